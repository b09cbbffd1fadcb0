"""No report and no figure claims what missing, failed or aperiodic points cannot show."""

import re
import warnings

import numpy as np
import pytest
from figure_checks import assert_no_invented_axes, words_of
from partial_data import DAMAGES, as_it_is, interrupted, some_failed

from lapwing import Status, plots
from lapwing.plots.sweep import orbit_diagram
from lapwing.report.summary import headlines
from lapwing.report.sweep import sweep_text

PAIR = {"natural_frequency": 8304.69, "pinion_base_lever": 0.034, "backlash": 0.002}
SWEEPS = ("torque", "compliant", "rigid", "one_branch", "single", "negative", "engaged", "speed")


@pytest.mark.parametrize("damage", DAMAGES, ids=lambda one: one.__name__)
@pytest.mark.parametrize("name", SWEEPS)
def test_every_sentence_rests_on_results(damaged, name, damage):
    data = damaged("sweeps", name, damage)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        said = "\n".join(sweep_text(data))
        line, = headlines({"sweep": {name: data}})
    done = data["status"].values == Status.OK
    assert not re.search(r"\b(nan|inf)\b", said)
    assert line.startswith(f"{name}: {done.sum()} of {done.size} points have")
    if not done.any():
        assert "nothing is known of its motions" in said
        assert "hysteresis" not in said and "last" not in said and "T_full" not in said
        return
    if not done[0].any() and done.shape[0] > 1:
        assert "not known" in said
    hysteresis = next(line for line in said.splitlines() if line.startswith("- hysteresis"))
    if len(data["start"]) == 1:
        assert "not looked for" in hysteresis
        return
    starts = list(data["start"].values)
    both = done[starts.index("up")] & done[starts.index("down")]
    periods = data["period"].values[[starts.index("up"), starts.index("down")]]
    judged = int((both & periods.any(axis=0)).sum())
    if not judged:
        assert "hysteresis: not known" in hysteresis
    elif judged < both.size:
        assert f"judged at {judged} of {both.size} values" in hysteresis
    else:
        assert re.search(rf"judged at (all )?{judged} value", hysteresis)


# Drawing takes longest: for every day each damage of one sweep, and two of each sweep.
DRAWN = [pytest.param(name, damage, id=f"{name}-{damage.__name__}",
                      marks=() if name == "torque" or damage in (as_it_is, some_failed)
                      else pytest.mark.full)
         for name in SWEEPS for damage in DAMAGES]


@pytest.mark.parametrize(("name", "damage"), DRAWN)
def test_every_figure_is_drawn_without_a_warning(damaged, name, damage):
    data = damaged("sweeps", name, damage)
    drawn = [module for module in plots.FIGURES["sweep"] if plots.shows(module, data)]
    assert bool(drawn) == bool((data["status"] == Status.OK).any())
    for module in plots.FIGURES["sweep"]:
        if not plots.shows(module, data):
            continue
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            figure = plots.figure_of(module, data, gear_pair=PAIR)
        assert_no_invented_axes(figure)
        words = words_of(figure)
        assert not re.search(r"\b(nan|inf)\b", words)
        if module in ("waterfall", "impact_speed_density"):
            empty = ~(data["status"] == Status.OK).any(data.attrs["parameter"]).values
            assert words.count("no result at any value") == empty.sum()
        assert "complete engagement from" not in words


def test_an_interrupted_sweep_knows_no_hysteresis_and_no_last_impact_above(sweeps):
    said = "\n".join(sweep_text(interrupted(sweeps["torque"])))
    assert "- hysteresis: not known (0 values in common)" in said
    assert "; no result at the other 4" in said
    assert not re.search(r"last back impact seen: none \(", said)


def test_rattling_above_complete_engagement_is_said_with_its_start(sweeps):
    kept = next(line for line in sweep_text(sweeps["torque"]) if line.startswith("- T_full"))
    assert "contact *can* be kept from here" in kept
    assert re.search(r"rattling seen up to 12\.2 N·m \([^)]*carried upwards\)", kept)
    assert "none at 4 values from 12 to 14 N·m above it" in kept
    figure = orbit_diagram.draw(sweeps["torque"], PAIR)
    words = " ".join(text.get_text() for axis in figure.axes for text in axis.texts)
    assert "the engaged motion keeps contact above" in words and "rattling seen up to 12.2" in words


def test_without_restitution_arrivals_are_engagements_everywhere(sweeps):
    data = sweeps["compliant"]
    said = "\n".join(sweep_text(data))
    assert "impacts per cycle" not in said and "| braking torque (N·m) | engagements per" in said
    assert "engagements are counted: every one" in said
    assert "1:(0,0), " not in said
    for module in ("orbit_diagram", "staircase"):
        figure = plots.figure_of(module, data, gear_pair=PAIR)
        axis = next(one for one in figure.axes if one.get_ylabel() == "engagements\nper cycle")
        assert max(np.nanmax(line.get_ydata()) for line in axis.lines[:3]) > 0
        assert not any("approach speed" in one.get_ylabel() for one in figure.axes)
    assert not plots.shows("impact_speed_density", data)
