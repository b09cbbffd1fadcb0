"""Which method moves a scene, and that sweeps in closed form are single runs, byte for byte."""

import math

import numpy as np
import pytest

import lapwing
from helpers import EPS, FLAT, PAIR, SHIPPED, dataset_bytes, events, oscillator, scene_a, scene_d
from lapwing import EventKind, Status, TransmissionError, engine, simulate
from lapwing.base.arrivals import listed_impacts
from lapwing.deck.schema import NumericsKeys
from lapwing.engine import REST, Numerics, Wanted, calls

COSINE = TransmissionError.harmonic([1.0])
PARABOLA = TransmissionError.parabola(1.0)


def undamped(te, ratio, **options):
    return oscillator(te, **{"force": 2.0, "period": 2 * math.pi / ratio, "damping_ratio": 0.0,
                             "gap": "one_flank", **options})


# --- near an undamped resonance ---------------------------------------------------------------

# A harmonic of rate r is amplified r²/|1 - r²|, a table 1/|1 - exp(iP)|: 1000 is the limit.
HARMONIC_LIMIT = 1 / math.sqrt(1 - 1e-3)
TABLE_LIMIT = 1 / (1 + 2 * math.asin(0.5e-3) / (2 * math.pi))


@pytest.mark.parametrize(("te", "ratio", "method"), [
    (COSINE, 1.0, "rk4"), (COSINE, 1 + 1e-7, "rk4"), (COSINE, 1.01, "exact"),
    (COSINE, 1 + 0.999 * (HARMONIC_LIMIT - 1), "rk4"),
    (COSINE, 1 + 1.001 * (HARMONIC_LIMIT - 1), "exact"),
    (TransmissionError.harmonic([1.0, 0.1], [0.0, 0.0], [1, 3]), 1 / 3, "rk4"),
    (TransmissionError.harmonic([1.0, 0.0], [0.0, 0.0], [1, 3]), 1 / 3, "exact"),
    (PARABOLA, 1.0, "rk4"), (PARABOLA, 0.5, "rk4"), (PARABOLA, 0.7, "exact"),
    (PARABOLA, 1 + 0.999 * (TABLE_LIMIT - 1), "rk4"),
    (PARABOLA, 1 + 1.001 * (TABLE_LIMIT - 1), "exact"),
    (FLAT, 1.0, "exact")])
def test_auto_says_what_it_takes_and_exact_is_refused_where_digits_are_lost(te, ratio, method):
    osc = undamped(te, ratio)
    run = simulate(osc, cycles=2)
    assert run.method == method and run.status == Status.OK
    if method == "exact":
        assert simulate(osc, cycles=2, method="exact").final == run.final
    else:
        with pytest.raises(ValueError, match=r"'exact'.*resonance.*'rk4'"):
            simulate(osc, cycles=2, method="exact")
        same = simulate(osc, cycles=2, method="rk4")
        assert dataset_bytes(same.events) == dataset_bytes(run.events)


@pytest.mark.parametrize("te", [COSINE, PARABOLA])
def test_damping_leaves_no_resonance_to_fear(te):
    assert simulate(undamped(te, 1.0, damping_ratio=0.01), cycles=2).method == "exact"


@pytest.mark.parametrize("te", [COSINE, PARABOLA])
@pytest.mark.parametrize("ratio", [0.9995, 1.0006])
def test_what_is_not_refused_keeps_its_digits(te, ratio):
    """An amplification of up to 1000 costs three of sixteen digits; a tenfold growth one more.

    rk4 at 1e-13 is the witness, good to some 1e-12 mesh periods over these few cycles.
    """
    osc = undamped(te, ratio, force=5.0, contact_law="compliant")
    exact, steps = (simulate(osc, cycles=6, method=method, rtol=1e-13).events
                    for method in ("exact", "rk4"))
    assert exact["kind"].values.tolist() == steps["kind"].values.tolist()
    assert np.abs(exact["tau"].values - steps["tau"].values).max() <= 1e-10 * osc.period


SPEEDS = 8304.690530059534 / 25 * np.array([0.9, 1.0, 1.1])  # rad/s: Ω = 0.9, 1, 1.1


def speed_sweep(values, **options):
    return lapwing.sweep(lapwing.GearPair(25, 32, 0.0078, 0.026, 0.034, 3.12e8, 0.002, 0.8,
                                          damping_ratio=0.0),
                         TransmissionError.harmonic([1e-5]), parameter="pinion_speed_rad_s",
                         values=values, settle=3, record=4, threads=1, brake_torque=5.0,
                         starts=("rest", "up"), **options)


def test_a_sweep_of_the_speed_through_a_resonance_takes_one_method():
    through, by_steps = speed_sweep(SPEEDS), speed_sweep(SPEEDS, method="rk4")
    assert through.attrs["method"] == by_steps.attrs["method"] == "rk4"
    assert dataset_bytes(through) == dataset_bytes(by_steps)
    assert np.all(through["status"] == Status.OK)
    around = speed_sweep(SPEEDS[[0, 2]])
    assert around.attrs["method"] == "exact"
    assert dataset_bytes(around) == dataset_bytes(speed_sweep(SPEEDS[[0, 2]], method="exact"))
    with pytest.raises(ValueError, match="resonance"):
        speed_sweep(SPEEDS, method="exact")


# --- sweeps in closed form --------------------------------------------------------------------

HARMONIC = TransmissionError.harmonic([17e-6, 4.5e-6, 1.5e-6], [0.0, 1.0, 2.0], [1, 2, 3])
SCENES = {
    "table": (SHIPPED, {"pinion_speed_rpm": 240, "impact_law": "absolute"}),
    "table_relative": (SHIPPED, {"pinion_speed_rpm": 240}),
    "kinked_compliant": (TransmissionError.parabola(125e-6),
                         {"pinion_speed_rpm": 480, "contact_law": "compliant"}),
    "kinked_rigid": (TransmissionError.parabola(125e-6),
                     {"pinion_speed_rpm": 480, "contact_law": "rigid"}),
    "series": (HARMONIC, {"pinion_speed_rpm": 1500}),
    "series_rigid": (HARMONIC, {"pinion_speed_rpm": 1500, "contact_law": "rigid"}),
    "series_standing": (HARMONIC, {"pinion_speed_rpm": 1500, "back_flank_te": False}),
}
TORQUES = (0.6, 1.8, 3.0, 5.5, 12.1)


@pytest.mark.parametrize("scene", SCENES)
def test_a_sweep_is_its_single_runs_whatever_the_threads(scene):
    te, operation = SCENES[scene]
    one, two = (lapwing.sweep(PAIR, te, values=TORQUES, settle=10, record=8, threads=threads,
                              observe=("cycles", "impacts"), method="exact", **operation)
                for threads in (1, 2))
    assert one.attrs["method"] == "exact"
    assert dataset_bytes(one) == dataset_bytes(two)
    for torque in TORQUES:
        osc = PAIR.oscillator(te, brake_torque=torque, **operation)
        run = simulate(osc, cycles=18, method="exact")
        point = one.sel(start="rest", brake_torque=torque)
        for name in ("motion_state", "phi", "phi_dot", "impacts", "counted_impacts", "releases",
                     "chatter_ends", "deepest_separation", "deepest_back_penetration"):
            assert point[name].values.tobytes() == run.cycles[name].values[10:].astype(
                point[name].dtype).tobytes(), name
        impacts = run.events.where((run.events.kind <= 2) & (run.events.cycle >= 10), drop=True)
        listed = one.isel(impact=listed_impacts(point)[0])
        assert listed.impact_velocity.values.tobytes() == impacts.velocity_before.values.tobytes()
        assert listed.impact_phase.values.tobytes() == impacts.phase.values.tobytes()


@pytest.mark.parametrize("scene", SCENES)
def test_points_that_share_an_oscillator_are_as_points_of_their_own(scene):
    """What points have in common is prepared once where they differ in their force only.

    One more point with another restitution makes every point prepare its own.
    """
    te, operation = SCENES[scene]
    shared = [PAIR.oscillator(te, brake_torque=torque, **operation) for torque in TORQUES]
    odd = lapwing.GearPair(25, 32, 0.0078, 0.026, 0.034, 3.12e8, 0.002, 0.7, damping_ratio=0.1)
    own = [*shared, odd.oscillator(te, brake_torque=1.0, **operation)]
    results = [engine.sweep(
        points, [(i, i, False) for i in range(len(points))], [(REST, 0, 0, 0.0)] * len(points),
        numerics=Numerics(method="exact"), wanted=Wanted(cycles=True, strobe=True, impacts=True),
        settle=10, record=8, log_room=500, threads=1) for points in (shared, own)]
    n = len(shared)
    for name in ("outcome", "cycles", "kept", "logs"):
        both = [np.concatenate(result.logs()[:n]) if name == "logs" else getattr(result, name)[:n]
                for result in results]
        assert both[0].tobytes() == both[1].tobytes(), name
    assert not np.array_equal(results[1].cycles[n], results[1].cycles[0])


# --- the two methods on one scene -------------------------------------------------------------


@pytest.mark.parametrize("build", [lambda: scene_a(1.8), lambda: scene_a(5.5), lambda: scene_d(8.0),
                                   lambda: scene_d(8.0, contact_law="compliant")])
def test_the_methods_agree_on_a_stable_motion(build):
    """rk4 at rtol 1e-12 promises event times to some 1e-12 mesh periods; stable orbits keep it."""
    osc = build()
    runs = [simulate(osc, cycles=30, method=method, rtol=1e-12, chatter_tol=1e-13)
            for method in ("exact", "rk4")]
    ends = [events(run, EventKind.CHATTER_END, EventKind.ENGAGE, EventKind.RELEASE)["tau"]
            for run in runs]
    assert ends[0].size == ends[1].size
    assert ends[0].size > 0 or osc.impact_law == "absolute"
    assert np.all(np.abs(ends[0] - ends[1]) <= 1e-10 * osc.period)
    assert runs[0].final.motion_state == runs[1].final.motion_state
    assert runs[0].final.phi == pytest.approx(runs[1].final.phi, rel=0,
                                              abs=1e-10 * osc.angle_scale)
    assert np.abs(runs[0].cycles["phi"] - runs[1].cycles["phi"]).max() <= 1e-10 * osc.angle_scale
    assert 1e-10 * osc.angle_scale > EPS * osc.backlash


@pytest.mark.parametrize(("method", "rtol", "default"), [
    ("exact", 1e-10, 1e-13), ("exact", 1e-6, 1e-13), ("rk4", 1e-6, 1e-10), ("rk4", 1e-12, 1e-12)])
def test_chatter_tol_left_out_is_what_the_deck_says(method, rtol, default):
    """What the engine is handed is the number that docs/deck.md and `used.nml` state."""
    said = NumericsKeys.model_fields["chatter_tol"].description
    assert "1e-13 in closed form, min(rtol, 1e-10) with rk4" in said
    osc = scene_a(5.5, "relative")
    left_out, written, other = (
        calls.real_parameters(calls.Points.of([osc]), Numerics(method=method, rtol=rtol, **chosen),
                               method, Wanted()).ravel().tolist()
        for chosen in ({}, {"chatter_tol": default}, {"chatter_tol": 3e-5}))
    assert left_out == written != other
