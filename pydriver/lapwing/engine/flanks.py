"""Transmission errors as arrays that the engine takes, made once for each."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from lapwing.model.transmission_error.table import TransmissionError

# A longer harmonic series is taken from its table (flank/series.f90, max_terms).
MAX_TERMS = 8
# Transmission error -> its arrays as the engine takes them, by form.
_FLANKS: WeakKeyDictionary[
    TransmissionError, dict[tuple[str, bool], NDArray[Any]]] = WeakKeyDictionary()


def series_is_taken(te: TransmissionError) -> bool:
    """Whether the closed form takes a transmission error as its series, not as a table."""
    return 0 < len(te.harmonics) <= MAX_TERMS


def flank_argument(te: TransmissionError, centred: bool,
                   method: str | None = None) -> NDArray[Any]:
    """The transmission error as api.f90 takes it, (8, columns): a table, a harmonic series or both.

    Only differences of g matter unless the coast flank stands still; a table is then shifted
    (`centred`) to the middle of its range, so that a large constant costs no digits. It is made
    once, for as long as the transmission error lives.
    """
    made = _FLANKS.setdefault(te, {})
    form = method if method and series_is_taken(te) else "table"
    if (form, centred) not in made:
        made[form, centred] = _made_flank(te, centred, form)
    return made[form, centred]


def flank_arguments(tes: Sequence[TransmissionError], centred: bool, method: str) -> NDArray[Any]:
    """Several as api.f90 takes them, (8, columns, n), NaN behind the columns of each."""
    flanks = [flank_argument(te, centred, method) for te in tes]
    if len(flanks) == 1:
        return flanks[0][:, :, None]
    widest = max(flank.shape[1] for flank in flanks)
    every = np.full((8, widest, len(flanks)), np.nan, order="F")
    for i, flank in enumerate(flanks):
        every[:, :flank.shape[1], i] = flank
    return every


def _made_flank(te: TransmissionError, centred: bool, form: str) -> NDArray[Any]:
    series = np.zeros((8, len(te.harmonics)), order="F")
    series[:3], series[7] = te.harmonics.T, -1
    if form == "exact":
        return series
    knots, coefficients, kinks = te.knots, te.coefficients, te.kinks
    if form == "rk4":
        knots, coefficients = te.fine_table
        kinks = np.zeros(knots.size - 1)
    flank = np.zeros((8, knots.size), order="F")
    flank[0], flank[1:7, :-1], flank[7, :-1] = knots, coefficients.T, kinks
    if centred:
        flank[1, :-1] -= 0.5 * sum(te.extrema)
    return np.asfortranarray(np.hstack([flank, series])) if form == "rk4" else flank
