"""A branch followed one way until a reason ends it."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lapwing.studies.branch.motion.borders import (
    Borders,
    borders_of,
    fewer,
)
from lapwing.studies.branch.motion.curve import (
    NotCorrected,
    Place,
    at_value,
    corrected,
)
from lapwing.studies.branch.motion.witness import (
    Seen,
    Turn,
    agrees,
    seen,
    turns_of,
    unlisted,
)
from lapwing.studies.branch.special import Kind, Outcome, Point, Special
from lapwing.studies.branch.trace.follower import Crossing, Follower
from lapwing.studies.branch.trace.passed import Passed, repeats_sooner, same_place

# Steps in the measure of length: mesh periods, scaled speeds, parts of the range.
FIRST_STEP, LONGEST, SHORTEST = 1e-3, 0.1, 1e-10
# The first step onto a branch that crosses another: nearer to the crossing nothing is told apart.
SWITCHED = 1e-2
# After a border the multipliers change fast; the first step is short and each is twice the last.
AFTER_BORDER = 1e-6
# Cosine of the most that the tangent may turn in one step, and how much farther than by the rate at
# either end the parameter may move, but for rounding: more, and it is another curve that was met.
TURN, FASTER, LEAST_MOVE = 0.85, 2.0, 1e-9

AGAIN = Kind.JOINS, "at a special point that it has passed already"
SOONER = "it comes upon a branch of fewer mesh cycles, which it would go along several times"


@dataclass(frozen=True, eq=False)
class Path:
    """What following found: points in their order and special points by the point they follow."""

    points: list[Point]
    specials: list[tuple[int, Special]]
    end: Special


Beyond = Callable[[Follower, Crossing | str, Place], tuple[Special, Place | None]]


def follow(follower: Follower, start: Place, most: int, beyond: Beyond,
           critical: bool = False, unstable: int | None = None,
           passed: Passed | None = None) -> Path:
    """Follow a branch until a reason ends it.

    1. A step along the tangent, corrected; halved where that fails, turns too far, or lands
       elsewhere.
    2. Conditions of its events that no longer hold are located, and the first one decides.
    3. Where they hold the engine is asked. What it sees besides is a flank touched on the way: the
       turn that did is located; a step that finds none is halved.
    4. Smooth special points in between are located, and the next step begins.
    5. At a border `beyond` tells what happens and where the branch goes on.

    After so many points in a row that are `unstable` it ends, too, and where it comes upon a
    special point that was `passed` already.

    Where a multiplier of the start is 1 already (`critical`), nothing is said of its trace.
    """
    points = [follower.point(start)]
    specials: list[tuple[int, Special]] = []
    place, step, turns = start, SWITCHED if critical else FIRST_STEP, _turns(follower, start)
    here = replace(points[0], trace=math.nan) if critical else points[0]
    passed, length = passed or Passed(), 0.0

    def ended(kind: Kind, words: str) -> Path:
        return Path(points, specials, _ended(points[-1], kind, words))

    while len(points) <= most:
        if unstable is not None and len(points) > unstable \
                and not any(one.stable for one in points[-unstable:]):
            return ended(Kind.POINTS, "as many unstable points in a row as were asked for")
        taken, why = _step(follower, place, turns, step)
        if taken is None:
            limit = _last_before_limit(follower, place)
            if limit is not None:
                points.append(follower.point(limit))
                return ended(Kind.LIMIT, "end of the range")
            special, after = beyond(follower, why, place)
        else:
            ahead, crossing = taken.place, taken.crossing
            value = follower.problem.value(ahead.z)
            outside = not follower.low < value < follower.high
            if outside:
                ahead, crossing = follower.at_limit(ahead, value), None
            for special in follower.between(here, ahead):
                # Where the parameter turns at the border itself there is no fold before it.
                if crossing is not None and special.kind is Kind.FOLD and abs(
                        special.value - value) <= special.error + crossing.error:
                    continue
                specials.append((len(points) - 1, special))
                if special.outcome is Outcome.ENDS:
                    return Path([*points, follower.point(special.place)], specials, special)
                if passed.again(follower.problem, special, length):
                    points.append(follower.point(special.place))
                    return ended(*AGAIN)
            length += taken.step
            points.append(follower.point(ahead))
            if outside:
                return ended(Kind.LIMIT, "end of the range")
            if crossing is None:
                if len(points) > 5 and same_place(follower.problem, start, ahead, taken.step):
                    return ended(Kind.CLOSED, "back where it began")
                place, turns, step = taken.next, taken.turns, taken.longer
                here = points[-1] if place is ahead else follower.point(place)
                continue
            special, after = beyond(follower, crossing, ahead)
        if after is not None and repeats_sooner(follower.problem, after):
            special, after = replace(special, outcome=Outcome.ENDS, words=SOONER), None
        specials.append((len(points) - 1, special))
        if after is None:
            return Path(points, specials, special)
        if passed.again(follower.problem, special, length):
            return ended(*AGAIN)
        place, turns = after, _turns(follower, after)
        step = FIRST_STEP if special.kind is Kind.KNOT else AFTER_BORDER
        here = follower.point(place)
        points.append(here)
    return ended(Kind.POINTS, "as many points as were asked for")


def _last_before_limit(follower: Follower, place: Place) -> Place | None:
    """The curve at the end of the range where the shortest step goes beyond it; else None.

    Where no oscillator has a value beyond, as of `restitution` 1, no step passes the end.
    """
    problem = follower.problem
    rate = float(place.tangent[-1])
    limit = follower.high if rate > 0 else follower.low
    # A step that fails may have been ten times as long before.
    if abs(limit - problem.value(place.z)) > 10 * SHORTEST * abs(rate) * problem.unit:
        return None
    try:
        return follower.at_limit(place, limit)
    except (NotCorrected, ValueError, OverflowError):
        return None


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
    if problem.weights(place.layout) @ (place.tangent * ahead.tangent) < TURN:
        raise NotCorrected("the curve turns")
    # Two curves cross where a branch of twice the period leaves: it turns back there.
    if repeats_sooner(problem, ahead) and not repeats_sooner(problem, place):
        raise NotCorrected("the motion of fewer mesh cycles")
    _moved_alike(place, ahead, step)
    passed = follower.borders_passed(place, borders, ahead, step)
    if not passed:
        found = seen(problem, ahead.layout, ahead.z, follower.distance)
        if agrees(ahead.layout, ahead.z, found):
            if not follower.turns(place, ahead, step):
                raise NotCorrected("the parameter turns without a fold")
            longer = min(LONGEST, step * (2.0 if count <= 3 or step < FIRST_STEP else
                                          1.3 if count <= 5 else 1.0))
            after = _renewed(follower, ahead, found)
            return Taken(ahead, step, None, after, turns_of(after.layout, after.z, found), longer)
        passed = follower.turns_passed(place, turns, ahead, step)
        if not passed:
            raise NotCorrected("the engine sees another motion")
    else:
        # A flank may be touched before the border.
        border = min(passed, key=lambda one: one.at)
        if border.at > 0:
            passed += follower.turns_passed(place, turns, border.place, border.at)
    first = min(passed, key=lambda one: one.at)
    return Taken(first.place, step, first, first.place, [], step)


def _moved_alike(place: Place, ahead: Place, step: float) -> None:
    """NotCorrected where the parameter moved otherwise than the rates at both ends let it."""
    one, two = float(place.tangent[-1]), float(ahead.tangent[-1])
    moved = float(ahead.z[-1] - place.z[-1])
    if abs(moved) > FASTER * step * max(abs(one), abs(two)) + LEAST_MOVE \
            or one * two > 0 > moved * one + LEAST_MOVE * abs(one):
        raise NotCorrected("the parameter moves otherwise than the curve leads")


def _renewed(follower: Follower, place: Place, found: Seen) -> Place:
    """The same place with as many bounces of a chatter as are fast there."""
    if found.layout is None or not place.layout.chatters:
        return place
    try:
        layout, z = fewer(follower.problem, found.layout, follower.problem.packed(
            found.phase, found.speed, follower.problem.value(place.z)))
        if layout.n == place.layout.n:
            return place
        summed = unlisted(place.layout, place.z[:-1:2], layout, z[:-1:2])
        if len(summed) == place.layout.n - layout.n:
            return _without_bounces(follower, place, summed)
        if abs(place.tangent[-1]) < 0.3:
            return place
        z = at_value(follower.problem, layout, z)
        along = np.zeros(len(z))
        along[-1] = math.copysign(1.0, place.tangent[-1])
        return follower.place(layout, z, along)
    except NotCorrected:
        return place


def _without_bounces(follower: Follower, place: Place, summed: NDArray[Any]) -> Place:
    """The same place with some of the last bounces summed."""
    problem = follower.problem
    osc = problem.oscillator(problem.value(place.z))
    layout = place.layout.without(summed, osc.contact_law == "rigid")
    kept = place.layout.columns_without(summed)
    z, along = place.z[kept], place.tangent[kept]
    z, _ = corrected(problem, layout, z, problem.weights(layout) * along)
    return follower.place(layout, z, along)


def _ended(point: Point, kind: Kind, words: str) -> Special:
    error = 0.0 if kind is Kind.LIMIT else math.nan
    return Special(kind, Outcome.ENDS, point.value, error, words, 0, math.nan, point.place,
                   point.multipliers)
