"""Motions to begin branches with: those that sweeps, a grid of starts and random starts find."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from lapwing import engine
from lapwing.base.codes import FoundFrom, FoundMotion, MotionState, Status
from lapwing.engine import Numerics, Wanted
from lapwing.engine.records import SAMPLE
from lapwing.studies.attractors.starts import drawn_starts, ranges
from lapwing.studies.critical.starts import StartGrid, fitted, start_grid
from lapwing.studies.period import MAX_PERIOD
from lapwing.studies.sweep.run import sweep
from lapwing.studies.sweep.varied import oscillator_at

if TYPE_CHECKING:
    import xarray as xr

    from lapwing.model.gear_pair import GearPair
    from lapwing.model.oscillator import Oscillator
    from lapwing.model.transmission_error.table import TransmissionError

# Mesh cycles, at most, for which motions are followed to where rattling ends that is on no branch.
RATTLING_CYCLES = 50_000_000
ARRIVALS = ("impacts", "back_impacts", "engages", "back_engages")


@dataclass(frozen=True)
class Motion:
    """A motion that was looked at.

    Attributes
    ----------
    value : float, of the parameter
    kind : FoundMotion
    begun : FoundFrom
    cycles : int, mesh cycles after which it repeats; 0: not
    state : (motion state, φ, φ') at phase 0, in the end
    """

    value: float
    kind: FoundMotion
    begun: FoundFrom
    cycles: int
    state: tuple[MotionState, float, float]


@dataclass(frozen=True)
class Search:
    """Where motions are looked for.

    Attributes
    ----------
    pair, te, operation : as `oscillator_at` takes them
    parameter : str; values : array (n,), ascending
    grid : StartGrid or None; starts tried at each value besides rest and the carried motions
    random, seed : int, starts drawn at each value at mesh phase 0, and what decides them
    settle : int, mesh cycles before a motion is looked at
    highest : int, the longest period that counts as one, mesh cycles
    sweeps : Datasets of `sweep` along the parameter, whose motions are taken as well
    trials : list of (value, StartGrid), further values with starts of their own
    numerics : Numerics
    threads : int
    rattling_cycles : int, mesh cycles, at most, followed to find where rattling ends
    """

    pair: GearPair
    te: TransmissionError
    parameter: str
    values: NDArray[Any]
    operation: dict[str, Any]
    grid: StartGrid | None = None
    random: int = 0
    seed: int = 0
    settle: int = 400
    highest: int = MAX_PERIOD
    sweeps: Sequence[xr.Dataset] = ()
    trials: Sequence[tuple[float, StartGrid]] = ()
    numerics: Numerics = field(default_factory=lambda: Numerics(rtol=1e-8))
    threads: int = 1
    rattling_cycles: int = RATTLING_CYCLES

    def oscillator(self, value: float) -> Oscillator:
        """The oscillator at a value of the parameter."""
        if self.parameter == "brake_torque" and self.operation.get("drive_torque") is None:
            # In balance: the force alone differs.
            return self._unit.with_force(value * self.pair.force_per_torque)
        return oscillator_at(self.pair, self.te, self.parameter, value, self.operation)

    @cached_property
    def _unit(self) -> Oscillator:
        """The oscillator at a value of 1."""
        return oscillator_at(self.pair, self.te, self.parameter, 1.0, self.operation)


def find(search: Search, progress: Callable[[float], None] | None = None) -> list[Motion]:
    """Motions of earlier sweeps, from rest, carried both ways, and from starts at each value.

    The carried ones go through the values in their order; each other start is followed for `settle`
    mesh cycles before its motion is looked at.
    """
    found = [motion for one in search.sweeps for motion in _of_sweep(search, one)]
    swept = sweep(
        search.pair, search.te, parameter=search.parameter, values=search.values,
        starts=("rest", "up", "down"), settle=search.settle, record=2 * MAX_PERIOD,
        observe=("cycles",), numerics=search.numerics, threads=search.threads, **search.operation)
    found += _of_sweep(search, swept)
    low, high = float(search.values[0]), float(search.values[-1])
    tried: list[tuple[float, StartGrid | None, int | None]] = [
        (value, search.grid, j) for j, value in enumerate(map(float, search.values))]
    tried += [(value, grid, None) for value, grid in search.trials if low <= value <= high]
    for count, (value, grid, number) in enumerate(tried):
        osc, starts = search.oscillator(value), []
        if grid is not None:
            starts += [(FoundFrom.GRID, one) for one in start_grid(osc, grid)]
        if number is not None and search.random:
            drawn = drawn_starts(osc, "random", search.random, 0, search.seed + number,
                                 **ranges(osc, 0.0), phase=0.0)
            starts += [(FoundFrom.RANDOM, tuple(one)) for one in drawn.rows.tolist()]
        found += _followed(search, [osc] * len(starts), [value] * len(starts), starts,
                           search.settle)
        if progress is not None:
            progress((count + 1) / len(tried))
    return [one for one in found if low <= one.value <= high]


def followed_on(search: Search, begun: Sequence[tuple[float, Any]],
                settle: int) -> list[Motion]:
    """Motions begun with states at phase 0, each at its value, where another one is not stable."""
    oscillators = [search.oscillator(value) for value, _ in begun]
    starts = [(FoundFrom.END, fitted(osc, (float(state[0]), state[1], state[2], 0.0)))
              for osc, (_, state) in zip(oscillators, begun, strict=True)]
    return list(_followed(search, oscillators, [value for value, _ in begun], starts, settle))


def _followed(search: Search, oscillators: Sequence[Oscillator], values: Sequence[float],
              starts: Sequence[tuple[FoundFrom, Any]], settle: int) -> Iterator[Motion]:
    """Motions from starts, each of its oscillator."""
    if not starts:
        return
    run = engine.sweep(
        oscillators, [(k, k, False) for k in range(len(starts))], [one for _, one in starts],
        numerics=search.numerics, wanted=Wanted(cycles=True, strobe=True), settle=settle,
        record=2 * MAX_PERIOD, log_room=1, threads=search.threads)
    for value, (begun, _), table, outcome in zip(values, starts, run.cycles, run.outcome,
                                                 strict=True):
        happened = any(np.any(table[name] > 0) for name in ARRIVALS)
        yield _motion(search, value, begun, [table[-1][name] for name in SAMPLE],
                      float(outcome["period"]), int(outcome["status"]), happened)


def _of_sweep(search: Search, swept: xr.Dataset) -> Iterator[Motion]:
    """Motions of the points of a sweep that were reached, where its last cycle begins."""
    table = {name: swept[name].transpose("start", ..., "recorded_cycle").values
             for name in (*SAMPLE, *ARRIVALS)}
    happened = np.any([np.nan_to_num(table[name]) > 0 for name in ARRIVALS], axis=(0, 3))
    starts = [FoundFrom[str(one).upper()] for one in swept["start"].values]
    for i, j in np.ndindex(happened.shape):
        status = int(swept["status"].values[i, j])
        if status == Status.UNFINISHED:
            continue
        value = float(swept[search.parameter].values[j])
        state = [table[name][i, j, -1] for name in SAMPLE]
        yield _motion(search, value, starts[i], state, float(swept["period"].values[i, j]), status,
                      bool(happened[i, j]))


def _motion(search: Search, value: float, begun: FoundFrom, state: Any, period: float,
            status: int, happened: bool) -> Motion:
    """A motion by its last state at phase 0."""
    if status != Status.OK:
        return Motion(value, FoundMotion.FAILED, begun, 0,
                      (MotionState.SEPARATION, np.nan, np.nan))
    cycles = int(np.nan_to_num(period))
    kind = FoundMotion.ENGAGED if not happened else \
        FoundMotion.PERIODIC if 0 < cycles <= search.highest else FoundMotion.APERIODIC
    return Motion(value, kind, begun, cycles if kind is FoundMotion.PERIODIC else 0,
                  (MotionState(int(state[0])), float(state[1]), float(state[2])))
