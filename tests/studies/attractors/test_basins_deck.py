"""Basins in a deck: the numbers of Python's, in parts, once more, in words and drawn."""

import re

import numpy as np
import pytest

from helpers import scene_a
from lapwing import Status, basins, load_deck, run_deck
from lapwing.commands.rerun import run_again
from lapwing.commands.status import state_of
from lapwing.part import run_part
from lapwing.plots import figure_of
from lapwing.plots.attractors.basins import shows
from lapwing.report.attractors.basins import basins_text, findings, headline, rattling_torques
from lapwing.report.attractors.words import choice
from lapwing.results import checksums, read_results
from lapwing.studies.cost import stages_of

DECK = """
&gear_pair
  pinion_teeth = 25, gear_teeth = 32, pinion_inertia = 0.0078, gear_inertia = 0.026
  pinion_base_lever = 0.034, mesh_stiffness = 3.12e8, backlash = 0.002
  restitution = 0.8, damping_ratio = 0.1
/
&transmission_error harmonic_amplitude = 17e-6, 4.5e-6, 1.5e-6, harmonic_shift = 0, 1, 2 /
&operation pinion_speed_rpm = 1500, brake_torque = 1.8 /
&basins name = 'starts', x_count = 30, y_count = 20, shard_runs = 100 /
"""


@pytest.fixture(scope="module")
def deck(tmp_path_factory):
    path = tmp_path_factory.mktemp("basins") / "one.nml"
    path.write_text(DECK, encoding="utf-8")
    return load_deck(path)


@pytest.fixture(scope="module")
def folder(deck):
    outcome = run_deck(deck, deck.path.parent / "whole", threads=1, figures="none")
    assert not outcome.failed
    return outcome.folder


@pytest.fixture(scope="module")
def plane():
    """Scene A at 12.4 N·m: contact beside rattling of period 2."""
    return basins(scene_a(12.4), size=40, phi=(-3e-4, 1e-4), phi_dot=(-1e-4, 1e-4),
                  threads=1).assign_attrs(name="one")


def numbers(result):
    return {name: one for name, one in checksums(result).items() if name.startswith("/basins_")}


def test_a_deck_runs_what_python_runs(deck, folder):
    (study,) = deck.studies["basins"]
    alone = basins(deck.oscillator(study), size=(30, 20), threads=1)
    with read_results(folder / "result.nc") as results:
        stored = results.study("basins", "starts")
        for name in ("attractor_of_run", "status", "followed_cycles", "period", "share",
                     "point_phi", "start_phi", "start_phi_dot"):
            assert np.array_equal(alone[name], stored[name], equal_nan=True), name
        assert list(alone.motion_class.values) == list(stored.motion_class.values)
        assert stored.attrs["boundary_entropy"] == alone.boundary_entropy
    summary = (folder / "summary.md").read_text(encoding="utf-8")
    assert "**At 1.8 N·m the start decides between 3 motions**: " in summary
    assert " of 600 starts with φ " in summary
    assert "## Basins starts" in summary


def test_parts_give_the_same_bytes(deck, folder):
    out = deck.path.parent / "parts"
    for part in (2, 1):
        run_part(deck, out, part, 2, threads=1)
    state = state_of(out / "one")
    (study,) = state.studies
    assert (study.runs, study.missing, study.shards_done) == (600, 0, 6)
    run_deck(deck, out, threads=1, figures="none")
    assert numbers(out / "one" / "result.nc") == numbers(folder / "result.nc")


def test_one_cell_once_more_ends_where_it_ended(deck, folder):
    with read_results(folder / "result.nc") as results:
        stored = results.study("basins", "starts").load()
    index = 137
    x, y = np.unravel_index(index, (30, 20))
    again = run_again(deck, "basins_starts", index)
    assert again.place == {"start_phi": stored.start_phi.values[x],
                           "start_phi_dot": stored.start_phi_dot.values[y]}
    cycles = int(stored.followed_cycles.values[x, y])
    row = again.run.cycles.isel(cycle=cycles)
    motion = stored.sel(attractor=stored.attractor_of_run.values[x, y])
    near = np.hypot(motion.point_phi - float(row.phi), motion.point_phi_dot - float(row.phi_dot))
    assert float(near.min()) < 0.02 * float(motion.deepest_separation)


def test_how_long_it_takes_is_tried(deck):
    (stage,) = stages_of(deck, 0.2, 1)
    assert 0 < stage.low <= stage.high < 60


def test_words(plane):
    text = "\n".join(basins_text(plane))
    assert "none of 1600 failed, none not resolved" in text
    assert "| 1 | 1:(0,0) | 0 | 0 |" in text and "| 2 | 2:(23,0) | 11.5 |" in text
    assert "95 % limits" not in text  # of a grid there are none
    assert headline(plane) == "2 attractors in 1600 cells"
    (sentence,) = findings(plane)
    assert re.match(r"\*\*At 12\.4 N·m the start decides between 2 motions\*\*: 83\.1 % of 1600 "
                    r"starts with φ -?[\d.]+ to -?[\d.]+ µrad and dφ/dτ -?[\d.]+ to -?[\d.]+ µrad "
                    r"end in lasting contact; 16\.9 % in rattling of period 2", sentence)
    assert "of other starts the shares are others" in sentence and "not known" not in sentence
    ends = [float(one) for one in re.findall(r"(-?[\d.]+) (?:to|µrad)", sentence)[:4]]
    inside = [1e6 * plane[name].values[end] for name in ("start_phi", "start_phi_dot")
              for end in (0, -1)]
    assert ends[0] < inside[0] < inside[1] < ends[1] and ends[2] < inside[2] < inside[3] < ends[3]


def test_words_where_something_is_missing(plane):
    part = plane.copy(deep=True)
    part["status"].values[:, :10] = Status.UNFINISHED
    part["attractor_of_run"].values[:, :12] = 0
    part.attrs |= {"not_reached": 400, "unresolved": 80, "boundary_boxes": 0, "boxes_left_out": 9}
    text = "\n".join(basins_text(part))
    assert "none of 1200 failed, 80 not resolved, **400 not reached**" in text
    assert "of 1120 cells whose end is known" in text
    assert "no boundary in 64 boxes" in text and "9 boxes with an end that is not known" in text
    assert headline(part) == "2 attractors in 1600 cells; 80 not resolved; 400 not reached"
    assert findings(part)[0].endswith("Of 480 the end is not known.")
    part["attractor_of_run"].values[:] = 0
    part = part.isel(attractor=slice(0, 0)).assign_attrs(boxes=0)
    assert findings(part) == [] and not shows(part)
    assert basins_text(part)[-1] == "- no motion was recognised: nothing is known"
    one = plane.copy(deep=True)
    one["runs_ended"].values[:] = [1600, 0]
    assert "all starts lead to one motion" in findings(one)[0]
    one["attractor_of_run"].values[0, 0] = 0
    assert "all starts whose end is known lead to one motion" in findings(one)[0]


def test_of_many_motions_some_are_told(plane):
    many = plane.isel(attractor=[0] + [1] * 7).assign_attrs(restitution=1.0).copy(deep=True)
    many["share"].values[:] = [0.02, 0.3, 0.2, 0.01, 0.1, 0.07, 0.14, 0.16]
    (sentence,) = findings(many)
    assert "the start decides between 8 motions" in sentence
    assert all(f"{share} % " in sentence for share in (30, 20, 14, 16))
    assert "10 % in 3 others; of other starts" in sentence and "each is one of many" in sentence
    many["attractor_of_run"].values[0, 0] = 0
    assert "the start decides between at least 8 motions" in findings(many)[0]


def test_the_torque_at_which_starts_rattle_is_not_enough(plane):
    higher = plane.assign_attrs(brake_torque=13.0).copy(deep=True)
    said, = choice(rattling_torques([plane, higher]))
    assert "keeps contact**; 13 N·m on the gear surely does not" in said
    higher["runs_ended"].values[:] = [1600, 0]  # all in lasting contact
    said, = choice(rattling_torques([plane, higher]))
    assert "keeps contact**; 12.4 N·m on the gear surely does not" in said
    assert choice(rattling_torques([higher])) == choice([]) == []


def test_figure(plane):
    """Every cell in the colour of its attractor; what is not resolved, in black; the points."""
    part = plane.copy(deep=True)
    part["attractor_of_run"].values[0, :5] = 0
    part["status"].values[1, :7] = Status.UNFINISHED
    part.attrs |= {"unresolved": 5, "not_reached": 7}
    figure = figure_of("basins", part)
    (axis,) = figure.axes
    image = axis.images[0].get_array()
    assert image.shape[:2] == (40, 40)
    shades, labels = image[..., :3].reshape(-1, 3), part.attractor_of_run.values.T.ravel()
    reached = part.status.values.T.ravel() != Status.UNFINISHED
    seen = {tuple(map(int, shade)): set(labels[reached & np.all(shades == shade, axis=1)])
            for shade in np.unique(shades[reached], axis=0)}
    assert sorted(map(sorted, seen.values())) == [[0], [1], [2]] and seen[0, 0, 0] == {0}
    words = [text.get_text() for text in figure.legends[0].get_texts()]
    assert words[0].startswith("contact kept: ")
    assert words[1].startswith("period 2, 11.5 impacts a cycle, 171 µrad deep: ")
    assert words[2:] == ["5 cells not resolved", "7 cells not reached",
                         "a motion's states at mesh phase 0, one for each cycle of its period"]
    drawn = np.concatenate([line.get_xydata() for line in axis.lines[1:]])
    points = np.column_stack([part.point_phi.values.ravel(), part.point_phi_dot.values.ravel()])
    assert np.array_equal(drawn, points[np.isfinite(points[:, 0])])
    # In another plane than that of mesh phase 0 the points are not drawn.
    other = figure_of("basins", part.assign_attrs(phase=0.5))
    assert len(other.axes[0].lines) == 1
