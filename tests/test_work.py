"""Work is counted, nothing is done that was not asked for, and everything is bounded."""

import numpy as np
import pytest

from helpers import EPS, events, kinds, oscillator, scene_a, scene_d
from lapwing import EventKind, MotionState, Status, simulate

SCENES = [lambda **o: scene_a(1.8, **o), lambda **o: scene_a(5.5, "relative", **o),
          lambda **o: scene_d(5.5, **o), lambda **o: scene_a(0.8, "relative",
                                                             contact_law="compliant", **o)]


@pytest.mark.parametrize("build", SCENES)
def test_nothing_asked_nothing_done(build):
    work = simulate(build(), cycles=5, observe=(), method="rk4").work
    assert (work["samples"], work["depth_searches"], work["graze_searches"]) == (0, 0, 0)
    assert work["steps"] > 0 and work["drive_flank_searches"] > 0
    assert work["coast_flank_searches"] > 0


@pytest.mark.parametrize("build", SCENES)
def test_nothing_asked_nothing_done_in_closed_form(build):
    work = simulate(build(), cycles=5, observe=(), method="exact").work
    assert work.pop("stretches") > 5
    assert not any(work.values())


@pytest.mark.parametrize("build", SCENES)
@pytest.mark.parametrize(("record", "counter"), [
    ("cycles", "depth_searches"), ("events", "depth_searches"), ("grazes", "graze_searches")])
def test_each_record_costs_its_own_searches_only(build, record, counter):
    plain = simulate(build(), cycles=5, observe=()).work
    other = simulate(build(), cycles=5, observe=(record,)).work
    assert plain[counter] == 0 < other[counter]
    assert {k: v for k, v in other.items() if k != counter} == {
        k: v for k, v in plain.items() if k != counter}


@pytest.mark.parametrize("build", SCENES)
def test_without_a_coast_flank_none_is_searched(build):
    for contact_law_record in (("events", "cycles", "grazes"), ()):
        work = simulate(build(gap="one_flank"), cycles=5, observe=contact_law_record,
                        method="rk4").work
        assert work["coast_flank_searches"] == 0 < work["drive_flank_searches"]


def test_recording_does_not_change_the_motion():
    runs = [simulate(scene_a(1.8), cycles=5, observe=record)
            for record in ((), ("events",), ("events", "cycles", "grazes"))]
    states = [(r.final.phi, r.final.phi_dot, r.final.tau, r.final.motion_state) for r in runs]
    assert states[0] == states[1] == states[2]
    assert runs[0].work["steps"] == runs[2].work["steps"]
    assert runs[0].events["kind"].size == 0 and runs[0].cycles["cycle"].size == 0


def test_samples_are_taken_by_the_history_alone():
    run = simulate(scene_a(1.8), cycles=5)
    assert run.work["samples"] == 0
    history = run.history(np.linspace(0, run.final.tau, 77))
    assert history.attrs["samples"] == 77
    assert run.work["samples"] == 0


def test_searches_follow_the_steps():
    """A flight searches each flank at most once a step and table piece, a contact its own flank."""
    osc = oscillator(restitution=1.0, backlash=1.0, period=4.0)
    work = simulate(osc, ("separation", -0.25, 0.0), cycles=100, observe=(), method="rk4").work
    assert 0 < work["drive_flank_searches"] <= work["steps"]
    assert work["coast_flank_searches"] <= work["steps"]
    # Flights are exact at any length: one step from event to event or end of a cycle.
    n = len(kinds(simulate(osc, ("separation", -0.25, 0.0), cycles=100)))
    assert work["steps"] <= n + 100 + 1 and work["rejected_steps"] == 0


def test_work_of_a_continued_run_adds_up():
    osc = scene_a(3.3)
    one = simulate(osc, cycles=6)
    two = simulate(osc, simulate(osc, cycles=2).final, cycles=4)
    assert two.work == one.work


# --- bounds -----------------------------------------------------------------------------------


def test_too_many_events():
    osc = oscillator(restitution=1.0, period=1000.0, gap="one_flank")
    run = simulate(osc, ("separation", -0.5, 0.0), cycles=3, max_events_per_cycle=7)
    # One impact each 2 units of τ from 1 on; the eighth in a cycle is one too many.
    assert run.status == Status.TOO_MANY_EVENTS
    assert run.final.tau == pytest.approx(15.0, rel=8 * EPS)
    assert run.final.motion_state == MotionState.SEPARATION
    assert run.final.phi == 0 and run.final.phi_dot == pytest.approx(-1.0, rel=32 * EPS)
    tau = events(run, EventKind.IMPACT)["tau"]
    assert 7 <= tau.size <= 8
    assert tau == pytest.approx(np.arange(1.0, 2 * tau.size, 2.0), rel=8 * EPS)
    history = run.history([0.0, 2.0, 13.5])
    assert history["phi"].values == pytest.approx([-0.5, -0.5, -0.375], rel=64 * EPS)


def test_events_are_bounded_by_cycle_not_in_all():
    osc = oscillator(restitution=1.0, period=10.0, gap="one_flank")
    run = simulate(osc, ("separation", -0.5, 0.0), cycles=30, max_events_per_cycle=6)
    assert run.status == Status.OK and len(kinds(run)) == 150


def test_too_many_steps():
    run = simulate(scene_a(1.8), cycles=10, max_steps_per_cycle=50, method="rk4")
    assert run.status == Status.TOO_MANY_STEPS
    assert 0 < run.final.tau < run.oscillator.period
    assert 50 <= run.work["steps"] <= 52
    assert np.isfinite([run.final.phi, run.final.phi_dot]).all()


def test_a_chatter_at_full_restitution_is_bounded():
    """ε close to 1 on a strongly pressed flank: named status, not an endless run."""
    osc = oscillator(restitution=1.0, period=1000.0, gap="one_flank")
    run = simulate(osc, ("separation", -1e-12, 0.0), cycles=1, max_events_per_cycle=10_000)
    assert run.status == Status.TOO_MANY_EVENTS
    # Each bounce takes 2√2e-6.
    assert run.final.tau == pytest.approx(10_000 * 2 * 2**0.5 * 1e-6, rel=1e-3)


@pytest.mark.parametrize("bad", [
    {"rtol": 0.0}, {"rtol": 1e-1}, {"rtol": float("nan")}, {"cycles": 0}, {"cycles": -1.0},
    {"cycles": float("inf")}, {"phase": 1.0}, {"phase": -0.1}, {"method": "euler"},
    {"observe": ("event",)}, {"count_depth": 1.5}, {"chatter_tol": 0.0},
    {"max_events_per_cycle": 0}, {"max_steps_per_cycle": 2**31}])
def test_bad_arguments_are_refused(bad):
    with pytest.raises(ValueError):
        simulate(scene_a(1.8), **bad)


def test_a_single_word_is_a_list_of_one():
    one, other = (simulate(scene_a(1.8), cycles=2, observe=words) for words in (
        "events", ("events",)))
    assert one.events.identical(other.events) and one.cycles.sizes["cycle"] == 0
    with pytest.raises(TypeError, match="observe = 'event', expected one or more of 'events'"):
        simulate(scene_a(1.8), observe="event")


@pytest.mark.parametrize("taus", [[-1.0], [1.0, 0.5], [1e9], [float("nan")], [[0.0, 1.0]]])
def test_bad_history_times_are_refused(taus):
    run = simulate(scene_a(1.8), cycles=1)
    with pytest.raises(ValueError):
        run.history(taus)
