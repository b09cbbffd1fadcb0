"""What a console and a notebook show of each object: a line of bounded length, a table of facts."""

import pytest

import lapwing
from helpers import PAIR, SHIPPED, scene_a

MOST_CHARACTERS = 400


def _orbit():
    return lapwing.find_orbit(scene_a(5.5), settle=100)


MADE = {
    "TransmissionError": lambda: SHIPPED,
    "series": lambda: lapwing.TransmissionError.harmonic([1e-4] * 30),
    "GearPair": lambda: PAIR,
    "Oscillator": lambda: scene_a(3.3),
    "Run": lambda: lapwing.simulate(scene_a(3.3), cycles=30),
    "Orbit": _orbit,
    "critical value": lambda: lapwing.critical_full(PAIR, SHIPPED, pinion_speed_rpm=240),
}


@pytest.mark.parametrize("what", MADE)
def test_it_is_shown_in_a_line_and_in_a_table(what):
    shown = MADE[what]()
    assert len(repr(shown)) <= MOST_CHARACTERS and "\n" not in repr(shown)
    table = shown._repr_html_()
    assert table.count("<tr>") == table.count("</tr>") >= 3
    assert len(table) <= 4000


def test_the_numbers_shown_are_those_of_the_object():
    assert f"peak to peak: {SHIPPED.peak_to_peak:.6g} rad" in repr(SHIPPED)
    orbit = _orbit()
    assert f"mesh cycles: {orbit.cycles}" in repr(orbit)
    assert f"{orbit.state[1]:.6g} rad" in orbit._repr_html_()
    run = lapwing.simulate(scene_a(3.3), cycles=30)
    assert f"events: {len(run.events.tau)}" in repr(run)


def test_what_is_shown_is_no_markup_of_its_own():
    from lapwing.base.messages import facts_html

    assert "<script" not in facts_html("<script>", {"a<script>": "<script>"})
