"""What a user calls: `lapwing.sweep` with its statistics, and each fast rival's own sweep.

All by the clock, from the call to its return, with one and with several threads. Of Lapwing the
part inside the compiled engine is told beside it; a rival is given its scene ready and compiled,
and leaves its events and last states, of which it makes no statistics.
"""

from __future__ import annotations

import time
from contextlib import contextmanager
from dataclasses import dataclass

import numpy as np

from lapwing_bench import summary
from lapwing_bench.problem import problem
from lapwing_bench.rivals import RIVALS
from lapwing_bench.scenes import PAIR

# A setting is compared at its cheapest with at most this median error.
CALL_ERROR = 1e-10
THREADS = (1, 2)
# A call is repeated until so many seconds have gone, or so often.
LEAST_SECONDS, MOST_CALLS = 0.5, 50
COLUMNS = ("call", "call_engine")


@dataclass(frozen=True)
class Case:
    """Size of a sweep; rivals run it unless it is said to be too large."""

    torques: int
    settle: int
    record: int
    rivals: bool = True

    @property
    def cycles(self):
        """Of each torque."""
        return self.settle + self.record

    @property
    def name(self):
        """As the report prints it."""
        return f"{self.torques} × {self.cycles}"


CASES = (Case(64, 0, 50), Case(64, 400, 100), Case(2000, 400, 100, rivals=False))


def measure_calls(scene, dataset, repeats, say):
    """Cost of whole calls beside what `measure` found.

    Parameters
    ----------
    scene : BenchScene
    dataset : Dataset of `measure`, whose errors choose each method's setting
    repeats : int, least number of calls
    say : callable(str), told what is under way

    Returns
    -------
    Dataset with `call` and `call_engine` besides, µs per mesh cycle over `setting`, `case` and
    `threads`: the quickest of the calls, and what of it was spent inside the engine; NaN where not
    run
    """
    shape = (dataset.sizes["setting"], len(CASES), len(THREADS))
    found = {name: np.full(shape, np.nan) for name in COLUMNS}
    methods = dict.fromkeys(str(method) for method in dataset["method"].values)
    rivals = {rival.name: rival for rival in RIVALS if rival.sweepers}
    for method in methods:
        k = summary.chosen(dataset, method, CALL_ERROR)
        if k is None or method not in (*summary.OURS, *rivals):
            continue
        tolerance = float(dataset["tolerance"][k])
        for c, case in enumerate(CASES):
            if not case.rivals and method != "exact":
                continue
            for t, threads in enumerate(THREADS):
                say(f"{scene.name} {method} {case.name}, {threads} threads")
                times = _own(scene, case, method, tolerance, threads, repeats) \
                    if method in summary.OURS else \
                    _of_rival(rivals[method], scene, case, tolerance, threads, repeats)
                for name, seconds in zip(COLUMNS, times, strict=True):
                    found[name][k, c, t] = 1e6 * seconds / (case.torques * case.cycles)
    dims = ("setting", "case", "threads")
    dataset = dataset.assign({name: (dims, values, {"units": "us"})
                              for name, values in found.items()})
    return dataset.assign_coords(case=[case.name for case in CASES], threads=list(THREADS))


def _torques(scene, case):
    return np.linspace(*scene.swept, case.torques)


def _own(scene, case, method, tolerance, threads, repeats):
    """Seconds of `lapwing.sweep`, and those inside the engine."""
    import lapwing

    more = {"rtol": tolerance} if method == "rk4" else {}
    torques = _torques(scene, case)

    def call():
        with engine_clock() as inside:
            begun = time.perf_counter()
            result = lapwing.sweep(
                PAIR, scene.te, values=torques, starts=("rest",), settle=case.settle,
                record=case.record, observe=("cycles",), method=method, threads=threads,
                mesh_frequency_hz=scene.mesh_frequency_hz, contact_law=scene.contact_law,
                impact_law=scene.impact_law, **more)
            seconds = time.perf_counter() - begun
        if np.any(result["status"].values):
            raise RuntimeError(f"{scene.name}: a point of the sweep failed")
        return seconds, inside[0]

    return _quickest(call, repeats)


def _of_rival(rival, scene, case, tolerance, threads, repeats):
    """Seconds of a rival's sweep, in the form that is the faster one here; NaN where it fails."""
    problems = [problem(scene.oscillator(torque)) for torque in _torques(scene, case)]
    times = [(np.nan, np.nan)]
    for module in rival.sweepers:
        sweep = rival.sweeper(module, scene, tolerance, threads)
        if any(record.failure for record in sweep(problems, 1)):  # compiles, where one compiles
            continue

        def call(sweep=sweep):
            begun = time.perf_counter()
            records = sweep(problems, case.cycles)
            seconds = time.perf_counter() - begun
            if any(record.failure for record in records):
                return np.nan, np.nan
            return seconds, np.nan

        times.append(_quickest(call, min(repeats, 3)))
    return min(times, key=lambda row: row[0] if np.isfinite(row[0]) else np.inf)


def _quickest(call, repeats):
    """(whole, inside) of the quickest of repeated calls."""
    call()
    rows, begun = [], time.perf_counter()
    while len(rows) < repeats or (
            len(rows) < MOST_CALLS and time.perf_counter() - begun < LEAST_SECONDS):
        rows.append(call())
    return min(rows)


@contextmanager
def engine_clock(clock=time.perf_counter):
    """Seconds by a clock inside the compiled engine while it lasts, as a list of one."""
    from lapwing.engine import calls

    api, seconds = calls.api, [0.0]

    class Clocked:
        def __getattr__(self, name):
            def call(*arguments):
                begun = clock()
                found = getattr(api, name)(*arguments)
                seconds[0] += clock() - begun
                return found

            return call

    calls.api = Clocked()
    try:
        yield seconds
    finally:
        calls.api = api
