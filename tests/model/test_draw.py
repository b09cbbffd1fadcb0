"""Draws: the distributions of SciPy, cut at their limits, and what is refused of them."""

import numpy as np
import pytest
from scipy import stats

from lapwing import Draw
from lapwing.model.draw import LEAST_SHARE, correlation_problem, sampling_problems

SHARES = np.array([0.0, 1e-9, 0.01, 0.3, 0.5, 0.8, 0.999, 1.0])


def lognormal(mean, deviation):
    spread = np.sqrt(np.log1p((deviation / mean)**2))
    return stats.lognorm(spread, scale=mean * np.exp(-spread**2 / 2))


@pytest.mark.parametrize(("draw", "expected"), [
    (Draw("normal", mean=2.0, deviation=0.5), stats.norm(2.0, 0.5)),
    (Draw("normal", mean=2.0, deviation=0.5, low=1.5), stats.truncnorm(-1, np.inf, 2.0, 0.5)),
    (Draw("normal", mean=2.0, deviation=0.5, low=3.5, high=4.0), stats.truncnorm(3, 4, 2.0, 0.5)),
    (Draw("normal", mean=2.0, deviation=0.5, high=0.5), stats.truncnorm(-np.inf, -3, 2.0, 0.5)),
    (Draw("lognormal", mean=2.0, deviation=0.5), lognormal(2.0, 0.5)),
    (Draw("uniform", low=-1.0, high=3.0), stats.uniform(-1.0, 4.0)),
    (Draw("triangular", low=1.0, mode=1.5, high=4.0), stats.triang(0.5 / 3, 1.0, 3.0)),
    (Draw("triangular", low=1.0, mode=1.0, high=4.0), stats.triang(0.0, 1.0, 3.0)),
    (Draw("triangular", low=1.0, mode=4.0, high=4.0), stats.triang(1.0, 1.0, 3.0))])
def test_values_are_those_of_the_distribution(draw, expected):
    inside = np.clip(SHARES, LEAST_SHARE, 1 - LEAST_SHARE)
    found = draw.at(SHARES)
    assert found[:-1] == pytest.approx(expected.ppf(inside)[:-1], rel=1e-9)
    assert found[-1] == pytest.approx(expected.ppf(inside)[-1], rel=0.01)  # of 1 - 2^-53
    low, high = draw.ends
    assert np.all((found >= low) & (found <= high))
    assert np.all(np.diff(found) >= 0)


def test_a_lognormal_law_has_the_mean_and_deviation_it_is_given():
    values = Draw("lognormal", mean=3.0, deviation=1.2).at((np.arange(200_000) + 0.5) / 200_000)
    assert values.mean() == pytest.approx(3.0, rel=1e-4)
    assert values.std() == pytest.approx(1.2, rel=2e-3)
    cut = Draw("lognormal", mean=3.0, deviation=1.2, low=0.0, high=3.0)
    whole = lognormal(3.0, 1.2)
    assert cut.at([0.4])[0] == pytest.approx(whole.ppf(0.4 * whole.cdf(3.0)))


@pytest.mark.parametrize(("given", "said"), [
    ({"law": "cauchy"}, "law = 'cauchy', expected one of 'normal'"),
    ({"law": "normal", "mean": 1.0}, "needs deviation"),
    ({"law": "normal", "mean": 1.0, "deviation": 0.0}, "deviation = 0, expected above 0"),
    ({"law": "normal", "mean": 1.0, "deviation": 1.0, "mode": 2.0}, "mode does not go with"),
    ({"law": "normal", "mean": 1.0, "deviation": 1.0, "low": 2.0, "high": 2.0}, "is not below"),
    ({"law": "normal", "mean": 1.0, "deviation": 0.1, "low": 2.0}, "leave 7.6e-24 of the"),
    ({"law": "normal", "mean": "x", "deviation": np.nan}, "mean = 'x', .*; deviation = nan"),
    ({"law": "uniform", "low": 1.0}, "needs high"),
    ({"law": "uniform", "low": 1.0, "high": 2.0, "mean": 1.0}, "mean does not go with"),
    ({"law": "triangular", "low": 1.0, "mode": 3.0, "high": 2.0}, "mode = 3 does not lie between"),
    ({"law": "lognormal", "mean": -1.0, "deviation": 1.0}, "mean = -1, expected above 0"),
    ({"law": "lognormal", "mean": 1.0, "deviation": 1.0, "low": -1.0}, "low = -1, expected 0"),
    ({"law": "lognormal", "mean": 1.0, "deviation": 1.0, "high": 0.0}, "high = 0, expected ab")])
def test_what_makes_no_distribution_is_refused(given, said):
    with pytest.raises(ValueError, match=said):
        Draw(**given)


def test_correlations_are_those_of_some_variables():
    assert not correlation_problem(np.array([[1.0, 0.5], [0.5, 1.0]]), 2)
    for matrix, said in (
            (np.eye(3), "3 × 3 numbers, expected 2 × 2"),
            (np.array([[1.0, 0.5], [0.5, 0.9]]), "1 on the diagonal"),
            (np.array([[1.0, 0.5], [0.4, 1.0]]), "0.5 in row 1, column 2, 0.4 in row 2, column 1"),
            (np.ones((2, 2)), "not positive definite")):
        assert said in correlation_problem(matrix, 2)


@pytest.mark.parametrize(("given", "said"), [
    (("sobol", 1000, 16, None), "such as 512 or 1024"),
    (("sobol", 16, 16, None), "such as 32 or 64"),
    (("sobol", 17 * 64, 17, None), ""),
    (("latin_hypercube", 1000, 16, None), "such as 992 or 1008"),
    (("latin_hypercube", 160, 16, None), ""),
    (("random", 1001, 16, 48), "such as 32 or 64"),
    (("random", 1001, 16, 64), "")])
def test_counts_that_do_not_go_together_are_told_with_such_that_do(given, said):
    problems = sampling_problems(*given)
    assert len(problems) == bool(said) and all(said in one for one in problems)
