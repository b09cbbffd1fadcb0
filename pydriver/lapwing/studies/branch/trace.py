"""A branch followed one way: steps, smooth special points, and where it meets a border."""

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
    borders_of,
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
    Seen,
    Turn,
    agrees,
    distance_at_turn,
    seen,
    turns_of,
)
from lapwing.studies.branch.special import Kind, Outcome, Point, Special

# Steps in the measure of length: mesh periods, scaled speeds, parts of the range.
FIRST_STEP, LONGEST, SHORTEST = 1e-3, 0.1, 1e-10
# The first step onto a branch that crosses another: nearer to the crossing nothing is told apart.
SWITCHED = 1e-2
# After a border the multipliers change fast; the first step is short and each is twice the last.
AFTER_BORDER = 1e-6
# Cosine of the most that the tangent may turn in one step.
TURN = 0.85
# A monitor function that is larger where it changes its sign jumps there.
NOT_ZERO = 1e-5


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
    """

    problem: Problem
    low: float
    high: float
    distance: float
    births: list[float] = field(default_factory=list)

    def point(self, place: Place) -> Point:
        """What there is to know at a place."""
        trace, det, rank = monodromy(self.problem, place.layout, place.z)
        return Point(self.problem.value(place.z), place, trace, det, rank,
                     multipliers_of(trace, det))

    def place(self, layout: Layout, z: NDArray[Any], along: NDArray[Any]) -> Place:
        """A place with its tangent, on the side of `along`."""
        return Place(layout, z, tangent_at(self.problem, layout, z, along))

    def ahead(self, place: Place, step: float, most: int = 12) -> tuple[Place, int]:
        """The curve a step further; NotCorrected where it is not found or lies elsewhere."""
        weights = self.problem.weights(place.layout)
        guess = place.z + step * place.tangent
        z, count = corrected(self.problem, place.layout, guess, weights * place.tangent, most)
        if math.sqrt(float(weights @ (z - guess) ** 2)) > 0.5 * abs(step) + 1e-12:
            raise NotCorrected("far from where it was expected")
        layout = moved_on(self.problem, place.layout, z)
        if layout is not place.layout:
            z, _ = corrected(self.problem, layout, z, weights * place.tangent)
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
            there = self.ahead(place, s, 20)[0] if s else place
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
        found = []
        for turn in turns:
            one, at = distance_at_turn(self.problem, place.layout, place.z, turn)
            two, _ = distance_at_turn(self.problem, ahead.layout, ahead.z, replace(turn, phase=at))
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
            if abs(value(there)) > NOT_ZERO:  # at a border the trace passes infinity
                continue
            yield self._along(before.place, there), self.named(there, kind, error)

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
        weights = self.problem.weights(ahead.layout)
        length = float((weights * before.place.tangent) @ (ahead.z - before.place.z))
        met = self.smooth(before, self.point(ahead), length)
        return [special for _, special in sorted(met, key=lambda one: one[0])]

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
    away = place.z[n:-1] - place.z[:n]
    away[::2] -= layout.cycles // 2
    return bool(np.max(np.abs(away)) < 1e-5)


@dataclass(frozen=True, eq=False)
class Path:
    """What following found: points in their order and special points by the point they follow."""

    points: list[Point]
    specials: list[tuple[int, Special]]
    end: Special


Beyond = Callable[[Follower, Crossing | str, Place], tuple[Special, Place | None]]


def follow(follower: Follower, start: Place, most: int, beyond: Beyond,
           critical: bool = False) -> Path:
    """Follow a branch until a reason ends it.

    1. A step along the tangent, corrected; halved where that fails, turns too far, or lands
       elsewhere.
    2. Conditions of its events that no longer hold are located, and the first one decides.
    3. Where they hold the engine is asked. What it sees besides is a flank touched on the way: the
       turn that did is located; a step that finds none is halved.
    4. Smooth special points in between are located, and the next step begins.
    5. At a border `beyond` tells what happens and where the branch goes on.

    Where a multiplier of the start is 1 already (`critical`), nothing is said of its trace.
    """
    points = [follower.point(start)]
    specials: list[tuple[int, Special]] = []
    place, step, turns = start, SWITCHED if critical else FIRST_STEP, _turns(follower, start)
    here = replace(points[0], trace=math.nan) if critical else points[0]

    def ended(kind: Kind, words: str) -> Path:
        return Path(points, specials, _ended(points[-1], kind, words))

    while len(points) <= most:
        taken, why = _step(follower, place, turns, step)
        if taken is None:
            special, after = beyond(follower, why, place)
        else:
            ahead, crossing = taken.place, taken.crossing
            value = follower.problem.value(ahead.z)
            outside = not follower.low < value < follower.high
            if outside:
                ahead, crossing = follower.at_limit(ahead, value), None
            for special in follower.between(here, ahead):
                specials.append((len(points) - 1, special))
                if special.outcome is Outcome.ENDS:
                    return Path([*points, follower.point(special.place)], specials, special)
            points.append(follower.point(ahead))
            if outside:
                return ended(Kind.LIMIT, "end of the range")
            if crossing is None:
                if len(points) > 5 and _same_place(follower, start, ahead, taken.step):
                    return ended(Kind.CLOSED, "back where it began")
                place, turns, step = taken.next, taken.turns, taken.longer
                here = points[-1] if place is ahead else follower.point(place)
                continue
            special, after = beyond(follower, crossing, ahead)
        specials.append((len(points) - 1, special))
        if after is None:
            return Path(points, specials, special)
        place, turns = after, _turns(follower, after)
        step = FIRST_STEP if special.kind is Kind.KNOT else AFTER_BORDER
        here = follower.point(place)
        points.append(here)
    return ended(Kind.POINTS, "as many points as were asked for")


def _turns(follower: Follower, place: Place) -> list[Turn]:
    found = seen(follower.problem, place.layout, place.z, follower.distance)
    return turns_of(place.layout, place.z, found)


@dataclass(frozen=True, eq=False)
class Taken:
    """A step: where it ends, the border that it meets, and from where the next one begins."""

    place: Place
    step: float
    crossing: Crossing | None
    next: Place
    turns: list[Turn]
    longer: float


def _step(follower: Follower, place: Place, turns: list[Turn],
          step: float) -> tuple[Taken | None, str]:
    """One step that is good, or why none is."""
    borders, why = borders_of(follower.problem, place.layout, place.z), ""
    while step > SHORTEST:
        try:
            return _taken(follower, place, turns, borders, step), ""
        except (NotCorrected, ValueError, OverflowError) as error:
            why = str(error)
            step *= 0.5 if step > 1e-5 else 0.1
    return None, why


def _taken(follower: Follower, place: Place, turns: list[Turn], borders: Borders,
           step: float) -> Taken:
    problem = follower.problem
    ahead, count = follower.ahead(place, step, 8)
    if problem.weights(place.layout) @ (place.tangent * ahead.tangent) < TURN and step > 1e-7:
        raise NotCorrected("the curve turns")
    passed = follower.borders_passed(place, borders, ahead, step)
    if not passed:
        found = seen(problem, ahead.layout, ahead.z, follower.distance)
        if agrees(ahead.layout, ahead.z, found):
            longer = min(LONGEST, step * (2.0 if count <= 3 or step < FIRST_STEP else
                                          1.3 if count <= 5 else 1.0))
            return Taken(ahead, step, None, _renewed(follower, ahead, found),
                         turns_of(ahead.layout, ahead.z, found), longer)
        passed = follower.turns_passed(place, turns, ahead, step)
        if not passed:
            raise NotCorrected("the engine sees another motion")
    first = min(passed, key=lambda one: one.at)
    return Taken(first.place, step, first, first.place, [], step)


def _renewed(follower: Follower, place: Place, found: Seen) -> Place:
    """The same place with as many bounces of a chatter as the engine lists."""
    layout = found.layout
    if layout is None or layout.n == place.layout.n or abs(place.tangent[-1]) < 0.3:
        return place
    try:
        z = follower.problem.packed(found.phase, found.speed, follower.problem.value(place.z))
        z = at_value(follower.problem, layout, z)
        along = np.zeros(len(z))
        along[-1] = math.copysign(1.0, place.tangent[-1])
        return follower.place(layout, z, along)
    except NotCorrected:
        return place


def _same_place(follower: Follower, one: Place, two: Place, step: float) -> bool:
    if not one.layout.same(two.layout):
        return False
    weights = follower.problem.weights(one.layout)
    away = math.sqrt(float(weights @ (one.z - two.z) ** 2))
    return away < step and float(weights @ (one.tangent * two.tangent)) > 0.9


def _ended(point: Point, kind: Kind, words: str) -> Special:
    error = 0.0 if kind is Kind.LIMIT else math.nan
    return Special(kind, Outcome.ENDS, point.value, error, words, 0, math.nan, point.place,
                   point.multipliers)
