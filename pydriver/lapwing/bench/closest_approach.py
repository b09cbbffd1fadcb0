"""How near the reference's motion came to an event it does not have, or to lacking one it has."""

from __future__ import annotations

import numpy as np

from lapwing.codes import EventKind, Flank

SEPARATION, DRIVE, COAST = 0, int(Flank.DRIVE), int(Flank.COAST)
ARRIVALS = (EventKind.IMPACT, EventKind.BACK_IMPACT, EventKind.ENGAGE, EventKind.BACK_ENGAGE)
RELEASES = (EventKind.RELEASE, EventKind.BACK_RELEASE)
RTOL = 1e-12
SAMPLES = 2001


def flank_of(kind):
    """Flank of an event kind; kinds alternate between the two."""
    return DRIVE if kind % 2 else COAST


def depth_beyond(problem, events, n):
    """How far (rad) the motion would have gone past event n: v²/2|a|, a before the event."""
    kind, tau = int(events["kind"][n]), float(events["time"][n]) * problem.period
    speed = float(events["velocity_before"][n])
    if kind not in (*ARRIVALS, *RELEASES):
        return np.inf  # a chatter's end has no other outcome nearby
    pull = problem.force - problem.curvature(problem.arc_at(tau), tau)
    if kind in RELEASES:
        pull -= 2 * problem.xi * speed
    return speed**2 / (2 * abs(pull)) if pull else np.inf


def closest_approach(problem, events, n, kind, here):
    """Least distance (rad) from an event of `kind` between events n - 1 and n of the reference.

    Where the motion turns back before the event, that turning point counts; where it does not,
    its distance at the time `here` (mesh periods).
    """
    state, tau, phi, phi_dot = _after(problem, events, n)
    end = float(events["time"][n]) if n < len(events["time"]) else here + 0.5
    times, distances = _distances(problem, state, tau, phi, phi_dot, end * problem.period, kind)
    inner = distances[1:-1]
    turning = inner[(inner <= distances[:-2]) & (inner <= distances[2:])]
    at = np.interp(here * problem.period, times, distances)
    return float(min([at, *np.abs(turning)])) if turning.size else float(abs(at))


def _after(problem, events, n):
    """Motion state, τ, φ, φ' after event n - 1 of the reference."""
    if n == 0:
        return DRIVE, 0.0, problem.force, 0.0
    kind = int(events["kind"][n - 1])
    flank = flank_of(kind)
    contact = kind not in (EventKind.IMPACT, EventKind.BACK_IMPACT, *RELEASES)
    return (flank if contact else SEPARATION, float(events["time"][n - 1]) * problem.period,
            0.0 if flank == DRIVE else -problem.backlash, float(events["velocity_after"][n - 1]))


def _distances(problem, state, tau, phi, phi_dot, end, kind):
    """Samples of the distance from an event of `kind`, positive before it."""
    from scipy.integrate import solve_ivp

    flank = flank_of(kind)
    offset = problem.backlash if flank == COAST else 0.0
    into = 1.0 if flank == DRIVE else -1.0  # the distance from release is the depth
    sign = into if kind in RELEASES else -into

    def rate(arc):
        def acceleration(t, y):
            load = problem.force - problem.curvature(arc, t)
            if state == SEPARATION:
                return y[1], load
            shift = problem.backlash if state == COAST else 0.0
            return y[1], load - 2 * problem.xi * y[1] - y[0] - shift
        return acceleration

    times, values = [], []
    for begin, stop, arc in problem.stretches(tau, end):
        if times:
            phi_dot -= arc.jump
        solution = solve_ivp(rate(arc), (begin, stop), (phi, phi_dot), method="DOP853",
                             rtol=RTOL, atol=RTOL * problem.angle, dense_output=True)
        t = np.linspace(begin, stop, SAMPLES)
        y = solution.sol(t)
        times.append(t)
        values.append(sign * (y[0] + offset))
        phi, phi_dot = solution.y[:, -1]
    return np.concatenate(times), np.concatenate(values)
