"""Curves of special points in two parameters against closed forms, and against branches.

Most are of the bouncing ball (docs/model.md), whose fold and doubling are known for every
restitution, and of its like, whose torques go with the square of the speed.
"""

import math
from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest
from scipy.optimize import brentq

from helpers import PAIR, ball, ball_start, oscillator, scene_a, scene_c
from lapwing import TransmissionError, curve, find_orbit, simulate
from lapwing.studies.branch import Kind, Outcome, branch


def saddle_node(restitution):
    return math.pi * (1 - restitution) / (1 + restitution)


def doubling(restitution):
    return math.hypot(saddle_node(restitution), 2 * (1 + restitution**2) / (1 + restitution)**2)


def ends(found):
    return [one.kind for one in (found.meetings[0], found.meetings[-1])]


def check_errors(found, expected, slope, where=True, more=0.0):
    """What is told of errors holds, across the curve, and says something."""
    told = found.error + np.abs(slope) * found.second_error + more
    assert np.all((np.abs(found.values - expected) <= told)[where])
    assert np.median(told) < 1e-12 and np.all(told[where] < 1e-10)


def begun_at(osc, phase, restitution):
    """The orbit with one impact in each mesh cycle, at that phase."""
    speed = -restitution * osc.period * osc.force / (1 + restitution)
    run = simulate(osc, ("separation", 0.0, speed), phase=phase, cycles=1 - phase).final
    return find_orbit(osc, (run.motion_state, run.phi, run.phi_dot))


@pytest.fixture(scope="module")
def ball_branch():
    eps = 0.7
    return branch(find_orbit(ball(0.9, eps), ball_start(0.9, eps)),
                  lambda gamma: ball(gamma, eps), value=0.9, low=0.4, high=1.4)


@pytest.mark.parametrize(("kind", "exact"), [
    (Kind.FOLD, saddle_node), (Kind.PERIOD_DOUBLING, doubling)])
def test_fold_and_doubling_of_the_ball(ball_branch, kind, exact):
    special, = ball_branch.of_kind(kind)
    found = curve(ball_branch, special, ball, low=0.5, high=0.9, value=0.7)
    assert found.kind is kind and ends(found) == [Kind.LIMIT, Kind.LIMIT]
    expected = np.array([exact(restitution) for restitution in found.second])
    assert found.values == pytest.approx(expected, rel=1e-12)
    slope = [(exact(one + 1e-6) - exact(one - 1e-6)) / 2e-6 for one in found.second]
    check_errors(found, expected, slope)
    # As far as the ranges go, and close enough for a line.
    assert found.second.min() == pytest.approx(0.5) or found.values.max() == pytest.approx(1.4)
    assert np.abs(np.diff(found.second)).max() < 0.03 * 0.4


@pytest.mark.full
def test_a_curve_ends_at_the_greatest_value_allowed(ball_branch):
    special, = ball_branch.of_kind(Kind.PERIOD_DOUBLING)
    found = curve(ball_branch, special, "restitution", low=0.7, high=1.0)
    assert (found.second.min(), found.second.max()) == (pytest.approx(0.7, rel=1e-15), 1.0)
    assert found.values[np.argmax(found.second)] == pytest.approx(1.0, rel=1e-12)


def test_grazing_meets_a_fold():
    """The coast flank is touched at n²P²F/8 - A cos u, on both sides of the fold at Γ = 1."""
    gamma, eps = 1.0, 0.7

    def gap(backlash, restitution=eps):
        return ball(gamma, restitution, backlash=backlash, back_flank_te=False)

    middle = math.pi**2 / 2
    exact = middle + math.sqrt(1 - saddle_node(eps)**2)
    found = branch(find_orbit(gap(1.1 * exact), ball_start(gamma, eps)), "backlash",
                   low=0.7 * exact, high=1.9 * exact)
    graze = next(one for one in found.of_kind(Kind.GRAZING)
                 if one.value == pytest.approx(exact, rel=1e-9))
    along = curve(found, graze, gap, low=0.5, high=0.72, value=eps)
    height = np.sqrt(np.clip(1 - saddle_node(along.second)**2, 0, None))
    assert np.abs(along.values - middle) == pytest.approx(height, abs=1e-7)
    far = height > 0.1  # closer to the fold the root magnifies what is left of 1 - sin²
    assert np.abs(along.values - middle)[far] == pytest.approx(height[far], rel=1e-12)
    slope = 2 * math.pi * saddle_node(along.second) / (1 + along.second)**2 / np.fmax(height, 1e-9)
    check_errors(along, np.where(along.values > middle, middle + height, middle - height), slope,
                 far)
    assert (along.values > middle).any() and (along.values < middle).any()
    fold, = [one for one in along.meetings if one.kind is Kind.FOLD]
    assert fold.outcome is Outcome.PERSISTS
    assert along.place(fold) == pytest.approx((middle, (math.pi - 1) / (math.pi + 1)), rel=1e-12)
    # From the motion that strikes the flank, where it loses the impact: the other side.
    lost, = [one for one in found.of_kind(Kind.GRAZING) if "lost" in one.words]
    other = curve(found, lost, gap, low=0.69, high=0.71, value=eps)
    height = np.sqrt(1 - saddle_node(other.second)**2)
    assert other.values == pytest.approx(middle - height, rel=1e-12)


@pytest.mark.full
def test_an_impact_at_a_kink():
    """The cusp-up parabola, P = 1: the impact comes upon the kink at F = 8(1 + ε)/(1 - ε)."""
    eps = 0.6

    def make(force, restitution):
        return oscillator(TransmissionError.parabola(-1.0), force=force, period=1.0,
                          restitution=restitution, damping_ratio=0.1)

    kink = 8 * (1 + eps) / (1 - eps)
    force = 0.7 * kink
    phase = 0.5 - force / 16 * (1 - eps) / (1 + eps)
    found = branch(begun_at(make(force, eps), phase, eps), lambda one: make(one, eps), value=force,
                   low=0.5 * kink, high=1.5 * kink)
    special, = found.of_kind(Kind.KINK)
    along = curve(found, special, make, low=0.5, high=0.7, value=eps)
    expected = 8 * (1 + along.second) / (1 - along.second)
    assert along.values == pytest.approx(expected, rel=1e-12)
    check_errors(along, expected, 16 / (1 - along.second)**2)
    assert ends(along) == [Kind.LIMIT, Kind.LIMIT]


@pytest.mark.full
def test_two_folds_meet_in_a_cusp():
    """The impact is where -g' = (PF/2)(1-ε)/(1+ε), folds where g'' = 0: cusp where g''' is, too.

    Its phase u and both harmonics: cos u + 4s cos(2u + a) = 0 = sin u + 8s sin(2u + a).
    """
    eps, cusp = 0.5, 2.0
    second = complex(-math.cos(cusp) / 4, -math.sin(cusp) / 8)
    shift = math.atan2(second.imag, second.real) - 2 * cusp

    def make(force, size):
        return oscillator(curve_of(size), force=force, period=2 * math.pi, restitution=eps,
                          damping_ratio=0.1, contact_law="rigid", gap="one_flank")

    @lru_cache
    def curve_of(size):
        return TransmissionError.harmonic([1.0, size], [0.0, shift], [1, 2])

    size = 1.05 * abs(second)

    def slope(angle, size=size):
        return -math.sin(angle) - 2 * size * math.sin(2 * angle + shift)

    def bend(angle, size=size):
        return -math.cos(angle) - 4 * size * math.cos(2 * angle + shift)

    def force(angle, size=size):
        return -slope(angle, size) * (1 + eps) / (math.pi * (1 - eps))

    away = (cusp + 0.4) / (2 * math.pi)
    ends_of_range = sorted((force(cusp - 0.4), force(cusp + 0.4)))
    found = branch(begun_at(make(force(cusp + 0.4), size), away, eps),
                   lambda one: make(one, size), value=force(cusp + 0.4),
                   low=ends_of_range[0] - 0.2, high=ends_of_range[1] + 0.2)
    fold = min(found.of_kind(Kind.FOLD), key=lambda one: abs(one.value - force(cusp)))
    along = curve(found, fold, make, low=0.98 * abs(second), high=1.2 * abs(second), value=size)
    meeting, = [one for one in along.meetings if one.kind is Kind.FOLD]
    assert meeting.outcome is Outcome.PERSISTS and "cusp" in meeting.words
    assert along.place(meeting) == pytest.approx((force(cusp, abs(second)), abs(second)), rel=1e-10)
    # Both folds, on either side of the cusp.
    for value, number in zip(along.values[::7], along.second[::7], strict=True):
        sides = [(cusp - 0.5, cusp), (cusp, cusp + 0.5)]
        folds = [force(brentq(bend, *side, (number,), xtol=1e-15), number) for side in sides
                 if bend(side[0], number) * bend(side[1], number) < 0]
        assert min(abs(value - one) for one in folds) < 1e-9


@pytest.fixture(scope="module")
def three_harmonics():
    """Scene C, its motion with one impact, and the phases of its folds and doublings."""
    return branch(find_orbit(scene_c(1.8, contact_law="rigid", gap="one_flank"), settle=400),
                  "brake_torque", low=0.5, high=6.0)


@pytest.mark.full
@pytest.mark.parametrize("second", ["restitution", "pinion_speed_rpm", "te_scale"])
def test_folds_of_a_gear_pair(three_harmonics, second):
    """F = -2g'(1 + ε)/(P(1 - ε)) at g'' = 0: as the square of the speed, as the curve's scale."""
    te = three_harmonics.follower.problem.make(1.0).te
    own = {"restitution": 0.8, "pinion_speed_rpm": 1500.0, "te_scale": 1.0}[second]

    def make(torque, number):
        given = {"pinion_speed_rpm": 1500.0, "te_scale": 1.0, second: number}
        pair = PAIR
        if second == "restitution":
            pair = replace(PAIR, restitution=given.pop(second))
        return pair.oscillator(te, brake_torque=torque, contact_law="rigid", gap="one_flank",
                               **given)

    fold = three_harmonics.of_kind(Kind.FOLD)[0]
    found = curve(three_harmonics, fold, make, low=0.8 * own, high=1.2 * own, value=own)
    ratio = found.second / own
    scale = {"restitution": lambda: (1 + found.second) / (1 - found.second) / 9,
             "pinion_speed_rpm": lambda: ratio**2, "te_scale": lambda: ratio}[second]()
    expected = scale * fold.value
    assert found.values == pytest.approx(expected, rel=1e-10)
    assert found.second.min() == pytest.approx(0.8 * own) and found.second.max() > 1.05 * own
    slope = {"restitution": 2 / 9 / (1 - np.fmin(found.second, 0.99))**2,
             "pinion_speed_rpm": 2 * ratio / own,
             "te_scale": np.full(ratio.shape, 1 / own)}[second] * fold.value
    check_errors(found, expected, slope, more=scale * fold.error)


@pytest.mark.full
def test_a_release_is_lost_where_the_curve_says():
    """Compliant: a branch at another damping loses its release on the curve, to 1e-11."""
    def make(torque, damping=0.1):
        return replace(scene_a(torque, "relative", contact_law="compliant"), damping_ratio=damping)

    found = branch(find_orbit(make(6.2), settle=400), "brake_torque", low=6.0, high=7.0)
    special, = found.of_kind(Kind.RELEASE)
    along = curve(found, special, "damping_ratio", low=0.095, high=0.1)
    assert along.kind is Kind.RELEASE and Kind.LIMIT in ends(along)
    k = int(np.argmin(along.second))
    value, damping = along.values[k], along.second[k]
    other = branch(find_orbit(make(value - 0.3, damping), settle=400),
                   lambda torque: make(torque, damping), value=value - 0.3, low=6.0, high=7.0)
    one, = other.of_kind(Kind.RELEASE)
    assert one.value == pytest.approx(value, rel=1e-11)
    assert abs(one.value - value) <= one.error + along.error[k] + 100 * along.second_error[k]


@pytest.mark.full
def test_a_curve_passes_the_special_points_of_other_branches():
    """Scene A: where a motion ends at another speed lies where the curve says, to 1e-10."""
    torque, own = 1.8, scene_a(1.8).mesh_frequency_ratio
    found = branch(find_orbit(scene_a(torque), settle=300), "brake_torque", low=1.0, high=3.5)
    ends_of_it = (found.specials[0], found.specials[-1])
    assert {one.kind for one in ends_of_it} == {Kind.REBOUND}
    for special in ends_of_it:
        along = curve(found, special, "mesh_frequency_ratio", low=0.98 * own, high=1.02 * own)
        k = int(np.argmin(np.abs(along.second - 1.004 * own)))
        value, ratio = along.values[k], along.second[k]

        def make(one, ratio=ratio):
            return replace(scene_a(one), mesh_frequency_ratio=ratio)

        into = 0.02 * math.copysign(1, torque - special.value)
        beside = found.state(found.at(special.value + into)[0])
        other = branch(find_orbit(make(value + into), beside), make, value=value + into, low=1.0,
                       high=3.5)
        nearest = min(other.of_kind(Kind.REBOUND), key=lambda one: abs(one.value - value))
        assert nearest.value == pytest.approx(value, rel=1e-10)


def test_what_is_refused(ball_branch):
    fold, = ball_branch.of_kind(Kind.FOLD)
    with pytest.raises(ValueError, match="there are curves of fold"):
        curve(ball_branch, ball_branch.specials[0], "restitution", low=0.5, high=0.9)
    with pytest.raises(ValueError, match="lies outside"):
        curve(ball_branch, fold, "restitution", low=0.8, high=0.9)
    with pytest.raises(ValueError, match="second"):
        curve(ball_branch, fold, "speed", low=0.5, high=0.9)
    with pytest.raises(ValueError, match="expected is the branch's own value"):
        curve(ball_branch, fold, ball, low=0.5, high=0.9)
    assert "fold points" in repr(curve(ball_branch, fold, "restitution", low=0.69, high=0.71))
