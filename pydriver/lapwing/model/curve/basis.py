"""What a fitted curve is made of, least squares in it, and the table that follows from it.

A constant, cosines and sines of the mesh up to some order, and for each kink the periodic parabola
B(t) = -(t² - t + 1/6)/2 of the phase t behind it, whose slope jumps by one: so a kink stays a kink,
and the rest is smooth.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lapwing.base.arguments import LEAST
from lapwing.model.harmonic_series import harmonic_derivative, harmonic_pieces
from lapwing.model.transmission_error import TransmissionError

# Columns of a fit must differ by more than this part of the largest.
_DISTINCT = 1e-5
# Residual degrees of freedom below which a noise level cannot be estimated.
LEAST_FREEDOM = 3


def kink_shape(phase: NDArray[Any]) -> NDArray[Any]:
    """Periodic parabola whose slope jumps by +1 at phase 0; mean 0, rad for a jump in rad."""
    t = np.mod(phase, 1.0)
    shape: NDArray[Any] = -(t * t - t + 1 / 6) / 2
    return shape


def design(phase: ArrayLike, kinks: Iterable[float], order: int) -> NDArray[Any]:
    """Columns of the fit at `phase`: constant, a parabola for each kink, cos and sin of each order.

    Returns
    -------
    (n, 1 + len(kinks) + 2·order) array
    """
    places = np.asarray(phase, dtype=float)
    angle = 2 * np.pi * np.multiply.outer(places, np.arange(1, order + 1))
    waves = np.stack([np.cos(angle), np.sin(angle)], axis=-1).reshape(places.size, -1)
    return np.column_stack([np.ones(places.size), *(kink_shape(places - at) for at in kinks),
                            waves])


def fit_problem(phase: NDArray[Any], kinks: NDArray[Any], order: int) -> str | None:
    """Why `order` harmonics cannot be fitted to samples at `phase`, or None."""
    unknown, many = 1 + len(kinks) + 2 * order, len(kinks)
    what = f"harmonics to order {order}" + f" and {many} kink{'s' * (many != 1)}" * bool(many)
    if phase.size < unknown + LEAST_FREEDOM:
        return f"{what} need at least {unknown + LEAST_FREEDOM} samples, there are {phase.size}"
    values = np.linalg.svd(design(phase, kinks, order), compute_uv=False)
    if values[-1] < _DISTINCT * values[0]:
        return f"{what} cannot be told apart from samples with such gaps between them"
    return None


@dataclass(frozen=True, eq=False)
class LeastSquares:
    """Least squares with all orders up to one, without smoothing.

    Attributes
    ----------
    order : int
    coefficients : (p,) array, rad, in the order of `design`
    root : (p, p) array; root @ root.T is the covariance of the coefficients for noise of 1 rad
    projector : (p, n) array, coefficients from samples
    residual : (n,) array, rad
    leverage : (n,) array
    freedom : int, degrees of freedom of the residuals
    gcv : float, rad²; generalised cross-validation
    """

    order: int
    coefficients: np.ndarray
    root: np.ndarray
    projector: np.ndarray
    residual: np.ndarray
    leverage: np.ndarray
    freedom: int
    gcv: float

    @property
    def noise(self) -> float:
        """Standard deviation of a sample, rad, from the residuals."""
        return float(np.sqrt(self.residual @ self.residual / self.freedom))

    @classmethod
    def of(cls, phase: NDArray[Any], value: NDArray[Any], kinks: NDArray[Any],
           order: int) -> LeastSquares:
        """The fit; ValueError where the samples do not determine it."""
        problem = fit_problem(phase, kinks, order)
        if problem:
            raise ValueError(problem)
        columns = design(phase, kinks, order)
        u, s, vt = np.linalg.svd(columns, full_matrices=False)
        root = vt.T / s
        projector = root @ u.T
        coefficients = projector @ value
        residual = value - columns @ coefficients
        freedom = phase.size - columns.shape[1]
        return cls(order, coefficients, root, projector, residual,
                   np.einsum("ij,ij->i", u, u), freedom,
                   phase.size * float(residual @ residual) / freedom**2)


def curve_of(coefficients: NDArray[Any], kinks: ArrayLike, order: int,
             te_sign_hint: str = "printed") -> TransmissionError:
    """The `TransmissionError` of coefficients as `design` orders them.

    Without kinks it keeps its harmonics; else it is a table of quintic pieces, as good as that of
    `TransmissionError.harmonic`, with a knot at each kink.
    """
    kinks = np.asarray(kinks, dtype=float)
    jumps = coefficients[1:1 + kinks.size]
    cosine, sine = coefficients[1 + kinks.size:].reshape(-1, 2).T
    amplitude = np.append(coefficients[0], np.hypot(cosine, sine))
    shift = np.append(0.0, np.arctan2(-sine, cosine))
    orders = np.arange(order + 1.0)
    amplitude[np.abs(amplitude) < LEAST] = 0.0
    if not kinks.size:
        return replace(TransmissionError.harmonic(amplitude, shift, orders),
                       te_sign_hint=te_sign_hint)
    return _kinked(np.column_stack([orders, amplitude, shift]), kinks, jumps, te_sign_hint)


def _kinked(series: NDArray[Any], kinks: NDArray[Any], jumps: NDArray[Any],
            te_sign_hint: str) -> TransmissionError:
    """Table of a series and of a parabola for each kink."""
    from scipy.interpolate import BPoly, PPoly

    count = harmonic_pieces(series)
    even = np.arange(count + 1) / count
    apart = np.abs((even[:, None] - kinks + 0.5) % 1 - 0.5).min(axis=1) > 1e-3 / count
    knots = np.unique(np.concatenate([even[apart], kinks, [0.0, 1.0]]))
    rows = np.stack([harmonic_derivative(series, k, knots % 1) for k in range(3)], axis=1)
    coefficients = PPoly.from_bernstein_basis(BPoly.from_derivatives(knots, rows)).c[::-1].T.copy()
    for at, jump in zip(kinks, jumps, strict=True):
        t = np.mod(knots[:-1] - at, 1.0)
        # A knot behind the kink by rounding is not a period behind it.
        t[np.isclose(t, 1.0, rtol=0, atol=1e-14)] = 0.0
        coefficients[:, 0] += jump * kink_shape(t)
        coefficients[:, 1] -= jump * (t - 0.5)
        coefficients[:, 2] -= jump / 2
    return TransmissionError(knots, coefficients, np.isin(knots[:-1], kinks),
                             te_sign_hint=te_sign_hint)
