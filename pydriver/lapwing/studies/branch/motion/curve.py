"""The curve of a motion's events and a parameter: correction, tangent, multipliers."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lapwing.engine.motions import (
    Blocks,
    bordered_solution,
    event_equations,
    numbers_of,
    round_trip,
)
from lapwing.model.oscillator import Oscillator
from lapwing.studies.branch.motion.equations import Events
from lapwing.studies.branch.motion.flank_motion import FlankMotion, Motions
from lapwing.studies.branch.motion.layout import Arc, Happening, Layout

MOST_CORRECTIONS = 12
# A correction this small is rounding; so is one that no longer shrinks, is smaller than `CLOSE`,
# and leaves the equations off by no more than `SOLVED`: close to where branches cross the matrix
# is nearly singular and magnifies the last digits.
DONE, CLOSE, SOLVED = 1e-14, 1e-8, 1e-11
# What some roundings make of a number of size one.
ROUNDING = 1e-15
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
        return self.by_events(layout, z)[0]

    def by_events(self, layout: Layout, z: NDArray[Any]) -> tuple[NDArray[Any], Blocks]:
        """By how much the equations are off, and their derivatives by the events."""
        osc = self.oscillator(self.value(z))
        motion = self.motions.of(osc)
        jumps = np.zeros(layout.n)
        if Arc.REST in layout.by_arc:
            for k in np.flatnonzero(layout.kind == Happening.AT_KINK):
                jumps[k] = motion.slope_jump(layout.piece[k])
        return event_equations(motion.curve(Arc.CONTACT in layout.by_arc),
                               numbers_of(osc, self.scale, layout.cycles), layout.table, jumps, z)

    def by_value(self, layout: Layout, z: NDArray[Any], here: NDArray[Any]) -> NDArray[Any]:
        """Derivative of the residual, which is `here` at z, by the scaled parameter."""
        step = np.zeros(len(z))
        step[-1] = BY_PARAMETER * max(1.0, abs(z[-1]))
        try:
            there = self.residual(layout, z + step)
        except ValueError:
            there = np.full(1, math.nan)
        if not np.all(np.isfinite(there)):
            # No oscillator has more than the greatest value allowed, no chatter dies out beyond the
            # value at which the last one does.
            step = -step
            there = self.residual(layout, z + step)
        found: NDArray[Any] = (there - here) / step[-1]
        return found


class Bordered:
    """The matrix of the equations with a column and a row more."""

    def __init__(self, blocks: Blocks, by_value: NDArray[Any], row: NDArray[Any]) -> None:
        self._all = blocks, by_value, row

    def solve(self, right: NDArray[Any]) -> NDArray[Any]:
        """Solution; NotCorrected where there is none."""
        found = bordered_solution(*self._all, right)
        if not np.all(np.isfinite(found)):
            raise NotCorrected("singular equations")
        return found

    def influence(self) -> NDArray[Any]:
        """By how much each equation moves the parameter, array (2n,)."""
        blocks, by_value, row = self._all
        n = blocks.one.shape[2]
        # The transposed equations are of the same kind, round the other way: event j is linked with
        # the one after it.
        back = slice(None, None, -1)
        one = np.asfortranarray(np.roll(blocks.one, -1, axis=2).transpose(1, 0, 2)[:, :, back])
        two = np.asfortranarray(blocks.two.transpose(1, 0, 2)[:, :, back])
        turned = [part[:2 * n].reshape(n, 2)[back].ravel() for part in (row, by_value)]
        right = np.zeros(2 * n + 1)
        right[-1] = 1.0
        found = bordered_solution(Blocks(one, two), np.ascontiguousarray(turned[0]),
                                  np.append(turned[1], row[-1]), right)
        if not np.all(np.isfinite(found)):
            raise NotCorrected("singular equations")
        return found[:-1]


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
        found, blocks = problem.by_events(layout, z)
        # Near the curve it no longer changes.
        if before > 1e-3:
            by_value = problem.by_value(layout, z, found)
        if not np.all(np.isfinite(found)):
            raise NotCorrected("not finite")
        step = Bordered(blocks, by_value, row).solve(np.append(-found, 0.0))
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
    found, blocks = problem.by_events(layout, z)
    by_value = problem.by_value(layout, z, found)
    bordered = Bordered(blocks, by_value, problem.weights(layout) * row)
    size = max(float(np.max(np.abs(found))), ROUNDING * float(np.max(np.abs(z))))
    return size * float(np.linalg.norm(bordered.influence())) + ROUNDING * abs(float(z[-1]))


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
    found, blocks = problem.by_events(layout, z)
    weights = problem.weights(layout)
    tangent = Bordered(blocks, problem.by_value(layout, z, found), weights * along).solve(
        np.append(np.zeros(2 * layout.n), 1.0))
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
    return round_trip(problem.by_events(layout, z)[1])


def flipped(problem: Problem, place: Place) -> NDArray[Any]:
    """The deviation that changes its sign once round, where a multiplier is -1: array (2n,)."""
    _, blocks = problem.by_events(place.layout, place.z)
    blocks.one[:, :, 0] *= -1
    # Any border makes the matrix regular; what it solves for turns into the direction that is lost.
    size = 2 * place.layout.n + 1
    row = np.full(size, 0.3) + 0.1 * np.cos(np.arange(size))
    column = row[:-1].copy()
    found = np.empty(0)
    for _ in range(3):
        right = np.zeros(len(row))
        right[-1] = 1.0
        found = Bordered(blocks, column, row).solve(right)
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
