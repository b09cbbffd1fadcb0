"""A measured transmission error: a curve fitted to samples with noise, and what the noise leaves.

`harmonics = n` is least squares with all orders up to n, without it the smoothing spline of
`spline`; kinks stay kinks (`basis`).

Intervals rest on a fit without any smoothing (`wide`), of all orders that smoothing lets through
by a tenth or more: noise may be in them, a bias is not.  They hold if the true curve has no higher
order; no samples with noise can tell.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lapwing.base import arguments
from lapwing.model.curve.basis import LeastSquares, curve_of, design
from lapwing.model.curve.spline import smoothed
from lapwing.model.transmission_error.table import MOST_ORDER

if TYPE_CHECKING:
    from lapwing.model.transmission_error.table import TransmissionError

# Every random number follows from this and from the number asked for.
_SEED = 20_170
_BATCH = 64


@dataclass(frozen=True, eq=False)
class CurveFit:
    """A curve fitted to samples of one mesh period.

    Attributes
    ----------
    phase, value : (n,) arrays, mesh periods and rad; the samples
    kinks : (k,) array, mesh periods
    method : 'harmonics' or 'smoothing'
    order : int, highest order of the curve
    coefficients : (1 + k + 2·order,) array, rad, in the order of `design`
    wide : LeastSquares, what intervals rest on
    noise : float, rad; standard deviation of a sample
    noise_stated : bool, whether it was told; else it is estimated from the residuals of `wide`
    effective : float, degrees of freedom that the curve takes
    te_sign_hint : str, as for `TransmissionError`
    """

    phase: np.ndarray
    value: np.ndarray
    kinks: np.ndarray
    method: str
    order: int
    coefficients: np.ndarray
    wide: LeastSquares
    noise: float
    noise_stated: bool
    effective: float
    te_sign_hint: str = "printed"

    @property
    def residual(self) -> NDArray[Any]:
        """Samples minus curve, (n,) rad."""
        rest: NDArray[Any] = self.value - design(self.phase, self.kinks, self.order) \
            @ self.coefficients
        return rest

    @cached_property
    def te(self) -> TransmissionError:
        """The curve as a `TransmissionError`."""
        return curve_of(self.coefficients, self.kinks, self.order, self.te_sign_hint)

    @cached_property
    def te_wide(self) -> TransmissionError:
        """The curve that intervals rest on."""
        return curve_of(self.wide.coefficients, self.kinks, self.wide.order, self.te_sign_hint)

    def without_orders_above(self, order: int) -> TransmissionError:
        """The curve without its orders above one, kinks kept."""
        last = 1 + self.kinks.size + 2 * min(order, self.order)
        return curve_of(self.coefficients[:last], self.kinks, min(order, self.order),
                        self.te_sign_hint)

    def deviations(self, count: int) -> tuple[NDArray[Any], NDArray[Any]]:
        """What noise does to the coefficients of `wide`: bootstrap of its residuals.

        1. Draw noise for each sample: from the residuals, each divided by √(1 - leverage), or
           normal of the stated level. 2. Fit it. The same numbers at every call.

        Parameters
        ----------
        count : int

        Returns
        -------
        deviations : (p, count) array, rad
        scale : (count,) array; the noise level that each fit estimates, over `noise`
        """
        rng = np.random.default_rng([_SEED, count])
        residual = self.wide.residual / np.sqrt(np.maximum(1 - self.wide.leverage, 1e-3))
        residual = residual - residual.mean()
        columns = design(self.phase, self.kinks, self.wide.order)
        found, scale = [], []
        for first in range(0, count, _BATCH):
            shape = (self.phase.size, min(_BATCH, count - first))
            drawn = rng.normal(0.0, self.noise, shape) if self.noise_stated \
                else rng.choice(residual, shape)
            found.append(self.wide.projector @ drawn)
            left = drawn - columns @ found[-1]
            scale.append(np.sqrt(np.einsum("ij,ij->j", left, left) / self.wide.freedom))
        spread = np.concatenate(scale) / self.noise if self.noise and not self.noise_stated \
            else np.ones(count)
        return np.hstack(found), spread

    def repeats(self, count: int) -> list[TransmissionError]:
        """`count` curves as other samples with the same noise might give them, `te` in the middle.

        Returns
        -------
        list of TransmissionError
        """
        deviations, _ = self.deviations(count)
        order = max(self.order, self.wide.order)
        middle = _widened(self.coefficients, order, self.kinks.size)
        return [curve_of(middle + _widened(one, order, self.kinks.size), self.kinks, order,
                         self.te_sign_hint) for one in deviations.T]

    def residual_excess(self) -> float:
        """Probability of residuals as far from the stated noise level as these; 1 if none is."""
        from scipy.stats import chi2

        if not self.noise_stated or self.noise == 0:
            return 1.0
        square = float(self.wide.residual @ self.wide.residual) / self.noise**2
        return 2 * float(min(chi2.cdf(square, self.wide.freedom),
                             chi2.sf(square, self.wide.freedom)))


def fit_curve(phase: NDArray[Any], value: NDArray[Any], kinks: ArrayLike = (), *,
              harmonics: int | None = None, noise_level: float | None = None,
              te_sign_hint: str = "printed") -> CurveFit:
    """Fit a curve to samples with noise.

    Parameters
    ----------
    phase : (n,) array, mesh periods, strictly ascending in [0, 1)
    value : (n,) array, rad
    kinks : (n,) array of 0/1, or empty for none; rows at which the slope may jump
    harmonics : int or None; all orders up to it, by least squares; None: the smoothing spline
    noise_level : float or None, rad; standard deviation of a sample, None: estimated
    te_sign_hint : 'printed' or 'geometric'

    Returns
    -------
    CurveFit

    Raises
    ------
    ValueError
        Rows as `TransmissionError.from_samples` refuses them; too few samples, or too uneven.
    """
    phase = arguments.reals("phase", phase, ndim=1)
    value = arguments.reals("value", value, ndim=1)
    flags = arguments.reals("kinks", kinks, ndim=1, empty=True)
    flags = np.zeros(phase.size) if flags.size == 0 else flags
    if not phase.shape == value.shape == flags.shape:
        raise ValueError("phase, value and kinks must be equally long")
    if phase[0] < 0 or phase[-1] >= 1 or not np.all(np.diff(phase) > 0):
        raise ValueError("phase must ascend strictly in [0, 1); the row at phase 1 is left out")
    if not np.all((flags == 0) | (flags == 1)):
        raise ValueError("kinks must be 0 or 1 for every row")
    if noise_level is not None:
        noise_level = arguments.real("noise_level", noise_level, low=0.0)
    places = phase[flags == 1]
    if harmonics is not None:
        order = arguments.whole("harmonics", harmonics, 1, MOST_ORDER)
        wide = LeastSquares.of(phase, value, places, order)
        coefficients, effective = wide.coefficients, float(phase.size - wide.freedom)
    else:
        coefficients, order, wide, effective = smoothed(phase, value, places, noise_level)
    return CurveFit(phase, value, places, "smoothing" if harmonics is None else "harmonics", order,
                    coefficients, wide, wide.noise if noise_level is None else noise_level,
                    noise_level is not None, effective, te_sign_hint)


def _widened(coefficients: NDArray[Any], order: int, kinks: int) -> NDArray[Any]:
    """Coefficients with zeros for the orders up to one that they lack."""
    return np.append(coefficients, np.zeros(1 + kinks + 2 * order - coefficients.size))
