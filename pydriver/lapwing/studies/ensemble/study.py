"""An ensemble as a deck asks for it."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Executor
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from lapwing.deck.keys.ensemble import all_runs
from lapwing.engine import Numerics
from lapwing.results.findings import endings
from lapwing.studies import cost
from lapwing.studies.again import Again, moved_again
from lapwing.studies.ensemble.run import ensemble, plan_of
from lapwing.studies.labels import own_operation
from lapwing.studies.map.shards import Job

if TYPE_CHECKING:
    import xarray as xr

    from lapwing.deck.deck import Asked, Deck

# Draws among which those are that are tried for an estimate of more runs than these.
TRIED = 512


def keeps_shards(_: Asked) -> bool:
    """Whether it keeps what is finished in a folder, while it is under way."""
    return True


def extent(study: Asked) -> tuple[int, str]:
    """How much of it there is to tell progress by, and in what unit."""
    return all_runs(study), "runs"


def failed(dataset: xr.Dataset) -> str:
    """What failed numerically, in words; empty text, nothing."""
    _, _, runs = endings(dataset)
    runs += int(dataset.attrs["sensitivity_runs_lost"]) * (not int(dataset.attrs["interrupted"]))
    return f"ensemble {{}} ({runs} runs)" * bool(runs)


def carry_out(deck: Deck, study: Asked, order: int, threads: int,
              done: Callable[[float], None] | None, folder: Path | None = None,
              notes: Callable[[str], None] | None = None,
              executor: Executor | None = None) -> xr.Dataset:
    """One ensemble of a deck; a signal keeps the shards that are finished. See `registry`."""
    result = ensemble(**_arguments(deck, study), folder=folder, threads=threads, progress=done,
                      notes=notes, executor=executor, keep_interrupted=True)
    return result.assign_attrs(own_operation(deck, study))


def job(deck: Deck, study: Asked) -> Job:
    """What is cut into shards."""
    return plan_of(**_arguments(deck, study)).job


def again(deck: Deck, study: Asked, index: int) -> Again:
    """One run of an ensemble once more, `index` counting as `status` of its results does."""
    made = job(deck, study)
    return Again(
        moved_again(made.grid.points(index, index + 1), made.grid.oscillator(index), range(0),
                    made.numerics, settle=made.settle, record=made.record, phase=made.phase,
                    bounces=False),
        {name: float(values[index]) for name, values in made.grid.axes.items()})


def _arguments(deck: Deck, study: Asked) -> dict[str, Any]:
    """What a deck says of an ensemble, as `ensemble` takes it."""
    count = len(study.draws)
    matrix = None if study.correlation is None else \
        np.array(study.correlation, dtype=float).reshape(count, count)
    return {"pair": deck.gear_pair, "te": deck.te, "draws": study.draws or study.points,
            "sampling": study.sampling, "runs": study.runs, "scrambles": study.scrambles,
            "seed": study.seed, "correlation": matrix,
            "sensitivity_draws": study.sensitivity_draws, "settle": study.settle_cycles,
            "record": study.record_cycles, "phase": deck.numerics["start_phase"],
            "numerics": Numerics(**deck.numerics_of(study)), "shard_runs": study.shard_runs,
            **study.operation}


def estimate(deck: Deck, study: Asked, seconds: float, clock: Callable[[], float],
             threads: int) -> tuple[float, float, float]:
    """How long it takes, from some of its runs; see `cost.rates`."""
    arguments = _arguments(deck, study)
    if study.draws and all_runs(study) > TRIED:
        arguments |= {"sampling": "random", "runs": TRIED, "sensitivity_draws": None,
                      "correlation": None}
    cloud = plan_of(**arguments).cloud

    def tried(part: NDArray[Any]) -> None:
        values = {name: column[part] for name, column in cloud.axes.items()}
        plan_of(**(arguments | {"draws": values, "shard_runs": part.size})).job.carried_out(0)

    low, high, count = cost.rates(tried, np.arange(cloud.runs), seconds, clock)
    runs = all_runs(study)
    return low * runs / threads, high * runs / threads, count / runs


__all__ = ["again", "carry_out", "estimate", "extent", "failed", "job"]
