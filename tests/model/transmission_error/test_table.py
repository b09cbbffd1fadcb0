"""Transmission-error tables: constructors, one-sided derivatives, extrema, files."""

import math
import pickle
from dataclasses import FrozenInstanceError
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.interpolate import CubicSpline, PPoly

from lapwing.model.harmonic_series import harmonic_derivative
from lapwing.model.transmission_error import TransmissionError
from lapwing.model.transmission_error.extrema import stationary_points
from lapwing.model.transmission_error.file import ANGLE_UNITS, TransmissionErrorFileError

SHIPPED = Path(__file__).parents[3] / "inputs" / "te_25x32.csv"
EPS = np.finfo(float).eps


@st.composite
def hermite_rows(draw, least=1, most=6):
    """Rows at least 0.02 apart with values and slopes of order one, some of them kinks."""
    n = draw(st.integers(least, most))
    cells = sorted(draw(st.sets(st.integers(0, 48), min_size=n, max_size=n)))
    unit = st.floats(-1, 1, allow_subnormal=False)
    row = st.lists(unit, min_size=n, max_size=n)
    left = draw(row)
    right = [draw(st.sampled_from([x, x + 0.5])) for x in left]
    return np.array(cells) / 50 + 0.01, np.array(draw(row)), np.array(left), np.array(right)


# --- the table itself -------------------------------------------------------------------------


def test_shipped_file_holds_four_exact_parabolas():
    table = TransmissionError.from_file(SHIPPED)
    assert table.knots.tolist() == [0.0, 0.03, 0.85, 0.915, 1.0]
    assert not table.kinks.any() and not table.slope_jumps().any()
    # The rows are consistent to the last printed digit, so the cubic term is rounding: values and
    # slopes of 1e-4 and 3e-3 divided by the width cubed, a few EPS each.
    width = np.diff(table.knots)
    assert np.all(np.abs(table.coefficients[:, 3]) < 32 * EPS * 3.4e-3 / width**2)
    assert np.all(table.coefficients[:, 4:] == 0)
    # Extremum of an arc v + s x + c x²: v - s²/4c, from the printed rows.
    curve = (9.70e-4 + 9.10e-4) / 0.82
    high = 6.525e-5 + 9.70e-4**2 / (2 * curve)
    curve = (3.380e-3 + 2.719e-3) / 0.085
    low = -2.80925e-5 - 2.719e-3**2 / (2 * curve)
    assert table.extrema == pytest.approx((low, high), rel=1e-11)
    assert table.peak_to_peak == pytest.approx(350e-6, rel=5e-3)


def test_sides_and_orders_at_a_knot():
    table = TransmissionError.from_hermite([0.0, 0.5], [1.0, 2.0], [3.0, 4.0], [3.5, 4.0])
    assert table.kinks.tolist() == [True, False]
    assert table.slope_jumps() == pytest.approx([0.5, 0.0], abs=8 * EPS)
    assert table.slope(0.0) == 3.5 and table.slope(1.0) == 3.5
    assert table.slope(0.0, "left") == pytest.approx(3.0, rel=16 * EPS)
    assert table.slope(-7.0, side="left") == table.slope(0, "left")
    assert table.curvature(0.5) != table.curvature(0.5, "left")
    assert table.derivative(3, 0.25) == 6 * table.coefficients[0, 3]
    assert table.derivative(6, 0.25) == 0
    assert table.value([[0.0, 0.5], [1.0, 1.5]]).tolist() == [[1.0, 2.0], [1.0, 2.0]]
    assert table.value(-1e-20) == 1.0  # phase mod 1 rounds to 1 here


def test_a_cubic_term_of_rounding_size_hides_no_extremum():
    # 0 + t - t² + 1e-19 t³: top at 1/2.
    at = stationary_points(np.array([0.0, 1.0, -1.0, 1e-19, 0.0, 0.0]))
    assert np.abs(at - 0.5).min() < 8 * EPS
    assert stationary_points(np.zeros(6)).tolist() == [0.0, 1.0]


def test_bad_arguments_of_the_methods():
    table = TransmissionError.parabola(1.0)
    for call in (lambda: table.slope(0.1, "up"), lambda: table.value(math.nan),
                 lambda: table.value([0.0, math.inf]), lambda: table.derivative(-1, 0.0)):
        with pytest.raises(ValueError):
            call()


def test_tables_do_not_change():
    table = TransmissionError.harmonic([1e-5])
    for owner in (table, pickle.loads(pickle.dumps(table))):
        for array in (owner.knots, owner.coefficients, owner.kinks, owner.harmonics):
            with pytest.raises(ValueError):
                array[0] = 0
    with pytest.raises(FrozenInstanceError):
        table.knots = table.knots


@pytest.mark.parametrize(("knots", "rows", "kinks", "message"), [
    ([0, 1], np.zeros((2, 6)), [False], "shapes"),
    ([0, 1], np.zeros((1, 5)), [False], "shapes"),
    ([0.1, 1], np.zeros((1, 6)), [False], "0 to 1"),
    ([0, 0.5, 0.5, 1], np.zeros((3, 6)), [False] * 3, "ascend"),
    ([0, 1], np.full((1, 6), math.nan), [False], "finite"),
    ([0, 1], [[0, 1, 0, 0, 0, 0]], [True], "value jumps"),
    ([0, 1], [[0, 1, -1, 0, 0, 0]], [False], "not marked"),
])
def test_inconsistent_tables_are_refused(knots, rows, kinks, message):
    with pytest.raises(ValueError, match=message):
        TransmissionError(knots, rows, kinks)


@given(hermite_rows())
@settings(deadline=None)
def test_hermite_rows_come_back(rows):
    phase, value, left, right = rows
    table = TransmissionError.from_hermite(phase, value, left, right)
    assert table.knots[0] == 0 and table.knots[-1] == 1
    # Narrowest piece 0.02: coefficients up to 6/0.02³ cancel to values of order 1; in units of
    # w^k they stay below 10, so values are good to about 100 EPS, slopes to 100 EPS/0.02.
    assert np.allclose(table.value(phase), value, rtol=0, atol=100 * EPS)
    assert np.allclose(table.slope(phase), right, rtol=0, atol=100 * EPS / 0.02)
    assert np.allclose(table.slope(phase, "left"), left, rtol=0, atol=100 * EPS / 0.02)
    assert np.array_equal(table.kinks[-phase.size:], left != right)
    if phase[0] > 0:
        assert not table.kinks[0]


@given(hermite_rows(), st.integers(1, 49))
@settings(deadline=None)
def test_start_of_the_period_does_not_matter(rows, cells):
    """Rows renumbered from another origin give the same curve, wherever phase 0 cuts a piece."""
    phase, value, left, right = rows
    moved = np.round(phase * 100 + 2 * cells) % 100 / 100
    order = np.argsort(moved)
    here = TransmissionError.from_hermite(phase, value, left, right)
    there = TransmissionError.from_hermite(moved[order], value[order], left[order], right[order])
    at = np.arange(0.0035, 1, 0.0071)
    # As above; in addition the phases round by EPS, slopes are below 10/0.02.
    tolerance = 100 * EPS + 500 * 4 * EPS
    assert np.allclose(there.value(at + cells / 50), here.value(at), rtol=0, atol=tolerance)


@given(hermite_rows())
@settings(max_examples=50, deadline=None)
def test_extrema_bound_a_dense_sample(rows):
    table = TransmissionError.from_hermite(*rows)
    low, high = table.extrema
    sample = table.value(np.arange(20_000) / 20_000)
    # A parabola of the steepest curvature misses its top by at most c (h/2)²/2 on a grid h.
    curvature = np.abs(table.curvature(table.knots[:-1])).max() + np.abs(
        table.curvature(table.knots[1:], "left")).max()
    slack = curvature * (1 / 20_000) ** 2 / 8 + 100 * EPS
    assert low - 100 * EPS <= sample.min() <= low + slack
    assert high - slack <= sample.max() <= high + 100 * EPS


def test_parabola():
    table = TransmissionError.parabola(5e-5)
    at = np.linspace(0, 1, 11)[:-1]
    assert np.allclose(table.value(at), -4 * 5e-5 * (at - 0.5) ** 2, rtol=0, atol=8 * EPS * 5e-5)
    assert table.kinks.tolist() == [True]
    assert table.slope_jumps() == pytest.approx([8 * 5e-5], rel=8 * EPS)
    assert table.curvature(0.3) == pytest.approx(-8 * 5e-5, rel=8 * EPS)
    assert table.extrema == pytest.approx((-5e-5, 0), abs=8 * EPS * 5e-5)
    assert not TransmissionError.parabola(0.0).kinks.any()


@pytest.mark.parametrize("rows", [
    ([], [], []), ([0.0, 0.0], [1, 2], [3, 4]), ([0.0, 1.0], [1, 2], [3, 4]),
    ([-0.1], [1], [2]), ([0.0], [1, 2], [3]), ([0.0], [math.nan], [3]), ([[0.0]], [[1]], [[3]])])
def test_bad_rows_are_refused(rows):
    with pytest.raises(ValueError):
        TransmissionError.from_hermite(*rows)


# --- splines through samples ------------------------------------------------------------------


def test_smooth_samples_are_the_periodic_spline():
    phase = np.array([0.1, 0.25, 0.4, 0.7, 0.85])
    value = np.array([1.0, -0.5, 2.0, 0.3, 0.9])
    table = TransmissionError.from_samples(phase, value)
    spline = CubicSpline(np.append(phase, 1.1), np.append(value, 1.0), bc_type="periodic")
    at = np.arange(200) / 200
    for order, scale in ((0, 1), (1, 10), (2, 100)):
        assert np.allclose(table.derivative(order, at), spline(at, order), atol=1e-13 * scale)
        assert np.allclose(table.derivative(order, table.knots[:-1], "left"),
                           table.derivative(order, table.knots[:-1]), atol=1e-12 * scale)
    assert not table.kinks.any()


def test_arcs_between_kinks_see_only_their_own_points():
    phase = np.array([0.05, 0.2, 0.4, 0.5, 0.8])
    value = np.array([0.0, 3.0, 1.0, -1.0, 2.0])
    table = TransmissionError.from_samples(phase, value, [0, 1, 0, 1, 0])
    assert table.kinks.tolist() == [False, False, True, False, True, False]
    # Rows 2 to 4 make an arc of three points: one parabola.
    parabola = np.polyfit(phase[1:4], value[1:4], 2)
    at = np.linspace(0.2, 0.5, 30)[:-1]
    assert np.allclose(table.value(at), np.polyval(parabola, at), atol=1e-12)
    # The arc through phase 0 is one cubic through its four points (not-a-knot).
    cubic = np.polyfit([0.5, 0.8, 1.05, 1.2], [-1.0, 2.0, 0.0, 3.0], 3)
    at = np.concatenate([np.linspace(0.5, 0.99, 20), np.linspace(1.0, 1.19, 20)])
    assert np.allclose(table.value(at), np.polyval(cubic, at), atol=1e-12)


def test_two_kinks_are_a_sawtooth_and_one_kink_an_open_spline():
    saw = TransmissionError.from_samples([0.0, 0.25], [0.0, 1.0], [1, 1])
    assert np.allclose(saw.slope([0.1, 0.6]), [4.0, -4 / 3], rtol=8 * EPS)
    assert saw.slope_jumps() == pytest.approx([16 / 3, -16 / 3], rel=8 * EPS)
    phase = np.arange(8) / 8
    parabola = -4 * (phase - 0.5) ** 2
    table = TransmissionError.from_samples(phase, parabola, phase == 0)
    assert np.allclose(table.curvature(np.arange(50) / 50), -8.0, atol=1e-11)
    assert table.slope_jumps()[0] == pytest.approx(8, rel=1e-12)


@pytest.mark.parametrize(("value", "kinks", "message"), [
    ([1, 2], (), "three rows"), ([1, 2], [0, 2], "0 or 1"), ([1, 2], [1], "equally long")])
def test_bad_samples_are_refused(value, kinks, message):
    with pytest.raises(ValueError, match=message):
        TransmissionError.from_samples([0.0, 0.5], value, kinks)


# --- harmonics --------------------------------------------------------------------------------

SERIES = [([1e-5], [0.0], [1]), ([17e-6, 4.5e-6, 1.5e-6], [0.0, 1.0, 2.0], [1, 2, 3]),
          ([1.0, 0.2], [0.4, -1.0], [0, 7])]


@pytest.mark.parametrize(("amplitudes", "shifts", "orders"), SERIES)
def test_harmonic_table_keeps_its_promise(amplitudes, shifts, orders):
    table = TransmissionError.harmonic(amplitudes, shifts, orders)
    at = (np.arange(40_000) + 0.5) / 40_000
    for k, promise in enumerate((1e-12, 1e-10, 1e-8)):
        exact = sum(a * (2 * np.pi * n) ** k * np.cos(2 * np.pi * n * at + s + k * np.pi / 2)
                    for a, s, n in zip(amplitudes, shifts, orders, strict=True))
        # Rounding comes on top of the remainder: a few EPS of the value over h^k.
        rounding = 30 * EPS * np.abs(amplitudes).sum() * (table.knots.size - 1) ** k
        error = np.abs(table.derivative(k, at) - exact).max()
        assert error <= promise * np.abs(exact).max() + rounding
        assert np.allclose(harmonic_derivative(table.harmonics, k, at), exact,
                           atol=1e-13 * np.abs(exact).max() + rounding)
    assert table.harmonics.tolist() == [list(x) for x in zip(orders, amplitudes, shifts,
                                                             strict=True)]
    assert not table.kinks.any()


@pytest.mark.parametrize(("amplitudes", "shifts", "orders"),
                         [*SERIES, ([1.0, 1e-13, 1e-15], [0.0, 0.5, 1.0], [1, 40, 200])])
def test_the_table_that_is_stepped_over_keeps_its_promise(amplitudes, shifts, orders):
    knots, coefficients = TransmissionError.harmonic(amplitudes, shifts, orders).fine_table
    pieces, at = PPoly(coefficients.T[::-1], knots), (np.arange(40_000) + 0.5) / 40_000
    for k, promise in enumerate((1e-16, 2e-14, 3e-12)):
        exact = sum(a * (2 * np.pi * n) ** k * np.cos(2 * np.pi * n * at + s + k * np.pi / 2)
                    for a, s, n in zip(amplitudes, shifts, orders, strict=True))
        # Rounding of both evaluations comes on top, with no division by the pieces' length.
        assert np.abs(pieces(at, k) - exact).max() <= (promise + 40 * EPS) * np.abs(exact).max()


def test_number_of_harmonic_pieces_is_the_smallest_the_bound_allows():
    # One cosine: value bound (2π)^6 h^6/46080 <= 1e-12 is the sharpest of the three; n = 105.
    n = TransmissionError.harmonic([3e-6], orders=[1]).knots.size - 1
    assert n == 105
    assert (2 * math.pi / n) ** 6 / 46_080 <= 1e-12 < (2 * math.pi / (n - 1)) ** 6 / 46_080
    # The bound is nearly attained at a crest: the measured error is within 5 % of it.
    table = TransmissionError.harmonic([1.0])
    at = (np.arange(n) + 0.5) / n
    error = np.abs(table.value(at) - np.cos(2 * np.pi * at)).max()
    assert error == pytest.approx((2 * math.pi / n) ** 6 / 46_080, rel=0.05)
    assert TransmissionError.harmonic([1.0], orders=[3]).knots.size - 1 in (314, 315)
    assert TransmissionError.harmonic([0.0, 0.0]).knots.size == 2
    assert TransmissionError.harmonic([2.0], orders=[0]).value(0.3) == 2.0


@pytest.mark.parametrize("bad", [
    {"amplitudes": [1.0], "shifts": [0, 0]}, {"amplitudes": [1.0], "orders": [1.5]},
    {"amplitudes": [1.0], "orders": [-1]}, {"amplitudes": [math.inf]}, {"amplitudes": [[1.0]]}])
def test_bad_harmonics_are_refused(bad):
    with pytest.raises(ValueError):
        TransmissionError.harmonic(**bad)


# --- angle pairs ------------------------------------------------------------------------------


def tca_pairs(n=21, last=1.0, reference=(0.3, 0.2)):
    """Angle pairs of a parabola of 100 µrad, vertex at the reference, from transfer on."""
    turn = (np.linspace(0, last, n) - 0.5) * 2 * math.pi / 25
    error = -1e-4 * (turn * 25 / math.pi) ** 2
    return reference[0] + turn, reference[1] + 25 / 32 * turn + error, reference


@pytest.mark.parametrize("drop_last", [True, False])
def test_angle_pairs_give_the_parabola_with_a_kink_at_transfer(drop_last):
    pinion, gear, reference = tca_pairs()
    rows = slice(None, -1) if drop_last else slice(None)
    table = TransmissionError.from_tca(pinion[rows], gear[rows], 25, 32, reference)
    # Angles of 0.4 rad carry 5e-17 of rounding, Δφ is 1e-4: absolute 3e-16, slopes 40 times that.
    at = np.arange(100) / 100
    exact = -4e-4 * ((at + 0.5) % 1 - 0.5) ** 2
    assert np.allclose(table.value(at), exact, rtol=0, atol=1e-15)
    assert table.knots[np.flatnonzero(table.kinks)] == pytest.approx([0.5], abs=1e-14)
    assert table.slope_jumps().max() == pytest.approx(8e-4, abs=1e-13)
    assert table.te_sign_hint == "geometric"


def test_angle_pairs_that_make_no_period_are_refused():
    pinion, gear, reference = tca_pairs(last=1.2)
    with pytest.raises(ValueError, match="more than one mesh period"):
        TransmissionError.from_tca(pinion, gear, 25, 32, reference)
    pinion, gear, reference = tca_pairs()
    gear[-1] += 1e-6
    with pytest.raises(ValueError, match="differ by"):
        TransmissionError.from_tca(pinion, gear, 25, 32, reference)
    for bad in ((pinion[::-1], gear), (pinion[:3], gear), ([0.0], [0.0])):
        with pytest.raises(ValueError, match="ascending"):
            TransmissionError.from_tca(*bad, 25, 32)


# --- files ------------------------------------------------------------------------------------


def read(tmp_path, text, **options):
    path = tmp_path / "te.csv"
    path.write_text(text, encoding="utf-8")
    return TransmissionError.from_file(path, **options)


def same(one, other, rtol=8 * EPS):
    at = np.arange(97) / 97
    return (np.array_equal(one.kinks, other.kinks)
            and np.allclose(one.value(at), other.value(at), rtol=rtol, atol=1e-18))


@pytest.mark.parametrize("unit", ANGLE_UNITS)
def test_units_of_angles(tmp_path, unit):
    factor = ANGLE_UNITS[unit]
    table = read(tmp_path, f"# note\n phase , transmission_error[{unit}],slope[{unit}/period] # x"
                 "\n\n0.1,1,-2\n0.5 , 3 , 4\n")
    expected = TransmissionError.from_hermite(
        [0.1, 0.5], np.array([1.0, 3]) * factor, np.array([-2.0, 4]) * factor)
    assert same(table, expected)
    assert ANGLE_UNITS["arcsec"] * 3600 == pytest.approx(math.radians(1), rel=4 * EPS)


@pytest.mark.parametrize("letter", ["\u00b5", "\u03bc"])
def test_micro_sign_and_greek_letter(tmp_path, letter):
    text = "phase,transmission_error[{0}rad],slope[{0}rad/period]\n0.1,1,-2\n0.5,3,4\n"
    assert same(read(tmp_path, text.format(letter)), read(tmp_path, text.format("u")), 0)


@pytest.mark.parametrize(("unit", "turn"), [("deg", 360 / 25), ("rad", 2 * math.pi / 25)])
def test_phase_in_pinion_rotation(tmp_path, unit, turn):
    text = f"phase[{unit}],transmission_error\n" + "".join(
        f"{x * turn!r},{y}\n" for x, y in ((0.0, 1), (0.25, 2), (0.5, 0)))
    expected = TransmissionError.from_samples([0.0, 0.25, 0.5], [1, 2, 0])
    assert same(read(tmp_path, text, pinion_teeth=25), expected, 64 * EPS)
    with pytest.raises(TransmissionErrorFileError, match=r"line 1, column 1: .*pinion_teeth"):
        read(tmp_path, text)


def test_kink_and_two_slope_columns_in_any_order(tmp_path):
    table = read(tmp_path, "kink,transmission_error[urad],phase\n1,0,0\n0,3,0.4\n1,1,0.8\n")
    assert same(table, TransmissionError.from_samples([0, 0.4, 0.8], [0, 3e-6, 1e-6], [1, 0, 1]))
    table = read(tmp_path, "slope_right,slope_left,transmission_error,phase\n"
                 "4,-4,-1,0\n0,0,0,0.5\n")
    assert same(table, TransmissionError.from_hermite([0, 0.5], [-1, 0], [-4, 0], [4, 0]))
    assert table.kinks.tolist() == [True, False]


def test_angle_pairs_from_a_file(tmp_path):
    pinion, gear, reference = tca_pairs()
    text = "pinion_angle[deg],gear_angle\n" + "".join(
        f"{math.degrees(a):.17g},{b:.17g}\n" for a, b in zip(pinion, gear, strict=True))
    options = {"pinion_teeth": 25, "gear_teeth": 32, "reference": reference}
    table = read(tmp_path, text, **options)
    at = np.arange(50) / 50
    expected = TransmissionError.from_tca(pinion, gear, 25, 32, reference)
    # Degrees to radians rounds the pinion angle by 1e-16, hence Δφ.
    assert np.allclose(table.value(at), expected.value(at), rtol=0, atol=2e-15)
    assert table.te_sign_hint == "geometric"
    with pytest.raises(TransmissionErrorFileError, match="need pinion_teeth and gear_teeth"):
        read(tmp_path, text, pinion_teeth=25)


@pytest.mark.parametrize(("text", "problems"), [
    ("", [(0, 0, "no data")]),
    ("# only\nphase,transmission_error\n", [(0, 0, "no data")]),
    ("0.0,1\n0.5,2\n", [(1, 1, "numbers instead of the header")]),
    ("phase,transmision_error\n0,1\n", [(1, 2, "expected 'transmission_error'")]),
    ("phase,transmission_error,kink[deg]\n0,1,1\n", [(1, 3, "0 and 1 without unit")]),
    ("phase,transmission_error[furlong]\n0,1\n", [(1, 2, "no unit 'furlong'; expected one")]),
    ("phase,slope\n0,1\n", [(1, 0, "make no table")]),
    ("phase,phase,transmission_error\n0,0,1\n", [(1, 0, "make no table")]),
    ("phase,transmission_error,slope,slope_left\n0,0,1,1\n", [(1, 0, "make no table")]),
    ("phase,transmission_error,slope\n0,1,2\n1,1,2\n", [(3, 1, "repeats phase 0")]),
    ("phase,transmission_error,slope\n-0.5,1,2\n", [(2, 1, "0 <= phase < 1")]),
    ("phase,transmission_error\n0,1\n0.5,2\n", [(0, 0, "three rows")]),
    # Everything at once: header, field count, number, nan, order, kink.
    ("phase,transmission_error[um],kink\n0,1\n0.5,x,0\n0.4,nan,2\n",
     [(1, 2, "no unit"), (2, 0, "2 fields; expected 3"), (3, 2, "'x'"), (4, 1, "ascend"),
      (4, 2, "'nan'"), (4, 3, "0 or 1")]),
    # One complaint about the separator instead of one in each row.
    ("# x\nphase;transmission_error\n0;1\n0,5;2\n0,6;1\n",
     [(2, 0, "separator is ';'; expected a comma")]),
    ("0,0;1,2\n0,5;2,0\n", [(1, 0, "separator is ';'; expected a comma")]),
    ("phase\ttransmission_error\n0\t1\n", [(1, 0, "separator is a tab; expected a comma")]),
    # Rows of one wrong width are counted, not listed; another width is named apart.
    ("phase,transmission_error\n" + "0,5,1,2\n" * 12 + "0.1\n",
     [(2, 0, "4 fields; expected 2, as the header names; decimal commas? A point is expected "
      "(... and 11 more rows)"), (14, 0, "1 field; expected 2")]),
    ("phase,transmission_error\n" + "0;1\n" * 2,
     [(2, 0, "the separator is ';', not a comma (... and 1 more row)")]),
])
def test_bad_files_name_every_place(tmp_path, text, problems):
    with pytest.raises(TransmissionErrorFileError) as caught:
        read(tmp_path, text)
    found = caught.value.problems
    assert [p[:2] for p in found] == [p[:2] for p in problems]
    for (_, _, message), (_, _, part) in zip(found, problems, strict=True):
        assert part in message
    assert str(caught.value).count("te.csv") == len(problems)
    assert isinstance(caught.value, ValueError)


def test_missing_file_is_an_os_error(tmp_path):
    with pytest.raises(OSError):
        TransmissionError.from_file(tmp_path / "none.csv")
