"""Intervals that say 95 % cover 95 %: 200 repeats with seeds, of cases with a known answer."""

import numpy as np
import pytest
from scipy.stats import beta, binom, norm, spearmanr

from lapwing.studies.ensemble.points import sensitivity_shares, shares_of
from lapwing.studies.ensemble.statistics import (
    Sample,
    effects,
    probability,
    quantile,
    rank_correlation,
)

# Repeats, and how often at least and at most the truth is held: of 200 for intervals that are exact
# and for those over scrambles, and of fewer where scrambling takes long, as rare by chance.
EXACT, OVER_SCRAMBLES, SOME = (200, 184, 200), (200, 184, 197), (40, 33, 40)
WEIGHTS = np.array([3.0, 2.0, 1.0, 0.5])
CHANCE = 0.7  # of a standard normal answer: a quarter lies above
LEVELS, CHANCES = (0.05, 0.5, 0.95), (0.1, 0.4)


def scaled_sum(shares):
    """A standard normal answer of four independent parameters."""
    return norm.ppf(np.clip(shares, 1e-12, 1 - 1e-12)) @ WEIGHTS / np.sqrt(WEIGHTS @ WEIGHTS)


def covers(interval, truth):
    """Whether an interval holds the truth; a limit that is not known excludes nothing."""
    return not (interval.low > truth) and not (interval.high < truth)


@pytest.mark.parametrize(("sampling", "runs", "expected"), [
    ("random", 300, EXACT), ("latin_hypercube", 1024, SOME), ("sobol", 1024, SOME),
    pytest.param("latin_hypercube", 1024, OVER_SCRAMBLES, marks=pytest.mark.full),
    pytest.param("random", 2048, EXACT, marks=pytest.mark.full),
    pytest.param("latin_hypercube", 4096, OVER_SCRAMBLES, marks=pytest.mark.full),
    pytest.param("sobol", 1024, OVER_SCRAMBLES, marks=pytest.mark.full)])
def test_probabilities_and_quantiles_are_covered_as_often_as_said(sampling, runs, expected):
    repeats, least, most = expected
    sample = Sample(runs, 0 if sampling == "random" else 16)
    held = {one: 0 for one in (*LEVELS, *CHANCES)}
    everything = np.ones(runs, dtype=bool)
    for seed in range(repeats):
        answer = scaled_sum(shares_of(sampling, runs, 4, 16, seed))
        for level in LEVELS:
            held[level] += covers(quantile(answer, level, sample), norm.ppf(level))
        for chance in CHANCES:
            seen = answer > norm.isf(chance)
            held[chance] += covers(probability(seen, everything, sample), chance)
    assert all(least <= count <= most for count in held.values()), held


@pytest.mark.parametrize(("count", "expected"), [
    (32, SOME), pytest.param(32, OVER_SCRAMBLES, marks=pytest.mark.full),
    pytest.param(128, OVER_SCRAMBLES, marks=pytest.mark.full)])
def test_sensitivities_are_covered_as_often_as_said(count, expected):
    repeats, least, most = expected
    parts = WEIGHTS**2 / (WEIGHTS @ WEIGHTS)
    held = np.zeros((2, 4), dtype=int)
    for seed in range(repeats):
        found = effects(scaled_sum(sensitivity_shares(count, 4, 16, seed)), 4, 16)
        for i, one in enumerate((found.main, found.total)):
            held[i] += (one[:, 1] <= parts) & (parts <= one[:, 2])
    # Eight intervals at a time: their mean is judged as one is. That one of eight good ones holds
    # in fewer than 179 of 200, or 33 of 40, is chance in less than one of 150 such tests.
    assert least <= held.mean() <= most and np.all(held >= (179 if repeats == 200 else 33)), held


@pytest.mark.parametrize("sampling", [
    "latin_hypercube", pytest.param("sobol", marks=pytest.mark.full)])
@pytest.mark.parametrize("chance", [0.0, 0.001, 0.003, 0.01])
def test_rare_events_are_covered_at_least_as_often(sampling, chance):
    """Few are seen, or none: t over what each scramble says would be too short."""
    held, runs = 0, 1024
    for seed in range(60):
        seen = scaled_sum(shares_of(sampling, runs, 4, 16, seed)) > norm.isf(chance)
        held += covers(probability(seen, np.ones(runs, dtype=bool), Sample(runs, 16)), chance)
    assert held >= 55


def test_exact_intervals_are_clopper_and_pearsons_and_order_statistics():
    rng = np.random.default_rng(5)
    for runs, seen in ((50, 0), (50, 50), (50, 7), (1, 1)):
        found = probability(np.arange(runs) < seen, np.ones(runs, dtype=bool), Sample(runs, 0))
        assert found.estimate == seen / runs
        assert found.low == pytest.approx(beta.ppf(0.025, seen, runs - seen + 1) if seen else 0)
        assert found.high == pytest.approx(beta.ppf(0.975, seen + 1, runs - seen)
                                           if seen < runs else 1)
    values = rng.permutation(1000.0 + np.arange(1, 101))
    for level in (0.1, 0.5, 0.9):
        found = quantile(values, level, Sample(100, 0))
        assert found.estimate == 1000 + 100 * level
        low, high = int(found.low - 1000), int(found.high - 1000)  # ranks, from 1
        assert binom.cdf(low - 1, 100, level) <= 0.025 < binom.cdf(low, 100, level)
        assert binom.sf(high - 1, 100, level) <= 0.025 < binom.sf(high - 2, 100, level)
    few = quantile(values[:20], 0.99, Sample(20, 0))
    assert np.isnan(few.high) and np.isfinite(few.low)  # 20 draws leave open how high it is


@pytest.mark.parametrize("scrambles", [0, 16])
def test_a_run_without_a_result_may_be_anything(scrambles):
    rng = np.random.default_rng(3)
    values = rng.random(320)
    lost = rng.random(320) < 0.1
    seen, sample = values > 0.7, Sample(320, scrambles)
    found = probability(seen, ~lost, sample)
    everything = np.ones(320, dtype=bool)
    assert found.estimate == (seen & ~lost).sum() / (~lost).sum()
    assert found.low == probability(seen & ~lost, everything, sample).low
    assert found.high == probability(seen | lost, everything, sample).high
    told = quantile(np.where(lost, np.nan, values), 0.5, sample)
    assert told.low <= quantile(np.where(lost, -1.0, values), 0.5, sample).low
    assert told.high >= quantile(np.where(lost, 2.0, values), 0.5, sample).high
    # Where more are lost than lie beyond a quantile, it is open on that side.
    assert np.isnan(quantile(np.where(lost, np.nan, values), 0.97, sample).high)
    assert np.isnan(quantile(np.where(lost, np.nan, values), 0.03, sample).low)
    assert np.isnan(probability(seen, ~everything, sample).estimate)
    nothing = probability(seen, ~everything, sample)
    assert (nothing.low, nothing.high) == (0.0, 1.0)
    assert np.isnan(quantile(np.full(320, np.nan), 0.5, sample)).all()


@pytest.mark.parametrize("scrambles", [0, 16])
def test_answers_that_are_often_the_same_are_covered_too(scrambles):
    """Half of all are 0: the median is, too, and a limit lies there."""
    held, truth = 0, 0.0
    for seed in range(60):
        shares = shares_of("latin_hypercube" if scrambles else "random", 512, 2, 16, seed)
        answer = np.maximum(shares[:, 0] - 0.5, 0)
        found = quantile(answer, 0.45, Sample(512, scrambles))
        held += covers(found, truth)
        assert found.low <= found.estimate <= found.high
    assert held >= 55


def test_of_listed_values_nothing_is_said_beyond_them():
    values, sample = np.arange(10.0), Sample(10, -1)
    found = probability(values > 6, np.ones(10, dtype=bool), sample)
    assert found.estimate == 0.3 and np.isnan(found[1:]).all()
    told = quantile(values, 0.5, sample)
    assert told.estimate == 4.0 and np.isnan(told[1:]).all()


def test_rank_correlations_are_spearmans():
    rng = np.random.default_rng(8)
    x, y = rng.random((2, 60))
    y[::3] = 0.5
    sample = Sample(60, 0)
    assert rank_correlation(x, y, sample).estimate == pytest.approx(
        spearmanr(x, y).statistic, rel=1e-12)
    lost = np.where(x > 0.8, np.nan, y)
    found = rank_correlation(x, lost, sample)
    assert found.estimate == pytest.approx(
        spearmanr(x[x <= 0.8], y[x <= 0.8]).statistic, rel=1e-12)
    # What is lost may be anything; of two that differ nobody knows how it would be with others.
    assert np.isnan(found[1:]).all()
    assert np.isnan(rank_correlation(x, np.where(x < np.sort(x)[2], 1.0, 0.0), sample)[1:]).all()
    assert np.isnan(rank_correlation(x, y, Sample(60, -1))[1:]).all()
    assert np.isnan(rank_correlation(x, np.ones(60), sample)).all()
    assert np.isnan(rank_correlation(x, np.full(60, np.nan), sample)).all()
    assert rank_correlation(x, np.exp(x), sample) == pytest.approx((1, 1, 1), abs=1e-9)


@pytest.mark.parametrize(("sampling", "runs", "expected"), [
    ("random", 96, SOME), ("latin_hypercube", 256, SOME),
    pytest.param("random", 512, EXACT, marks=pytest.mark.full),
    pytest.param("sobol", 512, OVER_SCRAMBLES, marks=pytest.mark.full),
    pytest.param("latin_hypercube", 512, OVER_SCRAMBLES, marks=pytest.mark.full)])
def test_rank_correlations_are_covered_as_often_as_said(sampling, runs, expected):
    """Of normal variables 6/π·asin(r/2), of one that is seen or not as a large sample has it."""
    repeats, least, most = expected
    correlations = WEIGHTS / np.sqrt(WEIGHTS @ WEIGHTS)
    truth = 6 / np.pi * np.arcsin(correlations / 2)
    many = np.random.default_rng(1).random((400_000, 4))
    seen = spearmanr(many[:, 0], scaled_sum(many) > CHANCE).statistic
    sample = Sample(runs, 0 if sampling == "random" else 16)
    held = np.zeros(5, dtype=int)
    for seed in range(repeats):
        shares = shares_of(sampling, runs, 4, 16, seed)
        answer = scaled_sum(shares)
        held[:4] += [covers(rank_correlation(shares[:, i], answer, sample), truth[i])
                     for i in range(4)]
        held[4] += covers(rank_correlation(shares[:, 0], (answer > CHANCE) * 1.0, sample), seen)
    assert np.all((least <= held) & (held <= most)), held


def test_sensitivities_are_not_told_where_a_run_is_lost_or_nothing_varies():
    answer = scaled_sum(sensitivity_shares(16, 4, 16, 0))
    lost = answer.copy()
    lost[77] = np.nan
    flat = answer.copy()
    flat[:6 * 16] = 1.0
    for one in (lost, flat):
        found = effects(one, 4, 16)
        assert np.isnan(found.main).all() and np.isnan(found.total).all()
    assert np.isfinite(effects(answer, 4, 16).main).all()
