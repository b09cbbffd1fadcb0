"""A curve followed one way: its steps, and what ends it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lapwing.studies.branch.motion.curve import NotCorrected
from lapwing.studies.branch.special import Kind, Outcome
from lapwing.studies.branch.trace.passed import is_back
from lapwing.studies.curve.condition import SMOOTH
from lapwing.studies.curve.sheet import Spot
from lapwing.studies.curve.trace import NOT_ZERO, Meeting, State, Tracer

# Steps in the measure of length: mesh periods, scaled speeds, parts of both ranges.
FIRST_STEP, LONGEST, SHORTEST = 1e-3, 0.5, 1e-9
# The most that either parameter may move in one step, parts of its range, for a smooth figure.
MOST_OF_RANGE = 0.02
# Cosine of the most that the tangent may turn in one step.
TURN = 0.85
# Names of what two special points are that meet, the curve's own first.
NAMED = {(Kind.FOLD, Kind.FOLD): "cusp: two folds meet",
         (Kind.FOLD, Kind.PERIOD_DOUBLING): "multipliers 1 and -1",
         (Kind.PERIOD_DOUBLING, Kind.FOLD): "multipliers -1 and 1",
         (Kind.FOLD, Kind.TORUS): "both multipliers are 1",
         (Kind.PERIOD_DOUBLING, Kind.TORUS): "both multipliers are -1",
         (Kind.TORUS, Kind.FOLD): "both multipliers are 1",
         (Kind.TORUS, Kind.PERIOD_DOUBLING): "both multipliers are -1"}


@dataclass(frozen=True, eq=False)
class Way:
    """What following found: places in their order, and meetings by the place they follow."""

    spots: list[Spot]
    meetings: list[tuple[int, Meeting]]


def follow(tracer: Tracer, start: State, most: int, second: str) -> Way:
    """Follow a curve from a place in the direction of its tangent until a reason ends it.

    1. A step along the tangent, corrected onto the curve; halved where that fails or turns too far.
    2. At the end of either range the curve is solved there, and ends.
    3. Conditions of the motion's other events, and turns at a flank, that no longer hold are
       located; the first one ends the curve, unless it is a knot that it does not feel.
    4. The engine is asked whether it sees the motion; a step where it does not is halved.
    5. Where another smooth special point meets the curve it is located, and the curve goes on.
    """
    spots, state, step = [start.spot], start, FIRST_STEP
    meetings: list[tuple[int, Meeting]] = []

    def ended(kind: Kind, words: str, spot: Spot | None = None) -> Way:
        one = Meeting(kind, Outcome.ENDS, spot or spots[-1], words)
        return Way(spots, [*meetings, (len(spots) - 1, one)])

    why = ""
    while len(spots) <= most:
        if step < SHORTEST:
            return ended(Kind.UNRESOLVED, why)
        step = min(step, MOST_OF_RANGE / max(MOST_OF_RANGE, *np.abs(state.spot.tangent[-2:])))
        try:
            spot, limit = _ahead(tracer, state, step)
            passed = tracer.passed(state, spot, step)
            if passed:
                first = min(passed, key=lambda one: _way(tracer, state, one.spot))
                if first.outcome is Outcome.ENDS:
                    return _ended_by(spots, meetings, first)
                meeting, after = tracer.beyond_knot(state, first)
                if after is None:
                    return _ended_by(spots, meetings, meeting)
                spots.append(after.spot)
                state, step = after, max(FIRST_STEP * 0.1, 0.5 * step)
                continue
            if limit is not None:
                spots.append(spot)
                return ended(Kind.LIMIT, "end of the range of "
                             f"{('the first parameter', second)[limit]}")
            after = tracer.state(spot, state.condition)
            meetings += [(len(spots) - 1, one) for one in _between(tracer, state, after, step)]
        except (NotCorrected, ValueError, OverflowError) as error:
            why, step = str(error), 0.5 * step if step > 1e-5 else 0.1 * step
            continue
        spots.append(spot)
        if len(spots) > 5 and _closed(tracer, start.spot, spot, step):
            return ended(Kind.CLOSED, "back where it began")
        state = after
        step = min(LONGEST, step * (2.0 if spot.count <= 3 else 1.3 if spot.count <= 5 else 1.0))
    return ended(Kind.POINTS, "as many points as were asked for")


def _ahead(tracer: Tracer, state: State, step: float) -> tuple[Spot, int | None]:
    """The curve a step further or at the end of a range, and the number of that parameter."""
    try:
        spot = tracer.ahead(state, step)
        limit = tracer.held(state, spot.y)
    except (ValueError, OverflowError):
        # Beyond the end of a range there may be no oscillator.
        limit = tracer.held(state, state.spot.y + step * state.spot.tangent)
        if limit is None:
            raise
    if limit is not None:
        spot = limit[0]
    if tracer.sheet.weights(spot.layout) @ (spot.tangent * state.spot.tangent) < TURN:
        raise NotCorrected("the curve turns")
    return spot, None if limit is None else limit[1]


def _ended_by(spots: list[Spot], meetings: list[tuple[int, Meeting]], last: Meeting) -> Way:
    return Way([*spots, last.spot], [*meetings, (len(spots), last)])


def _way(tracer: Tracer, state: State, spot: Spot) -> float:
    """How far along the tangent a place lies."""
    return float((tracer.sheet.weights(spot.layout) * state.spot.tangent)
                 @ (spot.y - state.spot.y))


def _between(tracer: Tracer, state: State, after: State, step: float) -> list[Meeting]:
    """Smooth special points that meet the curve between two places of it."""
    found = []
    for kind, one in state.monitors.items():
        two = after.monitors[kind]
        if not one * two < 0:
            continue

        def value(spot: Spot, kind: Kind = kind) -> float:
            return tracer.monitors(spot)[kind]

        try:
            spot = tracer.root(state, step, value)
        except NotCorrected:
            continue
        # Where an impact has no speed a multiplier passes infinity.
        if abs(value(spot)) > NOT_ZERO * max(1.0, abs(one)):
            continue
        words = NAMED.get((tracer.kind, kind))
        if words is None and tracer.kind in SMOOTH:
            continue
        words = words or f"a {kind.name.lower().replace('_', ' ')} meets it"
        found.append(Meeting(kind, Outcome.PERSISTS, spot, words))
    return sorted(found, key=lambda one: _way(tracer, state, one.spot))


def _closed(tracer: Tracer, start: Spot, spot: Spot, step: float) -> bool:
    if not start.layout.same(spot.layout):
        return False
    return is_back(tracer.sheet.weights(spot.layout), (start.y, start.tangent),
                   (spot.y, spot.tangent), step)
