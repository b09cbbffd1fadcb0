"""Periodic motions to begin branches with: those that sweeps and a grid of starts find."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from lapwing import engine
from lapwing.base.codes import MotionState, Status
from lapwing.base.threads import default_threads
from lapwing.engine import Numerics, Wanted
from lapwing.studies.critical.starts import StartGrid, start_grid
from lapwing.studies.sweep.run import sweep
from lapwing.studies.sweep.varied import oscillator_at

if TYPE_CHECKING:
    from lapwing.model.gear_pair import GearPair
    from lapwing.model.transmission_error.table import TransmissionError

# Longest period looked for, mesh cycles.
MOST_CYCLES = 24
RECORD = 2 * MOST_CYCLES
ARRIVALS = ("impacts", "back_impacts", "engages", "back_engages")


@dataclass(frozen=True)
class Seed:
    """A motion that repeats: value of the parameter, state at phase 0, mesh cycles."""

    value: float
    state: tuple[MotionState, float, float]
    cycles: int


@dataclass(frozen=True)
class Found:
    """Motions looked at.

    Attributes
    ----------
    seeds : list of Seed
    motions, engaged, aperiodic, failed : int arrays (n,), at each value: all, in contact
        throughout, without a period up to 24 mesh cycles, runs that failed numerically
    """

    seeds: list[Seed]
    motions: NDArray[Any]
    engaged: NDArray[Any]
    aperiodic: NDArray[Any]
    failed: NDArray[Any]


def find(pair: GearPair, te: TransmissionError, parameter: str, values: NDArray[Any],
         operation: Mapping[str, Any], grid: StartGrid | None, settle: int) -> Found:
    """Motions from rest, carried both ways, and from a grid of starts at each value.

    The carried ones go through the values in their order; each start of the grid is followed for
    `settle` mesh cycles before its motion is looked at.
    """
    seeds: list[Seed] = []
    counts = np.zeros((4, len(values)), dtype=np.int64)
    for j, table, period, status in _looked_at(pair, te, parameter, values, operation, grid,
                                               settle):
        happened = any(np.any(table[name] > 0) for name in ARRIVALS)
        kind = 3 if status != Status.OK else 1 if not happened else 2 if not period else 0
        counts[0, j] += 1
        if kind:
            counts[kind, j] += 1
            continue
        last = table[-1]
        state = MotionState(int(last["motion_state"]))
        seeds.append(Seed(float(values[j]), (state, float(last["phi"]), float(last["phi_dot"])),
                          period))
    return Found(seeds, *counts)


def _looked_at(pair: GearPair, te: TransmissionError, parameter: str, values: NDArray[Any],
               operation: Mapping[str, Any], grid: StartGrid | None,
               settle: int) -> Iterator[tuple[int, NDArray[Any], int, int]]:
    """Number of the value, table of its recorded cycles, period and status of each motion."""
    names = ("motion_state", "phi", "phi_dot", *ARRIVALS)
    swept = sweep(pair, te, parameter=parameter, values=values, starts=("rest", "up", "down"),
                  settle=settle, record=RECORD, observe=("cycles",), **operation)
    for i, j in np.ndindex(swept["period"].shape):
        table = np.zeros(RECORD, dtype=[(name, float) for name in names])
        for name in names:
            table[name] = swept[name].values[i, j]
        yield (j, table, int(np.nan_to_num(swept["period"].values[i, j])),
               int(swept["status"].values[i, j]))
    if grid is None:
        return
    for j, value in enumerate(values):
        osc = oscillator_at(pair, te, parameter, float(value), operation)
        starts = start_grid(osc, grid)
        found = engine.sweep(
            [osc] * len(starts), [(k, k, False) for k in range(len(starts))], starts,
            numerics=Numerics(rtol=1e-8), wanted=Wanted(cycles=True, strobe=True), settle=settle,
            record=RECORD, log_room=1, threads=default_threads())
        for table, outcome in zip(found.cycles, found.outcome, strict=True):
            yield (j, table, int(np.nan_to_num(outcome["period"])),
                   int(outcome["status"]))
