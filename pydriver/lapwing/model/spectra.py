"""Order spectra of sampled motions."""

import numpy as np


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
