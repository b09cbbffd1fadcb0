"""What makes a motion a special one, as a function on all motions: zero there."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from lapwing.studies.branch.motion.borders import (
    Borders,
    border_values,
    borders_of,
)
from lapwing.studies.branch.motion.borders import Condition as Border
from lapwing.studies.branch.motion.curve import Place, Problem, monodromy
from lapwing.studies.branch.motion.layout import Arc, Layout
from lapwing.studies.branch.motion.witness import Turn, distance_at_turn
from lapwing.studies.branch.special import Kind, Special

# A condition met by less than this is met; phases nearer to each other are one.
MET, SAME = 1e-6, 1e-6
# Its square is what is left of an extrapolation.
OFFSET = 1e-6
# Conditions by which a special point at a border of its motions can be met, the first one first.
BORDERS = {Kind.GRAZING: (Border.ARRIVES,), Kind.RELEASE: (Border.LEAVES,),
           Kind.REBOUND: (Border.REBOUNDS, Border.ARRIVES),
           Kind.KINK: (Border.BEGUN, Border.NOT_ENDED), Kind.KNOT: (Border.BEGUN, Border.NOT_ENDED)}
SMOOTH = (Kind.FOLD, Kind.PERIOD_DOUBLING, Kind.TORUS)
FOLLOWED = (*SMOOTH, *BORDERS)


class Condition(Protocol):
    """A condition.

    `side` is the sign of its values on the side of the motions whose events the layout lists; 0:
    they are on both. `offset` is how far from zero it is met.
    """

    @property
    def side(self) -> int:
        """See above."""

    @property
    def offset(self) -> float:
        """See above."""

    def value(self, problem: Problem, layout: Layout, z: NDArray[Any]) -> float:
        """Smooth, zero where the condition is met, NaN where it has no value."""

    def at(self, problem: Problem, layout: Layout, z: NDArray[Any]) -> Condition:
        """The same condition, begun from a place where it is met."""


def smooth_values(problem: Problem, layout: Layout, z: NDArray[Any]) -> dict[Kind, float]:
    """1 - trace + det, 1 + trace + det and det - 1, over what they are made of."""
    trace, det, _ = monodromy(problem, layout, z)
    size = math.sqrt(1 + trace * trace + det * det) if math.isfinite(trace) else math.nan
    return {Kind.FOLD: (1 - trace + det) / size, Kind.PERIOD_DOUBLING: (1 + trace + det) / size,
            Kind.TORUS: (det - 1) / size}


@dataclass(frozen=True)
class OfMultipliers:
    """A multiplier, or a pair of them, has magnitude one."""

    kind: Kind
    side: int = 0
    offset: float = 0.0

    def value(self, problem: Problem, layout: Layout, z: NDArray[Any]) -> float:
        """See `Condition`."""
        return smooth_values(problem, layout, z)[self.kind]

    def at(self, problem: Problem, layout: Layout, z: NDArray[Any]) -> Condition:
        """See `Condition`."""
        return self


@dataclass(frozen=True)
class OfEvent:
    """A condition of an event of the motion (`branch.motion.borders`) is just met.

    With an offset it is met by as much: where the arc to the next event comes to no length together
    with it, equations over that length lose their digits. Values are extrapolated over it.
    """

    condition: Border
    event: int
    offset: float = 0.0
    side: int = 1

    def value(self, problem: Problem, layout: Layout, z: NDArray[Any]) -> float:
        """See `Condition`."""
        one = Borders(np.array([self.condition]), np.array([self.event]))
        return float(border_values(problem, layout, z, one)[0]) - self.offset

    def at(self, problem: Problem, layout: Layout, z: NDArray[Any]) -> Condition:
        """See `Condition`."""
        return self


@dataclass(frozen=True)
class OfTurn:
    """A flight touches a flank where it turns, or a contact its end."""

    turn: Turn
    side: int
    offset: float = 0.0

    def value(self, problem: Problem, layout: Layout, z: NDArray[Any]) -> float:
        """See `Condition`."""
        return distance_at_turn(problem, layout, z, self.turn)[0]

    def at(self, problem: Problem, layout: Layout, z: NDArray[Any]) -> Condition:
        """See `Condition`."""
        _, phase = distance_at_turn(problem, layout, z, self.turn)
        return replace(self, turn=replace(self.turn, phase=phase))


def condition_of(problem: Problem, special: Special) -> Condition:
    """The condition that a special point meets.

    Raises
    ------
    ValueError
        where there is none that could be followed.
    """
    layout, z = special.place.layout, special.place.z
    if special.kind in SMOOTH:
        return OfMultipliers(special.kind)
    if special.kind not in BORDERS:
        raise ValueError(f"special = {special!r}: there are curves of "
                         f"{', '.join(kind.name.lower() for kind in FOLLOWED)}")
    rows = borders_of(problem, layout, z)
    values = border_values(problem, layout, z, rows)
    for wanted in BORDERS[special.kind]:
        for m in np.flatnonzero((rows.condition == wanted) & (np.abs(values) < MET)):
            event = int(rows.event[m])
            if layout.flank[event] == special.flank and _apart(
                    float(z[2 * event]), special.phase) < SAME:
                alone = all(k == event or _apart(float(z[2 * k]), special.phase) > SAME
                            for k in range(layout.n))
                return OfEvent(wanted, event, 0.0 if alone else OFFSET)
    turn = _turn_at(problem, layout, z, special)
    if special.kind in (Kind.GRAZING, Kind.RELEASE) and turn is not None:
        return OfTurn(turn, 1 if layout.arc[turn.arc] == Arc.CONTACT else -1)
    raise ValueError(f"special = {special!r}: no condition of one event is met there")


def without_empty(problem: Problem, special: Special) -> Special:
    """A special point whose motion is left without the events that come to nothing there.

    No time passes between an arrival without speed and the departure that follows, and equations
    over no time say nothing; the motion without them touches the flank where they were, and has
    multipliers there.
    """
    layout, z = special.place.layout, special.place.z
    if special.kind not in (Kind.GRAZING, Kind.RELEASE):
        return special
    near = [k for k in range(layout.n) if abs(z[2 * k + 1]) < MET and
            _apart(float(z[2 * k]), special.phase) < SAME and layout.flank[k] == special.flank]
    osc = problem.oscillator(special.value)
    # Under `absolute` an impact without speed throws the tooth: it is not the same without it.
    jumps = osc.impact_law == "absolute" and (special.flank == 1 or osc.back_flank_te)
    if not 0 < len(near) < layout.n or (jumps and len(near) == 1):
        return special
    rigid = osc.contact_law == "rigid"
    columns = layout.columns_without(np.array(near))
    place = Place(layout.without(np.array(near), rigid), z[columns], special.place.tangent[columns])
    return replace(special, place=place)


def _apart(one: float, two: float) -> float:
    """Distance of two mesh phases."""
    away = one - two
    return abs(away - round(away))


def _turn_at(problem: Problem, layout: Layout, z: NDArray[Any], special: Special) -> Turn | None:
    """The turn at a special point's mesh phase, in the mesh cycle in which the flank is touched."""
    phase = z[:-1:2]
    begin = special.phase + math.ceil(float(phase[0]) - special.phase)
    found = []
    for cycle in range(layout.cycles):
        at = begin + cycle
        turn = Turn(int(np.searchsorted(phase, at, side="right")) % layout.n, special.flank, at)
        found.append((abs(distance_at_turn(problem, layout, z, turn)[0]), turn))
    away, turn = min(found, key=lambda one: np.nan_to_num(one[0], nan=math.inf))
    return turn if away < MET else None
