"""The decisions of docs/model.md, section 7, letter by letter."""

import math

import numpy as np
import pytest
from scipy.optimize import brentq

from helpers import EPS, events, kinds, oscillator, scene_a
from lapwing import EventKind, MotionState, Status, TransmissionError, simulate
from lapwing.studies.period import find_period

pytestmark = pytest.mark.usefixtures("method")
K = EventKind
LAWS = ("restitution", "compliant", "rigid")
# Of period 2 and amplitude ¼: g' = ±¼ in τ, kinks at phase 0 (upwards) and ½ (downwards); with it
# every number below is a short binary fraction and flights are exact.
TRIANGLE = TransmissionError.from_hermite([0.0, 0.5], [0.0, 0.25], [-0.5, 0.5], [0.5, -0.5])
WAVE = TransmissionError.harmonic([1.0])
RTOL = 1e-10


def g_of(osc, tau, order=0):
    phase = np.asarray(tau) / osc.period
    return osc.flank_scale * osc.te.derivative(order, phase) / osc.period**order


def damped(force, damping_ratio, start, rate, s):
    """x'' + 2ξx' + x = F from (start, rate)."""
    omega = math.sqrt(1 - damping_ratio**2)
    off = start - force
    return force + np.exp(-damping_ratio * s) * (
        off * np.cos(omega * s) + (rate + damping_ratio * off) / omega * np.sin(omega * s))


# --- a: standing coast flank ------------------------------------------------------------------


def standing(**options):
    return oscillator(WAVE, **{"force": -1.0, "period": 10.0, "backlash": 5.0, "restitution": 0.5,
                               "damping_ratio": 0.1, "back_flank_te": False, **options})


@pytest.mark.parametrize("impact_law", ["relative", "absolute"])
def test_decision_a_impact_at_a_standing_flank(impact_law):
    run = simulate(standing(impact_law=impact_law), ("separation", -3.0, 0.2), cycles=1)
    impact = {name: column[0] for name, column in events(run, K.BACK_IMPACT).items()}
    # θ falls freely from φ + g with θ' = φ' + g' (g' = 0 at phase 0) to θ = -θ0.
    height, rate = -3.0 + 1.0 + 5.0, 0.2
    speed = math.sqrt(rate**2 + 2 * height)
    assert impact["tau"] == pytest.approx(rate + speed, rel=1e-12)
    assert impact["velocity_before"] == pytest.approx(-speed, rel=1e-12)
    assert impact["velocity_after"] == pytest.approx(0.5 * speed, rel=1e-12)
    # φ is reported as everywhere, against the drive flank: -θ0 - g.
    assert impact["phi"] == pytest.approx(-5.0 - g_of(run.oscillator, impact["tau"]), abs=1e-11)


def test_decision_a_compliant_motion_in_a_standing_flank():
    """θ'' = F - 2ξθ' - (θ + θ0): the transmission error is not felt; release at θ = -θ0."""
    osc = standing(contact_law="compliant")
    run = simulate(osc, ("back_engagement", -5.0 - 1.0 - 0.5, 0.0), cycles=1, rtol=RTOL)
    s = np.linspace(0, 9.0, 50)
    history = run.history(s)
    theta = history["phi"].values + g_of(osc, s)
    # F < 0 and ξ = 0.1 keep θ + θ0 between -0.5 and -1.4.  The error of φ is that of event times
    # (rtol mesh periods) times speeds below 1.
    assert kinds(run) == []
    assert np.allclose(theta + 5.0, damped(-1.0, 0.1, -0.5, 0.0, s), rtol=0,
                       atol=osc.period * RTOL)
    assert np.all(history["motion_state"] == MotionState.BACK_ENGAGEMENT)


def test_decision_a_release_from_a_standing_flank():
    osc = standing(force=0.5, contact_law="compliant")
    run = simulate(osc, ("back_engagement", -6.5, 0.0), cycles=0.9, rtol=RTOL)
    zero = brentq(lambda s: damped(0.5, 0.1, -0.5, 0.0, s), 0.5, 2.5, xtol=1e-14)
    release = events(run, K.BACK_RELEASE)
    assert release["tau"][0] == pytest.approx(zero, rel=0, abs=RTOL * osc.period)
    assert release["phi"][0] == pytest.approx(-5.0 - g_of(osc, zero), rel=0, abs=1e-8)
    assert release["velocity_before"][0] == release["velocity_after"][0] > 0


def test_decision_a_rigid_tooth_rests_on_a_standing_flank_while_pressed(method):
    osc = standing(contact_law="rigid")
    run = simulate(osc, "rest", cycles=3)
    s = np.linspace(0, 29.9, 40)
    history = run.history(s)
    assert kinds(run) == []
    assert np.all(history["motion_state"] == MotionState.BACK_ENGAGEMENT)
    # rk4 sees the harmonics' table, good to 1e-12 of its amplitude and 1e-10 of its slope.
    table = {"rk4": 1e-12, "exact": 0}[method]
    assert np.allclose(history["phi"], -5.0 - g_of(osc, s), rtol=0, atol=16 * EPS * 5 + table)
    error = 64 * EPS * 5 + 100 * table
    assert np.allclose(history["phi_dot"], -g_of(osc, s, 1), rtol=0, atol=error)
    lifted = simulate(standing(force=0.3, contact_law="rigid"),
                      ("back_engagement", -6.0, 0.0), cycles=0.1)
    assert kinds(lifted)[0] == K.BACK_RELEASE and lifted.events["tau"].values[0] == 0


@pytest.mark.parametrize("back_flank_te", [True, False])
def test_decision_a_the_constant_matters_only_with_a_standing_flank(back_flank_te):
    shifted = TransmissionError.harmonic([1.0, 0.5], orders=[1, 0])
    runs = [simulate(oscillator(te, force=-1.0, period=10.0, backlash=5.0,
                                back_flank_te=back_flank_te), ("separation", -3.0, 0.0), cycles=1)
            for te in (WAVE, shifted)]
    one, other = (events(run, K.BACK_IMPACT)["tau"][0] for run in runs)
    assert (abs(one - other) <= 1e-12) == back_flank_te


def test_decision_a_flanks_that_meet_are_refused():
    with pytest.raises(ValueError, match="standing coast flank"):
        standing(backlash=1.0 - 1e-9)
    assert standing(backlash=1.0 + 1e-9).backlash > 1


# --- b: kinks ---------------------------------------------------------------------------------


@pytest.mark.parametrize(("contact_law", "start"), [
    *((law, ("separation", -20.0, 1.0)) for law in LAWS),
    ("restitution", ("engagement", 1.0, 0.0)), ("compliant", ("engagement", 1.0, 0.0)),
    ("restitution", ("back_engagement", -41.0, 0.0)),
    ("compliant", ("back_engagement", -41.0, 0.0))])
@pytest.mark.parametrize("back_flank_te", [True, False])
def test_decision_b_the_wheels_do_not_notice_a_kink(contact_law, start, back_flank_te):
    force = -1.0 if start[0] == "back_engagement" else 1.0
    osc = oscillator(TRIANGLE, force=force, period=2.0, backlash=40.0, damping_ratio=0.05,
                     contact_law=contact_law, back_flank_te=back_flank_te)
    run = simulate(osc, start, phase=0.25, cycles=1)
    kinks = events(run, K.KINK)
    assert kinks["phase"].tolist() == [0.5, 0.0] and kinds(run) == [K.KINK, K.KINK]
    assert kinks["tau"] == pytest.approx([0.5, 1.5], rel=0, abs=4 * EPS)
    # φ'₊ = φ'₋ - Δg', Δg' = -½ and +½; rounding of velocities of order 1.
    jump = kinks["velocity_after"] - kinks["velocity_before"]
    assert jump == pytest.approx([0.5, -0.5], rel=0, abs=8 * EPS)
    h = 1e-6
    around = run.history(np.array([0.5 - h, 0.5, 0.5 + h]))
    assert np.all(around["motion_state"] == MotionState[start[0].upper()])
    phi, rate = around["phi"].values, around["phi_dot"].values
    # Within ±h only the smooth acceleration, below 2 |F| + 3, acts.
    assert abs(phi[1] - phi[0]) <= 4 * h and rate[1] == kinks["velocity_after"][0]
    assert rate[1] - rate[0] == pytest.approx(0.5, abs=8 * h)
    assert rate[2] - rate[1] == pytest.approx(0.0, abs=8 * h)


def test_decision_b_the_flank_is_still_seen_after_a_kink():
    osc = oscillator(TRIANGLE, force=1.0, period=2.0)
    run = simulate(osc, ("separation", -1.0, 0.5), phase=0.25, cycles=0.9)
    # Kink at s = ½; θ = -7/8 + 3/4 s + s²/2 meets g = 3/8 - s/4 at s = -1 + √(1 + 5/2).
    assert kinds(run)[:2] == [K.KINK, K.IMPACT]
    assert events(run, K.IMPACT)["tau"][0] == pytest.approx(math.sqrt(3.5) - 1, rel=8 * EPS)


# --- c: rigid contact on a kink ---------------------------------------------------------------


@pytest.mark.parametrize(("force", "phase", "expected", "after"), [
    (9.0, 0.25, [K.KINK, K.IMPACT, K.RELEASE], None), (9.0, 0.75, [K.KINK, K.RELEASE], -0.5),
    (-9.0, 0.25, [K.KINK, K.BACK_RELEASE], 0.5),
    (-9.0, 0.75, [K.KINK, K.BACK_IMPACT, K.BACK_RELEASE], None)])
def test_decision_c_a_kink_under_a_resting_rigid_tooth(force, phase, expected, after):
    osc = oscillator(TRIANGLE, force=force, period=2.0, backlash=10.0, restitution=0.25,
                     contact_law="rigid")
    run = simulate(osc, "rest", phase=phase, cycles=0.26)
    assert kinds(run)[:len(expected)] == expected
    assert np.all(run.events["tau"].values[:len(expected)] == 0.5)
    if after is None:
        # Struck with |Δg'| = ½ from the flank, thrown off with ε|Δg'|.
        sign = -math.copysign(1, force)
        strike = {n: run.events[n].values[1] for n in ("velocity_before", "velocity_after")}
        assert strike["velocity_before"] == pytest.approx(-sign * 0.5, rel=8 * EPS)
        assert strike["velocity_after"] == pytest.approx(sign * 0.125, rel=8 * EPS)
        after = sign * 0.125
    assert run.events["velocity_after"].values[len(expected) - 1] == pytest.approx(after,
                                                                                    rel=8 * EPS)


def test_decision_c_a_struck_tooth_without_rebound_stays():
    osc = oscillator(TRIANGLE, force=9.0, period=2.0, restitution=0.0, contact_law="rigid")
    run = simulate(osc, "rest", phase=0.25, cycles=0.5)
    assert K.RELEASE not in kinds(run)
    assert run.final.motion_state == MotionState.ENGAGEMENT


def test_decision_c_a_standing_flank_has_no_kink():
    osc = oscillator(TRIANGLE, force=-9.0, period=2.0, backlash=10.0, contact_law="rigid",
                     back_flank_te=False)
    assert set(kinds(simulate(osc, "rest", cycles=2))) <= {K.KINK}


# --- d: equal times ---------------------------------------------------------------------------


@pytest.mark.parametrize(("early", "expected", "speed"), [
    (0.0, [K.KINK, K.IMPACT], 2.25), (1e-6, [K.IMPACT, K.KINK], 1.75),
    (-1e-6, [K.KINK, K.IMPACT], 2.25)])
def test_decision_d_kink_before_impact(early, expected, speed):
    """θ = -¾ + s² meets g = ¼ at s = 1, exactly on the kink."""
    osc = oscillator(TRIANGLE, force=2.0, period=2.0, restitution=0.5)
    run = simulate(osc, ("separation", -0.75 + early, -0.25), cycles=0.6)
    assert kinds(run)[:2] == expected
    tau = run.events["tau"].values[:2]
    # The order changes at no distance; arrival is early by `early`/speed.
    assert np.all(np.abs(tau - 1.0) <= abs(early))
    assert events(run, K.IMPACT)["velocity_before"][0] == pytest.approx(speed, abs=3e-6)
    if early == 0:
        assert tau.tolist() == [1.0, 1.0]
        impact = events(run, K.IMPACT)
        assert impact["velocity_before"][0] == 2.25 and impact["velocity_after"][0] == -1.125


def test_decision_d_kink_before_back_impact():
    """Mirrored at the coast flank: g falls towards the kink at phase 0."""
    osc = oscillator(TRIANGLE, force=-2.0, period=2.0, restitution=0.5, backlash=4.0)
    # θ(0) = -3, θ = -3 - s² is at -4 = g - θ0 when s = 1 (g = 0 there); start at phase ½, g = ¼.
    run = simulate(osc, ("separation", -3.25, 0.25), phase=0.5, cycles=0.6)
    assert kinds(run)[:2] == [K.KINK, K.BACK_IMPACT]
    assert run.events["tau"].values[:2].tolist() == [1.0, 1.0]
    # θ' = -2; the flank's slope after the kink is +¼.
    assert events(run, K.BACK_IMPACT)["velocity_before"][0] == -2.25


def test_decision_d_kink_before_engagement():
    osc = oscillator(TRIANGLE, force=2.0, period=2.0, contact_law="compliant")
    run = simulate(osc, ("separation", -0.75, -0.25), cycles=0.6)
    assert kinds(run)[:2] == [K.KINK, K.ENGAGE]
    assert run.events["tau"].values[:2].tolist() == [1.0, 1.0]
    assert events(run, K.ENGAGE)["velocity_before"][0] == 2.25


def test_decision_d_observers_see_the_state_after():
    osc = oscillator(TRIANGLE, force=2.0, period=2.0, restitution=0.5)
    run = simulate(osc, ("separation", -0.75, -0.25), cycles=2.5)
    impact = run.history([1.0])
    assert impact["phi_dot"].values[0] == -1.125 and impact["phi"].values[0] == 0
    # A stroboscopic state on the kink at phase 0 is its right limit.
    kink = {n: c[events(run, K.KINK)["phase"] == 0] for n, c in events(run, K.KINK).items()}
    at = run.cycles["cycle"].values[1:]
    rows = [int(np.flatnonzero(kink["cycle"] == m)[0]) for m in at]
    assert run.cycles["phi_dot"].values[1:].tolist() == kink["velocity_after"][rows].tolist()
    assert run.history([2.0])["phi_dot"].values[0] == kink["velocity_after"][rows[0]]


def test_decision_d_a_run_that_ends_on_an_event_has_it():
    osc = oscillator(TRIANGLE, force=2.0, period=2.0, restitution=0.5)
    run = simulate(osc, ("separation", -0.75, -0.25), cycles=0.5)
    assert kinds(run) == [K.KINK, K.IMPACT]
    assert run.final.phi_dot == -1.125 and run.final.tau == 1.0


# --- e: starts --------------------------------------------------------------------------------


@pytest.mark.parametrize("contact_law", LAWS)
@pytest.mark.parametrize(("phi", "phi_dot", "kind"), [(0.0, 0.5, 0), (-3.0, -0.5, 1)])
def test_decision_e_an_arriving_tooth_has_its_impact_at_once(contact_law, phi, phi_dot, kind):
    osc = oscillator(backlash=3.0, contact_law=contact_law)
    run = simulate(osc, ("separation", phi, phi_dot), cycles=1e-4)
    first = K.ENGAGE if contact_law == "compliant" else K.IMPACT
    assert kinds(run)[0] == first + kind
    assert run.events["tau"].values[0] == 0
    after = phi_dot if contact_law == "compliant" else -0.8 * phi_dot
    assert run.events["velocity_before"].values[0] == phi_dot
    assert run.events["velocity_after"].values[0] == pytest.approx(after, rel=2 * EPS)


@pytest.mark.parametrize("contact_law", LAWS)
def test_decision_e_a_leaving_tooth_flies(contact_law):
    run = simulate(oscillator(contact_law=contact_law), ("separation", 0.0, -0.5), cycles=1e-4)
    assert kinds(run) == [] and run.final.motion_state == MotionState.SEPARATION


@pytest.mark.parametrize("contact_law", LAWS)
def test_decision_e_a_tooth_put_on_the_flank_in_separation(contact_law):
    pressed = simulate(oscillator(contact_law=contact_law), ("separation", 0.0, 0.0), cycles=1e-4)
    assert pressed.final.motion_state == MotionState.ENGAGEMENT
    assert set(pressed.events["tau"].values) == {0.0}
    pulled = simulate(oscillator(contact_law=contact_law, force=-1.0), ("separation", 0.0, 0.0),
                      cycles=1e-4)
    assert kinds(pulled) == []
    assert pulled.final.phi == pytest.approx(-0.5 * 0.1**2, rel=8 * EPS)


@pytest.mark.parametrize(("start", "options"), [
    (("separation", 1e-9, 0.0), {}), (("separation", -3.1, 0.0), {}),
    (("engagement", -1e-9, 0.0), {}), (("engagement", 0.1, 0.0), {"contact_law": "rigid"}),
    (("back_engagement", -2.9, 0.0), {}), (("back_engagement", -5.0, 0.0), {"gap": "one_flank"}),
    (("back_engagement", -5.9, 0.0), {"gap": "symmetric"}),
    (("separation", math.nan, 0.0), {}), (("separation", -1.0, math.inf), {}),
    (("flying", -1.0, 0.0), {}), ("sleep", {}), ((7, -1.0, 0.0), {})])
def test_decision_e_contradictory_starts_are_refused(start, options):
    with pytest.raises((ValueError, KeyError)) as caught:
        simulate(oscillator(backlash=3.0, **options), start, cycles=1)
    assert isinstance(caught.value, ValueError)


def test_decision_e_wider_gaps_allow_deeper_starts():
    for gap, phi in (("symmetric", -5.9), ("one_flank", -100.0)):
        run = simulate(oscillator(backlash=3.0, gap=gap), ("separation", phi, 0.0), cycles=1e-3)
        assert run.status == Status.OK
    with pytest.raises(ValueError, match="separation lies between"):
        simulate(oscillator(backlash=3.0, back_flank_te=False,
                            te=TransmissionError.harmonic([1.0])), ("separation", -4.1, 0.0))


# --- f: release by position -------------------------------------------------------------------


@pytest.mark.parametrize("contact_law", ["restitution", "compliant"])
@pytest.mark.parametrize("damping_ratio", [0.0, 0.1, 0.4])
def test_decision_f_contact_ends_where_phi_returns_to_zero(contact_law, damping_ratio):
    osc = oscillator(damping_ratio=damping_ratio, contact_law=contact_law, period=50.0)
    run = simulate(osc, ("engagement", 0.0, 30.0), cycles=0.2, rtol=RTOL)
    zero = brentq(lambda s: damped(1.0, damping_ratio, 0.0, 30.0, s), 2.0, 4.5, xtol=1e-15)
    release = events(run, K.RELEASE)
    assert release["tau"][0] == pytest.approx(zero, rel=0, abs=RTOL * osc.period)
    # The damper pulls there: 2ξφ' < 0 = φ.  No restitution: the velocity stays.
    assert release["velocity_before"][0] == release["velocity_after"][0] < -1
    assert release["phi"][0] == 0


# --- g: ends of the range of ε ----------------------------------------------------------------


@pytest.mark.parametrize("contact_law", ["restitution", "rigid"])
def test_decision_g_no_restitution(contact_law):
    osc = oscillator(WAVE, force=0.1, period=10.0, restitution=0.0, contact_law=contact_law)
    # Pressed (phase 0: g'' = -Ω² < 0): the impact engages.
    run = simulate(osc, ("separation", -0.01, 0.3), phase=0.95, cycles=0.1)
    assert kinds(run)[:2] == [K.IMPACT, K.ENGAGE]
    assert run.events["tau"].values[0] == run.events["tau"].values[1]
    assert events(run, K.IMPACT)["velocity_after"][0] == 0
    # Not pressed (phase ½: g'' = Ω² > F): it leaves again, without having been engaged.
    run = simulate(osc, ("separation", -0.01, 0.3), phase=0.48, cycles=0.1)
    assert kinds(run)[0] == K.IMPACT and K.ENGAGE not in kinds(run)
    assert events(run, K.IMPACT)["velocity_after"][0] == 0
    assert run.final.motion_state == MotionState.SEPARATION and run.final.phi < 0


def test_decision_g_full_restitution_never_engages():
    osc = oscillator(WAVE, force=0.5, period=10.0, restitution=1.0, gap="one_flank")
    run = simulate(osc, ("separation", -0.01, 0.0), cycles=50)
    assert set(kinds(run)) == {K.IMPACT}
    assert np.array_equal(run.events["velocity_after"].values,
                          -run.events["velocity_before"].values)


# --- h: signs ---------------------------------------------------------------------------------


def test_decision_h_any_finite_force_and_a_positive_backlash():
    for bad in ({"backlash": 0.0}, {"backlash": -1.0}, {"force": math.nan}, {"force": math.inf}):
        with pytest.raises(ValueError):
            oscillator(**bad)
    still = simulate(oscillator(force=0.0, backlash=2.0, restitution=0.5),
                     ("separation", -1.0, 0.25), cycles=0.021)
    # No force: straight flights, 1 at ¼, then 2 at ⅛ and 1/16.
    assert kinds(still) == [K.IMPACT, K.BACK_IMPACT]
    assert still.events["tau"].values == pytest.approx([4.0, 20.0], rel=8 * EPS)
    pulled = simulate(oscillator(force=-1.0, backlash=2.0), ("separation", 0.0, 0.0), cycles=0.02)
    assert kinds(pulled)[0] == K.BACK_IMPACT
    assert pulled.events["tau"].values[0] == pytest.approx(2.0, rel=8 * EPS)


# --- i: chatter (see also test_chatter.py) ----------------------------------------------------


def test_decision_i_absolute_rebounds_tend_to_a_finite_speed():
    """On a flank that moves with u = g' > 0 bounces tend to v = u(1+ε)/(1-ε), never to rest."""
    ramp = TransmissionError([0.0, 0.75, 1.0], [[0, 0.75, 0, 0, 0, 0], [0.5625, -2.25, 0, 0, 0, 0]],
                             [True, True])
    osc = oscillator(ramp, force=1.0, period=1000.0, impact_law="absolute", restitution=0.5)
    run = simulate(osc, ("separation", -0.5, 0.0), cycles=0.7)
    speed = 0.75e-3 * (1 + 0.5) / (1 - 0.5)
    assert set(kinds(run)) == {K.IMPACT}
    # ε^n of the first, 1, is below rounding after 60 bounces.
    late = run.events["velocity_after"].values[80:]
    assert late.size > 50
    assert late == pytest.approx(-speed, rel=1e-9)


def test_decision_i_absolute_bounces_end_where_the_flank_turns():
    """At a crest of g rebounds shrink with g'; just behind it an impact goes on into the flank."""
    osc = oscillator(WAVE, force=0.9, period=100.0, impact_law="absolute", restitution=0.5)
    run = simulate(osc, ("separation", -0.05, 0.0), phase=0.9, cycles=0.3)
    contact = np.isin(run.events["kind"].values, [K.ENGAGE, K.CHATTER_END])
    first = int(np.flatnonzero(contact)[0])
    assert run.events["tau"].values[first] >= 0.1 * osc.period * (1 - 1e-6)
    before = run.events["velocity_after"].values[:first - 1]
    assert np.all(before < 0)


# --- j: resting exactly on the flank ----------------------------------------------------------


def cubic_wall(second, third):
    """One piece with g'' = `second`, g''' = `third` at phase 0 (period 1), kinked there."""
    c2, c3 = second / 2, third / 6
    return TransmissionError([0.0, 1.0], [[0.0, -c2 - c3, c2, c3, 0, 0]], [True])


@pytest.mark.parametrize("contact_law", LAWS)
@pytest.mark.parametrize(("second", "third", "stays"), [
    (1.5, 0.0, True), (2.5, 0.0, False), (2.0, -6.0, True), (2.0, 6.0, False), (2.0, 0.0, True)])
@pytest.mark.parametrize("coast", [False, True])
def test_decision_j_the_first_derivative_that_does_not_vanish_decides(contact_law, second, third,
                                                                      stays, coast):
    """F - g'' = 2 - second, its rate -third; at the coast flank everything with the other sign."""
    sign = -1.0 if coast else 1.0
    osc = oscillator(cubic_wall(sign * second, sign * third), force=sign * 2.0, period=1.0,
                     backlash=50.0, damping_ratio=0.1, contact_law=contact_law)
    start = ("back_engagement", -50.0, 0.0) if coast else ("engagement", 0.0, 0.0)
    run = simulate(osc, start, cycles=0.05)
    released = K.BACK_RELEASE if coast else K.RELEASE
    if stays:
        assert kinds(run) == []
        assert run.final.motion_state == (2 if coast else 1)
    else:
        assert kinds(run)[0] == released and run.events["tau"].values[0] == 0
        assert run.final.motion_state == MotionState.SEPARATION


# --- k: rest ----------------------------------------------------------------------------------


@pytest.mark.parametrize(("force", "options", "state", "phi"), [
    (0.4, {}, "ENGAGEMENT", 0.4), (0.4, {"contact_law": "compliant"}, "ENGAGEMENT", 0.4),
    (0.4, {"contact_law": "rigid"}, "ENGAGEMENT", 0.0), (1e-5, {}, "ENGAGEMENT", 1e-5),
    (-0.4, {}, "BACK_ENGAGEMENT", -3.4), (-0.4, {"contact_law": "rigid"}, "BACK_ENGAGEMENT", -3.0),
    (-0.4, {"gap": "symmetric"}, "BACK_ENGAGEMENT", -6.4)])
@pytest.mark.parametrize("phase", [0.0, 0.3])
def test_decision_k_rest(force, options, state, phi, phase):
    te = TransmissionError.harmonic([1e-3])
    osc = oscillator(te, force=force, period=100.0, backlash=3.0, **options)
    start = simulate(osc, "rest", phase=phase, cycles=0.01).history([0.0])
    assert start["motion_state"].values[0] == MotionState[state]
    assert start["phi"].values[0] == pytest.approx(phi, rel=4 * EPS)
    assert start["phi_dot"].values[0] == 0
    assert start["phase"].values[0] == pytest.approx(phase, rel=4 * EPS)


@pytest.mark.parametrize("contact_law", LAWS)
@pytest.mark.parametrize(("phase", "stays"), [(0.0, True), (0.3, False)])
def test_decision_k_rest_without_a_force(contact_law, phase, stays):
    """On the drive flank, φ = φ' = 0; where g'' > 0 it is gone at once (decision j)."""
    osc = oscillator(WAVE, force=0.0, period=100.0, contact_law=contact_law)
    run = simulate(osc, "rest", phase=phase, cycles=0.01)
    start = run.history([0.0])
    assert start["phi"].values[0] == start["phi_dot"].values[0] == 0
    assert start["motion_state"].values[0] == stays
    assert kinds(run) == ([] if stays else [K.RELEASE])


@pytest.mark.parametrize("contact_law", ["restitution", "rigid"])
def test_decision_k_rest_on_a_standing_flank(contact_law):
    osc = standing(force=-0.4, contact_law=contact_law)
    start = simulate(osc, "rest", phase=0.2, cycles=0.01).history([0.0])
    at = 0.2 * osc.period
    deflection = 0.0 if contact_law == "rigid" else -0.4
    assert start["motion_state"].values[0] == MotionState.BACK_ENGAGEMENT
    assert start["phi"].values[0] == pytest.approx(-5 + deflection - g_of(osc, at), rel=8 * EPS)
    assert start["phi_dot"].values[0] == pytest.approx(-g_of(osc, at, 1), rel=1e-12)


@pytest.mark.parametrize("contact_law", LAWS)
def test_decision_k_a_kink_at_the_start_lies_before_it(contact_law):
    osc = oscillator(TransmissionError.parabola(1e-3), force=1.0, period=10.0,
                     contact_law=contact_law)
    run = simulate(osc, "rest", cycles=0.9)
    assert kinds(run) == []
    assert run.history([0.0])["phi_dot"].values[0] == 0
    one = simulate(osc, ("separation", -300.0, 0.0), cycles=1.5)
    assert events(one, K.KINK)["tau"] == pytest.approx([10.0], rel=4 * EPS)


def test_decision_k_without_a_coast_flank_there_is_nothing_to_rest_on():
    with pytest.raises(ValueError, match="coast flank"):
        simulate(oscillator(force=-1.0, gap="one_flank"), "rest")


# --- l: counting ------------------------------------------------------------------------------


def test_decision_l_threshold_and_whole_flights():
    """Flights of depth 1, ε², ε⁴ … on a flat flank; cycle membership is that of the impact."""
    restitution, period = 0.5, 4.2
    osc = oscillator(period=period, restitution=restitution, contact_law="rigid")
    fall = math.sqrt(2)
    # Impacts at √2, 2√2, 2.5√2, 2.75√2 … -> 3√2 = 4.24; cycle 0 ends at 4.2.
    impacts = [fall * (3 - 2 * restitution**n) for n in range(40)]
    depths = [restitution ** (2 * n) for n in range(40)]
    run = simulate(osc, ("separation", -1.0, 0.0), cycles=2)
    in_first = sum(t < period for t in impacts)
    counted = sum(t < period and d > 0.01 for t, d in zip(impacts, depths, strict=True))
    assert (in_first, counted) == (7, 4)
    cycle = run.cycles.isel(cycle=0)
    assert (int(cycle["impacts"]), int(cycle["counted_impacts"])) == (in_first, counted)
    assert float(cycle["deepest_separation"]) == 1.0
    assert int(run.cycles["chatter_ends"].values[1]) == 1
    for threshold, n in ((0.0, 7), (0.3, 1), (0.2, 2), (0.99, 1), (1.0, 0)):
        other = simulate(osc, ("separation", -1.0, 0.0), cycles=1, count_depth=threshold)
        assert int(other.cycles["counted_impacts"].values[0]) == n


def test_decision_l_a_flight_over_the_end_of_a_cycle():
    """Depth 1 is reached in cycle 0, the impact falls in cycle 1: it counts there, whole."""
    osc = oscillator(period=2.0, restitution=0.1, contact_law="rigid")
    # v = √2: apex at √2, landing at 2√2 = 2.83; at the end of cycle 0 depth is still 0.83.
    run = simulate(osc, ("separation", 0.0, -math.sqrt(2)), cycles=2)
    first, second = (run.cycles.isel(cycle=i) for i in range(2))
    assert int(first["impacts"]) == 0 and int(first["counted_impacts"]) == 0
    assert float(first["deepest_separation"]) == pytest.approx(1.0, rel=4 * EPS)
    assert int(second["counted_impacts"]) == 2
    # The second cycle's own deepest point is where it begins: √2·2 - 2.
    assert float(second["deepest_separation"]) == pytest.approx(2 * math.sqrt(2) - 2, rel=8 * EPS)
    # Its impact brings the whole flight: depth 1 exceeds even the whole of that.
    all_of_it = simulate(osc, ("separation", 0.0, -math.sqrt(2)), cycles=2, count_depth=1.0)
    assert int(all_of_it.cycles["counted_impacts"].values[1]) == 1


def test_decision_l_cycles_are_counted_from_phase_zero():
    osc = oscillator(period=2.0, restitution=1.0, gap="one_flank")
    run = simulate(osc, ("separation", -0.5, 0.0), phase=0.75, cycles=3)
    # Impacts at 1, 3, 5 after a start at ¾ of cycle 0, which ends at ½: cycles 1, 2, 3; cycle 3
    # is not complete at the end, 3¾.
    assert run.events["cycle"].values.tolist() == [1, 2, 3]
    assert run.cycles["cycle"].values.tolist() == [0, 1, 2, 3]
    assert run.cycles["complete"].values.tolist() == [False, True, True, False]
    assert run.cycles["impacts"].values.tolist() == [0, 1, 1, 1]


def test_decision_l_impacts_that_go_on_into_the_flank_count():
    run = simulate(scene_a(1.8), cycles=30)
    late = run.cycles.isel(cycle=slice(20, None))
    assert set(late["impacts"].values) == {3} and set(late["counted_impacts"].values) == {3}
    assert set(late["engages"].values) == {1} and set(late["releases"].values) == {1}


def test_decision_l_back_penetration_is_reported_apart():
    osc = oscillator(backlash=1.0, contact_law="compliant", restitution=1.0, period=100.0)
    run = simulate(osc, ("separation", 0.0, -2.0), cycles=1, rtol=RTOL)
    assert float(run.cycles["deepest_separation"].values[0]) == pytest.approx(1.0, rel=4 * EPS)
    # In the coast flank from speed v_b = √2: y'' = -1 - … deepest y = -1 + √(1 + v_b²)  (F = 1
    # pulls out of it): φ'' = 1 - (φ + 1), from 0 inwards with √2.
    assert float(run.cycles["deepest_back_penetration"].values[0]) == pytest.approx(
        math.sqrt(3) - 1, rel=0, abs=RTOL * osc.period)


# --- m: period --------------------------------------------------------------------------------


# At 2.0 N·m a chaotic transient of a few hundred cycles, different for every rounding, ends in
# period 4; at 2.1 the motion stays chaotic.
@pytest.mark.parametrize(("torque", "period"), [(1.8, 1), (1.78, 2), (2.1, 0), (3.3, 1)])
def test_decision_m_periods_of_the_published_gear(torque, period):
    run = simulate(scene_a(torque), cycles=460)
    late = run.cycles.isel(cycle=slice(-100, None))
    counts = ("motion_state", "impacts", "back_impacts", "releases", "engages", "chatter_ends")
    labels = np.column_stack([late[name].values for name in counts])
    scale = max(run.oscillator.force, float(late["deepest_separation"].max()))
    assert find_period(late["phi"].values, late["phi_dot"].values, labels, scale) == period


def test_decision_m_smallest_period_and_tolerance():
    """More in studies/test_period.py."""
    n = np.arange(100)
    labels = np.zeros((100, 1))
    still = np.zeros(100)
    for p in (1, 2, 3, 24):
        assert find_period(np.cos(2 * np.pi * (n % p) / p), still, labels, 1.0) == p
    assert find_period(np.cos(2 * np.pi * (n % 25) / 25), still, labels, 1.0) == 0
    # Above 1e-8 of the size, for φ and φ' alike, states differ; below 1e-11 it is rounding.  (In
    # between a difference that does not fall is a slow drift.)
    for step, expected in ((0.9e-11, 1), (1.1e-8, 2)):
        assert find_period(step * (n % 2), still, labels, 1.0) == expected
        assert find_period(still, step * (n % 2), labels, 1.0) == expected
        assert find_period(5 * step * (n % 2), still, labels, 5.0) == expected
    # Motion state or events that differ are no repetition.
    assert find_period(still, still, (n % 3)[:, None], 1.0) == 3
    # max(2p, 8) pairs are wanted.
    assert find_period(still[:8], still[:8], labels[:8], 1.0) == 0
    assert find_period(still[:9], still[:9], labels[:9], 1.0) == 1
