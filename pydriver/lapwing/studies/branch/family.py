"""Branches from the motions that a sweep finds: a bifurcation diagram as a table."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from lapwing.base import arguments
from lapwing.base.arguments import Refusals
from lapwing.base.codes import MotionState
from lapwing.model.gear_pair import GearPair
from lapwing.model.transmission_error import TransmissionError
from lapwing.studies.branch.motion.witness import states_at
from lapwing.studies.branch.run import Branch, branch
from lapwing.studies.branch.seeds import MOST_CYCLES, find
from lapwing.studies.branch.special import Kind, Outcome
from lapwing.studies.critical.starts import StartGrid
from lapwing.studies.orbit import NoOrbit, find_orbit
from lapwing.studies.sweep.varied import oscillator_at, parameters

if TYPE_CHECKING:
    import xarray as xr

# Two motions whose states differ by less, parts of the motion's size, are one.
ONE_MOTION = 1e-7


def branches(pair: GearPair, te: TransmissionError, *, parameter: str = "brake_torque", low: float,
             high: float, seeds: int = 41, starts: StartGrid | None = None, settle: int = 400,
             doublings: int = 2, points: int = 2000,
             progress: Callable[[float], None] | None = None, **operation: Any) -> xr.Dataset:
    """The branches of the periodic motions that sweeps find, each followed to both of its ends.

    1. Motions at `seeds` values from `low` to `high`: from rest, carried both ways, and from a grid
       of starts at each value.
    2. Each periodic one (up to 24 mesh cycles) that lies on no branch yet begins one.
    3. At each period doubling the branch of twice the period is followed, so many times over.

    A motion that no such branch reaches is not in the diagram: what is not shown may exist.

    Parameters
    ----------
    pair : GearPair
    te : TransmissionError
    parameter : str, a number of the pair or its operation, as of `sweep`
    low, high : float, range of the parameter
    seeds : int, values of the sweep
    starts : StartGrid or None, of each value; None: rest and the carried motions alone
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

    low, high, numbers = _checked(pair, te, parameter, low, high, starts, progress, {
        "seeds": (seeds, 2), "settle": (settle, 1), "doublings": (doublings, 0),
        "points": (points, 1)})
    make = partial(oscillator_at, pair, te, parameter, operation=operation)
    values = np.linspace(low, high, numbers["seeds"])
    looked = find(pair, te, parameter, values, operation, starts, numbers["settle"])
    found: list[Branch] = []
    lost = 0
    for count, seed in enumerate(looked.seeds):
        if not on_one(found, seed.value, seed.state, seed.cycles):
            try:
                orbit = find_orbit(make(seed.value), seed.state, seed.cycles)
                one = branch(orbit, make, value=seed.value, low=low, high=high,
                             points=numbers["points"])
                found += [one, *_doubled(one, numbers["doublings"], numbers["points"])]
            except NoOrbit:
                lost += 1
        if progress is not None:
            progress((count + 1) / len(looked.seeds))
    return table(found, parameter, low, high, values, looked).assign_attrs(
        settle=numbers["settle"], doublings=numbers["doublings"], lost=lost)


def _checked(pair: Any, te: Any, parameter: Any, low: Any, high: Any, starts: Any, progress: Any,
             whole: dict[str, tuple[Any, int]]) -> tuple[float, float, dict[str, int]]:
    """Range and whole numbers, or every problem at once."""
    taken = Refusals()
    taken.take(arguments.instance, "pair", pair, GearPair)
    taken.take(arguments.instance, "te", te, TransmissionError)
    taken.take(arguments.choice, "parameter", parameter, parameters())
    if starts is not None:
        taken.take(arguments.instance, "starts", starts, StartGrid)
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
