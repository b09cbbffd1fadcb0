"""One spelling in the API: the same words everywhere, old ones with a warning."""

import math
import warnings

import numpy as np
import pytest

import lapwing
from helpers import PAIR, SHIPPED, scene_a

SHORT = {"settle": 20, "record": 10}


def test_old_names_are_heard_with_a_warning():
    with pytest.warns(DeprecationWarning, match="record is called observe"):
        old = lapwing.simulate(scene_a(3.3), cycles=3, record=("events",))
    new = lapwing.simulate(scene_a(3.3), cycles=3, observe=("events",))
    assert old.events.identical(new.events)
    with pytest.warns(DeprecationWarning, match="settle_cycles is called settle"):
        old = lapwing.response(scene_a(3.3), PAIR, name="x", settle_cycles=20, record_cycles=10)
    assert old.identical(lapwing.response(scene_a(3.3), PAIR, name="x", **SHORT))
    with pytest.raises(TypeError, match="unexpected keyword argument 'recrod'"):
        lapwing.simulate(scene_a(3.3), recrod=())


def test_numerics_say_the_same_as_single_settings():
    numerics = lapwing.Numerics(method="rk4", rtol=1e-7)
    one = lapwing.simulate(scene_a(3.3), cycles=5, numerics=numerics)
    other = lapwing.simulate(scene_a(3.3), cycles=5, method="rk4", rtol=1e-7)
    assert one.events.identical(other.events)
    swept = [lapwing.sweep(PAIR, SHIPPED, values=[3.3], pinion_speed_rpm=240, **SHORT, **how)
             for how in ({"numerics": numerics}, {"method": "rk4", "rtol": 1e-7})]
    assert swept[0].identical(swept[1])
    with pytest.raises(ValueError, match="numerics and rtol are both given"):
        lapwing.simulate(scene_a(3.3), rtol=1e-7, numerics=numerics)


def test_a_critical_value_is_a_number_with_its_interval():
    full = lapwing.critical_full(PAIR, SHIPPED, pinion_speed_rpm=240)
    assert float(full) == full.value == full.low == full.high == full.attrs["estimate"]
    assert "found" not in repr(full) and f"{full.value:.12g} N m" in repr(full)
    safe = lapwing.critical_safe(PAIR, SHIPPED, values=[11.0, 14.0], resolution=0.5,
                                 starts=lapwing.StartGrid(1, 1, 1), pinion_speed_rpm=240, **SHORT)
    assert sorted((safe.attrs["rattling"], safe.attrs["clean"])) == [safe.low, safe.high]
    assert safe.low < safe.value < safe.high and "trial_value" in safe
    none = lapwing.critical_safe(PAIR, SHIPPED, values=[13.0, 14.0], resolution=0.5,
                                 starts=lapwing.StartGrid(1, 1, 1), pinion_speed_rpm=240, **SHORT)
    assert none.outcome == "safe_throughout" and math.isnan(none.low)
    assert "safe_throughout" in repr(none)


def test_an_orbit_is_found_from_rest():
    orbit = lapwing.find_orbit(scene_a(3.3), "rest", 1)
    settled = lapwing.find_orbit(scene_a(3.3), lapwing.settled_state(scene_a(3.3), 400), 1)
    assert orbit.state == settled.state and orbit.multipliers.stable


def test_exponents_of_a_motion_are_those_of_its_orbit():
    """Means over cycles against the multipliers of Newton's orbit; a transient dies out."""
    osc = scene_a(3.3)
    orbit = lapwing.find_orbit(osc, "rest", 1)
    found = lapwing.exponents(osc, settle=400, record=400)
    # The deviation turns with a complex pair: its mean is off by ln(axes ratio)/cycles or so.
    assert found.largest == pytest.approx(orbit.multipliers.exponents[0],
                                          abs=5 / (300 * osc.period))
    assert found.largest + found.second == pytest.approx(
        float(np.sum(orbit.multipliers.exponents)), rel=1e-6)


def test_what_can_be_varied_is_listed():
    with pytest.raises(ValueError, match=r"parameter = 'torque'.*'brake_torque'.*"
                                         "'mesh_frequency_hz'"):
        lapwing.sweep(PAIR, SHIPPED, parameter="torque", values=[1.0], pinion_speed_rpm=240)


def test_nothing_here_warns():
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for name in lapwing.__all__:
            getattr(lapwing, name)
