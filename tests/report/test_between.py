"""What happens in between is told by motions that stand for many; so is what a source reports."""

import re

import numpy as np
import pytest
from test_hysteresis import BOUNCING, ENGAGED, made_up

from lapwing import Status
from lapwing.report.answers.between import of_sweep
from lapwing.report.answers.source import against_source

WILD = (0, 0, 400)


def along_torque(**branches):
    """A made-up sweep along the braking torque, 1 to 8 N·m."""
    sweep = made_up(**branches).rename(torque="brake_torque")
    return sweep.assign(force=("brake_torque", np.ones(8))).assign_attrs(parameter="brake_torque")


def test_each_part_is_told_by_its_commonest_motion():
    outlier = (1, 9, 5)
    sweep = along_torque(rest=[WILD, WILD, (1, 3, 300), BOUNCING, outlier, (1, 6, 90),
                               (1, 7, 60), (1, 7, 70)])
    def motion(n, depth):
        return f"with {n} impacts per mesh cycle and {depth} µrad of separation; "

    assert of_sweep(sweep, None, 8.0) == (
        "**Where the teeth part**, each from rest: "
        f"from 1 to 3 N·m 67 % have no period, as at 1 N·m {motion(0, 400)}"
        f"from 4 to 6 N·m all have period 1, as at 6 N·m {motion(6, 90)}"
        f"from 7 to 8 N·m all have period 1, as at 7 N·m {motion(7, 60)}"
        "no period at 2 of 8 torques, the highest 2 N·m.")


def test_the_range_ends_at_the_last_back_impact_and_the_last_separation():
    sweep = along_torque(rest=[WILD] * 5 + [BOUNCING] * 2 + [ENGAGED])
    said = of_sweep(sweep, 5.0, 7.0)
    motion = "5 impacts per mesh cycle and 100 µrad of separation (period 1)"
    assert said == (f"**In between**, each from rest: at 6 N·m {motion}; at 7 N·m {motion}; every "
                    "motion has a period.")
    assert of_sweep(sweep, 7.0, 7.5) == ""
    # What has no result stands for nothing.
    sweep["status"][0, 6] = Status.UNFINISHED
    assert "at 7 N·m" not in of_sweep(sweep, 5.0, 7.0)


@pytest.mark.parametrize(("count", "told"), [(2, False), (3, True), (5, True)])
def test_a_motion_beside_is_told_where_it_lives_at_neighbours(count, told):
    up = [BOUNCING] * 2 + [(1, 1, 800)] * count + [BOUNCING] * (6 - count)
    said = of_sweep(along_torque(rest=[BOUNCING] * 8, up=up, down=[BOUNCING] * 8), None, 8.0)
    assert said.startswith("**Where the torque is raised step by step (carried upwards) other "
                           "motions live** than from rest at ") == told
    if told:
        assert (f"at {100 * count / 8:.0f} % of the torques at which the teeth part (3 to "
                f"{2 + count} N·m): at ") in said
        assert "800 µrad deep instead of 100. **Where the teeth part**" in said


@pytest.mark.parametrize(("depths", "rise"), [
    ([80, 70, 60, 50, 40, 30, 20, 10], ""),
    ([80, 70, 60, 10, 60, 30, 20, 10], ""),  # a single motion is no hollow
    ([80, 40, 20, 10, 10, 30, 30, 5], "10 µrad near 4 N·m to 30 µrad near 6 N·m"),
    ([900, 10, 10, 900, 900, 20, 10, 10], "10 µrad near 2 N·m to 900 µrad near 4 N·m")])
def test_a_hump_is_told(depths, rise):
    said = of_sweep(along_torque(rest=[(1, 5, depth) for depth in depths]), None, 8.0)
    assert ("**More torque is not always better**: separation rises from " in said) == bool(rise)
    assert rise in said


def response(torque, impacts, depth, **attrs):
    """A response as far as it is compared."""
    import xarray as xr

    return xr.Dataset(attrs={"status": 0, "start": "rest", "brake_torque": torque,
                             "impacts_per_cycle": impacts, "deepest_separation": 1e-6 * depth,
                             **attrs})


def test_what_a_source_reports_is_compared():
    claims = [response(1.8, 3.0, 610, claim_impacts_per_cycle=3.0, claim_deepest_separation=630e-6),
              response(3.3, 4.0, 320, claim_impacts_per_cycle=5.0, claim_deepest_separation=320e-6),
              response(5.5, 7.0, 237, claim_impacts_per_cycle=7.0, claim_deepest_separation=170e-6),
              response(12.0, 0.0, 0, claim_deepest_separation=0.0), response(13.0, 0.0, 0)]
    assert against_source(claims, 12.41, "12.41") == (
        "**Against the source**: impacts per mesh cycle as reported at 1.8 and 5.5 N·m; 4 impacts "
        "per mesh cycle at 3.3 N·m where 5 are reported; separation within 3.2 % of the reported "
        "at 1.8 and 3.3 N·m; 237 µrad at 5.5 N·m where 170 are reported (+39 %); no separation at "
        "12 N·m as reported, but from rest only: other motions rattle up to 12.41 N·m.")
    assert "12 N·m as reported (from rest)." in against_source(claims, None, "")
    parted = [claims[3].assign_attrs(deepest_separation=4e-5)]
    assert against_source(parted, 12.41, "12.41").endswith(
        ": 40 µrad of separation at 12 N·m where none is reported.")
    assert against_source([claims[4], claims[0].assign_attrs(status=3)], None, "") == ""


@pytest.mark.parametrize("depth", [609.66, 610, 614.25, 629.99, 632.1, 660])
def test_the_bound_told_of_a_depth_holds(depth):
    said = against_source([response(1.8, 3.0, depth, claim_deepest_separation=630e-6)], None, "")
    told = float(re.search(r"within ([\d.]+) % of the reported", said)[1])
    assert told - 0.1 < 100 * abs(depth / 630 - 1) <= told + 1e-9
