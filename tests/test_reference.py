"""The engine against the 60-digit integrator of tests/reference, event by event.

`growth` = |dτ/d ln T| of an event says how far a relative change of the force moves it.  One run
promises event times within about `rtol` mesh periods, times the growth of the dynamics; an error
of `rtol` angle scales is, for the next flight, what a change of F by that part would be, so

    |Δτ| <= rtol·(P + growth) + 8 EPS·(growth + τ),

the last term for the parameters rounded to double (a few roundings of Ω, ε and g act like one of
F).  At a place where φ is known, |φ''| <= a = |F| + |g''| + |φ| + 2ξ|φ'|, hence
|Δφ'| <= a·|Δτ| + rtol·velocity scale and |Δφ| <= |φ'|·|Δτ| + rtol·angle scale.
"""

import json
from functools import cache

import numpy as np
import pytest

from helpers import EPS, PAIR, ROOT
from lapwing import EventKind, MotionState, Status, TransmissionError, simulate

DATA = ROOT / "tests" / "reference" / "data"
RTOL = 1e-10
# Comparison ends where an event is uncertain by more than this part of a mesh period.
HORIZON = 1e-5
# Bounces this near, in mesh periods, to the end of a complete chatter are listed by convention.
CHATTER_TAIL = 1e-6
CODES = {(kind, flank): EventKind[("BACK_" if flank == "coast" else "") + kind.upper()]
         for kind in ("impact", "release", "engage", "chatter_end")
         for flank in ("drive", "coast")} | {("kink", "none"): EventKind.KINK}
MOTIONS = {"separation": MotionState.SEPARATION, "drive": MotionState.ENGAGEMENT,
           "coast": MotionState.BACK_ENGAGEMENT}
RUNS = [pytest.param(path.stem, index, id=f"{path.stem}-{run['name']}")
        for path in sorted(DATA.glob("*.json"))
        for index, run in enumerate(json.loads(path.read_text(encoding="utf-8"))["runs"])]


@cache
def load(stem, index):
    """One reference run and ours."""
    reference = json.loads((DATA / f"{stem}.json").read_text(encoding="utf-8"))["runs"][index]
    scene = reference["scene"]
    te = scene["te"]
    if te["kind"] == "cubic_hermite":
        table = TransmissionError.from_hermite(*np.array(te["rows"], dtype=float).T)
    else:
        (_, row), = te["pieces"]
        coefficients = np.zeros((1, 6))
        coefficients[0, :len(row)] = [float(c) for c in row]
        table = TransmissionError([0.0, 1.0], coefficients, [True])
    osc = PAIR.oscillator(
        table, brake_torque=float(scene["brake_torque"]),
        pinion_speed_rpm=float(scene["pinion_speed_rpm"]), contact_law=scene["contact_law"],
        impact_law=scene["impact_law"], gap=scene["gap"], back_flank_te=scene["back_flank_te"],
        te_sign=scene["te_sign"])
    assert [float(scene[key]) for key in ("pinion_inertia", "gear_inertia", "mesh_stiffness",
                                          "pinion_base_lever", "damping_ratio", "backlash",
                                          "restitution")] == [
        PAIR.pinion_inertia, PAIR.gear_inertia, PAIR.mesh_stiffness, PAIR.pinion_base_lever,
        PAIR.damping_ratio, PAIR.backlash, PAIR.restitution]
    return reference, osc, simulate(osc, reference["start"], cycles=reference["cycles"], rtol=RTOL)


def without_tails(table, period):
    """Rows but those bounces so near to the end of their chatter that listing is a convention."""
    keep = np.ones(len(table["tau"]), dtype=bool)
    for i in np.flatnonzero(np.isin(table["kind"], [EventKind.CHATTER_END,
                                                    EventKind.BACK_CHATTER_END])):
        impact = EventKind.IMPACT + (table["kind"][i] - EventKind.CHATTER_END)
        keep &= ~((table["kind"] == impact) & (table["tau"] < table["tau"][i])
                  & (table["tau"] >= table["tau"][i] - CHATTER_TAIL * period))
    return {name: column[keep] for name, column in table.items()}


def reference_table(run):
    """The reference's events as arrays, `growth` of a kink taken from its neighbours."""
    rows = run["events"]
    table = {name: np.array([float(row[name]) for row in rows])
             for name in ("tau", "phi", "velocity_before", "velocity_after")}
    table["kind"] = np.array([CODES[row["kind"], row["flank"]] for row in rows], dtype=int)
    growth = np.array([np.inf if row["growth"] is None else float(row["growth"]) for row in rows])
    table["growth"] = neighbours(growth, table["kind"] == EventKind.KINK)
    return table


def neighbours(growth, replace):
    """Growth where `replace`: the larger one of the nearest events that are not replaced."""
    result = growth.copy()
    fixed = np.flatnonzero(~replace)
    for i in np.flatnonzero(replace):
        j = np.searchsorted(fixed, i)
        result[i] = max((growth[k] for k in (*fixed[max(0, j - 1):j], *fixed[j:j + 1])),
                        default=0.0)
    return result


def time_tolerance(osc, growth, tau):
    return RTOL * (osc.period + growth) + 8 * EPS * (growth + tau)


def acceleration(osc, tau, phi, speed):
    """Bound of |φ''| at a place, on either side of a knot there."""
    phase = tau / osc.period
    curvature = np.maximum(*(np.abs(osc.te.curvature(phase + nudge)) for nudge in (-1e-9, 1e-9)))
    return (abs(osc.force) + osc.gear_ratio * curvature / osc.period**2 + np.abs(phi)
            + 2 * osc.damping_ratio * speed)


@pytest.mark.parametrize(("stem", "index"), RUNS)
def test_events(stem, index):
    reference, osc, run = load(stem, index)
    assert run.status == Status.OK
    expected = reference_table(reference)
    found = {name: run.events[name].values for name in
             ("tau", "kind", "phi", "velocity_before", "velocity_after")}
    expected, found = (without_tails(t, osc.period) for t in (expected, found))
    tolerance = time_tolerance(osc, expected["growth"], expected["tau"])
    far = np.flatnonzero(tolerance > HORIZON * osc.period)
    n = far[0] if far.size else len(tolerance)
    if n == len(tolerance):
        assert len(found["tau"]) == n
    assert found["kind"][:n].tolist() == expected["kind"][:n].tolist()
    tolerance = tolerance[:n]
    error = {name: np.abs(found[name][:n] - expected[name][:n])
             for name in ("tau", "phi", "velocity_before", "velocity_after")}
    assert np.all(error["tau"] <= tolerance)
    speed = np.maximum(np.abs(expected["velocity_before"]), np.abs(expected["velocity_after"]))[:n]
    assert np.all(error["phi"] <= speed * tolerance + RTOL * osc.angle_scale)
    allowed = (acceleration(osc, expected["tau"][:n], expected["phi"][:n], speed) * tolerance
               + RTOL * osc.angle_scale)
    assert np.all(error["velocity_before"] <= allowed)
    assert np.all(error["velocity_after"] <= allowed)


@pytest.mark.parametrize(("stem", "index"), RUNS)
def test_states_at_cycle_ends(stem, index):
    reference, osc, run = load(stem, index)
    table = reference_table(reference)
    motion = np.append(run.cycles["motion_state"].values[1:], run.final.motion_state)
    phi = np.append(run.cycles["phi"].values[1:], run.final.phi)
    phi_dot = np.append(run.cycles["phi_dot"].values[1:], run.final.phi_dot)
    assert len(reference["cycle_states"]) == len(run.cycles["cycle"]) == len(phi)
    for i, state in enumerate(reference["cycle_states"]):
        at = float(state["tau"])
        assert state["cycle"] == i + 1
        assert at == pytest.approx((i + 1) * osc.period, rel=4 * EPS)
        j = np.searchsorted(table["tau"], at * (1 - 1e-12))
        growth = max(table["growth"][max(0, j - 1):j + 1], default=0.0)
        tolerance = time_tolerance(osc, growth, at)
        if tolerance > HORIZON * osc.period:
            break
        assert motion[i] == MOTIONS[state["motion"]]
        at_phi, at_phi_dot = float(state["phi"]), float(state["velocity"])
        speed, slack = abs(at_phi_dot), RTOL * osc.angle_scale
        assert phi[i] == pytest.approx(at_phi, rel=0, abs=speed * tolerance + slack)
        assert phi_dot[i] == pytest.approx(at_phi_dot, rel=0, abs=slack + tolerance * acceleration(
            osc, at, at_phi, speed))
        # The deepest point of a flight moves less than φ does at the fastest place before it.
        fastest = np.abs(table["velocity_after"][max(0, j - 20):j + 1]).max(initial=0.0)
        assert run.cycles["deepest_separation"].values[i] == pytest.approx(
            float(state["deepest_separation"]), rel=0,
            abs=max(speed, fastest) * tolerance + slack)


def test_parameters_agree_with_the_reference():
    for stem, index in (param.values for param in RUNS):
        reference, osc, _ = load(stem, index)
        for key, text in reference["dimensionless"].items():
            # A handful of rounded operations lead from the deck to each of them.
            name = {"angular_frequency": None}.get(key, key)
            if name:
                assert getattr(osc, name) == pytest.approx(float(text), rel=16 * EPS)
