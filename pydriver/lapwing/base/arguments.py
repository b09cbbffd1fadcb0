"""What may enter: every argument on its way to the compiled engine passes one of these converters.

Each takes the argument's name and what was given, and returns a plain Python or NumPy value or
raises TypeError (no such kind of thing) or ValueError (one out of range), naming the argument,
what was given, in bounded length, and what is expected.
"""

from __future__ import annotations

import math
import os
import warnings
from collections.abc import Callable, Iterable
from numbers import Integral, Real
from typing import TYPE_CHECKING, Any, TypeVar, cast

import numpy as np

from lapwing.base.messages import cut

if TYPE_CHECKING:
    from lapwing.base.codes import MotionState

Kind = TypeVar("Kind")
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
        text = repr(value[:20] if isinstance(value, str | bytes | list | tuple) else value)
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


def renamed(old: dict[str, Any], who: str, names: dict[str, tuple[str, Any]]) -> list[Any]:
    """Values of arguments some of which have old names; a warning for each old one.

    Parameters
    ----------
    old : keyword arguments of a function that it does not know by their names today
    who : the function
    names : old name -> (name today, its value)

    Returns
    -------
    list of the values, in the order of `names`

    Raises
    ------
    TypeError
        for a keyword that is not even an old name.
    """
    for name in old.keys() - names.keys():
        raise TypeError(f"{who}() got an unexpected keyword argument {name!r}")
    values = []
    for name, (today, value) in names.items():
        if name in old:
            warnings.warn(f"{who}: {name} is called {today}", DeprecationWarning, stacklevel=3)
        values.append(old.get(name, value))
    return values


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
    """Some of some words, each once; a single word is no list of them."""
    if type(value) is tuple and len(value) == 1 and type(value[0]) is str and value[0] in allowed:
        return value
    expected = f"a tuple of {', '.join(map(repr, allowed))}, each once"
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
