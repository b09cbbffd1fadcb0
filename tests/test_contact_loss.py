"""Where contact is lost: rigid law (F against g'') and engaged response (verification.md, 3, 4)."""

import math

import numpy as np
import pytest

from helpers import EPS, PAIR, events, kinds, oscillator, scene_a, scene_d
from lapwing import (
    EventKind,
    MotionState,
    Status,
    TransmissionError,
    critical_torque,
    engaged_response,
    simulate,
)

pytestmark = pytest.mark.usefixtures("method")
ENGAGED_BIT = 1 << MotionState.ENGAGEMENT


@pytest.mark.parametrize(("change", "leaves"), [(1e-6, True), (-1e-6, False), (0.2, True)])
def test_rigid_harmonic_lets_go_above_gamma_one(method, change, leaves):
    # g'' of rk4's table is good to 1e-8 of its largest value, far inside the change of 1e-6; that
    # of the closed form to rounding.
    gamma = 1 + change
    osc = oscillator(TransmissionError.harmonic([1.0]), force=1 / gamma, period=2 * math.pi,
                     contact_law="rigid", damping_ratio=0.1)
    run = simulate(osc, "rest", cycles=20)
    assert (EventKind.RELEASE in kinds(run)) == leaves
    if leaves:
        # Left where F = g'' = -cos u first: u = π - arccos(1/Γ), up to the error of g'' over sin u.
        angle = math.pi - math.acos(1 / gamma)
        assert run.events["phase"].values[0] * 2 * math.pi == pytest.approx(
            angle, rel=0, abs={"rk4": 2e-8, "exact": 16 * EPS}[method] / math.sin(angle))
    else:
        assert kinds(run) == []
        assert run.final.motion_state == MotionState.ENGAGEMENT
        assert run.final.phi == run.final.phi_dot == 0


def test_rigid_torque_of_first_loss_of_the_25x32_pair():
    """T_on = i12·A·Ω²/(F/T_l) = 0.342724737180862 at A = 10 µrad and 80 rad/s."""
    for change, leaves in ((-1e-6, True), (1e-6, False)):
        osc = PAIR.oscillator(TransmissionError.harmonic([1e-5]), pinion_speed_rad_s=80,
                              brake_torque=0.342724737180862 * (1 + change), contact_law="rigid")
        assert (EventKind.RELEASE in kinds(simulate(osc, "rest", cycles=3))) == leaves


@pytest.mark.parametrize("force", [0.5, 10.0, 1e4])
def test_cusp_down_throws_a_rigid_tooth_off_at_any_force(force):
    te = TransmissionError.parabola(1.0)
    osc = oscillator(te, force=force, period=5.0, contact_law="rigid", restitution=0.3)
    run = simulate(osc, "rest", phase=0.5, cycles=0.6)
    assert kinds(run)[:2] == [EventKind.KINK, EventKind.RELEASE]
    # It leaves with the slope jump Δg' = 8A/P.
    assert run.events["velocity_after"].values[1] == pytest.approx(-8 / 5, rel=4 * EPS)
    assert run.events["tau"].values[:2] == pytest.approx(2.5, rel=4 * EPS)


def test_cusp_up_strikes_a_rigid_tooth():
    te = TransmissionError.parabola(-1.0)
    osc = oscillator(te, force=10.0, period=5.0, contact_law="rigid", restitution=0.3)
    run = simulate(osc, "rest", phase=0.5, cycles=0.6)
    assert kinds(run)[:3] == [EventKind.KINK, EventKind.IMPACT, EventKind.RELEASE]
    assert np.all(run.events["tau"].values[:3] == run.events["tau"].values[0])
    impact = events(run, EventKind.IMPACT)
    assert impact["velocity_before"][0] == pytest.approx(8 / 5, rel=4 * EPS)
    assert impact["velocity_after"][0] == pytest.approx(-0.3 * 8 / 5, rel=4 * EPS)


def test_sticking_and_bouncing_coexist_below_gamma_one():
    """Γ_SN < Γ < 1 with ε above (π-1)/(π+1): both motions, by the start alone."""
    restitution, gamma = 0.7, 0.8
    osc = oscillator(TransmissionError.harmonic([1.0]), force=1 / gamma, period=2 * math.pi,
                     restitution=restitution, contact_law="rigid", damping_ratio=0.1)
    assert kinds(simulate(osc, "rest", cycles=50)) == []
    angle = math.pi - math.asin(math.pi * 0.3 / 1.7 / gamma)
    speed = 2 * math.pi / gamma / 1.7
    run = simulate(osc, ("separation", 0.0, -restitution * speed), phase=angle / 2 / math.pi,
                   cycles=300)
    assert set(kinds(run)) == {EventKind.IMPACT} and len(kinds(run)) in (299, 300)


# --- engaged response -------------------------------------------------------------------------

SCENES = {"a_absolute": scene_a, "d": scene_d,
          "a_relative": lambda torque: scene_a(torque, "relative"),
          "a_compliant": lambda torque: scene_a(torque, "relative", contact_law="compliant")}


@pytest.mark.parametrize("damping_ratio", [0.0, 0.1, 1.0, 1.0 + 1e-9, 1.3])
@pytest.mark.parametrize("te", [
    TransmissionError.harmonic([1.0, 0.2], [0.0, 1.0], [1, 2]), TransmissionError.parabola(1.0),
    TransmissionError.from_hermite([0.1, 0.35, 0.8], [0.3, -0.2, 0.5], [1.0, 2.0, -1.0],
                                   [1.0, -3.0, 0.5])])
def test_engaged_motion_is_the_engaged_response(method, te, damping_ratio):
    """From a start on it, over three cycles: the Fourier gain, or the response to the table."""
    osc = oscillator(te, force=40.0, period=4.3, damping_ratio=damping_ratio)
    engaged = engaged_response(osc)
    assert engaged.minimum > 0
    start = ("engagement", float(engaged.penetration(0.6)), float(engaged.penetration(0.6, 1)))
    tau = np.linspace(0, 2.999 * 4.3, 200)
    expected = engaged.penetration(0.6 + tau / 4.3)
    if len(te.harmonics):
        order, amplitude, shift = te.harmonics.T
        rate = 2 * math.pi * order / 4.3
        wave = amplitude * rate**2 / (1 - rate**2 + 2j * damping_ratio * rate)
        angle = rate * (0.6 * 4.3 + tau[:, None]) + shift
        expected = 40.0 + (wave * np.exp(1j * angle)).sum(axis=1).real
        start = ("engagement", expected[0], (1j * rate * wave * np.exp(1j * angle[0])).sum().real)
    run = simulate(osc, start, phase=0.6, cycles=3, rtol=1e-12)
    # The closed form and the response round by EPS of φ some hundred times each; rk4 errs by some
    # rtol of φ a cycle, and sees a table of the harmonics good to 1e-12 of them.
    error = {"rk4": 4e-12, "exact": 200 * EPS}[method] * (40.0 + np.abs(engaged.minimum))
    found = run.history(tau)
    assert np.abs(found["phi"].values - expected).max() <= error
    assert set(kinds(run)) <= {EventKind.KINK}


@pytest.mark.parametrize("scene", SCENES)
def test_engaged_above_the_critical_torque_and_not_below(scene):
    build = SCENES[scene]
    torque, phase = critical_torque(build(1.0))
    # Rattling may coexist (model.md, section 9), so the start is the engaged motion itself.
    osc = build(torque * (1 + 1e-4))
    engaged = engaged_response(osc)
    start = ("engagement", float(engaged.penetration(0.5)), float(engaged.penetration(0.5, 1)))
    above = simulate(osc, start, phase=0.5, cycles=40)
    assert above.status == Status.OK
    assert not above.cycles["releases"].any() and not above.cycles["impacts"].any()
    assert set(above.cycles["states_visited"].values) == {ENGAGED_BIT}
    assert not above.cycles["deepest_separation"].any()

    end = above.final
    below = simulate(build(torque * (1 - 1e-3)), (end.motion_state, end.phi, end.phi_dot),
                     phase=end.phase, cycles=30)
    releases = events(below, EventKind.RELEASE)
    assert releases["tau"].size >= 1
    # The first loss is where the engaged motion dips below zero: around the critical phase, as
    # wide as a dip of 1e-3 F under curvature of the order of F: √(2e-3) of 1/ω'.
    width = 2 * math.sqrt(2e-3) / below.oscillator.period
    assert abs(releases["phase"][0] - phase) <= 5 * width


def test_the_published_smallest_torque():
    torque, phase = critical_torque(scene_a(1.0))
    assert torque == pytest.approx(11.91674543671654, rel=1e-12)
    assert phase == pytest.approx(0.951456732, abs=1e-9)
    # 12 N·m from rest: no separation at all.
    run = simulate(scene_a(12.0), "rest", cycles=40)
    assert not run.cycles["releases"].any()
    assert set(run.cycles["states_visited"].values) == {ENGAGED_BIT}
