"""Grazing: how a flank is met that is only just met (verification.md, section 7)."""

import math

import numpy as np
import pytest

from helpers import EPS, events, kinds, oscillator
from lapwing import EventKind, MotionState, TransmissionError, simulate

BACKLASH = 1.0
GRAZES = ("events", "cycles", "grazes")

pytestmark = pytest.mark.usefixtures("method")


def flight(force=1.0, **options):
    return oscillator(force=force, backlash=BACKLASH, period=10.0, **options)


def launched(osc, speed, cycles=0.7, **options):
    """A flight from the drive flank towards the coast flank, v² = 2Fθ0 just touches it."""
    return simulate(osc, ("separation", 0.0, -speed), cycles=cycles, **options)


@pytest.mark.parametrize("back_flank_te", [True, False])
@pytest.mark.parametrize("contact_law", ["restitution", "rigid", "compliant"])
def test_impact_speed_is_the_square_root_of_the_overlap(contact_law, back_flank_te):
    delta = 10.0 ** -np.linspace(3, 9, 13) * BACKLASH
    osc = flight(contact_law=contact_law, back_flank_te=back_flank_te)
    kind = EventKind.BACK_ENGAGE if contact_law == "compliant" else EventKind.BACK_IMPACT
    speed = np.sqrt(2 * (BACKLASH + delta))
    struck = np.array([-events(launched(osc, v), kind)["velocity_before"][0] for v in speed])
    # v_b = √(v1² - 2Fθ0): the launch speed's rounding, EPS, is magnified by (v1/v_b)² <= 1e9.
    assert np.allclose(struck, np.sqrt(speed**2 - 2 * BACKLASH), rtol=8 * EPS * 1e9, atol=0)
    # v = √(2δ)(1 + O(√δ)), exponent one half.
    slope = np.polyfit(np.log(delta), np.log(struck), 1)[0]
    assert slope == pytest.approx(0.5, abs=0.002)


WAVE = TransmissionError.harmonic([1.0])
LEAD = 0.1  # mesh periods from the start to the graze


def moving_flank(**options):
    return oscillator(WAVE, force=0.1, period=10.0, backlash=100.0, **options)


def passing(osc, at, offset, **options):
    """A flight whose distance to the drive flank has its least value, `offset`, at a phase.

    θ'' = F is followed back in closed form from there, so that the start is exact to rounding.
    """
    g, rate, bend = (float(WAVE.derivative(k, at)) / osc.period**k for k in range(3))
    assert bend > osc.force  # the flank's turn away is stronger than the force: a true graze
    s = LEAD * osc.period
    theta, velocity = g - offset - rate * s + osc.force * s**2 / 2, rate - osc.force * s
    start = ("separation", theta - float(WAVE.value(at - LEAD)),
             velocity - float(WAVE.slope(at - LEAD)) / osc.period)
    return simulate(osc, start, phase=at - LEAD, cycles=2 * LEAD, **options)


@pytest.mark.parametrize("contact_law", ["restitution", "rigid", "compliant"])
def test_impact_speed_on_a_moving_flank(method, contact_law):
    osc = moving_flank(contact_law=contact_law)
    kind = EventKind.ENGAGE if contact_law == "compliant" else EventKind.IMPACT
    delta = 10.0 ** -np.linspace(3, 9, 13)
    struck = [events(passing(osc, 0.47, -d), kind)["velocity_before"][0] for d in delta]
    slope = np.polyfit(np.log(delta), np.log(struck), 1)[0]
    assert slope == pytest.approx(0.5, abs=0.002)
    # Its coefficient: v = √(2aδ), a = g'' - F, up to O(√δ) from the third derivative.
    a = float(WAVE.curvature(0.47)) / osc.period**2 - osc.force
    assert struck[-1] == pytest.approx(math.sqrt(2 * a * 1e-9), rel=1e-4)


@pytest.mark.parametrize("contact_law", ["restitution", "rigid", "compliant"])
@pytest.mark.parametrize("sign", [1, -1])
def test_just_hit_and_just_missed(contact_law, sign):
    """±1e-9 θ0 about the touching orbit, at a flank at rest: decided rightly."""
    osc = flight(contact_law=contact_law)
    run = launched(osc, math.sqrt(2 * BACKLASH * (1 + sign * 1e-9)))
    back = [k for k in kinds(run) if k in (EventKind.BACK_IMPACT, EventKind.BACK_ENGAGE)]
    assert bool(back) == (sign > 0)


@pytest.mark.parametrize("offset", [1e-9, -1e-9])
@pytest.mark.parametrize("at", [0.43, 0.5, 0.58])
def test_just_hit_and_just_missed_on_a_moving_flank(method, at, offset):
    run = passing(moving_flank(), at, offset, observe=GRAZES, graze_distance=1e-8)
    if offset < 0:
        assert kinds(run)[0] == EventKind.IMPACT
    else:
        assert kinds(run) == [EventKind.NEAR_GRAZE]
        # θ and g are of order 1 and joined from some ten pieces: a few EPS each.
        assert run.events["phi"].values[0] == pytest.approx(-offset, rel=0, abs=64 * EPS)
        assert run.events["phase"].values[0] == pytest.approx(at, rel=0, abs=1e-12)


# --- near-grazes ------------------------------------------------------------------------------


@pytest.mark.parametrize("miss", [1e-3, 1e-6, 1e-9, 1e-12])
@pytest.mark.parametrize("back_flank_te", [True, False])
def test_near_graze_is_reported_with_its_closest_approach(miss, back_flank_te):
    osc = flight(back_flank_te=back_flank_te)
    speed = math.sqrt(2 * BACKLASH * (1 - miss))
    run = launched(osc, speed, observe=GRAZES, graze_distance=2 * miss)
    grazes = events(run, EventKind.BACK_NEAR_GRAZE)
    assert grazes["tau"].size == 1
    assert grazes["phi"][0] + BACKLASH == pytest.approx(miss, rel=0, abs=8 * EPS)
    # Position is stationary: its time is found to the root of rounding over curvature at worst,
    # as the root of the velocity to EPS.
    assert grazes["tau"][0] == pytest.approx(speed, rel=0, abs=16 * EPS * 10)
    assert abs(grazes["velocity_before"][0]) <= 16 * EPS * 10
    assert EventKind.BACK_IMPACT not in kinds(run)


def test_grazes_farther_than_asked_or_not_asked_are_silent():
    speed = math.sqrt(2 * BACKLASH * (1 - 1e-3))
    silent = (launched(flight(), speed, observe=GRAZES, graze_distance=0.9e-3),
              launched(flight(), speed, graze_distance=1.0))
    for run in silent:
        assert EventKind.BACK_NEAR_GRAZE not in kinds(run)


def test_default_distance_is_a_thousandth_of_the_angle_scale():
    for miss, reported in ((0.99e-3, True), (1.01e-3, False)):
        run = launched(flight(), math.sqrt(2 * BACKLASH * (1 - miss)), observe=GRAZES)
        assert (EventKind.BACK_NEAR_GRAZE in kinds(run)) == reported


def test_grazes_alone_can_be_recorded():
    run = launched(flight(), math.sqrt(2 * (1 - 1e-6)), observe=("grazes",), cycles=3)
    assert set(kinds(run)) == {EventKind.BACK_NEAR_GRAZE}


def test_contact_that_nearly_ends_is_a_near_graze(method):
    """Compliant, undamped: φ = F + (φ0 - F) cos τ turns back at 2F - φ0, just above zero."""
    osc = oscillator(contact_law="compliant", restitution=1.0, period=100.0)
    run = simulate(osc, ("engagement", 2.0 - 1e-4, 0.0), cycles=0.2, observe=GRAZES,
                   graze_distance=2e-4, rtol=1e-10)
    assert set(kinds(run)) == {EventKind.NEAR_GRAZE}
    # Minima at odd multiples of π; with rk4 φ is good to rtol mesh periods times φ' <= 1, in closed
    # form to rounding; times at a stationary point to the error of φ' over φ'' = 1, here of τ.
    found = events(run, EventKind.NEAR_GRAZE)
    slack = {"rk4": 1e-8, "exact": 8 * EPS * 20}[method]
    assert found["phi"] == pytest.approx(1e-4, rel=0, abs=slack)
    assert found["tau"] == pytest.approx(math.pi * np.arange(1, 7, 2), rel=0, abs=slack)
    assert run.final.motion_state == MotionState.ENGAGEMENT


def test_a_bounce_is_no_near_graze():
    """Departures and arrivals at a flank are near it, but turn nowhere."""
    run = simulate(flight(restitution=1.0), ("separation", -0.5, 0.0), cycles=5, observe=GRAZES,
                   graze_distance=0.1)
    assert set(kinds(run)) == {EventKind.IMPACT}
