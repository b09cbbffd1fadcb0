"""What may enter: every argument on its way to the compiled engine passes one of these converters.

Each takes the argument's name and what was given, and returns a plain Python or NumPy value or
raises TypeError (no such kind of thing) or ValueError (one out of range), naming the argument,
what was given, in bounded length, and what is expected. `complete` looks at the names of a call.
"""

from __future__ import annotations

import inspect
import math
import os
import warnings
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import cache, wraps
from numbers import Integral, Real
from typing import TYPE_CHECKING, Any, TypeVar, cast

import numpy as np

from lapwing.base.messages import cut, nearest
from lapwing.base.quantities import CURVE, PARAMETERS, base_name

if TYPE_CHECKING:
    from lapwing.base.codes import MotionState

Kind = TypeVar("Kind")
Called = TypeVar("Called", bound=Callable[..., Any])
# The engine counts in 32 bits.
MAX_INT = 2**31 - 1
# Parameters lie between these, or are zero: squares and the products of two of those stay far
# from overflow and underflow, so that no derived number becomes infinite, NaN or denormal.
LEAST, MOST = 1e-70, 1e70
SHOWN = 60


def shown(value: object) -> str:
    """A value as a message quotes it, at most `SHOWN` characters of it."""
    if isinstance(value, int) and value.bit_length() > 200:
        return f"a whole number of {value.bit_length()} bits"
    if isinstance(value, np.ndarray) and value.size > 8:
        return f"an array of shape {value.shape}"
    try:
        most = SHOWN if isinstance(value, str) else 20
        text = repr(value[:most] if isinstance(value, str | bytes | list | tuple) else value)
    except Exception:  # whatever a foreign object does when it is asked
        text = f"an object of type {type(value).__name__}"
    text = " ".join(text.split())
    return cut(text, SHOWN)


def wrong(name: str, value: object, expected: str) -> str:
    """The sentence that refuses an argument."""
    return f"{name} = {shown(value)}, expected {expected}"


def plain(value: object) -> object:
    """NumPy scalars and arrays without dimension as the Python number that they hold."""
    if value is np.ma.masked or (isinstance(value, np.ma.MaskedArray) and np.any(value.mask)):
        return value
    if isinstance(value, np.ndarray | np.generic) and value.ndim == 0 \
            and value.dtype.kind in "biuf":
        return value.item()
    return value


def _is_masked(value: object) -> bool:
    return value is np.ma.masked


def real(name: str, value: object, *, low: float = -MOST, high: float = MOST,
         above: float | None = None, below: float | None = None) -> float:
    """A finite number: low <= value <= high, above < value < below where these are given."""
    given = value if type(value) is float else plain(value)
    if isinstance(given, bool) or not isinstance(given, Real) or _is_masked(given):
        raise TypeError(wrong(name, value, _range("a number", low, high, above, below)))
    try:
        number = float(given)
        # The comparisons are written so that NaN fails them.
        if low <= number <= high and (above is None or number > above) \
                and (below is None or number < below):
            return number
    except (OverflowError, ValueError):
        pass
    raise ValueError(wrong(name, value, _range("a number", low, high, above, below)))


def positive(name: str, value: object) -> float:
    """A number above 0, between `LEAST` and `MOST`."""
    return real(name, value, low=LEAST)


def not_negative(name: str, value: object) -> float:
    """A number from 0 to `MOST`."""
    return real(name, value, low=0.0)


def whole(name: str, value: object, low: int = 0, high: int = MAX_INT - 1) -> int:
    """A whole number that the engine can count; 1.0 and True are none."""
    if type(value) is int and low <= value <= high:
        return value
    expected = f"a whole number from {low} to {high}"
    given = plain(value)
    if isinstance(given, bool) or not isinstance(given, Real) or _is_masked(given):
        raise TypeError(wrong(name, value, expected))
    if not isinstance(given, Integral):
        raise ValueError(wrong(name, value, expected))
    number = int(given)
    if not low <= number <= high:
        raise ValueError(wrong(name, value, expected))
    return number


def phase(name: str, value: object) -> float:
    """A mesh phase, 0 <= phase < 1."""
    return real(name, value, low=0.0, high=1.0, below=1.0)


def flag(name: str, value: object) -> bool:
    """True or False; 0 and 1 are none."""
    given = value if isinstance(value, bool) else plain(value)
    if not isinstance(given, bool):
        raise TypeError(wrong(name, value, "True or False"))
    return given


class ArgumentError(TypeError):
    """A call with names that are unknown, lacking or doubled; `problems` holds a sentence each."""

    def __init__(self, who: str, problems: Sequence[str]) -> None:
        self.who, self.problems = who, tuple(problems)
        super().__init__(f"{who}: " + "; ".join(self.problems))

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self), (self.who, self.problems)


def complete(*, old: Sequence[str] = (), operation: Callable[..., Any] | None = None,
             varied: str = "", one_of: Sequence[str] = ()) -> Callable[[Called], Called]:
    """Decorator of a function or class whose calls are looked at before anything is done.

    Parameters
    ----------
    old : old names of arguments, which `renamed` takes from ``**old``
    operation : method with the same decorator whose other arguments it takes as ``**operation``
    varied : the argument that names what is varied and so no part of the operation: a name, or a
        mapping of names
    one_of : names of which one is expected, told with other problems only

    Returns
    -------
    decorator; what it gives raises ArgumentError, a TypeError, with every problem of a call's names
    """
    def decorate(function: Called) -> Called:
        if isinstance(function, type):
            begin = cast(Any, function)
            begin.__init__ = _complete(begin.__init__, function.__name__, old, None, "", one_of)
            return function
        return cast(Called, _complete(function, function.__name__, old, operation, varied, one_of))
    return decorate


def _complete(function: Callable[..., Any], who: str, old: Sequence[str],
              operation: Any, varied: str, one_of: Sequence[str]) -> Callable[..., Any]:
    signature = inspect.signature(function).parameters
    bound = next(iter(signature), "") in ("self", "cls")
    own = {name: one for name, one in list(signature.items())[bound:]
           if one.kind is not one.VAR_KEYWORD}
    positional = [name for name, one in own.items() if one.kind is not one.KEYWORD_ONLY]
    needed = {name for name, one in own.items() if one.default is one.empty}
    others, wanted = [[name for name in names if name not in own] for names in operation.taken] \
        if operation else ([], [])
    one_of = operation.one_of if operation else one_of

    @cache
    def rules(count: int) -> tuple[frozenset[str], frozenset[str]]:
        """Names that may, and that must, follow so many arguments by position."""
        before = positional[:count]
        return (frozenset({*own, *old, *others}.difference(before)),
                frozenset(needed.difference(before)))

    def varying(args: tuple[Any, ...], given: dict[str, Any]) -> Iterable[str]:
        """What is varied; where that will be refused, all that is wanted, to say no more of it."""
        known = dict(zip(positional, args, strict=False)) | given
        what = known.get(varied, own[varied].default) if varied else ()
        names = (what,) if isinstance(what, str) else what if isinstance(what, Mapping) else ("",)
        return names if {*PARAMETERS, CURVE} >= set(map(base_name, names)) else wanted

    @wraps(function)
    def called(*args: Any, **given: Any) -> Any:
        count = len(args) - bound
        may, must = rules(min(count, len(positional)))
        if count > len(positional) or not given.keys() <= may or not must <= given.keys():
            # What its operation lacks alone is said by the operation, after the function's own say.
            there = {*given, *varying(args[bound:], given)}
            lacking = [name for name in (*own, *wanted) if name in must.union(wanted) - there]
            raise ArgumentError(who, _call_problems(
                positional, count, given, [*own, *others], may, lacking,
                one_of if there.isdisjoint(one_of) else ()))
        return function(*args, **given)

    cast(Any, called).taken = (list(own), [name for name in own if name in needed])
    cast(Any, called).one_of = one_of
    return called


def _call_problems(positional: list[str], count: int, given: dict[str, Any], known: list[str],
                   may: frozenset[str], lacking: list[str], one_of: Sequence[str]) -> list[str]:
    """One sentence for each name that does not fit, or is not there."""
    problems = []
    if count > len(positional):
        problems.append(f"{count} arguments without a name, expected at most {len(positional)}"
                        + f" ({', '.join(positional)}), others by name" * bool(positional))
    problems += [f"{name} is given twice" if name in known else
                 f"{shown(name)} is unknown, {nearest(name, known, 3)}"
                 for name in given if name not in may]
    for name in lacking:
        about = PARAMETERS.get(name)
        words = f", expected: {about.long_name}{f', {about.shown}' * bool(about.shown)}" \
            if about else ""
        problems.append(f"{name} is missing{words}")
    if one_of:
        problems.append(f"one of {', '.join(one_of)} is missing")
    return problems


def renamed(old: dict[str, Any], who: str, names: dict[str, tuple[str, Any]]) -> list[Any]:
    """Values of arguments some of which have old names; a warning for each old one.

    Parameters
    ----------
    old : keyword arguments by their old names, of a function that is `complete`
    who : the function
    names : old name -> (name today, its value)

    Returns
    -------
    list of the values, in the order of `names`
    """
    for name in old:
        # Of whoever called the function: `complete` stands between.
        warnings.warn(f"{who}: {name} is called {names[name][0]}", DeprecationWarning, stacklevel=4)
    return [old.get(name, value) for name, (_, value) in names.items()]


def choice(name: str, value: object, allowed: Iterable[str]) -> str:
    """One of some words."""
    if type(value) is str and value in allowed:
        return value
    expected = f"one of {', '.join(map(repr, allowed))}"
    if not isinstance(value, str):
        raise TypeError(wrong(name, value, expected))
    if value not in allowed:
        raise ValueError(wrong(name, value, expected))
    return str(value)


def choices(name: str, value: object, allowed: Iterable[str], *, least: int = 0) -> tuple[str, ...]:
    """Some of some words, each once; a single one of them is a list of one."""
    if isinstance(value, str) and value in allowed:
        return (str(value),)
    if type(value) is tuple and len(value) == 1 and type(value[0]) is str and value[0] in allowed:
        return value
    expected = f"one or more of {', '.join(map(repr, allowed))}, each once"
    try:
        words = None if isinstance(value, str | bytes | dict) \
            else tuple(cast(Iterable[Any], value))
    except TypeError:
        words = None
    if words is None:
        raise TypeError(wrong(name, value, expected))
    if len(words) < least:
        raise ValueError(f"{name} is empty, expected {expected}")
    if not all(isinstance(word, str) and word in allowed for word in words) \
            or len(set(words)) != len(words):
        raise ValueError(wrong(name, value, expected))
    return words


def path(name: str, value: object) -> str | os.PathLike[str]:
    """A path; a number would be taken for an open file, and that be closed."""
    expected = "a path: text or os.PathLike, not empty, without null characters"
    if not isinstance(value, str | os.PathLike):
        raise TypeError(wrong(name, value, expected))
    if "\0" in os.fsdecode(value) or not os.fsdecode(value):
        raise ValueError(wrong(name, value, expected))
    return value


def instance(name: str, value: object, kind: type[Kind]) -> Kind:
    """An object of a class of this package."""
    if not isinstance(value, kind):
        raise TypeError(wrong(name, value, f"an object of class {kind.__name__}"))
    return value


def function(name: str, value: object) -> Callable[..., Any]:
    """Something that can be called."""
    if not callable(value):
        raise TypeError(wrong(name, value, "something that can be called"))
    return value


def reals(name: str, value: object, *, ndim: int | None = None, empty: bool = False,
          largest: float = MOST) -> np.ndarray:
    """A new contiguous array of finite numbers; what is masked, complex, text or bool is none.

    Parameters
    ----------
    ndim : number of dimensions, or None for any; a single number is an array of one with ndim = 1
    empty : whether it may hold nothing
    largest : largest magnitude
    """
    if type(value) is np.ndarray and value.dtype == float and value.size \
            and ndim in (None, value.ndim) and -largest <= value.min() and value.max() <= largest:
        return np.array(value, order="C")
    expected = "an array of finite numbers" if ndim is None else \
        f"an array of {ndim} dimension{'s' * (ndim > 1)} of finite numbers"
    if np.ma.isMaskedArray(value) and np.any(np.ma.getmaskarray(value)):
        raise TypeError(wrong(name, value, f"{expected}, nothing masked"))
    try:
        array = np.asarray(value)
    except (ValueError, TypeError, OverflowError):
        raise ValueError(wrong(name, value, expected)) from None
    if array.size and array.dtype.kind == "O":
        array = _of_objects(name, value, array, expected)
    if array.size and array.dtype.kind not in "iuf":
        raise TypeError(wrong(name, value, expected))
    array = np.array(array, dtype=float, order="C", subok=False)
    if ndim == 1 and array.ndim == 0:
        array = array.reshape(1)
    if ndim is not None and array.ndim != ndim:
        raise ValueError(wrong(name, value, expected))
    if not array.size and not empty:
        raise ValueError(f"{name} is empty, expected {expected}, at least one")
    if not np.all(np.abs(array) <= largest):
        raise ValueError(wrong(name, value, f"{expected}, at most {largest:g} in magnitude"))
    return array


def _of_objects(name: str, value: Any, array: Any, expected: Any) -> Any:
    """Numbers that NumPy keeps as objects, such as whole ones beyond 64 bits."""
    try:
        return np.array([real(name, item) for item in array.flat]).reshape(array.shape)
    except TypeError:
        raise TypeError(wrong(name, value, expected)) from None
    except ValueError:
        raise ValueError(wrong(name, value, f"{expected}, at most {MOST:g} in magnitude")) from None


class Refusals:
    """Gathers what several converters refuse, so that all of it is said at once."""

    def __init__(self) -> None:
        self.problems: list[str] = []

    def take(self, converter: Callable[..., Any], name: str, value: object,
             *args: int | tuple[str, ...] | type, **kwargs: float) -> Any:
        """The converted value, or None where it is refused."""
        try:
            return converter(name, value, *args, **kwargs)
        except (TypeError, ValueError) as error:
            self.problems.append(str(error))
            return None

    def raise_if_any(self, what: str) -> None:
        """ValueError with every sentence."""
        if self.problems:
            raise ValueError(f"{what}: " + "; ".join(self.problems))


def _range(kind: str, low: float, high: MotionState | float, above: float | None,
           below: float | None) -> str:
    low_word = f"above {above:g}" if above is not None else f"from {low:g}"
    high_word = f"below {below:g}" if below is not None else f"to {high:g}"
    return f"{kind} {low_word} {high_word}" if math.isfinite(high) else f"{kind} {low_word}"
