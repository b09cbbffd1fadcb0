"""How often the 95 % interval of T_full holds the truth, over seeded repeats of a measurement.

`python tests/model/curve/test_coverage.py` prints the table of docs/method.md, in half an hour.
"""

import sys
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parents[2]))

from lapwing import TransmissionError, critical_torque
from lapwing.model.curve.fit import fit_curve
from lapwing.model.curve.interval import force_bounds
from measured import ARCSEC, PHASE, TRUTH, kinks, oscillator, samples

NOISES = (0.1, 0.4, 1.0)
METHODS = {"harmonics": {"harmonics": 4}, "smoothing": {}}
REPEATS = 200
# 92 %: 0.95 of 200 less two standard deviations of a binomial number.
LEAST = 0.92


class Record(NamedTuple):
    """Of all repeats: T_full (N·m), and the ends of its interval."""

    low: np.ndarray
    value: np.ndarray
    high: np.ndarray

    def covered(self, truth):
        """How many intervals hold the truth."""
        return int(np.sum((self.low <= truth) & (truth <= self.high)))

    @property
    def width(self):
        """Widths of the intervals, N·m."""
        return self.high - self.low


def measure(name, noise, method, repeats, **options):
    """The same curve measured again and again."""
    rows = []
    for seed in range(repeats):
        fit = fit_curve(PHASE, samples(name, noise, seed), kinks(name), **METHODS[method],
                        **options)
        osc = oscillator(fit.te)
        rows.append(np.array(force_bounds(osc, fit)[:3]) / osc.scales.force_per_torque)
    return Record(*np.array(rows).T)


# The dearest of them with the long ones.
@pytest.mark.parametrize(("name", "method"), [
    pytest.param(name, method, marks=[pytest.mark.full] * ((name, method) == (
        "kinked", "smoothing"))) for name in TRUTH for method in METHODS])
def test_the_interval_holds_the_truth_daily(name, method):
    record = measure(name, 0.4, method, 12)
    assert record.covered(TRUTH[name]) >= int(LEAST * 12)
    if name == "smooth":
        assert np.median(record.width) <= 1.0


@pytest.mark.full
@pytest.mark.parametrize("noise", NOISES)
@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("name", TRUTH)
def test_the_interval_holds_the_truth(name, method, noise):
    record = measure(name, noise, method, REPEATS)
    assert record.covered(TRUTH[name]) >= LEAST * REPEATS
    if name == "smooth" and noise == 0.4:
        # Cross-validation now and then lets noise through, and the interval says so.
        assert np.sum(record.width <= 1.0) >= {"harmonics": REPEATS, "smoothing": 195}[method]


@pytest.mark.full
def test_a_stated_noise_level_holds_it_as_well():
    for name, truth in TRUTH.items():
        record = measure(name, 0.4, "smoothing", REPEATS, noise_level=0.4 * ARCSEC)
        assert record.covered(truth) >= LEAST * REPEATS


def raw(name, noise, repeats):
    """T_full of tables used raw."""
    return np.array([critical_torque(oscillator(TransmissionError.from_samples(
        PHASE, samples(name, noise, seed), kinks(name))))[0] for seed in range(repeats)])


def cubic(name, noise, repeats):
    """T_full of SciPy's cubic smoothing spline and its cross-validation, over three periods.

    At a kink, which it does not know, it is cut: the middle third from kink to kink.
    """
    from scipy.interpolate import make_smoothing_spline

    found = []
    for seed in range(repeats):
        value = samples(name, noise, seed)
        if kinks(name).any():
            x, y = np.append(PHASE, 1.0), np.append(value, value[0])
            curve = make_smoothing_spline(x, y)
        else:
            x = np.concatenate([PHASE - 1, PHASE, PHASE + 1])
            curve = make_smoothing_spline(x, np.tile(value, 3))
        fine = np.arange(240) / 240
        fine_value = curve(fine)
        found.append(critical_torque(oscillator(TransmissionError.from_samples(
            fine, fine_value, (fine == 0) & kinks(name).any())))[0])
    return np.array(found)


if __name__ == "__main__":
    print("curve   arcsec method       T_full           held of 200  width: median, greatest")
    for name, truth in TRUTH.items():
        for noise in NOISES:
            for method, found in (("raw", raw(name, noise, 40)), ("cubic", cubic(name, noise, 40))):
                print(f"{name:7} {noise:6} {method:10} {found.mean():7.3f} ± {found.std():.3f}")
            for method in METHODS:
                record = measure(name, noise, method, REPEATS)
                print(f"{name:7} {noise:6} {method:10} {record.value.mean():7.3f} ± "
                      f"{record.value.std():.3f}      {record.covered(truth):4}         "
                      f"{np.median(record.width):.2f}  {record.width.max():.2f}", flush=True)
