"""Bounds of a critical force: against its exact value, a known distribution, and each other."""

import dataclasses

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.stats import norm

from lapwing.model.curve.fit import fit_curve
from lapwing.model.curve.interval import (
    _responses,
    force_bounds,
    forces_by_order,
    largest_value_bounds,
    needed_force,
    repeat_interval,
    share_of_high_orders,
)
from measured import ARCSEC, KINK, NO_KINK, PHASE, TRUTH, curve, kinks, oscillator, samples


@pytest.mark.parametrize("law", ["restitution", "rigid"])
def test_responses_add_up_to_the_engaged_response(law):
    """-min over the phases looked at is the exact critical force but for what lies between."""
    for name in ("smooth",) if law == "rigid" else ("smooth", "kinked"):
        fit = fit_curve(PHASE, samples(name, 0.4, 1), kinks(name), harmonics=5)
        osc = oscillator(fit.te, contact_law=law)
        response = _responses(osc, fit.kinks, 5) @ fit.coefficients
        # Half a step of 1/96 turn of the highest order off a parabola's peak: (π/96)²/2.
        assert -response.min() == pytest.approx(needed_force(osc)[0], rel=6e-4)


def test_a_coast_flank_that_stands_still_takes_no_part():
    """Not in the way of the curves tried besides the fit, which may be wider than the gap."""
    fit = fit_curve(PHASE, samples("kinked", 0.4, 1), kinks("kinked"))
    osc = dataclasses.replace(oscillator(fit.te), back_flank_te=False)
    osc = dataclasses.replace(osc, backlash=1.01 * osc.backlash
                              * -osc.flank_extrema[0] / osc.gap_width)
    moving = dataclasses.replace(osc, back_flank_te=True)
    for function in (force_bounds, share_of_high_orders, forces_by_order):
        found, expected = function(osc, fit), function(moving, fit)
        assert str(found) == str(expected)


@pytest.mark.parametrize("name", ["smooth", "kinked"])
def test_without_noise_the_interval_is_a_point(name):
    fit = fit_curve(PHASE, curve(name), kinks(name), harmonics=3)
    osc = oscillator(fit.te)
    bounds = force_bounds(osc, fit)
    unit = osc.scales.force_per_torque
    assert_allclose(np.array(bounds[:3]) / unit, TRUTH[name], rtol=1e-9)


def test_a_function_with_one_phase_has_the_normal_interval():
    deviations = norm.ppf((np.arange(4000) + 0.5) / 4000)[None, :]
    low, high = largest_value_bounds(np.array([3.0]), np.array([1.0]), deviations, 0.95, 60,
                                     np.inf)
    assert (low, high) == pytest.approx((3 - 1.96, 3 + 1.96), abs=5e-3)


def test_the_largest_of_equal_values_with_independent_errors():
    """The hardest case: 50 phases that all are the maximum; bounds hold it, its draws do not."""
    rng = np.random.default_rng(3)
    deviations = rng.standard_normal((50, 999))
    held = drawn = 0
    for _ in range(200):
        middle = rng.standard_normal(50)
        low, high = largest_value_bounds(middle, np.ones(50), deviations, 0.95, 60, np.inf)
        held += low <= 0 <= high
        spread = np.quantile((middle[:, None] + deviations).max(axis=0), [0.025, 0.975])
        drawn += spread[0] <= 0 <= spread[1]
    # 0.95 of 200 less four standard deviations of a binomial number.
    assert held >= 190 - 4 * np.sqrt(200 * 0.05 * 0.95)
    assert drawn < 20


def test_less_noise_gives_a_narrower_interval_and_more_orders_a_wider_one():
    def width(noise, order):
        fit = fit_curve(PHASE, samples("smooth", noise, 2), harmonics=order)
        low, _, high, _ = force_bounds(oscillator(fit.te), fit)
        return high - low

    assert width(0.1, 4) < width(0.4, 4) < width(1.0, 4)
    assert width(0.4, 2) < width(0.4, 4) < width(0.4, 6) < width(0.4, 9)


def test_a_kink_under_rigid_teeth_has_no_interval():
    fit = fit_curve(PHASE, samples("kinked", 0.1, 2), KINK, harmonics=3)
    assert force_bounds(oscillator(fit.te, contact_law="rigid"), fit).high == np.inf


def test_forces_by_order_are_those_of_such_fits():
    fit = fit_curve(PHASE, samples("smooth", 0.4, 3), NO_KINK)
    osc = oscillator(fit.te)
    table = forces_by_order(osc, fit)
    assert table["order"].tolist() == list(range(1, 17))
    for order in (1, 4, 9):
        one = fit_curve(PHASE, fit.value, harmonics=order)
        # Half a step of 1/1536 of a period off the peak, as above, at the highest order here.
        assert table["force"][order - 1] == pytest.approx(
            needed_force(oscillator(one.te))[0], rel=6e-4)
    assert int(table["order"][np.argmin(table["gcv"])]) == 2
    assert np.all(table["low"] <= table["force"]) and np.all(table["force"] <= table["high"])


def test_the_share_of_the_highest_orders():
    true = fit_curve(PHASE, curve("smooth"), harmonics=6)
    share, above = share_of_high_orders(oscillator(true.te), true)
    assert above == 4 and share < 1e-9
    noisy = fit_curve(PHASE, samples("smooth", 1.0, 3), harmonics=9)
    assert share_of_high_orders(oscillator(noisy.te), noisy)[0] > 0.3
    few = fit_curve(PHASE, curve("smooth"), harmonics=2)
    assert np.isnan(share_of_high_orders(oscillator(few.te), few)[0])


def test_an_order_below_the_noise_can_decide():
    """What docs/method.md says of order 11, which meets the natural frequency."""
    with_it = curve("smooth") + 0.05 * ARCSEC * np.cos(22 * np.pi * PHASE)
    fit = fit_curve(PHASE, with_it, harmonics=11)
    osc = oscillator(fit.te)
    torque = needed_force(osc)[0] / osc.scales.force_per_torque
    assert 4 < torque / TRUTH["smooth"] < 4.5


def test_repeats_turned_round_the_estimate():
    found = np.arange(1.0, 40.0)
    assert repeat_interval(20.0, found) == (1.0, 39.0)
    # All repeats lie above: the truth may lie as far below.
    assert repeat_interval(0.0, found) == (-39.0, 39.0)
    # One without a value may lie anywhere, and 38 are 95 % of 40; two are too many.
    assert repeat_interval(20.0, np.where(found < 2, np.nan, found)) == (1.0, 39.0)
    assert np.isnan(repeat_interval(20.0, np.where(found < 3, np.nan, found))).all()
    assert np.isnan(repeat_interval(np.nan, found)).all()
