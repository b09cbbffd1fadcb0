"""An ensemble in a deck: the numbers of Python's, in parts, drawn, told, and as a deck again."""

import numpy as np
import pytest

import lapwing
from lapwing import Draw, ensemble, load_deck, run_deck
from lapwing.deck import used_hash
from lapwing.part import run_part
from lapwing.results import checksums, read_results
from lapwing.studies.cost import stages_of

PAIR = """
&gear_pair
  pinion_teeth = 25, gear_teeth = 32
  pinion_inertia = 0.0078, gear_inertia = 0.026
  pinion_base_lever = 0.034, mesh_stiffness = 3.12e8, backlash = 0.002
  restitution = 0.8, damping_ratio = 0.1
/
&transmission_error harmonic_amplitude = 17e-6, 4.5e-6, 1.5e-6, harmonic_shift = 0, 1, 2 /
&operation pinion_speed_rpm = 1500 /
"""
DECK = PAIR + """
&draw parameter = 'backlash', mean = 0.002, deviation = 0.0002, low = 0.001 /
&draw parameter = 'restitution', law = 'uniform', low = 0.7, high = 0.9 /
&ensemble
  name = 'pairs', runs = 32, brake_torque = 9, settle_cycles = 20, record_cycles = 10
  sensitivity_draws = 16, shard_runs = 200
/
"""


@pytest.fixture
def deck(tmp_path):
    path = tmp_path / "pairs.nml"
    path.write_text(DECK, encoding="utf-8")
    return path


def numbers(folder):
    return {name: one for name, one in checksums(folder / "result.nc").items()
            if name.startswith("/ensemble_")}


def test_a_deck_runs_what_python_runs(deck, tmp_path):
    asked = load_deck(deck)
    outcome = run_deck(asked, tmp_path / "a", threads=1, figures="png")
    assert not outcome.undrawn and not outcome.failed
    assert {path.name for path in outcome.folder.glob("*.png")} == {
        "distributions_pairs.png", "tornado_pairs.png"}
    alone = ensemble(
        asked.gear_pair, asked.te, {
            "backlash": Draw("normal", mean=0.002, deviation=0.0002, low=0.001),
            "restitution": Draw("uniform", low=0.7, high=0.9)},
        runs=32, settle=20, record=10, sensitivity_draws=16, brake_torque=9.0,
        pinion_speed_rpm=1500.0)
    with read_results(outcome.folder / "result.nc") as results:
        stored = results.study("ensemble", "pairs")
        for name in alone.variables:
            assert np.array_equal(alone[name], stored[name],
                                  equal_nan=alone[name].dtype.kind == "f"), name
        assert stored["full_engagement_quantile_high"].attrs["units"] == "N m"
    summary = (outcome.folder / "summary.md").read_text(encoding="utf-8")
    assert "**99 % of pairs can keep contact from" in summary
    assert "## Ensemble pairs" in summary and "| part of the variance |" in summary
    # In parts, with other threads: the same bytes, and no shard is left.
    for part in (1, 2):
        run_part(asked, tmp_path / "b", part, 2)
    parts = run_deck(asked, tmp_path / "b", threads=2, figures="none")
    assert numbers(parts.folder) == numbers(outcome.folder)
    assert [path.name for path in (tmp_path / "b").iterdir()] == ["pairs"]
    used = load_deck(outcome.folder / "used.nml")
    assert used_hash(used) == used_hash(asked)


def test_what_decides_nothing_is_no_part_of_the_hash(deck, tmp_path):
    asked = load_deck(deck)
    for key, same in (("shard_runs", True), ("seed", False), ("runs", False)):
        other = load_deck(deck, [(f"ensemble.pairs.{key}", "128")])
        assert (used_hash(other) == used_hash(asked)) == same
    changed = load_deck(deck, [("draw.backlash.deviation", "0.0003")])
    assert used_hash(changed) != used_hash(asked)
    assert "draw.backlash.deviation: 0.0002 -> 0.0003" in lapwing.deck.changed_keys(asked, changed)


def test_a_table_is_run_row_by_row(tmp_path):
    (tmp_path / "my pairs é.csv").write_text("restitution,brake_torque\n0.7,3\n0.9,5\n0.8,14\n",
                                             encoding="utf-8")
    path = tmp_path / "listed.nml"
    path.write_text(PAIR + "&ensemble name = 'rows', table = 'my pairs é.csv', settle_cycles = 5, "
                    "record_cycles = 5 /\n", encoding="utf-8")
    asked = load_deck(path)
    outcome = run_deck(asked, tmp_path / "out", figures="png")
    assert not outcome.undrawn
    with read_results(outcome.folder / "result.nc") as results:
        stored = results.study("ensemble", "rows")
        assert stored["brake_torque"].values.tolist() == [3.0, 5.0, 14.0]
        assert np.isnan(stored["probability_low"]).all()
    summary = (outcome.folder / "summary.md").read_text(encoding="utf-8")
    assert "of the pairs listed can keep contact" in summary
    assert "nothing is said beyond them" in summary
    assert "95 % limits" not in summary.replace("| 95 % limits |", "")
    used = load_deck(outcome.folder / "used.nml")
    assert used_hash(used) == used_hash(asked)
    (tmp_path / "my pairs é.csv").write_text("restitution,brake_torque\n0.7,3\n0.9,5\n0.8,13\n",
                                             encoding="utf-8")
    assert used_hash(load_deck(path)) != used_hash(asked)


def test_the_time_it_takes_is_estimated(deck):
    clock = iter(np.arange(0.0, 1e6, 0.01))
    stage, = stages_of(load_deck(deck), 2, 0.1, lambda: float(next(clock)))
    assert stage.name == "ensemble 'pairs'" and 0 < stage.low <= stage.high and 0 < stage.part <= 1
