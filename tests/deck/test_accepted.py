"""Accepted decks: what they mean, also according to f90nml."""

from pathlib import Path

import f90nml
import numpy as np
import pytest

from lapwing import GearPair
from lapwing.deck import DeckError, load_deck
from lapwing.deck.schema import GROUPS, REPEATED

HERE = Path(__file__).parent
INPUTS = HERE.parents[1] / "inputs"
DECKS = [*sorted((HERE / "accepted").glob("*.nml")), *sorted(INPUTS.glob("*.nml"))]
PLAIN = HERE / "accepted" / "plain.nml"


@pytest.mark.parametrize("path", DECKS, ids=lambda path: path.stem)
def test_f90nml_reads_the_same(path):
    deck = load_deck(path)
    oracle = f90nml.reads(path.read_text(encoding="utf-8-sig"))
    for group in GROUPS:
        theirs = oracle.get(group, [] if group in REPEATED else {})
        ours = deck.settings[group]
        if group not in REPEATED:
            ours, theirs = [ours], [theirs]
        elif not isinstance(theirs, list):
            theirs = [theirs]
        assert len(ours) == len(theirs)
        for mine, other in zip(ours, theirs, strict=True):
            given = mine.model_dump(by_alias=True, exclude_unset=True)
            assert given.keys() == other.keys()
            for key, value in given.items():
                expected = other[key]
                if isinstance(value, list) and not isinstance(expected, list):
                    expected = [expected]
                assert value == expected, key


def test_ready_objects():
    deck = load_deck(INPUTS / "lapping_25x32.nml")
    assert deck.stem == "lapping_25x32"
    assert deck.gear_pair == GearPair(25, 32, 0.0078, 0.026, 0.034, 3.12e8, 0.002, 0.8, 0.1)
    assert deck.te.peak_to_peak == pytest.approx(350e-6, rel=0.02)
    assert [r.name for r in deck.responses] == [
        "torque_0.8", "torque_1.8", "torque_3.3", "torque_5.5", "torque_12"]
    response = deck.responses[1]
    assert (response.claim_impacts_per_cycle, response.claim_deepest_separation) == (3, 0.00063)
    assert (response.rtol, deck.sweeps[0].rtol) == (1e-8, 1e-6)
    oscillator = deck.oscillator(response)
    assert oscillator.force == pytest.approx(2.166096e-6 * 1.8, rel=1e-6)
    assert oscillator.impact_law == "absolute"
    sweep = deck.sweeps[0]
    assert sweep.parameter == "brake_torque" and "brake_torque" not in sweep.operation
    # The decimal fractions themselves, not what adding a step leads to.
    assert sweep.values.tolist() == [round(0.2 + 0.02 * i, 2) for i in range(691)]


def test_critical_values():
    deck = load_deck(HERE / "accepted" / "critical.nml")
    full, faster, speed, safe, back = deck.criticals
    assert (full.find, full.parameter, full.values, full.starts) == ("full", "brake_torque", None,
                                                                    None)
    assert "brake_torque" not in full.operation and not full.own_operation
    # A speed of its own replaces that of &operation, however it is spelled.
    assert faster.operation["pinion_speed_rpm"] == 900 and faster.own_operation
    assert "pinion_speed_rad_s" not in faster.operation
    assert speed.values.tolist() == list(range(10, 201, 10)) and speed.safe_end == "low"
    assert speed.operation["brake_torque"] == 12
    assert safe.values.tolist() == [4, 6, 8, 9, 10, 11, 12] and safe.resolution == 0.2
    assert safe.starts == (2, 3, 2) and (safe.settle_cycles, safe.record_cycles) == (20, 20)
    assert back.starts == (2, 2, 2) and back.record_cycles == 1200
    assert (back.rtol, back.confidence) == (1e-7, 0.9)


def test_odd_spellings():
    deck = load_deck(HERE / "accepted" / "harmonics.nml")
    assert deck.numerics["rtol"] == deck.responses[0].rtol == deck.sweeps[0].rtol == 1e-9
    assert deck.responses[0].start == ("separation", -1e-4, 0.0)
    assert deck.responses[0].claim_text == "it's \"so\" / & not # ! otherwise"
    assert "mesh_frequency_hz" not in deck.responses[1].operation
    assert deck.responses[1].operation["pinion_speed_rpm"] == 300
    expected = np.union1d(np.arange(10, 21) / 20, (5 + 1.5 * np.arange(11)) / 10)
    np.testing.assert_allclose(deck.sweeps[0].values, expected, rtol=1e-15)
    assert not deck.sweeps[0].impacts and deck.sweeps[0].starts == ("rest", "up")


def test_byte_order_mark_and_line_ends_change_nothing(tmp_path):
    plain = load_deck(PLAIN)
    text = PLAIN.read_text(encoding="utf-8")
    for number, data in enumerate([
            (HERE / "accepted" / "windows.nml").read_bytes(), text.encode("utf-16"),
            text.replace("\n", "\r").encode(), text.replace(" ", "\t").encode()]):
        path = tmp_path / f"{number}.nml"
        path.write_bytes(data)
        assert load_deck(path).settings == plain.settings


def changed(tmp_path, old, new, base=PLAIN):
    path = tmp_path / "deck.nml"
    path.write_text(base.read_text(encoding="utf-8").replace(old, new), encoding="utf-8")
    return load_deck(path)


@pytest.mark.parametrize(("values", "pairs"), [
    ("0,5 1,8", ["0.5", "1.8"]), ("1,5", ["1.5"]), ("1, 5", []), ("1,2,5", []), ("0.5,1", []),
    ("1.5,2.5", []),
    ("1,500", ["1500"]), ("0,500", ["0.500"])])
def test_decimal_comma_in_a_list_is_a_warning(tmp_path, values, pairs):
    study = f"&sweep name = 'a', parameter = 'brake_torque', values = {values} /"
    deck = changed(tmp_path, "&response name = 'a' /", study)
    assert [w.text.rpartition(" ")[2] for w in deck.warnings] == pairs
    assert all(w.warning and ": warning: " in str(w) for w in deck.warnings)


PAIRS = "pinion_angle[deg],gear_angle[deg]\n0,0\n3.6,2.813\n7.2,5.626\n10.8,8.438\n14.4,11.25\n"


@pytest.mark.parametrize(("sign", "warned"), [
    ("", "not given"), (", te_sign = 'printed'", "is 'printed'"), (", te_sign = 'geometric'", "")])
def test_angle_pairs_state_their_sign(tmp_path, sign, warned):
    (tmp_path / "pairs.csv").write_text(PAIRS)
    deck = changed(tmp_path, "parabola_amplitude = 125e-6", f"file = 'pairs.csv'{sign}")
    assert deck.te.te_sign_hint == "geometric"
    assert [warned in w.text for w in deck.warnings] == [True] * bool(warned)


def test_overrides(tmp_path):
    deck = load_deck(PLAIN, [("operation.brake_torque", "2d0"), ("scene.impact_law", "absolute"),
                             ("response.a.settle_cycles", "10"), ("response.rtol", "1e-9")])
    response = deck.responses[0]
    assert (response.operation["brake_torque"], response.operation["impact_law"]) == \
        (2, "absolute")
    assert (response.settle_cycles, response.rtol) == (10, 1e-9)
    single = load_deck(PLAIN, ("operation.brake_torque", "2d0"))
    assert single.overrides == (("operation.brake_torque", "2d0"),)


def test_log_ranges_and_lists(tmp_path):
    study = ("&sweep name = 'a', parameter = 'restitution', from = 0.01, to = 1, count = 3, "
             "spacing = 'log' /\n&sweep name = 'b', parameter = 'backlash', values = 3e-3 1e-3 /")
    deck = changed(tmp_path, "&response name = 'a' /", study)
    np.testing.assert_allclose(deck.sweeps[0].values, [0.01, 0.1, 1], rtol=1e-15)
    assert deck.sweeps[1].values.tolist() == [1e-3, 3e-3]
    assert deck.sweeps[1].group == "gear_pair"


def test_the_transmission_error_is_varied_by_its_scale_or_its_amplitude(tmp_path):
    path = tmp_path / "deck.nml"
    path.write_text("""
&gear_pair
  pinion_teeth = 25, gear_teeth = 32, pinion_inertia = 0.0078, gear_inertia = 0.026
  pinion_base_lever = 0.034, mesh_stiffness = 3.12e8, backlash = 0.002
  restitution = 0.8, damping_ratio = 0.1
/
&transmission_error parabola_amplitude = 1e-4 /
&operation brake_torque = 3, pinion_speed_rpm = 480, te_scale = 0.5 /
&sweep name = 's', parameter = 'transmission_error.scale', values = 0.5, 1, 2 /
&map name = 'm', x_parameter = 'parabola_amplitude', x_values = 5e-5, 2e-4, y_values = 1, 3 /
""", encoding="utf-8")
    deck = load_deck(path)
    (swept,), (mapped,) = deck.studies["sweep"], deck.studies["map"]
    assert (swept.parameter, swept.group) == ("te_scale", "operation")
    assert "te_scale" not in swept.operation and mapped.operation["te_scale"] == 0.5
    assert set(mapped.axes) == {"parabola_amplitude", "brake_torque"}
    text = path.read_text(encoding="utf-8").replace("parabola_amplitude = 1e-4",
                                                    "harmonic_amplitude = 1e-4")
    path.write_text(text, encoding="utf-8")
    with pytest.raises(DeckError, match="gives harmonic_amplitude; vary that, or give parabola"):
        load_deck(path)


def test_the_transmission_error_is_varied_by_an_element_and_by_files():
    deck = load_deck(HERE / "accepted" / "curves.nml")
    second, curves = deck.sweeps
    assert second.parameter == "harmonic_amplitude_2" and second.values.tolist() == [0, 1e-5, 2e-5]
    assert curves.parameter == "te" and curves.values.tolist() == ["as ground", "it's"]
    assert curves.starts == ("rest",) and list(deck.curves_of(curves)) == ["as ground", "it's"]
    assert second.starts == ("rest", "up", "down")
    plane, series = deck.studies["map"]
    assert plane.axes["te"].tolist() == ["te_25x32"]
    assert deck.axes_of(plane, plane.axes)["te"]["te_25x32"].knots.size == 5
    assert set(series.axes) == {"harmonic_amplitude_1", "harmonic_amplitude_3"}
    assert deck.axes_of(series, series.axes) == series.axes


def test_files_can_be_set_and_start_from_rest_by_themselves(tmp_path):
    path = HERE / "accepted" / "curves.nml"
    deck = load_deck(path, [("sweep.curves.labels", "'a', 'b c'"),
                            ("sweep.second.parameter", "harmonic_amplitude(3)")])
    assert deck.sweeps[1].values.tolist() == ["a", "b c"]
    assert deck.sweeps[0].parameter == "harmonic_amplitude_3"
    text = path.read_text(encoding="utf-8").replace(", starts = 'rest'", "").replace(
        "'../", f"'{path.parent}/../")
    (tmp_path / "deck.nml").write_text(text, encoding="utf-8")
    assert load_deck(tmp_path / "deck.nml").sweeps[1].starts == ("rest",)


def test_each_file_is_checked_where_the_coast_flank_stands(tmp_path):
    """A tooth that would reach the standing flank: of that curve alone it is refused."""
    text = (HERE / "accepted" / "curves.nml").read_text(encoding="utf-8").replace(
        "'../", f"'{HERE / 'accepted'}/../") + "&scene back_flank_te = .false. /\n"
    (tmp_path / "deep.csv").write_text(
        "phase,transmission_error\n0,0\n0.25,2e-3\n0.5,0\n0.75,-2e-3\n", encoding="utf-8")
    (tmp_path / "deck.nml").write_text(text, encoding="utf-8")
    load_deck(tmp_path / "deck.nml")
    with pytest.raises(DeckError, match="standing coast flank"):
        load_deck(tmp_path / "deck.nml", [("sweep.curves.files", "deep.csv, deep.csv")])
    with pytest.raises(DeckError, match="standing coast flank"):
        load_deck(tmp_path / "deck.nml", [("sweep.second.to", "5e-3")])
