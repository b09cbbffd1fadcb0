"""Where branches differ and where they jump, from made-up sweeps and from the 25 × 32 pair."""

import re

import numpy as np
import pytest
import xarray as xr

import lapwing
from helpers import PAIR, SHIPPED
from lapwing import Status
from lapwing.report.hysteresis import hysteresis

RECORDED = 12
VALUES = np.arange(1.0, 9.0)


def made_up(**branches):
    """A sweep over 1, 2, … 8 from (period, impacts per period, depth in µrad) of each value."""
    shape = (len(branches), VALUES.size, RECORDED)
    data = {key: np.zeros(shape) for key in ("counted_impacts", "counted_back_impacts",
                                             "chatter_ends", "deepest_separation", "impacts")}
    data["states_visited"] = np.ones(shape, int)
    period = np.zeros(shape[:2], int)
    for i, motions in enumerate(branches.values()):
        for j, (p, impacts, depth) in enumerate(motions):
            period[i, j] = p
            if p:  # all impacts of a period fall into its last cycle
                data["counted_impacts"][i, j, p - 1::p] = impacts
            data["deepest_separation"][i, j] = 1e-6 * depth
            data["states_visited"][i, j] = 3 if depth else 2
    dims = ("start", "torque", "recorded_cycle")
    sweep = xr.Dataset(
        {key: (dims, array) for key, array in data.items()}
        | {"period": (dims[:2], period), "status": (dims[:2], np.zeros_like(period))},
        {"start": list(branches), "torque": VALUES}, {"parameter": "torque"})
    return sweep


def text(sweep):
    return "\n".join(hysteresis(sweep, "N·m"))


BOUNCING, ENGAGED = (1, 5, 100), (1, 0, 0)


def test_agreement():
    said = text(made_up(up=[BOUNCING] * 8, down=[BOUNCING] * 8))
    assert said == ("none seen: up and down agree in period, impacts and depth (judged at all 8 "
                    "values from 1 to 8 N·m)")
    assert "needs the starts up and down" in text(made_up(rest=[BOUNCING] * 8))


def test_each_jump_is_named_with_its_bracket():
    up = [BOUNCING] * 6 + [ENGAGED] * 2
    down = [BOUNCING] * 3 + [ENGAGED] * 5
    said = text(made_up(up=up, down=down, rest=down))
    assert said.startswith("up and down differ in period, impacts or depth at 4 to 6 N·m "
                           "(judged at all 8 ")
    assert "| 4–6 | 1:(5,0), 100 µrad | engaged | as downwards | " \
        "3 to 4: downwards 1:(5,0), 100 µrad → engaged | " \
        "6 to 7: upwards 1:(5,0), 100 µrad → engaged |" in said


def test_a_jump_of_depth_alone_is_a_jump():
    deep = [(1, 5, 100 + 2 * i) for i in range(8)]
    down = deep[:3] + [(1, 5, 56 + i) for i in range(5)]
    up = deep[:6] + down[6:]
    said = text(made_up(up=up, down=down))
    assert "3 to 4: downwards 1:(5,0), 104 µrad → 1:(5,0), 56 µrad |" in said
    assert "6 to 7: upwards 1:(5,0), 110 µrad → 1:(5,0), 59 µrad |" in said


def test_branches_that_merge_slowly_do_not_jump():
    depths = (110, 107, 104.5, 102.6, 101.5, 100.8, 100.3, 100)
    said = text(made_up(up=[(1, 5, 100)] * 8, down=[(1, 5, depth) for depth in depths]))
    assert said.endswith("| the range ends | 4 to 5: gradual |")


def test_ends_of_the_range():
    said = text(made_up(up=[BOUNCING] * 8, down=[ENGAGED] * 8))
    assert "| 1–8 | 1:(5,0), 100 µrad | engaged | – | the range ends | the range ends |" in said


def test_counts_are_those_of_whole_periods():
    """12 recorded cycles hold no whole number of periods of 5."""
    said = text(made_up(up=[(5, 9, 100)] * 8, down=[ENGAGED] * 8))
    assert "5:(9,0), 100 µrad" in said


def test_a_motion_from_rest_unlike_both():
    rest = [BOUNCING] * 2 + [(2, 9, 80)] * 2 + [BOUNCING] * 4
    said = text(made_up(up=[BOUNCING] * 8, down=[BOUNCING] * 8, rest=rest))
    assert said == ("none seen: up and down agree in period, impacts and depth; from rest a motion "
                    "unlike both, which agree, at 3 to 4 N·m (judged at all 8 values from 1 to "
                    "8 N·m)")


def test_failed_points_are_not_compared():
    sweep = made_up(up=[BOUNCING] * 8, down=[BOUNCING] * 3 + [ENGAGED] * 5)
    sweep["status"][0, 3:] = Status.TOO_MANY_EVENTS
    assert text(sweep) == ("none seen: up and down agree in period, impacts and depth (judged at 3 "
                           "of 8 values; 5 without a result of both)")


def test_branches_with_no_value_in_common_are_not_judged():
    sweep = made_up(up=[BOUNCING] * 8, down=[BOUNCING] * 3 + [ENGAGED] * 5)
    sweep["status"][0, 3:] = Status.UNFINISHED
    sweep["status"][1, :3] = Status.UNFINISHED
    assert text(sweep) == "not known (0 values in common)"


def test_motions_without_a_period_are_not_said_to_agree():
    sweep = made_up(up=[(0, 0, 100)] * 8, down=[(0, 0, 90)] * 8)
    assert text(sweep) == "not known (8 values in common, all of motions without a period)"


def test_a_jump_out_of_what_is_known_is_not_named():
    """What follows an interval was never reached by one of the branches."""
    sweep = made_up(up=[BOUNCING] * 8, down=[BOUNCING] * 3 + [ENGAGED] * 5)
    sweep["status"][0, 6:] = Status.UNFINISHED
    said = text(sweep)
    assert "| 4–6 |" in said and said.endswith("| not known (no result of both at 7) |")
    sweep["status"][0, 4] = Status.TOO_MANY_STEPS
    assert "at 2 single values (" in text(sweep)


def test_a_tooth_on_the_coast_flank_is_not_engaged():
    sweep = made_up(up=[BOUNCING] * 8, down=[ENGAGED] * 8)
    sweep["states_visited"][1] = 4
    assert "| 1–8 | 1:(5,0), 100 µrad | on the coast flank |" in text(sweep)


def test_without_restitution_engagements_are_compared():
    sweep = made_up(up=[BOUNCING] * 8, down=[BOUNCING] * 8)
    sweep = sweep.rename(counted_impacts="engages", counted_back_impacts="back_engages")
    sweep.attrs["contact_law"] = "compliant"
    sweep["engages"][1] = 0
    assert text(sweep).startswith("up and down differ in period, engagements or depth at 1 to 8 ")
    assert "1:(5,0), 100 µrad | 1:(0,0), 100 µrad" in text(sweep)


@pytest.fixture(scope="module")
def shipped():
    sweep = lapwing.sweep(PAIR, SHIPPED, values=np.linspace(11.7, 12.7, 11), settle=60, record=10,
                          pinion_speed_rpm=240, impact_law="absolute")
    return sweep.assign_attrs(parameter="brake_torque")


def test_rattling_survives_upwards_and_engagement_downwards(shipped):
    said = text(shipped)
    row = next(line for line in said.splitlines() if re.match(r"\| (11\.9|12)–12\.[34] ", line))
    lower, upper = row.split(" | ")[4:]
    assert re.match(r"11\.[89] to (11\.9|12): downwards .* → ", lower)
    assert re.match(r"12\.[34] to 12\.[45]: upwards .* → engaged", upper)
