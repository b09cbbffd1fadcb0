"""Curves that a deck asks for: the ball's last motion ends at a torque as the speed's square."""

import numpy as np
import pytest

from lapwing import plots
from lapwing.base.codes import BranchOutcome, SpecialPoint
from lapwing.deck import DeckError, load_deck
from lapwing.plots.branch.curves import add_curves
from lapwing.report.branches import branches_text
from lapwing.results import read_results
from lapwing.run import run_deck
from lapwing.studies.curve import table
from lapwing.studies.of_deck import compute

TEXT = """
&gear_pair
  pinion_teeth = 25, gear_teeth = 32, pinion_inertia = 0.0078, gear_inertia = 0.026
  pinion_base_lever = 0.034, mesh_stiffness = 3.12e8, backlash = 0.002
  restitution = 0.8, damping_ratio = 0.1
/
&transmission_error harmonic_amplitude = 1e-5 /
&operation pinion_speed_rad_s = 80 /
&scene contact_law = 'rigid', gap = 'one_flank' /
&map
  name = 'plane', x_parameter = 'pinion_speed_rad_s', x_values = 70, 80, 90
  y_values = 0.9, 1.0, settle_cycles = 20, record_cycles = 20
/
&branches
  name = 'torque', values = 0.85, 1.05, random_starts = 12, highest_period = 1, doublings = 0
  second_parameter = 'pinion_speed_rad_s', second_from = 70, second_to = 90
/
"""


@pytest.fixture(scope="module")
def path(tmp_path_factory):
    path = tmp_path_factory.mktemp("curves") / "ball.nml"
    path.write_text(TEXT, encoding="utf-8")
    return path


@pytest.fixture(scope="module")
def results(path):
    outcome = run_deck(load_deck(path), path.parent, threads=1, figures="none")
    with read_results(outcome.folder / "result.nc") as results:
        yield results


def test_the_table_is_stored(results):
    data = results.study("branches", "torque").load()
    assert data["curve_kind"].values.tolist() == [SpecialPoint.FOLD]
    end = float(data["rattling_high"][-1])
    expected = end * (data["curve_second"].values / 80)**2
    assert data["curve_value"].values == pytest.approx(expected, rel=1e-10)
    assert data["curve_value_error"].values.max() < 1e-12
    assert (data["curve_value"].attrs["units"], data["curve_second"].attrs["units"]) \
        == ("N m", "rad/s")
    assert data["meeting_outcome"].values.tolist() == [BranchOutcome.ENDS] * 2
    table = data.lapwing.table("meeting")
    assert set(table["meeting_kind"]) == {"limit"}
    said = " ".join(branches_text(data))
    assert "followed in the pinion speed 70 to 90 rad/s: 1 curve (1 fold)" in said


def test_it_is_drawn_alone_and_over_a_map(results):
    data = results.study("branches", "torque").load()
    figure = plots.figure_of("curves", data, title="ball")
    axis, = figure.axes
    assert axis.get_xlim() == (70, 90) and axis.get_ylim() == (0.85, 1.05)
    assert "fold of branches" in [text.get_text() for text in figure.legends[0].get_texts()]
    alone = plots.figure_of("map_classes", results.study("map", "plane"))
    over = plots.figure_of("map_classes", results.study("map", "plane"), curves=[data])
    # The line and a white one behind it.
    assert len(over.axes[0].lines) == len(alone.axes[0].lines) + 2
    task = next(one for one in plots.tasks_of(results) if one.module == "map.map_classes")
    assert len(plots._options(results, task)["curves"]) == 1
    # A map whose axes are the other way round.
    handles = add_curves(axis, data, "brake_torque")
    assert len(handles) == 1
    assert np.array_equal(axis.lines[-1].get_xdata(), data["curve_value"].values)


def test_what_is_followed_outlives_its_process(path, results, tmp_path, monkeypatch):
    """Curves are kept with the branches; one that cannot be followed is told with its reason."""
    deck, parts = load_deck(path), []

    def run():
        found = compute(deck, 1, lambda *_: parts.append, folder=tmp_path)
        return found.studies["branches"]["torque"]

    followed = table.traced
    monkeypatch.setattr(table, "traced", lambda *_: 1 / 0)
    lost = run()
    assert lost.sizes["curve"] == 0 and lost.attrs["curves_lost"] == 1
    assert "fold at 0.98" in lost.attrs["curves_lost_why"]
    assert "1 could not be followed: fold at 0.98" in " ".join(branches_text(lost))
    monkeypatch.setattr(table, "traced", followed)
    kept = max((tmp_path / "branches_torque").glob("shard-*.nc"))
    kept.unlink()
    first = run()
    monkeypatch.setattr(table, "traced", lambda *_: pytest.fail("followed again"))
    again, whole = run(), results.study("branches", "torque")
    for name in ("curve_value", "curve_second", "curve_value_error", "meeting_kind",
                 "meeting_value"):
        assert np.array_equal(again[name], first[name]) and np.array_equal(again[name], whole[name])
    assert max(parts) <= 1


@pytest.mark.parametrize(("parameter", "value"), [
    ("harmonic_amplitude(1)", 1e-5), ("harmonic_amplitude(2)", 3e-6), ("te_scale", 1.0)])
def test_curves_begin_at_the_own_value(tmp_path, parameter, value):
    """Amplitudes are counted from 1; a scale that is left out is 1."""
    deck = tmp_path / "own.nml"
    text = TEXT.replace("amplitude = 1e-5", "amplitude = 1e-5, 3e-6")
    deck.write_text(text.replace("'pinion_speed_rad_s', second_from = 70, second_to = 90",
                                 f"'{parameter}', second_from = 0, second_to = 1"),
                    encoding="utf-8")
    study, = load_deck(deck).studies["branches"]
    assert study.second["value"] == value


@pytest.mark.parametrize(("old", "new", "message"), [
    ("second_from = 70", "second_from = 85", "expected a range that holds"),
    ("second_parameter = 'pinion_speed_rad_s', ", "", "second_from goes with second_parameter"),
    (", second_to = 90", "", "needs second_from and second_to"),
    ("second_parameter = 'pinion_speed_rad_s'", "second_parameter = 'brake_torque'",
     "is parameter as well"),
    ("second_parameter = 'pinion_speed_rad_s'", "second_parameter = 'speed'", "no real number"),
    ("second_from = 70", "second_from = -70", "expected a number")])
def test_what_is_refused(path, tmp_path, old, new, message):
    assert old in TEXT
    wrong = tmp_path / "wrong.nml"
    wrong.write_text(TEXT.replace(old, new), encoding="utf-8")
    with pytest.raises(DeckError, match=message):
        load_deck(wrong)
