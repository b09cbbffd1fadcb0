"""Branches found so far, each of them once: a motion is known by its points."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lapwing.studies.branch.motion.witness import strobed
from lapwing.studies.branch.run import Branch
from lapwing.studies.branch.special import Kind, Outcome, Special

# Two motions whose states differ by less, parts of the motion's size, are one.
ONE_MOTION = 1e-8
# A motion is looked for on a branch that passes nearer to it than this, or than its points lie
# apart there.
NEAR = 1e-2
# Points by which branches are compared, and the part of them that must lie on the other: close to
# where a branch changes its events the other may not be solved for.
COMPARED, ENOUGH = 9, 0.7
# Doublings nearer to each other, parts of the range, with one state are one.
ONE_DOUBLING = 1e-7


class Match(NamedTuple):
    """Where a motion lies: the branch, by how much it is off (part of its size), a point beside."""

    branch: Branch
    distance: float
    point: int


def nearest(one: Branch, value: float, state: NDArray[np.float64], cycles: int) -> Match | None:
    """The place of a branch that is nearest to a motion at a value, or None where none is near.

    Parameters
    ----------
    one : Branch
    value : float, of the parameter
    state : array (2,), φ and φ' at phase 0
    cycles : int, mesh cycles after which it repeats
    """
    best = None
    if one.cycles != cycles:
        return None
    problem = one.follower.problem
    for near, far in one.passes(value):
        here, there = one.strobed[near], one.strobed[far]
        away = _away(here, state)
        if away > 2 * np.hypot(*(here - there)).max() + NEAR * problem.scale:
            continue
        point = one.near(near, far, value)
        if point is None:
            continue
        states = strobed(problem, point.place.layout, point.place.z)
        found = Match(one, _away(states, state) / problem.scale, near)
        if best is None or found.distance < best.distance:
            best = found
    return best


def _away(strobed: NDArray[np.float64], state: NDArray[np.float64]) -> float:
    return float(np.hypot(strobed[0] - state[0], strobed[1] - state[1]).min())


class Collection:
    """Branches, none of them twice.

    Attributes
    ----------
    branches : list of Branch
    """

    def __init__(self) -> None:
        self.branches: list[Branch] = []

    def match(self, value: float, state: NDArray[np.float64], cycles: int) -> Match | None:
        """The branch that a motion lies on, or None."""
        found = (nearest(one, value, state, cycles) for one in self.branches)
        return next((one for one in found if one is not None and one.distance < ONE_MOTION), None)

    def add(self, one: Branch) -> None:
        """Add a branch, unless it is part of one; those that are parts of it make room."""
        if any(_is_part(one, other) for other in self.branches):
            return
        self.branches = [other for other in self.branches if not _is_part(other, one)]
        self.branches.append(one)

    def doublings(self, highest: int) -> Iterator[tuple[Branch, Special]]:
        """Period doublings from which no branch is known that leaves there."""
        for one in tuple(self.branches):
            if 2 * one.cycles > highest:
                continue
            for special in one.of_kind(Kind.PERIOD_DOUBLING):
                if special.outcome is Outcome.PERSISTS and not self._leaves(one, special):
                    yield one, special

    def _leaves(self, one: Branch, doubling: Special) -> bool:
        """Whether a branch of twice the period ends at a doubling."""
        problem = one.follower.problem
        _, *state = one.state(doubling)
        for other in self.branches:
            if other.cycles != 2 * one.cycles:
                continue
            for end in other.of_kind(Kind.PERIOD_DOUBLING):
                if end.outcome is not Outcome.ENDS \
                        or abs(end.value - doubling.value) > ONE_DOUBLING * problem.unit:
                    continue
                states = strobed(other.follower.problem, end.place.layout, end.place.z)
                # Close to a doubling the motions part as the root of the distance.
                if _away(states, np.array(state)) < NEAR * problem.scale:
                    return True
        return False


def _is_part(one: Branch, other: Branch) -> bool:
    """Whether a branch lies on another."""
    if one.cycles != other.cycles or one is other:
        return False
    if one.values.min() > other.values.max() or one.values.max() < other.values.min():
        return False
    # Evenly along the parameter; the ends are where branches meet, of others too.
    way = np.append(0.0, np.cumsum(np.abs(np.diff(one.values))))
    numbers = np.unique(np.searchsorted(way, np.linspace(0, way[-1], COMPARED + 2)[1:-1]))
    hits = 0
    for left, k in enumerate(numbers[::-1]):
        found = nearest(other, one.points[k].value, one.strobed[k][:, 0], one.cycles)
        hits += found is not None and found.distance < 10 * ONE_MOTION
        if hits + len(numbers) - 1 - left < ENOUGH * len(numbers):
            return False
    return True
