"""A map as a deck asks for it."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Executor
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from lapwing.engine import Numerics
from lapwing.model.linear_response import critical_torque
from lapwing.results.findings import endings
from lapwing.studies import cost
from lapwing.studies.again import Again, moved_again
from lapwing.studies.labels import own_operation
from lapwing.studies.map.run import job_of, left_map, parameter_map
from lapwing.studies.map.shards import Job
from lapwing.studies.sweep.curves import Curves
from lapwing.studies.sweep.varied import oscillator_at

if TYPE_CHECKING:
    import xarray as xr

    from lapwing.deck.deck import Asked, Deck

# Runs of a column that are tried for an estimate.
TRIED = 8


def keeps_shards(_: Asked) -> bool:
    """Whether it keeps what is finished in a folder, while it is under way."""
    return True


def extent(study: Asked) -> tuple[int, str]:
    """How much of it there is to tell progress by, and in what unit."""
    return int(np.prod([len(values) for values in study.axes.values()])), "runs"


def failed(dataset: xr.Dataset) -> str:
    """What failed numerically, in words; empty text, nothing."""
    _, _, runs = endings(dataset)
    return f"map {{}} ({runs} runs)" * bool(runs)


def carry_out(deck: Deck, study: Asked, order: int, threads: int,
              done: Callable[[float], None] | None, folder: Path | None = None,
              notes: Callable[[str], None] | None = None,
              executor: Executor | None = None) -> xr.Dataset:
    """One map of a deck; a signal keeps the shards that are finished. See `registry`."""
    if folder is None:
        result = parameter_map(**_arguments(deck, study), threads=threads, progress=done,
                               notes=notes, keep_interrupted=True)
    else:
        result = left_map(job(deck, study), folder, threads=threads, progress=done, notes=notes,
                          executor=executor, keep_interrupted=True)
    return result.assign(_full_engagement(deck, study)).assign_attrs(
        own_operation(deck, study)
        | {"x_parameter": study.x_parameter, "y_parameter": study.y_parameter})


def job(deck: Deck, study: Asked) -> Job:
    """How a map is cut, and what its shards say of themselves."""
    return job_of(**_arguments(deck, study))


def again(deck: Deck, study: Asked, index: int) -> Again:
    """One run of a map once more, `index` counting as `status` of its results does."""
    made = job(deck, study)
    grid = made.grid
    where = dict(zip(grid.axes, np.unravel_index(index, [*map(len, grid.axes.values())]),
                     strict=True))
    run = int(np.ravel_multi_index([where[name] for name in grid.order], grid.shape))
    line, at = divmod(run, grid.length)
    first = line * grid.length
    if made.start == "rest":
        points, before = grid.points(run, run + 1), range(0)
    else:
        points = grid.points(first, first + grid.length)
        before = range(at) if made.start == "up" else range(grid.length - 1, at, -1)
    return Again(
        moved_again(points, grid.oscillator(run), before, made.numerics, settle=made.settle,
                    record=made.record, phase=made.phase, bounces=False),
        {name: values[where[name]].item() for name, values in grid.axes.items()})


def _arguments(deck: Deck, study: Asked) -> dict[str, Any]:
    """What a deck says of a map, as `parameter_map` takes it."""
    return {"pair": deck.gear_pair, "te": deck.te, "axes": deck.axes_of(study, study.axes),
            "line": study.y_parameter, "start": study.start, "settle": study.settle_cycles,
            "record": study.record_cycles, "phase": deck.numerics["start_phase"],
            "numerics": Numerics(**deck.numerics_of(study)),
            "shard_runs": study.shard_runs, "observe": tuple(study.observe or ()),
            **study.operation}


def _full_engagement(deck: Deck, study: Asked) -> dict[str, Any]:
    """T_full (N·m) at each value of the axis that is not the braking torque, where it is known."""
    if "brake_torque" not in study.axes or "drive_torque" in study.axes \
            or study.operation.get("drive_torque") is not None \
            or study.operation["contact_law"] == "rigid":
        return {}
    other = next(name for name in study.axes if name != "brake_torque")
    found = np.full(len(study.axes[other]), np.nan)
    curves = Curves(deck.te, deck.curves_of(study))
    for i, value in enumerate(study.axes[other]):
        osc = oscillator_at(deck.gear_pair, curves, other, value,
                            {**study.operation, "brake_torque": 1.0})
        try:
            found[i] = critical_torque(osc)[0]
        except ValueError:
            continue  # no engaged motion there: at an undamped resonance
    return {"full_engagement": (other, found)}


def estimate(deck: Deck, study: Asked, seconds: float, clock: Callable[[], float],
             threads: int) -> tuple[float, float, float]:
    """How long it takes, from some runs from rest on some of its columns; see `cost.rates`.

    What is carried along a column costs about what the same runs cost from rest.
    """
    columns, values = study.axes[study.x_parameter], study.axes[study.y_parameter]
    some = values[np.unique(np.linspace(0, len(values) - 1, TRIED).round().astype(int))]

    def tried(part: NDArray[Any]) -> None:
        job_of(**_arguments(deck, study) | {
            "axes": deck.axes_of(study, {study.x_parameter: part, study.y_parameter: some}),
            "start": "rest",
            "shard_runs": part.size * some.size}).carried_out(0)

    low, high, count = cost.rates(tried, columns, seconds, clock)
    whole = len(values) / len(some) * len(columns) / threads
    return low * whole, high * whole, count * len(some) / (len(columns) * len(values))
