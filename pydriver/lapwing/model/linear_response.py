"""Periodic response while the drive flank never lets go: φ'' + 2ξφ' + φ = F - g'', linear.

The response is F + h with h independent of F, so contact is kept exactly while F > -min h.

Each piece of the table is cut into steps short against the oscillator's own time.  On a step of
length w, with t = s/w in [0, 1] and G_k the coefficients of g in t, the solution Σ b_k t^k obeys

    b_{k+2} = -G_{k+2} - 2ξw·b_{k+1}/(k+2) - w²·b_k/((k+1)(k+2)),

whose terms fall like 1/k!.  Summed to rounding this is the exact solution (forced polynomial plus
2×2 propagator) for every ξ, also at ξ = 1, and it does not cancel however short a step is, as the
textbook split into particular polynomial and free motion does for w << 1.

Where the mesh period is so long against the oscillator's own times that these steps would be
many, the free motion is kept apart from the polynomials (module `long_period`).

Between steps θ' is continuous, so φ' drops by whatever g' jumps: a kink, or the rounding left
where two pieces join.  Ignoring the latter would leave a mean force, (jump sum)/P, that is not
there; at Ω = 60 and 200 pieces it spoils the eighth digit.

A transmission error made from harmonics is not taken from its table: each harmonic G_n of g gives
(nΩ)²G_n/(1 - (nΩ)² + 2iξnΩ), and the sum of these is the response, exact to rounding.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.polynomial import polynomial as power
from numpy.typing import ArrayLike, NDArray

from lapwing.base import arguments
from lapwing.model.linear_steps import (
    TERMS,
    expanded,
    least_value,
    periodic_states,
    series,
    unit_motions,
)
from lapwing.model.long_period import APART, least_of_long, long_response
from lapwing.model.oscillator import Oscillator

# More short steps than this, and than two for each piece of the table, are not taken.
_MOST_STEPS = 10_000
# ... nor any where the response is a difference of parts so many times larger, EPS·ξΩ off.
_MOST_CANCELLED = 1e6
# Nearer to an undamped resonance than this, relative, fewer than three digits would be left.
_RESONANCE = 1e3 * np.finfo(float).eps


class CriticalForce(NamedTuple):
    """Smallest force (rad) that keeps contact, and the phase (periods) where it is lost first."""

    force: float
    phase: float


@dataclass(frozen=True, eq=False)
class EngagedResponse:
    """The periodic engaged motion over one mesh period.

    Attributes
    ----------
    edges : (n+1,) array, mesh periods; step ends, every knot of the table among them
    coefficients : (n, 21) array, rad; φ in ascending powers of t = (phase - edge)/(step length)
    free : (n, 2) array, rad and rad per τ; value and slope at the start of each step of a free
        motion that adds to the powers of t: not 0 on steps only that are long against its times
    period : float; mesh period in τ
    damping_ratio : float; ξ of the free motion
    minimum, minimum_phase : float; least φ (rad) and its phase (mesh periods)
    """

    edges: np.ndarray
    coefficients: np.ndarray
    free: np.ndarray
    period: float
    damping_ratio: float
    minimum: float
    minimum_phase: float

    def __post_init__(self) -> None:
        for array in (self.edges, self.coefficients, self.free):
            array.flags.writeable = False

    def penetration(self, phase: ArrayLike, order: int = 0) -> NDArray[Any]:
        """φ (rad) or its derivative with respect to τ at `phase` (periods); right limits."""
        order = arguments.whole("order", order, 0, TERMS)
        at = np.mod(arguments.reals("phase", phase, empty=True), 1.0)
        at = np.where(at == 1.0, 0.0, at)
        step = np.asarray(np.searchsorted(self.edges, at, side="right") - 1)
        width = np.diff(self.edges)[step]
        local = np.moveaxis(power.polyder(self.coefficients[step], order, axis=-1), -1, 0)
        value: NDArray[Any] = power.polyval((at - self.edges[step]) / width, local, tensor=False)
        value = value / (width * self.period) ** order
        return value + self._free_motion(step, at, order) if self.free.any() else value

    def _free_motion(self, step: NDArray[Any], phase: NDArray[Any],
                     order: int) -> NDArray[Any]:
        """Its value or derivative of an order; each derivative follows from the two before."""
        time = (phase - self.edges[step]) * self.period
        state = np.einsum("xs...,...s->x...", unit_motions(self.damping_ratio, time),
                          self.free[step])
        for _ in range(order):
            state = np.array([state[1], -state[0] - 2 * self.damping_ratio * state[1]])
        last: NDArray[Any] = state[0]
        return last


@arguments.complete()
def engaged_response(osc: Oscillator) -> EngagedResponse:
    """Periodic solution of the engaged equation for any table, at the oscillator's own force.

    1. cut the pieces into steps, 2. solve each step for unit starts and for the forcing,
    3. close the 2×2 affine map of one period, 4. run through once more and find the minimum.

    Parameters
    ----------
    osc : Oscillator

    Returns
    -------
    EngagedResponse
        Contact is kept if its `minimum` (rad) is > 0; minimum = F - F_crit.

    Raises
    ------
    ValueError
        No periodic response: ξ = 0 at a resonance, Ω = 1/n.
    """
    arguments.instance("osc", osc, Oscillator)
    response = _unforced(osc)
    coefficients = response.coefficients + np.eye(1, TERMS) * osc.force
    return replace(response, coefficients=coefficients, minimum=response.minimum + osc.force)


@arguments.complete()
def critical_force(osc: Oscillator) -> CriticalForce:
    """Smallest force of complete engagement, F_crit = -min h, whatever force `osc` has.

    Parameters
    ----------
    osc : Oscillator; its own force is not used

    Returns
    -------
    CriticalForce
        force (rad) and phase (mesh periods) of the minimum.

    Raises
    ------
    ValueError
        As `engaged_response`.
    """
    arguments.instance("osc", osc, Oscillator)
    response = _unforced(osc)
    return CriticalForce(-response.minimum, response.minimum_phase)


@arguments.complete()
def critical_torque(osc: Oscillator) -> tuple[float, float]:
    """Smallest braking torque (N·m, drive torque in balance) of complete engagement, and phase.

    Parameters
    ----------
    osc : Oscillator made from a GearPair; its own force is not used

    Returns
    -------
    (float, float), N·m and mesh periods

    Raises
    ------
    ValueError
        As `engaged_response`, or if `osc` has no scales.
    """
    arguments.instance("osc", osc, Oscillator)
    if osc.scales is None:
        raise ValueError("the oscillator has no scales: build it from a GearPair")
    force, phase = critical_force(osc)
    return force / osc.scales.force_per_torque, phase


def _unforced(osc: Oscillator) -> EngagedResponse:
    """The response h to the flank's motion alone."""
    _refuse_resonance(osc.damping_ratio, osc.period)
    if len(osc.te.harmonics):
        edges, coefficients = _response_to_series(osc)
    elif _is_long(osc):
        return _long_response(osc)
    else:
        edges, coefficients = _response_to_table(osc)
    least = least_value(edges, coefficients)
    free = np.zeros((len(coefficients), 2))
    return EngagedResponse(edges, coefficients, free, osc.period, osc.damping_ratio, *least)


def _long_response(osc: Oscillator) -> EngagedResponse:
    """The response where there are few steps, and free motions beside their polynomials."""
    steps = long_response(osc)
    least = least_of_long(osc.damping_ratio, osc.period, *steps)
    return EngagedResponse(*steps, osc.period, osc.damping_ratio, *least)


def _response_to_series(osc: Oscillator) -> tuple[NDArray[Any], NDArray[Any]]:
    """Step ends and φ on each step, from the gain of each harmonic."""
    order, amplitude = flank_harmonics(osc)
    frequency = order * osc.mesh_frequency_ratio
    # A harmonic of order 0 or without amplitude moves nothing, whatever its gain.
    moving = (order > 0) & (amplitude != 0)
    square = frequency[moving]**2
    gain = square / (1 - square + 2j * osc.damping_ratio * frequency[moving])
    return series_steps(order[moving], gain * amplitude[moving])


def flank_harmonics(osc: Oscillator) -> tuple[NDArray[Any], NDArray[Any]]:
    """Orders and complex amplitudes G_n (rad) of g = Re Σ G_n·e^(2πin·phase)."""
    order, amplitude, shift = osc.te.harmonics.T
    return order, osc.flank_scale * amplitude * np.exp(1j * shift)


def series_steps(order: NDArray[Any], amplitude: NDArray[Any]) -> tuple[NDArray[Any], NDArray[Any]]:
    """Re Σ amplitude·e^(2πi·order·phase) in powers of t on equal steps of the mesh period.

    Parameters
    ----------
    order : (m,) array
    amplitude : (m,) complex array

    Returns
    -------
    edges : (n+1,) array, mesh periods
    coefficients : (n, 21) array, ascending powers of t = (phase - edge)/(step length); the first
        term left out is below 1/21! of the amplitudes
    """
    count = max(1, math.ceil(2 * math.pi * np.max(order, initial=0.0)))
    edges = np.arange(count + 1) / count
    power_of_t = np.arange(TERMS)
    factorial = np.array([math.factorial(k) for k in power_of_t], dtype=float)
    turn = (2j * math.pi * order / count)[:, None] ** power_of_t / factorial
    start = amplitude * np.exp(2j * math.pi * edges[:-1, None] * order)
    return edges, (start @ turn).real


def _response_to_table(osc: Oscillator) -> tuple[NDArray[Any], NDArray[Any]]:
    """Step ends and φ on each step, from the pieces of the table."""
    edges, forcing = _steps(osc)
    width = np.diff(edges) * osc.period
    jumps = forcing[:, 1] / width - np.roll(forcing @ np.arange(6) / width, 1)
    zero, one = np.zeros_like(width), np.ones_like(width)
    solve = np.array([series(osc.damping_ratio, width, *start) for start in (
        (one, zero, 0 * forcing), (zero, width, 0 * forcing), (zero, zero, forcing))])
    position = solve.sum(axis=2)
    velocity = solve @ np.arange(TERMS) / width
    maps = np.moveaxis(np.array([position, velocity]), -1, 0)
    states = periodic_states(maps[:, :, :2], maps[:, :, 2], jumps)
    return edges, np.einsum("ni,ink->nk", np.column_stack([states, one]), solve)


def _longest(osc: Oscillator) -> float:
    """Length of the short steps, mesh periods: at most 1/|λ| of both free exponents λ."""
    return 1 / (osc.period * max(1.0, 2 * osc.damping_ratio))


def _short_steps(osc: Oscillator) -> float:
    """How many short steps the table would take; may be infinite."""
    return float(np.sum(np.maximum(1.0, np.ceil(np.diff(osc.te.knots) / _longest(osc)))))


def _is_long(osc: Oscillator) -> bool:
    """Whether the free motion is kept apart: else steps would be many, or digits lost."""
    cancelled = osc.damping_ratio * osc.mesh_frequency_ratio if osc.damping_ratio >= APART else 0.0
    return (cancelled > _MOST_CANCELLED
            or _short_steps(osc) > max(_MOST_STEPS, 2 * len(osc.te.coefficients)))


def _steps(osc: Oscillator) -> tuple[NDArray[Any], NDArray[Any]]:
    """Step ends (phase) and g on each step in powers of t."""
    te = osc.te
    longest = _longest(osc)
    edges, forcing = [], []
    for i, width in enumerate(np.diff(te.knots)):
        count = max(1, math.ceil(width / longest))
        start = np.arange(count) * (width / count)
        edges.append(te.knots[i] + start)
        forcing.append(expanded(te.coefficients[i], start, np.full(count, width / count)))
    return np.append(np.concatenate(edges), 1.0), osc.flank_scale * np.vstack(forcing)


def _refuse_resonance(damping_ratio: float, period: float) -> None:
    turns: float = period / (2 * math.pi)
    whole = round(float(turns))
    distance = abs(turns - whole) / turns
    if damping_ratio <= _RESONANCE and whole and distance <= _RESONANCE:
        raise ValueError(f"no periodic engaged response: undamped resonance, the mesh period is "
                         f"{whole} natural period(s)")


def response_amplification(osc: Oscillator, ratio: ArrayLike | None = None,
                           damping: ArrayLike | None = None) -> NDArray[np.float64]:
    """How many times its cause the engaged response to the transmission error can be.

    Of a harmonic of rate r: r²/|1 - r² + 2iξr|, the largest of them; of a table: 1/|1 - exp(λP)|,
    λ the free exponent nearest to a resonance; 0 without transmission error, and in rigid contact.

    Parameters
    ----------
    osc : Oscillator
    ratio, damping : array or None, mesh frequency ratios and damping ratios; None: its own

    Returns
    -------
    array of the shape of both; infinite at an undamped resonance
    """
    xi = np.asarray(osc.damping_ratio if damping is None else damping, dtype=float)
    ratio = np.asarray(osc.mesh_frequency_ratio if ratio is None else ratio, dtype=float)
    if osc.te.peak_to_peak == 0 or osc.contact_law == "rigid":
        return np.zeros(np.broadcast_shapes(xi.shape, ratio.shape))
    if len(osc.te.harmonics):
        order, amplitude, _ = osc.te.harmonics.T
        rate = ratio[..., None] * order[(order > 0) & (amplitude != 0)]
        denominator, numerator = np.abs(1 - rate**2 + 2j * xi[..., None] * rate), rate**2
    else:
        root = np.sqrt(xi**2 - 1 + 0j)
        exponent = -xi[..., None] + np.stack([root, -root], axis=-1)
        denominator = np.abs(1 - np.exp(exponent * (2 * np.pi / ratio)[..., None]))
        numerator = np.ones(2)
    with np.errstate(divide="ignore"):
        return np.asarray(np.max(numerator / denominator, axis=-1))
