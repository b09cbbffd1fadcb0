"""A sweep as a deck asks for it."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Executor
from pathlib import Path
from typing import TYPE_CHECKING, Any

from lapwing.engine import Numerics
from lapwing.results.findings import endings
from lapwing.studies import cost
from lapwing.studies.again import Again, moved_again
from lapwing.studies.critical.study import full_engagement
from lapwing.studies.labels import own_operation
from lapwing.studies.map.work import gather
from lapwing.studies.sweep import amplitudes, waterfall
from lapwing.studies.sweep.curves import Curves
from lapwing.studies.sweep.run import dataset_of, job_of, sweep
from lapwing.studies.sweep.shards import Gathered, SweepJob, is_large
from lapwing.studies.sweep.varied import Varied

if TYPE_CHECKING:
    import xarray as xr

    from lapwing.deck.deck import Asked, Deck


def extent(study: Asked) -> tuple[int, str]:
    """How much of it there is to tell progress by, and in what unit."""
    return len(study.values) * len(study.starts), "points"


def failed(dataset: xr.Dataset) -> str:
    """What failed numerically, in words; empty text, nothing."""
    _, _, points = endings(dataset)
    return f"sweep {{}} ({points} points)" * bool(points)


def keeps_shards(study: Asked) -> bool:
    """Whether it is so large that it keeps what is finished in a folder, while it is under way."""
    return is_large(extent(study)[0], study.settle_cycles + study.record_cycles
                    + amplitudes.CYCLES * study.amplitudes + waterfall.CYCLES * study.order_spectra)


def carry_out(deck: Deck, study: Asked, order: int, threads: int,
              done: Callable[..., Any] | None, folder: Path | None = None,
              notes: Callable[[str], None] | None = None,
              executor: Executor | None = None) -> xr.Dataset:
    """One sweep of a deck; a signal keeps what is finished. See `registry`."""
    if folder is None:
        result = sweep(**_arguments(deck, study), threads=threads, progress=done,
                       keep_interrupted=True)
    else:
        made = job(deck, study)
        found = Gathered(made, notes or (lambda _: None))
        interrupted = gather("sweep", made, found, folder=folder, executor=executor,
                             threads=threads, progress=done, notes=notes, keep_interrupted=True)
        result = dataset_of(made, found.result(interrupted), found.further)
    return result.assign_attrs(own_operation(deck, study) | full_engagement(deck, study))


def job(deck: Deck, study: Asked) -> SweepJob:
    """How a sweep is cut, and what its shards say of themselves."""
    return job_of(**_arguments(deck, study))


def _arguments(deck: Deck, study: Asked) -> dict[str, Any]:
    """What a deck says of a sweep, as `sweep` takes it."""
    observe = ("cycles", *["impacts"] * study.impacts, *["exponents"] * study.exponents,
               *["speeds"] * study.speed_density, *["spectra"] * study.order_spectra,
               *["amplitudes"] * study.amplitudes)
    return {"pair": deck.gear_pair, "te": deck.te, "parameter": study.parameter,
            "values": deck.axes_of(study, {study.parameter: study.values})[study.parameter],
            "starts": study.starts, "settle": study.settle_cycles,
            "record": study.record_cycles, "observe": observe,
            "phase": deck.numerics["start_phase"], **deck.numerics_of(study), **study.operation}


def again(deck: Deck, study: Asked, index: int) -> Again:
    """One point of a sweep once more, `index` counting as `status` of its results does."""
    start, at = divmod(index, len(study.values))
    begun = study.starts[start]
    oscillators = Varied(deck.gear_pair, Curves(deck.te, deck.curves_of(study)), study.parameter,
                         study.values, study.operation)
    before = {"rest": range(0), "up": range(at),
              "down": range(len(study.values) - 1, at, -1)}[begun]
    return Again(
        moved_again(oscillators.points, oscillators[at], before,
                    Numerics(**deck.numerics_of(study)), settle=study.settle_cycles,
                    record=study.record_cycles, phase=deck.numerics["start_phase"]),
        {"start": begun, study.parameter: study.values[at].item()})


def estimate(deck: Deck, study: Asked, seconds: float, clock: Any,
             threads: int) -> tuple[float, float, float]:
    """How long it takes, from some values from rest; see `cost.rates`.

    What is carried from value to value is one motion, as long as all of them.
    """
    start = "rest" if "rest" in study.starts else study.starts[0]
    low, high, points = cost.rates(
        lambda values: carry_out(
            deck, cost.changed(study, values=values, starts=(start,)), 0, 1, None),
        study.values, seconds, clock)
    motions = len(study.values) * len(study.starts)
    line = len(study.values) if {"up", "down"} & set(study.starts) else 1
    times = max(motions / threads, line)
    return low * times, high * times, points / motions
