"""Hard cases as data (tests/hard_cases): every number of every event, by both methods.

`condition` of a number is what a relative change of a parameter does to it, summed over all
parameters. Allowed are, for 'exact', 1e-10 of the natural size and what the rounding of inputs and
of time does, ROUNDING·(condition + τ); for 'rk4' in addition its promise, `rtol` mesh periods times
what the dynamics make of it.
"""

import json
import math
import sys

import numpy as np
import pytest

from event_comparison import CHATTER_TAIL, ROUNDING, bend, events_of
from helpers import EPS, PAIR, ROOT
from lapwing import EventKind, Oscillator, Status, TransmissionError, simulate

FOLDER = ROOT / "tests" / "hard_cases"
sys.path.append(str(FOLDER))
import make_hard_cases  # noqa: E402

RTOL = 1e-10
EXACT = 1e-10
FILES = sorted((FOLDER / "data").glob("*.json"))
ORBITS = json.loads((FOLDER / "orbits.json").read_text(encoding="utf-8"))
LONG = [name for name, orbit in ORBITS.items() if name != "command"]
COLUMNS = ("phi", "velocity_before", "velocity_after")


def load(path):
    return json.loads(path.read_text(encoding="utf-8"))


def oscillator_of(scene):
    te = scene["te"]
    if isinstance(te, dict) and "harmonic" in te:
        orders, amplitudes, shifts = np.array(te["harmonic"]).T
        table = TransmissionError.harmonic(amplitudes, shifts, orders)
    else:
        table = TransmissionError.from_hermite(*np.array(make_hard_cases.table_rows(te)).T)
    return Oscillator(
        table, mesh_frequency_ratio=2 * math.pi / scene["period"],
        **{key: value for key, value in scene.items() if key not in ("te", "period")})


def start_of(case):
    return case["start"] if isinstance(case["start"], str) else tuple(case["start"])


def run_case(case, method, cycles):
    osc = oscillator_of(case["scene"])
    assert osc.period == pytest.approx(case["scene"]["period"], rel=2 * EPS)
    return simulate(osc, start_of(case), case["phase"], cycles, method=method, rtol=RTOL,
                    observe=("events",))


def tolerances(run, method, tau, phi, speed, condition):
    """Allowed error of a time, and of a place or speed of some condition, at an event."""
    osc = run.oscillator
    promise = RTOL if method == "rk4" else 0.0
    time = (EXACT + promise) * osc.period + (promise + ROUNDING) * (condition["tau"] + abs(tau))
    load = bend(osc, tau, run.final) + abs(phi) + 2 * osc.damping_ratio * speed
    size = osc.angle_scale + speed

    def allowed(name):
        known = EXACT * size + ROUNDING * (condition[name] + size + abs(phi))
        return known + promise * (condition[name] + size + load * osc.period)
    return time, allowed


@pytest.mark.parametrize("method", ["exact", "rk4"])
@pytest.mark.parametrize("path", FILES, ids=lambda path: path.stem)
def test_case(path, method):
    case = load(path)
    run = run_case(case, method, case["cycles"] - case["phase"])
    assert run.status == Status.OK
    found = events_of(run)
    names = [EventKind(kind).name for kind in found["kind"]]
    assert names == [event["kind"] for event in case["events"]]
    for i, event in enumerate(case["events"]):
        expected = {name: float(event[name]) for name in ("tau", *COLUMNS)}
        speed = max(abs(expected["velocity_before"]), abs(expected["velocity_after"]))
        time, allowed = tolerances(run, method, expected["tau"], expected["phi"], speed,
                                   event["condition"])
        assert abs(found["tau"][i] - expected["tau"]) <= time, (i, names[i], "tau")
        for name in COLUMNS:
            error = abs(found[name][i] - expected[name])
            assert error <= allowed(name), (i, names[i], name, error, allowed(name))


@pytest.mark.parametrize("method", ["exact", "rk4"])
@pytest.mark.parametrize("path", FILES, ids=lambda path: path.stem)
def test_final_state(path, method):
    case = load(path)
    run = run_case(case, method, case["cycles"] - case["phase"])
    final = case["final"]
    assert run.final.motion_state.name.lower() == final["motion"]
    phi, velocity = float(final["phi"]), float(final["velocity"])
    condition = {**final["condition"], "tau": 0.0}
    _, allowed = tolerances(run, method, run.final.tau, phi, abs(velocity), condition)
    assert abs(run.final.phi - phi) <= allowed("phi")
    assert abs(run.final.phi_dot - velocity) <= allowed("velocity")


@pytest.mark.parametrize("method", ["exact", "rk4"])
@pytest.mark.parametrize("name", LONG)
@pytest.mark.parametrize("cycles", [2_000, pytest.param(100_000, marks=pytest.mark.full)])
def test_stable_orbit(name, cycles, method):
    """Every cycle of very many: the same events at the same phases with the same velocities."""
    orbit = ORBITS[name]
    run = run_case(orbit, method, cycles)
    assert run.status == Status.OK
    per_cycle = len(orbit["events"])
    late = run.events["cycle"].values >= orbit["settle"] + 1
    # What the end of the run may cut off is left out.
    late &= run.events["cycle"].values < cycles - 1
    found = {key: run.events[key].values[late].reshape(-1, per_cycle)
             for key in ("kind", "phase", "velocity_before", "velocity_after")}
    assert len(found["phase"]) == cycles - orbit["settle"] - 2
    kinds = [EventKind[event["kind"]] for event in orbit["events"]]
    assert np.all(found["kind"] == kinds)
    error = EXACT + ROUNDING * orbit["condition"]
    if method == "rk4":
        error += RTOL * (1 + orbit["condition"])
    osc = run.oscillator
    for k, event in enumerate(orbit["events"]):
        assert np.abs(found["phase"][:, k] - float(event["phase"])).max() <= error, event["kind"]
        for key in ("velocity_before", "velocity_after"):
            size = abs(float(event[key])) + bend(osc, run.final.tau, run.final) * osc.period
            assert np.abs(found[key][:, k] - float(event[key])).max() <= error * size, event["kind"]


# --- harmonic series ----------------------------------------------------------------------------

SERIES = [pytest.param(run, id=f"{path.stem}-{run['name']}")
          for path in sorted((ROOT / "tests" / "reference" / "data" / "quadruple").glob("*.json"))
          for run in load(path)["runs"]]
# What the table of a series is promised to: slope and curvature, relative (harmonic_series.py).
# Over the load, the slope's error acts like one of the load.
TABLE_SLOPE, TABLE_CURVATURE = 1e-10, 1e-8


@pytest.mark.parametrize("method", ["exact", "rk4"])
@pytest.mark.parametrize("run", SERIES)
def test_harmonic_series(run, method):
    """Event times against quadruple precision; 'rk4' moves on the table of the series."""
    scene = run["scene"]
    orders, amplitudes, shifts = np.array(scene["te"]["terms"], dtype=float).T
    osc = PAIR.oscillator(
        TransmissionError.harmonic(amplitudes, shifts, orders),
        brake_torque=float(scene["brake_torque"]),
        pinion_speed_rpm=float(scene["pinion_speed_rpm"]), contact_law=scene["contact_law"],
        impact_law=scene.get("impact_law", "relative"))
    found = simulate(osc, run["start"], cycles=run["cycles"], method=method, rtol=RTOL,
                     observe=("events",))
    names = [(event["kind"], event["flank"]) for event in run["events"]]
    tails = [(event["flank"], float(event["tau"])) for event in run["events"]
             if event["kind"] == "chatter_end"]
    keep = [not (kind == "impact" and any(f == flank and 0 <= end - float(event["tau"])
                                          <= CHATTER_TAIL * osc.period for f, end in tails))
            for (kind, flank), event in zip(names, run["events"], strict=True)]
    events = [event for event, kept in zip(run["events"], keep, strict=True) if kept]
    table = events_of(found)
    assert [EventKind(kind).name for kind in table["kind"]] == [
        make_hard_cases.NAMES[event["kind"], event["flank"]] for event in events]
    growth = np.array([float(event["growth"]) for event in events])
    tau = np.array([float(event["tau"]) for event in events])
    allowed = EXACT * osc.period + ROUNDING * (growth + tau)
    if method == "rk4":
        size = max(1.0, osc.gear_ratio * osc.te.peak_to_peak / osc.force)
        allowed += (RTOL + TABLE_SLOPE * size) * (osc.period + growth)
    assert np.all(np.abs(table["tau"] - tau) <= allowed)


@pytest.mark.parametrize("method", ["exact", "rk4"])
@pytest.mark.parametrize("side", [1, -1])
def test_rigid_contact_near_the_critical_gamma(side, method):
    """Γ = A'Ω²/F = 1 ± 1e-6: lost where cos u = -1/Γ, or never."""
    omega, gamma = 0.75, 1 + side * 1e-6
    osc = Oscillator(TransmissionError.harmonic([1.0]), force=omega**2 / gamma, backlash=1e3,
                     mesh_frequency_ratio=omega, restitution=0.5, contact_law="rigid")
    run = simulate(osc, cycles=0.6 if side > 0 else 50.0, method=method)
    if side < 0:
        assert run.events.sizes["event"] == 0
        return
    assert run.events["kind"].values[0] == EventKind.RELEASE
    # d cos u = sin u du: how far a relative error of g'' moves the place, in periods.
    u = math.pi - math.acos(osc.force / omega**2)
    condition = 1 / (2 * math.pi * math.tan(math.pi - u))
    error = EXACT + ROUNDING * condition + (TABLE_CURVATURE * condition if method == "rk4" else 0)
    assert run.events["phase"].values[0] == pytest.approx(u / (2 * math.pi), rel=0, abs=error)


@pytest.mark.parametrize("method", ["exact", "rk4"])
@pytest.mark.parametrize("damping_ratio", [0.0, 0.5, 1.0, 1.65, 3.0])
def test_short_pieces_lose_no_digits(damping_ratio, method):
    """Contact on a table of short quintic pieces against the series behind it.

    The table has the series' value to 1e-12 of its size; the gain from there to φ is below 4. What
    the fifth derivatives of short pieces are, rounding mostly, must not matter.
    """
    series = TransmissionError.harmonic([1.0, 0.3, 0.1], [0.0, 1.0, 2.0])
    table = TransmissionError(series.knots, series.coefficients, series.kinks)
    histories = []
    for te, how in ((series, "exact"), (table, method)):
        osc = Oscillator(te, force=24.0, mesh_frequency_ratio=2.7, damping_ratio=damping_ratio,
                         restitution=0.5, backlash=1e3, contact_law="compliant")
        run = simulate(osc, ("engagement", 24.0, 0.0), cycles=3, method=how, rtol=1e-13)
        assert run.events.sizes["event"] == 0
        histories.append(run.history(np.linspace(0, 3 * osc.period, 60))["phi"].values)
    assert np.abs(histories[1] - histories[0]).max() <= 4e-12 * series.peak_to_peak


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.stem)
def test_the_closed_form_does_not_depend_on_the_tolerance(path):
    """Nor is it Runge-Kutta in disguise; only where a chatter is summed rtol has a say."""
    case = load(path)
    osc, length = oscillator_of(case["scene"]), case["cycles"] - case["phase"]
    runs = [simulate(osc, start_of(case), case["phase"], length, method="exact", rtol=rtol,
                     chatter_tol=1e-13, observe=("events",)) for rtol in (1e-3, 1e-9)]
    assert runs[0].method == "exact"
    for name in ("tau", "kind", "velocity_after"):
        assert np.array_equal(*(run.events[name].values for run in runs))


def test_every_case_is_stored_and_named():
    import hard_case_list  # noqa: F401  registers the cases

    assert [path.stem for path in FILES] == sorted(make_hard_cases.CASES)
    assert all(load(path)["command"] == f"{make_hard_cases.COMMAND} {path.stem}" for path in FILES)


def test_flights_over_both_flanks_are_single_steps():
    """The case is what it says: fewer steps than events."""
    case = load(FOLDER / "data" / "both_flanks_in_one_step.json")
    run = run_case(case, "rk4", 0.005)
    assert run.events.sizes["event"] >= 2
    assert run.work["steps"] <= run.events.sizes["event"] + 1
