"""A plane of starts, cut into cells, and what is done at the middle of each."""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, fields
from functools import cached_property
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from lapwing.base.codes import MotionState
from lapwing.model.oscillator import Oscillator
from lapwing.model.start import coast_flanks
from lapwing.model.transmission_error.algebra import parts_of
from lapwing.results.shards import Shard, inputs_digest
from lapwing.studies.attractors.dataset import about
from lapwing.studies.attractors.search import Search, followed, spread
from lapwing.studies.attractors.starts import motion_states
from lapwing.studies.map.grid import Crossings
from lapwing.studies.map.task import Made, Task

# The states at a mesh phase, and arrivals at either flank.
PLANES = {"state": ("start_phi", "start_phi_dot"), "drive": ("start_phase", "start_speed"),
          "coast": ("start_phase", "start_speed")}
# Cells in which the motions are looked for, before all are labelled.
PILOT = 2048
# Variables of a shard, as they are kept.
KEPT = {"status": np.int8, "motion": np.int16, "ending": np.int8, "cycles": np.int32,
        "motion_state": np.int8, "phi": float, "phi_dot": float}


@dataclass(frozen=True, eq=False)
class Plane(Crossings):
    """Cells of a plane of starts, counted line by line along the first axis.

    Attributes
    ----------
    osc : Oscillator
    name : str, of `PLANES`
    axes : dict of the two names -> values, the middles of the cells
    phase : float, mesh phase of the states; NaN for arrivals
    """

    osc: Oscillator
    name: str
    axes: Mapping[str, NDArray[np.float64]]
    phase: float
    kind: ClassVar[str] = "basins"
    # Nothing is known of a run without moving it (`map.grid.Grid`).
    besides: ClassVar[tuple[str, ...]] = ()

    @cached_property
    def order(self) -> tuple[str, ...]:
        """See `Crossings`."""
        first, second = self.axes
        return second, first

    def starts(self, cells: NDArray[np.intp]) -> NDArray[np.float64]:
        """Starts (n, 4) in the middles of cells, as the engine takes them."""
        second, first = (self.axes[name][places] for name, places in zip(
            self.order, np.unravel_index(cells, self.shape), strict=True))
        if self.name == "state":
            phases = np.full(len(first), self.phase)
            return np.column_stack([motion_states(self.osc, first, phases), first, second, phases])
        flank, way = (np.zeros(len(first)), 1.0) if self.name == "drive" \
            else (coast_flanks(self.osc, first), -1.0)
        return np.column_stack([np.full(len(first), float(MotionState.SEPARATION)), flank,
                                way * second, first])


@dataclass(frozen=True, eq=False)
class Cells(Task):
    """Every cell of a plane is followed to its end, among the motions that a part of them finds.

    Attributes
    ----------
    grid : Plane
    search : Search, whose motions are found by `prepare`
    shard_runs : int, cells of a shard
    """

    grid: Plane
    search: Search
    shard_runs: int
    start = "rest"
    # `KEPT` and the table that it is put into, then the labels.
    run_bytes = 29 + 8 * 7 + 8

    def prepare(self) -> None:
        """Find the motions, from a part of the cells; once."""
        if not self.search.motions:
            self.search.find(self.grid.starts(spread(self.grid.runs, PILOT)))

    def carried_out(self, index: int, progress: Callable[[float], None] | None = None,
                    stop: threading.Event | None = None, before: Shard | None = None,
                    share_work: Callable[[int], int] = lambda _: 1) -> Made:
        """See `Task`."""
        self.prepare()
        first, behind = self.cut.place(index)
        search = self.search
        ends = followed(search.osc, search.known(), self.grid.starts(np.arange(first, behind)),
                        search.numerics, share_work(behind - first), progress, stop)
        return Made({name: ends[name].astype(kind) for name, kind in KEPT.items()}, None)

    @property
    def kept(self) -> dict[str, Any]:
        """See `Task`."""
        return KEPT

    @property
    def about(self) -> dict[str, Any]:
        """See `Task`."""
        return {**about(self.search), "plane": self.grid.name, "phase": self.grid.phase,
                "shard_runs": self.shard_runs}

    def write_study(self, folder: Any) -> None:
        """See `Task`; what it says follows from the motions."""
        self.prepare()
        super().write_study(folder)

    @cached_property
    def identity(self) -> str:
        """See `Task`."""
        osc, search = self.grid.osc, self.search
        return inputs_digest({
            "oscillator": {one.name: getattr(osc, one.name) for one in fields(osc)
                           if one.name not in ("te", "scales", "load")},
            "plane": self.grid.name, "phase": self.grid.phase, "numerics": asdict(search.numerics),
            "rules": [search.most_cycles, search.returns, search.recurrences, search.resolution],
            "shard_runs": self.shard_runs}, *self.grid.axes.values(), *parts_of(osc.te))


__all__ = ["KEPT", "PLANES", "Cells", "Plane"]
