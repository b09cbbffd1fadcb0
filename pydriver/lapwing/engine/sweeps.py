"""Many oscillators in one call: in lines that run side by side, block by block."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from lapwing.base import estimates
from lapwing.base.codes import Status
from lapwing.base.threads import team_of, usable_threads
from lapwing.engine import blocks, calls
from lapwing.engine.flanks import flank_arguments
from lapwing.engine.methods import common_method
from lapwing.engine.points import Points
from lapwing.engine.records import (
    CYCLE_TABLE,
    EVENT_TABLE,
    OUTCOME_TABLE,
    named,
    tangent_table,
    with_means,
)

if TYPE_CHECKING:
    from lapwing.engine.numerics import Numerics, Wanted

LINE_DONE = 4  # fortran/run/sweep.f90, stage_done
# Points of a block for each thread at least, lest threads wait for the last of them.
POINTS_PER_THREAD = 8
# To begin or to wake a thread takes longer than fewer cycles, by the way they are moved.
CYCLES_PER_THREAD = {"exact": 1000, "rk4": 40}


@dataclass
class SweepResult:
    """Tables of a sweep (`records`): outcome (points,), cycles (points, record), events.

    `events` is one list (n,), those of a point one after the other, `kept` (points,) of each;
    `cycle_means` (points, record), None with one degree of freedom; `tangent` (points, record)
    where it was wanted; `density` an array (points, bins + 2); `cpu_seconds` is the processor time
    spent inside the compiled engine; `method` is 'exact' or 'rk4', how they were moved.
    """

    outcome: np.ndarray
    cycles: np.ndarray
    cycle_means: np.ndarray | None
    tangent: np.ndarray
    density: np.ndarray
    events: np.ndarray
    kept: np.ndarray
    interrupted: bool = False
    cpu_seconds: float = 0.0
    method: str = ""

    def logs(self) -> list[NDArray[Any]]:
        """The events of each point."""
        return np.split(self.events, np.cumsum(self.kept)[:-1])


class _Tables(NamedTuple):
    """Arrays that the engine writes, points last; one of a single entry serves all points."""

    cycles: NDArray[np.float64]
    tangent: NDArray[np.float64]
    density: NDArray[np.float64]
    outcome: NDArray[np.float64]

    @classmethod
    def of(cls, points: Points, wanted: Wanted, record: int, keep_cycles: bool) -> _Tables:
        """Tables of all points; of cycles the engine fills all rows, also those not reached."""
        n, more = len(points), 2 * points.shared.degrees_of_freedom - 2
        by_cycle = wanted.cycles or wanted.strobe or wanted.tangent
        columns = calls.CYCLE_COLUMNS + more + calls.AVERAGE_COLUMNS * wanted.averages
        cycles = np.empty((columns, record if by_cycle else 1,
                           n if keep_cycles else 1), order="F")
        width = tangent_table(2 + more).itemsize // 8
        tangent = np.full((width, *((record, n) if wanted.tangent else (1, 1))), np.nan, order="F")
        outcome = np.full((calls.OUTCOME_COLUMNS, n), np.nan, order="F")
        outcome[0] = Status.UNFINISHED
        bins = (len(wanted.speed_edges) + 1, n) if wanted.speed_edges else (1, 1)
        return cls(cycles, tangent, np.zeros(bins, order="F"), outcome)

    def some(self, points: NDArray[np.intp]) -> _Tables:
        """Those of some points, copies of what is not one for all."""
        n = self.outcome.shape[1]
        return _Tables(*(np.asfortranarray(one[..., points]) if one.shape[-1] == n else one
                         for one in self))

    def put(self, points: NDArray[np.intp], part: _Tables) -> None:
        """Write back what `some` gave."""
        for one, other in zip(self, part, strict=True):
            if other is not one:
                one[..., points] = other

    def forget_unfinished(self) -> None:
        """Nothing is known of points left where they were, at an interruption or without memory."""
        if not self.outcome[0].any():  # all are OK
            return
        left = (self.outcome[0] == Status.UNFINISHED) | (self.outcome[0] == Status.OUT_OF_MEMORY)
        if np.any(left):
            for one in (self.cycles, self.tangent):
                if one.shape[-1] == len(left):
                    one[..., left] = np.nan


def sweep(points: Any, lines: Any, starts: Any, *, numerics: Numerics, wanted: Wanted,
          settle: int, record: int, log_room: int, threads: int,
          progress: Callable[..., Any] | None = None, keep_interrupted: bool = False,
          keep_cycles: bool = True, log_table: np.dtype[Any] = EVENT_TABLE) -> SweepResult:
    """Run many oscillators in lines.

    Parameters
    ----------
    points : Points, or sequence of Oscillator, all with the same laws
    lines : sequence of (first, last, carried), points from first to last inclusive, 0-based,
        either way; carried: each point begins where the one before ended
    starts : sequence of (motion state or REST, phi, phi', phase), one per line, for its first
        point; later ones begin at the same phase
    settle, record : int, cycles before recording and cycles recorded
    log_room : int, lines of the log kept per point: impacts beyond that are dropped
    threads : int, wanted; `threads.usable_threads` says how many are begun
    progress : callable(fraction) or None, called between calls into the engine
    keep_interrupted : bool, whether Ctrl-C ends the sweep with what is finished, the other points
        with status UNFINISHED, instead of raising KeyboardInterrupt
    keep_cycles : bool; False: of the cycles nothing is wanted but what `outcome` tells of them. The
        memory of one point serves all, one after the other, and so does one thread
    log_table : dtype, columns of `records.EVENT_TABLE` that are kept

    Returns
    -------
    SweepResult

    Raises
    ------
    MemoryError
        where the list of events cannot fit.
    ValueError
        where events or near-grazes are wanted and their log is full.
    """
    points = points if isinstance(points, Points) else Points.of(points)
    n, shared = len(points), points.shared
    method = common_method(points, numerics)
    flank = flank_arguments(points.curves, shared.back_flank_te, method)
    reals = calls.real_parameters(points, numerics, method, wanted)
    choices = calls.choices(shared, numerics, method, wanted, settle, record)
    way = np.array(lines, dtype=np.intc).reshape(-1, 3)
    begins = np.array(starts, dtype=float).reshape(-1, 4)
    tables = _Tables.of(points, wanted, record, keep_cycles)
    worth = len(points) * (settle + record) // CYCLES_PER_THREAD[method]
    threads = min(threads, max(1, worth)) if keep_cycles else 1
    waits = wanted.events or wanted.grazes
    logs = blocks.Logs(n, log_table) if waits or wanted.impacts else None
    log = np.empty((calls.LOG_COLUMNS, 1, n), order="F")
    most = n if logs is None else max(estimates.log_points(log_room), POINTS_PER_THREAD * threads)
    interrupted, seconds = False, 0.0
    for block in _blocks(way, begins, tables, most):
        part, here = block.part, block.points
        size = part.outcome.shape[1]
        if logs is not None and (log.shape[1] != log_room or log.shape[2] < size):
            log = np.empty((calls.LOG_COLUMNS, log_room, size), order="F")
        own = reals if part is tables else np.asfortranarray(reals[:, here])
        try:
            for spent in block.steps((flank, own, choices), log[:, :, :size], threads, waits):
                seconds += spent
                if progress is not None:
                    progress(_finished(tables, part) / n)
        except KeyboardInterrupt:
            if not keep_interrupted:
                raise
            interrupted = True
        if part is not tables:
            tables.put(here, part)
        if logs is not None:
            logs.take(here, part.outcome, log[:, :, :size])
        if interrupted:
            break
    tables.forget_unfinished()
    # What the averages are made of stands behind the columns of the table.
    width = len(tables.cycles) - calls.AVERAGE_COLUMNS * wanted.averages
    cycles, means = with_means(tables.cycles[:width].transpose(2, 1, 0), CYCLE_TABLE)
    states = 2 * shared.degrees_of_freedom
    kept, events = (np.zeros(n, int), np.empty(0, log_table)) if logs is None else (
        logs.kept, logs.listed())
    return SweepResult(named(tables.outcome.T, OUTCOME_TABLE), cycles, means,
                       named(tables.tangent.transpose(2, 1, 0), tangent_table(states)),
                       tables.density.T, events, kept, interrupted, seconds, method)


def _finished(tables: _Tables, part: _Tables) -> int:
    """Points that are finished, those of the block under way included."""
    both = (tables,) if part is tables else (tables, part)
    return sum(int(np.count_nonzero(one.outcome[0] != Status.UNFINISHED)) for one in both)


def _blocks(way: NDArray[Any], begins: NDArray[np.float64], tables: _Tables,
            most: int) -> Iterator[_Block]:
    """Blocks of about so many points, each made when those before are done."""
    n = tables.outcome.shape[1]
    if n <= most:
        yield _Block(np.arange(n), tables, _lines(way[:, :2].T, way[:, 2]),
                     np.asfortranarray(begins.T))
        return
    for pieces in blocks.cut(way, most):
        points = blocks.points_of(pieces)
        yield _Block(points, tables.some(points),
                     _lines(np.searchsorted(points, pieces[:, :2].T), way[pieces[:, 2], 2]),
                     _begins(pieces, way, begins, tables.outcome))


def _lines(ends: NDArray[Any], carried: NDArray[Any]) -> NDArray[np.intc]:
    """Lines as the engine takes them, (5, m), points counted from 1."""
    lines = np.zeros((5, ends.shape[1]), dtype=np.intc, order="F")
    lines[:2] = ends
    lines[:2] += 1
    lines[2], lines[3] = carried, lines[0]
    return lines


def _begins(pieces: NDArray[Any], way: NDArray[Any], begins: NDArray[np.float64],
            outcome: NDArray[np.float64]) -> NDArray[np.float64]:
    """How each piece begins, (4, pieces): as its line does, or where the point before ended."""
    first, _, line, whole = pieces.T
    found = begins[line]
    on = (whole == 0) & (way[line, 2] != 0)
    before = outcome[:, (first - np.where(way[line, 1] < way[line, 0], -1, 1))[on]]
    ended = before[0] == Status.OK
    found[on, 0] = np.where(ended, before[2], calls.REST)
    found[on, 1:3] = np.where(ended, before[3:5], 0.0).T
    return np.asfortranarray(found.T)


@dataclass
class _Block:
    """Some pieces of lines, carried out in calls of bounded work.

    Attributes
    ----------
    points : array (n,), its points among those of the sweep, rising
    part : _Tables of these points
    lines : array (5, m): first and last point of the block, carried, next point, its stage
    begins : array (4, m)
    """

    points: NDArray[np.intp]
    part: _Tables
    lines: NDArray[np.intc]
    begins: NDArray[np.float64]

    def steps(self, fixed: tuple[Any, ...], log: NDArray[np.float64], threads: int,
              waits: bool) -> Iterator[float]:
        """Call the engine until all is done, and give the processor time of each call, s."""
        many, part = self.lines.shape[1], self.part
        # The engine reads what it has written only; to fill all of it takes longer than short runs.
        # Compared, it must be equal to itself.
        blobs = (np.zeros if waits else np.empty)((calls.BLOB_SIZE, many), order="F")
        while self.lines[4].min() < LINE_DONE:
            before = (self.lines.copy(), blobs.copy()) if waits else None
            begun = time.process_time()
            count = usable_threads(threads, many)
            within = np.array([calls.CALL_SECONDS, count])
            with team_of(count):
                calls.api.sweep(*fixed, self.lines, self.begins, within, blobs, part.cycles,
                                part.tangent, part.density, log, part.outcome)
            spent = time.process_time() - begun
            if before and np.array_equal(before[0], self.lines) \
                    and np.array_equal(before[1], blobs):
                raise ValueError(f"sweep: a log of log_room = {log.shape[1]} lines is full; events "
                                 "and near-grazes are never dropped")
            yield spent
