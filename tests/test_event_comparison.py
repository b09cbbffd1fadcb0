"""The rule by which event lists are compared (event_comparison.py) finds what it must find."""

from copy import copy

import numpy as np
import pytest

from event_comparison import CHANGE, changed_data, compare, events_of
from helpers import oscillator, scene_a, scene_d
from lapwing import EventKind, TransmissionError, simulate

RTOL = 1e-12
WAVE = TransmissionError.harmonic([1.0])


def trio(osc, start="rest", rtol=RTOL, **options):
    """A run, the same at a tenth of its tolerance, and one of changed data."""
    options = {"method": "rk4", "observe": ("events",), **options}
    changed, begin = changed_data(osc, start)
    return (simulate(osc, start, rtol=rtol, **options),
            simulate(osc, start, rtol=10 * rtol, **options),
            simulate(changed, begin, rtol=rtol, **options))


def with_rows(run, rows):
    return with_events(run, run.events.isel(event=rows))


def with_events(run, events):
    other = copy(run)
    other.events = events
    return other


def test_a_run_agrees_with_itself_and_with_a_coarser_one():
    one, other, changed = trio(scene_a(1.8), cycles=4)
    for second in (one, other):
        verdict = compare(one, second, changed, 10 * RTOL)
        assert verdict.agrees and verdict.why == "all"
        assert verdict.compared == one.events.sizes["event"] > 15


@pytest.mark.parametrize("osc", [scene_a(1.8), scene_d(2.0)], ids=["a", "d"])
def test_every_missed_and_every_doubled_event_is_found(osc):
    one, other, changed = trio(osc, cycles=3)
    rows = np.arange(one.events.sizes["event"])
    tau = one.events["tau"].values
    # What lies on the end of the run may be on either side of it.
    kept = np.isin(tau, events_of(one)["tau"]) & (tau < one.final.tau * (1 - 1e-9))
    assert kept.sum() >= 10
    for k in rows[kept]:
        missed = compare(one, with_rows(other, np.delete(rows, k)), changed, RTOL)
        assert not missed.agrees and missed.compared <= k and "tau=" in missed.why
        doubled = compare(one, with_rows(other, np.insert(rows, k, k)), changed, RTOL)
        # A line written twice at one time is no event that errors could reorder.
        assert not doubled.agrees, doubled.why


def test_a_wrong_time_is_found():
    one, other, changed = trio(scene_a(1.8), cycles=3)
    shift = np.zeros(other.events.sizes["event"])
    shift[7] = 1e-7 * one.oscillator.period
    tau = other.events["tau"].values + shift
    moved = with_events(other, other.events.assign(tau=("event", tau)))
    assert compare(one, moved, changed, 10 * RTOL).compared == 7


def test_a_wrong_velocity_is_found():
    """A kink whose slope jump is counted twice."""
    one, other, changed = trio(scene_d(2.0), cycles=3)
    kinks = np.flatnonzero(one.events["kind"].values == EventKind.KINK)
    jump = np.zeros(other.events.sizes["event"])
    jump[kinks[1]] = np.diff([other.events[name].values[kinks[1]] for name in (
        "velocity_before", "velocity_after")], axis=0)[0]
    for name in ("velocity_before", "velocity_after"):
        wrong = other.events[name].values + jump
        moved = with_events(other, other.events.assign({name: ("event", wrong)}))
        verdict = compare(one, moved, changed, 10 * RTOL)
        assert not verdict.agrees
        assert events_of(one)["kind"][verdict.compared] == EventKind.KINK


def test_listed_tails_of_chatter_do_not_count():
    one, other, changed = trio(scene_d(5.5), cycles=2)
    rows = np.arange(one.events.sizes["event"])
    end = int(np.flatnonzero(one.events["kind"].values == EventKind.CHATTER_END)[0])
    # The last listed bounces are within 1e-6 mesh periods of the end, the first ones are not.
    assert compare(one, with_rows(other, np.delete(rows, end - 1)), changed, 10 * RTOL).agrees
    assert not compare(one, with_rows(other, np.delete(rows, end)), changed, 10 * RTOL).agrees
    first = int(np.flatnonzero(one.events["kind"].values == EventKind.IMPACT)[0])
    assert not compare(one, with_rows(other, np.delete(rows, first)), changed, 10 * RTOL).agrees


@pytest.mark.parametrize(("miss", "excused"), [(1e-13, True), (1e-5, False)])
def test_a_touch_is_excused_by_its_closest_approach(miss, excused):
    """A flight that turns `miss` short of the coast flank against one that strikes it."""
    osc = oscillator(backlash=1.0, period=10.0, gap="one_sided")
    short, beyond = (("separation", 0.0, -np.sqrt(2 * (1 + sign * miss))) for sign in (-1, 1))
    one, *_ = trio(osc, beyond, cycles=0.5)
    other = simulate(osc, short, cycles=0.5, rtol=RTOL, observe=("events",))
    back = EventKind.BACK_IMPACT
    assert back in one.events["kind"].values and back not in other.events["kind"].values
    verdict = compare(one, other, one, RTOL)
    assert verdict.agrees == excused, verdict.why
    assert compare(other, one, other, RTOL).agrees == excused
    if excused:
        assert verdict.why.startswith("ambiguous: a touch")


def test_comparison_stops_where_errors_have_grown():
    """An elastic ball on a shaking wall; e**(many) after enough bounces."""
    osc = oscillator(WAVE, force=0.3, period=10.0, restitution=1.0, gap="one_flank")
    one, other, changed = trio(osc, ("separation", -1.0, 0.0), cycles=80)
    verdict = compare(one, other, changed, 10 * RTOL)
    assert verdict.agrees and verdict.why == "growth"
    assert 5 <= verdict.compared < one.events.sizes["event"]


def test_equal_times_in_another_order_are_a_matter_of_error():
    """The tooth arrives on a kink, once a rounding before it and once after."""
    kinked = TransmissionError.from_hermite([0.0, 0.5], [0.0, 0.25], [-0.5, 0.5], [0.5, -0.5])
    osc = oscillator(kinked, force=2.0, period=2.0, restitution=0.5)
    runs = [simulate(osc, ("separation", -0.75 + early, -0.25), cycles=0.6, rtol=RTOL,
                     observe=("events",)) for early in (1e-13, -1e-13, 1e-5)]
    kinds = [run.events["kind"].values[0] for run in runs]
    assert kinds == [EventKind.IMPACT, EventKind.KINK, EventKind.IMPACT]
    assert compare(runs[0], runs[1], runs[0], RTOL).why == "ambiguous: two events at one time"
    assert not compare(runs[2], runs[1], runs[2], RTOL).agrees


def test_changed_data_are_changed_a_little_and_allowed():
    osc = oscillator(backlash=1.0)
    for start in ("rest", ("separation", -0.3, 0.1), ("separation", 0.0, -0.1),
                  ("engagement", 0.2, 0.0), ("back_engagement", -1.2, 0.0)):
        other, begin = changed_data(osc, start)
        assert 0 < abs(other.force - osc.force) <= 2 * CHANGE * osc.angle_scale
        simulate(other, begin, cycles=0.01)
        if not isinstance(start, str):
            assert begin[0] == start[0]
            assert np.allclose(begin[1:], start[1:], rtol=2 * CHANGE, atol=2 * CHANGE)
