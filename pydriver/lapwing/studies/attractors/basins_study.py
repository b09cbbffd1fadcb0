"""Basins as a deck asks for them."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Executor
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from lapwing.engine import Numerics, destinations
from lapwing.results.findings import endings
from lapwing.studies import cost
from lapwing.studies.again import Again
from lapwing.studies.attractors.basins import basins, job_of
from lapwing.studies.attractors.plane import Cells
from lapwing.studies.attractors.search import followed
from lapwing.studies.labels import own_operation
from lapwing.studies.trajectory import run_from

if TYPE_CHECKING:
    import xarray as xr

    from lapwing.deck.deck import Asked, Deck


def keeps_shards(_: Asked) -> bool:
    """Whether it keeps what is finished in a folder, while it is under way."""
    return True


def extent(study: Asked) -> tuple[int, str]:
    """How much of it there is to tell progress by, and in what unit."""
    return study.x_count * study.y_count, "cells"


def failed(dataset: xr.Dataset) -> str:
    """What failed numerically, in words; empty text, nothing."""
    _, _, cells = endings(dataset)
    return f"basins {{}} ({cells} cells)" * bool(cells)


def carry_out(deck: Deck, study: Asked, order: int, threads: int,
              done: Callable[[float], None] | None, folder: Path | None = None,
              notes: Callable[[str], None] | None = None,
              executor: Executor | None = None) -> xr.Dataset:
    """The basins of one plane; a signal keeps the shards that are finished. See `registry`."""
    result = basins(**_arguments(deck, study), folder=folder, threads=threads, progress=done,
                    notes=notes, executor=executor, keep_interrupted=True)
    return result.assign_attrs(own_operation(deck, study))


def job(deck: Deck, study: Asked) -> Cells:
    """How a plane is cut, and what its shards say of themselves."""
    return job_of(**_arguments(deck, study), threads=1)


def again(deck: Deck, study: Asked, index: int) -> Again:
    """The run of one cell once more, `index` counting as `status` of its results does."""
    made = job(deck, study)
    made.prepare()
    plane, search = made.grid, made.search
    where = dict(zip(plane.axes, np.unravel_index(index, [*map(len, plane.axes.values())]),
                     strict=True))
    cell = np.ravel_multi_index([where[name] for name in plane.order], plane.shape)
    start = plane.starts(np.array([cell]))
    (end,) = destinations(search.osc, search.known(), start, numerics=search.numerics)
    *state, phase = start[0].tolist()
    return Again(
        run_from(search.osc, tuple(state), phase, (int(end["cycles"]) + 1, 0.0), search.numerics,
                 bounces=False),
        {name: float(values[where[name]]) for name, values in plane.axes.items()})


def _arguments(deck: Deck, study: Asked) -> dict[str, Any]:
    """What a deck says of basins, as `job_of` takes it."""
    return {"osc": deck.oscillator(study), "plane": study.plane,
            "size": (study.x_count, study.y_count), "phi": study.phi, "phi_dot": study.phi_dot,
            "phase": study.phase, "speed": study.speed, "most_cycles": study.most_cycles,
            "returns": study.returns, "recurrences": study.recurrences,
            "resolution": study.resolution, "numerics": Numerics(**deck.numerics_of(study)),
            "shard_runs": study.shard_runs}


def estimate(deck: Deck, study: Asked, seconds: float, clock: Callable[[], float],
             threads: int) -> tuple[float, float, float]:
    """How long it takes, from some of its cells; see `cost.rates`."""
    made = job(deck, study)
    made.prepare()
    search = made.search

    def tried(part: NDArray[Any]) -> None:
        followed(search.osc, search.known(), made.grid.starts(part), search.numerics, 1)

    low, high, count = cost.rates(tried, np.arange(made.grid.runs), seconds, clock)
    runs = made.grid.runs
    return low * runs / threads, high * runs / threads, count / runs


__all__ = ["again", "carry_out", "estimate", "extent", "failed", "job"]
