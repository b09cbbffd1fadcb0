"""Curves of special points in two parameters."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lapwing.base import arguments
from lapwing.model.oscillator import Oscillator
from lapwing.studies.branch.motion.curve import NotCorrected
from lapwing.studies.branch.run import NUMBERS, Branch
from lapwing.studies.branch.special import Kind, Special
from lapwing.studies.curve.condition import condition_of, without_empty
from lapwing.studies.curve.follow import Way, follow
from lapwing.studies.curve.sheet import Sheet, Spot
from lapwing.studies.curve.trace import Meeting, Tracer
from lapwing.studies.orbit import NoOrbit


@dataclass(frozen=True, eq=False, repr=False)
class Curve:
    """Where special points of one kind lie over two parameters, from one end to the other.

    Attributes
    ----------
    kind : Kind
    values, second : arrays (n,), both parameters at each point
    error, second_error : arrays (n,), by how much they may be off, across the curve: by rounding,
        times what the equations make of it
    meetings : tuple of Meeting, in the order of the curve, both ends among them: where another
        special point meets it, of which `value` and `second` are
    positions : tuple of int, number of the point that each of them follows; -1: the first end
    """

    kind: Kind
    values: NDArray[Any]
    second: NDArray[Any]
    error: NDArray[Any]
    second_error: NDArray[Any]
    meetings: tuple[Meeting, ...]
    positions: tuple[int, ...]
    cycles: int
    tracer: Tracer
    offset: float

    def __repr__(self) -> str:
        return (f"<Curve of {len(self.values)} {self.kind.name.lower()} points, {self.cycles} mesh "
                f"cycles, second parameter {self.second.min():.6g} to {self.second.max():.6g}, "
                f"{len(self.meetings)} meetings>")

    def place(self, meeting: Meeting) -> tuple[float, float]:
        """Both parameters where something meets the curve."""
        value, second = self.tracer.values(meeting.spot, self.offset)
        return float(value), float(second)


@arguments.complete()
def curve(branch: Branch, special: Special, second: str | Callable[[float, float], Oscillator], *,
          low: float, high: float, value: float | None = None, points: int = 500) -> Curve:
    """Follow a special point of a branch in a second parameter, both ways.

    1. What makes the point a special one is a condition: a multiplier of 1 or -1, a speed or a
       distance of zero, an event at a kink. With it the motion's equations have a curve of
       solutions over two parameters, which pseudo-arclength continuation follows through its own
       folds.
    2. Each point is corrected until a correction is rounding; what that may hide is told (`error`).
    3. At each point the engine is asked whether it sees the motion, of a graze a little beside it.
    4. A curve ends at the end of a range, where another event's condition fails or another flank
       is touched (named), back where it began, or where no step further is found. A cusp, or
       another multiplier of 1 or -1, is located, and the curve goes on.

    Parameters
    ----------
    branch : Branch
    special : Special, of the branch: a fold, period doubling, torus, grazing, release, rebound,
        kink or knot. The end of a complete chatter moves with no power of the distance from its
        loss, which is therefore no condition that could be followed
    second : str, a number of the oscillator, or 'brake_torque' (N·m, at the balance of drive
        torque); or callable(value, second) giving an Oscillator, `value` the branch's parameter
    low, high : float, range of the second parameter; that of the branch's own is the branch's
    value : float, of the second parameter on the branch; with a callable only
    points : int, the most points either way

    Returns
    -------
    Curve

    Raises
    ------
    TypeError, ValueError
        for a refused argument; a special point that no condition of one event makes, and where
        contact is kept from there on: its torque is `critical_full`.
    NoOrbit
        where the point is not found again.
    """
    arguments.instance("branch", branch, Branch)
    arguments.instance("special", special, Special)
    low, high = arguments.real("low", low), arguments.real("high", high)
    points = arguments.whole("points", points, 1, 1_000_000)
    if not low < high:
        raise ValueError(f"low = {low:g} must be below high = {high:g}")
    make, value = _varied(branch, second, value, special)
    if not low <= value <= high:
        raise ValueError(f"the branch's own value = {value:g} lies outside of low = {low:g} to "
                         f"high = {high:g}")
    name = second if isinstance(second, str) else "the second parameter"
    return traced(branch, special, make, value, (low, high), points, name)


def traced(branch: Branch, special: Special, make: Callable[[float, float], Oscillator],
           value: float, ends: tuple[float, float], points: int, second: str) -> Curve:
    """`curve` of arguments that are known to be good."""
    follower = branch.follower
    problem = follower.problem
    special = without_empty(problem, special)
    condition = condition_of(problem, special)
    sheet = Sheet(make, problem, ends[1] - ends[0])
    tracer = Tracer(sheet, special.kind, np.array([follower.low, ends[0]]),
                    np.array([follower.high, ends[1]]), follower.distance)
    try:
        start = tracer.start(special.place, value / sheet.unit, condition)
    except NotCorrected as error:
        raise NoOrbit(f"{special!r} is not found again: {error}", special.value) from error
    up = follow(tracer, start, points, second)
    if up.meetings[-1][1].kind is Kind.CLOSED:
        return _joined(tracer, special, condition.offset, up)
    back = replace(start, spot=replace(start.spot, tangent=-start.spot.tangent))
    return _joined(tracer, special, condition.offset, up,
                   follow(tracer, back, points, second))


def _joined(tracer: Tracer, special: Special, offset: float, up: Way,
            down: Way | None = None) -> Curve:
    """Both ways as one, from the end of the second to the end of the first."""
    spots: list[Spot] = [*(down.spots[:0:-1] if down else []), *up.spots]
    last = len(down.spots) - 1 if down else 0
    found: list[tuple[int, Meeting]] = []
    if down is None:
        found.append((-1, up.meetings[-1][1]))
    else:
        found += [(-1 if k == len(down.spots) - 1 else last - 1 - k, one)
                  for k, one in reversed(down.meetings)]
    found += [(last + k, one) for k, one in up.meetings]
    values = np.array([tracer.values(one, offset) for one in spots])
    errors = np.array([tracer.errors(one, offset) for one in spots])
    return Curve(special.kind, values[:, 0], values[:, 1], errors[:, 0], errors[:, 1],
                 tuple(one for _, one in found), tuple(k for k, _ in found),
                 special.place.layout.cycles, tracer, offset)


def _varied(branch: Branch, second: Any, value: float | None,
            special: Special) -> tuple[Callable[[float, float], Oscillator], float]:
    """Oscillator of each pair of values, and the second one on the branch."""
    make = branch.follower.problem.make
    if callable(second):
        if value is None:
            raise ValueError("value: expected is the branch's own value beside a callable")

        def varied(first: float, number: float) -> Oscillator:
            made = arguments.instance("second(value, second)", second(first, number), Oscillator)
            return made if made.mean_rotation is None else replace(made, mean_rotation=None)

        return varied, arguments.real("value", value)
    arguments.choice("second", second, (*NUMBERS, "brake_torque"))
    if value is not None:
        raise ValueError("value is for a callable; a named parameter has the branch's own")
    osc = make(special.value)
    if second != "brake_torque":
        return ((lambda first, number: replace(make(first), **{second: number})),
                float(getattr(osc, second)))
    if osc.scales is None:
        raise ValueError("second = 'brake_torque': the oscillator was made without a gear pair")
    unit = osc.scales.force_per_torque
    return (lambda first, number: make(first).with_force(number * unit)), osc.force / unit
