"""Floquet multipliers and Lyapunov exponents against exact values, and the rules they must keep.

Tangent maps of single events are tested in tests/fortran/test_tangent_map.f90; here whole motions.
"""

import math

import numpy as np
import pytest

from helpers import EPS, PAIR, ball, ball_start, oscillator, scene_a, scene_c, scene_d
from lapwing import MotionState, TransmissionError
from lapwing.engine import Numerics, TrajectoryCall, Wanted
from lapwing.studies.orbit import find_orbit, flip_distance, follow, settled_state
from lapwing.studies.stability import (
    CycleMaps,
    defects,
    exponents,
    growth,
    multiplied,
    multipliers,
    near_grazes,
    sum_rule,
)

FINE = Numerics(rtol=1e-13, chatter_tol=1e-13)
LAWS = ("restitution", "rigid")


def run_maps(osc, cycles, settle=400, start="rest", numerics=FINE):
    """Tangent maps and statistics of `cycles` cycles after so many to settle."""
    begin = settled_state(osc, settle, start, numerics=numerics) if settle else start
    state, *numbers = begin
    call = TrajectoryCall(osc, (float(state), *numbers, 0.0), numerics=numerics,
                          wanted=Wanted(cycles=True, tangent=True))
    call.run((cycles, 0.0), [])
    return CycleMaps.from_rows(call.tangent, osc.period), call.cycles


# --- the bouncing ball: exact -------------------------------------------------------------------


@pytest.mark.parametrize("contact_law", LAWS)
def test_one_impact_focus(contact_law):
    """Γ = 1, ε = 0.7: trace, determinant and ln ε/P to the stated digits."""
    orbit = find_orbit(ball(1.0, 0.7, contact_law), ball_start(1.0, 0.7))
    found = orbit.multipliers
    assert orbit.cycles == 1 and orbit.residual < 1e-14
    # g'' of the table is right to 1e-8 of its largest value; (1+ε)²Γ = 2.89 of it enter.
    assert found.trace == pytest.approx(-0.915205998511699, abs=2.89e-8)
    assert found.det_sign * math.exp(found.log_det) == pytest.approx(0.49, rel=8 * EPS)
    assert np.abs(found.values) == pytest.approx([0.7, 0.7], rel=1e-14)
    assert found.exponents == pytest.approx([-0.0567665804048739] * 2, rel=1e-14)
    assert found.stable and found.rank == 2 and not found.warning


@pytest.mark.parametrize("contact_law", LAWS)
@pytest.mark.parametrize(("gamma", "restitution", "n"), [
    (0.6, 0.7, 1), (1.16, 0.7, 1), (1.2, 0.5, 1), (1.8, 0.3, 1), (0.8, 0.8, 2), (0.9, 0.85, 3)])
def test_trace_of_the_one_impact_orbit(contact_law, gamma, restitution, n):
    """trace = 1 + ε² - (1+ε)²Γ|cos u|, det = ε²; the node's exponent is ln|λ|max/(nP)."""
    orbit = find_orbit(ball(gamma, restitution, contact_law), ball_start(gamma, restitution, n), n)
    cosine = math.sqrt(1 - (n * math.pi * (1 - restitution) / (1 + restitution) / gamma) ** 2)
    square = (1 + restitution) ** 2 * gamma
    trace = 1 + restitution**2 - square * cosine
    det = restitution**2
    assert orbit.multipliers.trace == pytest.approx(trace, abs=1e-8 * square)
    assert orbit.multipliers.log_det == pytest.approx(math.log(det), rel=1e-14)
    root = np.emath.sqrt(trace**2 - 4 * det)
    largest = max(abs(0.5 * (trace + root)), abs(0.5 * (trace - root)))
    # Near where both multipliers meet an error of the trace is magnified to its square root.
    slack = 1e-8 * square / max(abs(root), 1e-4) / largest
    assert orbit.multipliers.exponents[0] == pytest.approx(
        math.log(largest) / (2 * math.pi * n), abs=slack)


def test_the_saddle_of_the_cusp_down():
    """One impact under a parabola with its cusp down: trace 1 + ε² + (1+ε)²·8A/F, a saddle."""
    force, restitution = 20.0, 0.7
    osc = oscillator(TransmissionError.parabola(1.0), force=force, period=1.0,
                     restitution=restitution)
    # Impact at ½ + (F/16)(1-ε)/(1+ε); the kink of phase 0 then lies in the flight.
    phase = 0.5 + force / 16 * (1 - restitution) / (1 + restitution)
    speed = restitution * force / (1 + restitution)
    # Flight from the impact to phase 1 in θ, where g = -1 and, after the kink, g' = 4.
    g, slope = -4 * (phase - 0.5) ** 2, -8 * (phase - 0.5)
    time, rate = 1 - phase, slope - speed
    start = (MotionState.SEPARATION, g + time * (rate + 0.5 * force * time) + 1,
             rate + force * time - 4)
    orbit = find_orbit(osc, start)
    trace = 1 + restitution**2 + (1 + restitution) ** 2 * 8 / force
    assert orbit.multipliers.trace == pytest.approx(trace, rel=1e-12)
    assert orbit.multipliers.values[0].real > 1 and not orbit.multipliers.stable
    assert orbit.multipliers.values.prod().real == pytest.approx(restitution**2, rel=1e-13)


# --- whole motions ------------------------------------------------------------------------------


@pytest.mark.parametrize(("damping", "expected"), [
    (0.1, -0.1), (0.02, -0.02), (1.7, -1.7 + math.sqrt(1.7**2 - 1))])
@pytest.mark.parametrize("contact_law", ["restitution", "compliant"])
def test_engaged_motion_has_the_exponent_of_the_linear_oscillator(damping, expected, contact_law):
    osc = oscillator(TransmissionError.harmonic([1.0]), force=1e3, period=9.0,
                     damping_ratio=damping, contact_law=contact_law)
    orbit = find_orbit(osc, (MotionState.ENGAGEMENT, 1e3, 0.0))
    assert orbit.multipliers.exponents[0] == pytest.approx(expected, rel=1e-13)
    assert orbit.multipliers.exponents.sum() == pytest.approx(-2 * damping, rel=1e-13)


def test_elastic_bounce_on_a_fixed_wall_neither_grows_nor_decays():
    osc = oscillator(force=1.0, period=1.0, restitution=1.0)
    maps, _ = run_maps(osc, 4000, 0, (MotionState.SEPARATION, -2.0, 0.0))
    assert np.abs(maps.log_det).max() == 0
    found = exponents(maps)
    # The deviation grows linearly: ln(n)/n over 4000 cycles less the 100 for it to align.
    assert 0 < found.largest < math.log(4000 * 10) / 3900


@pytest.mark.parametrize(("torque", "det", "impacts"), [
    (1.8, -5.1001e-2, 3), (3.3, -5.1844e-4, 5), (5.5, -8.455e-5, 7)])
def test_determinant_of_the_source_s_motions(torque, det, impacts):
    """Scene A, absolute law, over a period: fourth-order differences of the map give the same
    (-0.0510014 at 1.8 N·m)."""
    osc = scene_a(torque)
    orbit = find_orbit(osc, settled_state(osc, 300))
    found = orbit.multipliers
    assert orbit.cycles == 1 and orbit.maps.impacts.tolist() == [impacts]
    # Five, five and four digits are stated.
    digits = 4 if torque == 5.5 else 5
    assert float(f"{found.det_sign * math.exp(found.log_det):.{digits - 1}e}") == det
    assert found.stable
    check_rules(orbit.maps, osc)
    compare_with_differences(osc, orbit)


def compare_with_differences(osc, orbit, allowed=1e-6):
    """The product over a period against finite differences of the event-driven map."""
    matrix, exponent, *_ = multiplied(orbit.maps)
    matrix = matrix * 2.0**exponent
    state, *x = orbit.state
    step = 1e-6 * orbit.size
    for k in range(2):
        ends = []
        for sign in (1, -1):
            beside = list(x)
            beside[k] += sign * step
            ends.append(settled_state(osc, orbit.cycles, (state, *beside))[1:])
        column = (np.array(ends[0]) - ends[1]) / (2 * step)
        assert column == pytest.approx(matrix[:, k], rel=0, abs=allowed * np.abs(matrix).max())


def check_rules(maps, osc):
    """Determinant to 1e-12, sum rule to 1e-10, in every cycle that has a determinant."""
    determinant, rule = defects(maps, osc)
    assert determinant.max() <= 1e-12
    have = np.isfinite(rule)
    assert np.array_equal(have, maps.rank == 2)
    assert np.all(rule[have] <= 1e-10)


MOTIONS = [(scene_a, {"impact_law": "absolute"}), (scene_a, {"impact_law": "relative"}),
           (scene_c, {}), (scene_d, {})]
IDS = ["A absolute", "A relative", "C", "D"]


@pytest.mark.parametrize(("scene", "options"), MOTIONS, ids=IDS)
@pytest.mark.parametrize("torque", [0.5, 2.0, 4.5, 8.0, 12.5])
def test_rules_hold_on_attractors(scene, options, torque):
    osc = scene(torque, **options)
    maps, table = run_maps(osc, 60, 200, numerics=Numerics(rtol=1e-8))
    check_rules(maps, osc)
    chatter = table["chatter_ends"] + table["back_chatter_ends"] > 0
    assert np.array_equal(chatter, maps.rank < 2)


@pytest.mark.full
@pytest.mark.parametrize(("scene", "options"), MOTIONS, ids=IDS)
def test_rules_hold_at_forty_torques(scene, options):
    grazes, warnings = 0, 0
    for torque in np.linspace(0.3, 13.0, 40):
        osc = scene(torque, **options)
        maps, table = run_maps(osc, 200, 300, numerics=Numerics(rtol=1e-8))
        check_rules(maps, osc)
        size = max(abs(osc.force), table["deepest_separation"].max())
        grazes += int(near_grazes(maps, size).sum())
        warnings += bool(near_grazes(maps, size).any())
    print(f"near grazing: {grazes} of 8000 cycles, at {warnings} of 40 torques")
    assert grazes < 80


def test_both_flanks_standing_coast_flank_and_compliant():
    for osc in (scene_a(0.4, back_flank_te=False), scene_a(0.4, "relative", back_flank_te=False),
                scene_c(0.6, contact_law="compliant"), scene_c(0.6, contact_law="rigid"),
                scene_a(0.4, "relative", gap="symmetric")):
        maps, _ = run_maps(osc, 60, 100, numerics=Numerics(rtol=1e-8))
        check_rules(maps, osc)


def test_chatter_leaves_one_exponent():
    """Scene A, relative law, 8 N·m: complete chatter in every cycle."""
    osc = scene_a(8.0, "relative")
    orbit = find_orbit(osc, settled_state(osc, 300))
    found = orbit.multipliers
    assert orbit.maps.rank.tolist() == [1]
    assert found.values[1] == 0 and found.exponents[1] == -math.inf
    assert math.isfinite(found.exponents[0])
    assert math.isnan(sum_rule(orbit.maps, osc)[0])
    compare_with_differences(osc, orbit)
    # The multiplier tells how a deviation dies out.
    state, phi, phi_dot = orbit.state
    off = [settled_state(osc, n, (state, phi + 1e-5 * orbit.size, phi_dot))[1] - phi
           for n in (2, 3)]
    assert off[1] / off[0] == pytest.approx(found.values[0].real, rel=1e-3)
    averaged = exponents(run_maps(osc, 100)[0])
    assert averaged.second == -math.inf
    assert averaged.largest == pytest.approx(found.exponents[0], rel=1e-9)


def test_rigid_rest_forgets_everything():
    osc = scene_a(8.0, "relative", contact_law="rigid")
    maps, table = run_maps(osc, 5, 50, numerics=Numerics(rtol=1e-8))
    assert np.all(table["states_visited"] == 2) and np.all(maps.rank == 0)
    found = exponents(maps)
    assert (found.largest, found.second, found.rank) == (-math.inf, -math.inf, 0)
    repeated = multipliers(maps[-1:])
    assert np.all(repeated.values == 0) and np.all(repeated.exponents == -math.inf)


def test_chaos_has_a_positive_exponent_with_an_error():
    """Scene C at 8.2 N·m, the one motion there; its average does not depend on the start."""
    osc = scene_c(8.2)
    found = [exponents(run_maps(osc, 3000, 100, start, Numerics(rtol=1e-8))[0])
             for start in ("rest", (MotionState.SEPARATION, -1e-4, 0.0))]
    assert all(one.largest > 5 * one.error > 0 for one in found)
    assert found[0].largest == pytest.approx(found[1].largest,
                                             abs=2 * (found[0].error + found[1].error))
    assert len(found[0].running) == 3000 - 100
    assert found[0].running[-1] == found[0].largest
    # Areas shrink on the whole: impacts and contact take more than chaos stretches.
    assert found[0].largest + found[0].second < 0


def test_growth_follows_a_known_product():
    """Two motions at once, of diag(2, 1/2) and of rank 0 from the second cycle on."""
    matrix = np.tile(np.diag([2.0, 0.5]), (2, 6, 1, 1))
    matrix[1, 1:] = 0
    shape = (2, 6)
    maps = CycleMaps(matrix, np.full(shape, 3.0), np.full(shape, 6 * math.log(2)), np.ones(shape),
                     np.full(shape, 2), *np.zeros((4, *shape)), 1.0)
    grown = growth(maps)
    assert grown[0, -1] == pytest.approx(4 * math.log(2), rel=1e-5)
    assert np.all(np.isneginf(grown[1, 1:]))
    found = multipliers(maps[0])
    assert found.values == pytest.approx([16.0**6, 4.0**6], rel=1e-14)
    assert found.exponents == pytest.approx([4 * math.log(2), 2 * math.log(2)], rel=1e-14)


def test_small_multipliers_keep_their_digits():
    """A multiplier of 1e-40 beside one of 1/2, which no trace and no four numbers can tell."""
    maps = CycleMaps(np.array([[[0.5, 1.0], [0.0, 1e-40]]]), np.zeros(1),
                     np.array([math.log(0.5) - 40 * math.log(10)]), np.ones(1), np.array([2]),
                     *np.zeros((4, 1)), 2.0)
    found = multipliers(maps)
    assert found.values[1].real == pytest.approx(1e-40, rel=1e-13)
    assert found.exponents[1] == pytest.approx(-20 * math.log(10), rel=1e-14)


@pytest.mark.parametrize("beyond", [1e-3, 1e-5, 1e-8, 1e-10])
def test_a_graze_is_as_deep_as_the_flank_is_in_the_way(beyond):
    """The ball's flight reaches `beyond` further than the coast flank: v²/(2|a|) tells by how much.

    The flank's own curvature changes along the way; that is of the order of √beyond.
    """
    start = ball_start(1.0, 0.7)
    depth = run_maps(ball(1.0, 0.7), 1, 0, start)[1]["deepest_separation"][0]
    maps, table = run_maps(ball(1.0, 0.7, backlash=depth - beyond), 1, 0, start)
    assert table["back_impacts"][0] >= 1
    assert maps.graze_depth[0] == pytest.approx(beyond, rel=2 * math.sqrt(beyond) + 1e-4)
    found = multipliers(maps, depth)
    assert bool(found.warning) == (beyond < 5e-7 * depth)
    assert np.all(np.isnan(found.values)) == bool(found.warning)
    # The matrix itself grows as 1/v.
    speed = math.sqrt(2 * beyond)
    assert 0.1 / speed < np.abs(maps.matrix[0]).max() * 2.0 ** maps.exponent[0] < 100 / speed


def test_near_grazing_gives_a_warning_instead_of_a_number():
    """The limit is part of the motion's size; a motion without one is not judged."""
    maps = CycleMaps(np.eye(2)[None], np.zeros(1), np.zeros(1), np.ones(1), np.array([2]),
                     np.zeros(1), np.ones(1), np.zeros(1), np.array([1e-7]), 1.0)
    assert np.all(np.isnan(multipliers(maps, 1.0).values))
    assert "graze" in multipliers(maps, 1.0).warning
    assert multipliers(maps, 0.1).values.tolist() == [1, 1]
    found = exponents(maps, 1, 1.0)
    assert math.isnan(found.largest) and found.grazes == 1 and "graze" in found.warning


def test_following_a_motion_over_torque():
    """Scene A from 3.3 to 3.38 N·m: the orbit stays closed, its multiplier changes smoothly.

    It ends beyond 3.39, where an impact leaves with no speed and the second multiplier is 0.
    """
    orbits = follow(scene_a, np.linspace(3.3, 3.38, 5), settled_state(scene_a(3.3), 300))
    assert len(orbits) == 5 and max(one.residual for one in orbits) < 1e-12
    settled = find_orbit(scene_a(3.38), settled_state(scene_a(3.38), 300))
    assert orbits[-1].state[1:] == pytest.approx(settled.state[1:], rel=1e-12)
    assert orbits[-1].multipliers.values == pytest.approx(settled.multipliers.values, rel=1e-9)
    assert all(flip_distance(one) > 0 for one in orbits)
    further = follow(scene_a, [3.38, 3.39, 3.395, 3.4], orbits[-1].state)
    assert 2 <= len(further) < 4
    assert 0 < further[-1].multipliers.values[1].real < 2e-4


def test_a_repeated_orbit_is_told_with_its_least_period():
    osc = scene_a(3.3)
    assert find_orbit(osc, settled_state(osc, 300), 4).cycles == 1


def test_maps_do_not_depend_on_where_a_call_is_cut(monkeypatch):
    """A run in many short calls gives the same bytes."""
    from lapwing.engine import calls

    osc = PAIR.oscillator(TransmissionError.parabola(125e-6), brake_torque=5.5,
                          pinion_speed_rpm=480)
    whole, _ = run_maps(osc, 20, 0, (MotionState.ENGAGEMENT, 1e-5, 0.0))
    monkeypatch.setattr(calls, "CALL_SECONDS", 0.0)
    cut, _ = run_maps(osc, 20, 0, (MotionState.ENGAGEMENT, 1e-5, 0.0))
    assert whole.matrix.tobytes() == cut.matrix.tobytes()
    assert whole.log_det.tobytes() == cut.log_det.tobytes()
