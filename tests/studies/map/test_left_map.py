"""A map put together part by part: the file that its numbers in memory give, without them there."""

import sys
import tracemalloc

import numpy as np
import pytest
import xarray as xr
from test_map import AXES, RECORD, SETTLE, TE

from lapwing import Status, parameter_map
from lapwing.engine import Numerics
from lapwing.results import DamagedFile, checksums
from lapwing.results import variables as home
from lapwing.results.shards import discard_shards, shard_path
from lapwing.results.variables import IN_PARTS, write_groups
from lapwing.studies.map import opened
from lapwing.studies.map.run import job_of, left_map
from lapwing_bench.scenes import PAIR

# The axes are not in the order of the runs; some of the runs fail.
ASKED = {"settle": SETTLE, "record": RECORD, "phase": 0.0, "observe": ("rms", "exponent"),
         "line": "pinion_speed_rpm", "numerics": Numerics(rtol=1e-6, max_events_per_cycle=60)}


def left(folder, start, **options):
    return left_map(job_of(PAIR, TE, AXES, start=start, shard_runs=9, **ASKED), folder, **{
        "executor": None, "threads": 2, "progress": None, "notes": None,
        "keep_interrupted": True, **options})


@pytest.mark.parametrize("start", ["rest", "up"])
def test_the_file_is_that_of_the_numbers_in_memory(start, tmp_path, monkeypatch):
    expected = parameter_map(PAIR, TE, AXES, start=start, shard_runs=9, **ASKED)
    assert len({*expected["status"].values.ravel()}) == 2
    write_groups(tmp_path / "whole.nc", {"map_plane": expected})
    found = left(tmp_path / "shards", start)
    assert found.attrs == expected.attrs and list(found.variables) == list(expected.variables)
    assert sum(IN_PARTS in one.encoding for one in found.variables.values()) == 12
    monkeypatch.setattr(home, "row_parts", lambda stored: (
        slice(first, first + 2) for first in range(0, stored.shape[0], 2)))
    write_groups(tmp_path / "parts.nc", {"map_plane": found})
    assert checksums(tmp_path / "parts.nc") == checksums(tmp_path / "whole.nc")
    # A checksum does not depend on the parts, either.
    whole = checksums(tmp_path / "whole.nc")
    monkeypatch.setattr(sys.modules["lapwing.results.checksums"], "row_parts", home.row_parts)
    assert checksums(tmp_path / "whole.nc") == whole


def test_of_what_was_stopped_the_rest_is_told_as_not_known(tmp_path):
    def stop(part):
        if part > 0.4:
            raise KeyboardInterrupt

    left(tmp_path, "up")
    shard_path(tmp_path, 3).unlink()
    found = left(tmp_path, "up", threads=1, progress=stop)
    status = found["status"].transpose("brake_torque", "pinion_speed_rpm").values.ravel()
    assert found.attrs["interrupted"] == 1 and np.all(status[27:] == Status.UNFINISHED)
    shape = found["status"].shape
    write_groups(tmp_path / "result.nc", {"map_plane": found})
    with xr.open_dataset(tmp_path / "result.nc", group="map_plane") as stored:
        lost = stored["status"].values == Status.UNFINISHED
        assert stored["phi_rms"].shape == shape and 0 < lost.sum() < lost.size
        assert np.isnan(stored["phi_rms"].values[lost]).all()
        assert not stored["period"].values[lost].any()


def test_shards_that_are_gone_meanwhile_are_said_to_be(tmp_path):
    found = left(tmp_path, "rest")
    discard_shards(tmp_path)
    assert found["status"].values.size  # known
    with pytest.raises(DamagedFile, match="cannot be read any more"):
        _ = found["period"].values


def test_memory_does_not_grow_with_the_runs(tmp_path, monkeypatch):
    """16 MB of numbers; a piece of storage, of which there is a copy or two, has half a MB."""
    monkeypatch.setattr(home, "PIECE", 2**16)

    class Zeros:
        shape, dtype = (2000, 1000), np.dtype(float)

        def read(self, key):
            return np.zeros([len(range(size)[one]) for one, size in zip(
                key, self.shape, strict=True)])

    large = xr.Variable(("x", "y"), opened._lazy(Zeros()), encoding={IN_PARTS: 0})
    tracemalloc.start()
    try:
        write_groups(tmp_path / "a.nc", {"map_a": xr.Dataset({"large": large})})
        checksums(tmp_path / "a.nc")
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert peak < 4e6
