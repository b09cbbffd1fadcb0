"""Where polynomials, and tables of them, are least and greatest."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.polynomial import polynomial as power
from numpy.typing import NDArray

# Bernstein coefficients on [0, 1] of degree 5 from ascending powers: b_i = sum_k C(i,k)/C(5,k) c_k.
_TO_BERNSTEIN = np.array([[math.comb(i, k) / math.comb(5, k) for k in range(6)] for i in range(6)])


def extrema_of(knots: NDArray[np.float64],
               coefficients: NDArray[np.float64]) -> tuple[float, float]:
    """Least and greatest value of a table of pieces, from the roots of their derivatives.

    Only pieces that may pass all knots are searched: a polynomial lies between the least and the
    greatest of its Bernstein coefficients.

    Parameters
    ----------
    knots : (n + 1,) array
    coefficients : (n, 6) array; ascending powers of (phase - knots[i])
    """
    scaled = coefficients * np.diff(knots)[:, None] ** np.arange(6)
    bounds = scaled @ _TO_BERNSTEIN.T
    # What the sums above may be wrong by.
    slack = 64 * np.finfo(float).eps * np.abs(scaled).sum(axis=1)
    ends = bounds[:, [0, -1]]
    low, high = float(ends.min()), float(ends.max())
    searched = (bounds.min(axis=1) - slack < low) | (bounds.max(axis=1) + slack > high)
    low, high = math.inf, -math.inf
    for piece in scaled[searched | (np.arange(len(scaled)) == 0)]:
        values = power.polyval(stationary_points(piece), piece)
        low, high = min(low, float(values.min())), max(high, float(values.max()))
    return low, high


def stationary_points(coefficients: NDArray[Any]) -> NDArray[Any]:
    """Points of [0, 1] among which a polynomial (ascending powers) takes its least and greatest.

    The ends and the roots of the derivative; a complex root gives its real part, which does no
    harm as every point returned lies in [0, 1].  The roots are eigenvalues of the companion
    *pencil*: a leading coefficient of rounding size, as a cubic through a parabola has, gives one
    very large root and leaves the others exact, where the companion matrix would lose them.
    """
    from scipy.linalg import eigvals

    slope = power.polyder(coefficients)
    largest = np.abs(slope).max()
    if largest == 0:
        return np.array([0.0, 1.0])
    slope, degree = slope / largest, slope.size - 1
    left, right = np.eye(degree, k=1), np.eye(degree)
    left[-1], right[-1, -1] = -slope[:-1], slope[-1]
    numerator, denominator = eigvals(left, right, homogeneous_eigvals=True)
    finite = np.abs(denominator) > 0
    roots = (numerator[finite] / denominator[finite]).real
    return np.concatenate([[0.0, 1.0], np.clip(roots, 0.0, 1.0)])
