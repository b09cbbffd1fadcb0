"""Run every method on every scene: errors against the reference, processor time."""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np

from lapwing_bench import ours
from lapwing_bench.judge import judge
from lapwing_bench.problem import problem
from lapwing_bench.reference import load, variant
from lapwing_bench.rivals import RIVALS
from lapwing_bench.scenes import LONG, SHORT
from lapwing_bench.whole_calls import measure_calls

RK4_TOLERANCES = (1e-2, 1e-3, 1e-4, 1e-5, 1e-6, 1e-7, 1e-8, 1e-9, 1e-10, 1e-11, 1e-12)
# Only says how far a run of `exact` is compared (judge.py); nothing of the method depends on it.
EXACT_TOLERANCE = 1e-11
# The setting of rk4 that runs a study.
STUDY_TOLERANCE = 1e-8
COLUMNS = ("event_error", "state_error", "error", "missed", "doubled", "compared")
STUDY_COLUMNS = ("study_computed", "study_copied", "scaling", "identical_bytes")
METHODS = ("exact", "rk4", *(rival.name for rival in RIVALS))


@dataclass(frozen=True)
class Plan:
    """How much is measured.

    Parameters
    ----------
    torques : int or None, torques of each scene, spread evenly; None: all
    slow_torques : int, of those, how many a slow rival runs over the long horizon
    slow_short_torques : int or None, how many it runs over the short one
    tolerances : int, every how-many-th tolerance of a method is run, the tightest included
    repeats : int, of each timing
    """

    torques: int | None
    slow_torques: int
    slow_short_torques: int | None
    tolerances: int
    repeats: int


FULL = Plan(torques=None, slow_torques=6, slow_short_torques=None, tolerances=1, repeats=5)
QUICK = Plan(torques=16, slow_torques=1, slow_short_torques=4, tolerances=2, repeats=3)


def spread(n, count):
    """`count` of n indices, evenly spread, both ends included; a single one is in the middle."""
    if count is None or count >= n:
        return np.arange(n)
    if count == 1:
        return np.array([n // 2])
    return np.unique(np.linspace(0, n - 1, count).round().astype(int))


def thinned(tolerances, every):
    """Every `every`-th tolerance, counted from the tightest."""
    return tuple(tolerances[::-1][::every][::-1])


def measure(scene, plan, methods=METHODS, progress=None):
    """All methods on one scene.

    Parameters
    ----------
    scene : BenchScene
    plan : Plan
    methods : of `METHODS`; those not installed are left out
    progress : callable(str) or None, told what is under way

    Returns
    -------
    xarray.Dataset over `setting`, `torque` and `horizon` (cycles): `COLUMNS`, processor time in
    µs per mesh cycle over the long horizon and listed events per cycle; NaN where not run; and
    what `measure_calls` adds
    """
    scene = scene.at([scene.torques[i] for i in spread(len(scene.torques), plan.torques)])
    say = progress or (lambda text: None)
    rows = []
    for setting in _own_settings(plan, methods):
        say(f"{scene.name} {setting.name} {setting.tolerance:g}")
        rows.append(_measure_own(scene, setting, plan))
    for rival in RIVALS:
        if rival.name not in methods or not rival.installed:
            continue
        for tolerance in thinned(rival.tolerances, plan.tolerances):
            say(f"{scene.name} {rival.name} {tolerance:g}")
            rows.append(_measure_rival(scene, rival, tolerance, plan))
    return measure_calls(scene, _dataset(scene, rows), plan.repeats, say)


def _own_settings(plan, methods):
    found = [ours.Setting("exact", EXACT_TOLERANCE)] if "exact" in methods else []
    if "rk4" in methods:
        found += [ours.Setting("rk4", tolerance)
                  for tolerance in thinned(RK4_TOLERANCES, plan.tolerances)]
    return found


def _empty_row(scene, name, tolerance):
    n = len(scene.torques)
    row = {key: np.full((n, 2), np.nan) for key in COLUMNS}
    row |= {"microseconds": np.full(n, np.nan), "events_per_cycle": np.full(n, np.nan),
            "method": name, "tolerance": tolerance, "scaling": np.nan, "identical_bytes": -1,
            "study_computed": np.nan, "study_copied": np.nan}
    return row


def _enter(row, i, horizon, verdict):
    for key in COLUMNS:
        row[key][i, horizon] = getattr(verdict, key)


def _measure_own(scene, setting, plan):
    row = _empty_row(scene, setting.name, setting.tolerance)
    references = load(scene.name, variant(scene, rule=False, table=False))
    oscillators = scene.oscillators
    for horizon, cycles in enumerate((SHORT, LONG)):
        result = ours.run(oscillators, setting, cycles)
        for i, outcome in enumerate(ours.outcomes(result, oscillators)):
            reference = references[scene.torques[i]]
            if cycles == SHORT or reference.calm:
                _enter(row, i, horizon, judge(outcome, reference, problem(oscillators[i]), cycles,
                                              setting.tolerance))
    row["events_per_cycle"][:] = result.outcome["logged"] / LONG
    room = int(result.outcome["logged"].max()) + ours.SPARE_ROOM
    options = {"room": room, "repeats": plan.repeats}
    row["microseconds"][:] = 1e6 / LONG * ours.cpu_times(oscillators, setting, LONG, **options)
    if setting.method == "exact" or setting.tolerance == STUDY_TOLERANCE:
        row |= ours.study(oscillators, setting, repeats=plan.repeats)
    return row


def _measure_rival(scene, rival, tolerance, plan):
    row = _empty_row(scene, rival.name, tolerance)
    follow = rival.follower(scene, tolerance)
    references = load(scene.name, variant(scene, rule=True, table=False))
    calm = [i for i, torque in enumerate(scene.torques) if references[torque].calm]
    every = range(len(scene.torques))
    short = spread(len(every), plan.slow_short_torques if rival.slow else None)
    pool = calm if len(calm) >= plan.slow_torques else list(every)
    long = [pool[k] for k in spread(len(pool), plan.slow_torques)] if rival.slow else every
    follow(problem(scene.oscillators[0]), 1)  # compiles, where a method compiles
    for horizon, cycles, chosen in ((0, SHORT, short), (1, LONG, long)):
        for i in chosen:
            given, reference = problem(scene.oscillators[i]), references[scene.torques[i]]
            record, seconds = _timed(follow, given, cycles,
                                     1 if rival.slow or cycles == SHORT else plan.repeats)
            outcome = record.outcome()
            if cycles == LONG:
                row["events_per_cycle"][i] = len(outcome.kind) / LONG
                row["microseconds"][i] = 1e6 / LONG * seconds
            if cycles == SHORT or reference.calm:
                _enter(row, i, horizon, judge(outcome, reference, given, cycles, tolerance))
    return row


def _timed(follow, given, cycles, repeats):
    """What a run leaves behind, and its processor time in s: the median of repeats.

    Short runs are repeated until together they can be measured, as the engine's own are.
    """
    begun = time.process_time()
    record = follow(given, cycles)
    once = time.process_time() - begun
    if repeats == 1:
        return record, once
    calls = int(np.clip(np.ceil(ours.LEAST_CALL / max(once, 1e-9)), 1, ours.MOST_COPIES))
    times = []
    for _ in range(repeats):
        begun = time.process_time()
        for _ in range(calls):
            follow(given, cycles)
        times.append((time.process_time() - begun) / calls)
    return record, float(np.median(times))


def _dataset(scene, rows):
    import xarray as xr

    by_horizon = ("setting", "torque", "horizon")
    data = {key: (by_horizon, np.array([row[key] for row in rows]).reshape(
        len(rows), len(scene.torques), 2)) for key in COLUMNS}
    data |= {key: (("setting", "torque"), np.array([row[key] for row in rows]).reshape(
        len(rows), len(scene.torques))) for key in ("microseconds", "events_per_cycle")}
    data |= {key: ("setting", [row[key] for row in rows])
             for key in ("method", "tolerance", *STUDY_COLUMNS)}
    calm = load(scene.name, variant(scene, rule=False, table=False))
    data["calm"] = ("torque", [int(calm[torque].calm) for torque in scene.torques])
    dataset = xr.Dataset(data, {"torque": list(scene.torques), "horizon": [SHORT, LONG]},
                         {"scene": scene.name, "title": scene.title})
    units = {"torque": "N m", "microseconds": "us", "study_computed": "us",
             "study_copied": "us", "event_error": "mesh periods",
             "state_error": "natural sizes", "events_per_cycle": "1"}
    for key, unit in units.items():
        dataset[key].attrs["units"] = unit
    dataset["microseconds"].attrs["long_name"] = (
        f"processor time per mesh cycle on one core, {LONG} cycles from rest")
    dataset["error"].attrs["long_name"] = (
        "larger one of event and state error; infinite where an event was missed or doubled")
    dataset["calm"].attrs["long_name"] = "1: errors do not grow over the long horizon"
    return dataset
