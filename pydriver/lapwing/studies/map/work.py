"""The shards of a study handed out and gathered, by threads or by whatever executor."""

from __future__ import annotations

import contextlib
import threading
from collections import deque
from collections.abc import Callable, Iterable
from concurrent.futures import FIRST_COMPLETED, Executor, Future, ThreadPoolExecutor, wait
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lapwing.base import arguments, estimates
from lapwing.base.codes import Status
from lapwing.base.threads import checked_threads, usable_threads
from lapwing.results.provenance import processor
from lapwing.results.shards import Shard, read_digest, read_shard, write_shard
from lapwing.studies.map.observed import RATES, rate_of
from lapwing.studies.map.shards import Job, make_shard
from lapwing.studies.map.task import Task
from lapwing.studies.side_by_side import LISTEN

# Shards handed over beyond those that are worked at: to threads, and to another executor, of which
# it is not known how many workers it has.
AHEAD, FAR_AHEAD = 4, 1000


def carry_out(who: str, job: Task, *, folder: str | Path | None, executor: Executor | None,
              threads: int | None, progress: Callable[[float], None] | None,
              notes: Callable[[str], None] | None, keep_interrupted: bool) -> tuple[Found, bool]:
    """Make or read the shards of a study; arguments as of `parameter_map`, which `who` may be.

    Returns
    -------
    Found, and whether Ctrl-C has left some of it open
    """
    estimates.require(job.grid.runs * job.run_bytes, who, "the number of runs")
    found = Found(job, (lambda _: None) if notes is None else notes)
    return found, gather(who, job, found, folder=folder, executor=executor, threads=threads,
                         progress=progress, notes=notes, keep_interrupted=keep_interrupted)


def gather(who: str, job: Task, found: Any, *, folder: str | Path | None,
           executor: Executor | None, threads: int | None,
           progress: Callable[[float], None] | None, notes: Callable[[str], None] | None,
           keep_interrupted: bool) -> bool:
    """The same, the shards taken by `found`, a `Found` or what can the same.

    Returns
    -------
    bool, whether Ctrl-C has left some of it open
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
    threads = _fitting(job, checked_threads(threads))
    folder = None if folder is None else Path(arguments.path("folder", folder))
    work = _Work(job, folder, found, progress)
    try:
        work.carry_out(executor, threads)
    except KeyboardInterrupt:
        if not keep_interrupted:
            raise
        return True
    return False


def make_part(job: Task, folder: Path, part: int, parts: int, threads: int,
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
    made = _Work(job, folder, found, progress, indices).carry_out(None, _fitting(job, threads))
    return made, len(indices) - made


def _fitting(job: Task, threads: int) -> int:
    """How many of the wanted threads are begun; no number depends on it."""
    return estimates.threads_that_fit(usable_threads(threads, job.cut.shards), job.thread_bytes)


def missing_of(job: Task, folder: Path) -> list[int]:
    """Shards of a study that do not lie in a folder, or are not of it, in their order.

    A shard of a chain that goes on from another state than the one before hands over is not of it.
    Numbers are not looked at: whoever puts shards together checks them.
    """
    missing = []
    for chain in range(job.cut.chains):
        before: Shard | None = None
        for index in job.cut.chain(chain):
            digest = read_digest(folder, index, job.told(index, before))
            if digest is None:
                missing.append(index)
            # Behind one that is missing it is not known which state is right.
            before = None if digest is None else Shard({}, "", digest)
    return missing


class Found:
    """The numbers of the shards that are done, in the order of the runs."""

    def __init__(self, job: Task, notes: Callable[[str], object]) -> None:
        self.notes = notes
        self.data = {name: np.zeros(job.grid.runs, dtype=kind) for name, kind in job.kept.items()}
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


class Noted:
    """The same, and what is known of all.

    Attributes
    ----------
    status : array (runs,) of `Status`, in the order of the runs
    least : dict of variable -> its least number
    cpus : set of str
    """

    def __init__(self, job: Task, notes: Callable[[str], object]) -> None:
        self.notes, self.cpus = notes, set[str]()
        self.status = np.full(job.grid.runs, Status.UNFINISHED, dtype=np.int8)
        self.least: dict[str, float] = {}
        self._job = job

    def take(self, index: int, shard: Shard) -> None:
        """Note one."""
        first, stop = self._job.cut.place(index)
        self.cpus.add(shard.cpu)
        for name, values in shard.data.items():
            self.least[name] = min(self.least.get(name, 0), values.min())
        # Last: of what Ctrl-C tears apart here nothing is told as known.
        self.status[first:stop] = shard.data["status"]


class _Work:
    """Shards handed out and gathered."""

    def __init__(self, job: Task, folder: Path | None, found: Found | _Left,
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
        self.job.prepare()
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
        # Of a chain, a shard is ready when the one before it is there. Chains come first, then
        # large shards, so that none is waited for at the end.
        ready = deque(sorted((index for index in left if self._may_begin(index)), key=self._turn))
        waiting = set(left).difference(ready)
        under_way: dict[Future[Any], int] = {}
        while ready or under_way:
            while ready and len(under_way) < most:
                index = ready.popleft()
                under_way[submit(index)] = index
            try:
                # Not for ever: a signal that another thread hears wakes no one.
                done, _ = wait(under_way, LISTEN, FIRST_COMPLETED)
                for future in done:
                    index = under_way.pop(future)
                    self._take(future, index)
                    if index + 1 in waiting and self.job.cut.before(index + 1) == index:
                        waiting.remove(index + 1)
                        ready.appendleft(index + 1)
            except BaseException:
                self._stop.set()
                for future in under_way:
                    future.cancel()
                self._take_finished(under_way)
                raise

    def _turn(self, index: int) -> tuple[bool, int]:
        """What a shard is sorted by that is ready."""
        first, stop = self.job.cut.place(index)
        return not self.job.cut.is_chained(index), first - stop

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
        made = self.job.carried_out(index, lambda part: self._tell(index, part), self._stop,
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
    for name, kind in job.kept.items():
        if kind is float:
            data[name][bad] = np.nan
    for name in RATES:
        data[name] = rate_of(name, data.__getitem__, job.record)
    return data
