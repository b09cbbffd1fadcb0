"""Energy and periods of the undamped oscillator (verification.md, section 5)."""

import math

import numpy as np
import pytest

import lapwing
from helpers import EPS, events, kinds, oscillator
from lapwing import EventKind, simulate

pytestmark = pytest.mark.usefixtures("method")
IMPACTS = (EventKind.IMPACT, EventKind.BACK_IMPACT)


def elastic(**options):
    return oscillator(**{"restitution": 1.0, "damping_ratio": 0.0, **options})


# --- flight -----------------------------------------------------------------------------------


@pytest.mark.parametrize("height", [1.0, 0.5, 0.3, 2.7])
@pytest.mark.parametrize("period", [10.0, 7.3, 1e5])
def test_bouncing_keeps_its_energy(period, height):
    """10⁴ bounces: |ΔE/E| < 1e-12, no trend.

    Rounding of one bounce is below 2 EPS of the energy; 10⁴ of them add up as a random walk to
    100·2 EPS = 4e-14, as a trend to 4e-12.  1e-12 tells one from the other.
    """
    speed = math.sqrt(2 * height)
    osc = elastic(period=period, gap="one_flank")
    run = simulate(osc, ("separation", -height, 0.0), cycles=20_000 * speed / period,
                   observe=("events",))
    impacts = events(run, EventKind.IMPACT)
    assert set(kinds(run)) == {EventKind.IMPACT} and impacts["tau"].size >= 9_999
    energy = (impacts["velocity_before"] / speed) ** 2
    assert np.abs(energy - 1).max() < 1e-12
    assert np.abs(impacts["velocity_after"] + impacts["velocity_before"]).max() == 0


def test_ping_pong_between_both_flanks():
    """Period 2(v_f - v_b)/F with v_f = √(2E), v_b = √(2(E - Fθ0)); here F = θ0 = 1, E = 2."""
    osc = elastic(period=10.0, backlash=1.0)
    run = simulate(osc, ("separation", 0.0, -2.0), cycles=1000, observe=("events",))
    front, back = (events(run, kind) for kind in IMPACTS)
    period = 2 * (2 - math.sqrt(2))
    # τ up to 10⁴ rounds by EPS/2 of that; energy drifts by less than 1e-12 (below), and with it
    # the period, 2(1 - v_f/v_b)/v_f·ΔE = 0.8 ΔE in size.
    assert np.abs(np.diff(front["tau"]) - period).max() <= 2 * EPS * 1e4 + 2e-12
    assert np.abs(front["velocity_before"] / 2 - 1).max() < 1e-12
    assert np.abs(back["velocity_before"] / -math.sqrt(2) - 1).max() < 1e-12
    assert abs(front["tau"].size - 1e4 / period) <= 1


@pytest.mark.parametrize("back_flank_te", [True, False])
def test_mesh_cuts_do_not_touch_a_flight(back_flank_te):
    """Cycle ends inside a flight change nothing but rounding, however many there are."""
    runs = [simulate(elastic(period=period, backlash=1.0, back_flank_te=back_flank_te),
                     ("separation", -0.25, 0.5), cycles=300 / period, observe=("events",))
            for period in (300.0, 0.05)]
    one, many = (run.events["tau"].values for run in runs)
    # Each of the 6000 ends of a cycle adds a rounding of position and velocity, both of order 1
    # and below 4 EPS together.
    assert one.size == many.size
    assert np.abs(one - many).max() <= 300 / 0.05 * 4 * EPS + 4 * EPS * 300


# --- compliant contact ------------------------------------------------------------------------

RTOL = 1e-8


def event_error(method, osc, scale=1.0):
    """Error of an event's time and of velocities there, angles in units of the angle scale.

    With rk4 rtol mesh periods. In closed form rounding: a few EPS of the time in the mesh period
    and of the free oscillation, of all stretches of a cycle (fewer than ten).
    """
    return {"rk4": RTOL, "exact": 80 * EPS}[method] * osc.period * scale


def compliant(force=1.0, period=8.0, **options):
    return elastic(force=force, period=period, contact_law="compliant", gap="one_flank", **options)


def exact_period(speed, force):
    return 2 * speed / force + 2 * math.pi - 2 * math.atan(speed / force)


@pytest.mark.parametrize(("speed", "force"), [(2.0, 1.0), (0.1, 1.0), (5.0, 0.5), (0.3, 3.0)])
def test_period_and_extrema_of_the_undamped_contact(method, speed, force):
    osc = compliant(force)
    expected = exact_period(speed, force)
    if (speed, force) == (2.0, 1.0):
        assert expected == pytest.approx(8.06888787159141, rel=1e-14)
    run = simulate(osc, ("engagement", 0.0, speed), cycles=20 * expected / osc.period, rtol=RTOL)
    engages = events(run, EventKind.ENGAGE)
    # Angles are in units of F, so that a motion of v/F times that size is that much better
    # relative, or worse where v < F. Times from the start round by EPS of themselves.
    scale = max(1.0, osc.angle_scale / speed)
    times = np.diff(np.append(0.0, engages["tau"]))
    assert np.abs(times - expected).max() <= (event_error(method, osc, scale)
                                              + 2 * EPS * engages["tau"][-1])
    slack = event_error(method, osc, max(osc.angle_scale, speed))
    assert np.abs(engages["velocity_before"] - speed).max() <= slack
    s = np.linspace(0, expected, 4001)
    phi = run.history(s)["phi"].values
    top, bottom = force + math.hypot(force, speed), -(speed**2) / 2 / force
    # On the grid an extremum is missed by at most |φ''|h²/8.
    missed = max(top - force, force) * (s[1] ** 2) / 8
    slack += EPS * 20 * expected * speed  # the grid's times round by EPS of τ
    assert top - missed - slack <= phi.max() <= top + slack
    assert bottom - slack <= phi.min() <= bottom + missed + slack
    assert run.cycles["deepest_separation"].max() == pytest.approx(-bottom, rel=0, abs=slack)


@pytest.mark.parametrize("rtol", [1e-6, 1e-9, 1e-11])
def test_energy_drift_of_rk4_in_contact(rtol):
    """At most 10·rtol per mesh period; E = φ'²/2 - Fφ + φ₊²/2, here 2 on 1000 periods."""
    osc = compliant()
    run = lapwing.simulate(osc, ("engagement", 0.0, 2.0), cycles=1000 if rtol > 1e-10 else 100,
                           method="rk4", rtol=rtol)
    engages = events(run, EventKind.ENGAGE)
    drift = np.abs((engages["velocity_before"] / 2) ** 2 - 1)
    assert np.all(drift <= 10 * rtol * engages["tau"] / osc.period)


def test_energy_in_both_flanks(method):
    """Compliant contact at both flanks: E keeps to 10·rtol per mesh period through all states.

    In closed form to rounding: some ten stretches a mesh period of a few EPS each.
    """
    osc = elastic(period=8.0, contact_law="compliant", backlash=1.0)
    run = simulate(osc, ("engagement", 0.0, 2.0), cycles=200, rtol=RTOL)
    kind = run.events["kind"].values
    assert {EventKind.ENGAGE, EventKind.BACK_ENGAGE, EventKind.RELEASE,
            EventKind.BACK_RELEASE} == set(kinds(run))
    speed = run.events["velocity_before"].values
    phi = np.where(np.isin(kind, [EventKind.BACK_ENGAGE, EventKind.BACK_RELEASE]), -1.0, 0.0)
    drift = np.abs((speed**2 / 2 - phi) / 2 - 1)
    each = {"rk4": 10 * RTOL, "exact": 40 * EPS}[method]
    assert np.all(drift <= each * (1 + run.events["tau"].values / 8))
    assert run.events["phi"].values == pytest.approx(phi, rel=0, abs=4 * EPS)
