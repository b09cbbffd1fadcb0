"""What the noise of a measured transmission error leaves unknown of a critical force.

The force asked for is the largest value over the mesh phase of a function that is linear in the
curve's coefficients: of -h, the engaged response, or of g'' where teeth are rigid.  Of a curve with
noise that largest value comes out too large: the noise adds peaks of its own.  So the limits are
not those of its spread, but bounds for a largest value (Chernozhukov, Lee & Rosen, Econometrica 81
(2013) 667): the function's value is at most the upper limit at the phase of its true maximum,
whichever that is, hence the greatest pointwise upper limit; and at least the greatest of lower
limits that hold at all phases together, of those at which the maximum may lie.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from lapwing.model.curve.basis import LeastSquares, curve_of, fit_problem
from lapwing.model.linear_response import critical_force, engaged_response
from lapwing.model.rigid_contact import lift_off_force

if TYPE_CHECKING:
    from lapwing.model.curve.fit import CurveFit
    from lapwing.model.linear_response import CriticalForce
    from lapwing.model.oscillator import Oscillator
    from lapwing.model.rigid_contact import LiftOff
    from lapwing.model.transmission_error.table import TransmissionError

CONFIDENCE = 0.95
DRAWS = 999
# Phases for each turn of the highest order: a maximum between them is missed by 0.05 %.
_PER_TURN, _LEAST_PHASES, _MOST_PHASES = 96, 512, 20_000
# Orders in the table of the critical value against the highest order.
MOST_TABLED = 16
_TABLE_DRAWS = 199
# Of the orders of a curve the upper third is asked how much rests on it.
_LOWER = 2 / 3
_FEWEST = 3


class ForceBounds(NamedTuple):
    """A critical force (rad), its limits, and the phase (mesh periods) where contact goes first."""

    low: float
    force: float
    high: float
    phase: float


def force_bounds(osc: Oscillator, fit: CurveFit, confidence: float = CONFIDENCE,
                 draws: int = DRAWS) -> ForceBounds:
    """Critical force of a fitted curve and the interval that the samples' noise leaves.

    1. Responses to each coefficient of the unsmoothed fit, at phases close to each other.
    2. Deviations of the coefficients: bootstrap of the residuals (`CurveFit.deviations`).
    3. The bounds above, (1 - confidence)/2 on either side, each deviation over its own standard
       error. They are widened to hold the force of the curve itself, and end at 0: the mean of
       the function is 0.

    Parameters
    ----------
    osc : Oscillator; contact law, speed and damping; its transmission error and force are not used
    fit : CurveFit
    confidence : float
    draws : int

    Returns
    -------
    ForceBounds; infinite where a kink moves a rigid tooth

    Raises
    ------
    ValueError
        As `engaged_response`.
    """
    force, phase, *reason = needed_force(on_curve(osc, fit.te))
    if any(reason):
        return ForceBounds(math.inf, math.inf, math.inf, phase)
    if fit.noise == 0:
        return ForceBounds(force, force, force, phase)
    responses = _responses(osc, fit.kinks, fit.wide.order)
    wide = force if fit.method == "harmonics" else needed_force(on_curve(osc, fit.te_wide))[0]
    low, _, high = _bounds(fit, responses, confidence, draws, wide)
    return ForceBounds(max(min(low, force), 0.0), force, max(high, force), phase)


def _bounds(fit: CurveFit, responses: NDArray[Any], confidence: float, draws: int,
            exact: float | None = None) -> tuple[float, float, float]:
    """Bounds of the largest value at the phases of `responses`, and that value.

    `exact` is the largest value of all phases, where it is known.
    """
    columns = -responses[:, :fit.wide.coefficients.size]
    middle = columns @ fit.wide.coefficients
    if exact is not None:
        middle += exact - middle.max()
    error = fit.noise * np.linalg.norm(columns @ fit.wide.root, axis=1)
    deviations, scale = fit.deviations(draws)
    low, high = largest_value_bounds(middle, error, columns @ deviations / scale, confidence,
                                     fit.phase.size,
                                     math.inf if fit.noise_stated else fit.wide.freedom)
    return low, float(middle.max()), high


def largest_value_bounds(middle: NDArray[Any], error: NDArray[Any], deviations: NDArray[Any],
                         confidence: float, samples: int, freedom: float) -> tuple[float, float]:
    """Bounds for the largest value of a function known with errors.

    Parameters
    ----------
    middle, error : (n,) arrays; the function as estimated, and its standard error
    deviations : (n, m) array; draws of the estimate's error
    confidence : float, of the interval; half of what is left lies on either side
    samples : int, that the estimate rests on
    freedom : float, degrees of freedom of the standard error

    Returns
    -------
    low, high : float
    """
    from scipy.stats import norm, t

    side = 1 - (1 - confidence) / 2
    point = norm.ppf(side) if math.isinf(freedom) else t.ppf(side, freedom)
    high = float(np.max(middle + point * error))
    worst = deviations / error[:, None]
    # Phases that cannot hold the maximum do not count: the authors' step of selection.
    first = np.quantile(worst.max(axis=0), 1 - 0.1 / math.log(max(samples, 3)))
    possible = middle >= np.max(middle - first * error) - 2 * first * error
    together = np.quantile(worst[possible].max(axis=0), side)
    return float(np.max((middle - together * error)[possible])), high


def needed_force(osc: Oscillator) -> CriticalForce | LiftOff:
    """Critical force and phase: complete engagement, or of rigid teeth staying on the flank."""
    return lift_off_force(osc) if osc.contact_law == "rigid" else critical_force(osc)


def on_curve(osc: Oscillator, te: TransmissionError) -> Oscillator:
    """An oscillator on another curve, for what the engaged motion alone decides.

    The coast flank takes no part in it, and one that stands still would refuse a curve so wide that
    it comes to lie beyond.
    """
    return replace(osc, te=te, back_flank_te=True)


def _responses(osc: Oscillator, kinks: NDArray[Any], order: int) -> NDArray[Any]:
    """Response to each coefficient of a fit at all phases, (n, p); contact needs F > -minimum."""
    ratio = osc.mesh_frequency_ratio
    turns = max(order, min(1 / ratio, _MOST_PHASES) if len(kinks) else 1)
    count = min(max(_LEAST_PHASES, math.ceil(_PER_TURN * turns)), _MOST_PHASES)
    phase = np.union1d(np.arange(count) / count, kinks)  # where the response has a corner
    square = (np.arange(1, order + 1) * ratio) ** 2
    rigid = osc.contact_law == "rigid"
    gain = square if rigid else square / (
        1 - square + 2j * osc.damping_ratio * np.sqrt(square))
    wave = osc.flank_scale * gain * np.exp(
        2j * np.pi * np.multiply.outer(phase, np.arange(1, order + 1)))
    waves = np.stack([wave.real, wave.imag], axis=-1).reshape(phase.size, -1)
    return np.column_stack([np.zeros(phase.size), *(
        _kink_response(osc, at, phase) for at in kinks), waves])


def _kink_response(osc: Oscillator, at: float, phase: NDArray[Any]) -> NDArray[Any]:
    """Response to a parabola whose slope jumps by 1 rad per mesh period at a phase."""
    unit = curve_of(np.array([0.0, 1.0]), [at], 0)
    response = engaged_response(on_curve(osc, unit))
    return response.penetration(phase) - osc.force


def forces_by_order(osc: Oscillator, fit: CurveFit) -> dict[str, NDArray[Any]]:
    """Critical force against the highest order of an unsmoothed fit of the same samples.

    The force is the largest value at phases so close that 0.05 % of its highest order is missed.

    Returns
    -------
    dict of arrays (n,): order; low, force, high (rad); noise (rad) that the residuals show; gcv
    (rad²), generalised cross-validation
    """
    most = max(MOST_TABLED, min(fit.wide.order + 4, 2 * MOST_TABLED))
    responses, rows = _responses(osc, fit.kinks, most), []
    for order in range(1, most + 1):
        if fit_problem(fit.phase, fit.kinks, order):
            break
        wide = LeastSquares.of(fit.phase, fit.value, fit.kinks, order)
        one = replace(fit, method="harmonics", order=order, coefficients=wide.coefficients,
                      wide=wide, noise=fit.noise if fit.noise_stated else wide.noise)
        low, force, high = _bounds(one, responses, CONFIDENCE, _TABLE_DRAWS) if one.noise else \
            [float(np.max(-responses[:, :wide.coefficients.size] @ wide.coefficients))] * 3
        rows.append((order, max(min(low, force), 0.0), force, max(high, force), wide.noise,
                     wide.gcv))
    names = ("order", "low", "force", "high", "noise", "gcv")
    return dict(zip(names, map(np.array, zip(*rows, strict=True)), strict=True))


def share_of_high_orders(osc: Oscillator, fit: CurveFit) -> tuple[float, int]:
    """How much of the critical force rests on the upper third of a curve's orders.

    Returns
    -------
    share : float, change of the force without them, as part of it; NaN where there are fewer than
        three orders, or no force
    above : int, the highest order left
    """
    above = math.ceil(_LOWER * fit.order)
    if fit.order < _FEWEST:
        return math.nan, fit.order
    force = needed_force(on_curve(osc, fit.te))[0]
    without = needed_force(on_curve(osc, fit.without_orders_above(above)))[0]
    if not math.isfinite(force) or force == 0:
        return math.nan, above
    return abs(force - without) / abs(force), above


def repeat_interval(estimate: float, repeats: NDArray[Any]) -> tuple[float, float]:
    """Interval of a number found again on other curves, `CurveFit.repeats`.

    The 95 % range of what was found, joined with the same range turned round the estimate: noise
    that moves the repeats one way has moved the estimate the same way from the truth.

    Parameters
    ----------
    estimate : float
    repeats : array (n,); NaN where nothing was found

    Returns
    -------
    low, high : float; NaN where more than one in 20 repeats found nothing: what is beyond the
        range searched, or failed, would be left out of a 95 % range
    """
    found = repeats[np.isfinite(repeats)]
    if not math.isfinite(estimate) or found.size < max(CONFIDENCE * repeats.size, 1):
        return math.nan, math.nan
    side = (1 - CONFIDENCE) / 2
    low, high = np.quantile(found, [side, 1 - side], method="weibull")
    return float(min(low, 2 * estimate - high)), float(max(high, 2 * estimate - low))
