"""One spelling in the API: the same words everywhere, old ones with a warning."""

import math
import re
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


def test_a_warning_points_at_the_call():
    with pytest.warns(DeprecationWarning) as heard:
        lapwing.simulate(scene_a(3.3), cycles=1, record=())
    assert heard[0].filename == __file__


CALLS = {
    "oscillator": (lambda: PAIR.oscillator(SHIPPED, torque=1.8, pinion_rpm=240),
                   ["'torque' is unknown, did you mean .*'brake_torque'",
                    r"'pinion_rpm' is unknown, did you mean 'pinion_speed_rpm'\?",
                    "brake_torque is missing, expected: braking torque on the gear, N·m",
                    "one of pinion_speed_rpm, .* is missing"]),
    "sweep": (lambda: lapwing.sweep(PAIR, SHIPPED, torque=[1.0], pinion_speed_rpm=240),
              ["'torque' is unknown, did you mean .*'brake_torque'", "values is missing$"]),
    "a sweep of something else": (
        lambda: lapwing.sweep(PAIR, SHIPPED, parameter="backlash", values=[1e-3],
                              pinion_speed_rpm=240), ["oscillator: brake_torque is missing"]),
    "a sweep with more wrong": (
        lambda: lapwing.sweep(PAIR, SHIPPED, parameter="backlash", values=[1e-3], speed=240),
        ["'speed' is unknown, did you mean 'pinion_speed_rpm'", "brake_torque is missing",
         "one of pinion_speed_rpm"]),
    "a map of speeds": (
        lambda: lapwing.parameter_map(PAIR, SHIPPED, {
            "backlash": [1e-3], "pinion_speed_rpm": [240.0]}),
        ["oscillator: brake_torque is missing, expected: braking torque on the gear, N·m$"]),
    "find_orbit": (lambda: lapwing.find_orbit(scene_a(3.3), torqe=1),
                   ["find_orbit: 'torqe' is unknown, known are osc, start, cycles, settle"]),
    "by position": (lambda: lapwing.sweep(PAIR, SHIPPED, [1.0], pinion_speed_rpm=240),
                    [r"3 arguments without a name, expected at most 2 \(pair, te\)",
                     "values is missing"]),
    "twice": (lambda: lapwing.simulate(scene_a(3.3), osc=scene_a(3.3)), ["osc is given twice"]),
    "class": (lambda: lapwing.Numerics(rtoll=1e-6), ["Numerics: 'rtoll' .* did you mean 'rtol'"]),
    "history": (lambda: lapwing.simulate(scene_a(3.3), cycles=1).history(tau=[0.0]),
                ["history: 'tau' is unknown, did you mean 'taus'", "taus is missing"]),
    "table": (lambda: lapwing.simulate(scene_a(3.3), cycles=1).events.lapwing.table(unit=True),
              ["table: 'unit' is unknown, did you mean 'units'"]),
    "factory": (lambda: lapwing.TransmissionError.harmonic(amplitude=[1e-5]),
                ["did you mean 'amplitudes'", "amplitudes is missing"]),
}


@pytest.mark.parametrize("what", CALLS)
def test_wrong_names_are_answered_all_at_once(what):
    call, said = CALLS[what]
    with pytest.raises(lapwing.ArgumentError) as refused:
        call()
    assert isinstance(refused.value, TypeError)
    assert len(refused.value.problems) == len(said)
    for pattern in said:
        assert re.search(pattern, str(refused.value))


def test_what_is_varied_is_not_given_beside():
    for find in (lapwing.sweep, lapwing.critical_safe):
        with pytest.raises(ValueError, match=r"brake_torque = 3\.3, expected none beside"):
            find(PAIR, SHIPPED, values=[1e-3, 2e-3], brake_torque=3.3, pinion_speed_rpm=240)


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
