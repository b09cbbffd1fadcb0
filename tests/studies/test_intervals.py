"""Intervals cover what they claim: seeded repeats on series and processes with a known answer.

Of 200 intervals of 95 % that are right 184 to 197 cover the truth (binomial, 98 % of all sets of
seeds); where an interval is wide by construction, or a count is whole, no upper limit is asked for.
`test_intervals_of_motions` does the same with the program's own motions.
"""

import math

import numpy as np
import pytest
from scipy.signal import lfilter

from helpers import scene_a
from lapwing.engine import Numerics, TrajectoryCall, Wanted
from lapwing.studies.intervals import bursts, correlation_time, mean_interval, rate_limit
from lapwing.studies.stability import CycleMaps, exponents, growth

REPEATS = 200
LEAST, MOST = 184, 197


def autoregressive(memory, n, rng):
    """Stationary x_k = memory·x_(k-1) + noise, mean 0."""
    noise = rng.standard_normal(n)
    noise[0] /= math.sqrt(1 - memory**2)
    return lfilter([1], [1, -memory], noise)


def logistic_growth(n, rng):
    """ln|f'| along x -> 4x(1 - x), begun in its own density: the mean is ln 2."""
    x = math.sin(0.5 * math.pi * rng.random()) ** 2
    growth = np.empty(n)
    for k in range(n):
        growth[k] = math.log(abs(4 - 8 * x))
        x = 4 * x * (1 - x)
    return growth


@pytest.mark.parametrize(("memory", "n"), [(0.0, 500), (0.5, 800), (-0.6, 400), (0.9, 8000)])
def test_the_mean_of_a_correlated_series_is_covered(memory, n):
    rng = np.random.default_rng(1)
    found = [mean_interval(autoregressive(memory, n, rng)) for _ in range(REPEATS)]
    assert all(math.isfinite(one.half_width) for one in found)
    assert LEAST <= sum(abs(one.mean) <= one.half_width for one in found) <= MOST
    # Independent samples of as sure a mean: n(1 - memory)/(1 + memory).
    effective = np.median([one.effective for one in found])
    assert effective == pytest.approx(n * (1 - memory) / (1 + memory), rel=0.2)


def test_the_exponent_of_the_logistic_map_is_covered():
    """Its sums telescope: the interval is wide, by far more than it must be."""
    rng = np.random.default_rng(2)
    found = [mean_interval(logistic_growth(600, rng)) for _ in range(REPEATS)]
    assert sum(abs(one.mean - math.log(2)) <= one.half_width for one in found) >= LEAST


def products_of_known_growth(count, n, rng, period=13.0):
    """Rotations of random angle, each lengthened by a correlated factor: exponent 0.1/period."""
    angle = rng.uniform(0, 2 * np.pi, (count, n))
    logs = 0.1 + 0.05 * np.array([autoregressive(0.8, n, rng) for _ in range(count)])
    turn = np.moveaxis(np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]),
                       (0, 1), (-2, -1))
    zero = np.zeros((count, n))
    return CycleMaps(turn * np.exp(logs)[..., None, None], zero, 2 * logs, zero + 1, zero + 2,
                     zero, zero, zero, zero + 1e300, period)


def test_the_lyapunov_exponent_of_a_known_product_is_covered():
    maps = products_of_known_growth(REPEATS, 2000, np.random.default_rng(3))
    grown = growth(maps)
    found = [exponents(maps[i], grown=grown[i]) for i in range(REPEATS)]
    covered = sum(abs(one.largest - 0.1 / one.period) <= one.error for one in found)
    assert LEAST <= covered <= MOST
    assert all(one.effective < 2000 / 4 for one in found)


def test_runs_of_one_chaotic_band_agree_within_their_errors():
    """Eight starts, one attractor: they scatter as their errors say."""
    osc, found = scene_a(0.8), []
    for k in range(1, 9):
        call = TrajectoryCall(osc, (0.0, -1e-5 * k, 0.0, 0.0), numerics=Numerics(),
                              wanted=Wanted(tangent=True))
        found.append(exponents(CycleMaps.from_rows(
            call.run((1700, 0.0), []).tangent[200:], osc.period)))
    value, error = np.array([(one.largest, one.error) for one in found]).T
    assert np.all(value > 5 * error) and np.all([one.effective > 40 for one in found])
    # Squared scatter over squared errors (of 95 %, t of 8 batches or more): χ² of seven, 99.9 %.
    centre = np.average(value, weights=error**-2)
    assert np.sum(((value - centre) / (error / 2.365)) ** 2) < 24.3


@pytest.mark.parametrize("series", [
    np.zeros(400), np.arange(400.0), np.ones(3), np.array([1.0, np.nan] * 100), np.empty(0),
    np.repeat([0.0, 1.0], 200)])
def test_what_is_not_known_is_not_stated(series):
    found = mean_interval(series)
    assert math.isnan(found.half_width) and math.isnan(found.effective) and found.batches == 0


def switching(memory, n, rng):
    """A state that is left with probability (1 - memory)/2 in each cycle, mean 0."""
    left = np.cumsum(rng.random(n) < 0.5 * (1 - memory))
    return (left + (rng.random() < 0.5)) % 2 - 0.5


@pytest.mark.parametrize("kind", [autoregressive, switching])
@pytest.mark.parametrize("times", [10, 20])
def test_a_record_of_few_correlation_times_claims_nothing(kind, times):
    rng = np.random.default_rng(4)
    for memory in (0.5, 0.9, 0.98):
        n = round(times * (1 + memory) / (1 - memory))
        found = [mean_interval(kind(memory, n, rng)) for _ in range(REPEATS)]
        assert sum(math.isfinite(one.half_width) for one in found) <= REPEATS / 50


@pytest.mark.parametrize("kind", [autoregressive, switching])
@pytest.mark.parametrize(("memory", "times"), [
    (0.0, 80), (0.5, 60), (0.9, 60), (0.9, 80), (0.9, 160), (0.98, 80)])
def test_a_short_record_covers_or_claims_nothing(kind, memory, times):
    """White noise of 80 cycles among them; of the intervals that are stated, 92 % and more."""
    if kind is switching and memory == 0.0:
        pytest.skip("two values without a memory are white noise, too")
    rng = np.random.default_rng(6)
    n = round(times * (1 + memory) / (1 - memory))
    found = [mean_interval(kind(memory, n, rng)) for _ in range(REPEATS)]
    known = [one for one in found if math.isfinite(one.half_width)]
    assert len(known) >= REPEATS * (0.4 if times < 80 else 0.8)
    assert sum(abs(one.mean) <= one.half_width for one in known) >= LEAST * len(known) / REPEATS


@pytest.mark.parametrize("kind", [autoregressive, switching])
@pytest.mark.parametrize(("memory", "times"), [
    (0.5, 40), *(pytest.param(*case, marks=pytest.mark.full)
                 for case in [(0.0, 40), (0.5, 30), (0.9, 40), (0.9, 45), (0.98, 45)])])
def test_the_few_intervals_of_records_near_the_least_length_cover(kind, memory, times):
    """Chance finds the correlation of some records too short: these are the ones with intervals."""
    if kind is switching and memory == 0.0:
        pytest.skip("two values without a memory are white noise, too")
    rng, known = np.random.default_rng(8), []
    n = round(times * (1 + memory) / (1 - memory))
    while len(known) < REPEATS:
        found = mean_interval(kind(memory, n, rng))
        known += [found] * math.isfinite(found.half_width)
    assert sum(abs(one.mean) <= one.half_width for one in known) >= LEAST


def test_the_correlation_time_of_a_long_record():
    rng = np.random.default_rng(4)
    assert correlation_time(autoregressive(0.99, 200_000, rng)) == pytest.approx(199, rel=0.15)


# --- events in clusters -----------------------------------------------------------------------


def clustered(rate, size, n, rng, records=17):
    """Cycles with an event: bursts begin at `rate`, of geometric size, 1 to 3 cycles apart."""
    times = []
    for _ in range(records):
        seen = np.zeros(n, bool)
        for begun in rng.uniform(-500, n, rng.poisson(rate * (n + 500))):
            at = int(begun) - 1 + np.cumsum(rng.integers(1, 4, rng.geometric(1 / size)))
            seen[at[(at >= 0) & (at < n)]] = True
        times.append(np.flatnonzero(seen))
    return times


@pytest.mark.parametrize(("rate", "size"), [(1e-5, 20), (1e-4, 8), (1e-3, 8), (2e-3, 1)])
def test_the_rate_of_bursts_is_bounded(rate, size):
    """95 %, and whole counts make it more; cycles taken for independent fail by far."""
    rng = np.random.default_rng(5)
    bounded = naive = 0
    for _ in range(REPEATS):
        times = clustered(rate, size, 1200, rng)
        bounded += rate_limit(bursts(times), 17 * 1200) >= rate
        naive += rate_limit(sum(map(len, times)), 17 * 1200) >= rate * size
    assert bounded >= LEAST
    assert size == 1 or naive < 150


@pytest.mark.parametrize(("times", "count"), [
    ([], 0), ([[], []], 0), ([[5]], 1), ([[5], [7]], 2), ([[3, 4, 5, 6, 7]], 1),
    ([[10, 11, 12, 900, 901, 902, 903]], 2)])
def test_bursts(times, count):
    assert bursts([np.array(some, dtype=int) for some in times]) == count
