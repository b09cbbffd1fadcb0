"""What is met between two places of a branch: smooth special points, and borders."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lapwing.studies.branch.motion.borders import (
    Borders,
    Condition,
    border_values,
    moved_on,
)
from lapwing.studies.branch.motion.curve import (
    NotCorrected,
    Place,
    Problem,
    at_value,
    corrected,
    monodromy,
    multipliers_of,
    rounding,
    spread,
    tangent_at,
)
from lapwing.studies.branch.motion.layout import Layout
from lapwing.studies.branch.motion.witness import (
    Course,
    Turn,
    distance_at_turn,
)
from lapwing.studies.branch.special import Kind, Outcome, Point, Special

# The parameter nearly turns where it moves slower than this part of its rate at either side.
NEARLY = 0.3
# A monitor function that is larger where it changes its sign jumps there; so does the direction of
# the parameter where it is more than this part of what it is at the ends of the step.
NOT_ZERO, NOT_TURNED = 1e-5, 1e-3
# Halves of a repetition whose unknowns differ by less are alike.
ALIKE = 1e-5


@dataclass(frozen=True, eq=False)
class Crossing:
    """A border that a step passes: where, and which one. `turn` for a flank touched on the way.

    `error` is by how much the parameter may be off.
    """

    at: float
    place: Place
    condition: Condition | None
    event: int
    turn: Turn | None = None
    error: float = math.nan


@dataclass(eq=False)
class Follower:
    """Follows a branch from a place in the direction of its tangent.

    Attributes
    ----------
    problem : Problem
    low, high : float, range of the parameter
    distance : float, rad; turns nearer to a flank than this are watched
    births : list of float, values at which impacts were born one after the other
    corners : list of float, values at which a bounce after the other passed a jump of the curvature
    """

    problem: Problem
    low: float
    high: float
    distance: float
    births: list[float] = field(default_factory=list)
    corners: list[float] = field(default_factory=list)

    def forget(self) -> None:
        """What is followed now begins elsewhere."""
        self.births.clear()
        self.corners.clear()

    def point(self, place: Place) -> Point:
        """What there is to know at a place."""
        trace, det, rank = monodromy(self.problem, place.layout, place.z)
        return Point(self.problem.value(place.z), place, trace, det, rank,
                     multipliers_of(trace, det))

    def place(self, layout: Layout, z: NDArray[Any], along: NDArray[Any]) -> Place:
        """A place with its tangent, on the side of `along`."""
        return Place(layout, z, tangent_at(self.problem, layout, z, along))

    def ahead(self, place: Place, step: float, most: int = 12,
              guess: NDArray[Any] | None = None) -> tuple[Place, int]:
        """The curve a step further; NotCorrected where it is not found or lies elsewhere."""
        weights = self.problem.weights(place.layout)
        if guess is None:
            guess = place.z + step * place.tangent
        z, count = corrected(self.problem, place.layout, guess, weights * place.tangent, most)
        if math.sqrt(float(weights @ (z - guess) ** 2)) > 0.5 * abs(step) + 1e-12:
            raise NotCorrected("far from where it was expected")
        layout = moved_on(self.problem, place.layout, z)
        if layout is not place.layout:
            z, _ = corrected(self.problem, layout, z, weights * place.tangent)
            if moved_on(self.problem, layout, z) is not layout:
                raise NotCorrected("a bounce lies on neither side of a knot")
        return self.place(layout, z, place.tangent), count

    def root(self, place: Place, step: float,
             value: Callable[[Place], float]) -> tuple[Place, float]:
        """Where a function of the place is zero between 0 and a step that it changes sign over.

        Returns
        -------
        the place, and by how much its parameter may be off (`spread`, `rounding`)
        """
        from scipy.optimize import brentq

        tried: list[tuple[float, float, Place]] = []

        def at(s: float) -> float:
            there = self.ahead(place, s, 20, self._between(place, s, tried))[0] if s else place
            found = value(there)
            if not math.isfinite(found):
                raise NotCorrected("no value")
            tried.append((s, found, there))
            return found

        try:
            brentq(at, 0.0, step, xtol=1e-16 * max(1.0, abs(step)) + 1e-17, rtol=8.9e-16)
        except ValueError:
            raise NotCorrected("no change of sign") from None
        s, found, there = min(tried, key=lambda one: abs(one[1]))
        off = spread(tried, s, abs(found), float(there.tangent[-1])) + rounding(
            self.problem, there.layout, there.z, there.tangent)
        return there, off * self.problem.unit

    def _between(self, place: Place, s: float,
                 tried: list[tuple[float, float, Place]]) -> NDArray[Any] | None:
        """Where the curve is expected between the nearest places known on either side: a cubic."""
        row = self.problem.weights(place.layout) * place.tangent
        known = [(one, there) for one, _, there in tried if there.layout is place.layout]
        low, high = (min((one for one in known if (one[0] - s) * sign > 0), default=None,
                         key=lambda one: abs(one[0] - s)) for sign in (-1, 1))
        if low is None or high is None:
            return None
        width = high[0] - low[0]
        t = (s - low[0]) / width
        first, last = (there.tangent * (width / float(row @ there.tangent))
                       for _, there in (low, high))
        one, two = low[1].z, high[1].z
        guess: NDArray[Any] = one + t * (
            first + t * (3 * (two - one) - 2 * first - last
                         + t * (first + last - 2 * (two - one))))
        return guess + (s - float(row @ (guess - place.z))) * place.tangent

    def borders_passed(self, place: Place, borders: Borders, ahead: Place,
                       step: float) -> list[Crossing]:
        """Conditions that hold at a place and no longer a step ahead, located."""
        after = border_values(self.problem, ahead.layout, ahead.z, borders)
        found = []
        for m in np.flatnonzero(~(after > 0)):
            one = Borders(borders.condition[m:m + 1], borders.event[m:m + 1])

            def value(p: Place, one: Borders = one) -> float:
                return float(border_values(self.problem, p.layout, p.z, one)[0])

            there, error = self.root(place, step, value)
            found.append(Crossing(self._along(place, there), there,
                                  Condition(int(borders.condition[m])), int(borders.event[m]),
                                  error=error))
        return found

    def _along(self, place: Place, there: Place) -> float:
        weights = self.problem.weights(place.layout)
        return float((weights * place.tangent) @ (there.z - place.z))

    def turns_passed(self, place: Place, turns: list[Turn], ahead: Place,
                     step: float) -> list[Crossing]:
        """Turns that lie off a flank (or inside it) at a place and no longer ahead."""
        found, courses = [], [Course(self.problem, p.layout, p.z) for p in (place, ahead)]
        for turn in turns:
            one, at = distance_at_turn(self.problem, place.layout, place.z, turn, courses[0])
            two, _ = distance_at_turn(self.problem, ahead.layout, ahead.z, replace(turn, phase=at),
                                      courses[1])
            if not (math.isfinite(one) and math.isfinite(two)) or one * two > 0:
                continue
            seed = [at]

            def value(p: Place, turn: Turn = turn, seed: list[float] = seed) -> float:
                distance, phase = distance_at_turn(self.problem, p.layout, p.z,
                                                   replace(turn, phase=seed[0]))
                seed[0] = phase
                return distance

            there, error = self.root(place, step, value)
            phase = distance_at_turn(self.problem, there.layout, there.z,
                                     replace(turn, phase=seed[0]))[1]
            found.append(Crossing(self._along(place, there), there, None, turn.arc,
                                  replace(turn, phase=phase), error))
        return found

    def smooth(self, before: Point, after: Point, step: float) -> Iterator[tuple[float, Special]]:
        """Smooth special points between two points of one curve."""
        one, two = before.monitors(), after.monitors()
        for kind in one:
            if not one[kind] * two[kind] < 0 or (
                    kind is Kind.BRANCH_POINT and one[Kind.FOLD] * two[Kind.FOLD] < 0):
                continue

            def value(p: Place, kind: Kind = kind) -> float:
                return self.point(p).monitors()[kind]

            try:
                there, error = self.root(before.place, step, value)
            except NotCorrected:
                continue
            most = NOT_ZERO if kind is not Kind.FOLD else min(
                NOT_ZERO, NOT_TURNED * max(abs(one[kind]), abs(two[kind])))
            if abs(value(there)) > most:  # at a border the trace passes infinity
                continue
            yield self._along(before.place, there), self.named(there, kind, error)

    def turns(self, place: Place, ahead: Place, step: float) -> bool:
        """Whether the parameter turns between two places as a curve does, or goes on."""
        one, two = float(place.tangent[-1]), float(ahead.tangent[-1])
        if one * two >= 0:
            return True
        try:
            there, _ = self.root(place, step, lambda p: float(p.tangent[-1]))
        except NotCorrected:
            return False
        return abs(float(there.tangent[-1])) < NOT_TURNED * max(abs(one), abs(two))

    def named(self, place: Place, kind: Kind, error: float) -> Special:
        """A smooth special point."""
        point = self.point(place)
        words, outcome = WORDS[kind], Outcome.PERSISTS
        if kind is Kind.FOLD:
            outcome = Outcome.TURNS_BACK
            if _halves_alike(place):
                kind, outcome = Kind.PERIOD_DOUBLING, Outcome.ENDS
                words = "meets the branch of half its period"
        return Special(kind, outcome, point.value, error, words, 0, math.nan, place,
                       point.multipliers)

    def between(self, before: Point, ahead: Place) -> list[Special]:
        """Smooth special points between two places of one curve, in their order."""
        specials, here = [], before
        for place in (*self._slowest(before.place, ahead), ahead):
            there = self.point(place)
            met = self.smooth(here, there, self._along(here.place, place))
            specials += [special for _, special in sorted(met, key=lambda one: one[0])]
            here = there
        return specials

    def _slowest(self, place: Place, ahead: Place, halvings: int = 8) -> list[Place]:
        """Places between two at which the parameter moves slowest: two folds may lie about one.

        By the cubic with the parameter and its direction at both; where that nearly turns, the
        curve itself is looked at.
        """
        length = self._along(place, ahead)
        row = self.problem.weights(place.layout) * place.tangent
        if place.layout is not ahead.layout or not length > 0 or not halvings:
            return []
        first, last = float(place.tangent[-1]), float(ahead.tangent[-1] / (row @ ahead.tangent))
        mean = float(ahead.z[-1] - place.z[-1]) / length
        bend = 3 * (first + last) - 6 * mean
        at = (2 * first + last - 3 * mean) / bend if bend else 0.0
        slow = first - bend * at * at
        if first * last <= 0 or not 0 < at < 1 \
                or slow * math.copysign(1.0, first) > NEARLY * min(abs(first), abs(last)):
            return []
        try:
            middle = self.ahead(place, at * length)[0]
        except NotCorrected:
            return []
        if middle.tangent[-1] * first <= 0:
            return [middle]
        return [*self._slowest(place, middle, halvings - 1), middle,
                *self._slowest(middle, ahead, halvings - 1)]

    def at_limit(self, place: Place, value: float) -> Place:
        """The curve at the end of the range that a value lies beyond, near a place."""
        z = place.z.copy()
        z[-1] = (self.low if value <= self.low else self.high) / self.problem.unit
        z = at_value(self.problem, place.layout, z)
        return self.place(place.layout, z, place.tangent)


WORDS = {Kind.FOLD: "two motions meet", Kind.BRANCH_POINT: "branches cross",
         Kind.PERIOD_DOUBLING: "a multiplier is -1",
         Kind.TORUS: "a pair of multipliers has magnitude one"}


def _halves_alike(place: Place) -> bool:
    """Whether the second half of a repetition is the first one again."""
    layout, n = place.layout, place.layout.n
    if layout.cycles % 2 or n % 2 or not np.array_equal(layout.kind[:n // 2], layout.kind[n // 2:]):
        return False
    away, along = place.z[n:-1] - place.z[:n], place.tangent
    away[::2] -= layout.cycles // 2
    apart = float(np.max(np.abs(away)))
    # They part as the root of the distance from where they are alike, one the other way.
    parts = float(np.max(np.abs(along[n:-1] + along[:n]))) / float(np.max(np.abs(along[:-1])))
    return apart < ALIKE or (apart < 10 * ALIKE and parts < 1e-3)
