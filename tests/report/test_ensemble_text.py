"""What is said of an ensemble, also where runs are missing, failed, or all alike."""

import numpy as np
import pytest

from lapwing import Draw, Numerics, TransmissionError, ensemble
from lapwing.base.messages import percent
from lapwing.plots.ensemble import distributions, tornado
from lapwing.report.ensemble.findings import findings
from lapwing.report.ensemble.text import ensemble_text, headline
from lapwing_bench.scenes import PAIR

TE = TransmissionError.harmonic([17e-6, 4.5e-6, 1.5e-6], [0.0, 1.0, 2.0], [1, 2, 3])
DRAWS = {"restitution": Draw("uniform", low=0.6, high=0.9),
         "damping_ratio": Draw("normal", mean=0.1, deviation=0.01)}
QUICK = {"settle": 20, "record": 10, "threads": 2, "pinion_speed_rpm": 1500.0, "runs": 32}


def drawn(torque, name="one", draws=None, **options):
    found = ensemble(PAIR, TE, DRAWS if draws is None else draws, brake_torque=torque,
                     **{**QUICK, **options})
    return found.assign_attrs(name=name, brake_torque=torque)


@pytest.fixture(scope="module")
def pairs():
    return drawn(11.0, sensitivity_draws=16)


def said_of(data):
    return "\n".join([*ensemble_text(data), *findings([data]), headline(data)])


def test_a_whole_ensemble_in_words(pairs):
    said = said_of(pairs)
    full = pairs.sel(level=0.99)
    assert (f"**99 % of pairs can keep contact from "
            f"{float(full['full_engagement_quantile']):.4g} N·m**") in said
    rattles = pairs.sel(event="rattles")
    assert f"rattling in {int(rattles['seen'])} of 32" in said
    assert "**What matters most for T_full is the damping ratio**" in said
    assert "none failed" in said and "without a result" not in said
    assert "32 of 32 runs have a result, scrambled Sobol draws of restitution, damping" in said
    assert "nan" not in said


def test_ensembles_of_the_same_draws_answer_together(pairs):
    """What the draws alone decide is said once; the torque that surely keeps 99 %, of all."""
    quick = {"draws": {"restitution": DRAWS["restitution"],
                       "backlash": Draw("uniform", low=1e-3, high=3e-3)},
             "settle": 1, "record": 1, "sampling": "latin_hypercube"}
    high, low = (drawn(torque, name, runs=512, **quick) for torque, name in (
        (40.0, "high"), (2.0, "low")))
    said = findings([high, low])
    assert sum("can keep contact" in one for one in said) == 1
    assert [one[:10] for one in said if "stay together" in one and "At" in one] == \
        ["**At 2 N·m", "**At 40 N·"]
    told, = (one for one in said if "Choose" in one)
    least = 1 - float(high.sel(event="rattles")["probability_high"])
    assert told.startswith("**Choose 40 N·m on the gear** (")
    assert (f"impact law `relative`): there at least {percent(least)} of pairs keep contact (95 % "
            "confidence). At 2 N·m, the next below, 99 % are not sure. ") in told
    assert "restitution 0.75 ± 0.08" in told and "backlash 2000 ± 580 µrad" in told
    assert any("**No torque that was run surely keeps 99 %" in one for one in findings([low]))
    # So few draws cannot say so, whatever they show.
    assert any("**No torque" in one for one in findings([drawn(40.0, runs=64, **quick)]))


def test_what_is_lost_is_said():
    data = drawn(5.0, numerics=Numerics(max_events_per_cycle=60), sensitivity_draws=16)
    failed = int((data["status"].values != 0).sum())
    assert 0 < failed < 32
    said = said_of(data)
    assert f"{failed} failed" in said and f" {failed} runs failed: what is likely" in said
    assert "A run without a result may be anything" in said
    assert "(95 % limits" in said and "nan" not in said
    lost = int(data.attrs["sensitivity_runs_lost"])
    # T_full needs no run, so that its sensitivities are known.
    assert lost and "of T_full, alone" in said and "of deepest separation, alone" not in said
    drawn_ones = []
    for figure in (distributions, tornado):
        assert figure.shows(data)
        drawn_ones.append(figure.draw(data, None, title="deck, ensemble 'one'"))
        drawn_ones[-1].canvas.draw()
    texts = [text.get_text() for axis in drawn_ones[0].axes
             for text in (axis._left_title, *axis.texts)]
    assert any(f"{failed} without a result" in text for text in texts)


def test_nothing_known_says_nothing():
    data = drawn(5.0, numerics=Numerics(max_events_per_cycle=1), drive_torque=4.0)
    said = said_of(data)
    assert "no run has a result: nothing is known" in said and findings([data]) == []
    assert not distributions.shows(data) and not tornado.shows(data)


def test_all_alike_is_no_distribution():
    data = drawn(60.0, draws={"backlash": Draw("uniform", low=1e-3, high=3e-3),
                              "restitution": DRAWS["restitution"]}, sensitivity_draws=16)
    said = said_of(data)
    assert "Sensitivities are not known: no answer varies in each scramble" in said
    assert "What matters" not in said and "nan" not in said and not tornado.shows(data)
    figure = distributions.draw(data, None, title="x")
    assert any("in all" in text.get_text() for axis in figure.axes for text in axis.texts)


def test_a_figure_has_bars_longest_on_top(pairs):
    figure = tornado.draw(pairs, None, title="deck, ensemble 'one'")
    figure.canvas.draw()
    panel = figure.axes[0]
    assert [label.get_text() for label in panel.get_yticklabels()] == ["restitution",
                                                                       "damping ratio"]
    ranks = tornado.draw(pairs.drop_vars([name for name in pairs if "effect" in str(name)]), None)
    assert ranks.axes[0].get_xlabel() == "rank correlation" and not ranks.legends
    assert np.ptp(ranks.axes[0].get_xlim()) == 2


def test_what_differs_by_rounding_is_told_in_words():
    data = drawn(5.0)
    rounded = 11.9 * (1 + 4e-16 * np.arange(data.sizes["run"]))
    figure = distributions.draw(data.assign(
        full_engagement=("run", rounded), deepest_separation=("run", rounded / 1e4)))
    texts = [text.get_text() for axis in figure.axes for text in axis.texts]
    assert any("11.9 N·m in all" in text for text in texts)
