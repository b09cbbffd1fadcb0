"""What the measured numbers say: typical errors and costs, ratios, cost at equal error."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

# A rival is compared at its cheapest setting with at most this error.
WANTED_ERROR = 1e-9
# The long horizon speaks for a scene where at least so many torques are calm, or all are.
LEAST_CALM = 4
LEVELS = (1e-4, 1e-6, 1e-8, 1e-10)
OURS = ("exact", "rk4")


@dataclass(frozen=True)
class Line:
    """One method at one tolerance, over the torques of a scene.

    Errors are those of `measure`: (median, largest) by horizon, with how many torques they are
    taken over; `cost` is the median of µs per mesh cycle over the torques that count.
    """

    method: str
    tolerance: float
    errors: tuple
    counts: tuple
    missed: int
    doubled: int
    events_per_cycle: float
    cost: float
    study_computed: float
    study_copied: float
    scaling: float
    identical_bytes: int


def deciding_horizon(dataset):
    """Index of the horizon whose errors choose settings: the long one where enough is calm."""
    calm = int(dataset["calm"].sum())
    return 1 if calm >= min(LEAST_CALM, dataset.sizes["torque"]) else 0


def counting(dataset):
    """Which torques the costs are taken over: the calm ones where the long horizon decides."""
    if deciding_horizon(dataset):
        return dataset["calm"].values == 1
    return np.ones(dataset.sizes["torque"], dtype=bool)


def few_calm(dataset):
    """The dataset of a scene's calm torques where they are too few to decide for it; else None."""
    calm = dataset["calm"].values == 1
    return None if deciding_horizon(dataset) or not calm.any() else dataset.isel(torque=calm)


def lines(dataset):
    """Every setting of a scene's dataset as a `Line`."""
    found, counts = [], counting(dataset)
    for k in range(dataset.sizes["setting"]):
        row = dataset.isel(setting=k)
        columns = [error[~np.isnan(error)] for error in row["error"].values.T]
        cost = row["microseconds"].values[counts]
        found.append(Line(
            str(row["method"].values), float(row["tolerance"]),
            tuple((float(np.median(e)), float(e.max())) if e.size else (np.nan, np.nan)
                  for e in columns), tuple(e.size for e in columns),
            int(np.nansum(row["missed"])), int(np.nansum(row["doubled"])),
            float(_mean(row["events_per_cycle"].values)), _median(cost),
            float(row["study_computed"]), float(row["study_copied"]), float(row["scaling"]),
            int(row["identical_bytes"])))
    return found


def chosen(dataset, method, wanted=WANTED_ERROR):
    """Index of a method's cheapest setting with a median error of at most `wanted`.

    One that misses or doubles an event at any torque is not accurate. Where no setting will do,
    the most accurate one; None where the method was not run.
    """
    horizon = deciding_horizon(dataset)
    own = [(k, line) for k, line in enumerate(lines(dataset))
           if line.method == method and not np.isnan(line.cost)
           and not np.isnan(line.errors[horizon][0])]
    if not own:
        return None
    good = [(line.cost, k) for k, line in own
            if line.errors[horizon][0] <= wanted and line.missed + line.doubled == 0]
    if good:
        return min(good)[1]
    return min((line.errors[horizon][0], k) for k, line in own)[1]


def ratio(dataset, slow, fast):
    """Median, over the torques that count and that both ran, of two settings' costs."""
    cost = dataset["microseconds"].values[:, counting(dataset)]
    return _median(cost[slow] / cost[fast])


def cost_at(dataset, method, level):
    """µs per mesh cycle a method needs for a median error, between its settings on log scales.

    NaN where its settings do not reach so far; where its loosest is good enough, that one's.
    """
    horizon = deciding_horizon(dataset)
    points = sorted((line.errors[horizon][0], line.cost) for line in lines(dataset)
                    if line.method == method and np.isfinite(line.errors[horizon][0])
                    and not np.isnan(line.cost))
    if not points or level < points[0][0]:
        return np.nan
    # The cheapest that is at least so accurate is a fair offer too.
    offers = [cost for error, cost in points if error <= level]
    for (e0, c0), (e1, c1) in pairwise(points):
        if 0 < e0 <= level < e1:
            part = np.log(level / e0) / np.log(e1 / e0)
            offers.append(float(np.exp((1 - part) * np.log(c0) + part * np.log(c1))))
    return min(offers)


def _median(values):
    values = np.asarray(values, dtype=float)
    values = values[~np.isnan(values)]
    return float(np.median(values)) if values.size else np.nan


def _mean(values):
    values = values[~np.isnan(values)]
    return values.mean() if values.size else np.nan
