"""heyoka's adaptive Taylor integrator with terminal events.

One integrator for each motion state is compiled for a scene; force and curvature are runtime
parameters. A tooth that bounces stays in the integrator of separation: the event's callback applies
the impact law. Every other event stops the integrator and the next state's takes over.

heyoka isolates the zeros of an event's Taylor polynomial. It needs angles near one (here φ over its
natural size), its own cool-down after an event, and no polynomial that begins with an exact zero.
"""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from functools import partial

import heyoka as hy
import numpy as np

from lapwing.base.codes import EventKind
from lapwing_bench.outcome import Record
from lapwing_bench.problem import problem as problem_of
from lapwing_bench.rivals.hybrid import COAST, DRIVE, MAX_EVENTS, SEPARATION, back, resolve

UP, DOWN = hy.event_direction.positive, hy.event_direction.negative
# φ off a flank, in natural sizes: less than any digit of the motion feels.
ASIDE = 1e-40
# Part of a mesh period over which a tooth that sticks is moved by its Taylor polynomial.
FIRST_MOVE = 1e-5


class _Flight:
    """What the callbacks of separation see and leave behind."""

    def __init__(self, size):
        self.size, self.next_state, self.rows = size, SEPARATION, []
        self.problem, self.arc = None, None

    def strike(self, flank, integrator):
        """Apply the impact law; whether the flight goes on."""
        state, tau, size = integrator.state, integrator.time, self.size
        kinds, self.next_state, after = resolve(self.problem, self.arc, flank, tau,
                                                size * state[1])
        state[0] = beside(self, flank, self.next_state == flank)
        state[1] = after / size
        for kind in kinds:
            self.rows.append((back(kind, flank), tau, after))
        return self.next_state == SEPARATION and len(self.rows) < MAX_EVENTS


def beside(flight, flank, inside):
    """φ at a flank, in natural sizes, a trifle inside or off it."""
    depth = 1.0 if inside else -1.0
    if flank == DRIVE:
        return depth * ASIDE
    return np.nextafter(-flight.problem.backlash / flight.size, -np.inf * depth)


def settled(flight, flank, tau, move):
    """φ and φ' (natural sizes) shortly after a tooth has come to rest on a flank.

    An event's polynomial that begins with a double zero cannot be isolated.
    """
    problem = flight.problem
    pull = problem.force - problem.curvature(flight.arc, tau)
    jerk = -2 * problem.xi * pull
    if not problem.arcs:
        jerk -= problem.amplitude * problem.omega**3 * np.sin(problem.omega * tau)
    at_flank = 0.0 if flank == DRIVE else -problem.backlash
    phi = at_flank + move**2 * (pull / 2 + jerk * move / 6)
    return phi / flight.size, move * (pull + jerk * move / 2) / flight.size


def follower(scene, tolerance):
    """See the package's docstring."""
    return partial(_follow, *_compiled(problem_of(scene.oscillators[0]), tolerance))


def sweeper(scene, tolerance, threads):
    """See the package's docstring."""
    followers = [follower(scene, tolerance) for _ in range(threads)]

    def sweep(problems, cycles):
        def share(k):
            return [followers[k](problem, cycles) for problem in problems[k::threads]]

        if threads == 1:
            return share(0)
        found = [None] * len(problems)
        with ThreadPoolExecutor(threads) as pool:
            for k, records in enumerate(pool.map(share, range(threads))):
                found[k::threads] = records
        return found

    return sweep


def _compiled(first, tolerance):
    """The integrators by motion state, and what the callbacks share."""
    x, v = hy.make_vars("phi", "phi_dot")
    flight, backlash = _Flight(first.angle), first.backlash / first.angle
    if first.arcs:
        load = hy.par[0] - hy.par[1]
    else:
        inertia = first.amplitude * first.omega**2 / first.angle
        load = hy.par[0] + inertia * hy.cos(first.omega * hy.time)

    def integrator(acceleration, events):
        return hy.taylor_adaptive(sys=[(x, v), (v, acceleration)], state=[0.0, 0.0],
                                  tol=tolerance, t_events=events)

    def event(equation, direction, flank=None):
        # heyoka copies its callbacks deeply, but a function keeps what it closes over.
        more = {} if flank is None else {
            "callback": lambda integrator, derivative: flight.strike(flank, integrator)}
        return hy.t_event(equation, direction=direction, **more)

    decay = -2 * first.xi * v - x
    return {SEPARATION: integrator(load, [event(x, UP, DRIVE), event(x + backlash, DOWN, COAST)]),
            DRIVE: integrator(load + decay, [event(x, DOWN)]),
            COAST: integrator(load + decay - backlash, [event(x + backlash, UP)])}, flight


def _follow(integrators, flight, problem, cycles):
    flight.problem, flight.rows = problem, []
    rows, size = flight.rows, flight.size
    state, phi, phi_dot, tau, first = DRIVE, problem.force / size, 0.0, 0.0, True
    for integrator in integrators.values():
        integrator.pars[0] = problem.force / size
    for end, arc in problem.arc_list(cycles):
        flight.arc = arc
        phi_dot -= 0.0 if first else arc.jump / size
        first = False
        while tau < end:
            integrator = integrators[state]
            if problem.arcs:
                integrator.pars[1] = arc.curvature / size
            integrator.reset_cooldowns()
            integrator.time = tau
            integrator.state[0], integrator.state[1] = phi, phi_dot
            outcome = integrator.propagate_until(end)[0]
            tau, (phi, phi_dot) = integrator.time, map(float, integrator.state)
            if outcome == hy.taylor_outcome.time_limit:
                break
            if int(outcome) < -3 or len(rows) >= MAX_EVENTS:
                return Record(rows, problem.period, (state, size * phi, size * phi_dot),
                                 f"heyoka: {outcome}")
            if state != SEPARATION:
                rows.append((back(EventKind.RELEASE, state), tau, size * phi_dot))
                phi, state = beside(flight, state, False), SEPARATION
                continue
            state = flight.next_state
            if phi_dot == 0:
                move = min(FIRST_MOVE * problem.period, 0.5 * (end - tau))
                phi, phi_dot = settled(flight, state, tau, move)
                tau += move
        tau = end
    return Record(rows, problem.period, (state, size * phi, size * phi_dot))
