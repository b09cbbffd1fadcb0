"""The result of an ensemble: its runs, and what they tell of all pairs."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from lapwing.base.codes import Status
from lapwing.base.quantities import DESCRIPTIONS, worded
from lapwing.results.findings import map_rattles
from lapwing.studies.ensemble.statistics import (
    effects,
    probability,
    quantile,
    rank_correlation,
)
from lapwing.studies.map.work import numbers_of

if TYPE_CHECKING:
    import xarray as xr

    from lapwing.studies.ensemble.run import Plan
    from lapwing.studies.map.work import Found

LEVELS = (0.01, 0.05, 0.5, 0.95, 0.99)
# Numbers of a run whose distribution is told. Of what is seen in a run or not, a 1 or a 0.
ANSWERS = ("full_engagement", "deepest_separation", "impacts_per_cycle", "back_impacts_per_cycle",
           "fastest_arrival")
SEEN = "rattles"


def dataset_of(plan: Plan, found: Found, interrupted: bool) -> xr.Dataset:
    """What `lapwing.ensemble` returns."""
    import xarray as xr

    job, cloud, runs = plan.job, plan.cloud, plan.sample.runs
    numbers = numbers_of(job, found)
    own = {name: values[:runs] for name, values in numbers.items()}
    if plan.sample.scrambles > 0:
        own["scramble"] = np.repeat(np.arange(plan.sample.scrambles, dtype=np.int16),
                                    runs // plan.sample.scrambles)
    lost = numbers["status"][runs:] != Status.OK
    result = xr.Dataset(
        {name: ("run", values) for name, values in own.items()},
        {name: ("run", values[:runs]) for name, values in cloud.axes.items()}, {
            **{name: value for name, value in job.about.items() if name != "line"},
            "shards": job.cut.shards,
            "interrupted": int(interrupted), "cpus": "; ".join(sorted(found.cpus)),
            "scrambles": plan.sample.scrambles, "sensitivity_runs": plan.design.runs,
            "sensitivity_runs_lost": int(lost.sum()), **plan.told,
            **{f"draw_{name}": _spelled(draw.told()) for name, draw in plan.draws.items()}})
    rattles = map_rattles(xr.Dataset({name: ("run", numbers[name]) for name in (
        "status", "states_visited", "arrivals", "back_arrivals")})).values
    told = {**_quantiles(plan, own), **_probabilities(plan, own, rattles[:runs])}
    answers = {name: numbers[name] for name in ANSWERS if name in numbers} | {
        SEEN: np.where(numbers["status"] == Status.OK, rattles, np.nan)}
    told |= _influences(plan, answers)
    # As many of everything as there are parameters, answers: dimensions that name them.
    events = told.pop("event")
    return worded(result.assign(told).assign_coords(
        level=list(LEVELS), event=events, parameter=list(cloud.axes), answer=list(answers)))


def _quantiles(plan: Plan, numbers: dict[str, NDArray[Any]]) -> dict[str, Any]:
    """Quantiles of every answer."""
    told = {}
    for name in ANSWERS:
        if name in numbers:
            every = [quantile(numbers[name], level, plan.sample) for level in LEVELS]
            units, words = DESCRIPTIONS[name]
            for i, (end, of) in enumerate(_ENDS):
                told[f"{name}_quantile{end}"] = ("level", [one[i] for one in every], {
                    "units": units, "long_name": f"{of}quantile of: {words}"})
    return told


_ENDS = (("", ""), ("_low", "lower 95 % limit of the "), ("_high", "upper 95 % limit of the "))


def _probabilities(plan: Plan, numbers: dict[str, NDArray[Any]],
                   rattles: NDArray[np.bool_]) -> dict[str, Any]:
    """How likely it is that contact can be kept, that the pair rattles, that it hits the coast."""
    cloud, known = plan.cloud, numbers["status"] == Status.OK
    events = {"rattles": (rattles, known), "back_arrivals": (numbers["back_arrivals"] > 0, known)}
    if "full_engagement" in numbers:
        torque = cloud.axes["brake_torque"][:plan.sample.runs] \
            if "brake_torque" in cloud.axes else cloud.operation["brake_torque"]
        full = numbers["full_engagement"]
        with np.errstate(invalid="ignore"):
            events = {"contact_can_be_kept": (torque >= full, np.isfinite(full)), **events}
    every = [probability(*event, plan.sample) for event in events.values()]
    told: dict[str, Any] = {f"probability{end}": ("event", [one[i] for one in every])
                            for i, (end, _) in enumerate(_ENDS)}
    return {**told, "event": list(events),
            "seen": ("event", [int((seen & there).sum()) for seen, there in events.values()]),
            "known": ("event", [int(there.sum()) for _, there in events.values()])}


def _influences(plan: Plan, answers: dict[str, NDArray[Any]]) -> dict[str, Any]:
    """Which parameter moves which answer, and how much."""
    cloud, runs = plan.cloud, plan.sample.runs
    ranks = [[rank_correlation(cloud.axes[name][:runs], values[:runs], plan.sample)
              for name in cloud.axes] for values in answers.values()]
    told: dict[str, Any] = {f"rank_correlation{end}": (
        ("answer", "parameter"), [[one[i] for one in row] for row in ranks])
        for i, (end, _) in enumerate(_ENDS)}
    if plan.design.runs:
        every = [effects(values[runs:], len(cloud.axes), plan.design.scrambles)
                 for values in answers.values()]
        for what in ("main", "total"):
            for i, (end, _) in enumerate(_ENDS):
                told[f"{what}_effect{end}"] = (("answer", "parameter"), [
                    getattr(one, what)[:, i] for one in every])
    return told


def _spelled(told: dict[str, Any]) -> str:
    """`normal, mean 0.002, deviation 0.0001`."""
    return ", ".join([told["law"], *(f"{name} {value:g}" for name, value in told.items()
                                     if name != "law")])


__all__ = ["ANSWERS", "LEVELS", "SEEN", "dataset_of"]
