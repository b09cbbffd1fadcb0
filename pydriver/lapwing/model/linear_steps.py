"""Steps of the engaged equation: power series, free motion, periodic states, least values.

On a step of length w (τ), t = s/w in [0, 1], a solution of φ'' + 2ξφ' + φ = -g'' is a sum of powers
of t; on one that is long against the oscillator's own times a free motion stands beside it.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.polynomial import polynomial as power
from numpy.typing import NDArray

from lapwing.model.transmission_error.extrema import stationary_points

# |λ|·w <= 1 for both free exponents λ, so the first neglected term is below 1/21! = 2e-20.
TERMS = 21


def series(damping_ratio: float, width: NDArray[Any], start: NDArray[Any], slope: NDArray[Any],
           forcing: NDArray[Any]) -> NDArray[Any]:
    """Coefficients of the solution in powers of t for all steps at once.

    Parameters
    ----------
    damping_ratio : float
    width : (n,) array, τ; at most 1/max(1, 2ξ)
    start, slope : (n,) arrays, φ and dφ/dt at t = 0
    forcing : (n, 6) array, g in powers of t

    Returns
    -------
    (n, 21) array
    """
    terms = np.zeros((width.size, TERMS))
    terms[:, 0], terms[:, 1] = start, slope
    for k in range(TERMS - 2):
        terms[:, k + 2] = (-2 * damping_ratio * width * terms[:, k + 1] / (k + 2)
                           - width**2 * terms[:, k] / ((k + 1) * (k + 2)))
        if k < 4:
            terms[:, k + 2] -= forcing[:, k + 2]
    return terms


def expanded(coefficients: NDArray[Any], start: NDArray[Any], width: NDArray[Any]) -> NDArray[Any]:
    """Polynomials in u, t = start + width·u, from ascending powers of t.

    Parameters
    ----------
    coefficients : (m,) array
    start, width : (n,) arrays

    Returns
    -------
    (n, m) array
    """
    taylor = [power.polyval(start, power.polyder(coefficients, k)) / math.factorial(k)
              for k in range(len(coefficients))]
    return np.stack(taylor, axis=1) * np.asarray(width)[:, None] ** np.arange(len(coefficients))


def rates(damping_ratio: float) -> tuple[float, float]:
    """Decay rates of a damped free motion without oscillation: the slow and the fast λ, ξ >= 1."""
    root = math.sqrt(damping_ratio - 1) * math.sqrt(damping_ratio + 1)
    return -1 / (damping_ratio + root), -(damping_ratio + root)


def unit_motions(damping_ratio: float, time: NDArray[Any]) -> NDArray[Any]:
    """Free motions (x, x') at `time` (τ) from x = 1, x' = 0 and from x = 0, x' = 1; any ξ.

    Returns
    -------
    (2, 2) + shape of `time` array: [x or x', start]
    """
    time = np.asarray(time, dtype=float)
    if damping_ratio < 1:
        omega = math.sqrt((1 - damping_ratio) * (1 + damping_ratio))
        decay = np.exp(-damping_ratio * time)
        speed = decay * time * np.sinc(omega * time / math.pi)
        value = decay * np.cos(omega * time) + damping_ratio * speed
        return np.array([[value, speed], [-speed, value - 2 * damping_ratio * speed]])
    slow, fast = rates(damping_ratio)
    apart = slow - fast
    decay, other = np.exp(slow * time), np.exp(fast * time)
    # (1 - e^(-apart·time))/apart, which is `time` where the rates meet.
    mean = time if apart == 0 else -np.expm1(-apart * time) / apart
    speed = decay * mean
    value = (decay + other) / 2 + damping_ratio * speed
    slope = value - 2 * damping_ratio * speed if damping_ratio < 2 \
        else (slow * decay - fast * other) / apart
    return np.array([[value, speed], [-speed, slope]])


def periodic_states(maps: NDArray[Any], shifts: NDArray[Any], jumps: NDArray[Any]) -> NDArray[Any]:
    """(φ, φ') at the start of each step, right of a kink; φ' drops there by the jump of g'.

    Parameters
    ----------
    maps : (n, 2, 2) array
    shifts : (n, 2) array; a step ends in maps·state + shift
    jumps : (n,) array, of g' at the start of each step

    Returns
    -------
    (n, 2) array
    """
    def run(state: NDArray[Any]) -> Iterator[NDArray[Any]]:
        for matrix, shift, drop in zip(maps, shifts, np.roll(jumps, -1), strict=True):
            yield state
            state = matrix @ state + shift - (0.0, drop)
        yield state

    zero, *units = ([*run(np.array(start))][-1] for start in ((0., 0.), (1., 0.), (0., 1.)))
    linear = np.column_stack([unit - zero for unit in units])
    return np.array([*run(np.linalg.solve(np.eye(2) - linear, zero))][:-1])


def lower_bounds(coefficients: NDArray[Any]) -> NDArray[Any]:
    """What each polynomial is not below on [0, 1]: φ >= (φ(0) + φ(1) - max|dφ/dt|)/2."""
    steepest = np.abs(coefficients) @ np.arange(coefficients.shape[1])
    bounds: NDArray[Any] = (coefficients[:, 0] + coefficients.sum(axis=1) - steepest) / 2
    return bounds


def least_value(edges: NDArray[Any], coefficients: NDArray[Any]) -> tuple[float, float]:
    """Least value over a mesh period, and its phase in [0, 1); arguments as of `lowest_point`."""
    least, phase = lowest_point(edges, coefficients)
    return least, phase % 1.0


def lowest_point(edges: NDArray[Any], coefficients: NDArray[Any]) -> tuple[float, float]:
    """Least value over all steps, and where it is.

    Only steps whose bound is below the least end value are searched, by the roots of the
    derivative.

    Parameters
    ----------
    edges : (n+1,) array, ascending
    coefficients : (n, m) array, ascending powers of t = (x - edge)/(step length)

    Returns
    -------
    least, at : float; at = edges[-1] where the last step ends in the least value
    """
    ends = coefficients[:, 0]
    bound = lower_bounds(coefficients)
    best = int(np.argmin(ends))
    least, at = float(ends[best]), float(edges[best])
    for i in np.flatnonzero(bound < least):
        points = stationary_points(coefficients[i])
        values = power.polyval(points, coefficients[i])
        lowest = int(np.argmin(values))
        if values[lowest] < least:
            least = float(values[lowest])
            at = float(edges[i] + points[lowest] * (edges[i + 1] - edges[i]))
    return least, at
