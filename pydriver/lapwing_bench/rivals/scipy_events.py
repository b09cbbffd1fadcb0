"""SciPy's solve_ivp with terminal events: one call from event to event."""

from __future__ import annotations

from functools import partial

import numpy as np

from lapwing_bench.rivals.hybrid import COAST, DRIVE, SEPARATION, follow

STEP_FLOOR = 1e-12


def follower(scene, tolerance, method):
    """See the package's docstring; `method` is one of solve_ivp's."""
    return partial(_follow, method, max(tolerance, 3e-14))


def _follow(method, tolerance, problem, cycles):
    from scipy.integrate import solve_ivp

    natural = tolerance * np.array([problem.angle, problem.speed])
    shift = {SEPARATION: 0.0, DRIVE: 0.0, COAST: problem.backlash}

    def right_hand_side(state, arc):
        force, xi, offset = problem.force, problem.xi, shift[state]
        if problem.arcs:
            constant = force - arc.curvature

            def load(tau):
                return constant
        else:
            inertia, omega = problem.amplitude * problem.omega**2, problem.omega

            def load(tau):
                return force + inertia * np.cos(omega * tau)
        if state == SEPARATION:
            return lambda tau, y: (y[1], load(tau))
        return lambda tau, y: (y[1], load(tau) - 2 * xi * y[1] - y[0] - offset)

    def events(state):
        """The drive flank is reached upwards in flight and left downwards in contact."""
        found = []
        for flank in (DRIVE, COAST):
            if state not in (SEPARATION, flank):
                continue
            event = partial(_distance, shift[flank])
            event.terminal = True
            event.direction = 1 if (flank == DRIVE) == (state == SEPARATION) else -1
            found.append(event)
        return found

    event_sets = {state: events(state) for state in shift}

    def advance(state, arc, tau, end, phi, phi_dot, bounce):
        step, atol = None, natural
        if bounce is not None:
            step = min(max(bounce.half, STEP_FLOOR), end - tau)
            atol = tolerance * np.array([bounce.angle, bounce.speed])
        result = solve_ivp(right_hand_side(state, arc), (tau, end), (phi, phi_dot), method=method,
                           rtol=tolerance, atol=atol, events=event_sets[state], first_step=step)
        if result.status < 0:
            raise RuntimeError(result.message)
        flank = 0
        if result.status == 1:
            flank = state or (DRIVE if len(result.t_events[0]) else COAST)
        return float(result.t[-1]), float(result.y[0, -1]), float(result.y[1, -1]), flank

    return follow(problem, cycles, advance)


def _distance(offset, tau, y):
    return y[0] + offset
