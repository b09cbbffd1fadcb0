"""The bouncing ball inside the model: one impact every n cycles, exact (verification.md, 2).

Units: g = A cos u with A = 1, Ω = 1; Γ = AΩ²/F.  The law is `relative`, the coast flank far away.
Both methods' flights are exact.  With rk4 the harmonic table promises g' to 1e-10 of its largest
value, and the impact phase follows from g'; the closed form takes the cosine itself, so that
rounding is all the error there is: 8 EPS of the mesh period for each flight, summed by an orbit
whose multiplier is 0.97 at most.  Contact never matters; it is damped because at Ω = 1 without
damping its response, which the closed form begins with, would be infinite.
"""

import math

import numpy as np
import pytest

from helpers import EPS, events, kinds, oscillator
from lapwing import EventKind, MotionState, TransmissionError, simulate

PERIOD = 2 * math.pi
SLOPE_ERROR = {"rk4": 1e-10, "exact": 8 * EPS * PERIOD / (1 - 0.97)}
COSINE = TransmissionError.harmonic([1.0])
LAWS = ("restitution", "rigid")

pytestmark = pytest.mark.usefixtures("method")


def ball(gamma, restitution, contact_law="restitution", te=COSINE, **options):
    return oscillator(te, force=1 / gamma, period=PERIOD, restitution=restitution,
                      contact_law=contact_law, **{"damping_ratio": 0.1, **options})


def saddle_node(restitution, n=1):
    return n * math.pi * (1 - restitution) / (1 + restitution)


def period_doubling(restitution):
    bracket = 2 * (1 + restitution**2) / (1 + restitution) ** 2
    return math.hypot(saddle_node(restitution), bracket)


def orbit(gamma, restitution, n=1):
    """Impact angle (stable branch) and approach speed of the one-impact orbit."""
    angle = math.pi - math.asin(saddle_node(restitution, n) / gamma)
    return angle, n * PERIOD / gamma / (1 + restitution)


def fly(osc, angle, speed, cycles):
    """Run from just after an impact at mesh angle u with a relative separation speed."""
    return simulate(osc, ("separation", 0.0, -speed), phase=angle / PERIOD, cycles=cycles)


def last_impacts(run, n):
    impacts = events(run, EventKind.IMPACT)
    return {name: column[-n:] for name, column in impacts.items()}


@pytest.mark.parametrize("contact_law", LAWS)
@pytest.mark.parametrize(("gamma", "restitution", "n"), [
    (1.0, 0.7, 1), (1.16, 0.7, 1), (0.6, 0.7, 1), (1.2, 0.5, 1), (1.8, 0.3, 1), (3.5, 0.0, 1),
    (0.8, 0.8, 2), (0.9, 0.85, 3)])
def test_orbit_attracts_and_is_the_exact_one(method, contact_law, gamma, restitution, n):
    angle, speed = orbit(gamma, restitution, n)
    if (gamma, restitution, n) == (1.0, 0.7, 1):
        assert angle == pytest.approx(2.55395235536536, rel=1e-14)
    osc = ball(gamma, restitution, contact_law)
    # |λ| <= 0.97 per impact in all cases: 1e-2 falls below 1e-13 within 900 impacts.
    run = fly(osc, angle + 0.01, restitution * speed * 1.005, cycles=900 * n)
    found = last_impacts(run, 8)
    assert set(kinds(run)) == {EventKind.IMPACT}
    slack = 2 * SLOPE_ERROR[method] / abs(math.cos(angle))
    assert found["phase"] * PERIOD == pytest.approx(angle, rel=0, abs=slack)
    assert np.diff(found["tau"]) == pytest.approx(n * PERIOD, rel=1e-12)
    assert found["velocity_before"] == pytest.approx(speed, rel=2 * SLOPE_ERROR[method])
    assert found["velocity_after"] == pytest.approx(-restitution * speed,
                                                     rel=2 * SLOPE_ERROR[method])


@pytest.mark.parametrize("contact_law", LAWS)
def test_the_fixed_point_is_kept_from_the_first_impact(method, contact_law):
    angle, speed = orbit(1.0, 0.7)
    run = fly(ball(1.0, 0.7, contact_law), angle, 0.7 * speed, cycles=20)
    impacts = events(run, EventKind.IMPACT)
    # The start is off the table's own orbit by the table's error, which the focus (|λ| = ε)
    # does not amplify beyond the norm of its matrix, here below 5.
    assert np.abs(impacts["phase"] * PERIOD - angle).max() <= 5 * SLOPE_ERROR[method]


@pytest.mark.parametrize("contact_law", LAWS)
def test_multipliers_of_the_orbit(contact_law):
    """det = ε², trace = 1 + ε² - (1+ε)²·g''/F, from how a small deviation dies out."""
    gamma, restitution = 1.0, 0.7
    angle, speed = orbit(gamma, restitution)
    settled = last_impacts(fly(ball(gamma, restitution, contact_law), angle,
                               restitution * speed, 200), 1)
    fixed = settled["phase"][0] * PERIOD
    run = fly(ball(gamma, restitution, contact_law), fixed + 1e-5, restitution * speed, 12)
    deviation = events(run, EventKind.IMPACT)["phase"] * PERIOD - fixed
    # x_{k+2} = trace x_{k+1} - det x_k up to the square of the deviation, 1e-5 relative.
    rows = np.column_stack([deviation[1:8], -deviation[:7]])
    trace, det = np.linalg.lstsq(rows, deviation[2:9], rcond=None)[0]
    assert trace == pytest.approx(-0.915205998511699, abs=2e-4)
    assert det == pytest.approx(0.49, abs=2e-4)


@pytest.mark.parametrize("contact_law", LAWS)
@pytest.mark.parametrize(("restitution", "limit"), [(0.7, 0.554398703574669),
                                                    (0.8, 0.349065850399), (0.5, 1.0471975512)])
def test_existence_limit(contact_law, restitution, limit):
    assert saddle_node(restitution) == pytest.approx(limit, rel=1e-11)
    angle, speed = orbit(limit * 1.001, restitution)
    above = fly(ball(limit * 1.001, restitution, contact_law), angle, restitution * speed, 1000)
    assert len(above.events["kind"]) in (999, 1000, 1001)
    below = fly(ball(limit * 0.99, restitution, contact_law), angle, restitution * speed, 1000)
    # No orbit left: the ball falls behind, and what follows (chatter, or other orbits) has
    # another number of impacts.  The bottleneck 1 % below the limit is passed in some
    # π/√(0.01) = 31 cycles.
    assert abs(len(below.events["kind"]) - 1000) > 50 or EventKind.CHATTER_END in kinds(below)


@pytest.mark.parametrize("contact_law", LAWS)
@pytest.mark.parametrize("restitution", [0.0, 0.3, 0.5, 0.7, 0.8])
def test_period_doubling(contact_law, restitution):
    """Period 1 at 0.99 Γ_PD, period 2 at 1.01: not the high-bounce limit, up to 12 % lower."""
    critical = period_doubling(restitution)
    published = {0.0: 3.72419177824, 0.3: 2.12733368723, 0.5: 1.52682370052,
                 0.7: 1.17073117133009, 0.8: 1.07083646825}[restitution]
    assert critical == pytest.approx(published, rel=1e-11)
    spread = {}
    for factor in (0.99, 1.01):
        angle, speed = orbit(factor * critical, restitution)
        run = fly(ball(factor * critical, restitution, contact_law), angle + 1e-3,
                  restitution * speed, 1500)
        phase = last_impacts(run, 5)["phase"] * PERIOD
        assert np.abs(phase[2:] - phase[:-2]).max() < 1e-9
        spread[factor] = abs(phase[-1] - phase[-2])
    # Below, both are one point.  Above, the two points part as the square root of the distance,
    # √0.01 = 0.1 rad up to a factor.
    assert spread[0.99] < 1e-9
    assert 0.03 < spread[1.01] < 1.0


# --- parabola with one kink -------------------------------------------------------------------


def kinked(force, restitution, amplitude, **options):
    return oscillator(TransmissionError.parabola(amplitude), force=force, period=1.0,
                      restitution=restitution, **options)


@pytest.mark.parametrize("contact_law", LAWS)
@pytest.mark.parametrize("restitution", [0.5, 0.8])
@pytest.mark.parametrize("share", [1.05, 1.4])
def test_cusp_up_has_a_stable_orbit(contact_law, restitution, share):
    """A < 0, P = 1: impact at ½ - (F/16|A|)(1-ε)/(1+ε), stable for F above F_PD."""
    critical = 4 * (1 + restitution) ** 2 / (1 + restitution**2)
    force = share * critical
    border = 8 * (1 + restitution) / (1 - restitution)
    assert force < border
    phase = 0.5 - force / 16 * (1 - restitution) / (1 + restitution)
    speed = force / (1 + restitution)
    run = simulate(kinked(force, restitution, -1.0, contact_law=contact_law),
                   ("separation", 0.0, -restitution * speed * 1.001), phase=phase, cycles=600)
    found = last_impacts(run, 8)
    # One parabola, exact flights: rounding of a phase, amplified by 1/(1-|λ|) < 100.
    assert found["phase"] == pytest.approx(phase, rel=0, abs=100 * 8 * EPS)
    assert found["velocity_before"] == pytest.approx(speed, rel=100 * 8 * EPS)
    assert set(kinds(run)) == {EventKind.IMPACT, EventKind.KINK}


@pytest.mark.parametrize("contact_law", LAWS)
def test_cusp_up_period_doubling(contact_law):
    restitution = 0.7
    critical = 4 * (1 + restitution) ** 2 / (1 + restitution**2)
    left = {}
    for share in (0.99, 1.01):
        force = share * critical
        phase = 0.5 - force / 16 * (1 - restitution) / (1 + restitution)
        run = simulate(kinked(force, restitution, -1.0, contact_law=contact_law),
                       ("separation", 0.0, -restitution * force / (1 + restitution)),
                       phase=phase + 1e-6, cycles=1500)
        found = last_impacts(run, 2)["phase"]
        left[share] = np.abs(found - phase).max()
    # The map is linear between the kinks: below F_PD 1e-6 grows until it meets one.
    assert left[1.01] < 1e-12 < 1e-3 < left[0.99]


@pytest.mark.parametrize("contact_law", LAWS)
def test_cusp_down_has_only_saddles(contact_law):
    """A > 0: the trace 1 + ε² + (1+ε)²·8A/F exceeds 1 + det, so no one-impact orbit attracts."""
    force, restitution = 20.0, 0.7
    phase = 0.5 + force / 16 * (1 - restitution) / (1 + restitution)
    speed = force / (1 + restitution)
    run = simulate(kinked(force, restitution, 1.0, contact_law=contact_law),
                   ("separation", 0.0, -restitution * speed), phase=phase + 1e-9, cycles=6)
    deviation = np.abs(events(run, EventKind.IMPACT)["phase"] - phase)
    trace = 1 + restitution**2 + (1 + restitution) ** 2 * 8 / force
    multiplier = (trace + math.sqrt(trace**2 - 4 * restitution**2)) / 2
    assert multiplier > 1
    # After two impacts the stable direction (|λ| = 0.23) is 5 % of what is left.
    growth = deviation[2:5] / deviation[1:4]
    assert growth[1:] == pytest.approx(multiplier, rel=0.05)


def test_a_ball_that_comes_to_rest_is_engaged():
    run = fly(ball(0.5, 0.3), 1.0, 1e-3, 3)
    assert EventKind.CHATTER_END in kinds(run)
    assert run.final.motion_state in (MotionState.ENGAGEMENT, MotionState.SEPARATION)
