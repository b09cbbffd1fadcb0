"""Amplitudes and forces over a sweep: against the engaged response, and against a response."""

import numpy as np
import pytest

from helpers import PAIR, SHIPPED, scene_a
from lapwing import Status, TransmissionError, engaged_response, sweep
from lapwing.studies.response.run import response
from lapwing.studies.sweep.amplitudes import CYCLES, NAMES, SAMPLES

SMOOTH = TransmissionError.harmonic([17e-6, 4.5e-6, 1.5e-6], [0.0, 1.0, 2.0], [1, 2, 3])
OBSERVE = ("cycles", "amplitudes")


def found(values, te=SHIPPED, **options):
    options = {"settle": 100, "record": 20, "observe": OBSERVE, "starts": ("rest",), **options}
    return sweep(PAIR, te, values=values, **options)


@pytest.mark.parametrize("phase", [0.0, 0.3])
def test_engaged_teeth_follow_the_linear_response(phase):
    """Of 30 N·m at 2000 rpm the response is known in closed form; so are rms and peak to peak."""
    data = found([2000.0], SMOOTH, parameter="pinion_speed_rpm", brake_torque=30.0, phase=phase,
                 settle=300)
    osc = PAIR.oscillator(SMOOTH, brake_torque=30.0, pinion_speed_rpm=2000.0)
    at = np.arange(SAMPLES) / SAMPLES
    phi = engaged_response(osc).penetration(at)
    theta = phi + osc.flank_scale * SMOOTH.derivative(0, at)
    rate = engaged_response(osc).penetration(at, 1)
    newton = PAIR.mesh_stiffness * PAIR.pinion_base_lever
    force = newton * (phi + 2 * osc.damping_ratio * rate)
    expected = [phi.std(), np.ptp(phi), theta.std(), np.ptp(theta), newton * osc.force,
                force.max()]
    # After 300 cycles nothing is left of the transient. The peak of the force lies between samples
    # here: of three harmonics, they miss (3π/400)²/2 of its swing at most.
    for name, value in zip(NAMES, expected, strict=True):
        assert float(data[name][0, 0]) == pytest.approx(
            value, rel=3e-4 if name == "mesh_force_peak" else 1e-10), name


def test_forces_are_those_of_a_response():
    data = found([1.8, 3.3, 12.0], pinion_speed_rpm=240, impact_law="absolute", settle=400)
    for i, torque in enumerate((1.8, 3.3, 12.0)):
        attrs = response(scene_a(torque), PAIR, name="a", record=20).attrs
        for name in ("mesh_force_mean", "mesh_force_peak"):
            assert float(data[name][0, i]) == pytest.approx(attrs[name], rel=1e-6)
        # The displacement goes from the deepest separation into the flank.
        assert float(data["phi_peak_to_peak"][0, i]) > attrs["deepest_separation"] * (1 - 1e-3)


def test_a_motion_of_period_two_is_seen_whole():
    data = found([11.5], pinion_speed_rpm=240, impact_law="absolute", settle=400)
    assert int(data["period"][0, 0]) == 2
    run = response(scene_a(11.5), PAIR, name="a", record=20)
    phi = run["phi"].values
    assert float(data["phi_rms"][0, 0]) == pytest.approx(phi.std(), rel=1e-6)
    assert float(data["dynamic_te_peak_to_peak"][0, 0]) == pytest.approx(
        np.ptp(run["dynamic_te"].values), rel=1e-6)


def test_the_force_knows_the_stiffness_that_is_swept():
    data = found([1e8, 3.12e8], SMOOTH, parameter="mesh_stiffness", brake_torque=30.0,
                 pinion_speed_rpm=200.0)
    # Engaged throughout: the mean force is the torque over the lever, whatever the stiffness.
    assert data["mesh_force_mean"].values[0] == pytest.approx(
        30 / (PAIR.gear_ratio * PAIR.pinion_base_lever), rel=1e-9)


def test_rigid_teeth_have_no_force_and_failed_points_nothing():
    data = found([5.0], pinion_speed_rpm=240, contact_law="rigid")
    assert np.isnan(data["mesh_force_mean"].values).all()
    assert np.isfinite(data["dynamic_te_rms"].values).all()
    broken = found([0.6, 12.0], pinion_speed_rpm=240, impact_law="absolute",
                   max_events_per_cycle=3)
    assert list(broken["status"].values[0] == Status.OK) == [False, True]
    for name in NAMES:
        assert list(np.isfinite(broken[name].values[0])) == [False, True]


def test_chaos_is_looked_at_over_many_cycles_and_any_threads_agree():
    one, two = (found([0.8, 1.0], pinion_speed_rpm=240, impact_law="absolute", threads=n)
                for n in (1, 2))
    assert CYCLES > 8 and not one["period"].values.any()
    for name in NAMES:
        assert one[name].values.tobytes() == two[name].values.tobytes()


def test_amplitudes_want_cycles():
    with pytest.raises(ValueError, match="'amplitudes' wants 'cycles' beside it"):
        found([1.0], observe=("amplitudes",), pinion_speed_rpm=240)
