"""The periodic smoothing spline of degree five, with kinks.

It makes Σ(sample - curve)² + λ·∫(d³curve/dphase³)² least: one order higher than the cubic spline,
because the curvature is what moves the teeth.  Its Fourier series is taken, cut off at an order
(Wahba, Spline Models for Observational Data, 1990, section 2.1).

λ makes the generalised cross-validation of Craven & Wahba (Numer. Math. 31 (1979) 377) least, each
degree of freedom counted 1.4 times against the occasional undersmoothing (Kim & Gu, J. R. Stat.
Soc. B 66 (2004) 337); where the noise level is known, their unbiased risk takes its place.  The
jumps of slope, which are not smoothed, are found by Speckman's estimator (J. R. Stat. Soc. B 50
(1988) 413): in those of the partial spline the smoothing of the rest would leave a bias.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lapwing.model.curve.basis import LEAST_FREEDOM, LeastSquares, design, fit_problem

# A degree of freedom counts so many times in the choice of λ.
_INFLATION = 1.4
# Orders that smoothing lets through by less are left out of the curve: far below the noise ...
_LEAST_PASSED = 1e-3
# ... and of the fit that intervals rest on.
_WIDE_PASSED = 0.1
# More orders are not looked at.
_MOST_ORDERS = 60


def smoothed(phase: NDArray[Any], value: NDArray[Any], kinks: NDArray[Any],
             noise_level: float | None) -> tuple[NDArray[Any], int, LeastSquares, float]:
    """Coefficients and highest order of the smoothing spline, its wide fit, its freedom."""
    order = _orders(phase, kinks)
    spline = _Spline(phase, value, kinks, order)
    # From a curve that is all but a constant to one that follows all orders.
    ends = math.log(phase.size / 2 * 10.0), math.log(phase.size / 2 * 1e-3 / order**6)
    tried = np.linspace(*ends, 161)
    scores = [spline.score(x, noise_level) for x in tried]
    best = int(np.argmin(scores))
    log_penalty = _minimum(lambda x: spline.score(x, noise_level), tried[max(best - 1, 0)],
                           tried[min(best + 1, tried.size - 1)])
    passed = 1 / (1 + math.exp(log_penalty) * np.arange(1.0, order + 1) ** 6 / (phase.size / 2))
    kept = max(1, int(np.sum(passed >= _LEAST_PASSED)))
    wide = max(1, int(np.sum(passed >= _WIDE_PASSED)))
    coefficients, effective = spline.coefficients(log_penalty)
    return (coefficients[:1 + kinks.size + 2 * kept], kept,
            LeastSquares.of(phase, value, kinks, wide), effective)


def _orders(phase: NDArray[Any], kinks: NDArray[Any]) -> int:
    """As many orders as the samples tell apart."""
    order = min(_MOST_ORDERS, (phase.size - 1 - len(kinks) - LEAST_FREEDOM) // 2)
    problem = fit_problem(phase, kinks, max(order, 1))
    while problem and order > 1:
        order = order * 4 // 5
        problem = fit_problem(phase, kinks, order)
    if problem:
        raise ValueError(problem)
    return order


def _minimum(function: Callable[..., Any], low: float, high: float) -> float:
    """Place of the minimum of a function between two places."""
    from scipy.optimize import minimize_scalar

    return float(minimize_scalar(function, bounds=sorted((low, high)), method="bounded",
                                 options={"xatol": 1e-3}).x)


class _Spline:
    """The smoothing spline for every λ at once: in one basis it scales each column by itself."""

    def __init__(self, phase: NDArray[Any], value: NDArray[Any], kinks: NDArray[Any],
                 order: int) -> None:
        columns = design(phase, kinks, order)
        many = len(kinks)
        smooth = np.delete(columns, np.s_[1:1 + many], axis=1)
        q, r = np.linalg.qr(smooth)
        third = np.append(0.0, np.repeat(np.arange(1.0, order + 1) ** 3, 2))
        back = np.linalg.inv(r)
        turned, root, vt = np.linalg.svd(third[:, None] * back)
        del turned
        self._penalty = root**2
        basis = q @ vt.T
        self._back = back @ vt.T
        self._n, self._kinks = phase.size, many
        self._value = basis.T @ value
        self._parabolas = basis.T @ columns[:, 1:1 + many]
        # What no order up to the highest can follow.
        self._value_rest = value - basis @ self._value
        self._parabolas_rest = columns[:, 1:1 + many] - basis @ self._parabolas

    def _parts(self, log_penalty: float) -> tuple[
            NDArray[Any], NDArray[Any], NDArray[Any], NDArray[Any], float]:
        """Shares kept, jumps of slope by Speckman, projections left to smooth, and their trace."""
        kept = 1 / (1 + math.exp(log_penalty) * self._penalty)
        lost = 1 - kept
        trace = float(kept.sum())
        if not self._kinks:
            return kept, np.zeros(0), self._value, self._value_rest, trace
        rest = self._parabolas_rest.T
        normal = (self._parabolas.T * lost**2) @ self._parabolas + rest @ self._parabolas_rest
        jumps = np.linalg.solve(normal, (self._parabolas.T * lost**2) @ self._value
                                + rest @ self._value_rest)
        cube = (self._parabolas.T * lost**3) @ self._parabolas + rest @ self._parabolas_rest
        trace += float(np.trace(np.linalg.solve(normal, cube)))
        return (kept, jumps, self._value - self._parabolas @ jumps,
                self._value_rest - self._parabolas_rest @ jumps, trace)

    def score(self, log_penalty: float, noise_level: float | None) -> float:
        """Generalised cross-validation, or the unbiased risk where the noise is known; rad²."""
        kept, _, inside, outside, trace = self._parts(log_penalty)
        square = float(((1 - kept) * inside) @ ((1 - kept) * inside) + outside @ outside)
        if noise_level is not None:
            return (square + 2 * _INFLATION * noise_level**2 * trace) / self._n
        left = self._n - _INFLATION * trace
        return self._n * square / left**2 if left > 0 else math.inf

    def coefficients(self, log_penalty: float) -> tuple[NDArray[Any], float]:
        """Coefficients in the order of `design`, and the degrees of freedom taken."""
        kept, jumps, inside, _, trace = self._parts(log_penalty)
        smooth = self._back @ (kept * inside)
        return np.concatenate([smooth[:1], jumps, smooth[1:]]), trace
