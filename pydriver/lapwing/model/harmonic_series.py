"""Sums of harmonics of the mesh: derivatives, tables that follow them, spectra."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

# Value, slope, curvature of a harmonic table, each relative to its own maximum ...
_HARMONIC_TOLERANCE = (1e-12, 1e-10, 1e-8)
# ... of one that steps are taken over: below the rounding that a run adds up itself
FINE_TOLERANCE = (1e-16, 2e-14, 3e-12)
# ... and the remainder of quintic Hermite interpolation, max|f - q|^(k) <= c_k h^(6-k) max|f^(6)|
# (Birkhoff & Priver, J. Math. Phys. 46 (1967) 440), attained by f = x^6.
_QUINTIC_REMAINDER = (1 / 46_080, math.sqrt(5) / 30_000, 1 / 1_920)


def harmonic_derivative(series: NDArray[Any], order: int, phase: NDArray[Any]) -> NDArray[Any]:
    """Derivative of Σ amplitude·cos(2πn·phase + shift), rad per period^order, shape of `phase`.

    `series` is the (m, 3) array of n, amplitude (rad), shift (rad) kept by `TransmissionError`.
    """
    number, amplitude, shift = np.asarray(series, dtype=float).T
    rate = 2 * np.pi * number
    angle = np.multiply.outer(phase, rate) + shift + order * np.pi / 2
    value: NDArray[Any] = np.cos(angle) @ (amplitude * rate**order)
    return value


def harmonic_pieces(series: NDArray[Any],
                    tolerance: tuple[float, float, float] = _HARMONIC_TOLERANCE) -> int:
    """Smallest number of equal quintic Hermite pieces whose remainder bound is good enough."""
    number, amplitude, _ = series.T
    sixth = np.abs(amplitude) @ (2 * np.pi * number) ** 6
    if sixth == 0:
        return 1
    # Sampled maxima are below the true ones: the count can only come out on the safe side.
    phase = np.linspace(0, 1, 64 * int(number.max()), endpoint=False)
    needed: list[float] = [
        (bound * sixth / (allowed * np.abs(harmonic_derivative(series, k, phase)).max()))
        ** (1 / (6 - k))
        for k, (bound, allowed) in enumerate(zip(_QUINTIC_REMAINDER, tolerance, strict=True))]
    return math.ceil(max(needed))


def order_spectrum(values: NDArray[Any], cycles: int) -> tuple[NDArray[Any], NDArray[Any]]:
    """Amplitude spectrum of evenly spaced samples over whole mesh cycles, Hann window.

    Parameters
    ----------
    values : array (n,); the mean is taken off first
    cycles : int, mesh cycles they cover

    Returns
    -------
    orders, amplitudes : arrays (n//2 + 1,)
        In mesh orders, 1/cycles apart; amplitude of a cosine of that order (half its
        peak-to-peak), exact where the order is a whole number of bins.
    """
    values = np.asarray(values, dtype=float)
    n = values.size
    window = 0.5 - 0.5 * np.cos(2 * np.pi * np.arange(n) / n)
    amplitudes = 2 * np.abs(np.fft.rfft(window * (values - values.mean()))) / window.sum()
    return np.arange(amplitudes.size) / cycles, amplitudes


# c3, c4·h, c5·h² of a quintic Hermite piece by what its right end's value, slope and curvature
# are beyond the Taylor polynomial of the left end to h², each over the power of h it starts with.
_QUINTIC_WEIGHTS = np.array([[10, -4, 0.5], [-15, 7, -1], [6, -3, 0.5]])


def _taylor_remainders(z: NDArray[Any]) -> NDArray[Any]:
    """φ3, φ2, φ1 at z, (3, m): φk(z) = (e^z - Σ_{j<k} z^j/j!)/z^k, without cancellation near 0.

    The φ functions of exponential integrators (Hochbruck & Ostermann, Acta Numerica 19 (2010) 209).
    """
    phi = np.empty((3, z.size), dtype=complex)
    small = np.abs(z) < 1
    for row, k in enumerate((3, 2, 1)):
        # The first term left out is below 1e-17 of the sum.
        phi[row, small] = np.polynomial.polynomial.polyval(
            z[small], [1 / math.factorial(j + k) for j in range(18)])
    far, last = z[~small], np.exp(z[~small])
    for k in (1, 2, 3):
        last = (last - 1 / math.factorial(k - 1)) / far
        phi[3 - k, ~small] = last
    return phi


def harmonic_table(series: NDArray[Any],
                   tolerance: tuple[float, float, float] = _HARMONIC_TOLERANCE) -> tuple[
        NDArray[Any], NDArray[Any]]:
    """Quintic Hermite pieces of a series: knots (n + 1,) and coefficients (n, 6).

    Coefficients come from each harmonic's remainder over a piece, not from differences of the
    ends, which leave rounding/h² in the curvature.
    """
    n = harmonic_pieces(series, tolerance)
    knots, h = np.arange(n + 1) / n, 1 / n
    number, amplitude, shift = np.asarray(series, dtype=float).T
    rate = 2 * np.pi * number
    ends = [harmonic_derivative(series, k, knots[:-1]) for k in range(3)]
    # Re of a·(iω)³ e^{i(ωt + shift)}: the third derivative, which every remainder starts with.
    third = np.exp(1j * (np.multiply.outer(knots[:-1], rate) + shift)) * (
        amplitude * (1j * rate) ** 3)
    beyond = (third @ (_QUINTIC_WEIGHTS @ _taylor_remainders(1j * rate * h)).T).real
    coefficients = np.column_stack([ends[0], ends[1], ends[2] / 2, beyond / h ** np.arange(3)])
    return knots, coefficients
