"""What a user calls, alone: processor time of the call and of what is outside the engine.

Seconds to run, no rival, no reference. Every call is given other numbers than the one before, so
that nothing is quick which was only computed before. Processor times, of which the machine's other
work spoils little; what is outside the engine is that of the calling thread.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from lapwing_bench.report import Table
from lapwing_bench.scenes import PAIR, SCENES, harmonic
from lapwing_bench.whole_calls import engine_clock

# Seconds and number of calls of each line, whatever comes first.
MOST_SECONDS, MOST_CALLS = 1.5, 200
CYCLES = 50
# Torques, cycles to settle and recorded.
SWEEPS = ((4, 0, CYCLES), (64, 0, CYCLES), (64, 400, 100), (2000, 400, 100))


@dataclass(frozen=True)
class Line:
    """A call to be measured.

    Parameters
    ----------
    name : str
    call : callable(n), the n-th of them
    """

    name: str
    call: Callable[[int], object]


@dataclass(frozen=True)
class Cost:
    """What calls took, ms each.

    Attributes
    ----------
    name : str
    clock : array (n,), of the whole call by the clock
    processor : array (n,), processor time of it, all threads
    outside : array (n,), processor time of the calling thread outside the engine
    """

    name: str
    clock: np.ndarray
    processor: np.ndarray
    outside: np.ndarray


def lines():
    """The calls of `simulate` and `sweep` that this measures."""
    import lapwing

    a = SCENES["A"]
    smooth = harmonic(5e-5)
    prepared = a.oscillator(3.3)

    def looked_at(run):
        return run.events, run.cycles

    def rk4(n):
        osc = PAIR.oscillator(smooth, brake_torque=8.0 + 1e-6 * n, mesh_frequency_hz=300.0)
        return lapwing.simulate(osc, cycles=CYCLES, method="rk4", rtol=1e-8)

    found = [
        Line("simulate, new oscillator",
             lambda n: lapwing.simulate(a.oscillator(3.3 + 1e-6 * n), cycles=CYCLES)),
        Line("simulate, prepared", lambda n: lapwing.simulate(
            prepared, phase=1e-6 * n, cycles=CYCLES)),
        Line("simulate, prepared, both Datasets", lambda n: looked_at(lapwing.simulate(
            prepared, phase=1e-6 * n, cycles=CYCLES))),
        Line("simulate by rk4, harmonic, rtol 1e-8", rk4)]
    for torques, settle, record in SWEEPS:
        for threads in (1, 2):
            found.append(Line(
                f"sweep S1, {torques} × {settle + record}, {threads} thread{'s' * (threads > 1)}",
                lambda n, size=(torques, settle, record), threads=threads: _sweep(
                    SCENES["S1"], *size, threads, n)))
    return found


def _sweep(scene, torques, settle, record, threads, n):
    import lapwing

    return lapwing.sweep(
        PAIR, scene.te, values=np.linspace(*scene.swept, torques) + 1e-6 * n, starts=("rest",),
        settle=settle, record=record, threads=threads, mesh_frequency_hz=scene.mesh_frequency_hz,
        contact_law=scene.contact_law, impact_law=scene.impact_law)


def measured(line):
    """`Cost` of a line, after a first call that is not counted."""
    line.call(0)
    rows, begun = [], time.perf_counter()
    while len(rows) < 3 or (len(rows) < MOST_CALLS and time.perf_counter() - begun < MOST_SECONDS):
        with engine_clock(time.thread_time) as inside:
            before = time.perf_counter(), time.process_time(), time.thread_time()
            result = line.call(1 + len(rows))
            after = time.perf_counter(), time.process_time(), time.thread_time()
        del result  # to give its memory back is not part of the call
        clock, processor, own = np.subtract(after, before)
        rows.append((clock, processor, own - inside[0]))
    return Cost(line.name, *1e3 * np.array(rows).T)


def table(costs):
    """The report's table of some `Cost`."""
    rows = [[cost.name, *(f"{number:.3f}" for column in (cost.clock, cost.processor, cost.outside)
                          for number in (np.min(column), np.median(column)))] for cost in costs]
    return Table(
        "Public calls",
        f"Whole calls, ms: by the clock, processor time, and processor time outside the engine, "
        f"each the least and the median of up to {MOST_CALLS} calls with other numbers each.",
        ("call", "clock", "median", "processor", "median", "outside", "median"), rows)
