"""A map in a deck: killed, stopped, gone on with; the same numbers in the end, no shard left."""

import signal
import subprocess
import sys
import time

import pytest

from helpers import plane_deck, plane_numbers
from lapwing.deck import load_deck
from lapwing.folder import FolderError
from lapwing.part import run_part
from lapwing.results import read_results
from lapwing.results.shards import shards_in
from lapwing.run import run_deck
from lapwing.studies.map.shards import Job

SHARDS = 24


@pytest.fixture(scope="module")
def deck(tmp_path_factory):
    path = tmp_path_factory.mktemp("map") / "plane.nml"
    path.write_text(plane_deck(30, 600, 5), encoding="utf-8")
    return path


def run(deck, out, *options):
    return subprocess.Popen(
        [sys.executable, "-m", "lapwing", "run", deck, "--out", out, "--figures", "none",
         "--threads", "2", *options], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


@pytest.fixture(scope="module")
def whole(deck, tmp_path_factory):
    out = tmp_path_factory.mktemp("whole")
    child = run(deck, out)
    said, errors = child.communicate()
    assert child.returncode == 0, errors
    assert "contact was kept in" in said
    assert [path.name for path in out.iterdir()] == ["plane"]
    return plane_numbers(out / "plane" / "result.nc")


def when_it_has(shards, child, folder):
    """Wait until a child has so many shards; it has not ended then."""
    while len(shards_in(folder)) < shards:
        assert child.poll() is None, child.communicate()
        time.sleep(0.005)


def test_after_a_kill_the_same_command_goes_on(deck, whole, tmp_path):
    folder = tmp_path / "plane.shards" / "map_plane"
    for shards in (2, 7):
        child = run(deck, tmp_path)
        when_it_has(shards, child, folder)
        child.kill()
        child.communicate()
        assert child.returncode == -signal.SIGKILL and not (tmp_path / "plane").exists()
    lying = {path: path.stat().st_ino for path in folder.glob("shard-*.nc")}
    assert 7 <= len(lying) < SHARDS
    child = run(deck, tmp_path)
    # What lies there is read, not made again, as long as there is work left.
    when_it_has(len(lying) + 1, child, folder)
    assert all(path.stat().st_ino == inode for path, inode in lying.items() if path.exists())
    said, errors = child.communicate()
    assert child.returncode == 0, errors
    assert "again" not in said + errors
    assert plane_numbers(tmp_path / "plane" / "result.nc") == whole
    assert [path.name for path in tmp_path.iterdir()] == ["plane"]


@pytest.mark.parametrize(("number", "code"), [
    (signal.SIGTERM, 75), pytest.param(signal.SIGINT, 130, marks=pytest.mark.full)])
def test_after_a_signal_too(deck, whole, tmp_path, number, code):
    folder = tmp_path / "plane.shards" / "map_plane"
    child = run(deck, tmp_path)
    when_it_has(3, child, folder)
    child.send_signal(number)
    child.communicate()
    assert child.returncode == code
    with read_results(tmp_path / "plane" / "result.nc") as results:
        assert results.interrupted and int(results.study("map", "plane").attrs["interrupted"])
    said = (tmp_path / "plane" / "summary.md").read_text(encoding="utf-8")
    assert "map `plane` lacks" in said and "not reached" in said
    child = run(deck, tmp_path)
    child.communicate()
    assert child.returncode == 0
    assert plane_numbers(tmp_path / "plane" / "result.nc") == whole
    assert [path.name for path in tmp_path.iterdir()] == ["plane"]


def test_a_damaged_shard_is_made_again_and_said(deck, whole, tmp_path):
    folder = tmp_path / "plane.shards" / "map_plane"
    child = run(deck, tmp_path)
    when_it_has(4, child, folder)
    child.kill()
    child.communicate()
    path = sorted(folder.glob("shard-*.nc"))[0]
    path.write_bytes(path.read_bytes()[:1000])
    (folder / "notes of mine.txt").write_text("keep")
    child = run(deck, tmp_path)
    said, errors = child.communicate()
    assert child.returncode == 0 and "shard 0 " in said + errors
    assert plane_numbers(tmp_path / "plane" / "result.nc") == whole
    assert [path.name for path in folder.iterdir()] == ["notes of mine.txt"]


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
