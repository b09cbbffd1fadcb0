"""Order spectra over a sweep: lines of known motions."""

import numpy as np
import pytest

from helpers import PAIR, SHIPPED
from lapwing import Status, TransmissionError, sweep
from lapwing.studies.sweep.waterfall import CYCLES

OPERATION = {"pinion_speed_rpm": 1500, "settle": 100, "record": 10, "starts": ("rest",)}


def test_the_engaged_motion_has_the_lines_of_its_linear_response():
    """One harmonic: order 1 alone, of the amplitude of the linear oscillator."""
    te = TransmissionError.harmonic([1e-6], [0.3], [1])
    data = sweep(PAIR, te, values=[5.0, 9.0], observe=("cycles", "spectra"), **OPERATION)
    osc = PAIR.oscillator(te, brake_torque=5.0, pinion_speed_rpm=1500)
    ratio = osc.mesh_frequency_ratio
    # -g'' of amplitude i12·A·Ω² drives the oscillator.
    expected = 1.28e-6 * ratio**2 / np.hypot(1 - ratio**2, 2 * osc.damping_ratio * ratio)
    lines = data["order_spectrum"].values[0]
    assert data["order"].values[CYCLES] == 1
    # Kept in single precision; the sweep's tolerance is 1e-6.
    assert lines[:, CYCLES] == pytest.approx([expected] * 2, rel=1e-5)
    # The Hann window has lines of half the height beside a line, and nothing further off.
    assert lines[:, CYCLES + 1] == pytest.approx([0.5 * expected] * 2, rel=1e-4)
    assert lines[:, CYCLES + 3:].max() < 1e-5 * expected


def test_period_two_has_half_orders_and_chaos_a_floor():
    data = sweep(PAIR, TransmissionError.parabola(125e-6), values=[1.0, 5.5], settle=300,
                 record=20, starts=("rest",), pinion_speed_rpm=480, phase=0.25,
                 observe=("cycles", "spectra"))
    chaos, doubled = data["order_spectrum"].values[0]
    assert data["period"].values[0].tolist() == [0, 2]
    half, between = CYCLES // 2, CYCLES // 4
    assert doubled[half] > 1e3 * doubled[between]
    assert chaos[between] > 1e-2 * chaos.max()


def test_a_failed_point_has_no_spectrum():
    data = sweep(PAIR, SHIPPED, values=[1.0, 14.0], max_events_per_cycle=2,
                 observe=("cycles", "spectra"), **{**OPERATION, "pinion_speed_rpm": 240})
    assert data["status"].values[0].tolist() == [Status.TOO_MANY_EVENTS, Status.OK]
    assert np.all(np.isnan(data["order_spectrum"].values[0, 0]))
    assert np.all(np.isfinite(data["order_spectrum"].values[0, 1]))
    assert data["mesh_frequency_ratio"].values == pytest.approx(
        [PAIR.oscillator(SHIPPED, brake_torque=1.0, pinion_speed_rpm=240).mesh_frequency_ratio] * 2)
