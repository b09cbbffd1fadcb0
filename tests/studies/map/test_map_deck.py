"""A map in a deck: killed, stopped, gone on with; the same numbers in the end, no shard left."""

import signal

import pytest

import children
from helpers import ROOT, plane_deck, plane_numbers
from lapwing.deck import load_deck
from lapwing.folder import FolderError
from lapwing.part import run_part
from lapwing.results import read_results
from lapwing.results.shards import shards_in
from lapwing.run import run_deck
from lapwing.studies.map.shards import Job

SHARDS = 24
# The command, sent a signal as soon as it has published so many shards; a line for each it began.
SIGNALLED = """
import os, signal, sys
from lapwing.__main__ import main
from lapwing.studies.map import work
from lapwing.studies.map.shards import Job
signal.signal(signal.SIGINT, signal.default_int_handler)
left, write_shard, carried_out = {shards}, work.write_shard, Job.carried_out
log = os.open({begun!r}, os.O_WRONLY | os.O_APPEND | os.O_CREAT)

def begin(job, index, *rest):
    os.write(log, b"%d\\n" % index)
    return carried_out(job, index, *rest)

def counted(*given):
    global left
    digest = write_shard(*given)
    left -= 1
    if not left:
        os.kill(os.getpid(), {number})
    return digest

work.write_shard, Job.carried_out = counted, begin
sys.argv = ["lapwing", "run", {deck!r}, "--out", {out!r}, "--figures", "none", "--threads", "2"]
main()
"""


@pytest.fixture(scope="module")
def deck(tmp_path_factory):
    path = tmp_path_factory.mktemp("map") / "plane.nml"
    path.write_text(plane_deck(30, 100, 5), encoding="utf-8")
    return path


def run(deck, out):
    return run_deck(load_deck(deck), out, threads=2, figures="none")


def signalled(deck, out, number, shards):
    """How the command ends that is sent a signal after so many shards."""
    return children.carried_out(SIGNALLED.format(
        deck=str(deck), out=str(out), number=int(number), shards=shards,
        begun=str(out.parent / f"{out.name} begun")))


@pytest.fixture(scope="module")
def whole(deck, tmp_path_factory):
    out = tmp_path_factory.mktemp("whole")
    outcome = run(deck, out)
    assert outcome.findings
    assert [path.name for path in out.iterdir()] == ["plane"]
    return plane_numbers(out / "plane" / "result.nc")


def test_after_a_kill_the_same_command_goes_on(deck, whole, tmp_path, monkeypatch):
    folder = tmp_path / "plane.shards" / "map_plane"
    for shards in (2, 7):
        assert signalled(deck, tmp_path, signal.SIGKILL, shards).code == -signal.SIGKILL
        assert not (tmp_path / "plane").exists()
    assert len(shards_in(folder)) == 9
    begun = [*map(int, (tmp_path.parent / f"{tmp_path.name} begun").read_text().split())]
    carried_out = Job.carried_out
    monkeypatch.setattr(Job, "carried_out", lambda job, index, *rest: (
        begun.append(index), carried_out(job, index, *rest))[1])
    outcome = run(deck, tmp_path)
    # What lies there is read, not made again; of what was under way, each kill has cost one shard
    # for each of the two threads at most.
    assert set(begun) == set(range(SHARDS)) and not outcome.notes
    assert len(begun) <= SHARDS + 2 * 2
    assert plane_numbers(tmp_path / "plane" / "result.nc") == whole
    assert [path.name for path in tmp_path.iterdir()] == ["plane"]


@pytest.mark.parametrize(("number", "code"), [
    (signal.SIGTERM, 75), pytest.param(signal.SIGINT, 130, marks=pytest.mark.full)])
def test_after_a_signal_too(deck, whole, tmp_path, number, code):
    ended = signalled(deck, tmp_path, number, 3)
    assert ended.code == code, ended.said
    with read_results(tmp_path / "plane" / "result.nc") as results:
        assert results.interrupted and int(results.study("map", "plane").attrs["interrupted"])
    said = (tmp_path / "plane" / "summary.md").read_text(encoding="utf-8")
    assert "map `plane` lacks" in said and "not reached" in said
    run(deck, tmp_path)
    assert plane_numbers(tmp_path / "plane" / "result.nc") == whole
    assert [path.name for path in tmp_path.iterdir()] == ["plane"]


def test_a_damaged_shard_is_made_again_and_said(deck, whole, tmp_path):
    folder = tmp_path / "plane.shards" / "map_plane"
    signalled(deck, tmp_path, signal.SIGKILL, 4)
    path = sorted(folder.glob("shard-*.nc"))[0]
    path.write_bytes(path.read_bytes()[:1000])
    (folder / "notes of mine.txt").write_text("keep")
    assert any("shard 0 " in note for note in run(deck, tmp_path).notes)
    assert plane_numbers(tmp_path / "plane" / "result.nc") == whole
    assert [path.name for path in folder.iterdir()] == ["notes of mine.txt"]


def test_names_with_spaces_and_other_letters_are_names(tmp_path):
    """Of deck, curve and results; also where a part is made by itself."""
    found = []
    for place, stem, curve in (("a", "b", "c"), ("räder und zähne", "plan é", "Fehler über µm")):
        folder = tmp_path / place
        folder.mkdir()
        (folder / f"{curve}.csv").write_bytes((ROOT / "inputs" / "te_25x32.csv").read_bytes())
        text = plane_deck(3, 3, 4).replace(
            "harmonic_amplitude = 17e-6, 4.5e-6, 1.5e-6, harmonic_shift = 0, 1, 2",
            f"file = '{curve}.csv'")
        (folder / f"{stem}.nml").write_text(text, encoding="utf-8")
        deck = load_deck(folder / f"{stem}.nml")
        assert run_part(deck, folder / f"out {place}", 2, 3).made == 1
        assert not run_deck(deck, folder / f"out {place}", figures="none").notes
        found.append(plane_numbers(folder / f"out {place}" / stem / "result.nc"))
    assert found[0] and found[0] == found[1]


def test_parts_outlive_the_replacing_of_other_results(deck, whole, tmp_path, monkeypatch):
    asked = load_deck(deck)
    run_deck(load_deck(deck, [("map.plane.settle_cycles", "5")]), tmp_path, figures="none")
    run_part(asked, tmp_path, 1, 1)
    with pytest.raises(FolderError, match="--force replaces them"):
        run_deck(asked, tmp_path, figures="none")

    def made(*_):
        raise OSError("a shard is made")

    monkeypatch.setattr(Job, "carried_out", made)
    run_deck(asked, tmp_path, figures="none", force=True)
    assert plane_numbers(tmp_path / "plane" / "result.nc") == whole
    monkeypatch.undo()
    run_part(asked, tmp_path, 1, 1)
    monkeypatch.setattr(Job, "carried_out", made)
    with pytest.raises(OSError, match="a shard is made"):  # of the same values: anew
        run_deck(asked, tmp_path, figures="none", force=True)
