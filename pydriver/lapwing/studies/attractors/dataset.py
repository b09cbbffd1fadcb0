"""The motions that starts end in, as a dataset."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from lapwing.base.arrivals import arrivals_of
from lapwing.base.codes import Ending, Status
from lapwing.base.quantities import worded
from lapwing.studies.attractors.motions import RECORD, SAME
from lapwing.studies.ensemble.statistics import Sample, probability
from lapwing.studies.labels import settings
from lapwing.studies.period import MAX_PERIOD, class_name

if TYPE_CHECKING:
    import xarray as xr

    from lapwing.studies.attractors.motions import Motion
    from lapwing.studies.attractors.search import Search

# Of an aperiodic motion so many states are kept, its first ones.
MOST_POINTS = 2048
COUNTS = ("period", "arrivals", "back_arrivals", "chatter", "states_visited")
REALS = ("deepest_separation", "deepest_back_penetration", "fastest_arrival")
SHARES = ("share", "share_low", "share_high")


def ranked(motions: list[Motion]) -> list[int]:
    """Numbers of motions, from 1, the one that separates least first.

    So the order is that of the motions, whatever starts have found them.
    """
    def key(number: int) -> tuple[float, ...]:
        outcome = motions[number - 1].outcome
        return tuple(float(outcome[name]) for name in ("deepest_separation", "period"))

    return sorted(range(1, len(motions) + 1), key=key)


def renumbered(ends: NDArray[Any], order: list[int]) -> NDArray[np.int16]:
    """The attractor of each run by the numbers of `ranked` motions; 0: not known."""
    places = np.zeros(len(order) + 1, np.int16)
    places[order] = np.arange(1, len(order) + 1)
    labels: NDArray[np.int16] = places[ends["motion"].astype(int)]
    return labels


def attractor_variables(search: Search, order: list[int],
                        most_points: int = MOST_POINTS) -> dict[str, Any]:
    """What is told of each motion, over `attractor`, in an order of their numbers (`ranked`)."""
    motions = [search.motions[number - 1] for number in order]
    record = [one.period or RECORD for one in motions]
    told: dict[str, Any] = {name: ("attractor", np.array(
        [int(one.outcome[name]) for one in motions], np.int32)) for name in COUNTS}
    told |= {name: ("attractor", np.array([float(one.outcome[name]) for one in motions]))
             for name in REALS}
    for name, arrivals in (("impacts_per_cycle", "arrivals"),
                           ("back_impacts_per_cycle", "back_arrivals")):
        told[name] = ("attractor", np.array([
            one.outcome[arrivals] / cycles for one, cycles in zip(motions, record, strict=True)]))
    told["motion_class"] = ("attractor", np.array([
        class_name(*(int(one.outcome[name]) for name in COUNTS[:4])) for one in motions], object))
    multipliers = np.array([one.multipliers for one in motions]).reshape(-1, 2)
    told["multiplier_real"] = (("attractor", "multiplier"), multipliers.real)
    told["multiplier_imag"] = (("attractor", "multiplier"), multipliers.imag)
    told["lyapunov_exponent"] = ("attractor", np.array([one.exponent for one in motions]))
    told["lyapunov_exponent_error"] = ("attractor",
                                       np.array([one.exponent_error for one in motions]))
    told["residual"] = ("attractor", np.array([one.residual for one in motions]))
    points = [one.states[:one.period or most_points] for one in motions]
    table = np.full((len(motions), max(map(len, points), default=1), 3), np.nan)
    for row, states in zip(table, points, strict=True):
        row[:len(states)] = states
    for i, name in enumerate(("point_motion_state", "point_phi", "point_phi_dot")):
        told[name] = (("attractor", "point"), table[:, :, i])
    return told


def shares(labels: NDArray[np.integer[Any]], known: NDArray[np.bool_], count: int,
           sample: Sample) -> dict[str, Any]:
    """How many runs end in each attractor, and what part of all, over `attractor`."""
    each = [probability(labels == number, known, sample) for number in range(1, count + 1)]
    told: dict[str, Any] = {"runs_ended": ("attractor", np.array(
        [np.count_nonzero(labels == number) for number in range(1, count + 1)], np.int32))}
    table = np.array(each).reshape(-1, 3)
    return told | {name: ("attractor", table[:, i]) for i, name in enumerate(SHARES)}


def rules(search: Search) -> dict[str, Any]:
    """What a result says of when the end of a run is known: attributes."""
    return {"arrival": arrivals_of(search.osc.contact_law).word, "most_cycles": search.most_cycles,
            "returns": search.returns, "recurrences": search.recurrences,
            "resolution": search.resolution, "same_within": SAME, "max_period": MAX_PERIOD}


def about(search: Search) -> dict[str, Any]:
    """What a result says of one oscillator, and of how ends were recognised: attributes."""
    cells, box = search.known().cells, search.known().box
    aperiodic = any(not one.period for one in search.motions)
    size = np.array([box[1] - box[0], box[3] - box[2]]) / cells.shape
    return {**settings(search.osc, search.numerics), **rules(search),
            "cell_phi": float(size[0]) if aperiodic else float("nan"),
            "cell_phi_dot": float(size[1]) if aperiodic else float("nan"),
            "recorded_cycles": RECORD if aperiodic else 0}


def counts(ends: NDArray[Any]) -> dict[str, int]:
    """How many runs are unresolved, and how many failed: attributes."""
    fine = ends["status"] == Status.OK
    return {"unresolved": int(np.count_nonzero(fine & (ends["motion"] == 0))),
            "failed": int(np.count_nonzero(~fine)),
            "presumed": int(np.count_nonzero(ends["ending"] == Ending.PRESUMED))}


def dataset_of(search: Search, rows: NDArray[np.float64], ends: NDArray[Any], sample: Sample,
               told: dict[str, Any]) -> xr.Dataset:
    """What `lapwing.attractors` returns."""
    import xarray as xr

    order = ranked(search.motions)
    labels, count = renumbered(ends, order), len(order)
    runs = {"attractor_of_run": labels, "ending": ends["ending"].astype(np.int8),
            "followed_cycles": ends["cycles"].astype(np.int32),
            "status": ends["status"].astype(np.int8),
            "start_motion_state": rows[:, 0].astype(np.int8), "start_phi": rows[:, 1],
            "start_phi_dot": rows[:, 2], "start_phase": rows[:, 3]}
    if sample.scrambles > 0:
        runs["scramble"] = np.repeat(np.arange(sample.scrambles, dtype=np.int16),
                                     sample.runs // sample.scrambles)
    return worded(xr.Dataset(
        attractor_variables(search, order) | shares(labels, labels > 0, count, sample)
        | {name: ("run", values) for name, values in runs.items()},
        {"attractor": np.arange(1, count + 1, dtype=np.int32)},
        {**about(search), **told, **counts(ends)}))


__all__ = ["about", "attractor_variables", "counts", "dataset_of", "ranked",
           "renumbered", "rules", "shares"]
