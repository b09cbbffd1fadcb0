"""Basins: cells, shards, entropy."""

import math
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from helpers import dataset_bytes, scene_a, scene_c
from lapwing import Ending, Status, attractors, basins
from lapwing.results.shards import shard_path
from lapwing.studies.attractors.basins import entropy

SMALL = {"size": (30, 20), "threads": 1}


@pytest.fixture(scope="module")
def whole():
    """Scene A at 12 N·m: contact beside rattling, 600 cells."""
    return basins(scene_a(12.0), **SMALL)


def numbers(dataset):
    """Every number but texts, which are objects."""
    return {name: one for name, one in dataset_bytes(dataset).items() if one[0] != "|O"}


def test_a_cell_leads_where_its_middle_leads(whole):
    osc = scene_a(12.0)
    assert whole.attractor_of_run.dims == ("start_phi", "start_phi_dot")
    phi, phi_dot = np.meshgrid(whole.start_phi.values, whole.start_phi_dot.values, indexing="ij")
    same = attractors(osc, np.column_stack([phi.ravel(), phi_dot.ravel()]), threads=1)
    assert np.array_equal(same.attractor_of_run, whole.attractor_of_run.values.ravel())
    assert np.array_equal(same.point_phi, whole.point_phi)
    assert set(np.unique(whole.attractor_of_run)) == {1, 2}
    assert np.all(whole.ending == Ending.CERTAIN)
    assert whole.share.values == pytest.approx(
        [np.mean(whole.attractor_of_run.values == n) for n in (1, 2)])
    assert np.all(np.isnan(whole.share_low)) and np.all(np.isnan(whole.share_high))


@pytest.mark.parametrize(("plane", "way"), [("drive", 1), ("coast", -1)])
def test_arrivals_at_a_flank(plane, way):
    """Phase and speed at the flank are starts at the flank, towards it."""
    osc = scene_c(1.8)
    found = basins(osc, plane, size=12, speed=(0.0, 1e-4), threads=1)
    assert found.attractor_of_run.dims == ("start_phase", "start_speed")
    phase, speed = np.meshgrid(found.start_phase.values, found.start_speed.values, indexing="ij")
    at = np.full(144, 0.0 if plane == "drive" else -osc.gap_width)
    same = attractors(osc, np.column_stack([at, way * speed.ravel(), phase.ravel()]), threads=1)
    assert np.array_equal(same.attractor_of_run, found.attractor_of_run.values.ravel())
    assert found.attractor.size > 1


def test_no_byte_depends_on_threads_or_shards_or_where_it_went_on(whole, tmp_path):
    osc = scene_a(12.0)
    expected = numbers(whole)
    assert whole.shards == 60  # ten cells each: at least 64 shards, but for rounding
    assert numbers(basins(osc, **SMALL | {"threads": 3})) == expected
    notes = []
    folder = tmp_path / "shards"
    cut = basins(osc, **SMALL, shard_runs=77, folder=folder)
    assert (numbers(cut), cut.shards) == (expected, 8)
    shard_path(folder, 3).unlink()
    with ThreadPoolExecutor(2) as pool:
        again = basins(osc, **SMALL, shard_runs=77, folder=folder, executor=pool,
                       notes=notes.append)
    assert numbers(again) == expected and not notes
    # Of another size, or another rule, nothing there is taken.
    basins(osc, **SMALL, shard_runs=77, folder=folder, returns=29, notes=notes.append)
    assert len(notes) == 8


def test_what_was_not_reached_is_said():
    def stop(fraction):
        if fraction > 0.3:
            raise KeyboardInterrupt

    part = basins(scene_a(12.0), **SMALL, progress=stop, keep_interrupted=True)
    left = part.status == Status.UNFINISHED
    assert part.interrupted == 1 and 0 < part.not_reached == int(left.sum()) < 600
    assert np.all(part.attractor_of_run.values[left.values] == 0)
    assert part.unresolved == 0
    assert float(part.share.sum()) == pytest.approx(1.0)
    with pytest.raises(KeyboardInterrupt):
        basins(scene_a(12.0), **SMALL, progress=stop)


def test_cells_that_are_not_resolved_are_counted():
    """So few mesh cycles that the starts looked at are known, the others are not."""
    short = basins(scene_c(1.8), size=40, most_cycles=5, threads=1)
    open_ = int((short.attractor_of_run == 0).sum())
    assert short.unresolved == open_ > 500
    assert short.boxes_left_out > 0
    assert np.all(short.ending.values[short.attractor_of_run.values == 0] == Ending.UNKNOWN)


def test_entropy_is_that_of_the_definition():
    one = entropy(np.ones((20, 20), np.int16))
    assert (one["basin_entropy"], one["boxes"], one["boundary_boxes"]) == (0.0, 16, 0)
    assert math.isnan(one["boundary_entropy"])
    # Every box of the second column of boxes has 10 of its 25 cells in the other basin.
    halves = np.ones((20, 20), np.int16)
    halves[:, 8:] = 2
    own = -(0.4 * math.log(0.4) + 0.6 * math.log(0.6))
    told = entropy(halves)
    assert told["boundary_entropy"] == pytest.approx(own)
    assert told["basin_entropy"] == pytest.approx(own / 4)
    # Three basins that change from cell to cell are at ln 3 but for 25 = 8 + 8 + 9.
    mixed = entropy((np.add.outer(np.arange(20), np.arange(20)) % 3 + 1).astype(np.int16))
    assert mixed["boundary_entropy"] == pytest.approx(math.log(3), abs=0.01)
    # A box with a cell that is not known tells nothing; what fills no box is left out.
    halves[0, 0] = 0
    assert (entropy(halves[:18])["boxes"], entropy(halves[:18])["boxes_left_out"]) == (11, 1)
    assert math.isnan(entropy(np.zeros((5, 5), np.int16))["basin_entropy"])


def test_what_is_refused():
    osc = scene_a(12.0)
    for given, message in (
            ({"plane": "x", "size": 0, "phase": 1.0}, "plane.*phase.*size"),
            ({"size": (3, 4, 5)}, r"size = \(3, 4, 5\)"),
            ({"speed": (0, 1)}, "speed goes with another plane"),
            ({"plane": "drive", "phi": (0, 1)}, "phi goes with another plane"),
            ({"plane": "drive", "speed": (-1, 1)}, "from 0"),
            ({"shard_runs": 0, "most_cycles": 0}, "shard_runs.*most_cycles"),
            ({"executor": 3}, "executor wants a folder")):
        with pytest.raises(ValueError, match=message):
            basins(osc, **given)
    with pytest.raises(ValueError, match="one_flank"):
        basins(scene_a(12.0, gap="one_flank"), "coast")
    with pytest.raises(ValueError, match="lets no tooth"):
        basins(scene_a(12.0, "relative", contact_law="rigid"), phi=(-1e-4, 1e-4))
