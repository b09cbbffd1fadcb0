"""Sums, multiples and shifts of transmission errors, against the values themselves."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from helpers import EPS, SHIPPED
from lapwing import TransmissionError

PARABOLA = TransmissionError.parabola(1e-4)
SERIES = TransmissionError.harmonic([2e-5, 3e-6], [0.3, 1.0], [1, 3])
PHASES = np.linspace(0, 1, 401, endpoint=False) + 1e-3


def agree(one, values, slopes, size):
    """Values to rounding of the coefficients; slopes of narrow pieces lose digits to their width.

    Each of 6 powers is rounded a few times: 64 eps of the size, over the narrowest piece once for
    the slope.
    """
    narrow = np.diff(one.knots).min()
    assert np.abs(one.value(PHASES) - values).max() <= 64 * EPS * size
    assert np.abs(one.slope(PHASES) - slopes).max() <= 64 * EPS * size / narrow


@pytest.mark.parametrize("te", [PARABOLA, SHIPPED, SERIES])
@pytest.mark.parametrize("factor", [2, -0.5, np.float64(3)])
def test_a_multiple_is_every_value_times_the_number(te, factor):
    for made in (te * factor, factor * te):
        assert np.abs(made.value(PHASES) - factor * te.value(PHASES)).max() \
            <= 16 * EPS * abs(factor) * np.abs(te.value(PHASES)).max()
        assert made.kinks.tolist() == te.kinks.tolist() and len(made.harmonics) == len(te.harmonics)
    assert (-te).value(0.3) == -te.value(0.3)


@pytest.mark.parametrize("one", [PARABOLA, SHIPPED, SERIES])
@pytest.mark.parametrize("other", [PARABOLA, SHIPPED, SERIES])
def test_a_sum_is_the_sum_of_the_values(one, other):
    both = one + other
    size = np.abs(one.coefficients).max() + np.abs(other.coefficients).max()
    agree(both, one.value(PHASES) + other.value(PHASES), one.slope(PHASES) + other.slope(PHASES),
          size)
    assert bool(len(both.harmonics)) == (one is SERIES and other is SERIES)
    kinks = {round(float(knot), 12) for te in (one, other) for knot in te.knots[:-1][te.kinks]}
    assert {round(float(knot), 12) for knot in both.knots[:-1][both.kinks]} == kinks


@pytest.mark.parametrize("te", [PARABOLA, SHIPPED, SERIES])
@settings(max_examples=40, deadline=None)
@given(phase=st.one_of(st.floats(-2, 2), st.sampled_from([0.0, 0.25, 0.5, 1.0, -1e-15])))
def test_a_shift_is_the_same_curve_later(te, phase):
    later = te.shifted(phase)
    size = np.abs(te.coefficients).max()
    # A phase is known to eps, and the value with it to eps times the slope.
    blur = 8 * EPS * np.abs(te.slope(PHASES)).max()
    difference = np.abs(later.value(PHASES) - te.value(PHASES - phase))
    assert difference.max() <= 64 * EPS * size + blur
    assert later.kinks.sum() == te.kinks.sum()
    back = later.shifted(-phase)
    assert np.abs(back.value(PHASES) - te.value(PHASES)).max() <= 128 * EPS * size + 2 * blur


def test_a_kink_moves_with_its_curve():
    later = PARABOLA.shifted(0.25)
    assert later.knots.tolist() == [0.0, 0.25, 1.0] and later.kinks.tolist() == [False, True]
    assert later.slope(0.25, "right") == pytest.approx(PARABOLA.slope(0.0, "right"), rel=8 * EPS)


def test_what_is_no_number_is_refused():
    with pytest.raises(TypeError):
        PARABOLA * "2"
    with pytest.raises(TypeError):
        PARABOLA + 1.0
    with pytest.raises(ValueError, match="phase"):
        PARABOLA.shifted(math.nan)
    with pytest.raises(ValueError, match="factor"):
        PARABOLA * math.inf
