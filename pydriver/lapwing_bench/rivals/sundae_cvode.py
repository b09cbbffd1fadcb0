"""CVODE (SUNDIALS) through scikit-sundae, Adams method with root finding."""

from __future__ import annotations

from functools import partial

import numpy as np
from sksundae.cvode import CVODE

from lapwing_bench.rivals.hybrid import COAST, DRIVE, SEPARATION, follow


def follower(scene, tolerance):
    """See the package's docstring."""
    return partial(_follow, tolerance)


def _follow(tolerance, problem, cycles):
    natural = tolerance * np.array([problem.angle, problem.speed])
    force, xi = problem.force, problem.xi
    inertia, omega = problem.amplitude * problem.omega**2, problem.omega
    arc_now = [None]

    def load(tau):
        if problem.arcs:
            return force - arc_now[0].curvature
        return force + inertia * np.cos(omega * tau)

    def flight(tau, y, yp):
        yp[0] = y[1]
        yp[1] = load(tau)

    def contact(offset):
        def right_hand_side(tau, y, yp):
            yp[0] = y[1]
            yp[1] = load(tau) - 2 * xi * y[1] - y[0] - offset

        def distance(tau, y, events):
            events[0] = y[0] + offset

        return right_hand_side, distance

    def both(tau, y, events):
        events[0] = y[0]
        events[1] = y[0] + problem.backlash

    systems = {SEPARATION: (flight, both, [1, -1]),
               DRIVE: (*contact(0.0), [-1]), COAST: (*contact(problem.backlash), [1])}
    for _, event, directions in systems.values():
        event.terminal = [True] * len(directions)
        event.direction = directions

    def advance(state, arc, tau, end, phi, phi_dot, bounce):
        arc_now[0] = arc
        function, event, directions = systems[state]
        # A call that reaches its end before its first step is over is refused by CVODE.
        first, atol = 0.0, natural
        if bounce is not None:
            first = min(bounce.half, 0.5 * (end - tau))
            atol = tolerance * np.array([bounce.angle, bounce.speed])
        solver = CVODE(function, method="Adams", rtol=tolerance, atol=atol, eventsfn=event,
                       num_events=len(directions), first_step=first, max_num_steps=100_000)
        result = solver.solve(np.array([tau, end]), np.array([phi, phi_dot]))
        if not result.success:
            raise RuntimeError(result.message)
        flank = 0
        if result.i_events is not None and len(result.i_events):
            hit = int(np.flatnonzero(result.i_events[-1])[0])
            flank = state or (DRIVE if hit == 0 else COAST)
        return float(result.t[-1]), float(result.y[-1, 0]), float(result.y[-1, 1]), flank

    return follow(problem, cycles, advance)
