"""Branches that are hard to follow: isolas, folds close to each other, long periods.

Those of the bouncing ball are in closed form (test_branch.py): a motion with one impact every n
mesh cycles exists from Γ_SN = nπ(1-ε)/(1+ε) on.
"""

import math

import numpy as np
import pytest
from scipy.optimize import brentq

from helpers import COSINE, ball, ball_start, oscillator, scene_a
from lapwing import TransmissionError, find_orbit, simulate
from lapwing.studies.branch import Kind, branch


def saddle_node(restitution, n=1):
    return n * math.pi * (1 - restitution) / (1 + restitution)


def test_an_isola_closes():
    """Γ = Γ_SN + δ(1 - (p/h)²): node and saddle meet at p = ±h and nowhere else."""
    eps, height, half = 0.7, 0.3, 0.8

    def make(p):
        return ball(saddle_node(eps) + height * (1 - (p / half)**2), eps)

    orbit = find_orbit(make(0.0), ball_start(saddle_node(eps) + height, eps))
    found = branch(orbit, make, value=0.0, low=-1.0, high=1.0)
    folds = sorted(one.value for one in found.of_kind(Kind.FOLD))
    assert folds == [pytest.approx(-half, abs=1e-14), pytest.approx(half, abs=1e-14)]
    assert found.specials[-1].kind is Kind.CLOSED
    assert {point.stable for point in found.points} == {True, False}
    assert sorted(point.stable for point in found.at(0.25 * half)) == [False, True]


def test_two_folds_within_a_millionth():
    """Close to a cusp: the impact is where -g' = (PF/2)(1-ε)/(1+ε), its folds are where g'' = 0.

    The second harmonic is such that g'' and its slope vanish together, but for one part in 20,000.
    """
    eps, cusp = 0.5, 2.0
    second = complex(-math.cos(cusp) / 4, -math.sin(cusp) / 8)
    size, shift = abs(second) * (1 + 5e-5), math.atan2(second.imag, second.real) - 2 * cusp
    te = TransmissionError.harmonic([1.0, size], [0.0, shift], [1, 2])

    def derivative(order, angle):
        turned = [1j**order * np.exp(1j * angle),
                  (2j)**order * size * np.exp(1j * (2 * angle + shift))]
        return float(np.real(sum(turned)))

    def force(angle):
        return -derivative(1, angle) * (1 + eps) / (math.pi * (1 - eps))

    angles = np.linspace(cusp - 0.1, cusp + 0.1, 2001)
    bend = np.array([derivative(2, angle) for angle in angles])
    at = np.flatnonzero(bend[:-1] * bend[1:] < 0)
    exact = sorted(force(brentq(lambda angle: derivative(2, angle), angles[k], angles[k + 1],
                                xtol=1e-15)) for k in at)
    assert len(exact) == 2 and 1e-9 < exact[1] - exact[0] < 1e-6 * exact[1]
    away = cusp + 0.3

    def make(value):
        return oscillator(te, force=value, period=2 * math.pi, restitution=eps, damping_ratio=0.1,
                          contact_law="rigid", gap="one_flank")

    phase = (away / (2 * math.pi)) % 1
    begun = simulate(make(force(away)), ("separation", 0.0, -eps * 2 * math.pi * force(away)
                                         / (1 + eps)), phase=phase, cycles=1 - phase).final
    orbit = find_orbit(make(force(away)), (begun.motion_state, begun.phi, begun.phi_dot))
    ends = sorted((force(cusp - 0.3), force(away)))
    found = branch(orbit, "force", low=ends[0] - 0.2, high=ends[1] + 0.2)
    folds = [one for one in found.of_kind(Kind.FOLD)
             if abs(one.value - exact[0]) < 1e-5 * exact[0]]
    assert len(folds) == 2
    for one, value in zip(sorted(folds, key=lambda one: one.value), exact, strict=True):
        assert one.value == pytest.approx(value, rel=1e-12)
        assert abs(one.value - value) <= one.error < 1e-10


def test_a_motion_of_24_mesh_cycles():
    eps, n = 0.9, 24
    low, width = saddle_node(eps, n), 2 * (1 + eps**2) / (1 + eps)**2
    exact = math.hypot(low, width)
    gamma = 0.5 * (low + exact)

    def make(value):
        return ball(value, eps, gap="one_flank")

    orbit = find_orbit(make(gamma), ball_start(gamma, eps, n), n)
    assert orbit.cycles == n
    found = branch(orbit, make, value=gamma, low=0.9 * low, high=1.05 * exact)
    fold, = found.of_kind(Kind.FOLD)
    flip, = found.of_kind(Kind.PERIOD_DOUBLING)
    assert fold.value == pytest.approx(low, rel=1e-11)
    assert flip.value == pytest.approx(exact, rel=1e-11)
    assert abs(fold.value - low) <= fold.error and abs(flip.value - exact) <= flip.error
    assert found.cycles == n and found.points[0].place.layout.n == 1


def test_every_unstable_motion_is_one_of_runge_and_kutta_too():
    """Saddles of the ball and of scene A: each cycle leads where the branch says, by RK4."""
    scenes = [(branch(find_orbit(ball(0.9, 0.7), ball_start(0.9, 0.7)),
                      lambda value: ball(value, 0.7), value=0.9, low=0.5, high=1.0), 5),
              (branch(find_orbit(scene_a(1.77), settle=400, cycles=2), "brake_torque", low=1.7,
                      high=1.9), 7)]
    for found, every in scenes:
        unstable = [point for point in found.points[1:-1] if not point.stable
                    and np.all(np.isfinite(point.multipliers))]
        assert len(unstable) > 5
        for point in unstable[::every]:
            osc = found.follower.problem.oscillator(point.value)
            start = found.state(point)
            end = simulate(osc, start, cycles=found.cycles, method="rk4", rtol=1e-12).final
            grown = max(1.0, abs(point.multipliers[0]))
            assert end.motion_state == start[0]
            assert np.abs([end.phi - start[1], end.phi_dot - start[2]]).max() \
                < 1e-9 * grown * osc.angle_scale


def test_a_release_at_the_end_of_a_chatter():
    """Rigid: the rest after the bounces shrinks to nothing where F = g''; there the branch says so.

    g = cos u: the tooth is pressed as long as 1/Γ > -cos u.
    """
    eps = 0.3
    make = lambda gamma: oscillator(  # noqa: E731
        COSINE, force=1 / gamma, period=2 * math.pi, restitution=eps, contact_law="rigid",
        gap="one_flank", damping_ratio=0.1)
    orbit = find_orbit(make(1.2), settle=50)
    found = branch(orbit, make, value=1.2, low=1.05, high=3.0)
    assert found.points[0].place.layout.chatters
    ends = [one for one in found.specials if one.kind is Kind.CHATTER]
    assert ends
    end = ends[-1]
    # From beyond, grazes pile up there, each 0.3 times nearer than the one before: their limit.
    assert abs(end.value - 1.9469384825) < end.error < 1e-4
    # How long the rest is goes with the root of how far the value is off.
    assert -math.cos(2 * math.pi * end.phase) * end.value == pytest.approx(1, abs=1e-3)
