"""What the summary says of critical values, from small searches and from made-up ones."""

import re

import numpy as np
import pytest
import xarray as xr

import lapwing
from helpers import PAIR, SHIPPED
from lapwing import StartGrid, TransmissionError
from lapwing.base.codes import SearchStage
from lapwing.base.messages import decimals
from lapwing.report.critical import critical_table, critical_text, headline

ABSOLUTE = {"pinion_speed_rpm": 240, "impact_law": "absolute"}
SMALL = {"starts": StartGrid(2, 2, 2), "settle": 40, "record": 20, **ABSOLUTE}


def text(*datasets):
    named = [one.assign_attrs(name=f"n{i}") for i, one in enumerate(datasets)]
    return "\n".join([*critical_table(named), *critical_text(named)])


@pytest.fixture(scope="module")
def full():
    return lapwing.critical_full(PAIR, SHIPPED, **ABSOLUTE)


@pytest.fixture(scope="module")
def safe():
    return lapwing.critical_safe(PAIR, SHIPPED, values=[12, 12.5, 13], resolution=0.1, further=0,
                                 **SMALL)


@pytest.fixture(scope="module")
def back():
    return lapwing.critical_back(PAIR, SHIPPED, values=[0.6, 0.7, 0.9, 1.1], **SMALL)


def test_full_engagement(full):
    said = text(full)
    assert "**T_full = 11.9167454367 N·m** (closed form, to rounding)" in said
    assert "0.951456732" in said and "Other motions may rattle" in said
    assert ("| n0 | contact can be kept above | braking torque (N·m) | 11.9167454367 | rounding |"
            in said)
    assert headline(full) == "contact can be kept above T_full = 11.9167454367 N·m"


def test_the_last_rattling(safe):
    said = text(safe)
    value, bar = map(float, re.search(r"\*\*T_safe = ([\d.]+) ± ([\d.]+) N·m\*\*", said).groups())
    assert value == pytest.approx(safe.estimate, abs=0.1 * bar)
    assert bar == pytest.approx(safe.bar, rel=0.05)
    assert f"at {safe.rattling:g} N·m" in said and f"at {safe.clean:g} N·m" in said
    assert "from rest and 16 starts (2 phases × 2 positions × 2 speeds" in said
    assert "20 mesh cycles after 40" in said and "not covered" in said


@pytest.mark.parametrize(("carried", "died"), [(0, True), (1, False)])
def test_motions_carried_to_the_last_rattling_value_may_have_died(safe, carried, died):
    """A trial of motions carried there from below, made up: none of them rattles, or one does."""
    below = safe.data.isel(trial=[0]).copy(deep=True)
    below["trial_value"][:], below["trial_rattling"][:] = safe.rattling, carried
    below["trial_stage"][:] = SearchStage.CARRIED
    said = text(xr.concat([safe.data, below], "trial", combine_attrs="override"))
    assert ("from below died on the way" in said) == died
    assert "died on the way" not in text(safe)


def test_two_kinds_of_motion_beside_each_other(full, safe):
    assert "Between 11.92 and 12." in text(full, safe)
    assert "Between" not in text(safe)
    assert "Between" not in text(full.assign_attrs(own_operation=1), safe)


def test_rigid_teeth_rest_and_bounce_beside_each_other(safe):
    on = lapwing.critical_on(PAIR, SHIPPED, contact_law="rigid", pinion_speed_rpm=240)
    assert "Between 6.148 and 12." in text(on, safe)


def test_no_motion_but_engagement(full, safe):
    assert "agrees with T_full within its bar" in text(
        full, safe.assign_attrs(estimate=full.estimate + 0.004, bar=0.005))


def test_the_last_back_impact(back):
    said = text(back)
    assert "**last back impact seen at 0.7 N·m**" in said
    assert "none at the 2 values examined from 0.9 to 1.1 N·m, 680 cycles in all" in said
    # -ln 0.05/340
    assert "begins, if at all, less often than once in 113 mesh cycles, with 95 %" in said
    assert re.search(r"\(\d+ of 340 mesh cycles, in \d+ bursts?\)", said)
    assert "±" not in headline(back)
    assert headline(back) == ("last back impact seen at 0.7 N·m; none at the 2 values examined "
                              "from 0.9 to 1.1 N·m")
    assert "at every value of the grid between" in said


def test_bands_are_told(back):
    more = back.isel(trial=[0, 1, 2, 3, 3]).copy(deep=True)
    more["trial_value"][:] = [1.1, 0.9, 0.7, 0.6, 0.5]
    more["trial_back_cycles"][3] = 0
    said = text(more)
    assert "**Not one threshold:** back impacts come in 2 bands of the grid, 0.5, 0.7 N·m" in said


def test_failures_are_told(safe):
    failing = safe.copy(deep=True)
    failing["trial_failed"][0] = 3
    assert "**3 motions failed numerically; no value with one is taken as safe.**" in text(failing)
    assert "failed" not in text(safe)


def test_a_transient_is_told(safe):
    fading = safe.copy(deep=True)
    at = np.flatnonzero(fading["trial_stage"].values == SearchStage.CONFIRMATION)
    fading["trial_rattling"][at] = 0
    assert "there, rattling is a long transient" in text(fading)
    assert "transient" not in text(safe)


def test_ends_of_the_range():
    above = lapwing.critical_safe(PAIR, SHIPPED, values=[13, 13.5], **SMALL)
    assert "**none between 13.5 and 13 N·m**: no motion rattles at all 2 values" in text(above)
    below = lapwing.critical_safe(PAIR, SHIPPED, values=[11, 11.5], **SMALL)
    assert "**beyond 11.5 N·m**: already at this value" in text(below)
    assert headline(below) == "T_safe: not found: beyond 11.5, if any"


@pytest.mark.parametrize(("amplitude", "words"), [
    (5e-5, "throws the tooth off"), (-5e-5, "strikes the resting tooth")])
def test_no_torque_keeps_a_rigid_tooth_on_a_kink(amplitude, words):
    found = lapwing.critical_on(PAIR, TransmissionError.parabola(amplitude), contact_law="rigid",
                                pinion_speed_rpm=240)
    said = text(found)
    assert f"**none**: at mesh phase 0 the transmission error has a kink that {words}" in said


def test_another_parameter_names_itself():
    found = lapwing.critical_full(PAIR, SHIPPED, parameter="pinion_speed_rpm", brake_torque=12,
                                  values=np.arange(100, 401, 50), safe_end="low")
    said = text(found)
    assert re.search(r"\*\*pinion speed = 240\.\d+ rpm\*\* \(scan of 7 values from 100", said)
    assert "below it contact *can* be kept, by the engaged motion; just above it" in said


@pytest.mark.parametrize(("value", "bar", "shown"), [
    (12.4375, 0.0125, ("12.438", "0.013")), (12.4, 0.25, ("12.40", "0.25")), (1234.0, 20.0,
                                                                            ("1234", "20"))])
def test_digits_follow_the_bar(value, bar, shown):
    assert decimals(value, bar) == shown
