"""The estimate of a deck's time: by a clock that the work itself moves, and in a real process."""

import math
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from lapwing.deck import load_deck
from lapwing.studies import cost
from lapwing.studies.cost import Stage, spell, spread, stages_of, words
from lapwing.studies.ensemble import study as ensembles

ROOT = Path(__file__).parents[2]
PLAIN = (ROOT / "tests" / "deck" / "accepted" / "plain.nml").read_text(encoding="utf-8")
TWO = """&response name = 'two' settle_cycles = 640 record_cycles = 1280 /
&sweep name = 'wide' parameter = 'brake_torque' from = 1 to = 9 count = 1000 starts = 'rest'
  settle_cycles = 100 record_cycles = 10 /
&critical name = 'last' find = 'back' from = 1 to = 2 count = 64 /
&critical name = 'edge' find = 'safe' from = 1 to = 20 count = 50 /
"""


class Clock:
    """Stands still but for what the studies add."""

    def __init__(self):
        self.now = 0.0

    def __call__(self):
        return self.now


@pytest.fixture
def moved(monkeypatch):
    """A clock, and studies that do nothing but move it: each by a call and by its points."""
    from lapwing.studies.critical import study as critical
    from lapwing.studies.response import study as responses
    from lapwing.studies.sweep import study as sweeps

    clock = Clock()
    rates = SimpleNamespace(call=0.001, cycle=1e-4, value=0.002, grid=0.5)

    def response(deck, study, order, threads, done):
        clock.now += rates.call + rates.cycle * (study.settle_cycles + study.record_cycles)

    def sweep(deck, study, order, threads, done):
        assert len(study.starts) == threads == 1
        clock.now += rates.value * len(study.values)

    def search(deck, study, threads):
        clock.now += rates.value * len(study.values)

    def grid(deck, study, threads):
        clock.now += rates.grid
        return 3

    monkeypatch.setattr(responses, "carry_out", response)
    monkeypatch.setattr(sweeps, "carry_out", sweep)
    monkeypatch.setattr(critical, "critical_study", search)
    monkeypatch.setattr(critical, "rattling_at", grid)
    return clock, rates


def deck_of(folder, text):
    path = folder / "deck.nml"
    path.write_text(text, encoding="utf-8")
    return load_deck(path, [])


def test_estimates_of_work_that_is_known(tmp_path, moved):
    """Responses side by side, whole motions shared; never much longer than was allowed."""
    clock, rates = moved
    deck = deck_of(tmp_path, PLAIN + TWO)
    whole = [rates.call + rates.cycle * (study.settle_cycles + study.record_cycles)
             for study in deck.responses]
    responses, back, safe, sweep = stages_of(deck, 2, 1.0, clock)
    true = max(sum(whole) / 2, *whole)
    assert responses.low <= true * (1 + 1e-12) and true <= responses.high * (1 + 1e-12)
    assert responses.high < 1.5 * true
    assert (back.low, back.high) == pytest.approx((64 * rates.value / 2,) * 2)
    assert math.isnan(safe.low)
    assert safe.why == "about 0.25 s for each value that it tries"
    assert (sweep.low, sweep.high) == pytest.approx((1000 * rates.value / 2,) * 2)
    assert 0 < sweep.part < 1
    assert clock.now < 1.0 + rates.grid


def test_no_more_runs_of_an_ensemble_are_tried_than_there_are(tmp_path):
    text = PLAIN + """&draw parameter = 'backlash', law = 'uniform', low = 0.001, high = 0.003 /
&ensemble name = 'few', runs = 32, brake_torque = 6, settle_cycles = 2, record_cycles = 2 /
"""
    deck = deck_of(tmp_path, text)
    low, high, part = ensembles.estimate(deck, *deck.studies["ensemble"], 60.0, Clock(), 1)
    assert part == 1.0 and low == high == 0.0  # by a clock that stands still


@pytest.mark.parametrize(("part", "text"), [
    (1.0, "all"), (0.9999, "99 %"), (0.994, "99 %"), (0.031, "3.1 %")])
def test_parts_in_words(part, text):
    assert cost.spell_part(part) == text


def test_what_is_carried_is_not_shared(tmp_path, moved):
    clock, rates = moved
    text = PLAIN + TWO.replace("starts = 'rest'", "starts = 'rest', 'up'").split("&critical")[0]
    *_, sweep = stages_of(deck_of(tmp_path, text), 8, 1.0, clock)
    assert sweep.low == pytest.approx(1000 * rates.value)
    *_, sweep = stages_of(deck_of(tmp_path, text), 1, 1.0, clock)
    assert sweep.low == pytest.approx(2000 * rates.value)


def test_unequal_points_give_a_range(tmp_path, moved, monkeypatch):
    """Points of which every other one is ten times as slow: the truth lies in the range."""
    from lapwing.studies.sweep import study as sweeps

    clock, _ = moved
    times = np.where(np.random.default_rng(1).random(1000) < 0.5, 0.001, 0.01)

    def sweep(deck, study, order, threads, done):
        clock.now += times[np.searchsorted(deck.sweeps[0].values, study.values)].sum()

    monkeypatch.setattr(sweeps, "carry_out", sweep)
    text = PLAIN + TWO.split("&critical")[0]
    *_, stage = stages_of(deck_of(tmp_path, text), 1, 2.0, clock)
    assert stage.low < times.sum() < stage.high < 2 * times.sum()
    assert stage.low > 0.5 * times.sum()


def test_no_time_and_failures_are_said(tmp_path, moved, monkeypatch):
    from lapwing.studies.response import study as responses

    clock, rates = moved
    deck = deck_of(tmp_path, PLAIN + TWO)
    assert {stage.why for stage in stages_of(deck, 2, 0.0, clock)} == {cost.UNTRIED}
    rates.call = 5.0  # the first response takes all there is
    stages = list(stages_of(deck, 2, 1.0, clock))
    assert [stage.why for stage in stages] == [cost.UNTRIED] * 4
    assert [stage.name for stage in stages] == cost.names_of(deck)

    def failing(*_):
        raise MemoryError

    monkeypatch.setattr(responses, "carry_out", failing)
    assert next(stages_of(deck, 2, 1.0, clock)).why == "a trial failed"


@pytest.mark.parametrize("count", [1, 2, 3, 64, 139])
def test_every_beginning_is_spread(count):
    order = spread(count)
    assert sorted(order) == list(range(count))
    for n in range(1, count + 1):
        widest = np.diff([0, *sorted(order[:n]), count]).max()
        assert widest <= 4 * count / n + 1


@pytest.mark.parametrize(("seconds", "text"), [
    (0.0, "0 s"), (0.0004, "0 s"), (0.0421, "0.042 s"), (1.04, "1 s"), (61.0, "61 s"),
    (210.0, "3.5 min"), (7200.0, "2 h"), (2e5, "2.3 days"), (1e9, "32 years")])
def test_times_in_words(seconds, text):
    assert spell(seconds) == text


def test_sentences():
    known = Stage("the responses", 1.0, 3.0, 0.25)
    unknown = Stage("sweep 'a'", why=cost.UNTRIED)
    assert words([known], 2) == (
        "computing time: about 2 s (from 1 s to 3 s), estimated for this machine without other "
        "work and 2 threads, by trying 25 % of the responses; start and figures come on top")
    assert words([known, unknown], 1).endswith(
        "; not counted, for it is not known: sweep 'a' (no trial of it ended in time)")
    assert words([unknown], 1) == (
        "computing time: not known: sweep 'a' (no trial of it ended in time)")
    assert words([Stage("critical 'b'", 2.0, 2.0, 1.0)], 1) == (
        "computing time: about 2 s, estimated for this machine without other work and 1 thread, "
        "by trying all of critical 'b'; start and figures come on top")


def test_a_process_says_it_and_is_ended_in_a_long_point(tmp_path):
    """Bounds of processor time, none on the clock: what is said depends on no other work."""
    chaotic = PLAIN.replace("pinion_speed_rpm = 240", "pinion_speed_rpm = 480")
    slow = deck_of(tmp_path, chaotic + (
        "&sweep name = 'endless' parameter = 'brake_torque' from = 2.2 to = 2.3 count = 2 "
        "settle_cycles = 10000000 record_cycles = 1 /\n"))
    quick = load_deck(ROOT / "inputs" / "minimal.nml", [])
    found = cost.stated([quick, slow], 2, seconds=1.0, limit=3600.0)
    assert found[0].startswith("computing time: about ")
    assert " of the response; " in found[0]
    assert "sweep 'endless' (no trial of it ended in time)" in found[1]


def test_where_no_process_can_be_begun(tmp_path, monkeypatch):
    def none(*_, **__):
        raise OSError("no more processes")

    monkeypatch.setattr(cost.subprocess, "run", none)
    deck = load_deck(ROOT / "inputs" / "minimal.nml", [])
    assert cost.stated([deck], 2) == [
        "computing time: not known: the response (no trial of it ended in time)"]
