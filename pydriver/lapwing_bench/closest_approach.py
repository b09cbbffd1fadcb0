"""How near the reference's motion came to an event it does not have, or to lacking one it has."""

from __future__ import annotations

import numpy as np

from lapwing.base.codes import EventKind, Flank

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

    Where the motion turns back before the event, that turning point counts; besides, its distance
    at the time `here` (mesh periods).
    """
    state, tau, phi, phi_dot = _after(problem, events, n)
    end = float(events["time"][n]) if n < len(events["time"]) else here + 0.5
    flank = flank_of(kind)
    sign = 1.0 if flank == DRIVE else -1.0  # of the depth into the flank
    offset = problem.backlash if flank == COAST else 0.0
    # Before a release the depth is the distance; before an arrival what is missing to it.
    sign = sign if kind in RELEASES else -sign
    found, before = [np.inf], None
    for begin, stop, arc in problem.stretches(tau, end * problem.period):
        phi_dot -= arc.jump if before is not None else 0.0
        solution = _smooth(problem, state, arc, begin, stop, phi, phi_dot)
        # A kink can turn the motion back as well.
        if before is not None and sign * before < 0 <= sign * phi_dot:
            found.append(abs(phi + offset))
        times = _turning_points(solution, begin, stop, sign)
        if begin <= here * problem.period <= stop:
            times.append(here * problem.period)
        found += [abs(solution(t)[0] + offset) for t in times]
        phi, phi_dot = (float(x) for x in solution(stop))
        before = phi_dot
    return float(min(found))


def _smooth(problem, state, arc, begin, stop, phi, phi_dot):
    """φ, φ' as a function of τ on a stretch without kinks."""
    from scipy.integrate import solve_ivp

    def rate(t, y):
        load = problem.force - problem.curvature(arc, t)
        if state == SEPARATION:
            return y[1], load
        shift = problem.backlash if state == COAST else 0.0
        return y[1], load - 2 * problem.xi * y[1] - y[0] - shift

    return solve_ivp(rate, (begin, stop), (phi, phi_dot), method="DOP853", rtol=RTOL,
                     atol=RTOL * problem.angle, dense_output=True).sol


def _turning_points(solution, begin, stop, sign):
    """Where sign·φ stops falling and rises."""
    from scipy.optimize import brentq

    t = np.linspace(begin, stop, SAMPLES)
    rate = sign * solution(t)[1]
    return [brentq(lambda x: solution(x)[1], t[i], t[i + 1])
            for i in np.flatnonzero((rate[:-1] < 0) & (rate[1:] > 0))]


def _after(problem, events, n):
    """Motion state, τ, φ, φ' after event n - 1 of the reference."""
    if n == 0:
        return DRIVE, 0.0, problem.force, 0.0
    kind = int(events["kind"][n - 1])
    flank = flank_of(kind)
    contact = kind not in (EventKind.IMPACT, EventKind.BACK_IMPACT, *RELEASES)
    return (flank if contact else SEPARATION, float(events["time"][n - 1]) * problem.period,
            0.0 if flank == DRIVE else -problem.backlash, float(events["velocity_after"][n - 1]))
