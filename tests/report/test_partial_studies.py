"""No sentence and no figure of a response or a search claims what failed or missing parts hide."""

import re
import warnings

import numpy as np
import pytest
from figure_checks import assert_no_invented_axes, words_of
from partial_studies import (
    RESPONSE_DAMAGES,
    SEARCH_DAMAGES,
    every_second_failed,
    failed,
    nothing_known,
    second_run_differs,
    unsafe_ones_failed,
    whole,
    without_intervals,
)

from lapwing import plots
from lapwing.base.arrivals import IMPACTS
from lapwing.report.critical import critical_table, critical_text, headline
from lapwing.report.response import _legend, _paragraph, _table
from lapwing.report.summary import headlines

GEAR = {"natural_frequency": 8304.69, "pinion_base_lever": 0.034, "backlash": 0.002,
        "mesh_stiffness": 3.12e8}
RESPONSES = ("periodic", "chaotic", "chatter", "engaged", "rigid", "compliant", "short")
SEARCHES = ("safe", "all_safe", "all_unsafe", "back", "no_back", "all_back")


def all_said(data):
    """Table, legend, paragraph and console line of one response; no warning on the way."""
    attrs = data.attrs
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        line, = headlines({"response": {attrs["name"]: data}})
        return "\n".join([*_table([attrs]), *_legend([attrs]), _paragraph(attrs), line])


@pytest.mark.parametrize("damage", RESPONSE_DAMAGES, ids=lambda one: one.__name__)
@pytest.mark.parametrize("name", RESPONSES)
def test_every_sentence_of_a_response_rests_on_results(damaged, name, damage):
    data = damaged("responses", name, damage)
    said, attrs = all_said(data), data.attrs
    assert not re.search(r"\b(nan|inf)\b", said)
    if attrs["status"]:
        assert said.count("failed") == 3 and "there are no numbers" in said
        for claim in ("Settled", "repeats every mesh", "never part", "chaos", "Each run is"):
            assert claim not in said
        return
    legend, = _legend([attrs])
    numbers = said.replace(legend, "")
    sure = attrs["period"] and not attrs["status_reference"] \
        and attrs["motion_class"] == attrs["motion_class_reference"] \
        and "deepest_separation_change" in attrs
    if not sure:
        assert "(error" not in numbers
    if not attrs["period"]:
        assert "repeats every" not in numbers
        assert "greatest values are those seen" in said or attrs["status_reference"]
        assert ("≥" in numbers) == (attrs["deepest_separation"] > 0 or
                                    attrs["mesh_force_peak"] > 0)
    if "(change" in numbers:
        assert "says little of the error" in said
    if re.search(r"\d ± [\d.e-]+ (N|mJ|times)", numbers):
        assert "95 % interval of an average" in said
    if attrs["status_reference"]:
        assert "no error is known" in said
    if not np.isfinite(attrs["deepest_separation_transient"]):
        assert "Settled" not in said and "not known" in said


def test_a_motion_that_is_not_confirmed_is_called_so_everywhere(responses):
    said = all_said(second_run_differs(responses["periodic"]))
    assert "period 1 ?" in said and "do not rely on the class" in said
    assert "the second run gives another motion" in said.splitlines()[-1]


def test_without_an_interval_there_is_no_plus_minus(responses):
    said = all_said(without_intervals(responses["chatter"]))
    assert not re.search(r"\d ± \d", said)
    assert "95 %" not in _legend([without_intervals(responses["chatter"]).attrs])[0]


# Drawing takes longest: for every day each damage of one motion, and two of each.
DRAWN = [pytest.param(name, damage, id=f"{name}-{damage.__name__}",
                      marks=() if name == "periodic" or damage in (whole, failed)
                      else pytest.mark.full)
         for name in RESPONSES for damage in RESPONSE_DAMAGES]


@pytest.mark.parametrize(("name", "damage"), DRAWN)
@pytest.mark.parametrize("module", plots.FIGURES["response"])
def test_every_figure_of_a_response_shows_results_alone(damaged, name, damage, module):
    data = damaged("responses", name, damage)
    if not plots.shows(module, data):
        struck = np.isin(data["event_kind"].values, [int(kind) for kind in IMPACTS.kinds]).any() \
            or data.attrs["contact_law"] == "compliant"
        assert module == "response.shaft_motion" or (
            module == "response.impact_section" and (data.attrs["status"] or not struck))
        return
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        figure = plots.figure_of(module, data, gear_pair=GEAR)
    said = words_of(figure)
    assert not re.search(r"\b(nan|inf)\b", said)
    assert_no_invented_axes(figure)
    if data.attrs["status"]:
        assert "the run failed (not finite)" in said
    elif not data.attrs["period"]:
        assert "period 1" not in said


def search_said(data):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        return "\n".join([*critical_table([data]), *critical_text([data]), headline(data)])


@pytest.mark.parametrize("damage", SEARCH_DAMAGES, ids=lambda one: one.__name__)
@pytest.mark.parametrize("name", SEARCHES)
def test_every_sentence_of_a_search_rests_on_results(damaged, name, damage):
    data = damaged("searches", name, damage)
    said = search_said(data)
    assert not re.search(r"\b(nan|inf)\b", said)
    lost = int(data["trial_failed"].sum())
    assert ("failed" in said) == bool(lost)
    if damage is nothing_known:
        assert "not known" in headline(data) and "| not known |" in said
        for claim in ("no back impact seen", "no rattling seen above T_safe =", "none down to",
                      "some motion rattles", "confidence"):
            assert claim not in said, claim
    if "trial_rattling" in data and not data["trial_rattling"].values.any():
        assert not re.search(r"[1-9]\d* still rattle|[1-9]\d* motions still rattle", said)
        assert "some motion rattles" not in said
        assert not re.search(r"T_safe = ", said) and "±" not in said


def test_a_bracket_between_quiet_and_failed_values_is_a_limit_only(searches):
    data = unsafe_ones_failed(searches["safe"])
    said = search_said(data)
    assert f"at most {data.attrs['clean']:g}" in headline(data)
    assert f"**T_safe at most {data.attrs['clean']:g} N·m**" in said
    assert "none is seen to rattle" in said


def test_values_at_which_every_motion_failed_bound_no_rate(searches):
    data = every_second_failed(searches["back"])
    said = search_said(data)
    assert "last back impact seen at 0.7 N·m" in said
    assert re.search(r"none at the 1 value examined from 0\.9 to 1\.1 N·m "
                     r"\(every motion failed at 1 more\)", said)
    assert "nothing is known there" in said and "less often than once" not in said


@pytest.mark.parametrize("damage", SEARCH_DAMAGES, ids=lambda one: one.__name__)
@pytest.mark.parametrize("name", SEARCHES)
def test_every_figure_of_a_search_shows_results_alone(damaged, name, damage):
    data = damaged("searches", name, damage)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        figure = plots.figure_of("critical_search", data, gear_pair=GEAR)
    assert not re.search(r"\b(nan|inf)\b", words_of(figure))
    assert_no_invented_axes(figure)
    known = data["trial_failed"].values < data["trial_starts"].values
    drawn = [line.get_xydata() for line in figure.axes[0].lines
             if line.get_marker() in "osv^" and line.get_label()[0] != "_"]
    values = set(np.concatenate([np.zeros((0, 2)), *drawn])[:, 0])
    assert values <= set(data["trial_value"].values[known])
    if not known.any():
        assert "every motion failed: nothing is known" in words_of(figure)
        assert "not known" in figure.get_suptitle()
