"""What draws tell of all pairs: probabilities, quantiles, correlations, and how sure these are.

Independent draws have exact intervals: Clopper and Pearson's of a probability, order statistics of
a quantile. Draws of one scrambled sequence, or of one Latin hypercube, depend on each other; the
scrambles do not, and Student's t of what each says makes the interval. A run without a result may
be anything: the lower limit takes it for one thing, the upper limit for the other.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

CONFIDENCE = 0.95
# So many of either kind, for each scramble, that t is right: of fewer the numbers in each scramble
# are skew, and the interval is at least the one of as many independent draws.
FEW = 2
# Independent draws are taken in so many groups for a jackknife.
GROUPS = 32
# Of a correlation of one the artanh is infinite.
_NEAR_ONE = 1 - 1e-12
# Thresholds that are tried for a quantile over scrambles; between them it is rounded outwards.
TRIED = 20_000


class Sample(NamedTuple):
    """How runs were drawn, so many of them.

    Attributes
    ----------
    runs : int
    scrambles : int, independent ones, one after the other; 0: every draw is independent; -1: nobody
        knows, nothing is said of anything but the runs themselves
    """

    runs: int
    scrambles: int


class Interval(NamedTuple):
    """An estimate from the runs that have a result, and the limits; NaN: not known."""

    estimate: float
    low: float
    high: float


def probability(seen: NDArray[np.bool_], known: NDArray[np.bool_], sample: Sample) -> Interval:
    """How likely something is to be seen.

    Parameters
    ----------
    seen, known : (n,) arrays; what is seen where it is not known does not count
    sample : Sample
    """
    seen = seen & known
    estimate = seen.sum() / known.sum() if known.any() else math.nan
    if sample.scrambles < 0:
        return Interval(float(estimate), math.nan, math.nan)
    least, most = (_by_scramble(one, sample) for one in (seen, seen | ~known))
    return Interval(float(estimate), float(_share_limits(least[:, None], sample)[0][0]),
                    float(_share_limits(most[:, None], sample)[1][0]))


def _by_scramble(rows: NDArray[Any], sample: Sample) -> NDArray[np.int64]:
    """How many of each scramble, of all where draws are independent."""
    counts: NDArray[np.int64] = rows.reshape(max(sample.scrambles, 1), -1).sum(axis=1)
    return counts


def _share_limits(counts: NDArray[np.int64],
                  sample: Sample) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Limits of the share behind counts (scrambles, k), each of its scramble's part of the runs."""
    total = counts.sum(axis=0)
    if sample.scrambles < 1:
        return _exact_limits(total, sample.runs)
    from scipy.stats import t

    shares = counts * sample.scrambles / sample.runs
    half = t.ppf(0.5 + 0.5 * CONFIDENCE, sample.scrambles - 1) * shares.std(axis=0, ddof=1) \
        / math.sqrt(sample.scrambles)
    low, high = (np.clip(shares.mean(axis=0) + sign * half, 0, 1) for sign in (-1, 1))
    few = np.minimum(total, sample.runs - total) < FEW * sample.scrambles
    exact = _exact_limits(total[few], sample.runs)
    low[few], high[few] = np.minimum(low[few], exact[0]), np.maximum(high[few], exact[1])
    return low, high


def _exact_limits(count: NDArray[np.int64],
                  runs: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Clopper and Pearson's (1934, Biometrika 26, 404-413)."""
    from scipy.special import betaincinv

    tail = 0.5 - 0.5 * CONFIDENCE
    low = np.where(count > 0, betaincinv(np.maximum(count, 1), runs - count + 1, tail), 0.0)
    high = np.where(count < runs, betaincinv(count + 1, np.maximum(runs - count, 1), 1 - tail), 1.0)
    return low, high


def quantile(values: NDArray[np.float64], level: float, sample: Sample) -> Interval:
    """The least value that is not exceeded by a part `level` of all.

    Its limits are values that are there. Over scrambles they are those at which the interval of the
    probability to be below begins and ceases to hold `level` (Woodruff 1952, J. Am. Stat.
    Assoc. 47, 635-646).

    Parameters
    ----------
    values : (n,) array, NaN where not known
    level : float, 0 to 1
    sample : Sample

    Returns
    -------
    Interval, a limit NaN where so few draws, or those without a result, leave it open
    """
    known = np.isfinite(values)
    order = np.argsort(values, kind="stable")[:known.sum()]
    ranked = values[order]
    if not ranked.size:
        return Interval(math.nan, math.nan, math.nan)
    estimate = float(ranked[max(math.ceil(level * ranked.size - 1e-9), 1) - 1])
    if sample.scrambles < 0:
        return Interval(estimate, math.nan, math.nan)
    below, above = _ranks(known, order, level, sample)
    return Interval(estimate, float(ranked[below]) if below >= 0 else math.nan,
                    float(ranked[above]) if above < ranked.size else math.nan)


def _ranks(known: NDArray[np.bool_], order: NDArray[np.int64], level: float,
           sample: Sample) -> tuple[int, int]:
    """Places of the limits among the values that are known; -1 and their number: there is none."""
    lost = sample.runs - order.size
    if sample.scrambles == 0:
        from scipy.stats import binom

        tail = 0.5 - 0.5 * CONFIDENCE
        return (int(binom.ppf(tail, sample.runs, level)) - 1 - lost if level < 1 else -1,
                int(binom.ppf(1 - tail, sample.runs, level)))
    tried = np.unique(np.linspace(0, order.size, min(order.size + 1, TRIED)).astype(np.int64))
    size = sample.runs // sample.scrambles
    counts = np.stack([np.searchsorted(np.flatnonzero(order // size == i), tried)
                       for i in range(sample.scrambles)])  # those below so many of all
    most = counts + _by_scramble(~known, sample)[:, None]
    low_out = np.maximum.accumulate(_share_limits(most, sample)[1] > level)
    high_in = np.minimum.accumulate((_share_limits(counts, sample)[0] >= level)[::-1])[::-1]
    below = tried[~low_out]
    above = tried[high_in]
    return (int(min(below[-1], order.size - 1)) if below.size else -1,
            int(above[0]) - 1 if above.size and above[0] > 0 else order.size)


def rank_correlation(parameter: NDArray[np.float64], values: NDArray[np.float64],
                     sample: Sample) -> Interval:
    """Spearman's, of the runs in which the value is known, and its limits.

    The limits are Student's t of the jackknife that leaves out a scramble at a time, or a group of
    independent draws (Shao & Tu, The Jackknife and Bootstrap, 1995, section 2.3), of Fisher's
    artanh of the correlation.

    Parameters
    ----------
    parameter, values : (n,) arrays; values NaN where not known
    sample : Sample

    Returns
    -------
    Interval; NaN where nothing varies. Limits NaN where a run has no result, which may be anything,
    or where values other than the commonest are too few for each group
    """
    from scipy.stats import t

    estimate = _spearman(parameter, values)
    unknown = Interval(estimate, math.nan, math.nan)
    groups = sample.scrambles or min(GROUPS, sample.runs // 4)
    if groups < 2 or not math.isfinite(estimate) or not np.isfinite(values).all():
        return unknown
    commonest = int(np.unique(values, return_counts=True)[1].max())
    if sample.runs - commonest < min(FEW * groups, sample.runs - 1):
        return unknown
    group = np.arange(sample.runs) * groups // sample.runs
    left = np.array([_spearman(parameter[group != i], values[group != i]) for i in range(groups)])
    if not np.isfinite(left).all():
        return unknown
    whole, parts = (np.arctanh(np.clip(one, -_NEAR_ONE, _NEAR_ONE)) for one in (estimate, left))
    pseudo = groups * whole - (groups - 1) * parts
    half = t.ppf(0.5 + 0.5 * CONFIDENCE, groups - 1) * pseudo.std(ddof=1) / math.sqrt(groups)
    low, high = (float(np.tanh(whole + sign * half)) for sign in (-1, 1))
    return Interval(estimate, min(low, estimate), max(high, estimate))


def _spearman(parameter: NDArray[np.float64], values: NDArray[np.float64]) -> float:
    """Spearman's, of the runs in which the value is known; NaN where nothing varies."""
    from scipy.stats import rankdata

    known = np.isfinite(values)
    if known.sum() < 3:
        return math.nan
    x, y = (rankdata(one[known]) - (known.sum() + 1) / 2 for one in (parameter, values))
    scale = math.sqrt(float(x @ x) * float(y @ y))
    return float(x @ y) / scale if scale > 0 else math.nan


class Effects(NamedTuple):
    """Sobol's sensitivities of one value, (d, 3): estimate and limits; NaN: not known."""

    main: NDArray[np.float64]
    total: NDArray[np.float64]


def effects(values: NDArray[np.float64], dimensions: int, scrambles: int) -> Effects:
    """Parts of the variance of a value that each parameter makes: alone, and with the others.

    `scipy.stats.sobol_indices` of each scramble (Saltelli et al. 2010, Comput. Phys. Commun. 181,
    259-270), their mean, and Student's t over them.

    Parameters
    ----------
    values : (scrambles·(dimensions + 2)·n,) array, as `points.sensitivity_shares`
    dimensions, scrambles : int

    Returns
    -------
    Effects; NaN where a run has no result, or the value does not vary in some scramble
    """
    from scipy.stats import sobol_indices, t

    unknown = np.full((dimensions, 3), math.nan)
    blocks = values.reshape(scrambles, dimensions + 2, -1)
    if not np.isfinite(values).all() or not np.ptp(blocks[:, :2], axis=(1, 2)).all():
        return Effects(unknown, unknown)
    # Each scramble as if it were an answer of its own: one call for all of them.
    indices = sobol_indices(func={"f_A": blocks[:, 0], "f_B": blocks[:, 1],
                                  "f_AB": np.moveaxis(blocks[:, 2:], 1, 0)}, n=blocks.shape[2])
    every = np.stack([indices.first_order, indices.total_order], axis=1)
    every = every.reshape(scrambles, 2, dimensions)
    half = t.ppf(0.5 + 0.5 * CONFIDENCE, scrambles - 1) * every.std(axis=0, ddof=1) \
        / math.sqrt(scrambles)
    mean = every.mean(axis=0)
    main, total = (np.stack([mean[i], mean[i] - half[i], mean[i] + half[i]], axis=1)
                   for i in range(2))
    return Effects(main, total)


__all__ = ["CONFIDENCE", "Effects", "Interval", "Sample", "effects", "probability", "quantile",
           "rank_correlation"]
