"""Intervals that cover what they claim: means of correlated series, rates of events in clusters.

Where a series is too short for its own correlation nothing is claimed: the half width is NaN.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

CONFIDENCE = 0.95
# Of a normal variable, exceeded by one in twenty.
ONE_SIDED = 1.645
# The sum of autocorrelations is cut at so many of its own correlation times (Sokal's window): what
# is left out of an exponential is e^-5.
WINDOW = 5.0
# A record of so many correlation times needs no second estimate of them. Of a shorter one it comes
# from blocks of 1, 2, 4 ... samples, as long as so many blocks are left.
LONG_TIMES, FEWEST_BLOCKS = 200.0, 40
# A batch is at least so many correlation times long.
BATCH_TIMES = 5.0
# Fewer batches say nothing of their own scatter; more make an interval hardly any steadier, and
# longer ones depend less on each other.
FEWEST_BATCHES, MOST_BATCHES = 8, 32
# A record of fewer correlation times shows too little of its own correlation for batches alone, and
# those that seem long enough are those whose time was found too short. Of n samples the time T has
# a standard error of T·√(2(2W + 1)/n) with the window W = 5T, about T·√(20T/n).
SHORT_TIMES, TIME_SCATTER = 60.0, 20.0


class MeanInterval(NamedTuple):
    """Mean of a correlated series and what is known of it.

    Attributes
    ----------
    mean : float
    half_width : float, half of the interval; NaN: not known
    effective : float, independent samples with as sure a mean; NaN where it is not known
    batches : int, behind the interval; 0 where it is not known
    """

    mean: float
    half_width: float
    effective: float
    batches: int


def correlation_time(values: np.ndarray) -> float:
    """Sum of the autocorrelations over both sides, in samples; infinite where the series is short.

    Of a record shorter than 200 times the sum, the larger of two estimates, since too small a time
    makes an interval that covers too little: the sum as it is seen, and what blocks of doubling
    length tell of an autoregressive series. The sum is cut at the first lag W of at least `WINDOW`
    times itself; taking the mean from the series has cost it a part of (2W + 1)/n, which is given
    back (Wolff 2004, Comput. Phys. Commun. 156, 143-153).

    Parameters
    ----------
    values : array (n,), not all the same
    """
    time = _by_autocorrelation(values)
    return time if len(values) >= LONG_TIMES * time else max(time, _by_blocks(values))


def _by_autocorrelation(values: NDArray[Any]) -> float:
    """Sokal's sum; of a short record easily half of what it should be."""
    apart = values - values.mean()
    n = len(apart)
    spectrum = np.fft.rfft(apart, 2 * n)
    covariance = np.fft.irfft(spectrum * spectrum.conj(), 2 * n)[:n]
    sums = 2 * np.cumsum(covariance / covariance[0]) - 1
    enough = np.arange(n) >= np.maximum(WINDOW * sums, 1)
    lag = int(np.argmax(enough))
    return float(sums[lag] * (1 + (2 * lag + 1) / n)) if enough.any() else math.inf


def _by_blocks(values: NDArray[Any]) -> float:
    """The largest that the neighbours among means of blocks tell, as of an autoregressive series.

    Of one with parameter r the time is (1 + r)/(1 - r); the estimate of r from n values is too
    small by (1 + 3r)/n (Kendall 1954, Biometrika 41, 403-404).
    """
    longest, size, variance = 0.0, 1, values.var()
    while len(values) // size >= FEWEST_BLOCKS:
        blocks = len(values) // size
        means = values[len(values) - blocks * size:].reshape(blocks, size).mean(axis=1)
        apart = means - means.mean()
        square = apart @ apart
        if square > 0:
            alike = (apart[1:] @ apart[:-1]) / square
            alike = min(alike + (1 + 3 * alike) / blocks, 1 - 1 / blocks)
            longest = max(longest, size * means.var() / variance * (1 + alike) / (1 - alike))
        size *= 2
    return longest


def mean_interval(values: np.ndarray, confidence: float = CONFIDENCE) -> MeanInterval:
    """Interval of the mean of a stationary series from the means of batches.

    1. The correlation time gives the least length of a batch.
    2. Where neighbouring batch means are still alike, batches are made twice as long.
    3. Batches of L samples with a correlation time of T still share some: of an autoregressive
       series their means vary too little by (T - 1/T)/(2L). Twice that is added.
    4. Where the record is shorter than 60 correlation times, the variance is not taken for less
       than that of the series times T/n, with the upper limit (one-sided 95 %) of T, whose standard
       error is √(20T/n) of it (Madras and Sokal 1988, J. Stat. Phys. 50, 109-186): which short
       records have an interval at all depends on T.
    5. Student's t of the number of batches, 8 to 32, gives the interval. Where the series does
       not make 8 of 5 times each, or does not vary at all, it is not known.

    Batch means and t: Law and Carson (1979), Oper. Res. 27, 1011-1025; how many: Schmeiser (1982),
    Oper. Res. 30, 556-568.

    Parameters
    ----------
    values : array (n,)
    confidence : float, 0 to 1

    Returns
    -------
    MeanInterval
    """
    values = np.asarray(values, dtype=float)
    mean = float(np.mean(values)) if values.size else math.nan
    unknown = MeanInterval(mean, math.nan, math.nan, 0)
    if len(values) < FEWEST_BATCHES or not np.all(np.isfinite(values)) or np.ptp(values) == 0:
        return unknown
    time = max(correlation_time(values), 1.0)
    least = BATCH_TIMES * time
    if least > len(values) / FEWEST_BATCHES:
        return unknown
    from scipy.special import stdtrit  # scipy.stats takes long to load

    batches = min(MOST_BATCHES, int(len(values) // math.ceil(least)))
    while batches >= FEWEST_BATCHES:
        length = len(values) // batches
        means = values[len(values) - length * batches:].reshape(batches, length).mean(axis=1)
        if not _alike(means):
            variance = means.var(ddof=1) / batches / (1 - (time - 1 / time) / length)
            if len(values) < SHORT_TIMES * time:
                longer = time * (1 + ONE_SIDED * math.sqrt(TIME_SCATTER * time / len(values)))
                variance = max(variance, values.var() * longer / len(values))
            half = stdtrit(batches - 1, 0.5 + 0.5 * confidence) * math.sqrt(variance)
            effective = values.var() / variance if variance > 0 else math.nan
            return MeanInterval(mean, float(half), float(effective), batches)
        batches //= 2
    return unknown


def _alike(means: NDArray[Any]) -> bool:
    """Whether neighbours among batch means are more alike than chance makes them (one in 20)."""
    apart = means - means.mean()
    square = apart @ apart
    limit = ONE_SIDED / math.sqrt(len(means))
    return bool(square > 0 and (apart[1:] @ apart[:-1]) / square > limit)


def bursts(times: list[np.ndarray]) -> int:
    """Number of bursts among events that come in clusters, as few as the gaps allow for.

    The extremal index (part of the events that begin a burst) is estimated from the gaps between
    events of one record, after Ferro and Segers (2003, J. R. Statist. Soc. B 65, 545-556); the
    largest gaps separate bursts.

    Parameters
    ----------
    times : list of arrays (n,) of int, rising; whole cycles with an event, one array per record

    Returns
    -------
    int; at least one per record with an event
    """
    gaps = np.concatenate([np.diff(some) for some in times] or [np.empty(0, int)])
    records = sum(len(some) > 0 for some in times)
    apart = np.sort(gaps)[::-1]
    between = min(int(_extremal_index(gaps) * gaps.size), gaps.size)
    # Equal gaps are alike: either all of them separate bursts or none does.
    if 0 < between < gaps.size:
        between = int(np.sum(apart > apart[between]))
    # A gap of one cycle is none.
    return records + min(between, int(np.sum(gaps > 1)))


def _extremal_index(gaps: NDArray[Any]) -> float:
    """Moment estimate from gaps; 1 where there are none."""
    if not gaps.size:
        return 1.0
    less = (gaps - 1.0, gaps - 2.0) if gaps.max() > 2 else (gaps.astype(float),) * 2
    mixed = np.sum(less[0] * less[1])
    return min(1.0, float(2 * np.sum(less[0]) ** 2 / (gaps.size * mixed))) if mixed > 0 else 1.0


def rate_limit(events: np.ndarray, exposure: np.ndarray,
               confidence: float = CONFIDENCE) -> NDArray[Any]:
    """Exact one-sided upper limit of a Poisson rate: χ²(confidence; 2·events + 2)/(2·exposure).

    Parameters
    ----------
    events : array of int, independent of each other
    exposure : array, what they were seen in; 0: the limit is infinite
    confidence : float, 0 to 1

    Returns
    -------
    array, events per unit of exposure
    """
    from scipy.special import gammaincinv  # scipy.stats takes long to load

    with np.errstate(divide="ignore"):
        limit: NDArray[Any] = gammaincinv(np.asarray(events) + 1, confidence) / exposure
    return limit
