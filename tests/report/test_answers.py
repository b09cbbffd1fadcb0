"""The findings: each sentence is true, whatever is missing, failed or aperiodic."""

import re
import warnings

import numpy as np
import pytest
from partial_data import DAMAGES, interrupted, one_start_lost
from partial_studies import (
    RESPONSE_DAMAGES,
    SEARCH_DAMAGES,
    failed,
    nothing_known,
    second_run_differs,
    unsafe_ones_failed,
)

import lapwing
from helpers import PAIR, SHIPPED
from lapwing import MotionState, Status
from lapwing.base.codes import SearchStage
from lapwing.base.messages import at_least, at_most
from lapwing.report.answers.conditions import Conditions
from lapwing.report.answers.findings import findings, findings_in, findings_lines, on_console
from lapwing.report.words import bands

SWEEPS = ("torque", "compliant", "rigid", "one_branch", "single", "negative", "engaged", "speed")
RESPONSES = ("periodic", "chaotic", "chatter", "engaged", "rigid", "compliant", "short")
SEARCHES = ("safe", "all_safe", "all_unsafe", "back", "no_back", "all_back")
NOTHING = "**Nothing is known**: no run has a result."


def told(responses=(), criticals=(), sweeps=(), missing=(), **more):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        said = findings(responses, criticals, sweeps, missing, **more)
    assert not re.search(r"\b(nan|inf|None)\b", " ".join(said))
    return said


def points(sweep):
    """(value, rattles, meets the coast flank, failed) of each point, one by one."""
    sweep = sweep[["status", "states_visited", "impacts", "back_impacts", "back_engages"]]
    for point in (sweep.isel(start=i).isel({sweep.attrs["parameter"]: j})
                  for i in range(sweep.sizes["start"])
                  for j in range(sweep.sizes[sweep.attrs["parameter"]])):
        value, status = float(point[sweep.attrs["parameter"]]), int(point["status"])
        if status == Status.UNFINISHED:
            continue
        if status:
            yield value, False, False, True
            continue
        visited = {int(one) for one in point["states_visited"].values}
        yield (value, visited != {1 << MotionState.ENGAGEMENT} or bool(point["impacts"].sum()),
               bool((point["back_impacts"] + point["back_engages"]).sum()), False)


def trials(critical):
    """The same of a search, each motion of a trial one point; None: not looked at."""
    for i in range(critical.sizes["trial"]):
        one = critical.isel(trial=i)
        if "trial_stage" in one and int(one["trial_stage"]) == SearchStage.CONFIRMATION:
            continue
        value, lost = float(one["trial_value"]), int(one["trial_failed"])
        if lost < int(one["trial_starts"]):
            yield (value, bool(one["trial_rattling"]) if "trial_rattling" in one else None,
                   bool(one["trial_back_cycles"]) if "trial_back_cycles" in one else None, False)
        if lost:
            yield value, False, False, True


def check(said, seen):
    """Every sentence against the motions themselves, one by one."""
    text = " ".join(said)
    there = [one for one in seen if not one[3]]
    rattling = sorted(value for value, rattles, _, _ in there if rattles)
    back = sorted(value for value, _, met, _ in there if met)
    lost = {value for value, _, _, broken in seen if broken}
    if not there:
        for claim in ("looked at above", "were seen at", "not seen to part", "at least",
                      "no other motion", "were last seen at", "part at"):
            assert claim not in text, claim
    if found := re.search(r"\*\*Back \w+\*\* were last seen at ([\d.]+)", text):
        assert float(found[1]) == back[-1]
    if re.search(r"\*\*No back", text):
        assert not back
    if found := re.search(r"none at the (\d+) torques looked at above it, \S+ to \S+ N·m, in "
                          r"([\d,]+) mesh", text):
        assert int(found[1]) == len({one[0] for one in there
                                     if one[2] is not None and one[0] > back[-1]})
    if found := re.search(r"\*\*Separation\*\* was seen up to ([\d.]+)", text):
        assert float(found[1]) <= rattling[-1] < float(found[1]) + 0.5
    if "not seen to part" in text:
        assert not rattling
    if "no other motion was seen above it." in text or "not seen to part" in text:
        assert not any(one[1] for one in there if one[0] > 11.9167454)
    if found := re.search(r"Choose at least ([\d.]+) N·m", text):
        least = float(found[1])
        assert not any(value >= least for value in rattling)
        assert any(one[1] is False and one[0] <= least + 1e-9 for one in there)
        assert least not in lost
    if found := re.search(r"Choose more than ([\d.]+) N·m", text):
        assert not rattling or float(found[1]) >= rattling[-1]
    if found := re.search(r"(\d+) motions? failed", text):
        assert lost and int(found[1]) > 0
    elif NOTHING not in text:
        assert not lost or "runs failed" in text or "run failed" in text


@pytest.mark.parametrize("damage", DAMAGES, ids=lambda one: one.__name__)
@pytest.mark.parametrize("name", SWEEPS)
def test_findings_of_a_sweep_rest_on_its_points(damaged, name, damage):
    data = damaged("sweeps", name, damage)
    said = told(sweeps=[data])
    seen = list(points(data))
    if name not in ("negative", "speed"):
        check(said, seen)
    done = data["status"].values == Status.OK
    assert (NOTHING in said) == (not done.any() and "full_engagement" not in data.attrs)
    lacking = int((data["status"].values == Status.UNFINISHED).sum())
    stopped = [one for one in said if one.startswith("**The run was stopped")]
    assert bool(stopped) == bool(lacking)
    if lacking:
        assert f"sweep `{name}` lacks {lacking} of {done.size} points" in said[0]
    if damage.__name__ == "aperiodic" and name in ("torque", "rigid", "one_branch"):
        assert "every motion has a period" not in " ".join(said)


@pytest.mark.parametrize("damage", SEARCH_DAMAGES, ids=lambda one: one.__name__)
@pytest.mark.parametrize("name", SEARCHES)
def test_findings_of_a_search_rest_on_its_motions(damaged, name, damage):
    data = damaged("searches", name, damage)
    said = told(criticals=[data])
    check(said, list(trials(data)))
    if damage is nothing_known:
        assert said == [NOTHING]
    if "T_safe: from there on" in " ".join(said):
        assert data.attrs["outcome"] == "found" and data["trial_rattling"].values.any()


@pytest.mark.parametrize("damage", RESPONSE_DAMAGES, ids=lambda one: one.__name__)
@pytest.mark.parametrize("name", RESPONSES)
def test_findings_of_a_response_rest_on_it(damaged, name, damage):
    data = damaged("responses", name, damage)
    said = " ".join(told([data]))
    if damage is failed:
        assert said == NOTHING
        return
    parts = not data.attrs["fully_engaged"]
    assert ("**Where the teeth part**" in said) == parts
    assert ("were not seen to part" in said) == (not parts)
    if parts:
        assert ("no period found" in said) == (not data.attrs["period"])
        assert ("does not confirm" in said) == (damage is second_run_differs)
    assert "at least" not in said or not parts


def test_studies_are_taken_together(sweeps, searches):
    balanced = searches["safe"].assign_attrs(balanced=1)
    said = told(criticals=[balanced, searches["back"]], sweeps=[sweeps["torque"]])
    everything = [*points(sweeps["torque"]), *trials(searches["safe"]), *trials(searches["back"])]
    check(said, everything)
    text = " ".join(said)
    assert "**Back impacts** were last seen at 0.7 N·m" in text
    assert "each from rest and 16 other starts" in text
    assert re.search(r"From 11\.92 N·m contact can be kept, but need not be\*\* \(T_full.*from "
                     r"there to 12\.3\d* N·m rattling", text)
    # The recommendation is the first sentence, and the only one; what its symbols mean follows.
    assert said[0].startswith(
        "**Choose at least 12.5 N·m on the gear** (impact law `absolute`; T_safe: from there on "
        "none of the motions tried rattles); with 10 % more transmission error it is 13.8 N·m. ")
    assert "last seen at 0.7 N·m (T_back): none" in text
    assert "(T_full, in closed form for this transmission error and speed: only above it" in text
    assert len(re.findall("choose", text, re.IGNORECASE)) == 1
    # Between 0.7 and the last rattling: in between, not "where the teeth part".
    assert "**In between**, each from rest: at 1.8 N·m 3 impacts per mesh cycle and 609.7" in text


def test_the_choice_names_the_speed_and_limits_are_told_as_times(sweeps, searches):
    speed = Conditions.of({"pinion_speed_rpm": 240.0, "brake_torque": 3.0}, 25)
    assert speed == ("at a pinion speed of 240 rpm", 100.0)
    said = told(criticals=[searches["safe"], searches["back"]], conditions=speed)
    assert said[0].startswith("**Choose at least 12.5 N·m on the gear** (at a pinion speed of 240 "
                              "rpm, impact law `absolute`; T_safe")
    cycles, seconds = re.search(r"once in ([\d,]+) mesh cycles \(([\d.]+) s\)",
                                " ".join(said)).groups()
    assert float(seconds) == pytest.approx(float(cycles.replace(",", "")) / 100, rel=0.05)
    # A sweep at a speed of its own: that of the deck is not told of it.
    other = sweeps["torque"].assign_attrs(own_operation=1)
    assert "240 rpm" not in " ".join(told(sweeps=[other], conditions=speed))


@pytest.mark.parametrize(("operation", "words", "frequency"), [
    ({"mesh_frequency_hz": 50.0}, "at a mesh frequency of 50 Hz", 50),
    ({"pinion_speed_rad_s": 2 * np.pi}, "at a pinion speed of 6.28319 rad/s", 25), ({}, "", None)])
def test_the_speed_is_told_as_it_was_given(operation, words, frequency):
    said = Conditions.of(operation, 25)
    assert said.speed == words
    assert said.time(100) == (f" ({100 / frequency:g} s)" if frequency else "")
    assert said.words({"contact_law": "compliant", "impact_law": "relative"}) == words


def test_responses_alone_give_no_advice(responses):
    alone = responses["periodic"].assign_attrs(full_engagement=11.9167454)
    said = told([alone])
    assert said[0].startswith("**This run does not say which torque keeps contact**; a torque "
                              "below T_full = 11.92 N·m on the gear surely does not (impact law")
    assert "Choose" not in " ".join(said) and "From 11.92" not in " ".join(said)
    drifting = alone.assign_attrs(
        mean_acceleration=4.0, mean_speed_first=50 * np.pi, mean_speed_last=51 * np.pi, name="d")
    said = told([drifting])
    assert said[0].startswith("**The pinion does not keep its speed at 1.8 N·m on the gear**: the "
                              "torques are not in balance, and the mean speed goes from 157.1 to "
                              "160.2 rad/s (1500 to 1530 rpm) in the ")
    assert said[1].startswith("**This run does not say")


@pytest.mark.parametrize(("quiet", "words"), [
    (True, "at 1 of the 2 torques looked at below it none was seen either, at 1 more not from "
           "every start."),
    (False, "at 1 of the 2 torques looked at below it not from every start.")])
def test_starts_that_do_not_strike_back_are_counted(sweeps, quiet, words):
    data = sweeps["torque"].copy(deep=True)
    data["back_impacts"][{"start": 0, "brake_torque": 0}] = 1  # from rest alone
    data["back_impacts"][{"brake_torque": 1}] = 0 if quiet else 1
    data["back_impacts"][{"brake_torque": 2}] = 1
    assert f"It is no sharp threshold: {words}" in " ".join(told(sweeps=[data]))


def test_a_sweep_that_rattles_above_the_search_moves_the_choice(sweeps, searches):
    louder = sweeps["torque"].copy(deep=True)
    last = louder.sizes["brake_torque"] - 2  # 13 N·m
    louder["impacts"][{"start": 0, "brake_torque": last}] = 4
    said = " ".join(told(criticals=[searches["safe"]], sweeps=[louder]))
    assert "up to 13 N·m" in said and "Choose at least 14 N·m" in said


def test_what_was_not_computed_comes_first(sweeps):
    said = told(sweeps=[interrupted(sweeps["torque"])], missing=[("critical", "T_safe")])
    assert said[0].startswith("**The run was stopped before its end**: critical `T_safe` has no "
                              "result; sweep `torque` lacks 12 of 24 points.")
    assert told(missing=[("response", "a")])[-1] == NOTHING


def test_starts_are_named_only_where_they_were_at_every_value(sweeps):
    assert "(each from rest, carried upwards, carried downwards)" in " ".join(
        told(sweeps=[sweeps["torque"]]))
    half = " ".join(told(sweeps=[interrupted(sweeps["torque"])]))
    assert "(carried downwards)" in half
    lost = " ".join(told(sweeps=[one_start_lost(sweeps["torque"])]))
    assert "each from rest" not in lost


def test_a_search_that_only_failed_below_knows_no_last_separation(searches):
    said = " ".join(told(criticals=[unsafe_ones_failed(searches["safe"])]))
    assert "Separation** was seen" not in said and "T_safe: from" not in said
    assert "the lowest torque searched" in said


def test_other_operating_points_are_kept_apart(searches):
    own = searches["safe"].assign_attrs(own_operation=1, brake_torque=3.0)
    said, = told(criticals=[own])
    assert said.startswith("**Besides**: at 3 N·m (`safe`) no rattling seen above T_safe")
    speed = lapwing.critical_full(PAIR, SHIPPED, parameter="pinion_speed_rpm", brake_torque=12,
                                  values=np.arange(100, 401, 50), safe_end="low")
    said, = told(criticals=[speed.assign_attrs(name="speed", brake_torque=12.0)])
    # 240.7065: an upper limit is rounded down.
    assert said == "**Besides**: at 12 N·m contact can be kept up to a pinion speed of 240.7 rpm."


def test_along_another_parameter(sweeps):
    data = sweeps["speed"].assign_attrs(brake_torque=3.3).drop_vars("dynamic_te_rms")
    said, = told(sweeps=[data])
    assert said == ("**Avoid a pinion speed of 200 to 400 rpm at 3.3 N·m on the gear**: of 3 "
                    "values looked at, 100 to 400 rpm, the teeth part at 200 to 400 rpm, not at "
                    "100 rpm; back impacts were not seen.")
    everywhere, = told(sweeps=[data.isel(pinion_speed_rpm=slice(1, None))])
    assert everywhere.startswith("**Along the pinion speed at 3.3 N·m on the gear** (2 values "
                                 "looked at, 200 to 400 rpm) the teeth part everywhere; ")


def test_starts_that_differ_along_another_parameter_are_told_apart(sweeps):
    data = sweeps["speed"].drop_vars("dynamic_te_rms").copy(deep=True)
    down = [str(start) for start in data["start"].values].index("down")
    data["states_visited"][down, 1] = 1 << MotionState.ENGAGEMENT
    data["impacts"][down, 1] = 0
    said, = told(sweeps=[data])
    assert ("the teeth part at 200 to 400 rpm (each from rest, carried upwards), at 400 rpm "
            "(carried downwards); back impacts were not seen.") in said


def test_negative_torques_press_on_the_coast_flanks(sweeps):
    said, = told(sweeps=[sweeps["negative"]])
    assert "presses on the coast flanks" in said
    assert "they part at -12.5 to -5 N·m, not at -14 N·m" in said


@pytest.mark.parametrize(("value", "step", "least", "most"), [
    (12.4375, 0.0125, "12.44", "12.43"), (12.42, 0.02, "12.42", "12.42"), (13.0, 1.0, "13", "13"),
    (11.9167454, 0, "11.92", "11.91"), (240.7065, 0, "240.8", "240.7"), (0.0, 0, "0", "0"),
    (-3.14159, 0, "-3.141", "-3.142"), (123456.0, 0, "123500", "123400")])
def test_limits_are_rounded_to_the_safe_side(value, step, least, most):
    assert at_least(value, step) == least
    assert at_most(value, step) == most


def test_bands_are_told():
    values = np.arange(6.0)
    assert bands(values, np.array([1, 1, 0, 1, 0, 1], bool)) == "0 to 1, 3, 5"


def test_the_console_says_what_the_summary_says(sweeps):
    said = told(sweeps=[sweeps["torque"]])
    summary = "\n".join(["# case", "", *findings_lines(said), "", "25 × 32 teeth"])
    assert findings_in(summary) == tuple(said)
    assert findings_in("# case\n\nNo findings") == ()
    shown = on_console(said)
    assert max(map(len, shown.splitlines())) <= 100 and "**" not in shown
    assert re.sub(r"\s+", " ", shown).count(" - ") == len(said)
