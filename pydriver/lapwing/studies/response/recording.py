"""Whole mesh cycles of one motion: events, statistics and samples in one pass of the engine."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from lapwing import engine
from lapwing.base.codes import Status
from lapwing.engine import TrajectoryCall, Wanted, unknown
from lapwing.engine.records import CYCLE_TABLE, EVENT_TABLE, MEAN_TABLE, SAMPLE_TABLE

if TYPE_CHECKING:
    from lapwing.engine.numerics import Numerics
    from lapwing.model.oscillator import Oscillator


@dataclass(frozen=True)
class Recording:
    """Tables of events (n,), cycles (count,), samples (count·grid + 1,); the phases sampled.

    `means` are Θ and Θ' of the cycles and of the samples, None with one degree of freedom.

    Cycles are counted from the first recorded one; the last sample is the end of the last cycle.
    """

    status: Status
    grid: np.ndarray
    events: np.ndarray
    cycles: np.ndarray
    samples: np.ndarray
    means: tuple[NDArray[Any] | None, NDArray[Any] | None] = (None, None)
    tangent: np.ndarray | None = None


def recorded(osc: Oscillator, start: tuple[float, float, float, float], span: tuple[int, int],
             grid: NDArray[Any], numerics: Numerics, exponents: bool = False) -> Recording:
    """Follow a motion over `span[0]` cycles, and record the `span[1]` next ones.

    The cycle before the first recorded one is watched already, for an impact counts with the
    whole flight before it; and one cycle more is run, for the state at which the last one ends.
    """
    first, count = span
    watched, blob, status = max(0, first - 1), None, Status.OK
    if watched:
        call = TrajectoryCall(osc, start, numerics=numerics, wanted=Wanted())
        status = call.run((watched, 0.0), []).status
        start, blob = (engine.GO_ON, 0, 0, 0), call.blob
    times = np.column_stack([np.repeat(first + np.arange(count), grid.size),
                             np.tile(grid * osc.period, count)])
    if status == Status.OK:
        call = TrajectoryCall(osc, start, blob, watched, numerics=numerics,
                              wanted=Wanted(events=True, cycles=True, tangent=exponents))
        call.run((first + count + 1, 0.0), np.vstack([times, (first + count, 0.0)]))
        status = call.status
    if status != Status.OK:
        lost = tuple(unknown(MEAN_TABLE, n) if osc.mean_rotation else None
                     for n in (count, len(times) + 1))
        return Recording(status, grid, unknown(EVENT_TABLE, 0), unknown(CYCLE_TABLE, count),
                         unknown(SAMPLE_TABLE, len(times) + 1), (lost[0], lost[1]))
    kept = [(table["cycle"] >= first) & (table["cycle"] < first + count)
            for table in (call.events, call.cycles)]
    events, cycles = call.events[kept[0]], call.cycles[kept[1]]
    for table in (events, cycles):
        table["cycle"] -= first
    means = (None if call.cycle_means is None else call.cycle_means[kept[1]], call.sample_means)
    return Recording(status, grid, events, cycles, call.samples, means,
                     None if call.tangent is None else call.tangent[kept[1]])
