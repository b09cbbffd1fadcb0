"""Mean and peak of the mesh force over each cycle, from the known motion of each contact arc.

In contact d'' + 2ξd' + d = F - g'' (without g'' at a coast flank that stands still), and the force
of spring and damper is f = d + 2ξd' in units of k'·lever.  Its integral over an arc follows from
momentum alone, f = F - θ'':

    ∫f dτ = F·(b - a) - (θ'(b) - θ'(a)),                θ' = φ' + g'.

Its extremes are those of the arc's own power series, begun at states of the run that lie close
together; an interval whose bound lies below a force found already is not searched.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.polynomial import polynomial as power
from numpy.typing import NDArray

from lapwing.base.codes import EventKind, MotionState
from lapwing.engine import of_kind
from lapwing.engine.records import SAMPLE
from lapwing.model.transmission_error.extrema import stationary_points

if TYPE_CHECKING:
    from collections.abc import Callable

    from lapwing.model.oscillator import Oscillator

# Terms of the series.  Intervals are so short that |λ|h <= 1/2 for both free exponents λ and
# 2πnh <= 1/2 for each harmonic n: what is left out is below 1/(2^18·18!) = 6e-22.
TERMS = 18
LONGEST = 0.5
# Samples of a cycle taken for the series' sake: enough for mesh frequencies down to 1/4000 of the
# natural one. What needs more has no peak; else memory and time would grow with this ratio.
MOST_PHASES = 50_000
# Cycles whose series are made together.
BATCH = 64
BEGINS = {EventKind.ENGAGE: MotionState.ENGAGEMENT, EventKind.CHATTER_END: MotionState.ENGAGEMENT,
          EventKind.BACK_ENGAGE: MotionState.BACK_ENGAGEMENT,
          EventKind.BACK_CHATTER_END: MotionState.BACK_ENGAGEMENT}
ENDS = (EventKind.RELEASE, EventKind.BACK_RELEASE)


def sample_phases(osc: Oscillator, samples_per_cycle: int) -> tuple[NDArray[Any], NDArray[Any]]:
    """Phases to sample, close enough for the series, and which of them are the even ones stored.

    Every knot of a table is among them, so that g is one polynomial on each interval. Where the
    series needs more than `MOST_PHASES`, there are no more than those stored and the knots.

    Returns
    -------
    (n,) array of mesh phases, rising; (samples_per_cycle,) array of indices into them
    """
    each = math.ceil(osc.period / (_longest(osc) * samples_per_cycle))
    if samples_per_cycle * each > MOST_PHASES:
        each = 1
    even = np.arange(samples_per_cycle * each) / (samples_per_cycle * each)
    grid = even if _order(osc) else np.union1d(even, osc.te.knots[:-1])
    return grid, np.searchsorted(grid, np.arange(samples_per_cycle) / samples_per_cycle)


def _longest(osc: Oscillator) -> float:
    """The longest interval that the series takes, in τ."""
    order = _order(osc)
    return LONGEST * min(1.0, 1 / max(2 * osc.damping_ratio, 1e-300),
                         osc.period / (2 * math.pi * order) if order else math.inf)


def _order(osc: Oscillator) -> float:
    """The highest order of a harmonic series, 0 for a table."""
    return np.max(osc.te.harmonics[:, 0], initial=0.0) if len(osc.te.harmonics) else 0.0


def flank_motion(osc: Oscillator, phase: NDArray[Any], side: str = "right") -> list[NDArray[Any]]:
    """g, g' (rad, per τ) of the drive flank; `side` tells the limit at a knot."""
    return [osc.flank_scale / osc.period**k * osc.te.derivative(k, phase, side) for k in range(2)]


def deflection(osc: Oscillator, state: NDArray[Any], phi: NDArray[Any], phi_dot: NDArray[Any],
               g: NDArray[Any], slope: NDArray[Any]) -> tuple[NDArray[Any], NDArray[Any]]:
    """Deflection of the flank in contact and its rate, rad and rad per τ."""
    coast = state == MotionState.BACK_ENGAGEMENT
    standing = coast & (not osc.back_flank_te)
    return (np.where(coast, phi + osc.gap_width, phi) + np.where(standing, g, 0.0),
            phi_dot + np.where(standing, slope, 0.0))


def contact_forces(osc: Oscillator, grid: NDArray[Any], samples: NDArray[Any],
                   events: NDArray[Any], record: int,
                   told: Callable[[float], object] = lambda _: None) -> NDArray[Any]:
    """Mean and largest magnitude of W/(k'·lever) in each cycle, (2, record), rad.

    Impacts are not included. NaN under the rigid law, which has no spring; the largest also where
    the phases sampled lie too far apart for the series.

    Parameters
    ----------
    osc : Oscillator
    grid : (n,) array of the phases sampled
    samples : table (record·n + 1,), the last one at the end of the last cycle
    events : table of the events of these cycles, counted from the first
    record : int
    told : callable(fraction done), called before each batch of cycles
    """
    result = np.full((2, record), np.nan)
    if osc.contact_law == "rigid":
        return result
    size = grid.size
    phase = np.append(grid, 1.0)
    flank = flank_motion(osc, phase)
    # Phases are fractions of the period to rounding.
    near = osc.period * np.diff(phase).max() <= _longest(osc) * (1 + 1e-9)
    log = of_kind(events, (*BEGINS, *ENDS))
    for m in range(0, record, BATCH):
        told(1.0)
        cycles = np.arange(m, min(m + BATCH, record))
        some = samples[cycles[:, None] * size + np.arange(size + 1)]
        nodes = _nodes(osc, phase, some, flank, log[np.isin(log["cycle"], cycles)], m)
        result[0, cycles] = [_mean(osc, one) for one in nodes]
        if near:
            result[1, cycles] = _peaks(osc, nodes)
    return result


def _nodes(osc: Oscillator, phase: NDArray[Any], samples: NDArray[Any], flank: list[NDArray[Any]],
           events: NDArray[Any], first: int) -> list[NDArray[Any]]:
    """Of each cycle from the first on, columns (t, state, d, d', θ') at samples and events.

    In order; the state is the one after. Of an end of contact, and of a sample where contact goes
    on, the last two hold before it too. `samples` is (cycles, phases).
    """
    state, phi, phi_dot = (samples[name] for name in SAMPLE)
    at = np.array([np.broadcast_to(phase * osc.period, state.shape), state,
                   *deflection(osc, state, phi, phi_dot, *flank), phi_dot + flank[1]])
    kind, t = events["kind"], events["t"]
    before, after = events["velocity_before"], events["velocity_after"]
    ends = np.isin(kind, ENDS)
    begun = np.array([BEGINS.get(EventKind(int(one)), MotionState.SEPARATION) for one in kind])
    # A coast flank that stands still has no slope of its own: velocities there are those of θ.
    coast = kind % 2 == 0
    moving = 0.0 if not osc.back_flank_te else 1.0
    side = [flank_motion(osc, np.minimum(t / osc.period, 1.0), one)[1] for one in
            ("left", "right")]
    rate = np.where(ends, before, after)
    own = np.where(coast, moving, 1.0) * np.where(ends, *side)
    hits = np.array([t, begun, np.zeros(t.size), rate, rate + own])
    # Stable: an event comes before a sample at the same time, which sees the state after it.
    both = np.hstack([hits, at.reshape(5, -1)])
    cycle = np.concatenate([events["cycle"] - first,
                            np.repeat(np.arange(len(samples)), phase.size)])
    order = np.lexsort((both[0], cycle))
    return np.split(both[:, order], np.searchsorted(cycle[order], np.arange(1, len(samples))),
                    axis=1)


def _mean(osc: Oscillator, nodes: NDArray[Any]) -> float:
    """Mean force of a cycle from the momentum of each stretch of contact."""
    contact = nodes[1, :-1] != MotionState.SEPARATION
    t, momentum = nodes[0], nodes[4]
    # A stretch of unbroken contact telescopes; rounding is that of its two ends.
    edges = np.diff(np.concatenate([[0], contact.astype(int), [0]]))
    first, last = np.flatnonzero(edges == 1), np.flatnonzero(edges == -1)
    return float(np.sum(osc.force * (t[last] - t[first]) - (momentum[last] - momentum[first]))
                 / osc.period)


def _peaks(osc: Oscillator, cycles: list[NDArray[Any]]) -> NDArray[Any]:
    """Largest magnitude of the force in each of some cycles."""
    nodes = np.hstack([one[:, :-1] for one in cycles])
    width = np.concatenate([np.diff(one[0]) for one in cycles])
    cycle = np.repeat(np.arange(len(cycles)), [one.shape[1] - 1 for one in cycles])
    some = (nodes[1] != MotionState.SEPARATION) & (width > 0)
    series, cycle = _force_series(osc, nodes[:, some], width[some]), cycle[some]
    ends = np.abs(np.array([series[:, 0], series.sum(axis=1)]))
    best = np.zeros(len(cycles))
    np.maximum.at(best, cycle, ends.max(axis=0))
    bound = 0.5 * (ends.sum(axis=0) + np.abs(series) @ np.arange(series.shape[1]))
    left = np.flatnonzero(bound > best[cycle])
    for i in left[np.argsort(-bound[left])]:
        if bound[i] > best[cycle[i]]:
            values = power.polyval(stationary_points(series[i]), series[i])
            best[cycle[i]] = max(best[cycle[i]], float(np.abs(values).max()))
    return best


def _force_series(osc: Oscillator, nodes: NDArray[Any], width: NDArray[Any]) -> NDArray[Any]:
    """f in ascending powers of (τ - node)/width, (n, TERMS - 1)."""
    t, state, depth, rate, _ = nodes
    double = 2 * osc.damping_ratio
    forcing = _flank_series(osc, t / osc.period, width)
    forcing[(state == MotionState.BACK_ENGAGEMENT) & (not osc.back_flank_te)] = 0.0
    terms = np.zeros((t.size, TERMS))
    terms[:, 0], terms[:, 1] = depth - osc.force, rate * width
    for k in range(TERMS - 2):
        terms[:, k + 2] = -forcing[:, k + 2] - double * width * terms[:, k + 1] / (k + 2) \
            - width**2 * terms[:, k] / ((k + 1) * (k + 2))
    rates = terms[:, 1:] * np.arange(1, TERMS) / width[:, None]
    force: NDArray[Any] = terms[:, :-1] + double * rates
    force[:, 0] += osc.force
    return force


def _flank_series(osc: Oscillator, phase: NDArray[Any], width: NDArray[Any]) -> NDArray[Any]:
    """g in ascending powers of (τ - node)/width, (n, TERMS)."""
    turn = width / osc.period
    degree = TERMS if len(osc.te.harmonics) else osc.te.coefficients.shape[1]
    series = np.zeros((phase.size, TERMS))
    for k in range(degree):
        series[:, k] = osc.flank_scale * osc.te.derivative(k, phase) * turn**k / math.factorial(k)
    return series
