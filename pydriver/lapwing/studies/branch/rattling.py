"""Over which values motions rattle, what ends it, and where rattling that is raised slowly dies."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from lapwing import engine
from lapwing.base.codes import FoundFrom, FoundMotion, MotionState, Status
from lapwing.engine import Wanted
from lapwing.engine.records import SAMPLE
from lapwing.studies.branch.collection import nearest
from lapwing.studies.branch.ranges import BEYOND, SLOWLY, End, StableRange
from lapwing.studies.branch.seeds import ARRIVALS, Search
from lapwing.studies.branch.special import Kind
from lapwing.studies.critical.starts import fitted
from lapwing.studies.period import MAX_PERIOD

if TYPE_CHECKING:
    from lapwing.studies.branch.family import Found

# Motions that are followed beside each other to see whether rattling survives at a value, for so
# many mesh cycles; they begin with states so far apart, parts of their size, which chaos magnifies.
CROWD, FOLLOWED, APART = 8, 4000, 1e-6
# Mesh cycles, in parts, for which none of them dies at the value below a bracket, and within which
# all of them do above.
LONGER = tuple(FOLLOWED * part for part in (1, 1, 2, 4, 8, 16))
# Either end of a bracket is found to this, parts of the range.
BRACKET = 5e-9
# Values looked at on the way to the next interval.
LOOKED_AT = 16
# Steps by which an aperiodic motion is raised, parts of the range, and the most changes of motion.
RAISED, MOST_CHANGES = 2e-3, 2000
# A motion that is settled so far lies on the branch that is so near.
SETTLED = 1e-4


@dataclass(frozen=True)
class Rattling:
    """Where motions rattle above the value from which on contact can be kept.

    Attributes
    ----------
    intervals : list of (End, End), ascending; at the value itself, an end of kind NONE
    dies : End or None, where rattling dies that is carried upwards slowly; of kind LIMIT: not up to
        the end of the range; POINTS: not up to there, where the mesh cycles asked for were spent;
        None: it is not known, no rattling motion is carried up to there
    """

    intervals: list[tuple[End, End]]
    dies: End | None


def rattling(search: Search, found: Found, ranges: list[StableRange], kept: float) -> Rattling:
    """Intervals of rattling above a value, and where rattling dies that is raised slowly.

    1. The motion that was carried upwards to the value is raised: along its branch to the end of
       the stable range, beyond it with what it becomes there, without a period by small steps.
    2. The way of that motion and the stable ranges of the branches, those that overlap as one.
    3. Motions found that rattle and lie on no branch, without a period or beyond the end of a
       branch, are carried towards the next interval, and where they no longer rattle is bracketed.

    Parameters
    ----------
    search : Search
    found : family.Found
    ranges : of `stable_ranges`
    kept : float, the value from which on contact can be kept
    """
    cycles = _Cycles(search.rattling_cycles)
    dies = _raised(search, found, ranges, kept, cycles)
    return Rattling(_Intervals(search, found, ranges, kept, dies, cycles).merged(), dies)


class _Spent(Exception):
    """As many mesh cycles as were asked for have been followed."""


@dataclass
class _Cycles:
    """Mesh cycles that are left."""

    left: float

    def spend(self, count: int) -> None:
        """Take some; `_Spent` where there are no more."""
        if count > self.left:
            raise _Spent
        self.left -= count


class _Crowd:
    """Motions that rattle, followed at one value after the other, for so many cycles in all."""

    def __init__(self, search: Search, state: tuple[float, float, float],
                 cycles: _Cycles | None = None) -> None:
        self.search, self.state, self.period = search, state, 0
        self.cycles = cycles or _Cycles(np.inf)

    def survives(self, value: float, cycles: int = FOLLOWED) -> bool:
        """Whether one of them still rattles after so many mesh cycles; if so they go on from it."""
        return bool(self._left(value, self._begun(value), cycles))

    def _begun(self, value: float) -> list[tuple[float, float, float]]:
        """States of all of them."""
        osc = self.search.oscillator(value)
        motion, phi, phi_dot = self.state
        # A tooth that rests on a rigid flank has no state of its own.
        rests = osc.contact_law == "rigid" and motion != MotionState.SEPARATION
        size = 0.0 if rests else APART * osc.angle_scale * osc.mesh_frequency_ratio
        # A motion that repeats is one; of others each has its own chance.
        return [(motion, phi, phi_dot + size * k) for k in range(1 if self.period else CROWD)]

    def _left(self, value: float, states: list[tuple[float, float, float]],
              cycles: int) -> list[tuple[float, float, float]]:
        """States of those that still rattle after so many mesh cycles; the first one is kept."""
        osc, count = self.search.oscillator(value), len(states)
        self.cycles.spend(count * cycles)
        run = engine.sweep(
            [osc] * count, [(k, k, False) for k in range(count)],
            [fitted(osc, (*state, 0.0)) for state in states],
            numerics=self.search.numerics, wanted=Wanted(cycles=True, strobe=True),
            settle=cycles, record=2 * MAX_PERIOD, log_room=1, threads=self.search.threads)
        left: list[tuple[float, float, float]] = []
        for table, outcome in zip(run.cycles, run.outcome, strict=True):
            if outcome["status"] == Status.OK and any(np.any(table[name] > 0)
                                                      for name in ARRIVALS):
                motion, phi, phi_dot = (float(table[-1][name]) for name in SAMPLE)
                if not left:
                    self.state = motion, phi, phi_dot
                    self.period = int(np.nan_to_num(outcome["period"]))
                left.append((motion, phi, phi_dot))
        return left

    def _share(self, value: float) -> float:
        """Part of them that rattles through all of `LONGER`."""
        begun = left = self._begun(value)
        for cycles in LONGER:
            left = self._left(value, left, cycles)
            if not left:
                return 0.0
        return len(left) / len(begun)

    def bracket(self, alive: float, dead: float) -> End:
        """Between a value where they rattle and one where they do not: where that changes.

        Chaos goes on for a while beyond its end, the longer the nearer. Once it is known to about
        where that is, the bracket reaches from a value at which none of them dies in `LONGER` to
        one at which all of them do.
        """
        low, high = self.search.values[[0, -1]]
        width, begun = BRACKET * (high - low), alive
        while abs(dead - alive) > width:
            middle = 0.5 * (alive + dead)
            if self.survives(middle):
                alive = middle
            else:
                dead = middle
        shares, step = {dead: 0.0}, width

        def share(value: float) -> float:
            if value not in shares:
                shares[value] = self._share(value)
            return shares[value]

        while share(alive) < 1 and abs(alive - dead) < abs(begun - dead):
            step *= 4
            alive = dead + np.sign(begun - dead) * min(step, abs(begun - dead))
        ends: list[float] = []
        for least in (1.0, np.nextafter(0, 1)):
            inside, outside = alive, dead
            while abs(outside - inside) > width:
                middle = 0.5 * (inside + outside)
                if share(middle) >= least:
                    inside = middle
                else:
                    outside = middle
            ends.append(float(inside if least == 1 else outside))
        return End(ends[0], abs(ends[1] - ends[0]), Kind.APERIODIC)


class _Intervals:
    """Intervals of rattling above a value."""

    def __init__(self, search: Search, found: Found, ranges: list[StableRange],
                 kept: float, dies: End | None, cycles: _Cycles) -> None:
        self.search, self.cycles = search, cycles
        self.top = float(search.values[-1])
        low = float(search.values[0])
        start = End(max(kept, low), 0.0, Kind.NONE if kept >= low else Kind.LIMIT)
        self.start = start
        self.pieces = [(max(one.low, start), one.high) for one in ranges if one.high.value > kept]
        if dies is not None and dies.value > start.value:
            self.pieces.append((start, dies))
        self.wild = {one.value: one.state for one, on in zip(found.motions, found.on, strict=True)
                     if one.value > start.value and on is None
                     and one.kind in (FoundMotion.PERIODIC, FoundMotion.APERIODIC)}

    def merged(self) -> list[tuple[End, End]]:
        """The intervals, ascending."""
        self._join()
        for value in sorted(self.wild):
            if not any(low.value <= value <= high.value for low, high in self.pieces):
                self._grow(value)
                self._join()
        return self.pieces

    def _join(self) -> None:
        """Those that overlap become one, and those between which nothing was looked at."""
        joined: list[tuple[End, End]] = []
        near = 2 * BEYOND * (self.top - float(self.search.values[0]))
        for low, high in sorted(self.pieces):
            if joined and low.value <= joined[-1][1].value + near:
                joined[-1] = (joined[-1][0], max(joined[-1][1], high))
            else:
                joined.append((low, high))
        self.pieces = joined

    def _grow(self, value: float) -> None:
        """An interval about a value at which a motion without a period was found."""
        here = End(value, np.nan, Kind.POINTS)
        self.pieces.append((here, here))
        for side in (0, 1):
            self._reach(value, self.wild[value], side)

    def _reach(self, value: float, state: tuple[float, float, float], side: int) -> None:
        """How far a motion that rattles at a value does so on one side: that is a piece, too."""
        end, here = self._next(value, side), End(value, np.nan, Kind.POINTS)
        crowd, alive = _Crowd(self.search, state, self.cycles), value
        try:
            for further in np.linspace(value, end.value, LOOKED_AT + 1)[1:]:
                if not crowd.survives(float(further)):
                    end = crowd.bracket(alive, float(further))
                    break
                alive = float(further)
        except _Spent:
            end = End(alive, np.nan, Kind.POINTS)
        self.pieces.append((end, here) if side == 0 else (here, end))

    def _next(self, value: float, side: int) -> End:
        """What is known next on a side: an interval, or an end of the range."""
        limit = self.start if side == 0 else End(self.top, 0.0, Kind.LIMIT)
        goals = [limit, *(piece[1 - side] for piece in self.pieces),
                 *(End(one, 0.0, Kind.APERIODIC) for one in self.wild)]
        beyond = [one for one in goals if (one.value - value) * (2 * side - 1) > 0]
        return min(beyond, key=lambda one: abs(one.value - value), default=limit)


def _raised(search: Search, found: Found, ranges: list[StableRange], kept: float,
            cycles: _Cycles) -> End | None:
    """Where rattling dies that is carried upwards slowly; see `Rattling`."""
    carried = [one for one in found.motions if one.begun is FoundFrom.UP and one.value <= kept
               and one.kind in (FoundMotion.PERIODIC, FoundMotion.APERIODIC)]
    if not carried:
        return None
    first = max(carried, key=lambda one: one.value)
    value, top = first.value, float(search.values[-1])
    span, crowd = top - float(search.values[0]), _Crowd(search, first.state, cycles)
    crowd.period = first.cycles
    for _ in range(MOST_CHANGES):
        reached = value
        try:
            value, end = _raised_on(found, ranges, value, crowd, (span, top))
        except _Spent:
            return End(reached, np.nan, Kind.POINTS)
        if end is not None:
            return end
    return End(value, np.nan, Kind.POINTS)


def _raised_on(found: Found, ranges: list[StableRange], value: float, crowd: _Crowd,
               scale: tuple[float, float]) -> tuple[float, End | None]:
    """The next value at which the motion rattles, or the end of that."""
    span, top = scale
    stretch = _stretch(found, ranges, value, crowd)
    if stretch is not None:
        one = found.branches[stretch.branch - 1]
        if stretch.high.kind is Kind.LIMIT:
            return value, stretch.high
        at = max((stretch.first, stretch.last), key=lambda k: one.values[k])
        crowd.state = one.state(one.points[at])
        value = stretch.high.value + BEYOND * span
        if value < top and not crowd.survives(value, SLOWLY):
            return value, stretch.high
    else:
        higher = value + RAISED * span
        if higher < top and not crowd.survives(higher):
            return value, crowd.bracket(value, higher)
        value = higher
    return value, End(top, 0.0, Kind.LIMIT) if value >= top else None


def _stretch(found: Found, ranges: list[StableRange], value: float,
             crowd: _Crowd) -> StableRange | None:
    """The stable range that a motion lies on, if it is known."""
    if not crowd.period:
        return None
    for number, one in enumerate(found.branches, 1):
        match = nearest(one, value, np.array(crowd.state[1:]), crowd.period)
        if match is None or match.distance > SETTLED:
            continue
        for stretch in ranges:
            if stretch.branch == number and stretch.first <= match.point <= stretch.last \
                    and value < stretch.high.value:
                return stretch
    return None
