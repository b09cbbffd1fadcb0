"""Branches in a deck: the ball's last motion ends in a fold whose torque has a closed form."""

import math
import re

import numpy as np
import pytest

import lapwing
from lapwing.base.codes import FoundFrom, FoundMotion, SpecialPoint
from lapwing.deck import DeckError, load_deck
from lapwing.deck.used import used_hash, used_text
from lapwing.report.answers.findings import findings
from lapwing.report.branches import branches_text, headline
from lapwing.report.branches import findings as branches_findings
from lapwing.results import read_results
from lapwing.run import run_deck

EPS, AMPLITUDE, SPEED = 0.8, 1e-5, 80.0
TEXT = f"""
&gear_pair
  pinion_teeth = 25, gear_teeth = 32, pinion_inertia = 0.0078, gear_inertia = 0.026
  pinion_base_lever = 0.034, mesh_stiffness = 3.12e8, backlash = 0.002
  restitution = {EPS}, damping_ratio = 0.1
/
&transmission_error harmonic_amplitude = {AMPLITUDE} /
&operation pinion_speed_rad_s = {SPEED} /
&scene contact_law = 'rigid', gap = 'one_flank' /
&sweep name = 'torque', parameter = 'brake_torque', values = 0.5, 0.7, settle_cycles = 300 /
&branches
  name = 'torque', values = 0.4, 0.8, 1.2, random_starts = 12, highest_period = 4, doublings = 1
/
"""


@pytest.fixture(scope="module")
def deck(tmp_path_factory):
    path = tmp_path_factory.mktemp("branches") / "ball.nml"
    path.write_text(TEXT, encoding="utf-8")
    return load_deck(path)


@pytest.fixture(scope="module")
def outcome(deck, tmp_path_factory):
    return run_deck(deck, tmp_path_factory.mktemp("out"), threads=1, figures="none")


@pytest.fixture(scope="module")
def diagram(outcome):
    with read_results(outcome.folder / "result.nc") as results:
        yield results.study("branches", "torque").load()


def torques():
    """T_on, and the torque of the fold of the motion with one impact in every mesh cycle."""
    osc = lapwing.GearPair(25, 32, 0.0078, 0.026, 0.034, 3.12e8, 0.002, EPS, damping_ratio=0.1)
    ratio = 25 * SPEED / osc.natural_frequency
    kept = 1.28 * AMPLITUDE * ratio**2 / osc.force_per_torque
    return kept, kept / (math.pi * (1 - EPS) / (1 + EPS))


def test_rattling_ends_in_the_fold(diagram):
    kept, fold = torques()
    assert diagram.attrs["kept"] == pytest.approx(kept, rel=1e-12)
    high = diagram.isel(rattling=-1)
    assert float(high["rattling_high"]) == pytest.approx(fold, rel=1e-12)
    assert int(high["rattling_high_kind"]) == SpecialPoint.FOLD
    assert abs(float(high["rattling_high"]) - fold) <= float(high["rattling_high_error"]) < 1e-11
    number = int(high["rattling_high_branch"])
    mine = diagram["branch"] == number
    assert set(diagram["cycles"].values[mine.values]) == {1}
    # From rest the tooth is engaged above T_on: nothing rattles there that could be raised.
    assert "dies" not in diagram.attrs


def test_every_motion_is_told_of(diagram):
    kind, on = diagram["motion_kind"].values, diagram["motion_branch"].values
    begun = diagram["motion_begun"].values
    assert np.array_equal(on > 0, kind == FoundMotion.PERIODIC)
    assert (diagram["motion_distance"].values[on > 0] < 1e-8).all()
    # Those of the deck's sweep, at values of its own, the study's own three, and random ones.
    values = diagram["motion_value"].values
    assert {0.5, 0.7, 0.4, 0.8, 1.2} <= set(values[begun != FoundFrom.END])
    assert (begun == FoundFrom.RANDOM).sum() == 36
    counts = {name: int(diagram[f"seed_{name}"].sum()) for name in ("motions", "engaged")}
    looked = begun != FoundFrom.END
    assert counts == {"motions": looked.sum(),
                      "engaged": (kind[looked] == FoundMotion.ENGAGED).sum()}


def test_events_are_those_of_the_points(diagram):
    """One impact a cycle: -g' = (PF/2)(1-ε)/(1+ε) at each event of the stable branch."""
    point = int(np.flatnonzero((diagram["stable"] > 0) & (diagram["cycles"] == 1)
                               & (diagram["arrivals"] == 1))[0])
    event = np.flatnonzero(diagram["event_point"].values == point)
    assert event.size == 1
    phase, torque = (float(diagram[name].values[at]) for name, at in
                     (("event_phase", event[0]), ("value", point)))
    kept, _ = torques()
    sine = math.pi * (1 - EPS) / (1 + EPS) * torque / kept
    assert math.sin(2 * math.pi * phase) == pytest.approx(sine, abs=1e-12)


def test_what_is_said(outcome, diagram):
    _, fold = torques()
    text = (outcome.folder / "summary.md").read_text(encoding="utf-8")
    digits = f"{math.floor(fold * 1e10) / 1e10:.10f}"
    answer = f"**Rattling ends at T_safe = {digits}"
    assert text.count(answer) == 2  # in the findings, and first in the section
    assert text.index("## Branches torque") < text.rindex(answer) < text.index("motions looked at")
    assert "a fold: a stable motion meets an unstable one" in text
    assert "none was carried up to it" in text
    assert "(3/12)" in text and "(3/36)" in text
    head, = [line for line in outcome.headlines if "rattling ends" in line]
    assert f"rattling ends at {digits}" in head


def test_rattling_does_not_end_with_the_values(diagram):
    cut = diagram.copy(deep=True)
    cut["rattling_high_kind"].values[-1] = SpecialPoint.LIMIT
    assert "; rattling reaches " in headline(cut) and "rattling ends" not in headline(cut)


def test_nothing_is_said_of_values_that_were_not_looked_at(diagram):
    """Where contact can be kept below the lowest value, the values bound what is known."""
    kept = diagram.attrs["kept"]
    none = diagram.isel(rattling=slice(0, 0)).assign_attrs(low=kept / 2)
    assert f"No rattling above {kept:.10g} N·m" in branches_findings(none)[0]
    assert "above T_full" in headline(none)
    above = none.assign_attrs(low=2 * kept, high=3 * kept)
    assert f"No rattling from {2 * kept:.10g} to {3 * kept:.10g} N·m" in branches_findings(above)[0]
    assert "no rattling was found there" in headline(above)


def test_starts_that_failed_bound_no_share(diagram):
    lost = diagram.copy(deep=True)
    random = np.flatnonzero(lost["motion_begun"].values == FoundFrom.RANDOM)
    lost["motion_kind"].values[random[:4]] = FoundMotion.FAILED
    text = "\n".join(branches_text(lost))
    assert "at most 0.38 at any one value (3/8)" in text and "(3/32)" in text
    lost["motion_kind"].values[random[:10]] = FoundMotion.FAILED
    assert "the share of starts that lead to it is at most 0.12 if it" in "\n".join(
        branches_text(lost))
    lost["motion_kind"].values[random] = FoundMotion.FAILED
    del lost.attrs["kept"]
    motions, on = (int(one.sum()) for one in (lost["motion_kind"] != FoundMotion.FAILED,
                                              lost["motion_branch"] > 0))
    told = branches_findings(lost)[0]
    assert "of periodic motions** along the braking torque 0.4 to 1.2 N·m" in told
    assert f"of {motions + 36} motions looked at" in told and told.endswith(", 36 failed.")
    assert on >= int(told.split(" looked at ")[1].split()[0])
    lost["motion_kind"].values[:] = FoundMotion.FAILED
    assert branches_findings(lost) == []
    assert "too few random starts" in "\n".join(branches_text(lost))


def test_the_figure_has_the_sweep_behind_it(diagram, outcome):
    with read_results(outcome.folder / "result.nc") as results:
        swept = results.sweep("torque").load()
    section = lapwing.plots.figure_of("bifurcation", diagram, sweeps=[swept]).axes[0]
    words = [text.get_text() for text in section.get_legend().get_texts()]
    assert {"rattling ends", "fold"} <= set(words)
    # Below the range, and not known.
    assert not {"contact can be kept", "raised rattling dies"} & set(words)
    grey = [line for line in section.lines if line.get_color() == "0.55"]
    assert len(grey) == 1 and set(grey[0].get_xdata()) == {0.5, 0.7}
    assert section.get_title(loc="left").endswith("dots: the sweep")


def test_the_deck_as_used_is_the_same_deck(deck, tmp_path):
    path = tmp_path / "used.nml"
    path.write_text(used_text(deck, tmp_path), encoding="utf-8")
    assert used_hash(load_deck(path)) == used_hash(deck)


def test_a_branch_needs_two_values(tmp_path):
    path = tmp_path / "one.nml"
    for old, new, words in (
            ("values = 0.4, 0.8, 1.2", "values = 0.4", "expected two or more"),
            ("values = 0.4, 0.8, 1.2,", "", "lacks one of values, from"),
            ("highest_period = 4", "highest_period = 25", "highest_period")):
        path.write_text(TEXT.replace(old, new), encoding="utf-8")
        with pytest.raises(DeckError, match=words):
            load_deck(path)


def test_what_is_finished_outlives_an_interrupt(deck, diagram, tmp_path, monkeypatch):
    """The branches that were followed are read, not followed again; the same numbers in the end."""
    from lapwing.studies.branch import family
    from lapwing.studies.of_deck import compute

    whole, followed = family.branch, []

    def stopped_at(number):
        def branch(*args, **options):
            followed.append((args[0].cycles, options["value"]))
            if len(followed) == number:
                raise KeyboardInterrupt
            return whole(*args, **options)
        return branch

    def run():
        notes = []
        found = compute(deck, 1, lambda *_: lambda _: None, folder=tmp_path, notes=notes.append,
                        executor=None)
        return found, notes

    monkeypatch.setattr(family, "branch", stopped_at(2))
    stopped, _ = run()
    assert stopped.interrupted and not stopped.studies["branches"]
    assert len(list((tmp_path / "branches_torque").glob("shard-*.nc"))) == 1
    monkeypatch.setattr(family, "branch", stopped_at(0))
    first, followed[:] = list(followed), []
    again, notes = run()
    assert not notes and followed[0] == first[1] and first[0] not in followed
    found = again.studies["branches"]["torque"]
    for name, variable in diagram.data_vars.items():
        assert np.array_equal(variable.values, found[name].values, equal_nan=True), name
    # One that is damaged is followed again, and that is said.
    path = min((tmp_path / "branches_torque").glob("shard-*.nc"))
    path.write_bytes(path.read_bytes()[:-100])
    followed.clear()
    again, notes = run()
    assert followed == first[:1] and len(notes) == 1 and "branch 0" in notes[0]


def test_the_torque_to_choose_lies_above_every_branch(outcome, diagram):
    """The sweep saw no rattling at its two torques; the branches go on to the fold."""
    _, fold = torques()
    with read_results(outcome.folder / "result.nc") as results:
        sweep = results.study("sweep", "torque").load()
    choice = findings([], [], [sweep], diagrams=[diagram])[0]
    number = float(re.match(r"\*\*Choose at least (\S+) N·m", choice)[1])
    assert fold <= number < 1.001 * fold and "last branch of rattling" in choice
    open_ = diagram.assign(rattling_high_kind=diagram["rattling_high_kind"].copy(
        data=np.full(diagram["rattling_high_kind"].shape, SpecialPoint.LIMIT)))
    assert findings([], [], [sweep], diagrams=[open_])[0].startswith("**Choose more than ")
