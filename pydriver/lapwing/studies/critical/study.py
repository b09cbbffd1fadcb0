"""Critical values as a deck asks for them."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from concurrent.futures import Executor
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from lapwing.base.codes import Status
from lapwing.deck import used_hash
from lapwing.engine import Numerics
from lapwing.studies import cost
from lapwing.studies.critical import force, measured, run
from lapwing.studies.critical.records import Records
from lapwing.studies.critical.starts import StartGrid, follow, start_grid
from lapwing.studies.labels import own_operation
from lapwing.studies.sweep.varied import oscillator_at

if TYPE_CHECKING:
    import xarray as xr

    from lapwing.deck.deck import Asked, Deck

# Mesh cycles of a trial, its motions together, beyond which it is kept: some third of a second.
TRIAL_CYCLES = 100_000
# What it keeps one by one.
RECORDS = "trials"


def extent(_: Asked) -> tuple[int, str]:
    """How much of it there is to tell progress by, and in what unit."""
    return 100, "%"


def failed(dataset: xr.Dataset) -> str:
    """What failed numerically, in words; empty text, nothing."""
    runs = int(dataset["trial_failed"].sum()) if "trial_failed" in dataset else 0
    return f"critical {{}} ({runs} motions)" * bool(runs)


def ended(stored: Mapping[str, Any]) -> list[Status]:
    """How it ended, by its table: a motion that failed is told of the whole; see `registry`."""
    lost = "trial_failed" in stored and np.any(np.array(stored["trial_failed"][...]) > 0)
    return [Status.NOT_FINITE if lost else Status.OK]


def keeps_shards(study: Asked) -> bool:
    """Whether its trials take so long that each is kept in a folder while others are under way."""
    if study.find != "safe":
        return False
    motions = 1 + 2 * int(np.prod(study.starts))
    return bool(motions * (study.settle_cycles + study.record_cycles) > TRIAL_CYCLES)


def carry_out(deck: Deck, study: Asked, order: int, threads: int,
              done: Callable[..., Any], folder: Path | None = None,
              notes: Callable[[str], None] | None = None,
              executor: Executor | None = None) -> xr.Dataset:
    """One critical value of a deck, told as done at its end; see `registry`."""
    records = None if folder is None else Records(folder, notes, used_hash(deck))
    found = critical_study(deck, study, threads, done, records)
    done(1.0)
    return found


def critical_study(deck: Deck, study: Asked, threads: int,
                   done: Callable[..., Any] | None = None,
                   records: Records | None = None) -> xr.Dataset:
    """One critical value of a deck.

    Parameters
    ----------
    deck : lapwing.deck.Deck
    study : lapwing.deck.Asked
    threads : int
    done : callable(fraction) or None
    records : Records or None, where trials are kept

    Returns
    -------
    xarray.Dataset, from `lapwing.critical_full` and the like, with `labels.labels`, and of a
    measured transmission error what its noise leaves (`measured`)
    """
    options = {"parameter": study.parameter, "values": study.values, "safe_end": study.safe_end,
               **study.operation}
    if study.starts is not None:
        options |= {"starts": StartGrid(*study.starts), "settle": study.settle_cycles,
                    "record": study.record_cycles, "phase": deck.numerics["start_phase"],
                    "numerics": Numerics(**deck.numerics_of(study)), "threads": threads,
                    "progress": done and measured.first_of(deck, study, done)}
    if study.find == "safe":
        options |= {"resolution": study.resolution, "further": study.further_values,
                    "records": records}
    elif study.find == "back":
        options["confidence"] = study.confidence
    find: Callable[..., Any] = {"full": force.critical_full, "safe": run.critical_safe,
                                "back": run.critical_back, "on": force.critical_on}[study.find]
    found: xr.Dataset = find(deck.gear_pair, deck.te, **options).assign_attrs(
        own_operation(deck, study))
    if study.find in ("full", "on"):
        return measured.with_interval(found, deck, study)
    if study.find == "safe":
        return measured.with_repeats(found, deck, study, lambda te, progress: find(
            deck.gear_pair, te, **{**options, "progress": progress}), done)
    return found


def estimate(deck: Deck, study: Asked, seconds: float, clock: Any, threads: int) -> tuple[Any, ...]:
    """How long it takes, as `cost.Stage` has it after its name.

    A closed form is carried out, a search for back impacts tried at some values (`cost.rates`). How
    many values a search for rattling tries is known by the run alone: it tells the time of one.
    """
    begun = clock()
    if study.find == "safe":
        motions = rattling_at(deck, study, 1)
        each = (clock() - begun) / min(threads, motions)
        return math.nan, math.nan, 0.0, f"about {cost.spell(each)} for each value that it tries"
    if study.find == "back":
        low, high, tried = cost.rates(
            lambda values: critical_study(deck, cost.changed(study, values=values), 1),
            study.values, seconds, clock)
        return (*(rate * len(study.values) / threads for rate in (low, high)),
                tried / len(study.values))
    critical_study(deck, study, 1)
    taken = clock() - begun
    return taken, taken, 1.0


def rattling_at(deck: Deck, study: Asked, threads: int) -> int:
    """Follow the grid of starts of a search for rattling at its first value, and nothing more.

    Returns
    -------
    int, how many motions were followed
    """
    value = float(study.values[-1 if study.safe_end == "high" else 0])
    osc = oscillator_at(deck.gear_pair, deck.te, study.parameter, value, study.operation)
    starts = start_grid(osc, StartGrid(*study.starts), deck.numerics["start_phase"])
    follow([osc] * len(starts), starts, study.settle_cycles, study.record_cycles,
           numerics=Numerics(**deck.numerics_of(study)), threads=threads)
    return len(starts)


def full_engagement(deck: Deck, study: Asked) -> dict[str, float]:
    """T_full where a response, or a sweep of the braking torque, runs.

    The driving torque is in balance or as given.

    Returns
    -------
    dict of the attributes full_engagement (N·m) and full_engagement_phase (mesh periods), and of a
    measured transmission error full_engagement_low and _high, its 95 % interval; empty where there
    is none
    """
    if getattr(study, "parameter", "brake_torque") != "brake_torque" \
            or study.operation["contact_law"] == "rigid":
        return {}
    operation = {key: value for key, value in study.operation.items() if key != "brake_torque"}
    found = force.critical_full(deck.gear_pair, deck.te, **operation).attrs
    if found["outcome"] != "found":
        return {}
    known = {"full_engagement": found["estimate"], "full_engagement_phase": found["phase"]}
    if deck.curve is None:
        return known
    low, high = measured.interval(deck, "full", "brake_torque", operation)
    return known | {"full_engagement_low": low, "full_engagement_high": high}
