"""The transmission error where it is varied itself: whole curves, or amplitudes of a series."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from lapwing.base import arguments
from lapwing.base.quantities import CURVE, term
from lapwing.model.transmission_error.algebra import parts_of, with_amplitudes
from lapwing.results.curve import source_of
from lapwing.results.shards import inputs_digest

if TYPE_CHECKING:
    from lapwing.base.arguments import Refusals
    from lapwing.model.transmission_error.table import TransmissionError

# Curves of amplitudes that are kept: runs of a map come back to the same ones.
MOST_KEPT = 2048


@dataclass(frozen=True, eq=False)
class Curves:
    """Transmission errors by what varies them.

    Attributes
    ----------
    given : TransmissionError, of everything that does not name another
    named : mapping of label -> TransmissionError, the values of the axis `te`
    """

    given: TransmissionError
    named: Mapping[str, TransmissionError] = field(default_factory=dict)
    _made: dict[Any, TransmissionError] = field(default_factory=dict, repr=False)

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self), (self.given, dict(self.named))

    def at(self, values: Mapping[str, Any]) -> TransmissionError:
        """The curve at values of the parameters, whatever else is among them.

        Raises
        ------
        ValueError
            for an amplitude that the series does not have.
        """
        if CURVE in values:
            return self.named[str(values[CURVE])]
        changed = {number: float(value) for name, value in values.items()
                   if (number := term(name)) is not None}
        if not changed:
            return self.given
        key = tuple(changed.items())
        if key not in self._made:
            if len(self._made) >= MOST_KEPT:
                self._made.clear()
            self._made[key] = with_amplitudes(self.given, changed)
        return self._made[key]

    def each(self, values: Mapping[str, NDArray[Any]]) -> tuple[
            tuple[TransmissionError, ...], NDArray[np.intp]]:
        """Curves at values of many runs, (n,) arrays, and (n,) which of them each run has."""
        own = {name: array for name, array in values.items() if varies_curve(name)}
        count = len(next(iter(values.values())))
        if not own:
            return (self.given,), np.zeros(count, np.intp)
        rows = list(zip(*own.values(), strict=True))
        places: dict[tuple[Any, ...], int] = {}
        curve = np.array([places.setdefault(row, len(places)) for row in rows], np.intp)
        return tuple(self.at(dict(zip(own, row, strict=True))) for row in places), curve

    @property
    def told(self) -> dict[str, tuple[str, NDArray[Any], dict[str, str]]]:
        """Variables of a result along the axis `te`, by which it names its curves; none without."""
        columns = {
            "curve_source": ("", "what the curve was made from", source_of),
            "curve_peak_to_peak": ("rad", "peak to peak of the curve", lambda te: te.peak_to_peak),
            "curve_sha256": ("", "SHA-256 of the curve's knots, coefficients, kinks and harmonics",
                             lambda te: inputs_digest({}, *parts_of(te)))}
        return {name: (CURVE, np.array([of(te) for te in self.named.values()]),
                       {"units": unit, "long_name": words})
                for name, (unit, words, of) in columns.items() if self.named}

    def parts(self) -> Iterator[NDArray[Any]]:
        """The arrays of all of them, for a digest."""
        for te in (self.given, *self.named.values()):
            yield from parts_of(te)


def curves_of(te: TransmissionError | Curves) -> Curves:
    """`Curves` of a transmission error, which may be some already."""
    return te if isinstance(te, Curves) else Curves(te)


def varies_curve(name: str) -> bool:
    """Whether a parameter moves the shape of the transmission error, not a number alone."""
    return name == CURVE or term(name) is not None


def taken_axes(taken: Refusals, te: TransmissionError, given: Mapping[str, Any],
               words: str = "") -> tuple[dict[str, NDArray[Any]], Curves]:
    """Values of each parameter as given to a study, and the curves that they mean.

    Parameters
    ----------
    taken : Refusals, where problems go
    te : TransmissionError
    given : parameter -> values: numbers, or, of `te`, a mapping of label -> TransmissionError
    words : str, what values are called; default: the parameter

    Returns
    -------
    dict of parameter -> array: numbers that rise, or labels in the order given; and the curves
    """
    values, curves = dict[str, Any](), Curves(te)
    for name, one in given.items():
        if name != CURVE:
            values[name] = _rising(taken.take(arguments.reals, words or name, one))
            continue
        named = taken.take(_labelled, words or name, one)
        if named:
            values[name], curves = np.array(list(named)), Curves(te, named)
    return values, curves


def _rising(numbers: NDArray[Any] | None) -> NDArray[Any] | None:
    """Sorted and without repeats, as they mostly are."""
    if numbers is None or (numbers.ndim == 1 and (numbers[1:] > numbers[:-1]).all()):
        return numbers
    return np.unique(numbers)


def _labelled(name: str, given: Any) -> dict[str, TransmissionError]:
    """Transmission errors by label, one at least."""
    from lapwing.model.transmission_error.table import TransmissionError

    if not isinstance(given, Mapping) or not given or not all(
            isinstance(label, str) and label and isinstance(te, TransmissionError)
            for label, te in given.items()):
        raise TypeError(arguments.wrong(name, given, "{label: TransmissionError}, one or more"))
    return dict(given)


__all__ = ["Curves", "curves_of", "taken_axes", "varies_curve"]
