"""Order spectra over a sweep: each point goes on from its last state, sampled evenly."""

from __future__ import annotations

import math
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from lapwing.base.codes import Status
from lapwing.engine import TrajectoryCall, Wanted, position
from lapwing.engine.records import SAMPLE
from lapwing.model.harmonic_series import order_spectrum

if TYPE_CHECKING:
    from lapwing.engine.numerics import Numerics
    from lapwing.model.oscillator import Oscillator

# Mesh cycles of a spectrum, whose lines are 1/48 of an order apart (those of periods 2, 3, 4, 6,
# 8, … are among them), and samples in each: the displacement's lines fall with the square of the
# order, so that what is folded back onto the orders kept, from 128 less these, is below a hundredth
# of the lines there.
CYCLES, SAMPLES = 48, 128
# Orders kept: the natural frequency with half as much again, within these.
LEAST_ORDER, MOST_ORDER = 8, 24


def lines_of(oscillators: Sequence[Oscillator]) -> int:
    """Lines of each spectrum of a waterfall of these oscillators."""
    highest = min(max(LEAST_ORDER, math.ceil(max(
        1.5 / osc.mesh_frequency_ratio for osc in oscillators))), MOST_ORDER)
    return highest * CYCLES + 1


def orders(lines: int) -> NDArray[np.float64]:
    """Orders of these lines, (lines,)."""
    return np.arange(lines) / CYCLES


def spectra(oscillators: list[Oscillator], finals: NDArray[Any], phase: float, lines: int, *,
            numerics: Numerics, threads: int) -> NDArray[Any]:
    """Order spectra of the displacement φ.

    Parameters
    ----------
    oscillators : sequence of Oscillator (points,)
    finals : table (points,), how each point's run ended, `engine.SweepResult.outcome`
    phase : float, mesh phase there
    lines : int, `lines_of` the whole waterfall
    numerics : Numerics
    threads : int

    Returns
    -------
    (points, lines) array of amplitudes at `orders(lines)`, rad; NaN where a point failed
    """
    amplitudes = np.full((len(oscillators), lines), np.nan, dtype=np.float32)
    total = phase + np.arange(CYCLES * SAMPLES) / SAMPLES
    cycle = np.floor(total)

    def one(i: int) -> None:
        osc, final = oscillators[i], finals[i]
        if final["status"] != Status.OK:
            return
        times = np.column_stack([cycle, (total - cycle) * osc.period])
        start = (*(final[name] for name in SAMPLE), phase)
        call = TrajectoryCall(osc, start, numerics=numerics, wanted=Wanted())
        call.run(position(phase, CYCLES, osc.period), times)
        if call.status == Status.OK:
            amplitudes[i] = order_spectrum(call.samples["phi"], CYCLES)[1][:amplitudes.shape[1]]

    with ThreadPoolExecutor(threads) as pool:
        list(pool.map(one, range(len(oscillators))))
    return amplitudes
