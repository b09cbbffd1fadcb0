"""Where branches end and why: back on themselves, at corners, at corners that pile up."""

import math

import numpy as np
import pytest

from helpers import scene_a, scene_d
from lapwing import find_orbit
from lapwing.studies.branch import Kind, Outcome, branch
from lapwing.studies.branch.motion.witness import agrees, seen
from lapwing.studies.branch.run import begun, follower_of
from lapwing.studies.branch.trace.corner import PILED, piled_up


def relative(torque):
    return scene_a(torque, "relative")


def along_torque(make, torque, low, high, cycles=1, **options):
    orbit = find_orbit(make(torque), settle=2000, cycles=cycles)
    return branch(orbit, "brake_torque", low=low, high=high, **options)


def test_a_motion_over_six_cycles_is_followed_round_once():
    """Its isola leads to the same motion two cycles later, which is no other one."""
    found = along_torque(scene_d, 4.4, 4.0, 4.6, 6)
    assert {found.specials[0].kind, found.specials[-1].kind} <= {Kind.JOINS, Kind.CLOSED}
    folds = {round(one.value, 9) for one in found.of_kind(Kind.FOLD)}
    assert len(folds) == 2
    # Between its folds it is there twice, and no more often.
    assert len(found.passes(sum(folds) / 2)) == 2
    assert len(found.points) < 60


def test_a_branch_of_twice_the_period_ends_at_the_corner_where_it_meets_its_own():
    """At a release; a branch that went on would go twice along the one of half the period."""
    found = along_torque(scene_d, 11.7341, 11.7336, 11.7352, 4)
    for one in (found.specials[0], found.specials[-1]):
        assert (one.kind, one.outcome) == (Kind.RELEASE, Outcome.ENDS)
        assert one.value == pytest.approx(11.734312675036, abs=1e-10)
    assert max(found.values) < 11.73432


def test_chatters_of_which_one_goes_on_over_the_beginning_of_the_cycle():
    """Their bounces are put before their own ends each: the engine sees the same motion."""
    torque = 11.36
    osc = relative(torque)
    orbit = find_orbit(osc, settle=2000)
    problem = (follower := follower_of(relative, torque, 0.2, 14.0)).problem
    layout, z = begun(problem, orbit, torque)
    ends = np.flatnonzero(layout.kind == 3)
    assert len(ends) == 2 and ends[0] == 0
    assert agrees(layout, z, seen(problem, layout, z, follower.distance))


def test_corners_of_a_chatter_whose_bounces_pass_a_jump_of_the_curvature():
    """There a stable motion meets an unstable one without a multiplier of one."""
    found = along_torque(relative, 11.28, 11.2, 11.4, unstable=5)
    corners = [one for one in found.of_kind(Kind.KNOT) if one.outcome is Outcome.TURNS_BACK]
    values = sorted(one.value for one in corners)
    assert values[0] == pytest.approx(11.2561678235, abs=2e-9)
    assert all(one.error < 2e-9 for one in corners)
    at = next(k for one, k in zip(found.specials, found.positions, strict=True)
              if one is min(corners, key=lambda one: one.value))
    beside = [abs(found.points[k].multipliers[0]) for k in (at - 1, at, at + 1, at + 2)]
    assert min(beside) < 1 < max(beside)
    assert max(beside) - min(beside) > 0.1


def test_between_two_points_a_slow_bounce_passes_a_knot():
    """The motion at a value between them is that of the pieces it lies on there."""
    found = along_torque(relative, 10.24, 10.2, 10.3)
    for torque in np.linspace(10.21, 10.29, 9):
        point, = found.at(torque)
        orbit = find_orbit(relative(torque), settle=400)
        _, phi, phi_dot = found.state(point)
        size = found.follower.problem.scale
        assert abs(phi - orbit.state[1]) < 1e-9 * size
        assert abs(phi_dot - orbit.state[2]) < 1e-9 * size


@pytest.mark.parametrize(("ratio", "piles"), [(0.8, True), (1.0, False), (-0.8, False)])
def test_corners_pile_up_as_a_geometric_series_does(ratio, piles):
    """At its limit, once they lie close together."""
    follower = follower_of(relative, 11.0, 0.0, 10.0)
    for k in range(60):
        found = piled_up(follower, 3.0 + math.fsum(0.01 * ratio**j for j in range(k)))
        if found is not None:
            break
    assert (found is not None) is piles
    if piles:
        assert k > PILED
        assert found[0] == pytest.approx(3.0 + 0.01 / (1 - ratio), abs=1e-12)
        assert 0 < found[1] < 1e-2
