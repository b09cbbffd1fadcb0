"""A deck of measured samples from file to summary: every number says what the noise leaves."""

import re
from pathlib import Path

import numpy as np
import pytest

from lapwing.deck import load_deck
from lapwing.plots import fit_orders, tasks_of, te_fit
from lapwing.report.measured import curve_sentences, has_interval, value_and_interval, warnings
from lapwing.results import read_results
from lapwing.run import run_deck
from measured import write_csv

DECK = Path(__file__).parents[1] / "deck" / "accepted" / "measured.nml"
STUDIES = """
&response name = 'a', settle_cycles = 10, record_cycles = 10, exponents = .false. /
&critical name = 'T_full', find = 'full' /
&critical name = 'T_safe', find = 'safe', values = 2, 4, 8, resolution = 1
  start_phases = 1, start_positions = 1, start_speeds = 1, settle_cycles = 10, record_cycles = 5 /
&sweep name = 't', parameter = 'brake_torque', values = 3, 6, starts = 'rest'
  settle_cycles = 10, record_cycles = 10 /
"""
FIT = "smoothing = .true., noise_level = 2e-6, curve_repeats = 40"


def run(folder, fit, noise=0.4, studies=""):
    """Outcome, summary and open results of the deck with another fit."""
    write_csv(folder / "measured.csv", "kinked", noise, 11)
    text = DECK.read_text(encoding="utf-8").replace(FIT, fit)
    if studies:
        text = text[:text.index("&response")] + studies
    (folder / "deck.nml").write_text(text, encoding="utf-8")
    outcome = run_deck(load_deck(folder / "deck.nml"), folder / "out", threads=1, figures="none")
    assert not outcome.failed
    summary = (outcome.folder / "summary.md").read_text(encoding="utf-8")
    return outcome, summary, read_results(outcome.folder / "result.nc")


@pytest.fixture(scope="module")
def fitted(tmp_path_factory):
    outcome, summary, results = run(tmp_path_factory.mktemp("fitted"), FIT, studies=STUDIES)
    with results:
        yield outcome, summary, results


def test_the_summary_tells_the_fit_and_every_interval(fitted):
    _, summary, results = fitted
    table = results.transmission_error.attrs
    assert "60 samples by a smoothing spline" in summary
    assert "noise of a sample 2 µrad" in summary
    assert f"no order above {table['curve_wide_order']}" in summary
    full, safe = (results.critical(name).attrs for name in ("T_full", "T_safe"))
    row = next(line for line in summary.splitlines() if line.startswith("| T_full |"))
    value, interval = value_and_interval(full)
    assert f"| {value} | {interval} |" in row and "rounding" not in row
    assert value_and_interval(safe)[1] in summary
    assert "On 40 other curves that samples with the same noise might give:" in summary
    assert re.search(r"T_full = [\d.]+ \([\d.]+ to [\d.]+\) N·m, 95 %", summary)


def test_the_file_holds_samples_fit_and_band(fitted):
    *_, results = fitted
    te = results.transmission_error
    assert te.sizes["sample"] == 60 and te.attrs["curve"] == "smoothing"
    curve = load_deck(results.path.parents[2] / "deck.nml").curve
    np.testing.assert_array_equal(te["sample_residual"].values, curve.residual)
    bend = curve.te_wide.curvature(te["curve_phase"].values)
    low, high = te["curve_curvature_low"].values, te["curve_curvature_high"].values
    np.testing.assert_allclose((low + high) / 2, bend, atol=1e-8 * np.abs(bend).max())
    # ± 1.96 noise levels times the root of the covariance, by draws of other samples.
    draws = np.array([one.curvature(te["curve_phase"].values) for one in curve.repeats(100)])
    np.testing.assert_allclose((high - low) / 3.92, draws.std(axis=0), rtol=0.4)
    names = [task.stem for task in tasks_of(results)]
    assert "te_fit" in names and "fit_orders_T_full" in names


def test_headlines_tell_the_interval(fitted):
    outcome, *_ = fitted
    line = next(line for line in outcome.headlines if line.startswith("T_full"))
    assert re.search(r"T_full = [\d.]+ N·m: [\d.]+ to [\d.]+ \(95 %, noise of the samples\)$", line)


def test_raw_samples_say_so_everywhere(tmp_path):
    outcome, summary, results = run(tmp_path, "", studies="&critical name = 'T_full', "
                                                          "find = 'full' /\n")
    with results:
        names = [task.stem for task in tasks_of(results)]
        assert results.transmission_error.attrs["source"] == "measured.csv, 60 samples used raw"
    assert names == ["te_curve"]
    assert "60 samples of the transmission error are used raw" in summary
    assert "| not known: samples used raw |" in summary and "to rounding" not in summary
    assert "(samples used raw)" in outcome.headlines[0]
    assert any("The noise may decide" in note for note in outcome.notes)


def test_exact_samples_used_raw_bring_no_warning(tmp_path):
    outcome, summary, results = run(tmp_path, "", noise=0.0,
                                    studies="&critical name = 'T_full', find = 'full' /\n")
    results.close()
    assert not outcome.notes and "used raw" in summary and "The noise may decide" not in summary


def test_high_orders_and_a_noise_level_that_cannot_be_are_warned_of(tmp_path):
    outcome, summary, results = run(tmp_path, "harmonics = 12, noise_level = 1e-7, "
                                    "curve_repeats = 0",
                                    studies="&critical name = 'T_full', find = 'full' /\n")
    results.close()
    for text in ("The highest orders decide", "The residuals do not go with the noise level"):
        assert text in summary and any(text in note for note in outcome.notes)


def test_warnings_have_limits():
    quiet = {"curve": "harmonics", "high_order_share": 0.1, "high_order_above": 4,
             "residual_excess": 1e-3}
    assert warnings(quiet) == [] and len(warnings({**quiet, "high_order_share": 0.11})) == 1
    assert len(warnings({**quiet, "residual_excess": 9e-4})) == 1
    assert warnings({**quiet, "high_order_share": np.nan}) == []
    assert curve_sentences({"peak_to_peak": 1.0}) == []


@pytest.mark.parametrize(("low", "high", "words"), [
    (0.33, 0.694, ("0.55", "0.33 to 0.69 (95 %, noise of the samples)")),
    (np.nan, 0.694, ("0.55", "beyond the values searched to 0.69 (95 %, noise of the samples)")),
    (0.5457, 0.5462, ("0.54600", "0.54570 to 0.54620 (95 %, noise of the samples)"))])
def test_digits_end_where_the_interval_begins(low, high, words):
    attrs = {"estimate": 0.546, "low": low, "high": high, "confidence": 0.95, "outcome": "found"}
    assert has_interval(attrs) and value_and_interval(attrs)[1] == words[1]
    assert value_and_interval(attrs)[0] == words[0]


def test_figures_show_what_the_file_holds(fitted):
    *_, results = fitted
    te, full = results.transmission_error, results.critical("T_full")
    top, middle, bottom = te_fit.draw(te).axes[:3]
    x, y = next(line for line in top.lines if line.get_label() == "samples").get_data()
    inside = (x >= 0) & (x < 1)
    np.testing.assert_allclose(y[inside], 1e6 * te["sample_value"].values)
    x, y = middle.lines[0].get_data()
    np.testing.assert_allclose(y[inside], 1e6 * te["sample_residual"].values)
    assert len(bottom.collections) >= 1
    panel = fit_orders.draw(full).axes[0]
    _, y = panel.containers[0].lines[0].get_data()
    np.testing.assert_array_equal(y, full["fit_estimate"].values)
