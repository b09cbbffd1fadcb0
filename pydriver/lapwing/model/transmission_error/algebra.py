"""Sums, multiples and shifts of transmission errors, as new ones."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.polynomial import polynomial as power

if TYPE_CHECKING:
    from lapwing.model.transmission_error.table import TransmissionError

# Knots nearer to each other than this are one: phases made from angles are good to about 1e-15.
SAME_KNOT = 1e-14


class Parts(NamedTuple):
    """What a `TransmissionError` is made of: knots, coefficients, kinks, harmonics."""

    knots: np.ndarray
    coefficients: np.ndarray
    kinks: np.ndarray
    harmonics: np.ndarray


def parts_of(te: TransmissionError) -> Parts:
    """The arrays of one, in their order."""
    return Parts(te.knots, te.coefficients, te.kinks, te.harmonics)


def multiple(te: Parts, factor: float) -> Parts:
    """Every value times a number."""
    return Parts(te.knots, factor * te.coefficients, te.kinks,
                 te.harmonics * np.array([1.0, factor, 1.0]))


def with_amplitudes(te: TransmissionError, amplitudes: Mapping[int, float]) -> TransmissionError:
    """A harmonic series with other amplitudes (rad) of some of its terms, counted from 1.

    Raises
    ------
    ValueError
        where there is no such term, or no series; and as of `TransmissionError.harmonic`.
    """
    orders, values, shifts = te.harmonics.copy().T
    for number, value in amplitudes.items():
        if not 1 <= number <= len(values):
            raise ValueError(
                f"harmonic_amplitude_{number} goes with TransmissionError.harmonic of so many "
                f"amplitudes; this one has {len(values) or 'no series'}")
        values[number - 1] = value
    return replace(type(te).harmonic(values, shifts, orders), te_sign_hint=te.te_sign_hint)


def total(one: Parts, other: Parts) -> Parts:
    """The sum of two; of harmonic series it is one, of anything else a table.

    Both are expanded about the knots of both, where a piece of either may begin; a kink of one is
    a kink of the sum.
    """
    knots = one.knots
    for knot in other.knots:
        if np.abs(knots - knot).min() > SAME_KNOT:
            knots = np.insert(knots, np.searchsorted(knots, knot), knot)
    kinks = np.zeros(knots.size - 1, dtype=bool)
    for part in (one, other):
        at = np.abs(knots[:, None] - part.knots[:-1][part.kinks]).argmin(axis=0)
        kinks[at] = True
    series = np.vstack([one.harmonics, other.harmonics]) \
        if len(one.harmonics) and len(other.harmonics) else np.zeros((0, 3))
    return Parts(knots, _expanded(one, knots) + _expanded(other, knots), kinks, series)


def shifted(te: Parts, phase: float) -> Parts:
    """The same error so much later: what happened at phase p happens at p + phase."""
    phase = phase % 1.0
    moved = np.sort((te.knots[:-1] + phase) % 1.0)
    moved[moved > 1 - SAME_KNOT] = 0.0
    knots = np.unique(np.concatenate([[0.0], moved, [1.0]]))
    knots = knots[np.append(np.diff(knots) > SAME_KNOT, True)]
    knots[0] = 0.0
    kinks = np.zeros(knots.size - 1, dtype=bool)
    for knot in (te.knots[:-1][te.kinks] + phase) % 1.0:
        away = np.abs(knots[:-1] - knot)
        kinks[np.minimum(away, 1 - away).argmin()] = True
    harmonics = te.harmonics.copy()
    if len(harmonics):
        harmonics[:, 2] = np.mod(harmonics[:, 2] - 2 * np.pi * harmonics[:, 0] * phase, 2 * np.pi)
    middles = (0.5 * (knots[1:] + knots[:-1]) - phase) % 1.0
    piece = np.searchsorted(te.knots, middles, side="right") - 1
    # From the piece's own beginning to the new one: the same distance before and after the shift.
    begins = middles - 0.5 * np.diff(knots) - te.knots[piece]
    return Parts(knots, _about(te.coefficients[piece], begins), kinks, harmonics)


def _expanded(te: Parts, knots: np.ndarray) -> np.ndarray:
    """Coefficients of each piece between finer knots."""
    piece = np.searchsorted(te.knots, 0.5 * (knots[1:] + knots[:-1]), side="right") - 1
    return _about(te.coefficients[piece], knots[:-1] - te.knots[piece])


def _about(coefficients: np.ndarray, offset: np.ndarray) -> np.ndarray:
    """The same polynomials in powers of the distance from another point (Taylor)."""
    return np.stack([
        power.polyval(offset, power.polyder(coefficients, k, axis=1).T, tensor=False)
        / math.factorial(k) for k in range(6)], axis=1)
