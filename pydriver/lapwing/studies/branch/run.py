"""Branches of periodic motions by pseudo-arclength continuation."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lapwing.base import arguments
from lapwing.base.codes import MotionState, Status
from lapwing.engine import TrajectoryCall, Wanted
from lapwing.model.oscillator import Oscillator
from lapwing.studies.branch.motion.borders import fewer, moved_on
from lapwing.studies.branch.motion.curve import NotCorrected, Place, Problem, at_value, flipped
from lapwing.studies.branch.motion.flank_motion import Motions
from lapwing.studies.branch.motion.layout import of_log
from lapwing.studies.branch.motion.witness import NUMERICS, states_at, strobed
from lapwing.studies.branch.special import Kind, Outcome, Point, Special
from lapwing.studies.branch.trace.beyond import beyond
from lapwing.studies.branch.trace.follower import Follower
from lapwing.studies.branch.trace.passed import Passed
from lapwing.studies.branch.trace.path import Path, follow
from lapwing.studies.orbit import NoOrbit, Orbit, find_orbit

NUMBERS = ("force", "mesh_frequency_ratio", "damping_ratio", "restitution", "backlash",
           "gear_ratio")
# Values nearer to each other, parts of the range, are one.
ROUNDED = 1e-13
# A multiplier that is so near to 1 is 1.
NEUTRAL = 1e-6


@dataclass(frozen=True, eq=False, repr=False)
class Branch:
    """A branch of periodic motions, from one end to the other.

    Attributes
    ----------
    points : tuple of Point
    specials : tuple of Special, in the order of the branch, both ends among them
    positions : tuple of int, number of the point that each special point follows; -1: the first
        end
    cycles : int, mesh cycles after which its motions repeat
    """

    points: tuple[Point, ...]
    specials: tuple[Special, ...]
    positions: tuple[int, ...]
    cycles: int
    follower: Follower

    def __repr__(self) -> str:
        low, high = min(self.values), max(self.values)
        return (f"<Branch of {len(self.points)} points, {self.cycles} mesh cycles, {low:.6g} to "
                f"{high:.6g}, {len(self.specials)} special points>")

    @property
    def values(self) -> NDArray[Any]:
        """Parameter at each point, array (n,)."""
        return np.array([point.value for point in self.points])

    @property
    def stable(self) -> NDArray[Any]:
        """Whether each point is stable, array (n,) of bool."""
        return np.array([point.stable for point in self.points])

    @arguments.complete()
    def state(self, point: Point | Special) -> tuple[MotionState, float, float]:
        """Motion state, φ (rad) and φ' (rad per τ) at phase 0, a start for `simulate`."""
        place = point.place
        found = states_at(self.follower.problem, place.layout, place.z, np.zeros(1))
        return MotionState(int(found[0][0])), float(found[1][0]), float(found[2][0])

    @arguments.complete()
    def orbit(self, point: Point | Special) -> Orbit:
        """The motion at a point as `find_orbit` has it, with the engine's own multipliers.

        Raises
        ------
        NoOrbit
            as `find_orbit`.
        """
        return find_orbit(self.follower.problem.oscillator(point.value), self.state(point),
                          point.place.layout.cycles)

    @cached_property
    def strobed(self) -> tuple[NDArray[Any], ...]:
        """φ and φ' at phase 0 of each mesh cycle of each point: arrays (2, cycles)."""
        return tuple(strobed(self.follower.problem, one.place.layout, one.place.z)
                     for one in self.points)

    def passes(self, value: float) -> list[tuple[int, int]]:
        """Numbers of the points between which the branch passes a value, the nearer one first.

        Where a fold lies between two points it is passed from either of them to the fold.
        """
        away = self.values - value
        away[np.abs(away) < ROUNDED * self.follower.problem.unit] = 0.0
        found = [(int(k), int(k)) for k in np.flatnonzero(away == 0)]
        found += [(int(k), int(k) + 1) if abs(away[k]) < abs(away[k + 1]) else (int(k) + 1, int(k))
                  for k in np.flatnonzero(away[:-1] * away[1:] < 0) if k not in self._folds]
        for k, fold in self._folds.items():
            turn = fold.value - value
            found += [(k, k + 1)] * bool(away[k] * turn < 0)
            found += [(k + 1, k)] * bool(away[k + 1] * turn < 0)
        return sorted(found)

    def near(self, number: int, far: int, value: float) -> Point | None:
        """The branch at a value that it passes on the way from a point to another beside it."""
        place, fold = self.points[number].place, self._folds.get(min(number, far))
        try:
            if fold is not None and far != number:
                return self.follower.point(self._before_fold(place, fold.place, value))
            problem, z = self.follower.problem, place.z.copy()
            z[-1] = value / problem.unit
            z = at_value(problem, place.layout, z)
            # Between the points a slow bounce may pass a knot.
            layout = moved_on(problem, place.layout, z)
            if layout is not place.layout:
                z = at_value(problem, layout, z)
            return self.follower.point(Place(layout, z, place.tangent))
        except NotCorrected:
            return None

    @cached_property
    def _folds(self) -> dict[int, Special]:
        """The fold between two points, the last one of several, by the number of the first."""
        return {at: one for one, at in zip(self.specials, self.positions, strict=True)
                if one.kind is Kind.FOLD and 0 <= at < len(self.points) - 1}

    def _before_fold(self, place: Place, fold: Place, value: float) -> Place:
        """Where the branch has a value between a place and a fold.

        There it lies closer to the other side of the fold than a correction at that value can tell;
        along the branch it is a point like others.
        """
        if not place.layout.same(fold.layout):
            raise NotCorrected("other events")
        problem, row = self.follower.problem, self.follower.problem.weights(place.layout)
        step = float((row * place.tangent) @ (fold.z - place.z))
        return self.follower.root(place, step, lambda one: problem.value(one.z) - value)[0]

    @arguments.complete()
    def at(self, value: float) -> tuple[Point, ...]:
        """The branch at one value of the parameter: a point for each time that it passes it."""
        found = (self.near(*pair, value) for pair in self.passes(value))
        return tuple(one for one in found if one is not None)

    @arguments.complete()
    def switched(self, special: Special, points: int = 2000,
                 unstable: int | None = None) -> Branch:
        """The branch of twice the period that leaves this one at a period doubling.

        Parameters
        ----------
        special : Special, of this branch
        points, unstable : int, as of `branch`

        Raises
        ------
        ValueError
            for any other special point.
        """
        if special.kind is not Kind.PERIOD_DOUBLING or special.outcome is Outcome.ENDS:
            raise ValueError(arguments.wrong("special", special, "a period doubling on the way"))
        problem, place = self.follower.problem, special.place
        pieces = problem.motions.of(problem.oscillator(special.value)).pieces
        layout, flip = place.layout.twice(pieces), flipped(problem, place)
        later = place.z[:-1].copy()
        later[::2] += place.layout.cycles
        z = np.concatenate([place.z[:-1], later, place.z[-1:]])
        along = np.concatenate([flip, -flip, [0.0]])
        along /= math.sqrt(float(problem.weights(layout) @ along**2))
        self.follower.forget()
        path = follow(self.follower, Place(layout, z, along), points, beyond, critical=True,
                      unstable=unstable)
        begun = replace(special, outcome=Outcome.ENDS, words="leaves the branch of half its period",
                        place=Place(layout, z, along))
        return _joined(self.follower, path, begun)

    def of_kind(self, kind: Kind) -> tuple[Special, ...]:
        """Special points of one kind."""
        return tuple(one for one in self.specials if one.kind is kind)


@arguments.complete()
def branch(orbit: Orbit, parameter: str | Callable[[float], Oscillator], *, low: float,
           high: float, value: float | None = None, points: int = 2000,
           unstable: int | None = None) -> Branch:
    """Follow a periodic motion both ways in a parameter, stable or not, through its folds.

    Parameters
    ----------
    orbit : Orbit
    parameter : str, a number of the oscillator, or 'brake_torque' (N·m, at the balance of drive
        torque); or a callable(value) giving an Oscillator
    low, high : float, range of the parameter
    value : float, of the parameter at the orbit; with a callable only
    points : int, the most points either way
    unstable : int or None, the most points in a row that are not stable

    Returns
    -------
    Branch

    Raises
    ------
    TypeError, ValueError
        for a refused argument.
    NoOrbit
        where the orbit is none at that value, or has no events.
    """
    arguments.instance("orbit", orbit, Orbit)
    low, high = arguments.real("low", low), arguments.real("high", high)
    points = arguments.whole("points", points, 1, 1_000_000)
    if unstable is not None:
        unstable = arguments.whole("unstable", unstable, 1, 1_000_000)
    if not low < high:
        raise ValueError(f"low = {low:g} must be below high = {high:g}")
    make, value = _varied(orbit.oscillator, parameter, value)
    if not low <= value <= high:
        raise ValueError(f"the orbit's own value, {value:g}, lies outside of {low:g} to {high:g}")
    follower = follower_of(make, value, low, high)
    return both_ways(follower, *begun(follower.problem, orbit, value), points, unstable)


def follower_of(make: Callable[[float], Oscillator], value: float, low: float,
                high: float) -> Follower:
    """What follows the branch of a motion at a value; the scales are those of its oscillator."""
    osc = make(value)
    gap = osc.gap_width if math.isfinite(osc.gap_width) else osc.backlash
    return Follower(Problem(make, Motions(), osc.angle_scale, high - low), low, high, gap)


def begun(problem: Problem, orbit: Orbit, value: float) -> tuple[Any, NDArray[Any]]:
    """Layout and unknowns of an orbit; NoOrbit where it is none."""
    osc = problem.make(value)
    call = TrajectoryCall(osc, (float(orbit.state[0]), *orbit.state[1:], 0.0), numerics=NUMERICS,
                          wanted=Wanted(events=True))
    call.run((orbit.cycles, 0.0), [])
    if call.status != Status.OK:
        raise NoOrbit(f"the run ended with {call.status.name}")
    layout, phase, speed = of_log(call.events, osc, problem.motions.of(osc), orbit.cycles)
    if not layout.n:
        raise NoOrbit("a motion without events exists at every value and has no branch to follow")
    try:
        layout, z = fewer(problem, layout, problem.packed(phase, speed, value))
        return layout, at_value(problem, layout, z)
    except NotCorrected as error:
        why = f"no periodic motion with the events of this one: {error}"
        if np.any(np.abs(orbit.multipliers.values - 1) < NEUTRAL):
            why = "a multiplier of it is 1: it is a fold, or one of a family, as where nothing " \
                "is lost; begin at another value"
        raise NoOrbit(why, value) from error


def both_ways(follower: Follower, layout: Any, z: NDArray[Any], points: int,
              unstable: int | None = None) -> Branch:
    """A branch from one of its places."""
    along = np.zeros(len(z))
    along[-1] = 1.0
    start = follower.place(layout, z, along)
    passed = Passed()
    up = follow(follower, start, points, beyond, unstable=unstable, passed=passed)
    if up.end.kind is Kind.CLOSED:
        return _joined(follower, up, up.end)
    follower.forget()
    down = follow(follower, Place(layout, z, -start.tangent), points, beyond, unstable=unstable,
                  passed=passed.behind())
    return _joined(follower, up, down.end, down)


def _joined(follower: Follower, up: Path, begun: Special, down: Path | None = None) -> Branch:
    """Both ways as one branch, from the end of the second to the end of the first."""
    before = down.points[:0:-1] if down is not None else []
    last = len(before)
    found = [(-1, begun)]
    if down is not None:
        found += [(last - 1 - k, one) for k, one in reversed(down.specials) if one is not down.end]
    found += [(last + k, one) for k, one in up.specials if one is not up.end]
    found.append((last + len(up.points) - 1, up.end))
    return Branch((*before, *up.points), tuple(one for _, one in found),
                  tuple(k for k, _ in found), up.points[0].place.layout.cycles, follower)


def _varied(osc: Oscillator, parameter: Any,
            value: float | None) -> tuple[Callable[[float], Oscillator], float]:
    """Oscillator of each value, and the value of this one."""
    if callable(parameter):
        if value is None:
            raise ValueError("value: expected is the orbit's own value beside a callable")
        value = arguments.real("value", value)

        def varied(number: float) -> Oscillator:
            made = arguments.instance("parameter(value)", parameter(number), Oscillator)
            return made if made.mean_rotation is None else replace(made, mean_rotation=None)

        return varied, value
    arguments.choice("parameter", parameter, (*NUMBERS, "brake_torque"))
    if value is not None:
        raise ValueError("value is for a callable; a named parameter has the orbit's own")
    osc = replace(osc, mean_rotation=None)
    if parameter != "brake_torque":
        return (lambda number: replace(osc, **{parameter: number})), float(getattr(osc, parameter))
    if osc.scales is None:
        raise ValueError("parameter = 'brake_torque': the oscillator was made without a gear pair")
    unit = osc.scales.force_per_torque
    return (lambda torque: osc.with_force(torque * unit)), osc.force / unit
