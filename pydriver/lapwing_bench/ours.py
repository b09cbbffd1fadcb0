"""The engine as the benchmark runs it: many torques in one call, every event logged."""

from __future__ import annotations

import time
from dataclasses import dataclass, replace

import numpy as np

from lapwing import engine
from lapwing.base.codes import EventKind, Status
from lapwing.engine import Numerics, Wanted
from lapwing_bench.outcome import Outcome

# A full log ends a sweep that wants every event: far more than any scene lists in 50 cycles.
AMPLE_ROOM = 20_000
# Rows a log must have to spare for what one more stretch may bring.
SPARE_ROOM = 128
# A call shorter than this, in seconds, is made of several copies of the torque.
LEAST_CALL = 2e-3
MOST_COPIES = 64
# Cycles of a study, and the least length of its call in seconds.
SETTLED, RECORDED = 400, 100
LEAST_STUDY = 0.2
MOST_POINTS = 5000


@dataclass(frozen=True)
class Setting:
    """A method of the engine at a tolerance.

    Parameters
    ----------
    method : 'rk4' or 'exact'
    tolerance : float; `rtol` of rk4; exact knows none, its number only says when to stop comparing
    """

    method: str
    tolerance: float

    @property
    def name(self):
        """As the report prints it."""
        return self.method

    @property
    def numerics(self):
        """The engine's own form: every cycle is computed, none copied."""
        return Numerics(method=self.method, copy_repeats=False, **(
            {"rtol": self.tolerance} if self.method == "rk4" else {}))


def run(oscillators, setting, cycles, *, room=AMPLE_ROOM):
    """Every oscillator from rest at phase 0; the engine's `SweepResult`."""
    n = len(oscillators)
    return engine.sweep(
        oscillators, [(i, i, False) for i in range(n)], [(engine.REST, 0.0, 0.0, 0.0)] * n,
        numerics=setting.numerics, wanted=Wanted(events=True, impacts=True), settle=0,
        record=cycles, log_room=room, threads=1)


def outcomes(result, oscillators):
    """One `Outcome` for each oscillator of a sweep."""
    found = []
    for osc, log, end in zip(oscillators, result.logs(), result.outcome, strict=True):
        rows = log[:int(end["logged"])]
        rows = rows[rows["kind"] != EventKind.KINK]
        status = Status(int(end["status"]))
        found.append(Outcome(
            rows["kind"].astype(int), rows["cycle"] + rows["t"] / osc.period,
            rows["velocity_after"],
            (int(end["motion_state"]), float(end["phi"]), float(end["phi_dot"])),
            "" if status == Status.OK else status.name.lower()))
    return found


def cpu_times(oscillators, setting, cycles, *, room, repeats):
    """Processor time of each torque inside the engine, s: median of repeats.

    One call runs all torques; how its time divides among them is told by calls of one torque
    each. Calls too short to be measured are made of several copies.

    Returns
    -------
    array (n,)
    """
    def median(points):
        return np.median([run(points, setting, cycles, room=room).cpu_seconds
                          for _ in range(repeats)])

    n = len(oscillators)
    once = run(oscillators, setting, cycles, room=room).cpu_seconds
    copies = int(np.clip(np.ceil(LEAST_CALL / max(once, 1e-9)), 1, MOST_COPIES))
    whole = median(oscillators * copies) / copies
    copies = int(np.clip(np.ceil(LEAST_CALL * n / max(whole, 1e-9)), 1, MOST_COPIES))
    shares = np.array([median([osc] * copies) for osc in oscillators])
    return whole * shares / shares.sum()


def study(oscillators, setting, *, repeats, threads=2):
    """A sweep as `lapwing.sweep` runs it by itself, with statistics of the recorded cycles.

    Every cycle is computed, with one thread and with several; then cycles that repeat themselves
    to the last bit are copied. Times are by the clock inside one call, the best of repeats.

    Returns
    -------
    dict: `study_computed` and `study_copied`, µs per mesh cycle with one thread; `scaling`,
    throughput of several threads over one; `identical_bytes`, whether all results are the same
    """
    def run_study(points, copy_repeats, threads):
        n = len(points)
        begun = time.perf_counter()
        result = engine.sweep(
            points, [(i, i, False) for i in range(n)], [(engine.REST, 0.0, 0.0, 0.0)] * n,
            numerics=replace(setting.numerics, copy_repeats=copy_repeats),
            wanted=Wanted(cycles=True), settle=SETTLED, record=RECORDED, log_room=1,
            threads=threads)
        return time.perf_counter() - begun, result

    points = list(oscillators)
    once, _ = run_study(points, False, 1)
    points *= int(np.clip(np.ceil(LEAST_STUDY / once), 1, MOST_POINTS // len(points)))
    best, results = {}, {}
    for case in ((False, 1), (False, threads), (True, 1)):
        runs = [run_study(points, *case) for _ in range(repeats)]
        best[case], results[case] = min(seconds for seconds, _ in runs), runs[0][1]
    per_cycle = 1e6 / (len(points) * (SETTLED + RECORDED))
    first, *others = results.values()
    same = all(getattr(first, name).tobytes() == getattr(other, name).tobytes()
               for other in others for name in ("outcome", "cycles"))
    return {"study_computed": best[False, 1] * per_cycle,
            "study_copied": best[True, 1] * per_cycle,
            "scaling": best[False, 1] / best[False, threads], "identical_bytes": int(same)}
