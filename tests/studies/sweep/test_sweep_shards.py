"""A large sweep in shards: the bytes of one call, whatever is lost on the way."""

import pickle
from dataclasses import replace

import numpy as np
import pytest

from helpers import ROOT, dataset_bytes, plane_deck
from lapwing import Status, TransmissionError, sweep
from lapwing.commands.status import state_of
from lapwing.deck import load_deck
from lapwing.part import missing_shards, run_part
from lapwing.results import read_results
from lapwing.results.shards import shard_path, shards_in
from lapwing.run import run_deck
from lapwing.studies.map import cut, work
from lapwing.studies.map.cut import Cut, Cuts
from lapwing.studies.map.work import gather
from lapwing.studies.of_deck import jobs_of
from lapwing.studies.sweep import shards
from lapwing.studies.sweep.run import RECORDS, dataset_of, job_of
from lapwing.studies.sweep.shards import Gathered, SweepJob
from lapwing_bench.scenes import PAIR

TE = TransmissionError.harmonic([17e-6, 4.5e-6, 1.5e-6], [0.0, 1.0, 2.0], [1, 2, 3])
ASKED = {"parameter": "brake_torque", "values": np.linspace(0.5, 9, 5),
         "starts": ("rest", "up", "down"), "settle": 12, "record": 9,
         "pinion_speed_rpm": 1500.0, "observe": RECORDS, "phase": 0.0}


def job(most=2, **changed):
    return replace(job_of(PAIR, TE, **{**ASKED, **changed}), most=most)


def swept(made, folder=None, **options):
    """The sweep of a job, its shards put together; and whether it was stopped."""
    found = Gathered(made, options.get("notes") or (lambda _: None))
    stopped = gather("sweep", made, found, **{
        "folder": folder, "executor": None, "threads": 2, "progress": None, "notes": None,
        "keep_interrupted": True, **options})
    return dataset_of(made, found.result(stopped), found.further), stopped


@pytest.fixture(scope="module")
def expected():
    return sweep(PAIR, TE, **ASKED)


@pytest.mark.parametrize("most", [1, 3])
def test_shards_have_the_bytes_of_one_call(most, expected):
    found, stopped = swept(job(most))
    assert not stopped and found.attrs == expected.attrs
    assert dataset_bytes(found) == dataset_bytes(expected)


@pytest.mark.parametrize("changed", [
    {"degrees_of_freedom": 2, "observe": ("cycles", "exponents")},
    {"observe": ("cycles",), "contact_law": "compliant"},
    {"observe": ("impacts",), "brake_torque": 2.0, "parameter": "backlash",
     "values": [1e-4, 1e-3, 2e-3, 3e-3]}, {"max_events_per_cycle": 60}, {"phase": 0.25}])
def test_so_have_those_of_any_sweep(changed, tmp_path):
    asked = {**ASKED, **changed}
    expected = sweep(PAIR, TE, **asked)
    assert ("max_events_per_cycle" not in changed) or 0 < np.count_nonzero(expected["status"])
    swept(job(2, **changed), tmp_path)
    found, _ = swept(job(2, **changed), tmp_path, notes=pytest.fail)
    assert found.attrs == expected.attrs and dataset_bytes(found) == dataset_bytes(expected)


def test_what_is_lost_is_made_again_and_nothing_else(expected, tmp_path):
    made = job()
    swept(made, tmp_path)
    # Three shards of five values from each start.
    assert shards_in(tmp_path) == list(range(9)) and made.cut.chains == 5
    shard_path(tmp_path, 4).unlink()
    shard_path(tmp_path, 8).write_bytes(b"")
    lying = {path.name: path.stat().st_ino for path in tmp_path.iterdir()}
    notes = []
    found, _ = swept(made, tmp_path, notes=notes.append)
    assert dataset_bytes(found) == dataset_bytes(expected)
    assert {path.name for path in tmp_path.iterdir() if path.stat().st_ino
            != lying.get(path.name)} == {"shard-00004.nc", "shard-00008.nc"}
    assert len(notes) == 1 and notes[0].startswith("shard 8 ")
    notes.clear()
    swept(job(settle=13), tmp_path, notes=notes.append)
    assert len(notes) == 9 and all("is of another study" in note for note in notes)


def test_chains_are_begun_before_shards_that_wait_for_none(monkeypatch):
    """One thread: a chain goes on as soon as it can, then the other, then what begins at rest."""
    begun, carried_out = [], SweepJob.carried_out
    monkeypatch.setattr(work, "AHEAD", 0)
    monkeypatch.setattr(SweepJob, "carried_out", lambda self, index, *rest: (
        begun.append(index), carried_out(self, index, *rest))[1])
    swept(job(observe=("cycles",)), threads=1)
    assert begun == [3, 4, 5, 6, 7, 8, 0, 1, 2]


def test_what_is_finished_when_a_signal_comes_is_kept(expected, tmp_path):
    made = job()

    def stop(part):
        if part > 0.4:
            raise KeyboardInterrupt

    found, stopped = swept(made, tmp_path, threads=1, progress=stop)
    status = found["status"].values
    assert stopped and found.attrs["interrupted"] == 1
    done = status != Status.UNFINISHED
    assert 0 < done.sum() < done.size
    for name in ("deepest_separation", "lyapunov_exponent", "order_spectrum", "phi_rms"):
        assert np.array_equal(found[name].values[done], expected[name].values[done])
        assert np.isnan(found[name].values[~done]).all()
    assert not found["kept_impacts"].values[~done].any()
    assert dataset_bytes(swept(made, tmp_path, notes=pytest.fail)[0]) == dataset_bytes(expected)


def test_a_job_is_the_same_in_another_process():
    made = job()
    other = pickle.loads(pickle.dumps(made))
    assert other.identity == made.identity
    assert job(settle=13).identity != made.identity != job(most=3).identity


def test_cuts_one_after_the_other_are_the_parts_in_turn():
    parts = tuple(Cut(10, 4, 10, start) for start in ("rest", "up", "down"))
    cuts = Cuts(parts)
    assert cuts.shards == 9 and cuts.chains == 5
    assert [index for chain in range(cuts.chains) for index in cuts.chain(chain)] == list(range(9))
    assert [cuts.before(index) for index in range(9)] == [None, None, None, None, 3, 4, None, 6, 7]
    covered = np.zeros(30, dtype=int)
    for index in range(9):
        first, stop = cuts.place(index)
        covered[first:stop] += 1
        assert cuts.is_chained(index) == (index > 2)
    assert np.all(covered == 1) and cuts.place(6) == (26, 30)
    with pytest.raises(IndexError):
        cuts.place(9)


SWEEP = """
&sweep
  name = 'torque', parameter = 'brake_torque', from = 0.5, to = 9, count = 7
  settle_cycles = 30, record_cycles = 12, amplitudes = .true., exponents = .true.
/
&operation pinion_speed_rpm = 1500 /
"""


@pytest.fixture
def deck(tmp_path):
    path = tmp_path / "torque.nml"
    text = plane_deck(4, 5, 5)
    path.write_text(text[:text.index("&map")] + SWEEP, encoding="utf-8")
    return path


def test_a_small_sweep_of_a_deck_is_not_cut(deck, monkeypatch):
    assert not list(jobs_of(load_deck(deck)))
    # 7 values, 3 starts, 30 + 12 cycles, and 32 for amplitudes.
    for cycles, large in ((21 * 74, False), (21 * 74 - 1, True)):
        monkeypatch.setattr(shards, "CYCLES", cycles)
        assert bool(list(jobs_of(load_deck(deck)))) == large


def test_no_sweep_of_a_shipped_deck_is_cut():
    for path in sorted((ROOT / "inputs").glob("*.nml")):
        assert not [kind for kind, _, _ in jobs_of(load_deck(path)) if kind == "sweep"]


def test_parts_of_a_deck_make_a_large_sweep_between_them(deck, tmp_path, monkeypatch):
    run_deck(load_deck(deck), tmp_path / "whole", figures="none")
    monkeypatch.setattr(shards, "CYCLES", 100)
    monkeypatch.setattr(cut, "CYCLES", 3 * 42)
    asked, out = load_deck(deck), tmp_path / "parts"
    assert run_part(asked, out, 2, 2).made == 6
    (missing, count), = missing_shards(asked, out).values()
    assert count == 13 and len(missing) == 7
    state = state_of(out / "torque").studies[0]
    assert (state.study, state.shards, state.shards_done) == ("sweep_torque", 13, 6)
    assert state.missing == 21 - state.done > 0
    kept = []
    carried_out = SweepJob.carried_out
    monkeypatch.setattr(SweepJob, "carried_out", lambda self, index, *rest: (
        kept.append(index), carried_out(self, index, *rest))[1])
    run_deck(asked, out, figures="none")
    assert sorted(kept) == missing
    assert not (out / "torque.shards").exists()
    with read_results(tmp_path / "whole/torque/result.nc") as whole, \
            read_results(out / "torque/result.nc") as parts:
        one, other = (one.sweep("torque").load() for one in (whole, parts))
        assert one.identical(other)
