"""Branches from the motions that a sweep finds: a bifurcation diagram as a table."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from lapwing.base import arguments
from lapwing.base.arguments import Refusals
from lapwing.base.codes import MotionState, Status
from lapwing.model.gear_pair import GearPair
from lapwing.model.transmission_error import TransmissionError
from lapwing.studies.branch.motion.witness import states_at
from lapwing.studies.branch.run import Branch, branch
from lapwing.studies.branch.special import Kind, Outcome
from lapwing.studies.orbit import NoOrbit, find_orbit
from lapwing.studies.sweep.run import sweep
from lapwing.studies.sweep.varied import oscillator_at, parameters

if TYPE_CHECKING:
    import xarray as xr

MOST_CYCLES = 24
# Two motions whose states differ by less, parts of the motion's size, are one.
ONE_MOTION = 1e-7


def branches(pair: GearPair, te: TransmissionError, *, parameter: str = "brake_torque", low: float,
             high: float, seeds: int = 41, settle: int = 400, doublings: int = 2,
             points: int = 2000, progress: Callable[[float], None] | None = None,
             **operation: Any) -> xr.Dataset:
    """The branches of the periodic motions that sweeps find, each followed to both of its ends.

    1. A sweep of `seeds` values from `low` to `high`: from rest, and carried both ways.
    2. Each periodic motion of it (up to 24 mesh cycles) that lies on no branch yet begins one.
    3. At each period doubling the branch of twice the period is followed, so many times over.

    A motion that no such branch reaches is not in the diagram: what is not shown may exist.

    Parameters
    ----------
    pair : GearPair
    te : TransmissionError
    parameter : str, a number of the pair or its operation, as of `sweep`
    low, high : float, range of the parameter
    seeds : int, values of the sweep
    settle : int, mesh cycles at each value before a motion is looked at
    doublings : int, how many times a branch of twice the period is followed
    points : int, the most points of a branch either way
    progress : callable(fraction done) or None
    **operation : the other arguments of `GearPair.oscillator`

    Returns
    -------
    xarray.Dataset, `diagram.table`

    Raises
    ------
    TypeError, ValueError
        for a refused argument.
    """
    from lapwing.studies.branch.diagram import table

    low, high, numbers = _checked(pair, te, parameter, low, high, progress, {
        "seeds": (seeds, 2), "settle": (settle, 1), "doublings": (doublings, 0),
        "points": (points, 1)})
    make = partial(oscillator_at, pair, te, parameter, operation=operation)
    values = np.linspace(low, high, numbers["seeds"])
    swept = sweep(pair, te, parameter=parameter, values=values, starts=("rest", "up", "down"),
                  settle=numbers["settle"], record=2 * MOST_CYCLES, observe=("cycles",),
                  **operation)
    found: list[Branch] = []
    lost = 0
    motions = list(_periodic(swept, parameter))
    for count, (value, state, cycles) in enumerate(motions):
        if not on_one(found, value, state, cycles):
            try:
                orbit = find_orbit(make(value), state, cycles)
                one = branch(orbit, make, value=value, low=low, high=high,
                             points=numbers["points"])
                found += [one, *_doubled(one, numbers["doublings"], numbers["points"])]
            except NoOrbit:
                lost += 1
        if progress is not None:
            progress((count + 1) / len(motions))
    return table(found, parameter, low, high).assign_attrs(
        seeds=numbers["seeds"], settle=numbers["settle"], doublings=numbers["doublings"],
        motions=len(motions), motions_lost=lost,
        aperiodic=int(np.sum((swept["period"] == 0) & (swept["status"] == Status.OK))))


def _checked(pair: Any, te: Any, parameter: Any, low: Any, high: Any, progress: Any,
             whole: dict[str, tuple[Any, int]]) -> tuple[float, float, dict[str, int]]:
    """Range and whole numbers, or every problem at once."""
    taken = Refusals()
    taken.take(arguments.instance, "pair", pair, GearPair)
    taken.take(arguments.instance, "te", te, TransmissionError)
    taken.take(arguments.choice, "parameter", parameter, parameters())
    ends = [taken.take(arguments.real, name, value) for name, value in
            (("low", low), ("high", high))]
    numbers = {name: taken.take(arguments.whole, name, value, least, 1_000_000)
               for name, (value, least) in whole.items()}
    if progress is not None:
        taken.take(arguments.function, "progress", progress)
    if None not in ends and not ends[0] < ends[1]:
        taken.problems.append(f"low = {ends[0]:g} must be below high = {ends[1]:g}")
    taken.raise_if_any("branches")
    return ends[0], ends[1], numbers


def _periodic(swept: xr.Dataset, parameter: str) -> Iterator[tuple[float, Any, int]]:
    """Value, state at phase 0 and cycles of each motion of a sweep that repeats."""
    period = swept["period"].values
    for i, j in np.ndindex(period.shape):
        cycles = int(period[i, j])
        if not 0 < cycles <= MOST_CYCLES or swept["status"].values[i, j] != Status.OK:
            continue
        state = [float(swept[name].values[i, j, -1]) for name in ("motion_state", "phi", "phi_dot")]
        yield (float(swept[parameter].values[j]), (MotionState(int(state[0])), *state[1:]), cycles)


def on_one(found: Sequence[Branch], value: float, state: tuple[MotionState, float, float],
           cycles: int) -> bool:
    """Whether a motion lies on one of some branches."""
    for one in found:
        if one.cycles != cycles:
            continue
        for point in one.at(value):
            strobed = states_at(one.follower.problem, point.place.layout, point.place.z,
                                np.arange(cycles, dtype=float))
            away = np.hypot(strobed[1] - state[1], strobed[2] - state[2])
            if np.min(away) < ONE_MOTION * one.follower.problem.scale:
                return True
    return False


def _doubled(one: Branch, doublings: int, points: int) -> Iterator[Branch]:
    """Branches that leave a branch at its doublings, and those that leave these."""
    if not doublings or 2 * one.cycles > MOST_CYCLES:
        return
    for special in one.of_kind(Kind.PERIOD_DOUBLING):
        if special.outcome is Outcome.PERSISTS:
            try:
                twice = one.switched(special, points)
            except (NoOrbit, ArithmeticError):
                continue
            yield twice
            yield from _doubled(twice, doublings - 1, points)
