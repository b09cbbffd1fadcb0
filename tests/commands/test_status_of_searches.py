"""How far searches and attractors are, that are cut into nothing whose number is known."""

import json

import netCDF4
import numpy as np
import pytest
from typer.testing import CliRunner

from helpers import plane_deck
from lapwing.base.codes import FoundMotion, Status
from lapwing.base.registry import STUDIES
from lapwing.cli import app
from lapwing.deck import load_deck, used_hash
from lapwing.folder import note_deck
from lapwing.results.lock import FolderLock
from lapwing.results.shards import shard_path, shards_in
from lapwing.run import run_deck
from lapwing.studies.attractors import along
from lapwing.studies.critical import records as kept
from lapwing.studies.critical import study as critical
from lapwing.studies.of_deck import shards_of
from lapwing.studies.records import Records

SEARCH = """&critical
  name = 'T', find = 'safe', from = 9, to = 14, count = 6
  start_phases = 2, start_positions = 2, start_speeds = 1, settle_cycles = 40, record_cycles = 10
/"""
ALONG = "&attractors name = 'A', values = 6, 13, runs = 2 /"
BRANCHES = "&branches name = 'B', from = 10, to = 13, count = 4 /"
RESPONSE = "&response name = 'R', brake_torque = 6 /"


def deck_of(folder, *studies):
    path = folder / "small.nml"
    text = plane_deck(6, 20, 5)
    path.write_text("\n".join([text[:text.index("&map")], "&operation pinion_speed_rpm = 1500 /",
                               *studies, ""]), encoding="utf-8")
    return load_deck(path)


def states(folder):
    """As JSON, and in words."""
    done, text = (CliRunner().invoke(app, ["status", str(folder / "small"), *more])
                  for more in (["--json"], []))
    assert done.exit_code == text.exit_code == 0, done.output
    (found,) = json.loads(done.stdout)
    return found, text.stdout


def stopping(monkeypatch, module, name, after):
    """Interrupt instead of the call behind so many."""
    real, calls = getattr(module, name), []

    def call(*rest, **options):
        if len(calls) == after:
            raise KeyboardInterrupt
        calls.append(None)
        return real(*rest, **options)

    monkeypatch.setattr(module, name, call)


def test_trials_are_counted_with_their_times(tmp_path, monkeypatch):
    monkeypatch.setattr(critical, "TRIAL_CYCLES", 1)
    folder = shards_of(tmp_path / "small.shards", "critical", "T")
    for changed, finished, expected in (
            (SEARCH, 3, 3), (SEARCH, 1, 4),
            # The search of another deck that begins with the same trials; one of other motions.
            (SEARCH.replace("= 10", "= 10, further_values = 1"), 0, 4),
            (SEARCH.replace("= 40", "= 41"), 0, 0)):
        with monkeypatch.context() as patch:
            stopping(patch, kept, "follow", finished)
            assert run_deck(deck_of(tmp_path, changed), tmp_path, force=changed != SEARCH,
                            figures="none").interrupted
        found, text = states(tmp_path)
        study, = found["studies"]
        assert shards_in(folder) == list(range(max(expected, 3 + (changed != SEARCH))))
        assert (study["records"], study["record_unit"]) == (expected, "trials"), changed
        assert (study["done"], study["missing"], study["seconds_left"]) == (0, 1, None)
        assert f"trials so far: {expected or 'none'}" in text
        assert "how many are left is not known" in text
        if expected:
            took = []
            for index in shards_in(folder):
                with netCDF4.Dataset(shard_path(folder, index)) as file:
                    took.append(file.seconds)
            assert study["seconds_per_record"] == pytest.approx(np.mean(took)) and min(took) > 0
        else:
            assert study["seconds_per_record"] is None
    # Which of what lies there is of a search under way, that tells; whether it has ended is open.
    with FolderLock(tmp_path / "small"):
        study, = states(tmp_path)[0]["studies"]
    assert (study["done"], study["missing"], study["records"]) == (None, None, 0)


def test_branches_are_counted_one_by_one(tmp_path):
    deck = deck_of(tmp_path, BRANCHES)
    note_deck(deck, tmp_path / "small.shards")
    folder = shards_of(tmp_path / "small.shards", "branches", "B")
    for owner in (used_hash(deck), "another"):
        records = Records(folder, "branch", owner=owner)
        for index in range(2):
            made = records.taken(str(index), lambda: 2.5, lambda one: {"value": np.array([one])},
                                 lambda data: float(data["value"][0]))
            assert made == 2.5
        study, = states(tmp_path)[0]["studies"]
        assert (study["unit"], study["record_unit"]) == ("bifurcation diagram", "branches")
        # What another deck took over is no longer counted here.
        assert study["records"] == (0 if owner == "another" else 2)


def test_values_of_interrupted_attractors_are_counted(tmp_path, monkeypatch):
    deck = deck_of(tmp_path, ALONG)
    for finished, anew in ((1, True), (2, False)):
        with monkeypatch.context() as patch:
            stopping(patch, along, "at_value", finished)
            assert run_deck(deck, tmp_path, figures="none").interrupted == anew
        found, text = states(tmp_path)
        study, = found["studies"]
        assert (study["runs"], study["unit"], study["done"], study["missing"]) == (
            2, "values", finished, 2 - finished)
        assert study["begins_anew"] == anew == ("begins it anew" in text)
        assert f"attractors_A: {finished} of 2 values done" in text
        assert (study["records"], found["rerun"]) == (None, None)


def test_what_is_not_known_is_not_told_as_nothing(tmp_path):
    """At work, and nothing is stored before it ends; the deck neither where none keeps shards."""
    with FolderLock(tmp_path / "small"):
        found, text = states(tmp_path)
        assert (found["state"], found["studies"]) == ("running", [])
        assert "not known before it ends" in text
        note_deck(deck_of(tmp_path, RESPONSE, BRANCHES), tmp_path / "small.shards")
        found, text = states(tmp_path)
    response, branches = found["studies"]
    assert (response["done"], response["missing"]) == (None, None)
    assert "response_R: no result stored yet; how far it is is not known before it ends" in text
    assert "branches_B: no result stored yet; branches so far: none" in text and branches["runs"]
    response, _ = states(tmp_path)[0]["studies"]  # nobody is at work
    assert (response["done"], response["missing"]) == (0, 1)


@pytest.mark.parametrize(("kind", "stored", "expected"), [
    ("attractors", {"reached": [1, 1, 0], "failed": [0, 2, -1]},
     [Status.OK, Status.NOT_FINITE, Status.UNFINISHED]),
    ("branches", {"motion_kind": [FoundMotion.PERIODIC, FoundMotion.FAILED]}, [Status.NOT_FINITE]),
    ("branches", {"motion_kind": [FoundMotion.PERIODIC]}, [Status.OK]),
    ("critical", {"trial_failed": [0, 1]}, [Status.NOT_FINITE]),
    ("critical", {"trial_failed": [0, 0]}, [Status.OK]), ("critical", {}, [Status.OK])])
def test_how_stored_studies_ended(kind, stored, expected):
    arrays = {name: np.array(values) for name, values in stored.items()}
    assert STUDIES[kind].part("study").ended(arrays) == expected
