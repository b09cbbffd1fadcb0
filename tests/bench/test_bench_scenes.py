"""The scenes are what they are said to be, and the rivals are given the same motion."""

from itertools import pairwise

import numpy as np
import pytest

from helpers import EPS, PAIR, SHIPPED
from lapwing import critical_torque
from lapwing_bench import scenes
from lapwing_bench.problem import problem
from lapwing_bench.reference import load
from lapwing_bench.scenes import SCENES


def test_the_gear_is_the_published_one():
    assert scenes.PAIR == PAIR


def test_torques():
    assert scenes.TORQUES[0] == 0.5 and scenes.TORQUES[-1] == 14 and len(scenes.TORQUES) == 64
    assert SCENES["S1"].torques == (12.0,)
    assert all(scene.torques == scenes.TORQUES for name, scene in SCENES.items() if name != "S1")


def test_scene_a_is_the_shipped_example():
    for name in ("knots", "coefficients", "kinks"):
        assert np.array_equal(getattr(SCENES["A"].te, name), getattr(SHIPPED, name))
    assert SCENES["A"].mesh_frequency_hz * 60 == 240 * PAIR.pinion_teeth


def test_kinked_parabola():
    """Δφ = -4 A u² with u from -½ to ½ periods, the slope jumping up by 8 A at the kink."""
    te, phase = SCENES["S4"].te, np.array([0.0, 0.1, 0.4, 0.6, 0.9])
    u = np.where(phase < 0.5, phase, phase - 1)
    assert te.value(phase) == pytest.approx(-4 * 5e-5 * u**2, rel=0, abs=8 * EPS * 5e-5)
    assert te.slope_jumps() == pytest.approx([0.0, 8 * 5e-5], rel=8 * EPS)


def test_s1_never_leaves_contact():
    scene = SCENES["S1"]
    assert critical_torque(scene.oscillators[0])[0] < 12
    assert load("S1", "series_true")[12.0].events["kind"].size == 0


@pytest.mark.parametrize("name", SCENES)
def test_rivals_are_given_the_same_flank(name):
    osc = SCENES[name].oscillators[0]
    given = problem(osc)
    # Off the knots, where the table has one value; over several cycles.
    tau = (np.array([0.01, 0.26, 0.49, 0.51, 0.88, 0.93, 1.2, 2.7, 3.97])) * osc.period
    scale = osc.flank_scale * np.abs(osc.te.curvature(tau / osc.period)).max()
    for t in tau:
        arc = given.arc_at(t)
        # A harmonic's table is good to 1e-8 in curvature and 1e-10 in slope (`harmonic`).
        assert given.curvature(arc, t) * osc.period**2 == pytest.approx(
            osc.flank_scale * float(osc.te.curvature(t / osc.period)), rel=0, abs=2e-8 * scale)
        assert given.slope(arc, t) * osc.period == pytest.approx(
            osc.flank_scale * float(osc.te.slope(t / osc.period)), rel=0, abs=1e-9 * scale)


@pytest.mark.parametrize("name", ["S4", "A"])
def test_arcs_follow_each_other_without_gap(name):
    given = problem(SCENES[name].oscillators[0])
    stretches = given.stretches(0.0, 3 * given.period)
    assert stretches[0][0] == 0 and stretches[-1][1] == pytest.approx(3 * given.period, rel=EPS)
    ends = [stop for _, stop, _ in stretches]
    assert ends[:-1] == [begin for begin, _, _ in stretches[1:]]
    for (_, stop, arc), (begin, _, after) in pairwise(stretches):
        # The slope at the end of an arc, and what the jump makes of it.
        reached = given.slope(arc, stop * (1 - 4 * EPS)) + after.jump
        assert reached == pytest.approx(after.slope, rel=0, abs=1e-9 * given.largest_pull
                                        * given.period)
        assert begin == stop
