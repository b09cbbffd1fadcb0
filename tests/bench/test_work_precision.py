"""The work-precision figure: every method is drawn, named, and told apart."""

import numpy as np
import pytest

from lapwing_bench import work_precision

CURVES = {
    "exact": ([1e-12], [0.5], [0]), "rk4": ([1e-5, 1e-7, 1e-9], [3.0, 4.0, 6.0], [0, 0, 0]),
    "heyoka": ([1e-9, 1e-13], [9.0, 12.0], [1, 0]), "another": ([1e-3, np.inf], [3.1, 9.0], [0, 1]),
    "SciPy RK45": ([np.nan, 1e-6], [900.0, np.nan], [0, 0])}


@pytest.fixture(scope="module")
def axis():
    figure = work_precision.draw([("S9: a scene", CURVES, "error (mesh periods)")])
    return figure.axes[0]


def test_every_measured_method_is_drawn_and_named(axis):
    assert {text.get_text() for text in axis.texts} == {"exact", "rk4", "heyoka", "another"}
    lines = [line for line in axis.lines if line.get_linestyle() != "None"]
    assert sorted(len(line.get_xdata()) for line in lines) == [1, 1, 2, 3]
    assert len({line.get_color() for line in lines}) == 4


def test_settings_that_miss_events_are_hollow(axis):
    hollow = [line for line in axis.lines if line.get_markerfacecolor() == "white"]
    assert [tuple(x) for x in (line.get_xdata() for line in hollow) if len(x)] == [(1e-9,)]


def test_labels_do_not_touch(axis):
    bottom, top = np.log10(axis.get_ylim())
    heights = np.sort([(np.log10(text.xyann[1]) - bottom) / (top - bottom)
                       for text in axis.texts])
    assert np.diff(heights).min() > 0.99 * work_precision.LABEL_GAP
    assert heights[0] > 0 and heights[-1] < 1


def test_nothing_measured_is_said():
    figure = work_precision.draw([("S9", {"rk4": ([np.inf], [1.0], [1])}, "error")])
    assert "nothing measured" in figure.axes[0].texts[0].get_text()
