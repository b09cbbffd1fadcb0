"""The shards of a map, opened without putting them together."""

import pickle

import numpy as np
import pytest
from test_map import AXES, RECORD, SETTLE, TE

from lapwing import Draw, Status, ensemble, open_study, parameter_map
from lapwing.results import DamagedFile
from lapwing.results.shards import STUDY, discard_shards, shard_path
from lapwing.studies.map import opened
from lapwing_bench.scenes import PAIR


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    folder = tmp_path_factory.mktemp("räder und zähne") / "map_plane"
    # Along the speed, so that the axes are not in the order of the runs.
    return folder, parameter_map(PAIR, TE, AXES, settle=SETTLE, record=RECORD, shard_runs=9,
                                 start="up", line="pinion_speed_rpm", folder=folder)


def test_they_are_the_map(made):
    folder, expected = made
    found = open_study(folder)
    assert found.sizes == expected.sizes and set(found.variables) == set(expected.variables)
    for name, variable in expected.variables.items():
        assert found[name].dtype == variable.dtype and found[name].attrs == variable.attrs
        assert np.array_equal(found[name].values, variable.values,
                              equal_nan=variable.dtype == float)
    for name in ("start", "settle", "record", "shards", "contact_law", "rtol", "interrupted",
                 "x_parameter", "y_parameter"):
        assert found.attrs[name] == expected.attrs[name]
    assert found.attrs["missing_shards"] == 0
    assert found.lapwing.figures() == expected.lapwing.figures() != ()
    assert found.lapwing.map_classes().axes[0].get_ylabel().startswith("braking torque")


@pytest.mark.parametrize("at_once", [1, 7, 2**20])
@pytest.mark.parametrize("key", [
    {"pinion_speed_rpm": 1}, {"brake_torque": slice(None, None, 3)}, {"brake_torque": [4, 0, 4]},
    {"pinion_speed_rpm": 2, "brake_torque": -1}, {"brake_torque": slice(5, 5)},
    {"pinion_speed_rpm": [2, 0], "brake_torque": slice(7, 1, -2)}])
def test_any_part_is_that_part(made, key, at_once, monkeypatch):
    monkeypatch.setattr(opened, "AT_ONCE", at_once)
    monkeypatch.setattr(opened, "HELD", 1)
    folder, expected = made
    found = pickle.loads(pickle.dumps(open_study(folder))).isel(key)
    # Cell by cell a variable of each type is enough: they are read alike.
    names = expected.data_vars if at_once > 33 else ("status", "period", "deepest_separation")
    for name in names:
        assert np.array_equal(found[name].values, expected[name].isel(key).values,
                              equal_nan=expected[name].dtype == float)


def test_only_what_is_asked_for_is_read(made, monkeypatch):
    read, real = [], opened.read_shard
    monkeypatch.setattr(opened, "read_shard", lambda folder, index, *told: (
        read.append(index), real(folder, index, *told))[1])
    found = open_study(made[0])
    assert not read and "brake_torque" in repr(found) and not read
    assert int(found["status"][0, 10]) == Status.OK and read == [3]


def test_what_is_missing_is_unfinished_and_what_is_damaged_is_told(made, tmp_path):
    folder = tmp_path / "some"
    parameter_map(PAIR, TE, AXES, settle=1, record=1, shard_runs=9, folder=folder)
    shard_path(folder, 1).unlink()
    found = open_study(folder)
    assert found.attrs["missing_shards"] == 1 and found.attrs["interrupted"] == 1
    lost = np.zeros(33, dtype=bool)
    lost[9:18] = True
    lost = lost.reshape(3, 11)
    assert np.array_equal(found["status"].values == Status.UNFINISHED, lost)
    assert np.array_equal(np.isnan(found["impacts_per_cycle"].values), lost)
    shard_path(folder, 1).write_bytes(shard_path(folder, 2).read_bytes())
    with pytest.raises(DamagedFile, match=r"shard-00001\.nc is of another place"):
        open_study(folder)["period"].load()
    shard_path(folder, 1).write_bytes(shard_path(made[0], 1).read_bytes())
    with pytest.raises(DamagedFile, match=r"shard-00001\.nc is of another study"):
        open_study(folder)["period"].load()
    (folder / STUDY).write_bytes(b"none")
    with pytest.raises(DamagedFile, match="cannot be read"):
        open_study(folder)
    discard_shards(folder)
    with pytest.raises(FileNotFoundError, match="expected a folder of shards"):
        open_study(folder)
    with pytest.raises(TypeError, match="folder"):
        open_study(3)


def test_what_lies_there_of_another_study_is_written_anew(tmp_path):
    for record in (1, 2):
        parameter_map(PAIR, TE, AXES, settle=1, record=record, shard_runs=11, folder=tmp_path)
        assert open_study(tmp_path).attrs["record"] == record
        assert not np.any(open_study(tmp_path)["status"].values)


@pytest.mark.parametrize("start", ["up", "down"])
def test_chains_are_put_in_place(start, tmp_path):
    expected = parameter_map(PAIR, TE, AXES, settle=1, record=1, shard_runs=4, start=start,
                             folder=tmp_path)
    found = open_study(tmp_path)
    assert found.attrs["shards"] == expected.attrs["shards"] == 9
    for name, variable in expected.data_vars.items():
        assert np.array_equal(found[name].values, variable.values,
                              equal_nan=variable.dtype == float)


def test_the_shards_of_an_ensemble_are_its_runs(tmp_path):
    draws = {"backlash": Draw("uniform", low=1e-3, high=3e-3),
             "brake_torque": Draw("uniform", low=2.0, high=14.0)}
    expected = ensemble(PAIR, TE, draws, runs=32, settle=5, record=5, shard_runs=7,
                        pinion_speed_rpm=1500.0, folder=tmp_path)
    found = open_study(tmp_path)
    assert found.sizes == {"run": 32} and found.attrs["shards"] == 5
    for name in (*draws, "full_engagement", "status", "deepest_separation", "impacts_per_cycle"):
        assert found[name].attrs == expected[name].attrs
        assert np.array_equal(found[name].values, expected[name].values, equal_nan=True)
    shard_path(tmp_path, 1).unlink()
    found = open_study(tmp_path)
    lost = np.arange(32) // 7 == 1
    assert np.array_equal(found["status"].values == Status.UNFINISHED, lost)
    assert np.array_equal(np.isnan(found["full_engagement"].values), lost)
    assert float(found["full_engagement"][3]) == float(expected["full_engagement"][3])
