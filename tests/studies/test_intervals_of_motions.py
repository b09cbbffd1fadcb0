"""Intervals against the program's own chaotic motions: the truth comes from a long run.

As in `test_intervals`, 184 of 200 cover; where sums telescope or counts are whole, more do.
"""

import functools
import math

import numpy as np
import pytest

import lapwing
from helpers import scene_a
from lapwing.engine import Numerics, TrajectoryCall, Wanted
from lapwing.studies.critical.starts import follow
from lapwing.studies.intervals import bursts, mean_interval, rate_limit
from lapwing.studies.stability import CycleMaps, exponents, growth

REPEATS, LEAST = 200, 184
SETTLE = 200
COLUMNS = ("counted_impacts", "back_impacts", "deepest_separation")


@functools.cache
def band():
    """A chaotic band of the published gear that strikes its coast flank now and then."""
    return scene_a(0.8)


def start(k):
    return (0.0, -1e-5 * (1 + k / 37), 0.0, 0.0)


def maps(k, record):
    call = TrajectoryCall(band(), start(k), numerics=Numerics(), wanted=Wanted(tangent=True))
    return CycleMaps.from_rows(call.run((SETTLE + record, 0.0), []).tangent[SETTLE:],
                               band().period)


@functools.cache
def long_exponent():
    grown = growth(maps(0.5, 100_000)) / band().period
    return float(grown[100:].mean())


@pytest.mark.parametrize("record", [
    200, *(pytest.param(n, marks=pytest.mark.full) for n in (100, 400, 1500))])
def test_the_lyapunov_exponent_of_a_chaotic_band_is_covered(record):
    """Its sums telescope: the interval is wide, as of the logistic map."""
    found = [exponents(maps(k, record)) for k in range(REPEATS)]
    known = [one for one in found if math.isfinite(one.error)]
    assert len(known) >= 0.95 * REPEATS
    covered = sum(abs(one.largest - long_exponent()) <= one.error for one in known)
    assert covered >= LEAST * len(known) / REPEATS
    # Not so wide that it says nothing: the band is told from a motion without chaos.
    assert record < 400 or all(one.largest > one.error for one in known)


def columns(k, record):
    cycles = lapwing.simulate(band(), cycles=SETTLE + record, start=("separation", *start(k)[1:3]))
    return {name: cycles.cycles[name].values[SETTLE:].astype(float) for name in COLUMNS}


@functools.cache
def long_means():
    found = columns(0.5, 100_000)
    return {name: mean_interval(values) for name, values in found.items()}


@pytest.mark.parametrize("record", [
    300, *(pytest.param(n, marks=pytest.mark.full) for n in (150, 1000))])
def test_means_over_a_chaotic_band_are_covered(record):
    found = [columns(k, record) for k in range(REPEATS)]
    for name, truth in long_means().items():
        intervals = [mean_interval(one[name]) for one in found]
        known = [one for one in intervals if math.isfinite(one.half_width)]
        assert len(known) >= 0.8 * REPEATS, name
        # The truth is not known better than so.
        assert truth.half_width < 0.2 * np.median([one.half_width for one in known])
        covered = sum(abs(one.mean - truth.mean) <= one.half_width for one in known)
        assert LEAST <= covered * REPEATS / len(known), (name, covered, len(known))


def back_cycles(value, record, motions, first=0):
    """Cycles with a back impact of motions from many starts, one array each."""
    starts = [start(first + k) for k in range(motions)]
    fates = follow([scene_a(value)] * motions, starts, SETTLE, record, numerics=Numerics(),
                   threads=1)
    assert not fates.failed.any()
    return fates.back_at


@functools.cache
def long_rate(value):
    """Bursts per cycle in a million cycles: known to 1 %. A fifth of them would leave it open by
    3 %, which bounds from five thousand cycles feel."""
    return bursts(back_cycles(value, 50_000, 20, first=10_000)) / 1_000_000


@pytest.mark.parametrize(("value", "record"), [
    (0.8, 300), pytest.param(0.7, 300, marks=pytest.mark.full),
    pytest.param(0.75, 600, marks=pytest.mark.full),
    pytest.param(0.8, 1200, marks=pytest.mark.full)])
def test_the_rate_of_bursts_of_back_impacts_is_bounded(value, record):
    """Two hundred studies of four motions each."""
    rate = long_rate(value)
    assert 0.001 < rate < 0.5
    times = back_cycles(value, record, 4 * REPEATS)
    seen = [bursts(times[4 * k:4 * k + 4]) for k in range(REPEATS)]
    assert sum(rate_limit(count, 4 * record) >= rate for count in seen) >= LEAST
