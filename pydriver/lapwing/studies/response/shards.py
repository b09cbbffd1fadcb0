"""A long response cut at checkpoints into pieces that outlive their process.

Each pass, that of the response, the one that judges its numbers and those on other curves, is a
chain of pieces: some mesh cycles each, that begin with the state which the piece before hands over.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass, fields
from functools import cached_property
from types import SimpleNamespace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lapwing.base.codes import Status
from lapwing.model.transmission_error.algebra import parts_of
from lapwing.results.shards import Shard, inputs_digest
from lapwing.studies.map.cut import Cuts, Line
from lapwing.studies.map.shards import told_of
from lapwing.studies.map.task import Made, Task
from lapwing.studies.response.mesh_force import BATCH
from lapwing.studies.response.recording import Pass, Recording

# Mesh cycles of a piece while a motion settles, some 20 s of RK4; samples of a piece that is
# recorded, some 5 s and 25 MB.
SETTLED, SAMPLED = 1_000_000, 1 << 20


def is_long(settle: int, record: int, samples_per_cycle: int) -> bool:
    """Whether a response is more than one piece of either, so that it is cut."""
    return settle > SETTLED or record * samples_per_cycle > 2 * SAMPLED


def bounds(span: tuple[int, int], phases: int, most: int | None = None) -> tuple[int, ...]:
    """Mesh cycles at which a pass is cut, its beginning and its end among them.

    Parameters
    ----------
    span : mesh cycles to settle, and to record
    phases : int, samples in a mesh cycle
    most : int or None, mesh cycles of a piece; None: by `SETTLED` and `SAMPLED`. Of recorded ones
        there are whole batches of `mesh_force`
    """
    settle, record = span
    recorded = max(1, (most or SAMPLED // phases) // BATCH) * BATCH
    # The cycle behind the last goes with it.
    return (*range(0, settle, most or SETTLED), *range(settle, settle + record, recorded),
            settle + record + 1)


@dataclass(frozen=True, eq=False)
class ResponseJob(Task):
    """The passes of a response; runs are their mesh cycles, pass after pass.

    Attributes
    ----------
    passes : tuple of Pass
    most : int or None, mesh cycles of a piece (`bounds`)
    """

    passes: tuple[Pass, ...]
    most: int | None = None
    unit = "mesh cycles"

    @cached_property
    def cut(self) -> Cuts:
        """Which mesh cycles are in which piece."""
        return Cuts(tuple(Line(bounds(one.span, one.grid.size, self.most)) for one in self.passes))

    @property
    def grid(self) -> Any:
        """Runs as they are counted."""
        return SimpleNamespace(kind="response", axes={}, order=("run",), besides=(),
                               runs=sum(one.cycles for one in self.passes))

    @property
    def run_bytes(self) -> int:
        """See `Task`: the tables are asked for by `response`."""
        return 0

    @property
    def about(self) -> dict[str, Any]:
        """See `Task`."""
        settle, record = self.passes[0].span
        return {"passes": len(self.passes), "settle": settle, "record": record}

    @cached_property
    def identity(self) -> str:
        """See `Task`."""
        told = [{**{one.name: getattr(each.osc, one.name) for one in fields(each.osc)
                    if one.name not in ("te", "kept")},
                 "start": each.start, "span": each.span, "numerics": asdict(each.numerics),
                 "exponents": each.exponents} for each in self.passes]
        return inputs_digest({"passes": told, "most": self.most}, *(
            array for each in self.passes for array in (*parts_of(each.osc.te), each.grid)))

    def carried_out(self, index: int, progress: Callable[[float], None] | None = None,
                    stop: threading.Event | None = None, before: Shard | None = None,
                    share_work: Callable[[int], int] = lambda _: 1) -> Made:
        """See `Task`."""
        first, stop_at = self.cut.place(index)
        which = 0
        while first >= self.passes[which].cycles:
            behind = self.passes[which].cycles
            first, stop_at, which = first - behind, stop_at - behind, which + 1
        made = self.passes[which].piece(first, stop_at, before.handed if before else None,
                                        told_of(progress, stop))
        status = np.full(stop_at - first, made.status, dtype=np.int8)
        return Made({"status": status, **made.tables}, made.handed)


class Gathered:
    """The pieces that are done."""

    def __init__(self, job: ResponseJob, notes: Callable[[str], object]) -> None:
        self.notes, self.cpus = notes, set[str]()
        self._job = job
        self._pieces: dict[int, dict[str, NDArray[Any]]] = {}

    def take(self, index: int, shard: Shard) -> None:
        """Keep one."""
        self._pieces[index] = dict(shard.data)
        self.cpus.add(shard.cpu)

    def recordings(self) -> Iterator[Recording]:
        """What the pieces of each pass come to, one after the other; they are used up."""
        for chain, one in enumerate(self._job.passes):
            pieces = [self._pieces.pop(index) for index in self._job.cut.chain(chain)]
            yield one.recording([(Status(int(each.pop("status")[0])), each) for each in pieces])


__all__ = ["Gathered", "ResponseJob", "bounds", "is_long"]
