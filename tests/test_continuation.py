"""A run that is cut and continued is the uncut run, bit for bit."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from helpers import EPS, dataset_bytes, oscillator, scene_a, scene_c, scene_d
from lapwing import Status, TransmissionError, simulate
from lapwing.engine import calls

CYCLES = 6
RECORD = ("events", "cycles", "grazes")
TRIANGLE = TransmissionError.from_hermite([0.0, 0.5], [0.0, 0.25], [-0.5, 0.5], [0.5, -0.5])
SCENES = {
    "absolute": lambda: scene_a(1.8), "chatter": lambda: scene_a(5.5, "relative"),
    "chaos with back impacts": lambda: scene_a(0.4, "relative"),
    "rigid": lambda: scene_a(5.5, "relative", contact_law="rigid"),
    "compliant": lambda: scene_a(0.8, "relative", contact_law="compliant"),
    "harmonics": lambda: scene_c(1.5), "kink and chatter": lambda: scene_d(5.5),
    "kink, rigid": lambda: scene_d(8.0, contact_law="rigid"),
    "standing": lambda: scene_a(0.3, back_flank_te=False), "engaged": lambda: scene_a(12.5),
    "events on kinks": lambda: oscillator(TRIANGLE, force=2.0, period=2.0, restitution=0.5),
    "ping-pong": lambda: oscillator(restitution=1.0, backlash=1.0, period=4.0),
}
# Multiples of 2^-10 add up exactly, so that all ways of cutting end at the same time.
cuts = st.lists(st.integers(1, 1024 * CYCLES - 1), min_size=1, max_size=5, unique=True).map(
    lambda at: np.diff(np.sort([0, *at, 1024 * CYCLES])) / 1024)


def start_of(name):
    return ("separation", -0.25, 0.0) if name in ("events on kinks", "ping-pong") else "rest"


def whole(name, phase=0.0, **options):
    return simulate(SCENES[name](), start_of(name), phase=phase, cycles=CYCLES, observe=RECORD,
                    **options)


def in_parts(name, lengths, phase=0.0):
    """One run in parts: the parts' tables put together, and the last part."""
    osc, state, parts = SCENES[name](), start_of(name), []
    for length in lengths:
        parts.append(simulate(osc, state, phase=phase, cycles=float(length), observe=RECORD))
        state = parts[-1].final
    return parts


def joined(parts, table):
    """Tables of parts put together; a cycle in which one ends is a line of the next one, too."""
    tables = [getattr(part, table) for part in parts]
    if table == "cycles":
        following = [one["cycle"].values[0] for one in tables[1:]]
        tables = [one.isel(cycle=one["cycle"].values < first)
                  for one, first in zip(tables, [*following, np.inf], strict=True)]
    return {name: np.concatenate([one[name].values for one in tables]).tobytes()
            for name in tables[0].variables}


def plain(table):
    return {name: array.values.tobytes() for name, array in table.variables.items()}


def state_bytes(state):
    return (int(state.motion_state),
            np.array([state.phi, state.phi_dot, state.phase, state.tau]).tobytes())


@pytest.mark.parametrize("name", SCENES)
@given(cuts, st.sampled_from([0.0, 0.375]))
@settings(deadline=None, max_examples=12)
def test_cut_anywhere(name, lengths, phase):
    one, parts = whole(name, phase), in_parts(name, lengths, phase)
    assert one.status == Status.OK
    assert joined(parts, "events") == plain(one.events)
    assert joined(parts, "cycles") == plain(one.cycles)
    assert state_bytes(parts[-1].final) == state_bytes(one.final)


@pytest.mark.parametrize("name", SCENES)
def test_cut_at_events_and_cycle_ends(name):
    """The cuts hypothesis is unlikely to draw: at an event's time and at ends of cycles."""
    one = whole(name)
    events = one.events["tau"].values
    taus = events[(events > 0) & (events < one.final.tau)][:8] / one.oscillator.period
    for first in (*taus, 1.0, 3.0):
        lengths = [first, CYCLES - first]
        parts = in_parts(name, lengths)
        assert joined(parts, "events") == plain(one.events)
        # first + (CYCLES - first) may miss CYCLES by a rounding; the state then does, too.
        if first + (CYCLES - first) == CYCLES:
            assert state_bytes(parts[-1].final) == state_bytes(one.final)
        assert joined(parts, "cycles") == plain(one.cycles)


def test_events_belong_to_the_part_they_fall_in():
    parts = in_parts("chatter", [0.5, 0.25, 2.25, 3.0])
    ends = np.cumsum([0.5, 0.25, 2.25, 3.0]) * parts[0].oscillator.period
    begin = 0.0
    for part, end in zip(parts, ends, strict=True):
        tau = part.events["tau"].values
        assert np.all((begin <= tau) & (tau <= part.final.tau))
        assert part.final.tau == pytest.approx(end, rel=1e-15)
        begin = part.final.tau


@pytest.mark.parametrize("name", ["chatter", "compliant", "kink, rigid"])
def test_history_after_a_continuation(name):
    """The history of a continued run is that of the uncut one, from the very start."""
    one, parts = whole(name), in_parts(name, [1.25, 2.5, 2.25])
    taus = np.linspace(0, one.final.tau, 301)
    assert dataset_bytes(parts[-1].history(taus)) == dataset_bytes(one.history(taus))


@pytest.mark.parametrize("name", SCENES)
def test_a_history_goes_on_from_the_nearest_checkpoint(name, monkeypatch):
    """The same bytes, from many checkpoints, few, or none; the last cycles cost themselves."""
    import copy

    one = whole(name)
    monkeypatch.setattr(calls, "CALL_SECONDS", 0.0)
    monkeypatch.setattr(calls, "LOG_ROOM", 66)
    monkeypatch.setattr(calls, "MOST_CHECKPOINTS", 5)
    cut = whole(name)
    end = one.final.tau
    events = one.events["tau"].values
    bare = copy.copy(one)
    bare.final = replace(one.final, _checkpoints=())
    for since in (0.0, 0.5, 0.97):
        taus = np.unique(np.concatenate([np.linspace(since * end, end, 57),
                                         events[events >= since * end]]))
        expected = dataset_bytes(bare.history(taus))
        assert dataset_bytes(cut.history(taus)) == expected
        assert dataset_bytes(one.history(taus)) == expected
    assert len(cut.final._checkpoints) <= 6 and cut.final._checkpoints[-1][2] is cut.final._blob


def test_late_times_cost_no_more_than_what_leads_to_them(monkeypatch):
    from lapwing.studies.trajectory import result as trajectory

    osc = scene_a(1.8, "absolute")
    before = simulate(osc, cycles=5000, observe=())
    run = simulate(osc, before.final, cycles=2, observe=())
    made, original = [], trajectory.TrajectoryCall

    class Kept(original):
        def __init__(self, *arguments, **options):
            super().__init__(*arguments, **options)
            made.append((self, self.work))

    monkeypatch.setattr(trajectory, "TrajectoryCall", Kept)
    run.history(np.linspace(run.final.tau - osc.period, run.final.tau, 5))
    (call, begun), = made
    moved = call.work["stretches"] - begun["stretches"]
    assert 0 < moved < 0.01 * run.work["stretches"]


@pytest.mark.parametrize("name", SCENES)
def test_full_log_and_deadline(name, monkeypatch):
    one = whole(name)
    made = []
    compiled = calls.api.trajectory

    def counted(*arguments):
        made.append(None)
        return compiled(*arguments)

    class Api:
        trajectory = staticmethod(counted)

    monkeypatch.setattr(calls, "api", Api)
    variants = {}
    for setting, value in (("LOG_ROOM", 66), ("CALL_SECONDS", 0.0)):
        with monkeypatch.context() as patch:
            patch.setattr(calls, setting, value)
            before = len(made)
            variants[setting] = whole(name)
            variants[setting].calls = len(made) - before
    for run in variants.values():
        assert dataset_bytes(run.events) == dataset_bytes(one.events)
        assert dataset_bytes(run.cycles) == dataset_bytes(one.cycles)
        assert state_bytes(run.final) == state_bytes(one.final)
        assert run.work == one.work and run.status == Status.OK
    # The bounds were really met: a log of 66 lines, a look at the clock each 128 stretches.
    if len(one.events["kind"]) > 66:
        assert variants["LOG_ROOM"].calls > 1
    if one.work["steps"] > 256:
        assert variants["CALL_SECONDS"].calls > 1


def test_more_cycles_than_a_call_has_room_for():
    """The table of cycles is handed over in blocks of 4096."""
    osc = oscillator(restitution=1.0, backlash=1.0, period=4.0)
    one = simulate(osc, ("separation", -0.25, 0.0), cycles=9000)
    assert np.array_equal(one.cycles["cycle"].values, np.arange(9000))
    parts = [simulate(osc, ("separation", -0.25, 0.0), cycles=5000)]
    parts.append(simulate(osc, parts[0].final, cycles=4000))
    assert joined(parts, "cycles") == plain(one.cycles)


def test_the_cut_state_is_the_state_of_the_history():
    one = whole("compliant")
    for part in in_parts("compliant", [0.5, 1.125, 4.375])[:2]:
        there = one.history([part.final.tau])
        # τ alone says where the state is to its own rounding, EPS·τ; accelerations are below one
        # angle scale.
        slack = 2 * EPS * part.final.tau
        assert there["phi"].values[0] == pytest.approx(
            part.final.phi, rel=0, abs=slack * abs(part.final.phi_dot) + EPS * abs(part.final.phi))
        assert there["phi_dot"].values[0] == pytest.approx(
            part.final.phi_dot, rel=4 * EPS, abs=slack * one.oscillator.angle_scale)


def test_a_state_that_ends_no_run_is_refused():
    run = whole("absolute")
    bare = type(run.final)(run.final.motion_state, 0.0, 0.0, 0.0, 0.0)
    with pytest.raises(ValueError, match="no end of a run"):
        simulate(run.oscillator, bare)
