"""Engaged motion over a mesh period that is long against the oscillator's own times.

Steps short against those times would be as many as the ratio of the two.  Here a piece of the
table is one step, or a few: a particular polynomial, and the free motion beside it,

    φ = Σ p_k t^k + x_0·X(s) + x_0'·Y(s),

X and Y the free motions from unit value and unit slope.  The particular polynomial is the finite
sum of derivatives of g, whose terms fall like (k+1)!/(|λ|w)^k, on pieces beyond 8 of the slowest
free motion's times; pieces shorter than that take short steps, of which there are few.

For ξ >= 2 the two decays have scales of their own, and a piece may be long against one and short
against the other.  The equation is then taken apart: φ = a + b with D = λ1 - λ2 and

    a' = λ1·a - g''/D,    b' = λ2·b + g''/D,    at a kink a loses and b gains its jump over D.

Where one outlasts the mesh period, a' sums to nearly nothing over it, and rounding of its parts
would be left; α = a + (g' + λ1·g)/D has no kinks, α' = λ1·α - λ1²·g/D, and keeps all digits, as
b - (g' + λ2·g)/D does.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.polynomial import polynomial as power
from numpy.typing import NDArray

from lapwing.model.linear_steps import (
    TERMS,
    expanded,
    lower_bounds,
    lowest_point,
    periodic_states,
    rates,
    series,
    unit_motions,
)
from lapwing.model.transmission_error.extrema import stationary_points

if TYPE_CHECKING:
    from lapwing.model.oscillator import Oscillator

# Of a decay, in its own times: beyond so many a particular polynomial is well conditioned.
_LONG = 8.0
# ... and of an exponential nothing is left, e^-40 = 4e-18.
_GONE = 40.0
# From this damping ratio on the two decays are told apart, their rates 14 : 1.
APART = 2.0
# A free motion is followed to its end where that is at most so many natural times away.
_FOLLOWED = 256.0


def long_response(osc: Oscillator) -> tuple[NDArray[Any], NDArray[Any], NDArray[Any]]:
    """Step ends, polynomials and free motions of the periodic response to a table.

    Parameters
    ----------
    osc : Oscillator

    Returns
    -------
    edges : (n+1,) array, mesh periods
    coefficients : (n, 21) array, rad; ascending powers of t = (phase - edge)/(step length)
    free : (n, 2) array, rad, rad per τ; value and slope of the free motion at the start of a step
    """
    xi, width = osc.damping_ratio, np.diff(osc.te.knots) * osc.period
    slow, fast = (-1.0, -1.0) if xi < 1 else rates(xi)
    is_long = -slow * width > _LONG
    if xi < APART:
        count = np.where(is_long, 1, np.ceil(width * max(1.0, 2 * xi)))
        is_short = ~is_long
    else:
        is_short = -fast * width <= _LONG
        count = np.where(is_long, 1, np.ceil(np.where(is_short, -fast, -slow) * width))
    count = np.maximum(count, 1).astype(int)
    edges, forcing = _cut(osc, count)
    length = np.repeat(width / count, count)
    jumps = np.zeros(length.size)
    jumps[np.cumsum(count) - count] = osc.flank_scale * osc.te.slope_jumps() / osc.period
    steps = (length, forcing, jumps)
    if xi < APART:
        coefficients, free = _whole(xi, *steps, np.repeat(is_long, count))
    else:
        coefficients, free = _apart((slow, fast), osc.period, *steps, np.repeat(is_long, count),
                                    np.repeat(~is_short, count))
    return edges, coefficients, free


def _cut(osc: Oscillator, count: NDArray[Any]) -> tuple[NDArray[Any], NDArray[Any]]:
    """Step ends, and g on each step in powers of t, of pieces cut into `count` steps each."""
    te = osc.te
    edges, forcing = [], []
    for i, (width, n) in enumerate(zip(np.diff(te.knots), count, strict=True)):
        start = np.arange(n) * (width / n)
        edges.append(te.knots[i] + start)
        forcing.append(expanded(te.coefficients[i], start, np.full(n, width / n)))
    return np.append(np.concatenate(edges), 1.0), osc.flank_scale * np.vstack(forcing)


def _acceleration(forcing: NDArray[Any], length: NDArray[Any]) -> NDArray[Any]:
    """g'' in powers of t, (n, 4)."""
    k = np.arange(4)
    second: NDArray[Any] = forcing[:, 2:] * (k + 1) * (k + 2) / length[:, None] ** 2
    return second


def _particular(xi: float, forcing: NDArray[Any], length: NDArray[Any]) -> NDArray[Any]:
    """Polynomials of degree 3 that solve the equation exactly, (n, 21)."""
    terms = np.zeros((length.size, TERMS))
    acceleration = _acceleration(forcing, length)
    for k in reversed(range(4)):
        terms[:, k] = (-acceleration[:, k] - 2 * xi * (k + 1) * terms[:, k + 1] / length
                       - (k + 1) * (k + 2) * terms[:, k + 2] / length**2)
    return terms


def _whole(xi: float, length: NDArray[Any], forcing: NDArray[Any], jumps: NDArray[Any],
           is_long: NDArray[Any]) -> tuple[NDArray[Any], NDArray[Any]]:
    """Polynomials and free motions where both free exponents are about as fast, ξ < 2."""
    short = ~is_long
    zero, one = np.zeros_like(length), np.ones_like(length)
    solve = np.zeros((3, length.size, TERMS))
    for one_of, (start, slope, of_g) in zip(solve, (
            (one, zero, 0 * forcing), (zero, length, 0 * forcing), (zero, zero, forcing)),
            strict=True):
        one_of[short] = series(xi, length[short], start[short], slope[short], of_g[short])
    solve[2, is_long] = _particular(xi, forcing[is_long], length[is_long])
    ends = np.array([solve.sum(axis=2), solve @ np.arange(TERMS) / length])
    begun = np.array([solve[2, :, 0], solve[2, :, 1] / length])
    motions = unit_motions(xi, length[is_long])
    ends[:, :2, is_long] = motions
    ends[:, 2, is_long] -= np.einsum("xsn,sn->xn", motions, begun[:, is_long])
    maps = np.moveaxis(ends, -1, 0)
    states = periodic_states(maps[:, :, :2], maps[:, :, 2], jumps)
    coefficients = np.einsum("ni,ink->nk", np.column_stack([states, one]), solve)
    return coefficients, np.where(is_long[:, None], states - begun.T, 0.0)


def _apart(exponents: tuple[float, float], period: float, length: NDArray[Any],
           forcing: NDArray[Any], jumps: NDArray[Any], slow_long: NDArray[Any],
           fast_long: NDArray[Any]) -> tuple[NDArray[Any], NDArray[Any]]:
    """The same from the two decays by themselves, ξ >= 2."""
    slow, fast = exponents
    apart = slow - fast
    k = np.arange(5)
    from_start = forcing - np.eye(1, 6) * forcing[0, 0]
    speed = forcing[:, 1:] * (k + 1) / length[:, None]
    push = _acceleration(forcing, length) / apart
    coefficients, free = np.zeros((length.size, TERMS)), np.zeros((length.size, 2))
    of_place = of_speed = 0.0
    for rate, sign, is_long in ((slow, -1, slow_long), (fast, 1, fast_long)):
        if -rate * period > _LONG:
            terms, amplitude = _relaxed(rate, length, sign * push, sign * jumps / apart, is_long)
        else:
            terms, amplitude = _relaxed(rate, length, sign * rate * (rate / apart) * from_start,
                                        0 * jumps, is_long)
            of_place, of_speed = of_place + sign * rate / apart, of_speed + sign / apart
        coefficients += terms
        free += amplitude[:, None] * (1.0, rate)
    coefficients[:, :6] += of_place * from_start
    coefficients[:, :5] += of_speed * speed
    return coefficients, free


def _relaxed(rate: float, length: NDArray[Any], push: NDArray[Any], kicks: NDArray[Any],
             is_long: NDArray[Any]) -> tuple[NDArray[Any], NDArray[Any]]:
    """Periodic y' = rate·y + push that gains `kicks` at the starts of steps, rate < 0.

    Returns polynomials (n, 21) and the amplitudes (n,) of e^(rate·s) beside them; the latter are
    part of the polynomials where steps are not long.
    """
    terms = np.zeros((length.size, TERMS))
    many = push.shape[1]
    for k in reversed(range(many)):
        terms[is_long, k] = ((k + 1) * terms[is_long, k + 1] / length[is_long]
                             - push[is_long, k]) / rate
    short, w = ~is_long, length[~is_long]
    for k in range(TERMS - 1):
        terms[short, k + 1] = w * (rate * terms[short, k]
                                   + (push[short, k] if k < many else 0.0)) / (k + 1)
    decay = np.exp(rate * length)
    gains = (terms.sum(axis=1) - decay * terms[:, 0]).tolist()

    def run(value: float) -> Iterator[float]:
        for factor, gain, kick in zip(decay.tolist(), gains, kicks.tolist(), strict=True):
            value += kick
            yield value
            value = factor * value + gain
        yield value

    closed = [*run(0.0)][-1] / -math.expm1(rate * float(length.sum()))
    amplitude = np.array([*run(closed)][:-1]) - terms[:, 0]
    terms[short] += amplitude[short, None] * _exponential(rate * w)
    return terms, np.where(is_long, amplitude, 0.0)


def _exponential(exponent: NDArray[Any]) -> NDArray[Any]:
    """e^(exponent·t) in powers of t, (n, 21)."""
    factorial = np.array([math.factorial(k) for k in range(TERMS)], dtype=float)
    powers: NDArray[Any] = exponent[:, None] ** np.arange(TERMS) / factorial
    return powers


# --- the least value --------------------------------------------------------------------------


def least_of_long(xi: float, period: float, edges: NDArray[Any], coefficients: NDArray[Any],
                  free: NDArray[Any]) -> tuple[float, float]:
    """Least value over all steps, and its phase (mesh periods); arrays as of `long_response`."""
    length = np.diff(edges)
    ends = coefficients[:, 0] + free[:, 0]
    best = int(np.argmin(ends))
    least, phase = float(ends[best]), float(edges[best])
    # |X| <= 1; |Y| <= 1 and, of two decays, at most 1/(λ1 - λ2).
    reach = 1.0 if xi <= 1 else min(1.0, 1 / max(rates(xi)[0] - rates(xi)[1], 1e-300))
    bound = lower_bounds(coefficients) - np.abs(free) @ (1.0, reach)
    for i in np.argsort(bound, kind="stable"):
        if bound[i] >= least:
            break
        value, at = _least_of_step(xi, length[i] * period, coefficients[i], free[i], least)
        if value < least:
            least, phase = value, float(edges[i] + at * length[i]) % 1.0
    return least, phase


def _least_of_step(xi: float, width: float, coefficients: NDArray[Any], free: NDArray[Any],
                   known: float) -> tuple[float, float]:
    """Least value of one step, as far as it is below `known`, and t where it is."""
    if not free.any():
        return lowest_point(np.array([0.0, 1.0]), coefficients[None])
    if xi >= APART:
        slow, fast = rates(xi)
        ends = np.concatenate([np.arange(_GONE + 1) / -fast, np.arange(1, _GONE + 1) / -slow])
        ends = np.append(np.unique(ends[ends < width]), width)
        return _search(xi, width, coefficients, free, ends)
    decay = xi if xi < 1 else -rates(xi)[0]
    shortest = 1 / max(1.0, 2 * xi)
    if _GONE <= _FOLLOWED * decay or width <= _FOLLOWED:
        gone = min(width, _GONE / decay if decay > 0 else width)
        ends = np.linspace(0.0, gone, math.ceil(gone / shortest) + 1)
        return _search(xi, width, coefficients, free, np.unique(np.append(ends, width)))
    return _least_of_many_turns(xi, width, coefficients, free, known)


def _least_of_many_turns(xi: float, width: float, coefficients: NDArray[Any], free: NDArray[Any],
                         known: float) -> tuple[float, float]:
    """Least value of a step with very many oscillations.

    They touch their lower envelope E = p - A·e^(-ξs) once a turn.  Where E does not turn around
    within a turn of some point, one of its neighbours on the lower side touches below it: the
    least value lies within a turn of a minimum of E, or of an end of the step.
    """
    omega = math.sqrt((1 - xi) * (1 + xi))
    turn = 2 * math.pi / omega
    amplitude = math.hypot(free[0], (free[1] + xi * free[0]) / omega)
    best, where = known, 0.0
    windows: list[tuple[float, ...]] = [(0.0, turn), (width - turn, width)]
    for lowest, at in _envelope_minima(xi, width, coefficients, amplitude):
        windows.append((max(0.0, at - turn), min(width, at + turn), lowest))
    for start, stop, *value in windows:
        if value and value[0] >= best:
            break
        if not start < stop:  # a turn is less than the rounding of time
            continue
        ends = np.linspace(start, stop, math.ceil(stop - start) + 1)
        found, at = _search(xi, width, coefficients, free, ends)
        if found < best:
            best, where = found, at
    return best, where


def _envelope_minima(xi: float, width: float, coefficients: NDArray[Any],
                     amplitude: float) -> list[tuple[float, float]]:
    """(E, s) of the points among which the minima of the envelope are, lowest first."""
    gone = min(width, _GONE / xi) if xi > 0 else width
    ends = np.unique(np.append(np.linspace(0.0, gone, math.ceil(xi * gone) + 1), width))
    steps = np.diff(ends)
    lower = expanded(coefficients, ends[:-1] / width, steps / width)
    alive = ends[:-1] < gone
    lower[alive] -= amplitude * np.exp(-xi * ends[:-1][alive])[:, None] * _exponential(
        -xi * steps[alive])
    found: list[tuple[float, float]] = []
    for start, length, polynomial in zip(ends[:-1], steps, lower, strict=True):
        points = stationary_points(polynomial)
        found += zip(power.polyval(points, polynomial), start + points * length, strict=True)
    return sorted(found)


def _search(xi: float, width: float, coefficients: NDArray[Any], free: NDArray[Any],
            ends: NDArray[Any]) -> tuple[float, float]:
    """Least value between `ends` (τ from the step's start) and t where it is."""
    steps, at = np.diff(ends), ends[:-1]
    terms = expanded(coefficients, at / width, steps / width)
    if xi >= APART:
        exponents = rates(xi)
        for rate, other, sign in zip(exponents, exponents[::-1], (1, -1), strict=True):
            alive = (-rate * at < _GONE) & (-rate * steps <= 1 + 1e-9)
            amplitude = sign * (free[1] - other * free[0]) / (exponents[0] - exponents[1])
            terms[alive] += (amplitude * np.exp(rate * at[alive])[:, None]
                             * _exponential(rate * steps[alive]))
    else:
        alive = steps * max(1.0, 2 * xi) <= 1 + 1e-9
        state = np.einsum("xsn,s->xn", unit_motions(xi, at[alive]), free)
        terms[alive] += series(xi, steps[alive], state[0], state[1] * steps[alive],
                               np.zeros((np.count_nonzero(alive), 6)))
    return lowest_point(ends / width, terms)
