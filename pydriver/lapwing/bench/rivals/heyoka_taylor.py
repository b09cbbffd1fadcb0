"""heyoka's adaptive Taylor integrator with terminal events.

One integrator for each motion state is compiled for a scene; force and curvature are runtime
parameters. A tooth that bounces stays in the integrator of separation: the event's callback applies
the impact law. Every other event stops the integrator and the next state's takes over.
"""

from __future__ import annotations

from functools import partial

import heyoka as hy
import numpy as np

from lapwing.bench.outcome import from_rows
from lapwing.bench.problem import problem as problem_of
from lapwing.bench.rivals.hybrid import COAST, DRIVE, MAX_EVENTS, SEPARATION, back, resolve
from lapwing.codes import EventKind

UP, DOWN = hy.event_direction.positive, hy.event_direction.negative

ASIDE, ASIDE_SPEED = 1e-40, 1e-22  # rad, rad per τ


class _Flight:
    """What the callbacks of separation see and leave behind."""

    def __init__(self):
        self.problem, self.arc, self.rows, self.next_state = None, None, [], SEPARATION

    def strike(self, flank, integrator):
        """Apply the impact law; whether the flight goes on."""
        state = integrator.state
        kinds, self.next_state, after = resolve(
            self.problem, self.arc, flank, integrator.time, state[1])
        state[0], state[1] = beside(self.problem, flank, self.next_state == flank), after
        if after == 0:  # sticking: an event's polynomial with a double zero cannot be isolated
            state[1] = ASIDE_SPEED if flank == DRIVE else -ASIDE_SPEED
        for kind in kinds:
            self.rows.append((back(kind, flank), integrator.time, after))
        return self.next_state == SEPARATION and len(self.rows) < MAX_EVENTS


def beside(problem, flank, inside):
    """φ (rad) at a flank, so little off it that no digit of the motion feels it.

    Where an event's polynomial begins with an exact zero, heyoka may take the next root for it.
    """
    depth = ASIDE if inside else -ASIDE
    return depth if flank == DRIVE else -problem.backlash * (1 + np.sign(depth) * 2.3e-16)


def follower(scene, tolerance):
    """See the package's docstring."""
    return partial(_follow, *_compiled(problem_of(scene.oscillators[0]), tolerance))


def _compiled(scene_problem, tolerance):
    """The integrators by motion state, and what the callbacks share."""
    x, v = hy.make_vars("phi", "phi_dot")
    backlash, flight = scene_problem.backlash, _Flight()
    if scene_problem.arcs:
        load = hy.par[0] - hy.par[1]
    else:
        inertia = scene_problem.amplitude * scene_problem.omega**2
        load = hy.par[0] + inertia * hy.cos(scene_problem.omega * hy.time)

    def integrator(acceleration, events):
        return hy.taylor_adaptive(sys=[(x, v), (v, acceleration)], state=[0.0, 0.0],
                                  tol=tolerance, t_events=events)

    def event(equation, direction, flank=None):
        # The direction tells the event just left from the next one: no cool-down is needed.
        # heyoka copies its callbacks deeply, but a function keeps what it closes over.
        more = {} if flank is None else {
            "callback": lambda integrator, derivative: flight.strike(flank, integrator)}
        return hy.t_event(equation, direction=direction, cooldown=0.0, **more)

    decay = -2 * scene_problem.xi * v - x
    return {SEPARATION: integrator(load, [event(x, UP, DRIVE), event(x + backlash, DOWN, COAST)]),
            DRIVE: integrator(load + decay, [event(x, DOWN)]),
            COAST: integrator(load + decay - backlash, [event(x + backlash, UP)])}, flight


def _follow(integrators, flight, problem, cycles):
    flight.problem, flight.rows = problem, []
    rows = flight.rows
    state, phi, phi_dot, tau, first = DRIVE, problem.force, 0.0, 0.0, True
    for integrator in integrators.values():
        integrator.pars[0] = problem.force
    for end, arc in problem.arc_list(cycles):
        flight.arc = arc
        phi_dot -= 0.0 if first else arc.jump
        first = False
        while tau < end:
            integrator = integrators[state]
            if problem.arcs:
                integrator.pars[1] = arc.curvature
            integrator.time = tau
            integrator.state[0], integrator.state[1] = phi, phi_dot
            outcome = integrator.propagate_until(end)[0]
            tau, (phi, phi_dot) = integrator.time, map(float, integrator.state)
            if outcome == hy.taylor_outcome.time_limit:
                break
            if int(outcome) < -3 or len(rows) >= MAX_EVENTS:
                return from_rows(rows, problem.period, (state, phi, phi_dot),
                                 f"heyoka: {outcome}")
            if state == SEPARATION:
                state = flight.next_state
            else:
                rows.append((back(EventKind.RELEASE, state), tau, phi_dot))
                phi, state = beside(problem, state, False), SEPARATION
        tau = end
    return from_rows(rows, problem.period, (state, phi, phi_dot))
