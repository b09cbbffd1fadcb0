"""Memory follows what happens, not the ratio of two scales of the input."""

import json
import sys

import numpy as np
import pytest

import children
import lapwing
from lapwing.engine import methods

# A child process under a limit: its outcome, and the most memory it had, MB.
CHILD = """
import json, resource, sys
resource.setrlimit(resource.RLIMIT_AS, ({limit} << 20, {limit} << 20))
import numpy as np
import lapwing

def peak():  # of this program alone: ru_maxrss also counts the process that began it
    with open("/proc/self/status") as file:
        return next(int(line.split()[1]) for line in file if line.startswith("VmHWM"))

begun = peak()
try:
    {code}
except (ValueError, MemoryError) as error:
    said = f"{{type(error).__name__}}: {{error}}"
print(json.dumps([said, (peak() - begun) / 1024]))
"""


pytestmark = pytest.mark.skipif(not sys.platform.startswith("linux"), reason="reads /proc")


def child(code, limit=4096):
    ended = children.carried_out(CHILD.format(code=code, limit=limit))
    assert ended.code == 0, ended
    return json.loads(ended.said)


def stiff(ratio, xi):
    return (f"lapwing.Oscillator(lapwing.TransmissionError.parabola(1e-4), force=1e-4, "
            f"mesh_frequency_ratio={ratio}, damping_ratio={xi}, restitution=.5, backlash=2e-3)")


CASES = [(1.0, 1e-3), (1.0, 1.0), (1e-2, 1.0), (1e-2, 50.0), (1e-3, 100.0), (1e-4, 100.0),
         (1e-5, 100.0), (1e-7, 0.1), (1e-7, 1.0), (1e-4, 1e3), (1e-2, 1e5)]


# Each is a process of its own: the ordinary one and three extremes are enough for every day.
EVERY_DAY = {(1.0, 1e-3), (1e-2, 50.0), (1e-7, 0.1), (1e-2, 1e5)}


@pytest.mark.parametrize(("ratio", "xi"), [
    pytest.param(*case, marks=() if case in EVERY_DAY else pytest.mark.full) for case in CASES])
@pytest.mark.parametrize("method", ["exact", "rk4"])
def test_a_fast_damper_takes_no_more_memory(ratio, xi, method):
    code = (f"said = lapwing.simulate({stiff(ratio, xi)}, cycles=1, method='{method}', "
            "max_steps_per_cycle=200_000).status.name")
    said, megabytes = child(code)
    assert said in ({"OK"} if method == "exact" else {"OK", "TOO_MANY_STEPS"})
    assert megabytes < 200


@pytest.mark.parametrize("te", ["parabola(1e-4)", "harmonic([1e-4, 3e-5])",
                                "from_samples([.1, .3, .4, .8], [0, 1e-4, 0, -5e-5])"])
@pytest.mark.parametrize(("ratio", "xi"), CASES)
def test_the_closed_form_works_for_events_alone(te, ratio, xi):
    """Stretches are as many as events and knots, whatever the mesh is against spring and damper."""
    osc = lapwing.Oscillator(eval(f"lapwing.TransmissionError.{te}"), force=1e-4,
                             mesh_frequency_ratio=ratio, damping_ratio=xi, restitution=.5,
                             backlash=2e-3)
    run = lapwing.simulate(osc, ("separation", -1e-4, 0.0), cycles=5, method="exact")
    assert run.status == lapwing.Status.OK
    assert run.work["stretches"] <= run.events.sizes["event"] + 5 * osc.te.knots.size + 5


@pytest.mark.parametrize("te", [
    lapwing.TransmissionError.parabola(1e-4), lapwing.TransmissionError.harmonic([1e-4, 2e-5])])
@pytest.mark.parametrize(("ratio", "xi"), [(3e-5, 0.3), (1e-3, 20.0), (3e-2, 400.0)])
def test_a_graded_scene_moves_as_steps_do(te, ratio, xi):
    osc = lapwing.Oscillator(te, force=1e-4, mesh_frequency_ratio=ratio, damping_ratio=xi,
                             restitution=.5, backlash=2e-3)
    graded, stepped = (
        lapwing.simulate(osc, ("separation", -1e-4, 0.0), cycles=0.3, method=method, rtol=1e-12)
        for method in ("exact", "rk4"))
    assert osc.period * max(1, 2 * xi) > methods.GRADED_SPAN
    assert graded.events.kind.values.tolist() == stepped.events.kind.values.tolist()
    # To the tolerance of the steps, and of time against the period.
    assert graded.events.tau.values == pytest.approx(stepped.events.tau.values, rel=1e-9, abs=1e-9)
    assert graded.final.phi == pytest.approx(stepped.final.phi, rel=1e-9)


TIGHT = """
import resource, sys
import numpy as np
import lapwing
osc = {osc}
pair = lapwing.GearPair(25, 32, 0.0078, 0.026, 0.034, 3.12e8, 0.002, 0.8, damping_ratio=50.)
lapwing.simulate(osc, cycles=1, max_steps_per_cycle=10, method="rk4")
given = {{"values": [2.0, 3.0], "mesh_frequency_hz": 26.4, "settle": 0, "record": 1, "threads": 1}}
lapwing.sweep(pair, osc.te, max_steps_per_cycle=10, method="rk4", **given)
used = int(open("/proc/self/statm").read().split()[0]) * resource.getpagesize()
limit = used + ({room} << 20)
resource.setrlimit(resource.RLIMIT_AS, (limit, limit))
run = lapwing.simulate(osc, cycles=1, method="exact")
given |= {{"parameter": "mesh_frequency_hz", "values": [26.4, 400.0], "brake_torque": 2.0}}
del given["mesh_frequency_hz"]
swept = lapwing.sweep(pair, osc.te, method="exact", starts=("down",), **given)
print(run.status.name, *(lapwing.Status(one).name for one in swept.status.values[0]))
"""


@pytest.mark.parametrize(("room", "statuses"), [
    (4, {"OUT_OF_MEMORY", "OK"}), (1000, {"OK", "TOO_MANY_EVENTS"})])
def test_no_memory_is_a_status(room, statuses):
    code = TIGHT.format(osc=stiff(2e-2, 50.0), room=room)
    ended = children.carried_out(code)
    assert ended.code == 0, ended
    said = set(ended.said.split())
    assert said <= statuses and ("OUT_OF_MEMORY" in said) == ("OUT_OF_MEMORY" in statuses)


SECOND_POINT = """
import resource
from dataclasses import replace
import lapwing
from lapwing import engine
from lapwing.engine import calls, sweeps
from lapwing._engine import api
osc = {osc}

class Tight:
    @staticmethod
    def sweep(*arguments):
        lines, outcome = arguments[3], arguments[-1]
        lines[4, 0], outcome[0, 0] = sweeps.LINE_DONE, lapwing.Status.OK
        used = int(open("/proc/self/statm").read().split()[0]) * resource.getpagesize()
        resource.setrlimit(resource.RLIMIT_AS, (used + (4 << 20), resource.RLIM_INFINITY))
        return api.sweep(*arguments)

calls.api = Tight
result = engine.sweep(
    [osc, replace(osc, force=2e-4)], [(0, 0, False), (1, 1, False)],
    [(engine.REST, 0, 0, 0.0)] * 2, numerics=engine.Numerics(), wanted=engine.Wanted(),
    settle=0, record=1, log_room=1, threads=1)
print(*(lapwing.Status(int(status)).name for status in result.outcome["status"]))
"""


def test_points_that_are_finished_stay_so_where_memory_ends():
    """A sweep is many calls: what one of them has no room for takes nothing from those before."""
    ended = children.carried_out(SECOND_POINT.format(osc=stiff(6e-3, 50.0)))
    assert ended.code == 0, ended
    assert ended.said.split() == ["OK", "OUT_OF_MEMORY"]


SPY = """
    import types
    from lapwing.engine import Numerics, TrajectoryCall, Wanted
    osc, grew, call = {osc}, [], calls.api.trajectory
    def spied(*arguments):
        before = peak()
        done = call(*arguments)
        grew.append((peak() - before) / 1024)
        return done
    calls.api = types.SimpleNamespace(trajectory=spied)
    times = np.column_stack([np.zeros(10**6), np.linspace(0, osc.period, 10**6, endpoint=False)])
    TrajectoryCall(osc, (-1.0, 0, 0, 0), numerics=Numerics(), wanted=Wanted()).run((1, 0.0), times)
    said = max(grew)
"""


def test_tables_enter_the_engine_without_copies():
    """A copy that the compiler makes at the border takes for granted that there is memory."""
    code = "from lapwing.engine import calls" + SPY.format(osc=stiff(1.0, 0.1))
    grew, _ = child(code)
    # A million samples and their times are 40 MB; what a call takes itself is far below a tenth.
    assert grew < 4


def test_extrema_search_few_pieces(monkeypatch):
    """Of a series of order 200 and of a smooth table: where its bounds pass all knots."""
    from lapwing.model.transmission_error import extrema

    calls, original = [], extrema.stationary_points
    monkeypatch.setattr(extrema, "stationary_points",
                        lambda piece: calls.append(1) or original(piece))
    te = lapwing.TransmissionError.harmonic([1e-4, 3e-5], [0.3, 0.4], [1, 200])
    assert te.peak_to_peak == pytest.approx(2.6e-4, rel=1e-3)
    assert len(calls) < 0.02 * te.coefficients.shape[0]


@pytest.mark.parametrize("seed", range(20))
def test_extrema_are_those_of_every_piece(seed):
    from numpy.polynomial import polynomial as power

    from lapwing.model.transmission_error.extrema import stationary_points
    from random_scenes import transmission_error

    te = transmission_error(np.random.default_rng(seed), 41)
    values = [power.polyval(stationary_points(piece), piece) for piece in (
        te.coefficients * np.diff(te.knots)[:, None] ** np.arange(6))]
    assert te.extrema == (min(map(np.min, values)), max(map(np.max, values)))


def test_many_knots_fit_on_the_stack_and_take_no_time_of_their_square():
    """200,000 knots, in the main thread and in two others."""
    said, _ = child(
        "n = 200_000; phase = np.arange(n) / n\n"
        "    te = lapwing.TransmissionError.from_hermite(phase, 1e-4 * np.cos(2 * np.pi * phase), "
        "-2e-4 * np.pi * np.sin(2 * np.pi * phase))\n"
        "    osc = lapwing.Oscillator(te, force=1e-4, mesh_frequency_ratio=.1, damping_ratio=.1, "
        "restitution=.5, backlash=2e-3)\n"
        "    said = lapwing.simulate(osc, cycles=1, method='rk4', rtol=1e-4).status.name")
    assert said == "OK"
