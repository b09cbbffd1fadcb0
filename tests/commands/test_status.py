"""How far results are, and one run of them once more."""

import json
import os
import shlex
import socket

import numpy as np
import pytest
from typer.testing import CliRunner

from helpers import plane_deck
from lapwing.base.codes import Status
from lapwing.cli import app
from lapwing.commands.rerun import run_again
from lapwing.deck import load_deck
from lapwing.folder import deck_of
from lapwing.results import read_results, stored_studies
from lapwing.results.lock import FolderLock
from lapwing.results.shards import shard_path
from test_cli import write_deck

# So few events a mesh cycle that some runs fail.
FEW = "numerics.max_events_per_cycle=6"


def call(*words):
    done = CliRunner().invoke(app, [*map(str, words)])
    assert done.exception is None or isinstance(done.exception, SystemExit), done.exception
    return done


def state(results):
    done = call("status", results, "--json")
    assert done.exit_code == 0, done.output
    return json.loads(done.stdout)[0]


@pytest.fixture(scope="module")
def deck(tmp_path_factory):
    """4 speeds, 6 torques, 5 shards, of 5 runs but for the last."""
    path = tmp_path_factory.mktemp("deck") / "plane.nml"
    path.write_text(plane_deck(6, 20, 5), encoding="utf-8")
    return path


def run(deck, out, *options):
    return call("run", deck, "--out", out, "--threads", 1, "--figures", "none", *options)


@pytest.fixture(scope="module")
def failing(deck, tmp_path_factory):
    """Its results, complete, with runs that failed."""
    out = tmp_path_factory.mktemp("failing")
    assert run(deck, out, "--set", FEW).exit_code == 1
    return out / "plane"


def statuses(results, kind, name):
    with read_results(results / "result.nc") as opened:
        return stored_studies(opened)[kind, name]


def test_of_complete_results_all_is_known(failing):
    found = state(failing)
    status = statuses(failing, "map", "plane")["status"].values.ravel()
    failed = np.flatnonzero(status != Status.OK)
    assert 0 < failed.size < 24
    study, = found["studies"]
    assert found["state"] == "complete" and not found["at_work"]
    assert (study["runs"], study["done"], study["failed"], study["missing"]) == (
        24, 24 - failed.size, failed.size, 0)
    assert study["failed_runs"] == failed.tolist()
    assert (study["runs_per_second"], study["seconds_left"]) == (None, None)
    assert found["rerun"] == f"lapwing rerun {shlex.quote(str(failing))} map_plane {failed[0]}"


def test_the_command_that_is_printed_repeats_the_run_that_failed(failing, tmp_path):
    text = call("status", failing).stdout
    command = shlex.split(next(line for line in text.splitlines() if "to see one fail" in line)
                          .partition(": ")[2])
    done = call(*command[1:], "--json", "--out", tmp_path / "why")
    assert done.exit_code == 1, done.output
    found = json.loads(done.stdout)
    at = np.unravel_index(found["index"], (4, 6))
    study = statuses(failing, "map", "plane")
    assert found["status"] == Status(study["status"].values[at]).name == "TOO_MANY_EVENTS"
    assert found["place"] == {"pinion_speed_rpm": study["pinion_speed_rpm"].values[at[0]],
                              "brake_torque": study["brake_torque"].values[at[1]]}
    # Seven events in one mesh cycle are one too many, and the last of them is where it ended.
    *_, last = found["last_events"]
    assert len(found["last_events"]) == min(10, found["events"])
    assert (last["tau"], last["phase"]) == (found["tau"], pytest.approx(found["phase"]))
    rows = (tmp_path / "why" / "events.csv").read_text(encoding="utf-8").splitlines()
    assert len(rows) == 1 + found["events"]
    assert sum(row.split(",")[2] == str(last["cycle"]) for row in rows[1:]) == 7
    cycles = (tmp_path / "why" / "cycles.csv").read_text(encoding="utf-8").splitlines()
    assert len(cycles) == 2 + last["cycle"] and cycles[-1].endswith("False")
    said = call(*command[1:], "--last", 1).stdout
    assert "TOO_MANY_EVENTS at tau = " in said and said.count("    tau ") == 1


@pytest.mark.parametrize("start", ["rest", "up", "down"])
def test_every_run_of_a_map_is_repeated_bit_for_bit(deck, tmp_path, start):
    run(deck, tmp_path, "--set", FEW, "--set", f"map.start={start}")
    study = statuses(tmp_path / "plane", "map", "plane")
    made = deck_of(tmp_path / "plane")
    status = study["status"].values.ravel()
    assert {Status.OK, Status.TOO_MANY_EVENTS} == set(status)
    for index in range(24):
        again = run_again(made, "map_plane", index).run
        assert again.status == status[index]
        if again.status == Status.OK:
            cycles = again.cycles.isel(cycle=slice(20, 120))
            for name in ("deepest_separation", "deepest_back_penetration"):
                assert cycles[name].max() == study[name].values.ravel()[index], (index, name)


def test_every_point_of_a_sweep_and_a_response_are_repeated_bit_for_bit(tmp_path):
    path = write_deck(tmp_path, first=0.3, count=6, settle=3, events=40)
    text = path.read_text(encoding="utf-8").replace(
        "record_cycles = 8", "record_cycles = 8, starts = 'up', 'rest', 'down'")
    path.write_text(text, encoding="utf-8")
    assert run(path, tmp_path).exit_code in (0, 1)
    results = tmp_path / "small"
    study, made = statuses(results, "sweep", "torque"), deck_of(results)
    status = study["status"].values.ravel()
    assert set(status) == {Status.OK, Status.TOO_MANY_EVENTS}
    phi = study["phi"].values.reshape(18, 8)
    for index in range(18):
        again = run_again(made, "sweep_torque", index)
        assert again.run.status == status[index]
        assert again.place["start"] == study["start"].values[index // 6]
        if again.run.status == Status.OK:
            assert np.array_equal(again.run.cycles["phi"].values[3:11], phi[index])
    response = statuses(results, "response", "one")
    again = run_again(made, "response_one", 0).run
    assert again.status == response.attrs["status"] == Status.OK
    assert np.array_equal(again.cycles["phi"].values[2:4], response["cycle_phi"].values)


@pytest.mark.parametrize(("words", "said"), [
    (["map_plane", "24"], "map_plane: run 24, expected 0 to 23"),
    (["map_plan", "1"], "expected map_plane"), (["map_plane", "-1"], "-1"),
    (["map_plane", "x"], "INDEX")])
def test_what_is_no_run_is_refused(failing, words, said):
    done = call("rerun", failing, *words)
    assert done.exit_code == 2 and said in done.output


def test_a_map_under_way_is_counted_by_its_shards(deck, tmp_path):
    assert run(deck, tmp_path, "--shard", "1/2", "--set", FEW).exit_code == 0
    results, shards = tmp_path / "plane", tmp_path / "plane.shards" / "map_plane"
    for index in (0, 2, 4):  # three seconds between them
        os.utime(shard_path(shards, index), (1000 + 1.5 * index, 1000 + 1.5 * index))
    found = state(results)
    study, = found["studies"]
    assert (found["state"], found["at_work"]) == ("incomplete", [])
    assert (study["shards"], study["shards_done"]) == (5, 3)
    assert (study["runs"], study["done"] + study["failed"], study["missing"]) == (24, 14, 10)
    assert study["runs_per_second"] == pytest.approx(9 / 6) and study["seconds_left"] is None
    command = shlex.split(found["rerun"])
    assert call(*command[1:]).exit_code == 1
    # Two at work, one of them at a part; a third that is no more.
    with FolderLock(results), FolderLock(tmp_path / "plane.shards" / "part-2-of-2"):
        dead = tmp_path / "plane.shards" / ".part-1-of-9.lock"
        dead.write_text(f"process {2**22 + 1} on {socket.gethostname()}\n", encoding="utf-8")
        found = state(results)
        text = call("status", tmp_path / "plane.shards").stdout
    us = f"process {os.getpid()} on {socket.gethostname()}"
    assert (found["state"], found["at_work"]) == ("running", [us, f"{us}, part 2 of 2"])
    assert found["studies"][0]["seconds_left"] == pytest.approx(10 / 1.5)
    assert f"{results}: running; at work: {us}; {us}, part 2 of 2" in text
    assert "3 of 5 shards; 1.5 runs/s of late, about 6.7 s left" in text
    # Clocks that go backwards, or stand still, give no rate.
    for index in (0, 2, 4):
        os.utime(shard_path(shards, index), (1000, 1000))
    assert state(results)["studies"][0]["runs_per_second"] is None
    # Damaged ones are missing; another deck's count for nothing.
    shard_path(shards, 0).write_bytes(b"")
    assert state(results)["studies"][0]["shards_done"] == 2
    assert run(deck, tmp_path, "--shard", "2/2", "--set", "map.y_to=9.5").exit_code == 0
    assert state(results)["studies"][0]["shards_done"] == 2
    assert run(deck, tmp_path, "--set", FEW).exit_code == 1
    assert state(results)["state"] == "complete"
    assert [path.name for path in tmp_path.iterdir()] == ["plane"]


def test_studies_without_shards_are_done_or_missing(tmp_path):
    path = write_deck(tmp_path)
    assert run(path, tmp_path).exit_code == 0
    found = state(tmp_path / "small")
    assert [(one["study"], one["done"], one["missing"]) for one in found["studies"]] == [
        ("response_one", 1, 0), ("sweep_torque", 6, 0)]
    assert found["rerun"] is None and found["state"] == "complete"
    assert load_deck(path).stem == "small"


def test_nothing_is_no_state(tmp_path):
    (tmp_path / "mine").mkdir()
    for name in ("none", "mine"):
        done = call("status", tmp_path / name)
        assert done.exit_code == 2 and "no results, and no shards" in done.output
    assert call("rerun", tmp_path / "none", "map_plane", 1).exit_code == 2


def test_every_run_of_an_ensemble_is_counted_and_repeated(tmp_path):
    path = tmp_path / "pairs.nml"
    text = plane_deck(6, 20, 5)
    path.write_text(text[:text.index("&map")] + """
&operation pinion_speed_rpm = 1500, brake_torque = 6 /
&draw parameter = 'backlash', law = 'uniform', low = 0.001, high = 0.003 /
&draw parameter = 'brake_torque', law = 'uniform', low = 4, high = 13 /
&ensemble name = 'pairs', runs = 12, sampling = 'random', settle_cycles = 20,
  record_cycles = 100, shard_runs = 5 /
""", encoding="utf-8")
    assert run(path, tmp_path, "--shard", "1/2", "--set", FEW).exit_code == 0
    study, = state(tmp_path / "pairs")["studies"]
    assert (study["study"], study["shards"], study["shards_done"]) == ("ensemble_pairs", 3, 2)
    assert (study["runs"], study["done"] + study["failed"], study["missing"]) == (12, 7, 5)
    done = run(path, tmp_path, "--set", FEW)
    assert done.exit_code in (0, 1), done.output
    found, made = statuses(tmp_path / "pairs", "ensemble", "pairs"), deck_of(tmp_path / "pairs")
    assert Status.TOO_MANY_EVENTS in found["status"] and Status.OK in found["status"]
    for index in range(12):
        again = run_again(made, "ensemble_pairs", index)
        assert again.run.status == found["status"].values[index]
        assert again.place["brake_torque"] == found["brake_torque"].values[index]
        if again.run.status == Status.OK:
            cycles = again.run.cycles.isel(cycle=slice(20, 120))
            assert cycles["deepest_separation"].max() == found["deepest_separation"].values[index]
