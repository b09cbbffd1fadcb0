"""The rule that says what is an error, what is missed and what is doubled."""

from dataclasses import replace

import numpy as np
import pytest

from lapwing import EventKind
from lapwing_bench.judge import judge
from lapwing_bench.outcome import Outcome
from lapwing_bench.problem import Problem
from lapwing_bench.reference import Reference

IMPACT, RELEASE = int(EventKind.IMPACT), int(EventKind.RELEASE)
CHATTER_END, ENGAGE = int(EventKind.CHATTER_END), int(EventKind.ENGAGE)
STATE = (1, 0.1, 0.0)
# A flat flank under F = 1: a rebound at speed v lands again after 2v and rises by v²/2.
FLAT = Problem(force=1.0, omega=2 * np.pi / 10, period=10.0, xi=0.1, restitution=0.8,
               backlash=100.0, compliant=False, absolute=False, sticking=1e-6, angle=1.0,
               speed=1.0, amplitude=0.0, arcs=())


def reference(kinds, times, *, before=1.0, after=-0.8, growth=0.0, since=None, state_growth=0.0,
              listed_until=3.0):
    """A reference of one torque with one speed for all events."""
    n, times = len(kinds), np.array(times, dtype=float)
    events = {"kind": np.array(kinds, dtype=int), "cycle": np.floor(times).astype(int),
              "phase": times % 1, "time": times, "velocity_before": np.full(n, float(before)),
              "velocity_after": np.full(n, float(after)),
              "growth": np.broadcast_to(np.asarray(growth, dtype=float), (n,)),
              "chatter_since": np.full(n, np.nan) if since is None else np.array(since)}
    return Reference(events, {3: STATE}, {3: state_growth}, {3: n}, {3: listed_until}, False)


def run(kinds, times, state=STATE, velocity=-0.8, failure=""):
    return Outcome(np.array(kinds, dtype=int), np.array(times, dtype=float),
                   np.full(len(kinds), velocity), state, failure)


def verdict(outcome, expected, tolerance=1e-6):
    return judge(outcome, expected, FLAT, 3, tolerance)


def test_errors_are_the_largest_of_events_and_state():
    found = verdict(run([RELEASE, IMPACT], [0.5, 1.5 + 3e-7], (1, 0.1 + 2e-7, 1e-8)),
                    reference([RELEASE, IMPACT], [0.5, 1.5]))
    assert found.event_error == pytest.approx(3e-7, rel=1e-6)
    assert found.state_error == pytest.approx(2e-7, rel=1e-6)
    assert found.error == found.event_error and found.compared == 2
    assert (found.missed, found.doubled) == (0, 0)


def test_another_motion_state_is_no_small_error():
    found = verdict(run([], [], (0, 0.1, 0.0)), reference([], []))
    assert found.state_error == np.inf


@pytest.mark.parametrize(("times", "missed", "doubled"), [
    ([0.5, 1.5], 1, 0), ([0.5, 1.0, 1.3, 1.5], 0, 1), ([1.0, 1.5], 1, 0), ([0.5, 1.0], 1, 0),
    ([0.5, 1.0, 1.5, 2.5], 0, 1)])
def test_an_event_too_few_and_too_many(times, missed, doubled):
    expected = reference([IMPACT] * 3, [0.5, 1.0, 1.5])
    found = verdict(run([IMPACT] * len(times), times), expected)
    assert (found.missed, found.doubled) == (missed, doubled)
    assert found.error == np.inf and np.isnan(found.state_error)


def test_a_miss_within_the_own_error_is_none():
    """An impact at speed v goes v²/2 past the flank; ten state errors are 1e-5 here."""
    for v, missed in ((1e-3, 0), (1e-2, 1)):
        found = verdict(run([], []), reference([IMPACT], [1.0], before=v))
        assert (v**2 / 2 > 10 * 1e-6) == bool(missed)
        assert (found.missed, found.doubled) == (missed, 0)


def test_a_graze_within_the_own_error_is_no_doubled_event():
    """Thrown off at v = 0.8 the tooth turns 0.32 below; contact is 0.32 away, release is not."""
    expected = reference([IMPACT], [1.0])
    # φ is 0.01 below the flank when one tenth of a period, of ten, less 0.0125 has passed ...
    late = 1.0 + (1.6 - 0.0125) / 10
    near = verdict(run([IMPACT, IMPACT], [1.0, late]), expected, tolerance=1e-2)
    assert (near.missed, near.doubled) == (0, 0)
    # ... which is more than ten errors of a run at 1e-6.
    far = verdict(run([IMPACT, IMPACT], [1.0, late]), expected, tolerance=1e-6)
    assert (far.missed, far.doubled) == (0, 1)


@pytest.mark.parametrize(("miss", "doubled"), [(1e-7, 0), (1e-3, 1)])
def test_a_flight_that_turns_just_short_of_the_coast_flank(miss, doubled):
    """Thrown off at v it turns v²/2 below; a coast flank so little farther is not struck.

    A run that strikes it is right to within ten errors of 1e-7 or is not.
    """
    v = 0.8
    near = replace(FLAT, backlash=v**2 / 2 + miss)
    expected = reference([IMPACT], [1.0], after=-v)
    struck = run([IMPACT, IMPACT + 1], [1.0, 1.0 + v / 10], velocity=-v)
    found = judge(struck, expected, near, 3, 1e-7)
    assert (found.missed, found.doubled) == (0, doubled)
    # Half a flight later the distance is small no more, but what counts is how near it came.
    late = run([IMPACT, IMPACT + 1], [1.0, 1.0 + 1.3 * v / 10], velocity=-v)
    assert judge(late, expected, near, 3, 1e-7).doubled == doubled


def test_only_the_end_of_a_chatter_counts():
    expected = reference([IMPACT, CHATTER_END], [1.0, 2.0], since=[np.nan, 1.2])
    bounces = [1.4, 1.7, 1.9, 1.99]
    many = verdict(run([IMPACT] * 5 + [CHATTER_END], [1.0, *bounces, 2.0 + 1e-7]), expected)
    few = verdict(run([IMPACT, IMPACT, CHATTER_END], [1.0, 1.4, 2.0 + 1e-7]), expected)
    for found in (many, few):
        assert (found.missed, found.doubled, found.compared) == (0, 0, 2)
        assert found.event_error == pytest.approx(1e-7, rel=1e-6)


def test_bounces_after_the_reference_ends_its_chatter_belong_to_it():
    expected = reference([IMPACT, CHATTER_END], [1.0, 2.0], since=[np.nan, 1.2])
    found = verdict(run([IMPACT, IMPACT, CHATTER_END], [1.0, 2.01, 2.02]), expected)
    assert (found.missed, found.doubled) == (0, 0)
    assert found.event_error == pytest.approx(0.02, rel=1e-6)


def test_a_chatter_that_never_ends_is_missed():
    expected = reference([IMPACT, CHATTER_END], [1.0, 2.0], since=[np.nan, 1.2])
    found = verdict(run([IMPACT] * 4, [1.0, 1.5, 1.9, 2.5]), expected)
    assert (found.missed, found.doubled) == (1, 0)


def test_a_chatter_open_at_the_end_of_the_horizon():
    """Its bounces are not in the reference; they are no doubled events."""
    expected = reference([IMPACT], [1.0], listed_until=1.2)
    found = verdict(run([IMPACT] * 4, [1.0, 1.5, 1.9, 2.5]), expected)
    assert (found.missed, found.doubled, found.compared) == (0, 0, 1)
    assert found.state_error == 0


def test_comparison_stops_where_errors_have_grown():
    expected = reference([IMPACT] * 3, [0.5, 1.0, 1.5], growth=[1.0, 1e8, 1e8],
                         state_growth=1e8)
    short = run([IMPACT] * 2, [0.5, 1.0 + 1e-8])
    found = verdict(short, expected, tolerance=1e-6)
    assert (found.compared, found.missed, found.doubled) == (2, 1, 0)
    # 1e-15 has grown to 1e-7 at the second event, above 1e-8.
    found = verdict(short, expected, tolerance=1e-8)
    assert (found.compared, found.missed, found.doubled) == (1, 0, 0)
    assert np.isnan(found.state_error)


def test_an_event_at_the_very_end_may_lie_beyond_it():
    expected = reference([IMPACT], [3 - 1e-9])
    assert verdict(run([], []), expected).missed == 0
    assert verdict(run([], []), reference([IMPACT], [2.9])).missed == 1


def test_a_run_that_failed_is_wrong():
    found = verdict(run([], [], failure="step too small"), reference([IMPACT], [1.0]))
    assert found.error == np.inf and found.missed == 0
