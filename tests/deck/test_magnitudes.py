"""Slips of a unit are warned of by name, plausible gears are not; what a deck leads to is told."""

from pathlib import Path

import pytest

from lapwing.deck import DeckError, load_deck
from lapwing.deck.checks.magnitudes import BANDS, CURVE, magnitudes, outside

INPUTS = Path(__file__).parents[2] / "inputs"
SHIPPED = sorted(INPUTS.glob("*.nml"))
FILE = "file = 'te_25x32.csv'"


@pytest.fixture
def deck_with(tmp_path):
    """The shortest shipped deck with a part of its text replaced, its table beside it."""
    def make(old, new):
        text = (INPUTS / "minimal.nml").read_text(encoding="utf-8")
        assert old in text
        table = (INPUTS / "te_25x32.csv").read_text(encoding="utf-8")
        (tmp_path / "te_25x32.csv").write_text(table, encoding="utf-8")
        (tmp_path / "wide.csv").write_text(
            "phase,transmission_error\n0,-10\n0.25,0\n0.5,10\n0.75,0\n", encoding="utf-8")
        path = tmp_path / "deck.nml"
        path.write_text(text.replace(old, new), encoding="utf-8")
        return load_deck(path)
    return make


@pytest.mark.parametrize(("old", "new", "unit", "place"), [
    ("pinion_base_lever = 0.034", "pinion_base_lever = 34", "mm (0.034 m)", (4, 23)),
    ("pinion_inertia = 0.0078", "pinion_inertia = 7800", "g·cm² (0.00078 kg·m²)", (3, 56)),
    ("mesh_stiffness = 3.12e8", "mesh_stiffness = 3.12e5", "N/mm (3.12e+08 N/m)", (4, 47)),
    ("backlash = 0.002", "backlash = 0.11", "degrees (0.00192 rad)", (4, 66)),
    (FILE, "parabola_amplitude = 0.125", "mrad (0.000125 rad)", (7, 42)),
    (FILE, "file = 'wide.csv'", "µrad (2e-05 rad) or arcsec (9.7e-05 rad)", (7, 28))])
def test_a_slip_of_the_unit_is_one_warning_that_names_it(deck_with, old, new, unit, place):
    warning, = deck_with(old, new).warnings
    assert unit in warning.text and "convert it" in warning.text
    assert (warning.line, warning.column) == place


@pytest.mark.parametrize("path", SHIPPED, ids=lambda path: path.stem)
def test_shipped_decks_are_plausible(path):
    assert load_deck(path).warnings == ()


@pytest.mark.parametrize("band", [*BANDS.values(), CURVE])
def test_a_usual_number_is_never_odd(band):
    low, high = band.usual
    assert band.low < low < high < band.high
    assert not any(outside(value, band) for value in (band.low, low, high, band.high, 0.0))
    assert "outside" in outside(1.01 * band.high, band) and "outside" in outside(
        0.99 * band.low, band)


def test_without_a_likely_unit_none_is_named():
    assert outside(1e14, BANDS["mesh_stiffness"]).endswith(": is the unit right?")


def test_a_curve_wider_than_the_backlash_is_asked_about(deck_with):
    warning, = deck_with(FILE, "parabola_amplitude = 2e-3").warnings
    # 32/25·0.002/0.002
    assert "1.28 times as large as the backlash" in warning.text


@pytest.mark.parametrize(("values", "words"), [
    ("from = 14, to = 1, count = 14", ["from 14 to 1 runs downwards; values are taken in rising"]),
    ("from = 1, to = 14, count = 14", []),
    ("from = -2, to = 3, count = 6", ["2 of 6 braking torques (down to -2) press the teeth on"]),
    ("from = 3, to = -1, count = 5", ["from 3 to -1 runs downwards", "1 of 5 braking torques"])])
def test_what_is_done_with_odd_ranges_is_said(deck_with, values, words):
    deck = deck_with("&response name = 'torque_1.8' /",
                     f"&sweep name = 'a', parameter = 'brake_torque', {values} /")
    assert len(deck.warnings) == len(words)
    assert all(word in one.text for word, one in zip(words, deck.warnings, strict=True))
    assert list(deck.sweeps[0].values) == sorted(deck.sweeps[0].values)


def test_a_negative_torque_is_told_of(deck_with):
    warning, = deck_with("brake_torque = 1.8", "brake_torque = -5").warnings
    assert warning.text.startswith("brake_torque = -5 presses the teeth on the coast flank")
    # What presses is F: a driving torque of its own may turn it.
    assert not deck_with("brake_torque = 1.8", "brake_torque = -5, drive_torque = 20").warnings


def test_a_descending_search_is_told_of(deck_with):
    warning, = deck_with("&response name = 'torque_1.8' /", "&critical name = 'a', find = 'safe', "
                         "from = 14, to = 11, count = 4 /").warnings
    assert "safe_end says from which end the search begins" in warning.text


def test_restitution_is_asked_for_where_it_is_used(deck_with):
    with pytest.raises(DeckError, match="&gear_pair lacks restitution, a number from 0 to 1"):
        deck_with("restitution = 0.8, ", "")
    with pytest.raises(DeckError) as caught:  # one mistake, one message
        deck_with("restitution = 0.8", "restitutoin = 0.8")
    assert len(caught.value.problems) == 1


def test_without_restitution_the_compliant_law_runs(tmp_path):
    text = (INPUTS / "minimal.nml").read_text(encoding="utf-8")
    text = text.replace(FILE, "parabola_amplitude = 125e-6").replace("restitution = 0.8, ", "")
    path = tmp_path / "deck.nml"
    path.write_text(text.replace("impact_law = 'absolute'", "contact_law = 'compliant'"),
                    encoding="utf-8")
    deck = load_deck(path)
    assert deck.warnings == () and deck.oscillator(deck.responses[0]).contact_law == "compliant"


def test_magnitudes_are_told():
    said = magnitudes(load_deck(INPUTS / "lapping_25x32.nml"))
    # 350.1 µrad·32/25/2000 µrad; F per N·m and k'·lever of docs/model.md, section 8.
    assert "350.1 µrad (72.2 arcsec) peak to peak, at the pinion 0.224 of the backlash" in said
    assert "static deflection 2.166 µrad (0.0736 µm at the teeth) per N·m" in said
    assert said.endswith("T_full = 11.92 N·m")
    assert "T_full" not in magnitudes(load_deck(INPUTS / "critical_rigid.nml"))
