"""One shard of a map carried out. No number depends on how it is cut (`cut`)."""

from __future__ import annotations

import math
import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lapwing import engine
from lapwing.base import arguments, estimates
from lapwing.base.arguments import Refusals
from lapwing.base.arrivals import arrivals_of
from lapwing.base.codes import Status
from lapwing.base.quantities import OBSERVED
from lapwing.base.threads import worker_threads
from lapwing.engine import Numerics
from lapwing.results.shards import Shard, inputs_digest, read_shard, write_shard
from lapwing.studies.labels import settings
from lapwing.studies.map.grid import Grid
from lapwing.studies.map.observed import KEPT, kept, observations, wanted
from lapwing.studies.map.task import Dropped, Made, Task
from lapwing.studies.sweep.curves import curves_of

# Where a line begins.
REST = (engine.REST, 0.0, 0.0)
# Runs handed to the engine at once, in whole lines: it takes some 10 kB for each line, and where
# exponents are asked for the maps of all recorded cycles, which are to be this much at most.
AT_A_TIME, MAPS = 1024, 2**26
# Pieces of a shard for each of several threads, so that none waits long for the last.
PIECES = 4


@dataclass(frozen=True, eq=False)
class Job(Task):
    """What is done at each crossing point.

    Attributes
    ----------
    grid : Grid
    start : 'rest', 'up' or 'down'
    settle, record : int, mesh cycles
    phase : float, mesh phase of the start
    numerics : Numerics
    shard_runs : int, runs of a shard
    observe : tuple of str, of `OBSERVED`, what is kept of each run besides
    """

    grid: Grid
    start: str
    settle: int
    record: int
    phase: float
    numerics: Numerics
    shard_runs: int
    observe: tuple[str, ...] = ()

    @property
    def kept(self) -> dict[str, Any]:
        """See `Task`."""
        return kept(self.observe)

    @property
    def run_bytes(self) -> int:
        """See `Task`."""
        return estimates.map_run(self.observe)

    @property
    def thread_bytes(self) -> int:
        """See `Task`."""
        return estimates.CLOSED_FORM * self.grid.pieces

    def carried_out(self, index: int, progress: Callable[[float], None] | None = None,
                    stop: threading.Event | None = None, before: Shard | None = None,
                    share_work: Callable[[int], int] = lambda _: 1) -> Made:
        """See `Task`."""
        first, behind = self.cut.place(index)
        outcome = np.empty(behind - first, dtype=engine.OUTCOME_TABLE)
        besides = {name: np.empty(behind - first) for one in self.observe for name in OBSERVED[one]}
        length = 1 if self.start == "rest" else min(self.grid.length, len(outcome))
        threads = share_work(len(outcome) // length)
        most = float(AT_A_TIME)
        if "exponent" in self.observe:
            most = min(most, MAPS / estimates.sweep_bytes(1, self.record, False, exponents=True))
        if threads > 1:
            most = min(most, len(outcome) / (threads * PIECES))
        size = max(1, math.ceil(most / length)) * length
        start = (*(before.handed if before and before.handed else REST), self.phase)

        give_up = told_of(None, stop, 0.0, 0.0)

        def fill(begin: int) -> None:
            here = slice(begin - first, min(begin + size, behind) - first)
            part = outcome[here]
            _move(self, begin, part, {name: values[here] for name, values in besides.items()},
                  start, told_of(progress, stop, here.start / len(outcome),
                                 len(part) / len(outcome)))

        pieces = range(first, behind, size)
        if threads == 1:
            for begin in pieces:
                fill(begin)
        else:
            with ThreadPoolExecutor(threads) as pool:
                for _ in pool.map(fill, pieces):
                    pass
        good = outcome["status"] == Status.OK
        data = {name: np.where(good | (name == "status"), outcome[name], 0 if kind is not float
                               else np.nan).astype(kind) for name, kind in KEPT.items()} \
            | besides | self.grid.known(first, behind, lambda: give_up(0.0))
        last = outcome[0 if self.start == "down" else -1]
        return Made(data, handed_over(last) if self.cut.is_chained(index) else None)

    @property
    def about(self) -> dict[str, Any]:
        """What a map says of how it was made: attributes of its Dataset."""
        grid = self.grid
        first = grid.at({name: values[0] for name, values in grid.axes.items()})
        told = settings(first, self.numerics, pair=grid.pair, varied=grid.axes.keys())
        return told | {"arrival": arrivals_of(told["contact_law"]).word, "start": self.start,
                       "line": grid.line, "settle": self.settle, "record": self.record,
                       "phase": self.phase, "shard_runs": self.shard_runs,
                       "observe": " ".join(self.observe)}

    @cached_property
    def identity(self) -> str:
        """SHA-256 of every value that the numbers of the map, and its cut, follow from."""
        grid = self.grid
        return inputs_digest({
            "pair": asdict(grid.pair), "operation": dict(grid.operation), "axes": list(grid.axes),
            "line": grid.line, "start": self.start, "settle": self.settle, "record": self.record,
            "phase": self.phase, "numerics": asdict(self.numerics),
            "shard_runs": self.shard_runs, "observe": self.observe},
            *grid.axes.values(), *curves_of(grid.te).parts())


def check_settings(taken: Refusals, settle: Any, record: Any, phase: Any, numerics: Any,
                   shard_runs: Any) -> None:
    """Check how each run is carried out, and how many are in a shard."""
    taken.take(arguments.whole, "settle", settle, 0)
    taken.take(arguments.whole, "record", record, 1)
    taken.take(arguments.phase, "phase", phase)
    if numerics is not None:
        taken.take(arguments.instance, "numerics", numerics, Numerics)
    if shard_runs is not None:
        taken.take(arguments.whole, "shard_runs", shard_runs, 1)


def handed_over(last: Any) -> tuple[float, ...]:
    """State that a line is carried on with from how its last run ended: rest after a failure."""
    if last["status"] != Status.OK:
        return REST
    return tuple(map(float, last[["motion_state", "phi", "phi_dot"]]))


def _move(job: Job, first: int, outcome: NDArray[Any], besides: dict[str, NDArray[Any]],
          start: tuple[float, ...], told: Callable[[float], None]) -> None:
    """Fill the outcome, and what is observed, of the runs from `first` on.

    Each line begins with `start`.
    """
    behind = first + len(outcome)
    points = job.grid.points(first, behind)
    stepped = _stepped(job, first, points)
    done = 0
    for which in (np.flatnonzero(~stepped), np.flatnonzero(stepped)):
        if not which.size:
            continue
        part = points if which.size == len(points) else points.take(which)
        lines = _lines(job, which.size)
        result = engine.sweep(
            part, lines, [start] * len(lines), numerics=job.numerics,
            wanted=wanted(job.observe), settle=job.settle, record=job.record,
            log_room=1, threads=1, keep_cycles=False,
            progress=told_of(told, None, done / len(points), which.size / len(points)))
        outcome[which] = result.outcome
        if besides:
            for name, values in observations(job.observe, result, part, job.grid.newtons(
                    first, behind)[which]).items():
                besides[name][which] = values
        done += which.size


def _stepped(job: Job, first: int, points: engine.Points) -> NDArray[np.bool_]:
    """Which runs RK4 moves; a carried line whole, where it is needed at one of its values."""
    if job.start != "rest" and len(points) < job.grid.length:
        begin = first // job.grid.length * job.grid.length
        line = job.grid.points(begin, begin + job.grid.length)
        return np.full(len(points), bool(engine.steps(line, job.numerics).any()))
    stepped = engine.steps(points, job.numerics)
    if job.start == "rest":
        return stepped
    by_line = stepped.reshape(-1, job.grid.length)
    return np.repeat(by_line.any(axis=1), job.grid.length)


def _lines(job: Job, runs: int) -> list[tuple[int, int, bool]]:
    if job.start == "rest":
        return [(i, i, False) for i in range(runs)]
    length = min(job.grid.length, runs)
    ends = [(first, first + length - 1) for first in range(0, runs, length)]
    return [(*(end if job.start == "up" else reversed(end)), True) for end in ends]


def told_of(progress: Callable[[float], object] | None, stop: threading.Event | None,
            begun: float = 0.0, share: float = 1.0) -> Callable[[float], None]:
    """Progress of a part, and a place to give up."""
    def told(fraction: float) -> None:
        if stop is not None and stop.is_set():
            raise Dropped
        if progress is not None:
            progress(begun + share * fraction)
    return told


def make_shard(job: Task, index: int, folder: Path, before: Shard | None = None) -> int:
    """Carry out one shard and publish it, in whatever process; returns its index.

    One that lies there already, whole and of this map, is left as it is.
    """
    told = job.told(index, before)
    if read_shard(folder, index, told)[0] is None:
        made = job.carried_out(index, before=before, share_work=worker_threads)
        write_shard(folder, index, made.data, told, made.handed)
    return index
