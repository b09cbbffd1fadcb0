"""What becomes of a branch where its motion meets a border.

At a border the events change: one is lost or born with no speed, or one comes upon another piece of
the table. The motion there is a point of the curve before and of the curve beyond, if there is one,
and the tangent of the latter says whether the parameter goes on the same way.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lapwing.studies.branch.motion.borders import Condition, fewer
from lapwing.studies.branch.motion.curve import (
    NotCorrected,
    Place,
    Problem,
    at_value,
    corrected,
)
from lapwing.studies.branch.motion.layout import Arc, Happening, Layout, of_parts
from lapwing.studies.branch.motion.witness import (
    Seen,
    Turn,
    agrees,
    distance_at_turn,
    seen,
    states_at,
)
from lapwing.studies.branch.special import Kind, Outcome, Special
from lapwing.studies.branch.trace.corner import around, piled_up
from lapwing.studies.branch.trace.follower import Crossing, Follower

# Events so near to each other, mesh periods, with no speed, come to nothing together.
TOGETHER, NO_SPEED = 1e-6, 1e-6
# Parts of the range at which the engine is asked what lies beyond.
ASKED = (1e-7, 1e-6, 1e-5, 1e-4, 1e-3)
# What lies beyond a place from which no step was found is seen so many times nearer than it may be.
STUCK = 4
# The last complete chatter is looked for to this, parts of the range, and is off by `SUMMED`: so
# far from it what the equations neglect of the last bounces lets one more be complete.
LAST, SUMMED = 1e-12, 1e-11
# Impacts born one after the other within this part of the range are the onset of a chatter.
PILED_UP = 1e-10


def beyond(follower: Follower, crossing: Crossing | str,
           place: Place) -> tuple[Special, Place | None]:
    """The special point at a border, and the place from which the branch goes on, or None.

    Instead of a border there may be a reason why no step further was found.
    """
    if isinstance(crossing, str):
        return _stuck(follower, crossing, place)
    if crossing.turn is None:
        follower.births.clear()
    if crossing.condition in (Condition.BEGUN, Condition.NOT_ENDED):
        return _at_knot(follower, crossing, place)
    if crossing.condition is Condition.PRESSED:
        return _found(follower, crossing, place, Kind.CHATTER, "bounces no longer die out", None)
    if crossing.condition is Condition.REBOUNDS:
        return _found(follower, crossing, place, Kind.REBOUND,
                      "the speed after an impact passes zero", None)
    if crossing.turn is not None:
        return _touched(follower, crossing, place)
    return _lost(follower, crossing, place)


def _found(follower: Follower, crossing: Crossing, place: Place, kind: Kind, words: str,
           after: Place | None, error: float = 0.0) -> tuple[Special, Place | None]:
    """A special point and what follows, said in its outcome; `error` on top of the crossing's."""
    outcome = Outcome.ENDS
    if after is not None:
        same = after.tangent[-1] * place.tangent[-1] > 0
        outcome = Outcome.PERSISTS if same else Outcome.TURNS_BACK
    turn, point = crossing.turn, follower.point(place)
    flank = turn.flank if turn else int(place.layout.flank[crossing.event])
    phase = turn.phase if turn else float(place.z[2 * crossing.event])
    known = kind is Kind.KNOT
    error = crossing.error + error * follower.problem.unit
    return Special(kind, outcome, point.value, error, words, flank,
                   float(np.mod(phase, 1.0)), place,
                   point.multipliers if known else np.full(2, complex(math.nan))), after


def _jumps(follower: Follower, place: Place, flank: int) -> bool:
    """Whether an impact without speed throws the tooth: `absolute` velocities, a moving flank."""
    osc = follower.problem.oscillator(follower.problem.value(place.z))
    return osc.impact_law == "absolute" and (flank == 1 or osc.back_flank_te)


def _at_knot(follower: Follower, crossing: Crossing,
             place: Place) -> tuple[Special, Place | None]:
    """An event leaves its piece of the table."""
    problem, layout, event = follower.problem, place.layout, crossing.event
    osc = problem.oscillator(problem.value(place.z))
    motion = problem.motions.of(osc)
    back = crossing.condition is Condition.BEGUN
    piece = int(layout.piece[event])
    kink = motion.has_kink(piece if back else piece + 1)
    struck = layout.kind[event] <= Happening.GO_ON and osc.contact_law != "compliant"
    if kink and struck:
        return _found(follower, crossing, place, Kind.KINK,
                      "an impact comes upon a kink", None)
    other = layout.on_piece(event, piece - 1 if back else piece + 1)
    after = follower.place(other, place.z, place.tangent)
    if after.tangent[2 * event] * place.tangent[2 * event] < 0:
        after = Place(other, after.z, -after.tangent)
    words = "an event passes a kink, which it does not feel" if kink else \
        "an event passes a jump of the curvature"
    return _found(follower, crossing, place, Kind.KNOT, words, after)


def _together(place: Place, event: int) -> list[int]:
    """Events beside this one that come to nothing with it, in their order, itself among them."""
    layout, phase, speed = place.layout, place.z[:-1:2], place.z[1:-1:2]
    found = [event]
    for way in (-1, 1):
        last = event
        while len(found) < layout.n:
            here = (last + way) % layout.n
            away = phase[here] - phase[event]
            away -= layout.cycles * round(away / layout.cycles)
            if abs(away) > TOGETHER or abs(speed[here]) > NO_SPEED:
                break
            found.insert(0 if way < 0 else len(found), here)
            last = here
    return found


def _lost(follower: Follower, crossing: Crossing, place: Place) -> tuple[Special, Place | None]:
    """An arrival or a departure comes to nothing, and what goes with it."""
    layout, event = place.layout, crossing.event
    flank, together = int(layout.flank[event]), _together(place, event)
    kinds = [Happening(int(layout.kind[k])) for k in together]
    if kinds[0] is Happening.RELEASE:
        kind, words = Kind.RELEASE, "a release is lost"
    else:
        kind = Kind.GRAZING
        words = "a contact is lost" if Happening.GO_ON in kinds else "an impact is lost"
    if _jumps(follower, place, flank) and _rebound_is_none(place, together[0]):
        return _found(follower, crossing, place, Kind.REBOUND,
                      "the speed after an impact passes zero", None)
    arrives = Happening.REBOUND in kinds or Happening.GO_ON in kinds
    if _jumps(follower, place, flank) and arrives:
        return _found(follower, crossing, place, kind, words, None)
    if layout.n == len(together) and Happening.RELEASE in kinds:
        return _found(follower, crossing, place, Kind.ENGAGED,
                      "the last separation vanishes: contact is kept", None)
    after = None
    if layout.n > len(together) and _closed(kinds):
        after = _without(follower, place, np.array(together),
                         Turn(0, flank, float(place.z[2 * event])), kind is Kind.RELEASE)
    if after is None:
        after = _asked(follower, place)
    return _found(follower, crossing, place, kind, words, after)


def _rebound_is_none(place: Place, event: int) -> bool:
    """Whether the arc to an event has no length although the tooth arrived before with some speed.

    The impact at its beginning then left none.
    """
    layout, before = place.layout, int(place.layout.before[event])
    away = place.z[2 * event] - place.z[2 * before]
    away -= layout.cycles * round(away / layout.cycles)
    return bool(abs(away) < TOGETHER and layout.arrivals[before]
                and place.z[2 * before + 1] > NO_SPEED)


def _closed(kinds: list[Happening]) -> bool:
    """Whether the tooth is after these events in the motion state that it was in before them."""
    ends = (Happening.GO_ON, Happening.CHATTER_END)
    if kinds[0] is Happening.RELEASE:
        return kinds[-1] in ends
    return kinds[-1] is Happening.RELEASE or kinds == [Happening.REBOUND]


def _without(follower: Follower, place: Place, events: NDArray[Any], turn: Turn,
             inside: bool) -> Place | None:
    """The same motion with the grazing events left out, away from the flank or into it."""
    osc = follower.problem.oscillator(follower.problem.value(place.z))
    layout = place.layout.without(events, osc.contact_law == "rigid")
    kept = np.setdiff1d(np.arange(place.layout.n), events)
    columns = place.layout.columns_without(events)
    z, along = place.z[columns], place.tangent[columns]
    arc = int(np.searchsorted(place.z[2 * kept], turn.phase, side="right")) % len(kept)
    turn = Turn(arc, turn.flank, turn.phase)
    try:
        z, _ = corrected(follower.problem, layout, z, follower.problem.weights(layout) * along)
        after = follower.place(layout, z, along)
        ahead = follower.ahead(after, 1e-6)[0]
        distance = distance_at_turn(follower.problem, layout, ahead.z, turn)[0]
    except NotCorrected:
        return None
    if not math.isfinite(distance):
        return None
    return after if (distance > 0) is inside else Place(layout, after.z, -after.tangent)


def _touched(follower: Follower, crossing: Crossing,
             place: Place) -> tuple[Special, Place | None]:
    """A flight or a contact touches a flank where it turns."""
    turn, layout = crossing.turn, place.layout
    assert turn is not None
    inside = layout.arc[turn.arc] == Arc.CONTACT
    osc = follower.problem.oscillator(follower.problem.value(place.z))
    compliant = osc.contact_law == "compliant"
    kind = Kind.RELEASE if inside else Kind.GRAZING
    words = "a release is born" if inside else \
        "a contact is born" if compliant else "an impact is born"
    if _jumps(follower, place, turn.flank):
        return _found(follower, crossing, place, kind, words, None)
    after = None
    if not inside and not compliant:
        after = _chatter_born(follower, place)
        if after is not None:
            gaps = np.diff(follower.births[-3:])
            return _found(follower, crossing, place, Kind.CHATTER, "a complete chatter is born",
                          after, abs(gaps[-1]) / max(1e-3, 1 - abs(gaps[-1] / gaps[-2])))
        after = _with_impact(follower, place, turn, osc.contact_law == "rigid")
    if after is None:
        after = _asked(follower, place)
    return _found(follower, crossing, place, kind, words, after)


def _chatter_born(follower: Follower, place: Place) -> Place | None:
    """Beyond where the births of impacts pile up, the bounces die out; None where they do not."""
    births = follower.births
    births.append(float(place.z[-1]))
    if len(births) < 3 or not abs(births[-1] - births[-2]) < PILED_UP:
        return None
    after = _asked(follower, place)
    return after if after is not None and after.layout.chatters else None


def _stuck(follower: Follower, why: str, place: Place) -> tuple[Special, Place | None]:
    """No step further was found: what lies beyond is asked, and differs by name."""
    corner = around(follower, place)
    if corner is not None:
        return _at_corner(follower, place, *corner)
    after, point = _asked(follower, place), follower.point(place)
    kind, words, error, flank, phase = Kind.UNRESOLVED, why, math.nan, 0, math.nan
    if after is not None:
        one, two = place.layout, after.layout
        error = STUCK * abs(after.z[-1] - place.z[-1]) * follower.problem.unit
        if one.chatters != two.chatters:
            kind, words = Kind.CHATTER, "bounces no longer die out" if one.chatters else \
                "a complete chatter is born"
            if one.chatters:
                place, error = _last_complete(follower, place, float(after.z[-1]))
                point = follower.point(place)
                end = int(np.flatnonzero(one.kind == Happening.CHATTER_END)[-1])
                flank, phase = int(one.flank[end]), float(np.mod(place.z[2 * end], 1.0))
        elif one.chatters:
            # How many of its bounces are listed says nothing.
            releases = [np.sum(layout.kind == Happening.RELEASE) for layout in (one, two)]
            if releases[0] != releases[1]:
                kind, words = Kind.RELEASE, "a release is born or lost"
        elif np.sum(one.arrivals) != np.sum(two.arrivals):
            kind = Kind.GRAZING
            words = f"{np.sum(one.arrivals)} arrivals become {np.sum(two.arrivals)}"
        else:
            kind, words = Kind.RELEASE, "a release is born or lost"
    outcome = Outcome.ENDS if after is None else Outcome.PERSISTS \
        if after.tangent[-1] * place.tangent[-1] > 0 else Outcome.TURNS_BACK
    return Special(kind, outcome, point.value, error, words, flank, phase, place,
                   point.multipliers), after


def _last_complete(follower: Follower, place: Place, beyond: float) -> tuple[Place, float]:
    """The motion before which bounces no longer die out, and by how much its value may be off.

    Towards it the end of the chatter moves ever faster, with no power of the distance, so that no
    step along the branch comes near it; at a value that is held the equations can be solved as long
    as the bounces die out.
    """
    problem, alive, dead = follower.problem, place, beyond
    while abs(dead - alive.z[-1]) > LAST * max(1.0, abs(dead)):
        z = alive.z + alive.tangent * (0.5 * (dead - alive.z[-1]) / alive.tangent[-1])
        try:
            alive = follower.place(alive.layout, at_value(problem, alive.layout, z), alive.tangent)
        except NotCorrected:
            dead = float(z[-1])
    return alive, (abs(dead - alive.z[-1]) + SUMMED * max(1.0, abs(dead))) * problem.unit


def _at_corner(follower: Follower, place: Place, behind: Place,
               error: float) -> tuple[Special, Place | None]:
    """A bounce of a chatter that is not listed passes a jump of the curvature."""
    point = follower.point(place)
    pile = piled_up(follower, point.value)
    if pile is not None:
        return Special(Kind.KNOT, Outcome.ENDS, *pile,
                       "the end of a chatter comes upon a jump of the curvature: corners, one for "
                       "each bounce, pile up", 0, math.nan, place, point.multipliers), None
    outcome = Outcome.PERSISTS if behind.tangent[-1] * place.tangent[-1] > 0 \
        else Outcome.TURNS_BACK
    return Special(Kind.KNOT, outcome, point.value, error,
                   "a bounce of a chatter passes a jump of the curvature", 0, math.nan, place,
                   point.multipliers), behind


def _with_impact(follower: Follower, place: Place, turn: Turn, rigid: bool) -> Place | None:
    """The same motion with an impact where it touches the flank, towards more speed."""
    layout, problem = place.layout, follower.problem
    osc = problem.oscillator(problem.value(place.z))
    phases = place.z[:-1:2]
    phase = turn.phase + layout.cycles * math.ceil((phases[0] - turn.phase) / layout.cycles)
    where = int(np.searchsorted(phases, phase))
    piece = problem.motions.of(osc).piece(np.array([phase]))[0]
    with_it = of_parts(np.insert(layout.kind, where, Happening.REBOUND),
                       np.insert(layout.flank, where, turn.flank),
                       np.insert(layout.piece, where, piece), layout.cycles, rigid)
    z = np.insert(place.z, 2 * where, [phase, 0.0])
    along = np.zeros(len(z))
    along[2 * where + 1] = 1.0
    try:
        z, _ = corrected(problem, with_it, z, along)
        return follower.place(with_it, z, along)
    except NotCorrected:
        return None


def _asked(follower: Follower, place: Place) -> Place | None:
    """What the engine makes of the motion a little beyond, on either side; corrected."""
    problem = follower.problem
    ahead = math.copysign(1.0, place.tangent[-1])
    for part in ASKED:
        for way in (ahead, -ahead):
            z = place.z.copy()
            z[-1] += way * part
            try:
                found = seen(problem, place.layout, z, follower.distance)
                if found.layout is None or found.layout.same(place.layout) or not found.layout.n:
                    continue
                layout, there = fewer(problem, found.layout, problem.packed(
                    found.phase, found.speed, problem.value(z)))
                if layout.same(place.layout) or (
                        way != ahead and _is_own(problem, place.layout, z, found)):
                    continue
                there = at_value(problem, layout, there)
                again = seen(problem, layout, there, follower.distance)
                if not agrees(layout, there, again):
                    continue
                if _apart(follower, place, layout, there) > 10 * math.sqrt(part):
                    continue
                along = np.zeros(len(there))
                along[-1] = way
                return follower.place(layout, there, along)
            except (NotCorrected, ValueError, OverflowError):
                continue
    return None


def _is_own(problem: Problem, layout: Layout, z: NDArray[Any], found: Seen) -> bool:
    """Whether what is seen is the motion itself with other bounces listed, where it came from."""
    try:
        return agrees(layout, at_value(problem, layout, z), found)
    except NotCorrected:
        return False


def _apart(follower: Follower, place: Place, layout: Layout, z: NDArray[Any]) -> float:
    """Distance of two motions where the first is far from its events, in scales."""
    at = np.array([float(np.mod(place.z[0] + 0.37 * k, place.layout.cycles)) for k in range(3)])
    problem = follower.problem
    one, two = (states_at(problem, *where, at)[1] for where in ((place.layout, place.z),
                                                               (layout, z)))
    return float(np.max(np.abs(one - two))) / problem.scale
