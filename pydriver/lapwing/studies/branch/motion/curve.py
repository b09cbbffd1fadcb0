"""The curve of a motion's events and a parameter: correction, tangent, multipliers."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lapwing.model.oscillator import Oscillator
from lapwing.studies.branch.motion.equations import Events, blocks, residual
from lapwing.studies.branch.motion.flank_motion import FlankMotion, Motions
from lapwing.studies.branch.motion.layout import Layout

MOST_CORRECTIONS = 12
# A correction this small is rounding; so is one that no longer shrinks, is smaller than `CLOSE`,
# and leaves the equations off by no more than `SOLVED`: close to where branches cross the matrix
# is nearly singular and magnifies the last digits.
DONE, CLOSE, SOLVED = 1e-14, 1e-8, 1e-11
# What some roundings make of a number of size one.
ROUNDING = 1e-15
# Larger systems are solved as sparse ones; up to here LAPACK keeps to one thread, and is faster.
MOST_DENSE = 180
# Part of the parameter's scale over which the equations are differenced, in which most are linear:
# error 1e-6 of the derivative of the others, which bears on the speed of Newton's method and on
# nothing that is located: a fold is where the other columns alone are singular.
BY_PARAMETER = 1e-6
MOST_KEPT = 16


class NotCorrected(Exception):
    """Newton's method has not come back to the curve."""


@dataclass(frozen=True, eq=False)
class Place:
    """A point of the curve.

    Attributes
    ----------
    layout : Layout
    z : array (2n + 1,), phase and scaled speed of each event, and the scaled parameter
    tangent : array (2n + 1,), of unit length in the curve's measure
    """

    layout: Layout
    z: NDArray[Any]
    tangent: NDArray[Any]


@dataclass(frozen=True, eq=False)
class Problem:
    """An oscillator for each value of a parameter, and the scales of the unknowns.

    Attributes
    ----------
    make : callable(value) giving an Oscillator
    motions : Motions
    scale : float, rad; of angles, and over P of speeds
    unit : float, of the parameter
    """

    make: Callable[[float], Oscillator]
    motions: Motions
    scale: float
    unit: float
    kept: dict[float, Oscillator] = field(default_factory=dict)

    def value(self, z: NDArray[Any]) -> float:
        """The parameter."""
        return float(z[-1]) * self.unit

    def oscillator(self, value: float) -> Oscillator:
        """The oscillator at a value; the last few are kept."""
        if value not in self.kept:
            if len(self.kept) >= MOST_KEPT:
                self.kept.pop(next(iter(self.kept)))
            self.kept[value] = self.make(value)
        return self.kept[value]

    def at(self, z: NDArray[Any]) -> tuple[Events, Oscillator, FlankMotion]:
        """Events, oscillator and flank motion of a vector of unknowns."""
        osc = self.oscillator(self.value(z))
        return (Events(z[:-1:2], z[1:-1:2] * (self.scale / osc.period)), osc,
                self.motions.of(osc))

    def packed(self, phase: NDArray[Any], speed: NDArray[Any], value: float) -> NDArray[Any]:
        """The other way."""
        z = np.empty(2 * len(phase) + 1)
        z[:-1:2], z[-1] = phase, value / self.unit
        z[1:-1:2] = speed * (self.oscillator(value).period / self.scale)
        return z

    def weights(self, layout: Layout) -> NDArray[Any]:
        """Of the squares of the unknowns in the measure of length: their mean, and the value's."""
        return np.append(np.full(2 * layout.n, 1.0 / max(1, layout.n)), 1.0)

    def residual(self, layout: Layout, z: NDArray[Any]) -> NDArray[Any]:
        """By how much the equations are off, array (2n,)."""
        events, osc, motion = self.at(z)
        return residual(layout, events, osc, motion, self.scale)

    def linear(self, layout: Layout, z: NDArray[Any]) -> tuple[Any, Any, Any, Any]:
        """Residual, derivatives by the event before, by each event, and by the parameter."""
        found, one, two = self.by_events(layout, z)
        return found, one, two, self.by_value(layout, z, found)

    def by_events(self, layout: Layout, z: NDArray[Any]) -> tuple[Any, Any, Any]:
        """Residual, derivatives by the event before and by each event."""
        events, osc, motion = self.at(z)
        return blocks(layout, events, osc, motion, self.scale)

    def by_value(self, layout: Layout, z: NDArray[Any], here: NDArray[Any]) -> NDArray[Any]:
        """Derivative of the residual, which is `here` at z, by the scaled parameter."""
        step = np.zeros(len(z))
        step[-1] = BY_PARAMETER * max(1.0, abs(z[-1]))
        try:
            there = self.residual(layout, z + step)
        except ValueError:
            # No oscillator has more than the greatest value allowed.
            step = -step
            there = self.residual(layout, z + step)
        found: NDArray[Any] = (there - here) / step[-1]
        return found


class Bordered:
    """The matrix of the equations with one more row, factorised."""

    def __init__(self, one: NDArray[Any], two: NDArray[Any], by_value: NDArray[Any],
                 row: NDArray[Any]) -> None:
        n = len(one)
        at, before = np.arange(n), np.roll(np.arange(n), 1)
        size = 2 * n + 1
        where_row = (2 * at[:, None, None] + np.arange(2)[:, None]) + np.zeros((1, 1, 2), dtype=int)
        rows = np.concatenate([where_row.ravel()] * 2)
        columns = np.concatenate([
            (2 * k[:, None, None] + np.zeros((2, 1), dtype=int) + np.arange(2)).ravel()
            for k in (at, before)])
        values = np.concatenate([two.ravel(), one.ravel()])
        if size <= MOST_DENSE:
            from scipy.linalg.lapack import dgetrf, dgetrs

            matrix = np.zeros((size, size))
            np.add.at(matrix, (rows, columns), values)
            matrix[:-1, -1], matrix[-1] = by_value, row
            # A singular matrix is seen in `solve`; `scipy.linalg.lu_factor` would warn of it, too.
            factors, pivots, _ = dgetrf(matrix)
            self._solve: Any = lambda right, transposed: dgetrs(
                factors, pivots, right, trans=int(transposed))[0]
        else:
            from scipy.sparse import coo_matrix, vstack
            from scipy.sparse.linalg import splu

            last = np.full(2 * n, 2 * n)
            top = coo_matrix((np.append(values, by_value), (
                np.append(rows, np.arange(2 * n)), np.append(columns, last))),
                shape=(2 * n, size))
            try:
                factors = splu(vstack([top, row[None]]).tocsc())
            except RuntimeError as error:
                raise NotCorrected(str(error)) from None
            self._solve = lambda right, transposed: factors.solve(right, "NT"[transposed])

    def solve(self, right: NDArray[Any], transposed: bool = False) -> NDArray[Any]:
        """Solution, of the transposed matrix if asked for; NotCorrected where there is none."""
        with np.errstate(all="ignore"):
            found: NDArray[Any] = self._solve(right, transposed)
        if not np.all(np.isfinite(found)):
            raise NotCorrected("singular equations")
        return found


def corrected(problem: Problem, layout: Layout, z: NDArray[Any], row: NDArray[Any],
              most: int = MOST_CORRECTIONS) -> tuple[NDArray[Any], int]:
    """Newton's method from z onto the curve, in the plane through z that `row` is normal to.

    Returns
    -------
    z and how many corrections it took

    Raises
    ------
    NotCorrected
    """
    before = math.inf
    best = z
    by_value = np.empty(0)
    for count in range(most):
        found, one, two = problem.by_events(layout, z)
        # Near the curve it no longer changes.
        if before > 1e-3:
            by_value = problem.by_value(layout, z, found)
        if not np.all(np.isfinite(found)):
            raise NotCorrected("not finite")
        step = Bordered(one, two, by_value, row).solve(np.append(-found, 0.0))
        if not row[:-1].any():
            step[-1] = 0.0  # A value held: rounding must not lead out of what is allowed.
        size = float(np.max(np.abs(step)))
        if size > 10.0:
            raise NotCorrected("far away")
        if size >= 0.5 * before and before < CLOSE and np.max(np.abs(found)) < SOLVED:
            return best, count
        z = z + step
        best, before = z, size
        if size < DONE:
            return z, count
    if before < CLOSE and np.max(np.abs(problem.residual(layout, z))) < SOLVED:
        return z, most
    raise NotCorrected(f"still off by {before:.1e}")


def rounding(problem: Problem, layout: Layout, z: NDArray[Any], row: NDArray[Any]) -> float:
    """By how much a corrected parameter, scaled, may be off by rounding.

    Each equation is taken to be off by as much as the worst of them, or by the roundings of a
    phase: what a further correction finds of that is more or less by chance.
    """
    found, one, two = problem.by_events(layout, z)
    by_value = problem.by_value(layout, z, found)
    bordered = Bordered(one, two, by_value, problem.weights(layout) * row)
    size = max(float(np.max(np.abs(found))), ROUNDING * float(np.max(np.abs(z))))
    last = np.zeros(2 * layout.n + 1)
    last[-1] = 1.0
    influence = bordered.solve(last, transposed=True)[:-1]
    return size * float(np.linalg.norm(influence)) + ROUNDING * abs(float(z[-1]))


def spread(tried: list[tuple[float, float, Place]], s: float, left: float,
           direction: float) -> float:
    """By how much the parameter of a root may be off, from the values that led to it.

    The root lies between the nearest values of either sign; what is left of the function there,
    over its slope, is what its rounding hides. Along the curve the parameter moves with its
    direction, and at a fold with the square of the way alone.
    """
    sides = [min((abs(one - s) for one, found, _ in tried if sign * found >= 0), default=0.0)
             for sign in (1, -1)]
    away = max(tried, key=lambda one: abs(one[0] - s))
    far = min((one for one in tried if abs(one[0] - s) > 1e-4 * abs(away[0] - s)),
              key=lambda one: abs(one[0] - s))
    way = far[0] - s
    slope = abs(far[1] / way) if way else 0.0
    length = max(sides) + (left / slope if slope else 0.0)
    bend = abs((float(far[2].tangent[-1]) - direction) / way) if way else 0.0
    return abs(direction) * length + 0.5 * bend * length**2


def tangent_at(problem: Problem, layout: Layout, z: NDArray[Any],
               along: NDArray[Any]) -> NDArray[Any]:
    """Unit tangent whose product with `along` is positive."""
    _, one, two, by_value = problem.linear(layout, z)
    weights = problem.weights(layout)
    bordered = Bordered(one, two, by_value, weights * along)
    tangent = bordered.solve(np.append(np.zeros(2 * layout.n), 1.0))
    return tangent / math.sqrt(float(weights @ tangent**2))


def at_value(problem: Problem, layout: Layout, z: NDArray[Any]) -> NDArray[Any]:
    """Newton's method at the parameter of z."""
    row = np.zeros(len(z))
    row[-1] = 1.0
    return corrected(problem, layout, z, row, 30)[0]


def monodromy(problem: Problem, layout: Layout, z: NDArray[Any]) -> tuple[float, float, int]:
    """Trace and determinant of the map of a deviation once round, and its rank.

    A deviation of phase and speed of an event is one of the state by a change of variables, so that
    the multipliers are those of the map from cycle to cycle.
    """
    _, one, two = problem.by_events(layout, z)
    (a, b, c, d), log_det, sign, rank, exponent = (1.0, 0.0, 0.0, 1.0), 0.0, 1.0, 2, 0
    # Numbers, not arrays: of two by two they are ten times as fast.
    for ((p, q), (r, s)), ((e, f), (g, h)) in zip(one.tolist(), two.tolist(), strict=True):
        det, upper = e * h - f * g, p * s - q * r
        if det == 0:
            return math.nan, math.nan, rank
        p, q, r, s = ((f * r - h * p) / det, (f * s - h * q) / det,
                      (g * p - e * r) / det, (g * q - e * s) / det)
        a, b, c, d = p * a + q * c, p * b + q * d, r * a + s * c, r * b + s * d
        size = max(abs(a), abs(b), abs(c), abs(d))
        if size == 0:
            return 0.0, 0.0, 0
        shift = math.frexp(size)[1]
        a, b, c, d = (math.ldexp(x, -shift) for x in (a, b, c, d))
        exponent += shift
        if upper == 0:
            rank = 1
        else:
            log_det += math.log(abs(upper / det))
            sign *= math.copysign(1.0, upper / det)
    trace = (a + d) * 2.0**exponent
    return trace, sign * math.exp(log_det) if rank == 2 else 0.0, rank


def flipped(problem: Problem, place: Place) -> NDArray[Any]:
    """The deviation that changes its sign once round, where a multiplier is -1: array (2n,)."""
    _, one, two = problem.by_events(place.layout, place.z)
    one[0] *= -1
    # Any border makes the matrix regular; what it solves for turns into the direction that is lost.
    row = np.full(2 * len(one) + 1, 0.3) + 0.1 * np.cos(np.arange(2 * len(one) + 1))
    column = row[:-1]
    found = np.empty(0)
    for _ in range(3):
        right = np.zeros(len(row))
        right[-1] = 1.0
        found = Bordered(one, two, column, row).solve(right)
        row = found / np.max(np.abs(found))
    flip: NDArray[Any] = found[:-1] / np.max(np.abs(found[:-1]))
    return flip


def multipliers_of(trace: float, det: float) -> NDArray[Any]:
    """Both multipliers, the larger magnitude first: complex array (2,)."""
    if not math.isfinite(trace):
        return np.full(2, complex(math.nan))
    half = 0.5 * trace
    square = half * half - det
    if square < 0:
        root = math.sqrt(-square)
        return np.array([complex(half, root), complex(half, -root)])
    first = half + math.copysign(math.sqrt(square), half)
    return np.array([first, det / first if first else 0.0], dtype=complex)
