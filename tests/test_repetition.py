"""Cycles that are copied instead of computed: the same bytes, and no end to how far they lead."""

from dataclasses import fields

import numpy as np
import pytest

from helpers import oscillator, scene_a, scene_c, scene_d
from lapwing import MotionState, TransmissionError, engine, simulate
from lapwing.engine import Numerics, Wanted

SCENES = {
    "published": [scene_a(torque) for torque in (0.6, 1.8, 5.5, 12.0)],
    "relative": [scene_a(torque, "relative") for torque in (0.6, 5.5)],
    "smooth": [scene_c(torque) for torque in (3.0, 7.0)],
    "compliant": [scene_c(torque, contact_law="compliant") for torque in (3.0, 7.0, 20.0)],
    "kinked": [scene_d(torque) for torque in (3.0, 5.5, 8.0)],
    "rigid": [scene_d(torque, contact_law="rigid") for torque in (5.5, 8.0)],
}
# Near-grazes are never dropped: a full log would be waited for.
ROOM = 20_000
EVERYTHING = Wanted(impacts=True, grazes=True, strobe=True, cycles=True, tangent=True,
                    graze_distance=1e-7, speed_edges=tuple(np.geomspace(1e-9, 1e-3, 20)))


def run(oscillators, method, copy_repeats, wanted=EVERYTHING, settle=60):
    n = len(oscillators)
    return engine.sweep(
        oscillators, [(i, i, False) for i in range(n)], [(engine.REST, 0.0, 0.0, 0.3)] * n,
        numerics=Numerics(method=method, rtol=1e-6, copy_repeats=copy_repeats), wanted=wanted,
        settle=settle, record=40, log_room=ROOM, threads=1)


@pytest.mark.parametrize("scene", SCENES)
@pytest.mark.parametrize("method", ["exact", "rk4"])
def test_same_bytes(scene, method):
    copied, computed = (run(SCENES[scene], method, copy) for copy in (True, False))
    for field in fields(copied):
        one, other = getattr(copied, field.name), getattr(computed, field.name)
        if isinstance(one, np.ndarray):
            assert one.tobytes() == other.tobytes(), field.name
    assert np.all(copied.outcome["status"] == 0)


def test_log_in_portions():
    """A log that is emptied again and again holds the same lines."""
    osc = scene_a(5.5)
    short, long = (simulate(osc, cycles=n) for n in (300, 600))
    n = len(short.events["tau"])
    assert n > 1000
    for name in ("kind", "cycle", "phi", "velocity_before"):
        assert np.array_equal(short.events[name].values, long.events[name].values[:n])
    assert np.all(np.diff(long.events["tau"].values) >= 0)


def test_far_ahead():
    """Nothing but a copied round reaches the end of so long a run."""
    osc = oscillator(TransmissionError.harmonic([1e-3]), force=1.0, period=5.0, damping_ratio=0.3,
                     contact_law="compliant")
    end = simulate(osc, cycles=1_000_000_000, observe=()).final
    near = simulate(osc, cycles=1_000, observe=()).final
    assert end.motion_state == MotionState.ENGAGEMENT
    assert (end.phi, end.phi_dot) == (near.phi, near.phi_dot)


def test_samples_and_cut_runs():
    """A history across copied cycles, and a run cut anywhere, see the same motion."""
    osc = scene_a(8.0)
    times = np.array([0.5, 7.25, 151.0, 151.5, 399.75]) * osc.period
    whole = simulate(osc, cycles=400)
    phi = whole.history(times)["phi"].values
    for tau, sampled in zip(times, phi, strict=True):
        cut = simulate(osc, cycles=tau / osc.period)
        assert cut.final.phi == pytest.approx(sampled, rel=1e-12)
        rest = simulate(osc, cut.final, cycles=400 - tau / osc.period)
        assert rest.final.phi == whole.final.phi
        assert len(cut.events["tau"]) + len(rest.events["tau"]) == len(whole.events["tau"])
