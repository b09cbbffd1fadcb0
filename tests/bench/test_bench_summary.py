"""Choosing settings, ratios, cost at equal error."""

import numpy as np
import pytest
import xarray as xr

from lapwing_bench import summary


def dataset(settings, *, calm=True, torques=5):
    """Settings: (method, tolerance, error at every torque, µs at each torque, missed)."""
    n = len(settings)
    error = np.full((n, torques, 2), np.nan)
    microseconds, missed = np.zeros((n, torques)), np.zeros((n, torques, 2))
    for k, (_, _, size, cost, wrong) in enumerate(settings):
        error[k, :, 0] = size
        if calm:
            error[k, :, 1] = size
        microseconds[k], missed[k, 0, 0] = cost, wrong
    by_horizon = ("setting", "torque", "horizon")
    return xr.Dataset({
        "error": (by_horizon, error), "missed": (by_horizon, missed),
        "doubled": (by_horizon, np.zeros_like(missed)),
        "microseconds": (("setting", "torque"), microseconds),
        "events_per_cycle": (("setting", "torque"), np.ones((n, torques))),
        "method": ("setting", [s[0] for s in settings]),
        "tolerance": ("setting", [s[1] for s in settings]),
        **{name: ("setting", np.full(n, np.nan))
           for name in ("study_computed", "study_copied", "scaling")},
        "identical_bytes": ("setting", np.full(n, -1)),
        "calm": ("torque", np.full(torques, int(calm)))})


def test_the_cheapest_that_is_accurate_is_chosen():
    data = dataset([("a", 1e-6, 1e-8, 1.0, 0), ("a", 1e-8, 5e-10, 3.0, 0),
                    ("a", 1e-9, 5e-11, 2.5, 0), ("a", 1e-10, 5e-12, 2.0, 1)])
    assert summary.chosen(data, "a") == 2
    assert summary.chosen(data, "b") is None


def test_the_most_accurate_where_none_is_accurate():
    assert summary.chosen(dataset([("a", 1e-4, 1e-5, 1.0, 0), ("a", 1e-6, 1e-7, 9.0, 0)]),
                          "a") == 1


def test_ratio_is_the_median_over_common_torques():
    slow, fast = np.array([4.0, np.nan, 8.0, 100.0, np.nan]), np.array([2.0, 1.0, 2.0, 1.0, 1.0])
    data = dataset([("a", 1e-9, 1e-10, slow, 0), ("b", 1e-9, 1e-10, fast, 0)])
    assert summary.ratio(data, 0, 1) == 4.0


def test_few_calm_torques_leave_it_to_the_short_horizon():
    data = dataset([("a", 1e-9, 1e-10, 1.0, 0)], calm=False)
    assert summary.deciding_horizon(data) == 0 and summary.counting(data).all()
    assert summary.deciding_horizon(dataset([("a", 1e-9, 1e-10, 1.0, 0)])) == 1


def test_few_calm_torques_speak_for_themselves():
    data = dataset([("a", 1e-9, 1e-10, np.array([1.0, 2.0, 3.0, 4.0, 5.0]), 0)])
    assert summary.few_calm(data) is None
    data["calm"][:] = [0, 0, 1, 0, 0]
    few = summary.few_calm(data)
    assert summary.deciding_horizon(few) == 1 and summary.lines(few)[0].cost == 3.0
    data["calm"][:] = 0
    assert summary.few_calm(data) is None


def test_cost_at_equal_error():
    """Ten times the work for a ten-thousandth of the error: between them the square root."""
    data = dataset([("a", 1e-4, 1e-4, 1.0, 0), ("a", 1e-8, 1e-8, 10.0, 0)])
    assert summary.cost_at(data, "a", 1e-6) == pytest.approx(10**0.5)
    assert summary.cost_at(data, "a", 1e-2) == 1.0
    assert np.isnan(summary.cost_at(data, "a", 1e-10))


def test_missed_events_are_infinitely_wrong():
    data = dataset([("a", 1e-4, np.inf, 1.0, 1)])
    assert np.isnan(summary.cost_at(data, "a", 1.0))
    assert summary.lines(data)[0].errors[0] == (np.inf, np.inf)
