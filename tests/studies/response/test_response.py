"""One operating point: forces and energies against the averaged equations, errors, failures."""

import numpy as np
import pytest

from helpers import PAIR, dataset_bytes, oscillator, scene_a, scene_c, scene_d
from lapwing import EventKind, MotionState, Status, simulate
from lapwing.studies.response.run import response

NEWTON = PAIR.mesh_stiffness * PAIR.pinion_base_lever
# Mean of a cubic Hermite quadrature against the exact one, part of the largest force: h⁴/720 for
# an oscillation of unit frequency, and the cases below have none faster.
QUADRATURE = 1e-11
SHORT = {"settle": 60, "record": 24, "samples_per_cycle": 64}


def run(osc, **options):
    return response(osc, PAIR, name="case", **{**SHORT, **options})


def static_force(osc):
    """k'·lever·F, N."""
    return NEWTON * osc.force


@pytest.mark.parametrize("osc", [scene_a(12), scene_c(12), scene_d(13),
                                 scene_d(13, contact_law="compliant")])
def test_mean_force_of_an_engaged_motion_is_the_static_force(osc):
    found = run(osc).attrs
    assert found["fully_engaged"] == 1
    assert found["motion_class"] == "1:(0,0)"
    assert abs(found["mesh_force_mean"] - static_force(osc)) < QUADRATURE * found["mesh_force_peak"]
    assert found["impact_energy_per_cycle"] == 0


@pytest.mark.parametrize("back_flank_te", [True, False])
def test_coast_contact_pushes_the_other_way(back_flank_te):
    osc = scene_a(-60, "relative", back_flank_te=back_flank_te)
    data = run(osc)
    assert data.attrs["states_visited"] == 1 << MotionState.BACK_ENGAGEMENT
    error = data.attrs["mesh_force_mean"] - static_force(osc)
    assert abs(error) < QUADRATURE * data.attrs["mesh_force_peak"]
    assert float(data["mesh_force"].mean()) < 0
    if not back_flank_te:  # nothing shakes a tooth that lies on a flank at rest
        assert data.attrs["mesh_force_peak"] == pytest.approx(-static_force(osc), rel=1e-9)
    assert data.attrs["deepest_back_penetration"] > 0


@pytest.mark.parametrize("osc", [scene_a(1.8), scene_a(5.5), scene_d(8.0), scene_d(5.5)])
def test_contact_and_impacts_together_carry_the_static_force(osc):
    """Bounces of a chatter shorter than 1e-7 periods are not listed; their push is left out."""
    found = run(osc, settle=400).attrs
    assert found["period"] > 0
    pressing = osc.force + osc.gear_ratio * np.abs(osc.te.curvature(osc.te.knots)).max() \
        / osc.period**2
    unlisted = 1e-7 * NEWTON * pressing
    total = found["mesh_force_mean"] + found["impact_force_mean"]
    assert abs(total - static_force(osc)) < unlisted + QUADRATURE * found["mesh_force_peak"] * 10


@pytest.mark.parametrize("osc", [
    scene_a(0.8), scene_a(0.3, "relative", back_flank_te=False),
    scene_c(0.3, contact_law="compliant"), scene_d(0.05, contact_law="compliant"),
    scene_d(0.05, contact_law="compliant", back_flank_te=False),
    scene_d(2.0), scene_a(1.8, "relative")])
def test_momentum_balance_of_every_cycle(osc):
    """Chaos, both flanks: forces of each cycle against the change of φ' (g' is that of phase 0)."""
    data = run(osc, record=100)
    change = np.diff(data["cycle_phi_dot"].values) / osc.period
    force = (data["cycle_mesh_force_mean"] + data["cycle_impact_force_mean"]).values[:-1]
    error = np.abs(force - NEWTON * (osc.force - change))
    pressing = abs(osc.force) + osc.gear_ratio * np.abs(osc.te.curvature(osc.te.knots)).max() \
        / osc.period**2
    peak = data.attrs["mesh_force_peak"] + NEWTON * osc.angle_scale
    assert error.max() < 1e-7 * NEWTON * pressing + 10 * QUADRATURE * peak
    assert np.abs(change).max() > 1e3 * error.max() / NEWTON or data.attrs["period"] == 1


def test_energy_balance_over_a_period():
    """What the flank puts in goes into the damper and the impacts (relative law, chatter).

    0 = Σ½(v₋² - v₊²) + Σ g'(v₋ - v₊) + 2ξ∫φ'² + ∫W g', the integrals over contact.  Integrated by
    the trapezium rule; each of the three places where the integrand jumps (release, kink, end of
    chatter) costs at most one spacing times its size.
    """
    osc, n = scene_d(8.0), 16_000
    data = run(osc, record=9, settle=200, samples_per_cycle=n)
    one = data.isel(sample=slice(0, n + 1))
    slope = osc.flank_scale / osc.period * osc.te.slope(one["phase"].values)
    contact = one["motion_state"].values == MotionState.ENGAGEMENT
    power = np.where(contact, 2 * osc.damping_ratio * one["phi_dot"].values**2
                     + one["mesh_force"].values / NEWTON * slope, 0)
    spacing = osc.period / n
    first = data.isel(event=data["event_cycle"].values == 0)
    hits = first.isel(event=first["event_kind"].values == EventKind.IMPACT)
    jump = (hits["velocity_before"] - hits["velocity_after"]).values
    flank = osc.flank_scale / osc.period * osc.te.slope(hits["event_phase"].values)
    lost = float(hits["impact_energy"].sum())
    total = lost / PAIR.torsional_stiffness + jump @ flank + spacing * power[:n].sum()
    assert abs(total) < 3 * spacing * np.abs(power).max()
    assert lost > 100 * PAIR.torsional_stiffness * abs(total)  # the check is not an empty one
    assert data.attrs["impact_energy_per_cycle"] == pytest.approx(lost, rel=1e-6)


def test_history_and_events_are_those_of_simulate():
    """At a start phase above 0, too; recording begins with the first whole cycle."""
    osc = scene_a(3.3)
    data = run(osc, phase=0.25, settle=5, record=6, rtol=1e-10)
    assert data.attrs["first_cycle"] == 6
    whole = simulate(osc, phase=0.25, cycles=12, rtol=1e-10)
    first = whole.cycles.sel(cycle=slice(6, 11))
    np.testing.assert_array_equal(data["cycle_phi"], first["phi"])
    np.testing.assert_array_equal(data["cycle_counted_impacts"], first["counted_impacts"])
    inside = (whole.events["cycle"] >= 6) & (whole.events["cycle"] < 12)
    np.testing.assert_array_equal(data["event_phase"], whole.events["phase"][inside])
    taus = (6 + data["sample_cycle"].values + data["phase"].values - 0.25) * osc.period
    history = whole.history(taus)
    # The times differ by rounding, a few ulp of 12 periods.
    speed = np.abs(data["phi_dot"]).max().item()
    slack = 4 * 12 * osc.period * np.finfo(float).eps * speed
    assert np.abs(history["phi"].values - data["phi"].values).max() < slack
    np.testing.assert_allclose(data["time"], (data["sample_cycle"] + data["phase"]) * 0.01,
                               rtol=1e-14)
    np.testing.assert_array_equal(
        data["dynamic_te"], data["phi"] + osc.flank_scale * osc.te.value(data["phase"].values))


def test_an_impact_counts_with_the_flight_before_recording():
    """A fall from 1 lasts √2; at 1.41, where recording begins, 1 - 1.41²/2 = 0.006 is left of it.

    That is less than 1 % of the rebound's height, ε² = 0.64, but the flight was 1 deep.
    """
    data = run(oscillator(period=1.41), start=("separation", -1.0, 0.0), settle=1,
               record=1)
    assert data["cycle_deepest_separation"].item() == pytest.approx(0.64, rel=1e-9)
    assert data["cycle_counted_impacts"].item() == data["cycle_impacts"].item() == 1


def test_peak_force_does_not_hang_on_the_samples_stored():
    peaks = [run(scene_a(5.5), samples_per_cycle=n).attrs["mesh_force_peak"] for n in (8, 400)]
    assert peaks[0] == pytest.approx(peaks[1], rel=1e-11)
    stored = run(scene_a(5.5), samples_per_cycle=4000)["mesh_force"].max().item()
    assert stored <= peaks[1] * (1 + 1e-9)
    # Samples 0.02 apart miss an extremum of unit frequency by at most 0.01²/2 of the swing.
    assert stored == pytest.approx(peaks[1], rel=4 * 0.01**2)


def test_the_error_estimate_bounds_the_error():
    """Against a run at 1e-12; the loose run's own difference to 1e-7 leaves 1 % of it out."""
    loose = run(scene_a(3.3), method="rk4", rtol=1e-5).attrs
    tight = run(scene_a(3.3), method="rk4", rtol=1e-11).attrs
    assert loose["error_kind"] == tight["error_kind"] == "convergence"
    assert tight["rtol_reference"] == pytest.approx(1e-13, rel=1e-9, abs=0)
    for key in ("deepest_separation", "mesh_force_peak", "impact_energy_per_cycle"):
        actual = abs(loose[key] - tight[key])
        assert 0.5 * loose[f"{key}_error"] <= actual <= 2 * loose[f"{key}_error"]
        assert tight[f"{key}_error"] < 1e-3 * loose[f"{key}_error"]


def test_below_the_tightest_tolerance_the_other_run_is_looser():
    assert run(scene_a(12), rtol=5e-13, settle=1, record=2).attrs["rtol_reference"] \
        == pytest.approx(5e-11)


def test_transient_shows_what_has_not_settled():
    early = run(scene_c(12), settle=0, record=8).attrs
    late = run(scene_c(12)).attrs
    assert abs(early["mesh_force_mean_transient"]) > 1e-3 * early["mesh_force_mean"]
    # 60 periods of 13 in τ damped with 0.1: e^-80.
    assert abs(late["mesh_force_mean_transient"]) < 1e-10 * late["mesh_force_mean"]


def test_motion_without_a_period_is_compared_by_its_statistics():
    found = run(scene_a(0.8), settle=100, record=80).attrs
    assert found["period"] == 0
    assert found["motion_class"] == "no period"
    assert found["error_kind"] == "statistical"
    assert found["mesh_force_mean_transient"] != 0


def test_averages_are_over_whole_periods():
    """Period 2 in 25 cycles: the last 24 count, so that each cycle of the pair weighs the same."""
    data = run(scene_d(5.5), settle=400, record=25)
    assert data.attrs["motion_class"].startswith("2:(")
    assert data.attrs["motion_class"].endswith("c")
    counted = data["cycle_counted_impacts"].values
    assert data.attrs["impacts_per_cycle"] == counted[-24:].mean()
    assert data.attrs["impacts_per_cycle_transient"] == 0


def test_a_failed_run_keeps_its_place():
    data = run(scene_a(1.8), max_steps_per_cycle=3)
    assert data.attrs["status"] == Status.TOO_MANY_STEPS
    assert data.attrs["status_meaning"] == "too_many_steps"
    assert data.attrs["motion_class"] == "failed"
    assert data.sizes == {"sample": 24 * 64, "event": 0, "cycle": 24}
    for key in ("phi", "mesh_force", "cycle_deepest_separation", "cycle_mesh_force_peak"):
        assert np.isnan(data[key]).all()
    for key in ("impacts_per_cycle", "mesh_force_mean", "mesh_force_peak_error"):
        assert np.isnan(data.attrs[key])
    assert (data["motion_state"] == -1).all()
    assert data.attrs["fully_engaged"] == 0


def test_rigid_contact_has_no_spring_force():
    data = run(scene_d(8.0, contact_law="rigid"))
    assert np.isnan(data["mesh_force"]).all()
    assert np.isnan(data.attrs["mesh_force_mean"])
    assert data.attrs["impact_energy_per_cycle"] > 0


def test_without_restitution_arrivals_are_counted():
    data = run(scene_d(5.5, contact_law="compliant"), settle=200)
    assert data.attrs["impacts_per_cycle"] == data["cycle_engages"].values.mean() > 0


def test_claims_are_kept_and_repeats_are_bit_identical():
    options = {"claim_impacts_per_cycle": 3.0, "claim_text": "3 impacts", "order": 2}
    one, two = (run(scene_a(1.8), **options) for _ in range(2))
    assert one.attrs["claim_impacts_per_cycle"] == 3.0
    assert "claim_deepest_separation" not in one.attrs
    assert one.attrs["brake_torque"] == pytest.approx(1.8, rel=1e-15)
    assert dataset_bytes(one) == dataset_bytes(two)
    assert one.attrs == two.attrs


@pytest.mark.parametrize(("wrong", "message"), [
    ({"record": 0}, "record = 0"), ({"settle": -1}, "settle = -1"),
    ({"samples_per_cycle": 2.5}, "samples_per_cycle = 2.5"), ({"phase": 1.0}, "phase = 1.0"),
    ({"start": ("separation", 1.0, 0.0)}, "contradicts"), ({"rtol": 1.0}, "rtol = 1.0")])
def test_refusals(wrong, message):
    with pytest.raises(ValueError, match=message):
        run(scene_a(1.8), **wrong)
