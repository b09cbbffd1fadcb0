"""Critical values of a measured transmission error: intervals, repeats, and raw samples."""

from pathlib import Path

import numpy as np
import pytest

from lapwing import critical_full
from lapwing.deck import load_deck
from lapwing.model.curve.interval import force_bounds, repeat_interval
from lapwing.studies.critical.measured import high_orders
from lapwing.studies.critical.study import critical_study, full_engagement
from measured import TRUTH, write_csv

DECK = Path(__file__).parents[2] / "deck" / "accepted" / "measured.nml"


@pytest.fixture(scope="module")
def deck():
    return load_deck(DECK)


def study(deck, name):
    return next(one for one in deck.criticals if one.name == name)


def found(deck, name, done=None):
    return critical_study(deck, study(deck, name), 1, done)


def test_a_torque_has_the_bounds_of_its_force(deck):
    attrs = found(deck, "T_full").attrs
    osc = deck.gear_pair.oscillator(deck.te, brake_torque=1.0,
                                    **study(deck, "T_full").operation)
    bounds = force_bounds(osc, deck.curve)
    unit = osc.scales.force_per_torque
    assert (attrs["low"], attrs["high"]) == pytest.approx((bounds.low / unit, bounds.high / unit))
    assert attrs["low"] < TRUTH["smooth"] < attrs["high"] and attrs["curve"] == "smoothing"
    assert attrs["estimate"] == pytest.approx(bounds.force / unit)


def test_the_bounds_of_a_speed_are_where_the_bounds_of_the_force_are_passed(deck):
    attrs = found(deck, "speed").attrs
    assert attrs["low"] < attrs["estimate"] < attrs["high"]
    operation = {**study(deck, "speed").operation, "pinion_speed_rpm": attrs["low"]}
    osc = deck.gear_pair.oscillator(deck.te, **operation)
    # Both with 199 draws: the same force, solved for to rounding.
    assert osc.force == pytest.approx(force_bounds(osc, deck.curve, draws=199).high, rel=1e-9)


def test_the_table_against_the_order(deck):
    data = found(deck, "T_full")
    order = data["fit_order"].values
    assert order.tolist() == list(range(1, order.size + 1)) and order.size >= 16
    assert np.all(data["fit_low"] <= data["fit_estimate"])
    assert np.all(data["fit_estimate"] <= data["fit_high"]) and float(data["fit_low"].min()) >= 0
    width = (data["fit_high"] - data["fit_low"]).values
    assert width[11] > 10 * width[2]
    assert data["fit_noise"].attrs["units"] == "rad"
    assert data["fit_estimate"].attrs["units"] == "N m"


def test_a_search_is_repeated_on_other_curves():
    told = []
    deck = load_deck(DECK, [("critical.T_safe.resolution", "0.01")])
    data = found(deck, "T_safe", told.append)
    values = data["repeat_value"].values
    assert values.size == 40 and np.ptp(values[np.isfinite(values)]) > 0
    low, high = repeat_interval(data.attrs["estimate"], values)
    assert (data.attrs["low"], data.attrs["high"]) \
        == (low - data.attrs["bar"], high + data.attrs["bar"])
    assert told == sorted(told) and 0 <= told[0] and 0.95 < told[-1] <= 1 and len(told) > 41
    alone = found(load_deck(DECK, [("critical.T_safe.resolution", "0.01"),
                                   ("transmission_error.curve_repeats", "0")]), "T_safe")
    assert "repeat_value" not in alone and "low" not in alone.attrs
    assert data.attrs["estimate"] == alone.attrs["estimate"]


def test_a_sweep_has_the_interval(deck):
    attrs, full = full_engagement(deck, deck.sweeps[0]), found(deck, "T_full").attrs
    assert [attrs[f"full_engagement{end}"] for end in ("", "_low", "_high")] \
        == pytest.approx([full["estimate"], full["low"], full["high"]])


def raw_deck(tmp_path, noise):
    write_csv(tmp_path / "measured.csv", "smooth", noise, 11)
    text = DECK.read_text(encoding="utf-8")
    text = text.replace("  smoothing = .true., noise_level = 2e-6, curve_repeats = 40\n", "")
    (tmp_path / "raw.nml").write_text(text, encoding="utf-8")
    return load_deck(tmp_path / "raw.nml")


@pytest.mark.parametrize(("noise", "decides"), [(0.4, True), (0.0, False)])
def test_raw_samples_are_told_and_compared_with_smoothed_ones(tmp_path, noise, decides):
    deck = raw_deck(tmp_path, noise)
    assert deck.curve is None
    data = found(deck, "T_full")
    operation = study(deck, "T_full").operation
    plain = critical_full(deck.gear_pair, deck.te, **operation)
    assert data.attrs["estimate"] == plain.attrs["estimate"] and "low" not in data.attrs
    assert data.attrs["curve"] == "samples"
    assert (data.attrs["high_order_share"] > 0.1) == decides


def test_a_formula_has_nothing_of_it():
    deck = load_deck(DECK.with_name("critical.nml"))
    osc = deck.gear_pair.oscillator(deck.te, **{"brake_torque": 1.0, **deck.operation})
    assert high_orders(deck, osc) == {}
    assert "curve" not in found(deck, deck.criticals[0].name).attrs
