"""Whether a branch has been at a place before: at its beginning, or at a special point."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lapwing.studies.branch.motion.curve import NotCorrected, Place, Problem, corrected
from lapwing.studies.branch.motion.witness import strobed
from lapwing.studies.branch.special import Kind, Special

# Special points whose values differ by less, parts of the range, and their states, parts of the
# motion's size, are one; but not before the branch has been so far away, in its measure of length:
# impacts that are born one after the other before a chatter lie close together.
ONE_VALUE, ONE_STATE, AWAY = 1e-9, 1e-4, 1e-2
# By how much a place that is the first one again, some mesh cycles later, may be off.
ONE_PLACE = 1e-8


class Mark(NamedTuple):
    """A special point that was passed: φ and φ' at phase 0 (2, cycles), length of the way to it."""

    kind: Kind
    value: float
    states: NDArray[np.float64]
    length: float


def repeats_sooner(problem: Problem, place: Place) -> bool:
    """Whether a motion is one of fewer mesh cycles, gone through several times.

    Where the map has a corner, a branch of twice the period may meet the one it came from at an
    event, without a smooth doubling: what follows are the motions of that one.
    """
    cycles = place.layout.cycles
    if cycles == 1:
        return False
    states = strobed(problem, place.layout, place.z) / problem.scale
    return any(np.abs(states - np.roll(states, part, axis=1)).max() < ONE_PLACE
               for part in range(1, cycles) if cycles % part == 0)


@dataclass(eq=False)
class Passed:
    """Special points that a branch has passed.

    A curve passes none of its points twice unless it is closed: what follows was followed already.

    Attributes
    ----------
    marks : list of Mark
    """

    marks: list[Mark] = field(default_factory=list)

    def again(self, problem: Problem, special: Special, length: float) -> bool:
        """Whether a special point was passed already; if not it is from now on."""
        place = special.place
        if not special.error < ONE_VALUE * problem.unit:
            return False
        states = strobed(problem, place.layout, place.z) / problem.scale
        states[1] *= problem.oscillator(special.value).period
        for one in self.marks:
            if one.kind is special.kind and length - one.length > AWAY and abs(
                    one.value - special.value) < ONE_VALUE * problem.unit and _alike(
                        one.states, states):
                return True
        self.marks.append(Mark(special.kind, special.value, states, length))
        return False

    def behind(self) -> Passed:
        """The same for the other way from the beginning: all of it lies far away."""
        return Passed([one._replace(length=-math.inf) for one in self.marks])


def _alike(one: NDArray[np.float64], two: NDArray[np.float64]) -> bool:
    """Whether states are the same ones, some mesh cycles later or not."""
    return one.shape == two.shape and any(
        float(np.max(np.abs(np.roll(two, shift, axis=1) - one))) < ONE_STATE
        for shift in range(one.shape[1]))


def same_place(problem: Problem, one: Place, two: Place, step: float) -> bool:
    """Whether a place is less than a step behind another one, or behind it some mesh cycles later.

    A motion over several mesh cycles that begins with another one of them is the same motion.
    """
    if (one.layout.n, one.layout.cycles) != (two.layout.n, two.layout.cycles):
        return False
    weights = problem.weights(one.layout)
    if one.layout.same(two.layout) and is_back(weights, (one.z, one.tangent),
                                               (two.z, two.tangent), step):
        return True
    return any(is_back(weights, (one.z, one.tangent), (later.z, later.tangent), step)
               and _is_met(problem, one, later) for later in _later(one, two))


def is_back(weights: NDArray[np.float64], one: tuple[NDArray[np.float64], NDArray[np.float64]],
            two: tuple[NDArray[np.float64], NDArray[np.float64]], step: float) -> bool:
    """Whether two points, each with its tangent, lie within a step and go on the same way.

    Parameters
    ----------
    weights : array (n,), of the components in a length
    one, two : pairs of arrays (n,), point and tangent
    step : float, a length
    """
    away = math.sqrt(float(weights @ (one[0] - two[0]) ** 2))
    return away < step and float(weights @ (one[1] * two[1])) > 0.9


def _later(one: Place, two: Place) -> Iterator[Place]:
    """The second place so many mesh cycles later that its events may be those of the first."""
    layout, phase, first = one.layout, two.z[:-1:2], float(one.z[0])
    for shift in range(1, layout.cycles):
        away = phase - shift - first
        away -= layout.cycles * np.round(away / layout.cycles)
        begin = int(np.argmin(np.abs(away)))
        order = np.roll(np.arange(layout.n), -begin)
        if not (np.array_equal(two.layout.kind[order], layout.kind)
                and np.array_equal(two.layout.flank[order], layout.flank)):
            continue
        columns = np.append(np.column_stack([2 * order, 2 * order + 1]).ravel(), 2 * layout.n)
        z, tangent = two.z[columns], two.tangent[columns]
        # Those that came before the first one come after the last one now.
        z[2 * (layout.n - begin):-1:2] += layout.cycles
        z[:-1:2] -= shift + layout.cycles * round((z[0] - shift - first) / layout.cycles)
        yield Place(layout, z, tangent)


def _is_met(problem: Problem, one: Place, two: Place) -> bool:
    """Whether the curve through the second place passes the first, and no other beside it."""
    row = problem.weights(one.layout) * one.tangent
    step = float(row @ (one.z - two.z)) / float(row @ two.tangent)
    try:
        found, _ = corrected(problem, one.layout, two.z + step * two.tangent, row)
    except NotCorrected:
        return False
    return bool(np.max(np.abs(found - one.z)) < ONE_PLACE)
