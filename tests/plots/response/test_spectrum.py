"""The order spectrum against series whose amplitudes are known."""

import numpy as np
import pytest

from lapwing.plots.response.spectrum import HANN_BANDWIDTH, order_spectrum

CYCLES, PER_CYCLE = 50, 64
PHASE = np.arange(CYCLES * PER_CYCLE) / PER_CYCLE


def at(orders, amplitudes, order):
    return amplitudes[np.argmin(np.abs(orders - order))]


def test_cosines_have_their_amplitudes():
    """Orders on a bin: the window's side lobes vanish, rounding is left."""
    values = 7 + 3 * np.cos(2 * np.pi * PHASE + 0.4) + 0.02 * np.sin(2 * np.pi * 2.5 * PHASE)
    orders, amplitudes = order_spectrum(values, CYCLES)
    assert at(orders, amplitudes, 1) == pytest.approx(3, rel=1e-12)
    assert at(orders, amplitudes, 2.5) == pytest.approx(0.02, rel=1e-10)
    assert at(orders, amplitudes, 0) == pytest.approx(0, abs=1e-12)
    assert at(orders, amplitudes, 5) == pytest.approx(0, abs=1e-12)


def test_orders_are_a_bin_apart():
    orders, _ = order_spectrum(np.cos(2 * np.pi * PHASE), CYCLES)
    np.testing.assert_allclose(np.diff(orders), 1 / CYCLES, rtol=1e-9)
    assert orders[-1] == PER_CYCLE / 2


def test_between_two_bins_the_loss_is_that_of_the_window():
    """Half a bin off, a Hann window reads 8/(3π) of the amplitude."""
    order = 3 + 0.5 / CYCLES
    _, amplitudes = order_spectrum(np.cos(2 * np.pi * order * PHASE), CYCLES)
    assert amplitudes.max() == pytest.approx(8 / (3 * np.pi), rel=1e-3)


def test_noise_bandwidth_of_the_window():
    window = 0.5 - 0.5 * np.cos(2 * np.pi * np.arange(1000) / 1000)
    assert 1000 * np.sum(window**2) / np.sum(window)**2 == pytest.approx(HANN_BANDWIDTH)


def test_the_resolution_is_stated():
    import xarray as xr

    from lapwing.plots.response.spectrum import draw

    n = CYCLES * PER_CYCLE
    wave = np.cos(2 * np.pi * PHASE)
    response = xr.Dataset(
        {"phi": ("sample", 1e-6 * wave), "mesh_force": ("sample", np.full(n, np.nan)),
         "dynamic_te": ("sample", 1e-6 * wave), "sample_cycle": ("sample", PHASE.astype(int)),
         "cycle_phi": ("cycle", np.zeros(CYCLES))},
        attrs={"name": "wave", "status": 0, "period": 3, "mesh_frequency_ratio": 0.1,
               "mesh_period_s": 0.01, "count_depth": 0.01})
    figure = draw(response)
    label = figure.axes[-1].get_xlabel()
    assert "Hann window over 48 cycles" in label and "resolution 0.0312 order" in label
    curve = figure.axes[0].lines[0].get_xydata()
    assert curve[np.argmin(np.abs(curve[:, 0] - 1)), 1] == pytest.approx(1, rel=1e-3)
