"""What a console and a notebook show of each object: a line of bounded length, a table of facts."""

import math
from dataclasses import replace

import pytest

import lapwing
from helpers import PAIR, SHIPPED, scene_a

MOST_CHARACTERS = 400
FEW = {"starts": lapwing.StartGrid(1, 1, 1), "settle": 20, "record": 5, "pinion_speed_rpm": 240}


def _orbit():
    return lapwing.find_orbit(scene_a(5.5), settle=100)


MADE = {
    "TransmissionError": lambda: SHIPPED,
    "series": lambda: lapwing.TransmissionError.harmonic([1e-4] * 30),
    "GearPair": lambda: PAIR,
    "Oscillator": lambda: scene_a(3.3),
    "Run": lambda: lapwing.simulate(scene_a(3.3), cycles=30),
    "Orbit": _orbit,
    "Multipliers": lambda: _orbit().multipliers,
    "Exponents": lambda: lapwing.exponents(scene_a(3.3), settle=10, record=20),
    "critical value": lambda: lapwing.critical_full(PAIR, SHIPPED, pinion_speed_rpm=240),
}


@pytest.mark.parametrize("what", MADE)
def test_it_is_shown_in_a_line_and_in_a_table(what):
    shown = MADE[what]()
    assert len(repr(shown)) <= MOST_CHARACTERS and "\n" not in repr(shown)
    table = shown._repr_html_()
    assert table.count("<tr>") == table.count("</tr>") >= 3
    assert len(table) <= 4000


NONE_FOUND = {
    "nothing rattles at any of 2 values from 14 to 13 N m": lambda: lapwing.critical_safe(
        PAIR, SHIPPED, values=[13.0, 14.0], **FEW),
    "motions rattle at 3 N m already": lambda: lapwing.critical_safe(
        PAIR, SHIPPED, values=[2.0, 3.0], **FEW),
    "motions fail numerically at 3 N m already": lambda: lapwing.critical_safe(
        PAIR, SHIPPED, values=[2.0, 3.0], **FEW, numerics=lapwing.Numerics(max_steps_per_cycle=1,
                                                                           method="rk4")),
    "no back impact is seen at any of 1 values": lambda: lapwing.critical_back(
        PAIR, SHIPPED, values=[14.0], **FEW),
    "contact is lost at 210 rpm already": lambda: lapwing.critical_full(
        PAIR, SHIPPED, parameter="pinion_speed_rpm", values=[200.0, 210.0], brake_torque=3.0),
    "undamped resonance": lambda: lapwing.critical_full(
        replace(PAIR, damping_ratio=0.0), SHIPPED,
        mesh_frequency_hz=PAIR.natural_frequency / (2 * math.pi)),
    "a kink at mesh phase 0 throws the tooth off": lambda: lapwing.critical_on(
        PAIR, lapwing.TransmissionError.parabola(1e-5), pinion_speed_rpm=240,
        contact_law="rigid"),
}


@pytest.mark.parametrize("why", NONE_FOUND)
def test_a_critical_value_that_is_none_says_why(why):
    found = NONE_FOUND[why]()
    assert math.isnan(float(found)) and why in found.why
    assert why in repr(found) and why in found._repr_html_() and found.outcome in repr(found)


def test_the_numbers_shown_are_those_of_the_object():
    assert f"peak to peak: {SHIPPED.peak_to_peak:.6g} rad" in repr(SHIPPED)
    orbit = _orbit()
    assert f"mesh cycles: {orbit.cycles}" in repr(orbit)
    assert f"{orbit.state[1]:.6g} rad" in orbit._repr_html_()
    run = lapwing.simulate(scene_a(3.3), cycles=30)
    assert f"events: {len(run.events.tau)}" in repr(run)


def test_a_critical_value_is_written_as_its_number():
    found = lapwing.critical_full(PAIR, SHIPPED, pinion_speed_rpm=240)
    assert f"{found:.3f}" == f"{found.value:.3f}" and f"{found}" == repr(found)
    with pytest.raises(AttributeError, match=r"has no 'vlue', did you mean 'value'\?"):
        found.vlue  # noqa: B018


def test_what_is_not_known_of_an_exponent_is_said():
    known = lapwing.exponents(scene_a(1.8), settle=10, record=400)
    assert "±" in repr(known) and "320 mesh cycles" in repr(known)
    assert "of unknown error" in repr(lapwing.exponents(scene_a(3.3), settle=0, record=2))


def test_what_is_shown_is_no_markup_of_its_own():
    from lapwing.base.messages import facts_html

    assert "<script" not in facts_html("<script>", {"a<script>": "<script>"})
