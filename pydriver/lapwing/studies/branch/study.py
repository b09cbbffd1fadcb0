"""Branches as a deck asks for them."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from lapwing.base.codes import FoundMotion, Status
from lapwing.deck import used_hash
from lapwing.engine import Numerics
from lapwing.studies.branch.diagram import table
from lapwing.studies.branch.family import Kept, Request, followed
from lapwing.studies.branch.seeds import Search
from lapwing.studies.critical.starts import StartGrid
from lapwing.studies.labels import own_operation
from lapwing.studies.records import Records

if TYPE_CHECKING:
    import xarray as xr

    from lapwing.deck.deck import Asked, Deck

# It begins with the motions of the deck's sweeps and searches, too (`of_deck.compute`).
TAKES_FOUND = True
# Part of the progress that curves in a second parameter are taken to be.
OF_CURVES = 0.5
# What it keeps one by one.
RECORDS = "branches"


def extent(_: Asked) -> tuple[int, str]:
    """How much of it there is to tell progress by, and in what unit."""
    return 100, "%"


def failed(dataset: xr.Dataset) -> str:
    """What failed numerically, in words; empty text, nothing."""
    motions = int((dataset["motion_kind"] == FoundMotion.FAILED).sum())
    return f"branches {{}} ({motions} motions)" * bool(motions)


def ended(stored: Mapping[str, Any]) -> list[Status]:
    """How it ended, by its table: a run that failed is told of the whole; see `registry`."""
    lost = np.any(np.array(stored["motion_kind"][...]) == FoundMotion.FAILED)
    return [Status.NOT_FINITE if lost else Status.OK]


def keeps_shards(_: Asked) -> bool:
    """It keeps each branch that is finished in a folder, while it is under way."""
    return True


def carry_out(deck: Deck, study: Asked, order: int, threads: int,
              done: Callable[[float], None] | None, folder: Path | None = None,
              notes: Callable[[str], None] | None = None, executor: object = None,
              found: Mapping[str, Mapping[str, xr.Dataset]] | None = None) -> xr.Dataset:
    """The branches of a deck's motions along one parameter; see `registry`."""
    found = found or {}
    request = Request(Search(
        deck.gear_pair, deck.te, study.parameter, study.values, study.operation,
        random=study.random_starts, seed=study.random_seed, settle=study.settle_cycles,
        highest=study.highest_period, numerics=Numerics(**deck.numerics_of(study)),
        threads=threads, rattling_cycles=study.rattling_cycles,
        sweeps=[one for one in found.get("sweep", {}).values()
                if one["status"].dims[1] == study.parameter],
        trials=_trials(deck, study, found.get("critical", {}))),
        study.doublings, study.most_points, study.unstable_points, study.beyond_ends)
    curved = study.second is not None
    records = None if folder is None else Records(folder, "branch or curve" if curved else "branch",
                                                  notes, used_hash(deck))
    part = 1 - OF_CURVES * curved

    def of_branches(fraction: float) -> None:
        if done is not None:
            done(part * fraction)

    branches = followed(request, of_branches, Kept(records))
    diagram = table(request, branches)
    if study.second is not None:
        from lapwing.studies.curve import table as curves

        second = curves.Second(**study.second)
        diagram = curves.added(diagram, curves.followed(
            request.search, branches.branches, second, records,
            done and (lambda fraction: done(part + OF_CURVES * fraction))), second)
    return diagram.assign_attrs(own_operation(deck, study))


def _trials(deck: Deck, study: Asked,
            criticals: Mapping[str, xr.Dataset]) -> list[tuple[float, StartGrid]]:
    """Values at which a search along the parameter met rattling, and its starts."""
    return [(float(value), StartGrid(*asked.starts)) for asked in deck.criticals
            if asked.parameter == study.parameter and asked.find == "safe"
            and not asked.own_operation and asked.name in criticals
            for one in (criticals[asked.name],)
            for value in np.unique(one["trial_value"].values[one["trial_rattling"].values > 0])]


def estimate(deck: Deck, study: Asked, seconds: float, clock: Any,
             threads: int) -> tuple[float, float, float, str]:
    """How long it takes is known by the run alone; as `cost.Stage` has it after its name."""
    return math.nan, math.nan, 0.0, "how many branches there are, the run tells"
