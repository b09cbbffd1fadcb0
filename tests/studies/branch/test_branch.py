"""Branches against closed forms: folds, doublings, grazing, kinks, a cascade, through chatter.

Most are of the bouncing ball (docs/model.md): one impact a cycle, sin u = nπ(1-ε)/(Γ(1+ε)), trace
1 + ε² - (1+ε)²·g''/F, determinant ε².  What is located has no error but rounding: 1e-12.
"""

import math

import numpy as np
import pytest

from helpers import PAIR, ball, ball_start, oscillator, scene_a, scene_c, scene_d
from lapwing import (
    MotionState,
    NoOrbit,
    critical_torque,
    find_orbit,
    simulate,
)
from lapwing.studies.branch import Kind, Outcome, branch


def saddle_node(restitution, n=1):
    return n * math.pi * (1 - restitution) / (1 + restitution)


def doubling(restitution):
    return math.hypot(saddle_node(restitution), 2 * (1 + restitution**2) / (1 + restitution)**2)


def ball_branch(restitution, low, high, gamma=None, **options):
    """The one-impact orbit of the ball, from between fold and doubling unless told otherwise."""
    gamma = gamma or 0.5 * (saddle_node(restitution) + doubling(restitution))
    orbit = find_orbit(ball(gamma, restitution, **options), ball_start(gamma, restitution))
    return branch(orbit, lambda value: ball(value, restitution, **options), value=gamma, low=low,
                  high=high)


def only(found, kind):
    special, = found.of_kind(kind)
    return special


@pytest.mark.parametrize(("restitution", "contact_law"), [
    (0.5, "rigid"), (0.8, "restitution"), pytest.param(0.9, "rigid", marks=pytest.mark.full)])
def test_fold_and_doubling_of_the_ball(contact_law, restitution):
    """Through the fold onto the saddle, through the doubling onto the unstable node."""
    low, high = 0.9 * saddle_node(restitution), 1.03 * doubling(restitution)
    found = ball_branch(restitution, low, high, contact_law=contact_law)
    fold, flip = only(found, Kind.FOLD), only(found, Kind.PERIOD_DOUBLING)
    assert fold.value == pytest.approx(saddle_node(restitution), rel=1e-12)
    assert flip.value == pytest.approx(doubling(restitution), rel=1e-12)
    # What is told of the error holds, and says something.
    for special, exact in ((fold, saddle_node(restitution)), (flip, doubling(restitution))):
        assert abs(special.value - exact) <= special.error < 1e-11
    assert fold.outcome is Outcome.TURNS_BACK and flip.outcome is Outcome.PERSISTS
    # Near a fold a multiplier moves as the root of the distance.
    assert fold.multipliers == pytest.approx([1, restitution**2], abs=1e-7)
    assert flip.multipliers == pytest.approx([-1, -restitution**2], abs=1e-11)
    ends = [found.specials[0], found.specials[-1]]
    assert {end.kind for end in ends} <= {Kind.LIMIT, Kind.GRAZING}
    # The saddle below, and the focus or node above: both are there, to the closed form.
    stable = {True: 0, False: 0}
    for point in found.points:
        phase = 2 * math.pi * point.place.z[0]
        assert math.sin(phase) == pytest.approx(saddle_node(restitution) / point.value, abs=1e-11)
        trace = 1 + restitution**2 + (1 + restitution)**2 * point.value * math.cos(phase)
        assert point.trace == pytest.approx(trace, abs=1e-9)
        assert point.det == pytest.approx(restitution**2, rel=1e-12)
        stable[point.stable] += 1
    assert min(stable.values()) > 3


def coast_touched(gamma, restitution):
    """Backlash at which the ball's flight reaches a standing coast flank: n²P²F/8 - A cos u."""
    angle = math.pi - math.asin(saddle_node(restitution) / gamma)
    return (2 * math.pi)**2 / gamma / 8 - math.cos(angle)


@pytest.mark.parametrize(("gamma", "restitution"), [(1.0, 0.7), (1.2, 0.5), (0.6, 0.8)])
def test_grazing_of_the_coast_flank(gamma, restitution):
    """There the branch turns back: the motion with a coast impact lies at wider gaps, too."""
    def gap(backlash):
        return ball(gamma, restitution, backlash=backlash, back_flank_te=False)

    exact = coast_touched(gamma, restitution)
    orbit = find_orbit(gap(1.2 * exact), ball_start(gamma, restitution))
    found = branch(orbit, "backlash", low=0.9 * exact, high=1.3 * exact)
    graze = found.of_kind(Kind.GRAZING)[-1]
    assert graze.value == pytest.approx(exact, rel=1e-12)
    assert (graze.flank, graze.outcome) == (2, Outcome.TURNS_BACK)
    assert abs(graze.value - exact) <= graze.error < 1e-10 * exact
    # From the other side, along the motion that strikes: an impact is lost at the same place.
    beyond = next(point for point in found.points if point.place.layout.n == 2
                  and 1e-4 < point.value - exact < 0.1 * exact)
    again = branch(found.orbit(beyond), "backlash", low=0.9 * exact, high=1.3 * exact)
    lost = min(again.of_kind(Kind.GRAZING), key=lambda one: abs(one.value - exact))
    assert lost.value == pytest.approx(exact, rel=1e-12)


@pytest.mark.full
def test_impacts_are_born_until_a_chatter_is_complete():
    """The ball's saddle, ε = 0.3: grazes that pile up where F = g'', and what lies beyond."""
    found = ball_branch(0.3, 1.65, 2.6)
    grazes, onset = found.of_kind(Kind.GRAZING), only(found, Kind.CHATTER)
    assert len(grazes) > 5
    steps = np.abs(np.diff([one.value for one in grazes]))
    steps = steps[(steps > 1e-8) & (steps < 1e-5)]
    # Each bounce is ε times as fast as the one before, and so shrink the distances.
    assert len(steps) > 3 and steps[1:] / steps[:-1] == pytest.approx(1 / 0.3, rel=0.1)
    assert onset.error < 1e-9 * onset.value
    assert -onset.value * math.cos(2 * math.pi * onset.phase) == pytest.approx(1, abs=1e-4)
    chattering = [point for point in found.points if point.place.layout.chatters]
    assert chattering and all(point.rank == 1 for point in chattering)


def test_one_impact_orbits_of_three_harmonics():
    """Scene C: three folds where g'' = 0, a doubling where (1+ε)²g'' = 2(1+ε²)F.

    The impact is where -g' = (PF/2)(1-ε)/(1+ε); along the branch its phase falls.
    """
    from scipy.optimize import brentq

    eps, some = PAIR.restitution, scene_c(2.0)
    period, unit = some.period, PAIR.force_per_torque

    def g(order, phase):
        return some.flank_scale * float(some.te.derivative(order, phase)) / period**order

    def torque(phase):
        return -2 * g(1, phase) * (1 + eps) / (period * (1 - eps)) / unit

    def flips(phase):
        return (1 + eps)**2 * g(2, phase) - 2 * (1 + eps**2) * torque(phase) * unit

    exact = [torque(brentq(lambda phase: g(2, phase), *ends, xtol=1e-15))
             for ends in ((0.25, 0.3), (0.15, 0.25), (0.05, 0.1))]
    flip = torque(brentq(flips, 0.55, 0.58, xtol=1e-15))
    # The orbit half way, from just after its impact.
    phase = 0.45
    osc = scene_c(torque(phase), contact_law="rigid", gap="one_flank")
    begun = simulate(osc, ("separation", 0.0, -eps * period * osc.force / (1 + eps)), phase=phase,
                     cycles=1 - phase).final
    orbit = find_orbit(osc, (begun.motion_state, begun.phi, begun.phi_dot))
    found = branch(orbit, "brake_torque", low=0.5 * flip, high=1.1 * exact[-1])
    folds = [one.value for one in found.of_kind(Kind.FOLD)]
    for value in exact:
        assert value in [pytest.approx(one, rel=1e-12) for one in folds]
    assert flip in [pytest.approx(one.value, rel=1e-12)
                    for one in found.of_kind(Kind.PERIOD_DOUBLING)]


SCENES = {
    "absolute": lambda torque: scene_a(torque), "chatter": scene_d,
    "compliant": lambda torque: scene_a(torque, "relative", contact_law="compliant"),
    "standing": lambda torque: scene_a(torque, back_flank_te=False)}


@pytest.mark.parametrize(("name", "torque", "width"), [
    ("absolute", 1.8, 0.5), ("chatter", 8.0, 0.2), ("compliant", 5.5, 0.5), ("standing", 3.3, 0.5)])
def test_the_engine_and_rk4_confirm_the_motions(name, torque, width):
    """Multipliers, and where each cycle leads, stable or not, by both methods of the engine."""
    make = SCENES[name]
    found = branch(find_orbit(make(torque), settle=200), "brake_torque", low=torque - width,
                   high=torque + width)
    assert len(found.points) > 5
    for point in found.points[1:-1:max(1, len(found.points) // 6)]:
        orbit = found.orbit(point)
        assert orbit.cycles == found.cycles and orbit.multipliers.rank == point.rank
        largest = max(1.0, abs(point.multipliers[0]))
        assert point.multipliers == pytest.approx(orbit.multipliers.values, abs=1e-8 * largest)
        state = found.state(point)
        ends = [simulate(orbit.oscillator, state, cycles=1, method=method, rtol=1e-12).final
                for method in ("exact", "rk4")]
        for end in ends:
            assert end.motion_state == state[0]
            # 1e-12 of the motion, grown by what the map makes of it.
            assert np.abs([end.phi - state[1], end.phi_dot - state[2]]).max() \
                < 1e-9 * largest * orbit.size


def test_the_end_of_the_range_is_the_greatest_value_allowed():
    """No oscillator has a restitution above 1: neither a step nor a difference may ask for one."""
    def make(restitution):
        return ball(1.0, restitution)

    found = branch(find_orbit(make(0.8), ball_start(1.0, 0.8)), make, value=0.8, low=0.8, high=1.0)
    end = found.specials[-1]
    assert (end.kind, end.value) == (Kind.LIMIT, 1.0)
    assert np.prod(end.multipliers) == pytest.approx(1.0, abs=1e-9)
    back = branch(found.orbit(end), make, value=1.0, low=0.8, high=1.0)
    assert [one.value for one in (back.specials[0], back.specials[-1])] == [0.8, 1.0]


def test_a_doubled_branch_comes_back_to_the_one_it_left():
    """Scene A with a compliant contact: a bubble of period 2 between two doublings, or its end."""
    found = ball_branch(0.7, 0.8, 1.25)
    flip = only(found, Kind.PERIOD_DOUBLING)
    doubled = found.switched(flip)
    assert doubled.cycles == 2
    middle = doubled.points[len(doubled.points) // 2]
    one, two = middle.place.z[1:-1:2][:2]
    assert abs(one - two) > 1e-3
    assert find_orbit(ball(middle.value, 0.7), doubled.state(middle), 2).cycles == 2


def test_what_is_refused():
    orbit = find_orbit(ball(1.0, 0.7), ball_start(1.0, 0.7))
    with pytest.raises(ValueError, match="lies outside"):
        branch(orbit, "force", low=2.0, high=3.0)
    with pytest.raises(ValueError, match="must be below"):
        branch(orbit, "force", low=2.0, high=1.0)
    with pytest.raises(ValueError, match="parameter"):
        branch(orbit, "torque", low=0.5, high=2.0)
    with pytest.raises(ValueError, match="expected is the orbit's own value"):
        branch(orbit, lambda value: ball(value, 0.7), low=0.5, high=2.0)
    found = branch(orbit, "force", low=0.95, high=1.05)
    with pytest.raises(ValueError, match="a period doubling"):
        found.switched(found.specials[0])
    engaged = find_orbit(scene_a(13.0), settle=100)
    with pytest.raises(NoOrbit, match="without events"):
        branch(engaged, "brake_torque", low=12.0, high=14.0)


def test_a_motion_that_is_one_of_a_family_begins_no_branch():
    """Nothing is lost: a bounce on a flat flank may have any phase."""
    osc = oscillator(force=1.0, period=2 * math.sqrt(8), restitution=1.0, damping_ratio=0.1)
    orbit = find_orbit(osc, (0, 0.0, -math.sqrt(8)), 1)
    with pytest.raises(NoOrbit, match="a multiplier of it is 1"):
        branch(orbit, "force", low=0.9, high=1.1)


def test_state_and_value_of_a_branch():
    found = ball_branch(0.7, 0.8, 1.1)
    below, = found.at(0.95)
    assert below.value == pytest.approx(0.95, rel=1e-15)
    assert found.state(below)[0] is MotionState.SEPARATION
    assert found.state(below)[1:] == pytest.approx(ball_start(0.95, 0.7)[1:], abs=1e-12)


@pytest.mark.parametrize("contact_law", ["compliant", "restitution"])
def test_the_last_separation_vanishes_at_the_torque_of_complete_engagement(contact_law):
    """With bounces the motion outlives it: a fold, and back to where the engaged one begins."""
    full = critical_torque(scene_a(1.0))[0]

    def make(torque):
        return scene_a(torque, "relative", contact_law=contact_law)

    orbit = find_orbit(make(full - 0.005), settle=400)
    found = branch(orbit, "brake_torque", low=full - 0.03, high=full + 0.03)
    *others, end = found.specials
    if end.kind is not Kind.ENGAGED:
        end, *others = found.specials
    assert (end.kind, end.outcome) == (Kind.ENGAGED, Outcome.ENDS)
    assert end.value == pytest.approx(full, rel=1e-11)
    assert abs(end.value - full) <= end.error < 1e-10
    folds = [one for one in others if one.kind is Kind.FOLD]
    assert len(folds) == (contact_law == "restitution")
    for fold in folds:
        # Twenty bounces and more at every point, some less the nearer the end.
        assert 5e-6 < fold.value - full < 2e-5
        assert all(point.rank == 1 for point in found.points)
        above = found.at(0.5 * (fold.value + full))
        assert [point.stable for point in above].count(True) == 1 and len(above) == 2


def test_where_the_map_jumps_it_does_not_end_there():
    """`absolute`: the last arrival still throws the tooth, and no engaged motion is near."""
    full = critical_torque(scene_a(1.0))[0]
    found = branch(find_orbit(scene_a(full - 0.01), settle=400), "brake_torque", low=full - 0.05,
                   high=full + 0.05)
    assert not found.of_kind(Kind.ENGAGED)
    last = max((one for one in found.specials if one.outcome is Outcome.ENDS),
               key=lambda one: one.value)
    assert last.kind is not Kind.LIMIT and 1e-4 < full - last.value < 1e-3
