"""Complete chatter: infinitely many impacts in finite time (docs/model.md, section 7, item i)."""

import math

import mpmath as mp
import numpy as np
import pytest

from helpers import EPS, events, kinds, oscillator
from lapwing import EventKind, MotionState, TransmissionError, simulate

END, BACK_END = EventKind.CHATTER_END, EventKind.BACK_CHATTER_END
RTOL = 1e-10
pytestmark = pytest.mark.usefixtures("method")
# Default chatter_tol is 1e-10 mesh periods, 1e-13 in closed form: the neglected part.  On walls
# of constant acceleration nothing is neglected and flights are exact; what is left is rounding:
# each impact adds a few EPS of the time in the mesh period (some 30 times t∞); 60 bounces go before
# the rest is below 1e-7 P.
ROUNDING = 60 * 4 * 30 * EPS


def accumulation(distance, acceleration, restitution):
    """t∞ of a drop from rest: √(2h/a)·(1+ε)/(1-ε)."""
    return math.sqrt(2 * distance / acceleration) * (1 + restitution) / (1 - restitution)


def drop(osc, phi=-1.0, *, phase=0.25, cycles=0.5, **options):
    return simulate(osc, ("separation", phi, 0.0), phase=phase, cycles=cycles, rtol=RTOL, **options)


@pytest.mark.parametrize("contact_law", ["restitution", "rigid"])
def test_drop_from_rest_on_a_standing_wall(contact_law):
    run = drop(oscillator(contact_law=contact_law))
    end = events(run, END)["tau"][0]
    # The promised 1e-10; the value of the formula itself is checked beside it.
    assert end == pytest.approx(12.7279220613579, rel=1e-10)
    assert end == pytest.approx(accumulation(1, 1, 0.8), rel=ROUNDING)


@pytest.mark.parametrize("restitution", [0.05, 0.3, 0.8, 0.95])
def test_listed_impacts_follow_the_geometric_series(restitution):
    run = drop(oscillator(restitution=restitution))
    impacts = events(run, EventKind.IMPACT)
    end = events(run, END)["tau"][0]
    before = impacts["tau"] < end
    fall, n = math.sqrt(2), np.arange(np.count_nonzero(before))
    # t_n = t_0 + (2εv0/a)(1-ε^n)/(1-ε), counted from n = 0; v_n = v0 ε^n.
    tau = fall + 2 * restitution * fall * (1 - restitution**n) / (1 - restitution)
    assert n.size >= 4
    # Time is kept in the mesh period, here up to 400: each flight adds a few roundings of that.
    rounding = 2 * (n.size + 2) * EPS * 400
    assert np.allclose(impacts["tau"][before], tau, rtol=0, atol=rounding)
    # Speeds do not depend on it: each flight keeps its speed to a few EPS.
    assert np.allclose(impacts["velocity_before"][before], fall * restitution**n,
                       rtol=8 * (n.size + 2) * EPS, atol=0)
    assert np.allclose(impacts["velocity_after"], -restitution * impacts["velocity_before"],
                       rtol=2 * EPS, atol=0)
    assert end == pytest.approx(accumulation(1, 1, restitution), rel=0, abs=rounding)
    # Bounces are listed while the rest exceeds 1e-7 mesh periods.
    rest = end - impacts["tau"][before]
    assert rest[-2] > 1e-7 * run.oscillator.period > rest[-1] * (1 - 1e-6)


def test_restitution_zero_engages_at_the_landing():
    run = drop(oscillator(restitution=0.0), cycles=0.002)
    assert kinds(run)[:2] == [EventKind.IMPACT, EventKind.ENGAGE]
    assert run.events["tau"].values[:2] == pytest.approx([math.sqrt(2)] * 2, rel=4 * EPS)
    assert run.events["tau"].values[0] == run.events["tau"].values[1]
    assert run.final.motion_state == MotionState.ENGAGEMENT


def test_restitution_one_never_ends():
    run = drop(oscillator(restitution=1.0))
    assert set(kinds(run)) == {EventKind.IMPACT}
    # The last flight: 500/(2√2) bounces of duration 2√2.
    assert len(kinds(run)) == math.floor((500 - math.sqrt(2)) / (2 * math.sqrt(2))) + 1


PARABOLA = TransmissionError.parabola(1.0)
PERIOD = 20.0


@pytest.mark.parametrize("contact_law", ["restitution", "rigid"])
@pytest.mark.parametrize("amplitude", [2.0, -2.0])
def test_wall_of_constant_acceleration(contact_law, amplitude):
    """Inside one arc of a parabola g'' = -8A/P², so a = F + 8A/P²."""
    osc = oscillator(TransmissionError.parabola(amplitude), period=PERIOD, restitution=0.3,
                     contact_law=contact_law)
    acceleration = 1 + 8 * amplitude / PERIOD**2
    run = drop(osc, phase=0.1)
    end = events(run, END)["tau"][0]
    expected = accumulation(1, acceleration, 0.3)
    assert 0.1 * PERIOD + expected < PERIOD  # no kink on the way
    assert end == pytest.approx(expected, rel=1e-10)
    assert end == pytest.approx(expected, rel=ROUNDING)


@pytest.mark.parametrize("acceleration_share", [0.7, 0.2])
def test_wall_with_jerk_against_bounces_followed_in_high_precision(method, acceleration_share):
    """A harmonic wall: 40-digit bounces until nothing is left, against the summed end."""
    amplitude, period, restitution = 1.0, 50.0, 0.5
    omega = 2 * math.pi / period
    # F such that pressing at the steepest place of g'' is a share of the mean.
    force = amplitude * omega**2 / (1 - acceleration_share)
    osc = oscillator(TransmissionError.harmonic([amplitude]), force=force, period=period,
                     restitution=restitution, backlash=1e3, damping_ratio=0.1)
    start = -0.02 * amplitude
    run = drop(osc, start, phase=0.3, cycles=0.7)
    end = events(run, END)["tau"][0]
    with mp.workdps(40):
        exact = float(_exact_accumulation(amplitude, period, force, restitution, start, 0.3))
    # With rk4 rtol promises event times, chatter_tol the neglected part; the harmonic table is good
    # to 1e-12 of its amplitude, far less than the 2 % that is fallen through.  In closed form there
    # is the neglected part of 1e-13 and the rounding of a dozen flights.
    error = {"rk4": 2e-10, "exact": 4e-13}[method]
    assert end == pytest.approx(exact, rel=0, abs=error * period)


def _exact_accumulation(amplitude, period, force, restitution, phi, phase):
    """Sum of all flights over a harmonic wall; Newton from the parabola of each flight."""
    omega = 2 * mp.pi / mp.mpf(period)
    force, restitution = mp.mpf(force), mp.mpf(restitution)
    t, theta = mp.mpf(phase) * period, None
    start = t

    def wall(k, t):
        return amplitude * omega**k * mp.cos(omega * t + k * mp.pi / 2)

    theta, rate = phi + wall(0, t), wall(1, t)
    while True:
        def distance(s, t=t, theta=theta, rate=rate):
            return theta + rate * s + force * s * s / 2 - wall(0, t + s)

        relative, pressing = rate - wall(1, t), force - wall(2, t)
        depth = theta - wall(0, t)
        guess = (-relative + mp.sqrt(relative**2 - 2 * pressing * min(depth, 0))) / pressing
        s = mp.findroot(distance, (guess, guess * mp.mpf("1.001")), solver="secant", tol=1e-70)
        t += s
        v = restitution * (rate + force * s - wall(1, t))
        theta, rate = wall(0, t), wall(1, t) - v
        if v < mp.mpf("1e-9"):
            a, j = force - wall(2, t), -wall(3, t)
            loss = 1 - restitution
            return t - start + 2 * v / (a * loss) - 4 * j * v**2 / (3 * a**3 * loss**2)


def test_jerk_term_of_the_sum(method):
    """A chatter right behind the place where F = g'': pressing 6e-6 + 6s, P = 1.

    The sum takes over at a rest of 1e-7 P, of which the jerk makes 1 to 2 %: ten times and more
    the tolerance of 1e-10 P.  With the closed form's of 1e-13 P it does later.
    """
    force, pressing, jerk, restitution, v = 2.0, 6e-6, 6.0, 0.5, 1e-12
    c2, c3 = (force - pressing) / 2, -jerk / 6
    te = TransmissionError([0.0, 1.0], [[0.0, -c2 - c3, c2, c3, 0, 0]], [True])
    osc = oscillator(te, force=force, period=1.0, restitution=restitution)
    run = simulate(osc, ("separation", 0.0, -v), cycles=1e-5)
    end = events(run, END)["tau"][0]
    t = mp.mpf(0)
    while v > 1e-25:
        # Distance v s - (a + j t) s²/2 - j s³/6 returns to zero.
        a = mp.mpf(force - 2 * c2) + jerk * t
        s = (-a / 2 + mp.sqrt(a**2 / 4 + 4 * v * mp.mpf(jerk) / 6)) / (2 * mp.mpf(jerk) / 6)
        t += s
        v = restitution * -(v - a * s - jerk * s**2 / 2)
    assert events(run, EventKind.IMPACT)["tau"].size >= 2
    assert end == pytest.approx(float(t), rel=0, abs={"rk4": 1e-10, "exact": 4e-13}[method])


def test_the_end_of_chatter_does_not_depend_on_when_it_is_summed():
    """Tolerances of the sum over nine decades give one end, within the larger of them."""
    osc = oscillator(TransmissionError.harmonic([1.0]), force=0.1, period=50.0, restitution=0.5)
    tolerances = 10.0 ** -np.arange(5, 15)
    ends = np.array([events(drop(osc, -0.02, phase=0.3, chatter_tol=x), END)["tau"][0]
                     for x in tolerances])
    # The neglected part is an estimate of the next term: a factor of 4 covers it.  Rounding of
    # the dozen flights stays below 1e-13 of their sum.
    assert np.all(np.abs(ends - ends[-1]) <= (4 * tolerances + 1e-14) * osc.period)


@pytest.mark.parametrize("damping_ratio", [0.0, 0.1, 0.6])
def test_engaged_motion_after_the_end(method, damping_ratio):
    run = drop(oscillator(damping_ratio=damping_ratio), cycles=0.0145)
    end = events(run, END)["tau"][0]
    omega = math.sqrt(1 - damping_ratio**2)
    s = np.linspace(0, 1.7, 18)
    history = run.history(end + s)
    exact = 1 - np.exp(-damping_ratio * s) * (np.cos(omega * s)
                                              + damping_ratio / omega * np.sin(omega * s))
    # Natural size of φ is F = 1; every step may err by rtol/96 of it, dense output included.  In
    # closed form it is as good as the time, which rounds by EPS of 250.
    error = {"rk4": RTOL, "exact": 2 * EPS * 300}[method]
    assert np.allclose(history["phi"], exact, rtol=0, atol=error)
    assert np.all(history["motion_state"] == MotionState.ENGAGEMENT)
    assert history["phi"].values[0] == 0 and history["phi_dot"].values[0] == 0


def test_after_the_end_a_rigid_tooth_rests():
    run = drop(oscillator(contact_law="rigid"))
    after = run.history(np.linspace(events(run, END)["tau"][0], 500, 50))
    assert np.all(after["motion_state"] == MotionState.ENGAGEMENT)
    assert np.all(after["phi"] == 0) and np.all(after["phi_dot"] == 0)


@pytest.mark.parametrize("contact_law", ["restitution", "rigid"])
@pytest.mark.parametrize("back_flank_te", [True, False])
def test_coast_flank_mirrored(contact_law, back_flank_te):
    osc = oscillator(force=-1.0, backlash=3.0, contact_law=contact_law,
                     back_flank_te=back_flank_te)
    run = drop(osc, -2.0)
    assert events(run, BACK_END)["tau"][0] == pytest.approx(12.7279220613579, rel=1e-10)
    # φ of an impact there is -θ0, its velocities are φ'.
    impacts = events(run, EventKind.BACK_IMPACT)
    assert impacts["phi"] == pytest.approx(-3.0, rel=4 * EPS)
    assert impacts["velocity_before"][0] == pytest.approx(-math.sqrt(2), rel=4 * EPS)
    assert events(run, EventKind.IMPACT)["tau"].size == 0


def test_absolute_law_on_a_standing_flank_sums_its_chatter():
    relative, absolute = (drop(oscillator(impact_law=law)) for law in ("relative", "absolute"))
    # On a standing flank the laws coincide, impact by impact and in what may be summed.
    ends = [events(run, END)["tau"][0] for run in (relative, absolute)]
    assert ends[1] == pytest.approx(ends[0], rel=1e-10)


def test_chatter_over_a_kink_is_not_summed_across_it():
    """The kink lies inside the geometric rest of the chatter and lifts the tooth again."""
    osc = oscillator(TransmissionError.parabola(2.0), period=PERIOD, restitution=0.8)
    run = drop(osc, phase=0.6, cycles=0.45)
    ends, kinks = (events(run, kind)["tau"] for kind in (END, EventKind.KINK))
    assert kinks == pytest.approx([0.4 * PERIOD], rel=4 * EPS)
    assert not np.any(ends < 0.4 * PERIOD)
    assert np.count_nonzero(events(run, EventKind.IMPACT)["tau"] < 0.4 * PERIOD) >= 2
