"""Curves fitted to samples: exact where they can be, kinks kept, noise told as it is."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from lapwing import critical_torque
from lapwing.model.curve.basis import curve_of, design
from lapwing.model.curve.fit import fit_curve
from lapwing.model.curve.spline import _Spline
from measured import ARCSEC, KINK, NO_KINK, PHASE, ROWS, TRUTH, curve, kinks, oscillator, samples

CURVES = ("smooth", "kinked")


@pytest.mark.parametrize("name", CURVES)
def test_samples_without_noise_give_the_curve(name):
    fit = fit_curve(PHASE, curve(name), kinks(name), harmonics=4)
    # One in the last digit that is told.
    assert critical_torque(oscillator(fit.te))[0] == pytest.approx(TRUTH[name], abs=1e-9)
    assert fit.noise < 1e-13 * ARCSEC and np.abs(fit.residual).max() < 1e-13 * ARCSEC
    between = (PHASE + 0.3 / ROWS) % 1
    assert_allclose(fit.te.value(between), curve(name, between), atol=1e-11 * 9 * ARCSEC)


@pytest.mark.parametrize("method", [{"harmonics": 4}, {}])
def test_a_kink_stays_a_kink_and_nothing_else_becomes_one(method):
    noisy = fit_curve(PHASE, samples("kinked", 0.4, 1), KINK, **method).te
    assert noisy.knots[:-1][noisy.kinks].tolist() == [0.0]
    assert noisy.slope_jumps()[0] == pytest.approx(96 * ARCSEC, rel=0.5)
    smooth = fit_curve(PHASE, samples("smooth", 0.4, 1), NO_KINK, **method).te
    assert not smooth.kinks.any() and len(smooth.harmonics)


def test_uneven_samples_and_kinks_in_two_rows():
    phase = np.sort(np.random.default_rng(5).uniform(0, 1, 80))
    flags = np.zeros(80)
    flags[[11, 47]] = 1
    true = curve_of(np.array([1.0, 30.0, -12.0, 5.0, 1.0, 0.5, -0.3]) * 1e-6, phase[flags == 1], 2)
    fit = fit_curve(phase, true.value(phase), flags, harmonics=3)
    assert_allclose(fit.te.slope(phase, "left"), true.slope(phase, "left"), atol=1e-15)
    assert_allclose(fit.te.slope_jumps()[fit.te.kinks], [30e-6, -12e-6], rtol=1e-9)


def test_the_table_of_a_kinked_curve_is_its_series_and_parabola():
    coefficients = np.array([0.2, 3.0, 1.0, -2.0, 0.4, 0.1]) * 1e-6
    te = curve_of(coefficients, [0.37], 2)
    phase = np.random.default_rng(2).uniform(0, 1, 500)
    assert_allclose(te.value(phase), design(phase, [0.37], 2) @ coefficients, rtol=0, atol=1e-17)
    jump = te.slope(0.37, "right") - te.slope(0.37, "left")
    assert jump == pytest.approx(3e-6, rel=1e-9)


def test_the_spline_is_the_least_of_what_it_says():
    """Fidelity plus λ·∫(d³/dphase³)², minimised by solving the normal equations outright."""
    value, order, log_penalty = samples("smooth", 1.0, 3), 12, -9.0
    found, freedom = _Spline(PHASE, value, PHASE[:0], order).coefficients(log_penalty)
    columns = design(PHASE, (), order)
    roughness = np.append(0.0, np.repeat(np.arange(1.0, order + 1) ** 6, 2))
    normal = columns.T @ columns + np.exp(log_penalty) * np.diag(roughness)
    assert_allclose(found, np.linalg.solve(normal, columns.T @ value), rtol=1e-9,
                    atol=1e-9 * np.abs(value).max())
    assert freedom == pytest.approx(np.trace(np.linalg.solve(normal, columns.T @ columns)))


def test_the_jump_of_slope_has_less_bias_than_that_of_a_partial_spline():
    """Samples without noise, smoothed as those with noise are: what is off is bias."""
    order, log_penalty = 20, np.log(ROWS / 2 / 2.85**6)  # half of order 2.85 passes
    spline = _Spline(PHASE, curve("kinked"), PHASE[:1], order)
    speckman = spline.coefficients(log_penalty)[0][1] / (96 * ARCSEC) - 1
    columns = design(PHASE, PHASE[:1], order)
    roughness = np.append([0.0, 0.0], np.repeat(np.arange(1.0, order + 1) ** 6, 2))
    normal = columns.T @ columns + np.exp(log_penalty) * np.diag(roughness)
    partial = np.linalg.solve(normal, columns.T @ curve("kinked"))[1] / (96 * ARCSEC) - 1
    assert abs(partial) > 0.05 and abs(speckman) < abs(partial) / 4


def test_cross_validation_is_leaving_out_one_at_even_samples():
    """Without inflation and with equal leverages it is the mean square of what is left out."""
    value = samples("smooth", 1.0, 4)
    fit = fit_curve(PHASE, value, harmonics=3)
    left_out = []
    for i in range(ROWS):
        others = np.arange(ROWS) != i
        one = fit_curve(PHASE[others], value[others], harmonics=3)
        left_out.append(value[i] - float(one.te.value(PHASE[i])))
    assert fit.wide.gcv == pytest.approx(np.mean(np.square(left_out)), rel=1e-9)


@pytest.mark.parametrize("name", CURVES)
@pytest.mark.parametrize("method", [{"harmonics": 4}, {}])
@pytest.mark.parametrize("fits", [8, pytest.param(30, marks=pytest.mark.full)])
def test_the_noise_is_found(name, method, fits):
    """Of 47 to 51 degrees of freedom a mean over 30 fits is good to 2 %; four times that."""
    found = [fit_curve(PHASE, samples(name, 0.4, seed), kinks(name), **method).noise
             for seed in range(fits)]
    assert np.sqrt(np.mean(np.square(found))) == pytest.approx(0.4 * ARCSEC,
                                                               rel=0.08 * np.sqrt(30 / fits))


def test_a_stated_noise_level_decides_how_smooth():
    value = samples("smooth", 0.4, 6)
    fits = [fit_curve(PHASE, value, noise_level=level * ARCSEC) for level in (0.05, 0.4, 4.0)]
    freedom = [fit.effective for fit in fits]
    assert freedom[0] > freedom[1] > freedom[2]
    assert fits[1].noise == 0.4 * ARCSEC and fits[1].noise_stated
    assert fits[1].residual_excess() > 0.01 and fits[0].residual_excess() < 1e-9
    assert fits[2].residual_excess() < 1e-9


def test_deviations_are_those_of_fits_to_other_samples():
    fit = fit_curve(PHASE, samples("kinked", 0.4, 8), KINK, harmonics=3)
    deviations, scale = fit.deviations(4000)
    covariance = fit.noise**2 * fit.wide.root @ fit.wide.root.T
    # Of 4000 draws a variance is known to 2 %; residuals divided by √(1 - leverage) give it.
    assert_allclose(np.var(deviations, axis=1), np.diag(covariance), rtol=0.12)
    assert np.mean(scale**2) == pytest.approx(1.0, abs=0.05)
    assert np.array_equal(deviations, fit.deviations(4000)[0])


def test_repeats_lie_about_the_curve():
    fit = fit_curve(PHASE, samples("smooth", 0.4, 9))
    values = np.array([te.value(PHASE) for te in fit.repeats(200)])
    error = fit.noise * np.linalg.norm(design(PHASE, (), fit.wide.order) @ fit.wide.root, axis=1)
    assert_allclose(values.std(axis=0), error, rtol=0.3)
    assert np.all(np.abs(values.mean(axis=0) - fit.te.value(PHASE)) < 5 * error / np.sqrt(200))


@pytest.mark.parametrize(("change", "text"), [
    ({"harmonics": 29}, "harmonics to order 29 need at least 62 samples, there are 60"),
    ({"phase": PHASE[:-1]}, "equally long"), ({"phase": PHASE[::-1]}, "ascend strictly"),
    ({"kinks": 2 * KINK}, "0 or 1"), ({"noise_level": -1.0}, "noise_level"),
    ({"harmonics": 0}, "harmonics"), ({"phase": PHASE / 20, "harmonics": 6}, "with such gaps")])
def test_what_cannot_be_fitted_is_refused(change, text):
    given = {"phase": PHASE, "value": curve("smooth"), "kinks": NO_KINK, **change}
    with pytest.raises(ValueError, match=text):
        fit_curve(given.pop("phase"), given.pop("value"), given.pop("kinks"), **given)


def test_few_samples_are_smoothed_with_the_orders_they_tell_apart():
    phase = np.arange(7) / 7
    fit = fit_curve(phase, curve("smooth", phase))
    assert fit.order == 1 and fit.wide.freedom == 4
    with pytest.raises(ValueError, match="need at least 6 samples"):
        fit_curve(phase[:5], curve("smooth", phase[:5]))
