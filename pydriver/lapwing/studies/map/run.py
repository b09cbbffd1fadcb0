"""A map: what happens at every crossing point of two or more axes."""

from __future__ import annotations

import contextlib
import threading
from collections import deque
from collections.abc import Callable, Iterable, Mapping
from concurrent.futures import FIRST_COMPLETED, Executor, Future, ThreadPoolExecutor, wait
from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from lapwing.base import arguments, estimates
from lapwing.base.arguments import MAX_INT, Refusals
from lapwing.base.codes import Status
from lapwing.base.quantities import worded
from lapwing.base.threads import checked_threads, usable_threads
from lapwing.engine import Numerics
from lapwing.model.gear_pair import GearPair
from lapwing.model.transmission_error import TransmissionError
from lapwing.results.provenance import processor
from lapwing.results.shards import Shard, read_shard, write_shard
from lapwing.studies.map.cut import shard_size
from lapwing.studies.map.grid import Grid, fastest_axis
from lapwing.studies.map.shards import (
    KEPT,
    RATES,
    Job,
    carried_out,
    make_shard,
    rate_of,
)
from lapwing.studies.sweep.varied import moved_to, oscillator_at, parameters

if TYPE_CHECKING:
    import xarray as xr

STARTS = ("rest", "up", "down")
# Numbers that a run without a result does not have.
REALS = tuple(name for name, kind in KEPT.items() if kind is float)
# Shards handed over beyond those that are worked at: to threads, and to another executor, of which
# it is not known how many workers it has.
AHEAD, FAR_AHEAD = 4, 1000


def parameter_map(pair: GearPair, te: TransmissionError, axes: Mapping[str, Any], *,
                  line: str | None = None, start: str = "rest", settle: int = 400,
                  record: int = 100, phase: float = 0.0, numerics: Numerics | None = None,
                  shard_runs: int | None = None, folder: str | Path | None = None,
                  executor: Executor | None = None, threads: int | None = None,
                  progress: Callable[[float], None] | None = None,
                  notes: Callable[[str], None] | None = None, keep_interrupted: bool = False,
                  **operation: Any) -> xr.Dataset:
    """Run every combination of the values of some parameters.

    Parameters
    ----------
    pair : GearPair
    te : TransmissionError
    axes : mapping of parameter -> array (n,) of values, two or more, each an operating parameter of
        `GearPair.oscillator` or a number of the pair; sorted and without repeats in the result
    line : str or None, the parameter along which motions are carried; with 'rest' it decides
        nothing. Default: the last one
    start : 'rest' (each run from rest), 'up' or 'down' (each value of `line` from where the next
        lower or higher one ended, the first from rest)
    settle, record : int, mesh cycles before recording (>= 0), and recorded (>= 1)
    phase : float, mesh phase at the start
    numerics : Numerics or None; default: rtol 1e-6
    shard_runs : int or None, runs of a shard; where motions are carried these are whole lines, or,
        of a line that is longer, a chain of shards that go on from each other; default: some 20 s
        of work, and at least 64 shards, but for chains. No number depends on it
    folder : path or None, where shards are kept while there is work. A map that was stopped goes on
        there: shards of the same values and the same build are read, others made again. They stay
        (`lapwing.results.shards.discard_shards`), and `open_study` opens them
    executor : concurrent.futures.Executor or None, which carries out the shards, in other processes
        or on other machines that see `folder`, which is needed then; default: threads
    threads : int or None; default `threads.default_threads`
    progress : callable(fraction done) or None
    notes : callable(text) or None, told of shards that were made again, and why
    keep_interrupted : bool, whether Ctrl-C returns what is finished (attribute `interrupted`, the
        rest with status UNFINISHED) instead of raising KeyboardInterrupt
    **operation : the other arguments of `GearPair.oscillator`

    Returns
    -------
    xarray.Dataset over the axes, in their order: status (Status); period (mesh cycles, 0: none
    found) with the arrivals at either flank in it, arrivals and back_arrivals (in all recorded
    cycles of a motion without period); impacts_per_cycle and back_impacts_per_cycle; chatter, 1
    where one was complete; states_visited (bits of MotionState); deepest_separation and
    deepest_back_penetration (rad), and fastest_arrival (rad per τ) of the recorded cycles. A run
    that fails has no numbers but its status.

    Raises
    ------
    TypeError, ValueError
        for every refused argument, the oscillators' own refusals included.
    MemoryError
        before any work, where the result cannot fit.
    OSError
        where a shard cannot be written.
    """
    job = job_of(pair, te, axes, line=line, start=start, settle=settle, record=record, phase=phase,
                 numerics=numerics, shard_runs=shard_runs, **operation)
    found, interrupted = carry_out("parameter_map", job, folder=folder, executor=executor,
                                   threads=threads, progress=progress, notes=notes,
                                   keep_interrupted=keep_interrupted)
    return _dataset(job, found, interrupted)


def carry_out(who: str, job: Job, *, folder: str | Path | None, executor: Executor | None,
              threads: int | None, progress: Callable[[float], None] | None,
              notes: Callable[[str], None] | None, keep_interrupted: bool) -> tuple[Found, bool]:
    """Make or read the shards of a study; arguments as of `parameter_map`, which `who` may be.

    Returns
    -------
    Found, and whether Ctrl-C has left some of it open
    """
    if executor is not None and folder is None:
        raise ValueError(f"{who}: executor wants a folder, which its workers see as well")
    if executor is not None and not callable(getattr(executor, "submit", None)):
        raise TypeError(f"{who}: " + arguments.wrong(
            "executor", executor, "what concurrent.futures.Executor can"))
    arguments.flag("keep_interrupted", keep_interrupted)
    for name, given in (("progress", progress), ("notes", notes)):
        if given is not None:
            arguments.function(name, given)
    threads = usable_threads(checked_threads(threads), job.cut.shards)
    folder = None if folder is None else Path(arguments.path("folder", folder))
    estimates.require(job.grid.runs * estimates.MAP_RUN, who, "the number of runs")
    found = Found(job, notes or (lambda _: None))
    work = _Work(job, folder, found, progress)
    try:
        work.carry_out(executor, threads)
    except KeyboardInterrupt:
        if not keep_interrupted:
            raise
        return found, True
    return found, False


def make_part(job: Job, folder: Path, part: int, parts: int, threads: int,
              progress: Callable[[float], object] | None = None,
              notes: Callable[[str], object] | None = None) -> tuple[int, int]:
    """Make each `parts`-th shard of a map, from the `part`-th on (1 to `parts`), and nothing more.

    So many processes, on one machine or many that see the folder, each with a part of its own, make
    a map between them; `parameter_map` puts it together.

    Returns
    -------
    int, int, how many shards were made, and how many lay there
    """
    found = _Left(notes or (lambda _: None))
    indices = [index for chain in range(part - 1, job.cut.chains, parts)
               for index in job.cut.chain(chain)]
    made = _Work(job, folder, found, progress, indices).carry_out(None, threads)
    return made, len(indices) - made


def job_of(pair: GearPair, te: TransmissionError, axes: Any, *, line: str | None, start: str,
           settle: int, record: int, phase: float, numerics: Numerics | None,
           shard_runs: int | None, **operation: Any) -> Job:
    """The checked arguments of `parameter_map` as a `Job`, or every problem at once."""
    taken = Refusals()
    taken.take(arguments.instance, "pair", pair, GearPair)
    taken.take(arguments.instance, "te", te, TransmissionError)
    values = {}
    if not isinstance(axes, Mapping) or len(axes) < 2:
        taken.problems.append(arguments.wrong("axes", axes, "two or more: {parameter: values}"))
        axes = {}
    for name in axes:
        if name in operation:
            taken.problems.append(arguments.wrong(name, operation[name], "none beside its axis"))
        if taken.take(arguments.choice, "axes", name, parameters()) is not None:
            values[name] = taken.take(arguments.reals, name, axes[name])
    taken.take(arguments.choice, "start", start, STARTS)
    if line is not None:
        taken.take(arguments.choice, "line", line, tuple(values))
    for key, given, least in (("settle", settle, 0), ("record", record, 1)):
        taken.take(arguments.whole, key, given, least)
    if shard_runs is not None:
        taken.take(arguments.whole, "shard_runs", shard_runs, 1)
    taken.take(arguments.phase, "phase", phase)
    if numerics is not None:
        taken.take(arguments.instance, "numerics", numerics, Numerics)
    taken.raise_if_any("parameter_map")
    values = {name: np.unique(one) for name, one in values.items()}
    if start == "rest":
        line = fastest_axis(values)
    grid = Grid(pair, te, values, line or list(values)[-1], operation)
    if grid.runs > MAX_INT:
        raise ValueError(f"parameter_map: {grid.runs} runs, expected at most {MAX_INT}")
    if grid.length > MAX_INT // 8:
        raise ValueError(f"parameter_map: {grid.length} values of {grid.line}")
    _check_corners(grid)
    length = 1 if start == "rest" else grid.length
    size = shard_size(grid.runs, settle + record, length, shard_runs)
    return Job(grid, start, int(settle), int(record), float(phase),
               numerics or Numerics(rtol=1e-6), size)


def _check_corners(grid: Grid) -> None:
    """Refuse what is refused at a corner, where parameters are extreme together."""
    for corner in product(*(sorted({float(values[0]), float(values[-1])})
                            for values in grid.axes.values())):
        *others, (last, value) = zip(grid.axes, corner, strict=True)
        pair, operation = grid.pair, dict(grid.operation)
        for name, number in others:
            pair, operation = moved_to(pair, grid.te, name, number, operation)
        oscillator = oscillator_at(pair, grid.te, last, value, operation)
        if oscillator.gap == "one_flank" and oscillator.force < 0:
            raise ValueError("parameter_map: rest with a negative force needs a coast flank to "
                             "rest on")


class Found:
    """The numbers of the shards that are done, in the order of the runs."""

    def __init__(self, job: Job, notes: Callable[[str], object]) -> None:
        self.notes = notes
        self.data = {name: np.zeros(job.grid.runs, dtype=kind) for name, kind in KEPT.items()}
        self.data |= {name: np.full(job.grid.runs, np.nan) for name in job.grid.besides}
        self.data["status"][:] = Status.UNFINISHED
        self.cpus: set[str] = set()
        self._job = job

    def take(self, index: int, shard: Shard) -> None:
        """Put a shard in its place."""
        first, stop = self._job.cut.place(index)
        # The status last: of what Ctrl-C tears apart here nothing is told as known.
        for name, values in sorted(shard.data.items(), key=lambda item: item[0] == "status"):
            self.data[name][first:stop] = values
        self.cpus.add(shard.cpu)


class _Left:
    """Shards that stay where they lie, for whoever puts them together."""

    def __init__(self, notes: Callable[[str], object]) -> None:
        self.notes = notes

    def take(self, index: int, shard: Shard) -> None:
        """Let one be."""


class _Work:
    """Shards handed out and gathered."""

    def __init__(self, job: Job, folder: Path | None, found: Found | _Left,
                 progress: Callable[[float], object] | None,
                 indices: Iterable[int] | None = None) -> None:
        self.job, self.folder, self.found = job, folder, found
        self._indices = list(range(job.cut.shards) if indices is None else indices)
        self._progress = progress
        self._parts = np.zeros(job.cut.shards)
        self._stop = threading.Event()
        # Of a chain, the shards that others go on from.
        self._known: dict[int, Shard] = {}
        self._noted: set[int] = set()

    def carry_out(self, executor: Executor | None, threads: int) -> int:
        """Read what lies there, make the rest; returns how many that are."""
        if self.folder is not None:
            self.job.write_study(self.folder)
        left = [index for index in self._indices if not self._read(index)]
        self._tell()
        if not left:
            return 0
        with contextlib.ExitStack() as stack:
            if executor is None:
                pool = stack.enter_context(ThreadPoolExecutor(threads))
                ahead = threads

                def submit(index: int) -> Future[Any]:
                    return pool.submit(self._make, index, self._before(index))
            else:
                ahead, folder = FAR_AHEAD, self.folder or Path()

                def submit(index: int) -> Future[Any]:
                    return executor.submit(make_shard, self.job, index, folder,
                                           self._before(index))
            try:
                self._hand_out(submit, left, ahead + AHEAD)
            except BaseException:
                self._stop.set()
                raise
        return len(left)

    def _hand_out(self, submit: Callable[[int], Future[Any]], left: list[int],
                  most: int) -> None:
        """Keep an executor busy, and take what it has finished."""
        waiting: deque[int] = deque(left)
        under_way: dict[Future[Any], int] = {}
        while True:
            # Of a chain, those wait aside whose forerunner is not there yet.
            for _ in range(len(waiting)):
                index = waiting.popleft()
                if len(under_way) >= most or not self._may_begin(index):
                    waiting.append(index)
                else:
                    under_way[submit(index)] = index
            if not under_way:
                return
            try:
                done, _ = wait(under_way, return_when=FIRST_COMPLETED)
                for future in done:
                    self._take(future, under_way.pop(future))
            except BaseException:
                self._stop.set()
                for future in under_way:
                    future.cancel()
                self._take_finished(under_way)
                raise

    def _take_finished(self, under_way: dict[Future[Any], int]) -> None:
        """After an interruption: what is finished counts."""
        for future, index in under_way.items():
            if future.done() and not future.cancelled() and future.exception() is None:
                self._take(future, index)

    def _take(self, future: Future[Any], index: int) -> None:
        result = future.result()
        if isinstance(result, Shard):
            self._keep(index, result)
        elif not self._read(index):
            raise OSError(f"shard {index} is not in {self.folder}, where a worker says it wrote it")
        self._parts[index] = 1.0
        self._tell()

    def _make(self, index: int, before: Shard | None) -> Shard:
        """One shard, in a thread of this process."""
        told = self.job.told(index, before)
        if self.folder is not None and before is not None:
            shard, why = read_shard(self.folder, index, told)
            if shard is not None:
                return shard
            self._note(index, why)
        made = carried_out(self.job, index, lambda part: self._tell(index, part), self._stop,
                           before)
        digest = "" if self.folder is None else write_shard(
            self.folder, index, made.data, told, made.handed)
        return Shard(made.data, processor(), digest, made.handed)

    def _before(self, index: int) -> Shard | None:
        """The shard that one goes on from; of a chain's first there is none."""
        before = self.job.cut.before(index)
        return None if before is None else self._known[before]

    def _may_begin(self, index: int) -> bool:
        """Whether what a shard goes on from is known."""
        before = self.job.cut.before(index)
        return before is None or before in self._known

    def _keep(self, index: int, shard: Shard) -> None:
        """Take the numbers of a shard, and keep what the next one of its chain needs."""
        self.found.take(index, shard)
        if shard.handed is not None:
            self._known[index] = Shard({}, "", shard.digest, shard.handed)

    def _read(self, index: int) -> bool:
        """Take a shard that lies in the folder, if it is one of this map."""
        if self.folder is None:
            return False
        if not self._may_begin(index):
            return False  # looked at again when the one before it is there
        shard, why = read_shard(self.folder, index, self.job.told(index, self._before(index)))
        if shard is None:
            self._note(index, why)
            return False
        self._keep(index, shard)
        self._parts[index] = 1.0
        return True

    def _note(self, index: int, why: str) -> None:
        """Say, once, why a shard that lies there is made again."""
        if why and index not in self._noted:
            self._noted.add(index)
            self.found.notes(f"shard {index} {why}: made again")

    def _tell(self, index: int | None = None, part: float = 0.0) -> None:
        if index is not None:
            self._parts[index] = part
        if self._progress is not None:
            self._progress(float(self._parts[self._indices].mean()) if self._indices else 1.0)


def numbers_of(job: Job, found: Found) -> dict[str, NDArray[Any]]:
    """The numbers of all runs, name -> (runs,) array; what is not known of a run is NaN or 0."""
    data = dict(found.data)
    bad = data["status"] != Status.OK
    for name in REALS:
        data[name][bad] = np.nan
    for name in RATES:
        data[name] = rate_of(name, data.__getitem__, job.record)
    return data


def _dataset(job: Job, found: Found, interrupted: bool) -> xr.Dataset:
    import xarray as xr

    grid = job.grid
    data = {name: values.reshape(grid.shape) for name, values in numbers_of(job, found).items()}
    variables = {name: (grid.order, values) for name, values in data.items()}
    drawn = dict(zip(("x_parameter", "y_parameter"), grid.axes, strict=True)) \
        if len(grid.axes) == 2 else {}
    return worded(xr.Dataset(variables, dict(grid.axes), {
        **job.about, **drawn, "shards": job.cut.shards, "interrupted": int(interrupted),
        "cpus": "; ".join(sorted(found.cpus))})).transpose(*grid.axes)


__all__ = ["parameter_map"]
