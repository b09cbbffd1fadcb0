"""Sums of harmonics of the mesh: derivatives, tables that follow them, spectra."""

from __future__ import annotations

import math

import numpy as np

# Value, slope, curvature of a harmonic table, each relative to its own maximum ...
_HARMONIC_TOLERANCE = (1e-12, 1e-10, 1e-8)
# ... of one that steps are taken over: below the rounding that a run adds up itself
FINE_TOLERANCE = (1e-16, 2e-14, 3e-12)
# ... and the remainder of quintic Hermite interpolation, max|f - q|^(k) <= c_k h^(6-k) max|f^(6)|
# (Birkhoff & Priver, J. Math. Phys. 46 (1967) 440), attained by f = x^6.
_QUINTIC_REMAINDER = (1 / 46_080, math.sqrt(5) / 30_000, 1 / 1_920)


def harmonic_derivative(series, order, phase):
    """Derivative of Σ amplitude·cos(2πn·phase + shift), rad per period^order, shape of `phase`.

    `series` is the (m, 3) array of n, amplitude (rad), shift (rad) kept by `TransmissionError`.
    """
    number, amplitude, shift = np.asarray(series, dtype=float).T
    rate = 2 * np.pi * number
    angle = np.multiply.outer(phase, rate) + shift + order * np.pi / 2
    return np.cos(angle) @ (amplitude * rate**order)


def harmonic_pieces(series, tolerance=_HARMONIC_TOLERANCE):
    """Smallest number of equal quintic Hermite pieces whose remainder bound is good enough."""
    number, amplitude, _ = series.T
    sixth = np.abs(amplitude) @ (2 * np.pi * number) ** 6
    if sixth == 0:
        return 1
    # Sampled maxima are below the true ones: the count can only come out on the safe side.
    phase = np.linspace(0, 1, 64 * int(number.max()), endpoint=False)
    needed = [(bound * sixth / (allowed * np.abs(harmonic_derivative(series, k, phase)).max()))
              ** (1 / (6 - k))
              for k, (bound, allowed) in enumerate(
                  zip(_QUINTIC_REMAINDER, tolerance, strict=True))]
    return math.ceil(max(needed))


def order_spectrum(values, cycles):
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


def harmonic_table(series, tolerance=_HARMONIC_TOLERANCE):
    """Quintic Hermite pieces of a series: knots (n + 1,) and coefficients (n, 6)."""
    from scipy.interpolate import BPoly, PPoly

    n = harmonic_pieces(series, tolerance)
    knots = np.arange(n + 1) / n
    rows = np.stack([harmonic_derivative(series, k, knots % 1) for k in range(3)], axis=1)
    pieces = PPoly.from_bernstein_basis(BPoly.from_derivatives(knots, rows))
    return knots, pieces.c[::-1].T
