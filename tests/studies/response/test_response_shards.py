"""A long response in pieces: the bytes of one call, wherever it is cut and whatever is lost."""

import pickle
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from helpers import dataset_bytes, plane_deck
from lapwing import TransmissionError
from lapwing.commands.status import state_of
from lapwing.deck import load_deck
from lapwing.part import missing_shards, run_part
from lapwing.results import read_results
from lapwing.results.shards import shard_path, shards_in
from lapwing.run import run_deck
from lapwing.studies.map.cut import Cuts, Line
from lapwing.studies.map.work import gather
from lapwing.studies.of_deck import compute, jobs_of
from lapwing.studies.response import shards, study
from lapwing.studies.response.measured import passes_on_repeats
from lapwing.studies.response.run import dataset_of, prepared, response
from lapwing.studies.response.shards import Gathered, ResponseJob, bounds, is_long
from lapwing_bench.scenes import PAIR

WAVES = TransmissionError.harmonic([17e-6, 4.5e-6, 1.5e-6], [0.0, 1.0, 2.0], [1, 2, 3])
# Kinked at phase 0, where mesh cycles are cut.
KINKED = TransmissionError.parabola(17e-6)
ASKED = {"start": "rest", "settle": 20, "record": 70, "samples_per_cycle": 8, "exponents": True,
         "phase": 0.0}
SCENES = {
    "chaos": (WAVES, {"brake_torque": 0.6}, {"settle": 0}),
    "phase": (WAVES, {"brake_torque": 2.0}, {"phase": 0.3, "settle": 0}),
    "kinked": (KINKED, {"brake_torque": 3.0}, {}),
    "engaged": (WAVES, {"brake_torque": 60.0}, {}),
    "two masses": (WAVES, {"brake_torque": 2.0, "degrees_of_freedom": 2}, {}),
    "rigid": (WAVES, {"brake_torque": 2.0, "contact_law": "rigid"}, {"exponents": False}),
    "fails": (KINKED, {"brake_torque": 3.0}, {"max_events_per_cycle": 40}),
}


def asked(scene):
    te, operation, changed = SCENES[scene]
    return (PAIR.oscillator(te, pinion_speed_rpm=1500.0, **operation), PAIR), {**ASKED, **changed}


def in_pieces(scene, most, folder=None, **options):
    """The response of a scene, its pieces put together."""
    given, words = asked(scene)
    made = prepared(*given, name="response", **words)
    job = ResponseJob(made.passes, most)
    found = Gathered(job, options.get("notes") or (lambda _: None))
    gather("response", job, found, **{
        "folder": folder, "executor": None, "threads": 2, "progress": None, "notes": None,
        "keep_interrupted": False, **options})
    return dataset_of(made, found.recordings())


def same(one, other):
    """Whether two responses hold the same bytes and say the same."""
    return dataset_bytes(one) == dataset_bytes(other) and repr(one.attrs) == repr(other.attrs)


@pytest.mark.parametrize("scene", SCENES)
def test_pieces_have_the_bytes_of_one_call(scene, tmp_path):
    given, words = asked(scene)
    expected = response(*given, **words)
    assert (expected.attrs["status_meaning"] != "ok") == (scene == "fails")
    assert same(in_pieces(scene, 7), expected)
    in_pieces(scene, 19, tmp_path)
    assert same(in_pieces(scene, 19, tmp_path, notes=pytest.fail), expected)


def test_what_is_lost_is_made_again_and_nothing_else(tmp_path):
    expected = in_pieces("kinked", 19, tmp_path)
    # Of 20 cycles that settle, and 70 in batches of 64: 2 and 2 pieces, twice.
    assert shards_in(tmp_path) == list(range(8))
    shard_path(tmp_path, 1).unlink()
    shard_path(tmp_path, 6).write_bytes(b"")
    lying = {path.name: path.stat().st_ino for path in tmp_path.iterdir()}
    notes = []
    assert same(in_pieces("kinked", 19, tmp_path, notes=notes.append), expected)
    assert {path.name for path in tmp_path.iterdir() if path.stat().st_ino
            != lying.get(path.name)} == {"shard-00001.nc", "shard-00006.nc"}
    assert len(notes) == 1 and notes[0].startswith("shard 6 ")


def test_a_job_is_the_same_in_another_process():
    def job(scene, **changed):
        given, words = asked(scene)
        return ResponseJob(prepared(*given, name="a", **{**words, **changed}).passes, 19)

    made = job("chaos")
    assert pickle.loads(pickle.dumps(made)).identity == made.identity
    others = [job("chaos", **changed).identity for changed in (
        {"settle": 1}, {"record": 71}, {"samples_per_cycle": 9}, {"rtol": 1e-9}, {"phase": 0.1},
        {"exponents": False})] + [job("kinked").identity, job("two masses").identity]
    assert len({made.identity, *others}) == 9


def test_a_cut_follows_from_the_response_alone():
    assert bounds((20, 130), 8, 19) == (0, 19, 20, 84, 148, 151)
    assert bounds((0, 1), 400) == (0, 2)
    settle, record = 2 * shards.SETTLED + 1, 3000
    found = bounds((settle, record), 400)
    assert found == (0, shards.SETTLED, 2 * shards.SETTLED, settle, settle + 2560,
                     settle + record + 1)
    line = Line(found)
    assert Cuts((line, line)).place(5) == (line.runs, line.runs + shards.SETTLED)
    assert not is_long(400, 100, 400) and not is_long(shards.SETTLED, 1, 8)
    assert is_long(shards.SETTLED + 1, 1, 8) and is_long(0, shards.SAMPLED // 200 + 1, 400)


@pytest.fixture
def deck(tmp_path):
    path = tmp_path / "long.nml"
    text = plane_deck(4, 5, 5)
    path.write_text(text[:text.index("&map")] + "".join(f"""
&response
  name = '{name}', brake_torque = {torque}, settle_cycles = 40, record_cycles = 70
  samples_per_cycle = 8
/""" for name, torque in (("low", 0.6), ("high", 2.0))) + "&operation pinion_speed_rpm = 1500 /",
        encoding="utf-8")
    return path


def cut_at(monkeypatch, settled):
    monkeypatch.setattr(shards, "SETTLED", settled)
    monkeypatch.setattr(shards, "SAMPLED", 8 * 64)


def stored(folder):
    with read_results(folder / "long/result.nc") as results:
        return [results.response(name).load() for name in ("low", "high")]


def test_a_short_response_leaves_no_files(deck, tmp_path, monkeypatch):
    asked_for = load_deck(deck)
    assert not list(jobs_of(asked_for))
    compute(asked_for, 1, lambda *_: lambda _: None, folder=tmp_path / "shards")
    assert not (tmp_path / "shards").exists()
    cut_at(monkeypatch, 39)
    assert [(kind, name) for kind, name, _ in jobs_of(asked_for)] == [
        ("response", "low"), ("response", "high")]


def test_a_stopped_response_goes_on_where_it_was(deck, tmp_path, monkeypatch):
    """Parts, a signal, and the same command again make between them what one call makes."""
    run_deck(load_deck(deck), tmp_path / "whole", figures="none")
    cut_at(monkeypatch, 15)
    asked_for, out = load_deck(deck), tmp_path / "cut"
    assert run_part(asked_for, out, 2, 2).made == 10  # the second chain of each
    (missing, count), _ = missing_shards(asked_for, out).values()
    assert (missing, count) == ([0, 1, 2, 3, 4], 10)

    class Stopping:
        """Stops the run when some more is done."""

        def study(self, label, total, unit):
            return self.told

        def told(self, fraction):
            if 0.83 < fraction < 0.95:
                raise KeyboardInterrupt

    outcome = run_deck(asked_for, out, figures="none", threads=1, progress=Stopping())
    assert outcome.interrupted
    done, state = state_of(out / "long").studies
    assert (done.done, done.runs) == (1, 1)
    assert (state.runs, state.unit, state.shards) == (222, "mesh cycles", 10)
    assert 5 < state.shards_done < 10 and 111 < state.done == 222 - state.missing
    run_deck(asked_for, out, figures="none")
    assert not (out / "long.shards").exists()
    for one, other in zip(stored(tmp_path / "whole"), stored(out), strict=True):
        assert one.identical(other)


def test_one_that_fails_is_repeated_whole(deck, tmp_path, monkeypatch):
    cut_at(monkeypatch, 15)
    asked_for = load_deck(deck, [("numerics.max_events_per_cycle", "1")])
    run_part(asked_for, tmp_path, 1, 1)
    state = state_of(tmp_path / "long")
    assert state.studies[0].failed and not state.studies[0].failed_runs
    assert state.rerun.endswith("response_low 0")


def test_motions_on_other_curves_are_cut_as_well(tmp_path, monkeypatch):
    deck = load_deck(Path(__file__).parents[2] / "deck" / "accepted" / "measured.nml",
                     [("response.a.samples_per_cycle", "8")])
    deck.studies |= {"critical": (), "sweep": ()}
    monkeypatch.setattr(study, "passes_on_repeats", lambda *given: (
        [*passes_on_repeats(*given)[:2], None]))

    def found():
        return compute(deck, 2, lambda *_: lambda _: None,
                       folder=tmp_path / "shards").studies["response"]["a"]

    expected = found()
    cut_at(monkeypatch, 19)
    (_, _, job), = jobs_of(deck)
    assert job.cut.chains == 4
    assert found().identical(expected)
    assert list(expected["repeat_class"].values == "failed") == [False, False, True]
    assert shards_in(tmp_path / "shards/response_a") == list(range(job.cut.shards))


# `lapwing` with small pieces.
SMALL = """
import sys
from lapwing.studies.response import shards
shards.SETTLED, shards.SAMPLED = 20_000, 8 * 640
from lapwing.__main__ import main
sys.exit(main())
"""


@pytest.mark.full
def test_processes_that_are_killed_lose_a_piece_of_each_run(deck, tmp_path):
    words = ["run", str(deck), "--figures", "none", "--threads", "2", "--out"]
    for name in ("low", "high"):
        words[2:2] = ["--set", f"response.{name}.settle_cycles=200000",
                      "--set", f"response.{name}.record_cycles=2000"]
    subprocess.run([sys.executable, "-m", "lapwing", *words, tmp_path / "whole"], check=True)
    folder = tmp_path / "cut/long.shards"

    def lying():
        return {path: path.stat().st_ino for path in folder.glob("*/shard-*.nc")}

    for signum, code in ((signal.SIGKILL, -9), (signal.SIGTERM, 75), (signal.SIGKILL, -9)):
        before = lying()
        process = subprocess.Popen([sys.executable, "-c", SMALL, *words, tmp_path / "cut"])
        while len(lying()) < len(before) + 7:
            assert process.poll() is None
            time.sleep(0.02)
        process.send_signal(signum)
        assert process.wait() == code
        assert before.items() <= lying().items()  # no piece is made twice
    subprocess.run([sys.executable, "-c", SMALL, *words, tmp_path / "cut"], check=True)
    assert not folder.exists()
    for one, other in zip(stored(tmp_path / "whole"), stored(tmp_path / "cut"), strict=True):
        assert one.identical(other)
