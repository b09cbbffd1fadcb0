"""Basins: which cell of a plane of starts leads to which attractor."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Executor
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from lapwing.base import arguments
from lapwing.base.arguments import Refusals
from lapwing.base.codes import Status
from lapwing.base.quantities import worded
from lapwing.engine import END_TABLE, Numerics
from lapwing.model.oscillator import Oscillator
from lapwing.studies.attractors.dataset import (
    attractor_variables,
    counts,
    ranked,
    renumbered,
    shares,
)
from lapwing.studies.attractors.plane import KEPT, PLANES, Cells, Plane
from lapwing.studies.attractors.run import search_of
from lapwing.studies.attractors.starts import checked_spans, ranges, start_problems
from lapwing.studies.ensemble.statistics import Sample
from lapwing.studies.map.cut import shard_size
from lapwing.studies.map.work import Found, carry_out

if TYPE_CHECKING:
    import xarray as xr

MOST_ALONG = 20_000
# What a cell takes of mesh cycles, for the size of a shard; and cells along the side of a box of
# the entropy (Daza et al. 2016: 25 in each).
CYCLES, BOX = 100, 5


@arguments.complete()
def basins(osc: Oscillator, plane: str = "state", *, size: Any = 256, phi: Any = None,
           phi_dot: Any = None, phase: float = 0.0, speed: Any = None, most_cycles: int = 1000,
           returns: int = 30, recurrences: int = 50, resolution: int = 256,
           numerics: Numerics | None = None, shard_runs: int | None = None,
           folder: str | Path | None = None, executor: Executor | None = None,
           threads: int | None = None, progress: Callable[[float], None] | None = None,
           notes: Callable[[str], None] | None = None,
           keep_interrupted: bool = False) -> xr.Dataset:
    """Tell of each cell of a plane of starts which attractor it leads to.

    The attractors are looked for in some 2,000 cells spread over all, as `lapwing.attractors` does;
    then every cell is followed until it is one of them. Cells that are none of them are looked at
    once more, at most 512.

    Parameters
    ----------
    osc : Oscillator, of one degree of freedom
    plane : 'state', φ × φ' at a mesh phase; 'drive' or 'coast', arrivals at that flank, mesh phase
        × speed relative to it
    size : int or (int, int), cells along either axis
    phi, phi_dot : (low, high) or None, of 'state'; default as of `lapwing.attractors`
    phase : float, mesh phase of 'state'
    speed : (low, high) or None, of arrivals, rad per τ; default: from 0 to that of a fall through
        the gap
    most_cycles, returns, recurrences, resolution, numerics : as of `lapwing.attractors`
    shard_runs, folder, executor, threads, progress, notes, keep_interrupted : as of
        `lapwing.parameter_map`

    Returns
    -------
    xarray.Dataset
        over the plane, start_phi and start_phi_dot (or start_phase and start_speed):
        attractor_of_run (0: not resolved), ending, followed_cycles, status. Over `attractor`,
        `point` and `multiplier` as of `lapwing.attractors`, share being the part of the cells whose
        end is known. Attributes: unresolved, failed, presumed; basin_entropy, the mean of -Σ p ln p
        over boxes of 5 × 5 cells, p the parts of a box by attractor; boundary_entropy, that of the
        boxes with more than one (above ln 2 the boundary is fractal; Daza et al. 2016, Sci. Rep. 6,
        31416), NaN where there is none; boxes, and boxes_left_out, which hold a cell whose end is
        not known.

    Raises
    ------
    TypeError, ValueError
        for every refused argument.
    MemoryError
        before any work, where the result cannot fit.
    OSError
        where a shard cannot be written.
    """
    job = job_of(osc, plane, size=size, phi=phi, phi_dot=phi_dot, phase=phase, speed=speed,
                 most_cycles=most_cycles, returns=returns, recurrences=recurrences,
                 resolution=resolution, numerics=numerics, shard_runs=shard_runs, threads=threads)
    found, interrupted = carry_out("basins", job, folder=folder, executor=executor,
                                   threads=threads, progress=progress, notes=notes,
                                   keep_interrupted=keep_interrupted)
    return dataset_of(job, found, interrupted)


def job_of(osc: Oscillator, plane: str, *, size: Any, phi: Any, phi_dot: Any, phase: Any,
           speed: Any, most_cycles: Any, returns: Any, recurrences: Any, resolution: Any,
           numerics: Any, shard_runs: Any, threads: Any) -> Cells:
    """The checked arguments of `basins`, or every problem at once."""
    taken = Refusals()
    taken.take(arguments.instance, "osc", osc, Oscillator)
    taken.take(arguments.choice, "plane", plane, tuple(PLANES))
    taken.take(arguments.phase, "phase", phase)
    numbers = _sizes(size, taken)
    spans = checked_spans(taken, phi=phi, phi_dot=phi_dot, speed=speed)
    if shard_runs is not None:
        taken.take(arguments.whole, "shard_runs", shard_runs, 1)
    search = search_of(osc, most_cycles=most_cycles, returns=returns, recurrences=recurrences,
                       resolution=resolution, numerics=numerics, threads=threads, taken=taken)
    taken.raise_if_any("basins")
    wrong = ("speed",) if plane == "state" else ("phi", "phi_dot")
    taken.problems += [f"{name} goes with another plane than {plane!r}" for name in wrong
                       if name in spans]
    if plane == "coast" and osc.gap == "one_flank":
        taken.problems.append("plane = 'coast', expected another one: gap = 'one_flank'")
    if spans.get("speed", (0.0, 1.0))[0] < 0:
        taken.problems.append(arguments.wrong("speed", speed, "speeds towards the flank, from 0"))
    taken.raise_if_any("basins")
    own = ranges(osc, phase)
    own |= {"speed": (0.0, own["phi_dot"][1])} | spans
    both = (own["phi"], own["phi_dot"]) if plane == "state" else ((0.0, 1.0), own["speed"])
    axes = {name: low + (high - low) * (np.arange(count) + 0.5) / count
            for name, (low, high), count in zip(PLANES[plane], both, numbers, strict=True)}
    grid = Plane(osc, plane, axes, float(phase) if plane == "state" else float("nan"))
    ends = grid.starts(np.array([0, grid.length - 1, grid.runs - 1]))
    taken.problems += start_problems(osc, ends)
    taken.raise_if_any("basins")
    return Cells(grid, search, shard_size(grid.runs, CYCLES, 1, shard_runs))


def _sizes(size: Any, taken: Refusals) -> tuple[int, int]:
    """Cells along either axis."""
    values = tuple(size) if isinstance(size, tuple | list) else (size, size)
    if len(values) != 2:
        taken.problems.append(arguments.wrong("size", size, "cells along both axes, or (x, y)"))
        return 1, 1
    first, second = (taken.take(arguments.whole, "size", one, 2, MOST_ALONG) for one in values)
    return first, second


def dataset_of(job: Cells, found: Found, interrupted: bool) -> xr.Dataset:
    """What `lapwing.basins` returns; of a search that was interrupted, what is known."""
    import xarray as xr

    grid, search = job.grid, job.search
    ends = np.empty(grid.runs, END_TABLE)
    for name in KEPT:
        ends[name] = found.data[name]
    if not interrupted:
        job.prepare()
        search.resolve(ends)
    order = ranked(search.motions)
    labels = renumbered(ends, order)
    reached = ends["status"] != Status.UNFINISHED
    cells: dict[str, NDArray[Any]] = {
        "attractor_of_run": labels, "ending": ends["ending"].astype(np.int8),
        "followed_cycles": ends["cycles"].astype(np.int32),
        "status": ends["status"].astype(np.int8)}
    return worded(xr.Dataset(
        attractor_variables(search, order)
        | shares(labels, labels > 0, len(order), Sample(grid.runs, -1))
        | {name: (grid.order, values.reshape(grid.shape)) for name, values in cells.items()},
        {"attractor": np.arange(1, len(order) + 1, dtype=np.int32), **grid.axes}, {
            **job.about, "x_parameter": next(iter(grid.axes)), "y_parameter": grid.order[0],
            **counts(ends[reached]), **entropy(labels.reshape(grid.shape)),
            "not_reached": int(np.count_nonzero(~reached)), "interrupted": int(interrupted),
            "shards": job.cut.shards, "cpus": "; ".join(sorted(found.cpus))})).transpose(
                *grid.axes, ...)


def entropy(labels: NDArray[np.integer[Any]]) -> dict[str, Any]:
    """Basin entropy and boundary entropy of labels (y, x), 0: not known; attributes.

    Boxes do not overlap; rows and columns that fill none are left out.
    """
    rows, columns = (length // BOX for length in labels.shape)
    boxes = labels[:rows * BOX, :columns * BOX].reshape(rows, BOX, columns, BOX).swapaxes(
        1, 2).reshape(-1, BOX * BOX)
    known = boxes[np.all(boxes > 0, axis=1)]
    parts = np.stack([np.count_nonzero(known == number, axis=1)
                      for number in range(1, int(labels.max(initial=0)) + 1)] or
                     [np.zeros(len(known))]) / (BOX * BOX)
    each = -np.sum(parts * np.log(np.where(parts > 0, parts, 1.0)), axis=0)
    mixed = each[each > 0]
    return {"entropy_box": BOX, "boxes": len(known), "boxes_left_out": len(boxes) - len(known),
            "boundary_boxes": len(mixed),
            "basin_entropy": float(each.mean()) if len(known) else float("nan"),
            "boundary_entropy": float(mixed.mean()) if len(mixed) else float("nan")}


__all__ = ["basins", "dataset_of", "entropy", "job_of"]
