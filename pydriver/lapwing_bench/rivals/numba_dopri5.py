"""A compiled Dormand-Prince 5(4) with dense output: the whole hybrid loop in numba.

Step-size control and dense output as in Hairer, Nørsett & Wanner, Solving Ordinary Differential
Equations I, section II.5-6 (their DOPRI5); an event is a change of sign over a step, located on the
fourth-order dense output by Newton's method inside the bracket.
"""

from __future__ import annotations

from functools import partial

import numpy as np
from numba import njit, prange, set_num_threads

from lapwing.base.codes import EventKind
from lapwing_bench.outcome import Record

SEPARATION, DRIVE, COAST = 0, 1, 2
MAX_EVENTS, MAX_STEPS = 50_000, 5_000_000
# Torques of a sweep for which events are kept.
MOST_TORQUES = 64
FAILURES = ("", "too many events", "too many steps")
IMPACT, RELEASE = int(EventKind.IMPACT), int(EventKind.RELEASE)
ENGAGE, CHATTER_END = int(EventKind.ENGAGE), int(EventKind.CHATTER_END)
# Columns of the parameters.
(FORCE, OMEGA, PERIOD, XI, RESTITUTION, BACKLASH, STICKING, INERTIA) = range(8)
E1, E3, E4, E5, E6, E7 = (71 / 57600, -71 / 16695, 71 / 1920, -17253 / 339200, 22 / 525, -1 / 40)
D1, D3, D4, D5, D6, D7 = (
    -12715105075 / 11282082432, 87487479700 / 32700410799, -10690763975 / 1880347072,
    701980252875 / 199316789632, -1453857185 / 822651844, 69997945 / 29380423)


def follower(scene, tolerance):
    """See the package's docstring."""
    return partial(_follow, tolerance, np.empty((MAX_EVENTS, 3)))


def _follow(tolerance, rows, problem, cycles):
    laws, arcs = _shared(problem, cycles)
    n, failure, state, phi, phi_dot = run(
        _numbers(problem), laws, arcs, cycles, tolerance, tolerance * problem.angle,
        tolerance * problem.speed, problem.amplitude, rows)
    return Record(rows[:n].copy(), problem.period, (state, phi, phi_dot), FAILURES[failure])


def sweeper(scene, tolerance, threads):
    """See the package's docstring."""
    room = np.empty((MOST_TORQUES, MAX_EVENTS, 3))

    def sweep(problems, cycles):
        set_num_threads(threads)
        laws, arcs = _shared(problems[0], cycles)
        n = len(problems)
        if n > MOST_TORQUES:
            raise ValueError(f"{n} torques, expected at most {MOST_TORQUES}")
        rows, counts, ends = room[:n], np.empty((n, 3), dtype=np.int64), np.empty((n, 2))
        run_all(np.array([_numbers(problem) for problem in problems]), laws, arcs, cycles,
                tolerance, np.array([(problem.angle, problem.speed) for problem in problems]),
                problems[0].amplitude, rows, counts, ends)
        return [Record(rows[i, :counts[i, 0]].copy(), problem.period,
                       (int(counts[i, 2]), *ends[i].tolist()), FAILURES[counts[i, 1]])
                for i, problem in enumerate(problems)]

    return sweep


def _numbers(problem):
    return np.array([
        problem.force, problem.omega, problem.period, problem.xi, problem.restitution,
        problem.backlash, problem.sticking, problem.amplitude * problem.omega**2])


def _shared(problem, cycles):
    """Laws and arcs, as `run` takes them."""
    laws = np.array([problem.compliant, problem.absolute, len(problem.arcs) > 0])
    arcs = np.array([[arc.begin, arc.end, arc.slope, arc.curvature, arc.jump]
                     for arc in problem.arcs] or [[0.0, problem.period * cycles, 0.0, 0.0, 0.0]])
    return laws, arcs


@njit(inline="always")
def acceleration(p, state, piecewise, curvature, tau, phi, phi_dot):
    """φ''."""
    load = p[FORCE] - curvature if piecewise else p[FORCE] + p[INERTIA] * np.cos(p[OMEGA] * tau)
    if state == SEPARATION:
        return load
    offset = p[BACKLASH] if state == COAST else 0.0
    return load - 2 * p[XI] * phi_dot - phi - offset


@njit
def step_once(p, state, piecewise, curvature, tau, h, x, v, a1):
    """One step; end state, error estimate, acceleration at the end, and the dense output."""
    x2, v2 = x + h * v / 5, v + h * a1 / 5
    a2 = acceleration(p, state, piecewise, curvature, tau + h / 5, x2, v2)
    x3 = x + h * (3 / 40 * v + 9 / 40 * v2)
    v3 = v + h * (3 / 40 * a1 + 9 / 40 * a2)
    a3 = acceleration(p, state, piecewise, curvature, tau + 0.3 * h, x3, v3)
    x4 = x + h * (44 / 45 * v - 56 / 15 * v2 + 32 / 9 * v3)
    v4 = v + h * (44 / 45 * a1 - 56 / 15 * a2 + 32 / 9 * a3)
    a4 = acceleration(p, state, piecewise, curvature, tau + 0.8 * h, x4, v4)
    x5 = x + h * (19372 / 6561 * v - 25360 / 2187 * v2 + 64448 / 6561 * v3 - 212 / 729 * v4)
    v5 = v + h * (19372 / 6561 * a1 - 25360 / 2187 * a2 + 64448 / 6561 * a3 - 212 / 729 * a4)
    a5 = acceleration(p, state, piecewise, curvature, tau + 8 / 9 * h, x5, v5)
    x6 = x + h * (9017 / 3168 * v - 355 / 33 * v2 + 46732 / 5247 * v3 + 49 / 176 * v4
                  - 5103 / 18656 * v5)
    v6 = v + h * (9017 / 3168 * a1 - 355 / 33 * a2 + 46732 / 5247 * a3 + 49 / 176 * a4
                  - 5103 / 18656 * a5)
    a6 = acceleration(p, state, piecewise, curvature, tau + h, x6, v6)
    dx = h * (35 / 384 * v + 500 / 1113 * v3 + 125 / 192 * v4 - 2187 / 6784 * v5 + 11 / 84 * v6)
    dv = h * (35 / 384 * a1 + 500 / 1113 * a3 + 125 / 192 * a4 - 2187 / 6784 * a5 + 11 / 84 * a6)
    x7, v7 = x + dx, v + dv
    a7 = acceleration(p, state, piecewise, curvature, tau + h, x7, v7)
    ex = h * (E1 * v + E3 * v3 + E4 * v4 + E5 * v5 + E6 * v6 + E7 * v7)
    ev = h * (E1 * a1 + E3 * a3 + E4 * a4 + E5 * a5 + E6 * a6 + E7 * a7)
    bx, bv = h * v - dx, h * a1 - dv
    dense = (dx, bx, dx - h * v7 - bx,
             h * (D1 * v + D3 * v3 + D4 * v4 + D5 * v5 + D6 * v6 + D7 * v7),
             dv, bv, dv - h * a7 - bv,
             h * (D1 * a1 + D3 * a3 + D4 * a4 + D5 * a5 + D6 * a6 + D7 * a7))
    return x7, v7, a7, ex, ev, dense


@njit(inline="always")
def dense_position(x, d, s):
    """φ at a fraction of the step."""
    return x + s * (d[0] + (1 - s) * (d[1] + s * (d[2] + (1 - s) * d[3])))


@njit(inline="always")
def dense_velocity(v, d, s):
    """φ' at a fraction of the step."""
    return v + s * (d[4] + (1 - s) * (d[5] + s * (d[6] + (1 - s) * d[7])))


@njit
def locate(x, v, d, offset):
    """Fraction of the step at which the dense output of φ + offset passes zero."""
    low, high = 0.0, 1.0
    rising = dense_position(x, d, 1.0) + offset > 0
    s = 1.0
    for _ in range(60):
        f = dense_position(x, d, s) + offset
        if f == 0.0:
            return s
        if (f > 0) == rising:
            high = s
        else:
            low = s
        # Derivative of the dense output by its own formula.
        q = d[1] + s * (d[2] + (1 - s) * d[3])
        dq = d[2] + (1 - 2 * s) * d[3]
        slope = d[0] + (1 - 2 * s) * q + s * (1 - s) * dq
        new = s - f / slope if slope != 0.0 else 0.5 * (low + high)
        if not low < new < high:
            new = 0.5 * (low + high)
        if abs(new - s) <= 2e-16:
            return new
        s = new
    return s


@njit
def touched(state, x0, x1, backlash):
    """Flank whose event lies between two positions (0: none)."""
    if state == SEPARATION:
        if x1 >= 0.0 and x0 <= 0.0:
            return DRIVE
        if x1 <= -backlash and x0 >= -backlash:
            return COAST
        return 0
    if state == DRIVE:
        return DRIVE if x1 <= 0.0 else 0
    return COAST if x1 >= -backlash else 0


@njit
def resolve(p, compliant, absolute, state, flank, tau, v, load, slope, rows, n):
    """What an event does: motion state, φ' and the number of rows after it."""
    side, code = (1.0, 0) if flank == DRIVE else (-1.0, 1)
    if state != SEPARATION or compliant:
        kind = RELEASE if state != SEPARATION else ENGAGE
        rows[n, 0], rows[n, 1], rows[n, 2] = kind + code, tau, v
        return flank if state == SEPARATION else SEPARATION, v, n + 1
    v = -p[RESTITUTION] * v
    if absolute:
        v -= (1 + p[RESTITUTION]) * slope
    rows[n, 0], rows[n, 1], rows[n, 2] = IMPACT + code, tau, v
    n += 1
    sticks = abs(v) < p[STICKING] and side * load > 0
    if not sticks and side * v <= 0:
        return SEPARATION, v, n
    v = 0.0 if sticks else v
    kind = CHATTER_END if sticks else ENGAGE
    rows[n, 0], rows[n, 1], rows[n, 2] = kind + code, tau, v
    return flank, v, n + 1


@njit
def run(p, laws, arcs, cycles, rtol, atol_x, atol_v, amplitude, rows):
    """The hybrid loop; (events, failure, motion state, φ, φ')."""
    compliant, absolute, piecewise = laws[0], laws[1], laws[2]
    period, backlash = p[PERIOD], p[BACKLASH]
    last = cycles * period
    state, x, v, tau = DRIVE, p[FORCE], 0.0, 0.0
    n, steps, cycle, arc, h = 0, 0, 0, 0, 0.1
    while tau < last:
        begin, curvature = cycle * period + arcs[arc, 0], arcs[arc, 3]
        end = min(cycle * period + arcs[arc, 1], last) if piecewise else last
        a = acceleration(p, state, piecewise, curvature, tau, x, v)
        previous = 1e-4
        while tau < end:
            at_end = tau + 1.000001 * h >= end
            if at_end:
                h = end - tau
            x1, v1, a1, ex, ev, dense = step_once(p, state, piecewise, curvature, tau, h, x, v, a)
            sx = ex / (atol_x + rtol * max(abs(x), abs(x1)))
            sv = ev / (atol_v + rtol * max(abs(v), abs(v1)))
            error = max(np.sqrt(0.5 * (sx * sx + sv * sv)), 1e-10)
            steps += 1
            if steps > MAX_STEPS:
                return n, 2, state, x, v
            if error > 1.0:
                h *= max(0.2, 0.9 * error ** -0.2)
                continue
            grown = h * min(10.0, max(0.2, 0.9 * error ** -0.17 * previous ** 0.04))
            previous = max(error, 1e-4)
            flank = touched(state, x, x1, backlash)
            if flank == 0:
                tau = end if at_end else tau + h
                x, v, a, h = x1, v1, a1, grown
                continue
            offset = backlash if flank == COAST else 0.0
            s = locate(x, v, dense, offset)
            tau, v, x = tau + s * h, dense_velocity(v, dense, s), -offset
            h = grown
            if n + 2 > len(rows):
                return n, 1, state, x, v
            load = acceleration(p, SEPARATION, piecewise, curvature, tau, x, v)
            slope = 0.0
            if absolute:
                slope = (arcs[arc, 2] + curvature * (tau - begin) if piecewise
                         else -amplitude * p[OMEGA] * np.sin(p[OMEGA] * tau))
            state, v, n = resolve(p, compliant, absolute, state, flank, tau, v, load, slope,
                                  rows, n)
            if state == SEPARATION and load != 0.0 and v != 0.0:
                h = min(h, abs(v / load))  # a step must not leap over a short flight
            h = max(h, 1e-13)
            a = acceleration(p, state, piecewise, curvature, tau, x, v)
            previous = 1e-4
        if piecewise and tau < last:
            arc += 1
            if arc == len(arcs):
                arc, cycle = 0, cycle + 1
            v -= arcs[arc, 4]
    return n, 0, state, x, v


@njit(parallel=True)
def run_all(parameters, laws, arcs, cycles, tolerance, sizes, amplitude, rows, counts, ends):
    """Every torque, several at a time; events, failures and motion states, φ and φ'."""
    for i in prange(len(parameters)):
        counts[i, 0], counts[i, 1], counts[i, 2], ends[i, 0], ends[i, 1] = run(
            parameters[i], laws, arcs, cycles, tolerance, tolerance * sizes[i, 0],
            tolerance * sizes[i, 1], amplitude, rows[i])
