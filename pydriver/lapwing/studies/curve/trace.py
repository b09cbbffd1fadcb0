"""A curve over two parameters followed one way until a reason ends it."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lapwing.studies.branch.motion import curve as branch_curve
from lapwing.studies.branch.motion.borders import Borders, border_values, borders_of
from lapwing.studies.branch.motion.borders import Condition as Border
from lapwing.studies.branch.motion.curve import NotCorrected, Place
from lapwing.studies.branch.motion.layout import Happening, Layout
from lapwing.studies.branch.motion.witness import (
    Seen,
    Turn,
    agrees,
    distance_at_turn,
    seen,
    turns_of,
)
from lapwing.studies.branch.special import Kind, Outcome
from lapwing.studies.curve.condition import MET, SMOOTH, Condition, OfEvent, smooth_values
from lapwing.studies.curve.sheet import Sheet, Spot, corrected, onto

# How far from the curve the engine is asked, on the side of the motions whose events are listed.
ASIDE = (1e-5, 1e-4, 1e-6)
# How far before a border a curve of such points is come to.
BEFORE = 1e-4
# A monitor that is larger where it changes its sign jumps there.
NOT_ZERO = 1e-5

# What meets a curve where a condition of an event fails.
OF_BORDER = {Border.ARRIVES: Kind.GRAZING, Border.LEAVES: Kind.RELEASE,
             Border.REBOUNDS: Kind.REBOUND, Border.PRESSED: Kind.CHATTER}


@dataclass(frozen=True, eq=False)
class Meeting:
    """Where a curve meets another, or ends.

    Attributes
    ----------
    kind : Kind, of what meets it; that of the curve itself is its cusp or its like
    outcome : Outcome
    spot : Spot
    words : str
    """

    kind: Kind
    outcome: Outcome
    spot: Spot
    words: str


@dataclass(frozen=True, eq=False)
class State:
    """A place of the curve, and what is watched there."""

    spot: Spot
    condition: Condition
    monitors: dict[Kind, float]
    turns: list[Turn]


@dataclass(eq=False)
class Tracer:
    """Follows a curve.

    Attributes
    ----------
    sheet : Sheet
    kind : Kind, of the special points
    low, high : arrays (2,), ranges of both parameters
    distance : float, rad; turns nearer to a flank than this are watched
    """

    sheet: Sheet
    kind: Kind
    low: NDArray[Any]
    high: NDArray[Any]
    distance: float

    @property
    def units(self) -> NDArray[Any]:
        """Of both parameters."""
        return np.array([self.sheet.first.unit, self.sheet.unit])

    def state(self, spot: Spot, condition: Condition) -> State:
        """What is watched at a place; NotCorrected where the engine sees another motion there."""
        problem, z = self.sheet.problem(spot.y), spot.y[:-1]
        condition = condition.at(problem, spot.layout, z)
        found = self.asked(spot, condition)
        watched = [one for one in turns_of(spot.layout, z, found) if not _is_own(condition, one)]
        return State(spot, condition, self.monitors(spot), watched)

    def asked(self, spot: Spot, condition: Condition) -> Seen:
        """What the engine makes of the motion, on the side of which the layout is."""
        problem, z, layout = self.sheet.problem(spot.y), spot.y[:-1], spot.layout
        if not condition.side:
            found = seen(problem, layout, z, self.distance)
            if agrees(layout, z, found):
                return found
            raise NotCorrected("the engine sees another motion")
        for length in ASIDE:
            beside = spot.y + condition.side * length * spot.aside
            try:
                beside = onto(self.sheet, layout, beside, spot)
            except NotCorrected:
                continue
            problem = self.sheet.problem(beside)
            found = seen(problem, layout, beside[:-1], self.distance)
            if agrees(layout, beside[:-1], found):
                return found
        raise NotCorrected("the engine sees another motion")

    def monitors(self, spot: Spot) -> dict[Kind, float]:
        """Functions that pass zero where another smooth special point meets the curve.

        Of a curve of folds, the curvature of the branch: at a cusp it is none.
        """
        found = smooth_values(self.sheet.problem(spot.y), spot.layout, spot.y[:-1])
        if self.kind in SMOOTH:
            found[self.kind] = spot.slope if self.kind is Kind.FOLD else math.nan
        return found

    def start(self, place: Place, second: float, condition: Condition) -> State:
        """The place of a special point, at the second value (scaled) held.

        One at a border is come to from the branch before it.
        """
        z, layout = place.z, place.layout
        if isinstance(condition, OfEvent):
            problem = self.sheet.first
            z, _ = branch_curve.corrected(problem, layout, z - BEFORE * place.tangent,
                                          problem.weights(layout) * place.tangent)
        y = np.append(z, second)
        row = np.zeros(len(y))
        row[-1] = 1.0
        spot = corrected(self.sheet, layout, y, condition.value, row,
                         np.append(place.tangent, 0.0), row)
        return self.state(spot, condition)

    def values(self, spot: Spot, offset: float) -> NDArray[Any]:
        """Both parameters where the condition is met by nothing: array (2,)."""
        return np.array(self.sheet.values(spot.y - self._back(spot, offset)))

    def errors(self, spot: Spot, offset: float) -> NDArray[Any]:
        """By how much both may be off: by rounding, and by the square of an extrapolation."""
        left = float(np.max(np.abs(self._back(spot, offset))))**2
        return np.array((spot.error + left) * self.units)

    def _back(self, spot: Spot, offset: float) -> NDArray[Any]:
        way: NDArray[Any] = offset / spot.gradient * spot.aside
        return way

    def ahead(self, state: State, step: float) -> Spot:
        """The curve a step further."""
        spot = state.spot
        row = self.sheet.weights(spot.layout) * spot.tangent
        guess = spot.y + step * spot.tangent
        found = corrected(self.sheet, spot.layout, guess, state.condition.value, row, spot.along,
                          spot.tangent)
        away = self._length(spot.layout, found.y - guess)
        if away > 0.5 * abs(step) + 1e-12:
            raise NotCorrected("far from where it was expected")
        return found

    def _length(self, layout: Layout, way: NDArray[Any]) -> float:
        return math.sqrt(float(self.sheet.weights(layout) @ way**2))

    def root(self, state: State, step: float, value: Callable[[Spot], float]) -> Spot:
        """Where a function of the place is zero between 0 and a step that it changes sign over."""
        from scipy.optimize import brentq

        found = {0.0: state.spot}

        def at(s: float) -> float:
            if s not in found:
                found[s] = self.ahead(state, s)
            here = value(found[s])
            if not math.isfinite(here):
                raise NotCorrected("no value")
            return here

        try:
            s = brentq(at, 0.0, step, xtol=1e-15, rtol=8.9e-16)
        except ValueError:
            raise NotCorrected("no change of sign") from None
        at(s)
        return found[s]

    def held(self, state: State, y: NDArray[Any]) -> tuple[Spot, int] | None:
        """The curve at the end of a range that y lies beyond, and which one; None: inside."""
        before, values = (np.array(self.sheet.values(one)) for one in (state.spot.y, y))
        ends = np.where(values < self.low, self.low, self.high)
        with np.errstate(all="ignore"):
            parts = np.where((values < self.low) | (values > self.high),
                             (ends - before) / (values - before), np.inf)
        k = int(np.argmin(parts))
        if not parts[k] < np.inf:
            return None
        y = state.spot.y + parts[k] * (y - state.spot.y)
        row = np.zeros(len(y))
        y[k - 2], row[k - 2] = ends[k] / self.units[k], 1.0
        spot = state.spot
        return corrected(self.sheet, spot.layout, y, state.condition.value, row, spot.along,
                         spot.tangent), k

    def borders(self, state: State) -> tuple[Borders, NDArray[Any]]:
        """Conditions of the motion's events that must go on to hold, and their values."""
        problem, z = self.sheet.problem(state.spot.y), state.spot.y[:-1]
        rows = borders_of(problem, state.spot.layout, z)
        values = border_values(problem, state.spot.layout, z, rows)
        kept = values > MET
        return Borders(rows.condition[kept], rows.event[kept]), values[kept]

    def passed(self, state: State, spot: Spot, step: float) -> list[Meeting]:
        """Conditions of events, and of turns, that hold at a place and no longer a step ahead."""
        rows, _ = self.borders(state)
        problem, z = self.sheet.problem(spot.y), spot.y[:-1]
        after = border_values(problem, spot.layout, z, rows)
        found = []
        for m in np.flatnonzero(~(after > 0)):
            one = Borders(rows.condition[m:m + 1], rows.event[m:m + 1])

            def value(at: Spot, one: Borders = one) -> float:
                where = self.sheet.problem(at.y)
                return float(border_values(where, at.layout, at.y[:-1], one)[0])

            found.append(self._met(self.root(state, step, value), Border(int(one.condition[0])),
                                   int(one.event[0])))
        for turn in state.turns:
            def distance(at: Spot, turn: Turn = turn) -> float:
                where = self.sheet.problem(at.y)
                return distance_at_turn(where, at.layout, at.y[:-1], turn)[0]

            if distance(state.spot) * distance(spot) < 0:
                inside = distance(state.spot) > 0
                found.append(Meeting(Kind.RELEASE if inside else Kind.GRAZING, Outcome.ENDS,
                                     self.root(state, step, distance),
                                     "a contact touches its end elsewhere" if inside
                                     else "a flank is touched elsewhere"))
        return found

    def _met(self, spot: Spot, condition: Border, event: int) -> Meeting:
        """What it means that a condition of an event fails."""
        kind = OF_BORDER.get(condition)
        if kind is not None:
            return Meeting(kind, Outcome.ENDS, spot,
                           f"another event's condition fails: {condition.name.lower()}")
        osc = self.sheet.problem(spot.y).oscillator(self.sheet.values(spot.y)[0])
        motion = self.sheet.first.motions.of(osc)
        back = condition is Border.BEGUN
        piece = int(spot.layout.piece[event])
        struck = spot.layout.kind[event] <= Happening.GO_ON and osc.contact_law != "compliant"
        if struck and motion.has_kink(piece if back else piece + 1):
            return Meeting(Kind.KINK, Outcome.ENDS, spot, "an impact comes upon a kink")
        other = spot.layout.on_piece(event, piece - 1 if back else piece + 1)
        return Meeting(Kind.KNOT, Outcome.PERSISTS, replace(spot, layout=other), "")

    def beyond_knot(self, state: State, meeting: Meeting) -> tuple[Meeting, State | None]:
        """The curve on the other side of a knot that an event passes, if it is met there."""
        spot = meeting.spot
        value = state.condition.value(self.sheet.problem(spot.y), spot.layout, spot.y[:-1])
        ended = replace(meeting, outcome=Outcome.ENDS, spot=replace(
            spot, layout=state.spot.layout), words="an event passes a jump of the curvature, "
            "beyond which the condition is not met")
        if not abs(value) < MET:
            return ended, None
        row = self.sheet.weights(spot.layout) * spot.tangent
        try:
            after = corrected(self.sheet, spot.layout, spot.y + 1e-6 * spot.tangent,
                              state.condition.value, row, spot.along, spot.tangent)
            return meeting, self.state(after, state.condition)
        except NotCorrected:
            return ended, None


def _is_own(condition: Condition, turn: Turn) -> bool:
    """Whether a turn is the one by which the curve is met."""
    own = getattr(condition, "turn", None)
    return own is not None and own.flank == turn.flank and own.arc == turn.arc
