"""Shares of time, impact speeds and energies of a response, against what its events say."""

import math

import numpy as np
import pytest

from helpers import EPS, PAIR, oscillator, scene_a
from lapwing import EventKind, MotionState
from lapwing.engine import Numerics
from lapwing.engine.records import CYCLE_TABLE, EVENT_TABLE, TANGENT_TABLE
from lapwing.studies.response.motion import (
    SHARES,
    fastest_arrivals,
    impact_attributes,
    motion_attributes,
    shares_of_time,
)
from lapwing.studies.response.run import response

SHORT = {"settle": 60, "record": 30, "samples_per_cycle": 400, "rtol": 1e-8}


def rows(*lines):
    """Log lines: kind, cycle, t, phi, before, after."""
    return np.array([(kind, cycle, t, 0.0, before, after, np.nan)
                     for kind, cycle, t, before, after in lines], dtype=EVENT_TABLE)


def test_shares_of_a_made_up_log():
    log = rows((EventKind.RELEASE, 0, 1.0, -1, -1), (EventKind.IMPACT, 0, 2.0, 1, -0.5),
               (EventKind.CHATTER_END, 0, 3.0, 0, 0), (EventKind.KINK, 0, 3.5, 0, 0),
               (EventKind.RELEASE, 1, 0.5, 0, 0), (EventKind.BACK_IMPACT, 1, 1.0, -1, -0.1),
               (EventKind.BACK_ENGAGE, 1, 1.0, -0.1, -0.1), (EventKind.BACK_RELEASE, 1, 3.0, 1, 1))
    found = shares_of_time(log, np.array([1.0, 1.0, 0.0, np.nan]), 4.0)
    assert found["time_separated"][:3].tolist() == [0.5, 0.375, 1.0]
    assert found["time_engaged"][:3].tolist() == [0.5, 0.125, 0.0]
    assert found["time_back_engaged"][:3].tolist() == [0.0, 0.5, 0.0]
    assert all(math.isnan(found[key][3]) for key in SHARES)


def test_speeds_and_energies_of_a_made_up_log():
    log = rows((EventKind.IMPACT, 0, 2.0, 1.0, -0.5), (EventKind.BACK_IMPACT, 2, 1.0, -3.0, 1.0))
    assert fastest_arrivals(log, 3, 10.0, "restitution").tolist() == [10.0, 0.0, 30.0]
    osc = oscillator(force=2.0)
    found = impact_attributes(osc, PAIR, log, 7.0)
    assert found["impact_speed_mean"] == pytest.approx(2 * PAIR.natural_frequency, rel=4 * EPS)
    assert found["energy_per_impact"] == pytest.approx(
        0.5 * PAIR.torsional_stiffness * (0.75 + 8) / 2, rel=4 * EPS)
    assert found["dynamic_factor"] == pytest.approx(
        3.5 / (PAIR.mesh_stiffness * PAIR.pinion_base_lever), rel=4 * EPS)
    assert impact_attributes(osc.with_force(0.0), PAIR, rows(), 7.0) == {}
    assert impact_attributes(osc, PAIR, rows(), math.nan) == {}


@pytest.mark.parametrize(("torque", "options"), [
    (1.8, {}), (5.5, {"impact_law": "relative"}), (0.4, {"back_flank_te": False}),
    (5.5, {"impact_law": "relative", "contact_law": "compliant"})])
def test_shares_agree_with_the_samples(torque, options):
    """The share of samples in a state, which errs by one sample per change of state."""
    data = response(scene_a(torque, **options), PAIR, name="x", **SHORT)
    for state, key in zip(MotionState, SHARES, strict=True):
        sampled = float(np.mean(data["motion_state"].values == state))
        changes = sum(int((data[f"cycle_{name}"]).sum()) for name in (
            "releases", "back_releases", "engages", "back_engages", "chatter_ends"))
        assert data.attrs[key] == pytest.approx(sampled, abs=max(changes, 1) / 30 / 400)
    total = sum(data.attrs[key] for key in SHARES)
    assert total == pytest.approx(1, rel=1e-12)


def test_mean_force_is_that_of_the_contact_alone():
    """Energy per impact times impacts is the energy per cycle; every number has its error."""
    data = response(scene_a(3.3), PAIR, name="x", **SHORT).attrs
    assert data["energy_per_impact"] * data["resolved_impacts_per_cycle"] == pytest.approx(
        data["impact_energy_per_cycle"], rel=1e-12)
    assert data["impact_speed_max"] > data["impact_speed_mean"] > 0
    assert data["impact_speed_max_error"] < 1e-6 * data["impact_speed_max"]
    engaged = response(scene_a(14), PAIR, name="x", **SHORT).attrs
    assert engaged["time_engaged"] == 1 and "impact_speed_mean" not in engaged
    # Without impacts the torques' own force is the mean of spring and damper.
    assert engaged["mesh_force_peak"] / engaged["dynamic_factor"] == pytest.approx(
        engaged["mesh_force_mean"], rel=1e-6)


def test_a_period_that_newton_does_not_find_is_said_so():
    """Lines of a made-up recording: states that are no orbit of this oscillator."""
    class Recording:
        cycles = np.zeros(30, CYCLE_TABLE)
        cycles["phi"], cycles["deepest_separation"], cycles["states_visited"] = -1e-3, 1e-3, 1
        tangent = np.zeros(30, TANGENT_TABLE)
        tangent["matrix"], tangent["log_det"] = 0.5 * np.eye(2), math.log(0.25)
        tangent["det_sign"], tangent["rank"], tangent["graze_depth"] = 1, 2, 1e300

    found = motion_attributes(scene_a(1.0), Recording, 5, 24, Numerics(rtol=1e-8))
    assert found["orbit_period"] == 0 and "orbit_distance" not in found
    # A double root is right to the square root of rounding.
    assert found["multiplier_real"] == pytest.approx([0.5**5] * 2, rel=1e-7)
