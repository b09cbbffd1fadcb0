"""A response as a deck asks for it."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Executor
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, Any

from lapwing.base.codes import Status
from lapwing.engine import Numerics
from lapwing.studies import cost
from lapwing.studies.again import Again
from lapwing.studies.critical.study import full_engagement
from lapwing.studies.labels import own_operation
from lapwing.studies.map.work import gather
from lapwing.studies.response.measured import passes_on_repeats, with_repeats
from lapwing.studies.response.recording import Pass, Recording
from lapwing.studies.response.run import Prepared, dataset_of, prepared
from lapwing.studies.response.shards import Gathered, ResponseJob, is_long
from lapwing.studies.trajectory import checked_start, engine_start, run_from

if TYPE_CHECKING:
    import xarray as xr

    from lapwing.deck.deck import Asked, Deck


def extent(_: Any) -> Any:
    """How much of it there is to tell progress by, and in what unit."""
    return 1, "responses"


def failed(dataset: xr.Dataset) -> str:
    """What failed numerically, in words; empty text, nothing."""
    return "response {}" * (int(dataset.attrs["status"]) != Status.OK)


def keeps_shards(study: Asked) -> bool:
    """Whether it is so long that it keeps what is finished in a folder, while it is under way."""
    return is_long(study.settle_cycles, study.record_cycles, study.samples_per_cycle)


def carry_out(deck: Deck, study: Asked, order: int, threads: int,
              done: Callable[[float], None] | None, folder: Path | None = None,
              notes: Callable[[str], None] | None = None,
              executor: Executor | None = None) -> xr.Dataset:
    """One response of a deck; see `registry`."""
    made, repeats = _prepared(deck, study, order), passes_on_repeats(deck, study)
    recordings: Iterator[Recording]
    if folder is None:
        recordings = (one.whole() for one in _there(made, repeats))
    else:
        cut = ResponseJob(_there(made, repeats))
        found = Gathered(cut, notes or (lambda _: None))
        gather("response", cut, found, folder=folder, executor=executor, threads=threads,
               progress=done, notes=notes, keep_interrupted=False)
        recordings = found.recordings()
    result = dataset_of(made, islice(recordings, len(made.passes))).assign_attrs(
        own_operation(deck, study) | full_engagement(deck, study))
    return with_repeats(result, deck, repeats, recordings)


def job(deck: Deck, study: Asked) -> ResponseJob:
    """How a response is cut, and what its shards say of themselves."""
    return ResponseJob(_there(_prepared(deck, study, 0), passes_on_repeats(deck, study)))


def _there(made: Prepared, repeats: Sequence[Pass | None]) -> tuple[Pass, ...]:
    """The passes of a response and of those of its repeats that have one."""
    return (*made.passes, *(one for one in repeats if one is not None))


def _prepared(deck: Deck, study: Asked, order: int) -> Prepared:
    """What a deck says of a response."""
    return prepared(
        deck.oscillator(study), deck.gear_pair, name=study.name, start=study.start,
        phase=deck.numerics["start_phase"], settle=study.settle_cycles,
        record=study.record_cycles, samples_per_cycle=study.samples_per_cycle,
        exponents=study.exponents,
        max_period=deck.numerics["max_period"], order=order,
        claim_impacts_per_cycle=study.claim_impacts_per_cycle,
        claim_deepest_separation=study.claim_deepest_separation, claim_text=study.claim_text,
        **deck.numerics_of(study))


def again(deck: Deck, study: Asked, index: int) -> Again:
    """A response once more, its cycles from the start; there is no other `index` but 0."""
    osc, phase = deck.oscillator(study), deck.numerics["start_phase"]
    start = engine_start(osc, checked_start(osc, study.start, phase))
    # One cycle more, for the state at the end.
    end = study.settle_cycles + (phase > 0) + study.record_cycles + 1
    return Again(run_from(osc, start, phase, (end, 0.0), Numerics(**deck.numerics_of(study))), {})


def estimate(deck: Deck, study: Asked, seconds: float, clock: Any,
             threads: int) -> tuple[float, float, float]:
    """How long it takes, from a part of its cycles; see `cost.growth`."""
    return cost.growth(
        lambda settle, record: carry_out(
            deck, cost.changed(study, settle_cycles=settle, record_cycles=record), 0, 1, None),
        study.settle_cycles, study.record_cycles, seconds, clock)
