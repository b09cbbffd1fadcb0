"""A large sweep cut into shards that outlive their process; to the bit the numbers of one call."""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import asdict, dataclass, fields, replace
from functools import cached_property
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from lapwing import engine
from lapwing.base.codes import Status
from lapwing.engine import Wanted, named, numbers, unknown
from lapwing.engine.records import (
    CYCLE_TABLE,
    IMPACT_TABLE,
    MEAN_TABLE,
    OUTCOME_TABLE,
    tangent_table,
)
from lapwing.engine.sweeps import SweepResult
from lapwing.results.shards import Shard, inputs_digest
from lapwing.studies.map.cut import CYCLES, Cut, Cuts, shard_size
from lapwing.studies.map.shards import REST, handed_over, told_of
from lapwing.studies.map.task import Made, Task
from lapwing.studies.sweep import amplitudes, waterfall
from lapwing.studies.sweep.curves import Curves, curves_of
from lapwing.studies.sweep.varied import Varied, force_per_deflection

if TYPE_CHECKING:
    from lapwing.engine.numerics import Numerics
    from lapwing.model.gear_pair import GearPair
    from lapwing.model.transmission_error import TransmissionError

# Columns of a list of impacts, each a variable of a shard.
IMPACTS = tuple(IMPACT_TABLE.names or ())


def is_large(points: int, cycles: int) -> bool:
    """Whether a sweep is more than a shard of work, so that it is cut.

    Parameters
    ----------
    points : int, values times starts
    cycles : int, mesh cycles of each
    """
    return points * cycles > CYCLES


@dataclass(frozen=True, eq=False)
class SweepJob(Task):
    """What is done at each point of a sweep; its runs are those of `sweep`, start after start.

    Attributes
    ----------
    pair, te, parameter, values, starts, settle, record, max_impacts, phase, operation : as of
        `sweep`, checked
    numerics : Numerics
    wanted : Wanted, of the engine
    besides : tuple of 'spectra' and 'amplitudes', what each point goes on for
    most : int or None, runs of a shard; None: by `CYCLES`
    """

    pair: GearPair
    te: TransmissionError | Curves
    parameter: str
    values: NDArray[Any]
    starts: tuple[str, ...]
    settle: int
    record: int
    max_impacts: int
    phase: float
    operation: dict[str, Any]
    numerics: Numerics
    wanted: Wanted
    besides: tuple[str, ...]
    most: int | None = None

    def __reduce__(self) -> tuple[Any, ...]:
        # Oscillators are made again where a shard is carried out.
        return type(self), tuple(getattr(self, one.name) for one in fields(self))

    @cached_property
    def oscillators(self) -> Varied:
        """Those of the values."""
        return Varied(self.pair, self.te, self.parameter, self.values, self.operation)

    @cached_property
    def method(self) -> str:
        """How all points are moved, since one call moves them alike."""
        return engine.common_method(self.oscillators.points, self.numerics)

    @cached_property
    def cut(self) -> Cuts:
        """Which runs are in which shard, start after start."""
        count = len(self.values)

        def size(start: str) -> int:
            return shard_size(count, self.settle + self.record, 1 if start == "rest" else count,
                              self.most)
        return Cuts(tuple(Cut(count, size(start), count, start) for start in self.starts))

    @property
    def grid(self) -> Any:
        """Runs as a result counts them."""
        runs = len(self.values) * len(self.starts)
        return SimpleNamespace(kind="sweep", axes={self.parameter: self.values}, order=("run",),
                               runs=runs, besides=())

    @property
    def run_bytes(self) -> int:
        """See `Task`: the tables are asked for by `sweep`."""
        return 0

    @property
    def about(self) -> dict[str, Any]:
        """See `Task`."""
        return {"starts": " ".join(self.starts), "settle": self.settle, "record": self.record}

    @cached_property
    def identity(self) -> str:
        """See `Task`."""
        return inputs_digest({
            **{one.name: getattr(self, one.name) for one in fields(self)
               if one.name not in ("pair", "te", "values", "numerics", "wanted")},
            "pair": asdict(self.pair), "numerics": asdict(self.numerics),
            "wanted": asdict(self.wanted)}, self.values, *curves_of(self.te).parts())

    def prepare(self) -> None:
        """See `Task`."""
        _ = self.method

    def carried_out(self, index: int, progress: Callable[[float], None] | None = None,
                    stop: threading.Event | None = None, before: Shard | None = None,
                    share_work: Callable[[int], int] = lambda _: 1) -> Made:
        """See `Task`."""
        first, behind = self.cut.place(index)
        block, first = divmod(first, len(self.values))
        many, start = behind - block * len(self.values) - first, self.starts[block]
        places = np.arange(first, first + many)
        told = told_of(progress, stop)
        begin = (*(before.handed if before and before.handed else REST), self.phase)
        lines = [(i, i, False) for i in range(many)] if start == "rest" else \
            [(0, many - 1, True) if start == "up" else (many - 1, 0, True)]
        result = engine.sweep(
            self.oscillators.points.take(places), lines, [begin] * len(lines),
            numerics=replace(self.numerics, method=self.method), wanted=self.wanted,
            settle=self.settle, record=self.record, log_room=self.max_impacts,
            threads=share_work(len(lines)), progress=told, log_table=IMPACT_TABLE)
        data: dict[str, NDArray[Any]] = {
                "status": result.outcome["status"].astype(np.int8),
                "outcome": numbers(result.outcome), "cycles": numbers(result.cycles)}
        if result.cycle_means is not None:
            data["cycle_means"] = numbers(result.cycle_means)
        if self.wanted.tangent:
            data["tangent"] = numbers(result.tangent)
        if self.wanted.speed_edges:
            data["density"] = result.density
        if self.wanted.impacts:
            data |= {"kept": result.kept, **{name: result.events[name] for name in IMPACTS}}
        data |= self.further(result.outcome, places, lambda: told(1.0))
        last = result.outcome[0 if start == "down" else -1]
        return Made(data, handed_over(last) if self.cut.is_chained(index) else None)

    def further(self, outcome: NDArray[Any], places: NDArray[Any], each: Callable[[], None],
                threads: int = 1) -> dict[str, NDArray[Any]]:
        """What points go on for after they are recorded, name -> (points, ...) array.

        Parameters
        ----------
        outcome : table (points,), how each ended
        places : array (points,), which of the values each has
        each : called before each of the parts
        threads : int
        """
        found: dict[str, NDArray[Any]] = {}
        if not self.besides:
            return found
        some = [self.oscillators[int(place)] for place in places]
        if "spectra" in self.besides:
            each()
            found["order_spectrum"] = waterfall.spectra(
                some, outcome, self.phase, waterfall.lines_of(self.oscillators),
                numerics=self.numerics, threads=threads)
        if "amplitudes" in self.besides:
            each()
            newtons = [force_per_deflection(self.pair, {self.parameter: self.values[place]})
                       for place in places]
            found |= amplitudes.amplitudes(some, outcome, np.nan_to_num(
                outcome["period"]).astype(np.int16), newtons, self.phase,
                numerics=self.numerics, threads=threads)
        return found


class Gathered:
    """The tables of the shards that are done, in the order of the runs."""

    def __init__(self, job: SweepJob, notes: Callable[[str], object]) -> None:
        self.notes, self.cpus = notes, set[str]()
        self._job = job
        runs, record = job.grid.runs, job.record
        degrees = job.oscillators.shared.degrees_of_freedom
        self._tables = {"outcome": unknown(OUTCOME_TABLE, runs),
                        "cycles": unknown(CYCLE_TABLE, runs, record)}
        self._tables["outcome"]["status"] = Status.UNFINISHED
        if degrees == 2:
            self._tables["cycle_means"] = unknown(MEAN_TABLE, runs, record)
        if job.wanted.tangent:
            self._tables["tangent"] = unknown(tangent_table(2 * degrees), runs, record)
        bins = len(job.wanted.speed_edges) + 1 if job.wanted.speed_edges else 1
        self._density = np.zeros((runs, bins))
        self._kept = np.zeros(runs, dtype=np.int64)
        self._events: dict[int, NDArray[Any]] = {}
        self.further: dict[str, NDArray[Any]] = {}
        if "spectra" in job.besides:
            lines = waterfall.lines_of(job.oscillators)
            self.further["order_spectrum"] = np.full((runs, lines), np.nan, dtype=np.float32)
        if "amplitudes" in job.besides:
            self.further |= {name: np.full(runs, np.nan) for name in amplitudes.NAMES}

    def take(self, index: int, shard: Shard) -> None:
        """Put a shard in its place; the outcome last, by which the rest is known."""
        first, stop = self._job.cut.place(index)
        data = dict(shard.data)
        data.pop("status")
        if "kept" in data:
            columns = {name: data.pop(name) for name in IMPACTS}
            events = np.empty(len(columns[IMPACTS[0]]), dtype=IMPACT_TABLE)
            for name, column in columns.items():
                events[name] = column
            self._events[first], self._kept[first:stop] = events, data.pop("kept")
        if "density" in data:
            self._density[first:stop] = data.pop("density")
        tables = {name: data.pop(name) for name in self._tables}
        for name, values in data.items():
            self.further[name][first:stop] = values
        for name in reversed(tables):
            self._tables[name][first:stop] = named(tables[name], self._tables[name].dtype)
        self.cpus.add(shard.cpu)

    def result(self, interrupted: bool) -> SweepResult:
        """All of it as one call of the engine gives it."""
        events = [self._events[first] for first in sorted(self._events)]
        tables = self._tables
        return SweepResult(
            tables["outcome"], tables["cycles"], tables.get("cycle_means"),
            tables.get("tangent", unknown(tangent_table(), 1, 1)), self._density,
            np.concatenate(events) if events else np.empty(0, IMPACT_TABLE), self._kept,
            interrupted, method=self._job.method)
