"""What a run tells of its flights, and of the cycle in which it ended."""

import math
from dataclasses import replace

import numpy as np
import pytest

from helpers import EPS, dataset_bytes, events, kinds, oscillator, scene_a, scene_c, scene_d
from lapwing import EventKind, MotionState, Status, TransmissionError, simulate

ARRIVALS = (EventKind.IMPACT, EventKind.BACK_IMPACT, EventKind.ENGAGE, EventKind.BACK_ENGAGE)
COUNTS = {"impacts": EventKind.IMPACT, "back_impacts": EventKind.BACK_IMPACT,
          "releases": EventKind.RELEASE, "back_releases": EventKind.BACK_RELEASE,
          "engages": EventKind.ENGAGE, "back_engages": EventKind.BACK_ENGAGE,
          "chatter_ends": EventKind.CHATTER_END, "back_chatter_ends": EventKind.BACK_CHATTER_END}
SCENES = [lambda: scene_a(1.8), lambda: scene_a(0.4, "relative"), lambda: scene_d(5.5),
          lambda: scene_c(1.5, contact_law="compliant"), lambda: scene_c(1.5, contact_law="rigid"),
          lambda: scene_a(0.3, back_flank_te=False)]
SAMPLES = 4000


def sampled_depth(run, begin, end):
    """Greatest depth of a stretch of the dense history, and what samples may miss of it.

    Between two samples h apart a parabola of second derivative a rises by up to a·h²/8 above both;
    |φ''| = |F - g''| is below the table's largest.
    """
    osc, taus = run.oscillator, np.linspace(begin, end, SAMPLES)
    phi = run.history(taus).phi.values
    curvature = np.abs(osc.te.derivative(2, np.arange(2000) / 2000)).max() / osc.period**2
    bound = abs(osc.force) + abs(osc.flank_scale) * curvature
    return -phi.min(), bound * (taus[1] - taus[0])**2


@pytest.mark.parametrize("method", ["exact", "rk4"])
@pytest.mark.parametrize("build", SCENES)
def test_depth_of_a_flight_is_that_of_the_history(build, method):
    run = simulate(build(), cycles=6, method=method)
    tau, kind, depth = (run.events[name].values for name in ("tau", "kind", "flight_depth"))
    at_flanks = kind <= EventKind.BACK_CHATTER_END
    tau, kind, depth = tau[at_flanks], kind[at_flanks], depth[at_flanks]
    ends = np.flatnonzero(np.isin(kind, ARRIVALS) & (np.diff(tau, prepend=0.0) > 0))
    seen = ends[np.argsort(-np.nan_to_num(depth[ends]))][:12]
    assert len(seen) > 3
    for i in seen:
        found, missed = sampled_depth(run, tau[i - 1] if i else 0.0, tau[i])
        rounding = 1e-9 * run.oscillator.angle_scale
        assert found - rounding <= depth[i] <= found + missed + rounding
    assert np.isnan(depth[~np.isin(kind, ARRIVALS)]).all()


@pytest.mark.parametrize("build", SCENES)
def test_depths_are_the_same_whatever_else_is_observed(build):
    both, alone = (simulate(build(), cycles=6, observe=observe)
                   for observe in (("events", "cycles", "grazes"), ("events",)))
    grazes = np.isin(both.events["kind"].values, (EventKind.NEAR_GRAZE, EventKind.BACK_NEAR_GRAZE))
    assert dataset_bytes(both.events.isel(event=~grazes)) == dataset_bytes(alone.events)
    assert np.isnan(both.events["flight_depth"].values[grazes]).all()


def test_depth_of_a_fall_and_of_its_bounces():
    """Drop from h onto a flat flank under F = 1: h, then ε² times the depth before each time."""
    run = simulate(oscillator(restitution=0.5, period=8.0), ("separation", -2.0, 0.0), cycles=1)
    depths = events(run, EventKind.IMPACT)["flight_depth"]
    np.testing.assert_allclose(depths[:6], 2 * 0.25 ** np.arange(6), rtol=1e-13)


def test_depth_at_the_coast_flank_is_the_gap():
    run = simulate(oscillator(restitution=1.0, backlash=1.0, period=4.0),
                   ("separation", -0.25, -2.0), cycles=4)
    back = events(run, EventKind.BACK_IMPACT)["flight_depth"]
    assert len(back) > 2
    np.testing.assert_allclose(back, 1.0, rtol=4 * EPS)


def test_where_there_was_no_flight_there_is_no_depth():
    """An impact at the very start, and a kink that strikes a resting tooth."""
    start = simulate(oscillator(backlash=1.0), (MotionState.SEPARATION, 0.0, 0.5), cycles=0.001)
    assert kinds(start)[0] == EventKind.IMPACT
    assert math.isnan(start.events["flight_depth"].values[0])
    struck = simulate(oscillator(TransmissionError.from_hermite(
        [0.0, 0.5], [0.0, 0.25], [-0.5, 0.5], [0.5, -0.5]), force=2.0, period=4.0,
        contact_law="rigid"), cycles=0.6)
    first = kinds(struck).index(EventKind.IMPACT)
    assert kinds(struck)[:first] == [EventKind.KINK]
    assert math.isnan(struck.events["flight_depth"].values[first])


def test_of_a_flight_watched_in_part_no_depth_is_told():
    osc = scene_a(1.8)
    whole = simulate(osc, cycles=6.4)
    assert whole.final.motion_state == MotionState.SEPARATION
    for observe, known in (((), False), (("events",), True), (("cycles",), True)):
        before = simulate(osc, cycles=6.4, observe=observe)
        after = simulate(osc, before.final, cycles=2)
        depths = events(after, EventKind.IMPACT)["flight_depth"]
        same = events(simulate(osc, whole.final, cycles=2), EventKind.IMPACT)["flight_depth"]
        assert math.isnan(depths[0]) != known
        assert depths[known ^ 1:].tolist() == same[known ^ 1:].tolist()


@pytest.mark.parametrize("method", ["exact", "rk4"])
@pytest.mark.parametrize("build", SCENES)
def test_the_cycle_in_which_a_run_ends(build, method):
    osc = build()
    run, longer = (simulate(osc, cycles=cycles, method=method) for cycles in (4.4375, 5))
    assert run.cycles["cycle"].values.tolist() == [0, 1, 2, 3, 4]
    assert run.cycles["complete"].values.tolist() == 4 * [True] + [False]
    assert longer.cycles["complete"].values.all()
    for name in run.cycles.variables:
        assert run.cycles[name].values[:4].tolist() == longer.cycles[name].values[:4].tolist()
    last, whole = run.cycles.isel(cycle=4), longer.cycles.isel(cycle=4)
    for name in ("motion_state", "phi", "phi_dot"):
        assert last[name] == whole[name]
    happened = run.events.isel(event=run.events["cycle"].values == 4)
    in_it = happened["kind"].values
    for name, kind in COUNTS.items():
        assert last[name] == np.sum(in_it == kind) <= whole[name]
    taus = np.linspace(4 * osc.period, run.final.tau, SAMPLES)
    history = run.history(taus)
    visited = np.bitwise_or.reduce(1 << history["motion_state"].values.astype(int))
    assert int(last["states_visited"]) == visited
    apart = history["motion_state"].values == MotionState.SEPARATION
    _, missed = sampled_depth(run, taus[0], taus[-1])
    # A flight is deepest where φ' = 0, or where a coast flank ends it.
    found = max(-history["phi"].values[apart].min(initial=0.0),
                -happened["phi"].values[in_it == EventKind.BACK_IMPACT].min(initial=0.0))
    rounding = 1e-9 * osc.angle_scale
    assert found - rounding <= last["deepest_separation"] <= found + missed + rounding


def test_the_cycle_in_which_a_run_fails():
    run = simulate(scene_a(1.8), cycles=6, max_events_per_cycle=5)
    assert run.status == Status.TOO_MANY_EVENTS
    last = run.cycles.isel(cycle=-1)
    assert not last["complete"] and last["cycle"] == run.events["cycle"].values[-1]
    of_it = run.events["kind"].values[run.events["cycle"].values == int(last["cycle"])]
    assert len(of_it) > 5 and last["impacts"] == np.sum(of_it == EventKind.IMPACT) > 0


def test_the_cycle_in_which_a_run_begins():
    osc = scene_a(1.8)
    late = simulate(osc, phase=0.25, cycles=3)
    assert late.cycles["complete"].values.tolist() == [False, True, True, False]
    blind = simulate(osc, cycles=2.5, observe=("events",))
    seen, unseen = (simulate(osc, before.final, cycles=2)
                    for before in (simulate(osc, cycles=2.5), blind))
    assert seen.cycles["complete"].values.tolist() == [True, True, False]
    assert unseen.cycles["complete"].values.tolist() == [False, True, False]
    assert unseen.cycles["impacts"].values[0] <= seen.cycles["impacts"].values[0]
    again = simulate(osc, simulate(osc, blind.final, cycles=0.25).final, cycles=2)
    assert again.cycles["complete"].values.tolist() == [False, True, False]
    for name in seen.cycles.variables:
        assert seen.cycles[name].values[1:].tolist() == unseen.cycles[name].values[1:].tolist()


def test_what_lies_before_an_unwatched_stretch_is_no_part_of_a_cycle():
    osc = scene_a(1.8)
    watched = simulate(osc, cycles=2.5)
    blind = simulate(osc, watched.final, cycles=2, observe=())
    fresh = simulate(osc, cycles=4.5, observe=())
    one, other = (simulate(osc, run.final, cycles=2) for run in (blind, fresh))
    assert dataset_bytes(one.cycles) == dataset_bytes(other.cycles)


def test_a_run_that_ends_with_a_cycle_has_no_other():
    run = simulate(scene_a(1.8), cycles=3)
    assert run.cycles["cycle"].values.tolist() == [0, 1, 2]
    assert run.cycles["complete"].values.all()
    assert simulate(scene_a(1.8), cycles=0.5, observe=("events",)).cycles.sizes["cycle"] == 0


def test_two_degrees_of_freedom_tell_their_mean_too():
    from helpers import PAIR, SHIPPED

    osc = PAIR.oscillator(SHIPPED, brake_torque=1.8, drive_torque=1.5, pinion_speed_rpm=240,
                          degrees_of_freedom=2)
    run, longer = (simulate(osc, cycles=cycles) for cycles in (2.5, 3))
    assert run.cycles["mean_rate"].values.tolist() == longer.cycles["mean_rate"].values.tolist()


@pytest.mark.parametrize("method", ["exact", "rk4"])
@pytest.mark.parametrize("damping_ratio", [0.9, 1.0])
def test_a_tooth_that_stands_still_in_contact_turns_nowhere(damping_ratio, method):
    """What is left of the transient is below rounding: the velocity's sign says nothing.

    Engaged at 12 N·m, every turn of the flank's depth lies far from release.
    """
    osc = replace(scene_a(12.0), damping_ratio=damping_ratio)
    run = simulate(osc, "rest", cycles=2, method=method, observe=("events", "grazes"),
                   graze_distance=osc.angle_scale)
    times = np.diff(run.events.tau.values)
    assert run.status == Status.OK and (times > 1e-3).all()
