"""How far a run is from its reference: errors of events and state, events missed or doubled.

1. Bounces inside a complete chatter do not count, only its end.
2. Comparison stops once an initial relative change of 1e-15 has grown to the method's tolerance.
3. Events are matched in order. Where the two lists part, the event is *missed* or *doubled* if the
   closest approach to the other outcome exceeds ten times the method's own state error there;
   else the motion grazed to within that error, and neither outcome is wrong. Either way the two
   motions are different ones from there on and comparison ends.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lapwing.base.codes import EventKind
from lapwing_bench.closest_approach import closest_approach, depth_beyond

INITIAL_CHANGE = 1e-15
# Below it a run is judged to the growth that the long horizon admits, 1e4 times 1e-15.
LEAST_TOLERANCE = 1e-11
MARGIN = 10.0
# Events farther apart than this are two events, mesh periods.
FARTHEST = 0.2
CHATTER_ENDS = {int(EventKind.CHATTER_END): int(EventKind.IMPACT),
                int(EventKind.BACK_CHATTER_END): int(EventKind.BACK_IMPACT)}


@dataclass(frozen=True)
class Verdict:
    """What one run is worth.

    Attributes
    ----------
    event_error : float, mesh periods; largest error of a compared event, NaN: none compared
    state_error : float, parts of the natural sizes; NaN: not compared
    missed, doubled : int, 0 or 1
    compared : int, events compared
    failed : bool, the run ended early
    """

    event_error: float
    state_error: float
    missed: int
    doubled: int
    compared: int
    failed: bool

    @property
    def error(self):
        """The larger error; infinite where an event was missed or doubled or the run failed."""
        if self.missed or self.doubled or self.failed:
            return np.inf
        errors = [e for e in (self.event_error, self.state_error) if not np.isnan(e)]
        return max(errors, default=np.nan)


def judge(outcome, reference, problem, cycles, tolerance):
    """Compare a run with its reference.

    Parameters
    ----------
    outcome : Outcome
    reference : Reference, of the same variant
    problem : Problem
    cycles : int, the horizon
    tolerance : float, the method's

    Returns
    -------
    Verdict
    """
    tolerance = max(tolerance, LEAST_TOLERANCE)
    until = _until(reference, cycles, tolerance)
    # Whole lists are matched, so that an event near the limit finds its partner beyond it.
    expected = _cut(reference.events, reference.events["cycle"] < cycles)
    found = _without_chatter(outcome, expected)
    n, parted = matched(expected["kind"], expected["time"], found["kind"], found["time"])
    within = expected["time"][:n] < until
    errors = np.abs(found["time"][:n] - expected["time"][:n])[within]
    missed = doubled = 0
    place = _place(expected, found, n) if parted and not outcome.failure else np.inf
    # An event within its own error of the horizon's end may lie on either side of it.
    sure = cycles - MARGIN * max(errors.max(initial=0.0), tolerance)
    if place < min(until, sure):
        missed, doubled = _blame(expected, found, n, problem, tolerance)
    state_error = np.nan
    if place >= until and not outcome.failure and _stays_small(reference, expected, cycles,
                                                               tolerance):
        state_error = _state_error(outcome.state, reference.states[cycles], problem)
    return Verdict(errors.max(initial=0.0) if errors.size else np.nan, state_error,
                   missed, doubled, int(errors.size), bool(outcome.failure))


def matched(kinds, times, found_kinds, found_times):
    """How many events of two lists go together from the beginning.

    Returns
    -------
    n : int, pairs
    parted : bool, whether something is left in either list
    """
    n = 0
    while n < min(len(kinds), len(found_kinds)):
        distance = abs(found_times[n] - times[n])
        if kinds[n] != found_kinds[n] or not distance <= FARTHEST:
            break
        # One that fits the next event better belongs to that one.
        if n + 1 < len(kinds) and kinds[n + 1] == kinds[n] and (
                abs(found_times[n] - times[n + 1]) < distance):
            break
        if n + 1 < len(found_kinds) and found_kinds[n + 1] == kinds[n] and (
                abs(found_times[n + 1] - times[n]) < distance):
            break
        n += 1
    return n, n < max(len(kinds), len(found_kinds))


def _until(reference, cycles, tolerance):
    """Mesh periods up to which events are compared."""
    events = reference.events
    grown = events["time"][events["growth"] * INITIAL_CHANGE > tolerance]
    return min([reference.listed_until[cycles], *grown[:1]])


def _stays_small(reference, expected, cycles, tolerance):
    """Whether an initial change of 1e-15 is below the tolerance up to the end of the horizon."""
    largest = max([reference.state_growth[cycles], *expected["growth"]])
    return largest * INITIAL_CHANGE <= tolerance


def _cut(table, keep):
    return {name: column[keep] for name, column in table.items()}


def _without_chatter(outcome, expected):
    """A run's events less those bounces that the reference knows to lie inside a chatter."""
    keep = np.ones(len(outcome.kind), dtype=bool)
    for since, end, kind in zip(expected["chatter_since"], expected["time"], expected["kind"],
                                strict=True):
        if np.isnan(since):
            continue
        own = np.flatnonzero((outcome.kind == kind) & (outcome.time > since))
        last = outcome.time[own[0]] if own.size and (
            outcome.time[own[0]] < end + FARTHEST) else end
        keep &= ~((outcome.kind == CHATTER_ENDS[int(kind)]) & (outcome.time > since)
                  & (outcome.time <= last))
    return {"kind": outcome.kind[keep], "time": outcome.time[keep],
            "velocity_after": outcome.velocity[keep]}


def _place(expected, found, n):
    """Time at which the two lists part."""
    return min([table["time"][n] for table in (expected, found) if n < len(table["time"])])


def _blame(expected, found, n, problem, tolerance):
    """(missed, doubled) at the place where the lists part."""
    lacking = _lacks(expected, found, n)
    here = (expected if lacking else found)["time"][n]
    error = _state_error_at(expected, found, n, here, problem, tolerance)
    if lacking:
        approach = depth_beyond(problem, expected, n)
    else:
        approach = closest_approach(problem, expected, n, int(found["kind"][n]), here)
    if approach <= MARGIN * error:
        return 0, 0
    return int(lacking), int(not lacking)


def _lacks(expected, found, n):
    """Whether the run lacks the reference's next event, rather than having one more."""
    if n >= len(found["kind"]):
        return True
    if n >= len(expected["kind"]):
        return False
    if n + 1 < len(expected["kind"]) and expected["kind"][n + 1] == found["kind"][n] and (
            abs(expected["time"][n + 1] - found["time"][n])
            < abs(expected["time"][n] - found["time"][n])):
        return True
    return bool(expected["time"][n] < found["time"][n])


def _state_error_at(expected, found, n, here, problem, tolerance):
    """Bound of the run's error of φ (rad) at a time, from its error at the last event matched."""
    least = tolerance * problem.angle
    if n == 0:
        return least
    since = (here - expected["time"][n - 1]) * problem.period
    late = abs(found["time"][n - 1] - expected["time"][n - 1]) * problem.period
    speed = abs(expected["velocity_after"][n - 1])
    faster = abs(found["velocity_after"][n - 1] - expected["velocity_after"][n - 1])
    return max(least, speed * late + (faster + problem.largest_pull * late) * max(since, 0.0))


def _state_error(state, expected, problem):
    """Largest error of φ and φ' in parts of their natural sizes; infinite in another state."""
    if int(state[0]) != int(expected[0]):
        return np.inf
    return max(abs(state[1] - expected[1]) / problem.angle,
               abs(state[2] - expected[2]) / problem.speed)
