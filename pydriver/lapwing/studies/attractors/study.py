"""Attractors along a parameter as a deck asks for them."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from lapwing.base.codes import Status
from lapwing.engine import Numerics
from lapwing.studies import cost
from lapwing.studies.attractors.along import attractors_along
from lapwing.studies.labels import own_operation

if TYPE_CHECKING:
    import xarray as xr

    from lapwing.deck.deck import Asked, Deck


def extent(study: Asked) -> tuple[int, str]:
    """How much of it there is to tell progress by, and in what unit."""
    return len(study.values), "values"


def failed(dataset: xr.Dataset) -> str:
    """What failed numerically, in words; empty text, nothing."""
    runs = int(dataset["failed"].values[dataset["reached"].values == 1].sum())
    return f"attractors {{}} ({runs} runs)" * bool(runs)


def ended(stored: Mapping[str, Any]) -> list[Status]:
    """How each value ended: one with a run that failed is told as failed; see `registry`."""
    return [Status.UNFINISHED if not there else Status.NOT_FINITE if lost else Status.OK
            for there, lost in zip(np.array(stored["reached"][...]),
                                   np.array(stored["failed"][...]), strict=True)]


def carry_out(deck: Deck, study: Asked, order: int, threads: int,
              done: Callable[..., Any] | None) -> xr.Dataset:
    """The attractors along a parameter; Ctrl-C keeps what is finished. See `registry`."""
    result = attractors_along(
        deck.gear_pair, deck.te, parameter=study.parameter, values=study.values, runs=study.runs,
        seed=study.seed, phi=study.phi, phi_dot=study.phi_dot, phase=deck.numerics["start_phase"],
        most_cycles=study.most_cycles, returns=study.returns, recurrences=study.recurrences,
        resolution=study.resolution, numerics=Numerics(**deck.numerics_of(study)), threads=threads,
        progress=done, keep_interrupted=True, **study.operation)
    return result.assign_attrs(own_operation(deck, study))


def estimate(deck: Deck, study: Asked, seconds: float, clock: Any,
             threads: int) -> tuple[float, float, float]:
    """How long it takes, from some of its values; see `cost.rates`."""
    low, high, count = cost.rates(
        lambda values: carry_out(deck, cost.changed(study, values=values), 0, 1, None),
        study.values, seconds, clock)
    many = len(study.values)
    return low * many, high * many, count / many
