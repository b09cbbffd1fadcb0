"""heyoka in batch mode: as many torques side by side as the processor's vectors hold doubles.

One integrator serves every motion state, since neighbours in a batch differ in it: spring and
damper are switched on by a runtime parameter. Both flanks are events of either direction, and the
callback says what they do. The remarks of `heyoka_taylor.py` on events hold here too.
"""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor

import heyoka as hy
import numpy as np

from lapwing.base.codes import EventKind
from lapwing_bench.outcome import Record
from lapwing_bench.problem import problem as problem_of
from lapwing_bench.rivals.hybrid import COAST, DRIVE, MAX_EVENTS, SEPARATION, back, resolve

# φ off a flank, in natural sizes: less than any digit of the motion feels.
ASIDE = 1e-40
# τ; a tooth that comes to rest is put as deep into the flank as it sinks in so long. It keeps the
# event's polynomial from a double zero, which cannot be isolated, and no digit above 1e-14 sees it.
SUNK = 1e-7
LOAD, CURVATURE, CONTACT, OFFSET = range(4)


def sweeper(scene, tolerance, threads):
    """See the package's docstring."""
    batches = [_Batch(problem_of(scene.oscillators[0]), tolerance) for _ in range(threads)]

    def sweep(problems, cycles):
        width = batches[0].width
        parts = [problems[i:i + width] for i in range(0, len(problems), width)]

        def share(k):
            return [batches[k].run(part, cycles) for part in parts[k::threads]]

        found = [None] * len(parts)
        if threads == 1:
            found = share(0)
        else:
            with ThreadPoolExecutor(threads) as pool:
                for k, records in enumerate(pool.map(share, range(threads))):
                    found[k::threads] = records
        return [record for part in found for record in part]

    return sweep


class _Batch:
    """Torques in one integrator, and what the callbacks share."""

    def __init__(self, first, tolerance):
        self.width, self.size = hy.recommended_simd_size(), first.angle
        x, v = hy.make_vars("phi", "phi_dot")
        backlash = first.backlash / self.size
        load = hy.par[LOAD]
        if first.arcs:
            load = load - hy.par[CURVATURE]
        else:
            inertia = first.amplitude * first.omega**2 / self.size
            load = load + inertia * hy.cos(first.omega * hy.time)
        spring = hy.par[CONTACT] * (2 * first.xi * v + x + hy.par[OFFSET])

        def event(equation, flank):
            # heyoka copies its callbacks deeply, but a function keeps what it closes over.
            return hy.t_event_batch(equation, callback=lambda integrator, sign, lane:
                                    self.touch(flank, integrator, sign, lane))

        self.integrator = hy.taylor_adaptive_batch(
            sys=[(x, v), (v, load - spring)], state=np.zeros((2, self.width)), tol=tolerance,
            pars=np.zeros((4, self.width)),
            t_events=[event(x, DRIVE), event(x + backlash, COAST)])

    def touch(self, flank, integrator, sign, lane):
        """Apply the impact law or release; whether that torque goes on."""
        problem, state = self.problems[lane], self.states[lane]
        inwards = (sign > 0) == (flank == DRIVE)
        if state != (SEPARATION if inwards else flank):
            return True
        tau, after = integrator.time[lane], self.size * integrator.state[1, lane]
        kinds, new = [EventKind.RELEASE], SEPARATION
        if inwards:
            kinds, new, after = resolve(problem, self.arc, flank, tau, after)
        depth = 0.0
        if new != SEPARATION and after == 0:
            pull = problem.force - problem.curvature(self.arc, tau)
            depth = 0.5 * abs(pull) * SUNK**2
        self.put(integrator, lane, flank, new, depth, after)
        rows = self.rows[lane]
        rows += [(back(kind, flank), tau, after) for kind in kinds]
        return len(rows) < MAX_EVENTS

    def put(self, integrator, lane, flank, state, depth, speed):
        """Place a tooth at a flank, `depth` (rad) inside or a trifle to its side."""
        inside = 1.0 if (state != SEPARATION) == (flank == DRIVE) else -1.0
        if flank == DRIVE:
            phi = inside * max(depth / self.size, ASIDE)
        else:
            wall = -self.problems[lane].backlash / self.size
            phi = min(wall - depth / self.size, np.nextafter(wall, -np.inf)) \
                if state != SEPARATION else np.nextafter(wall, np.inf)
        self.states[lane] = state
        integrator.state[:, lane] = phi, speed / self.size
        integrator.pars[CONTACT, lane] = float(state != SEPARATION)
        integrator.pars[OFFSET, lane] = (
            self.problems[lane].backlash / self.size if state == COAST else 0.0)

    def run(self, problems, cycles):
        """A `Record` of each problem, from rest."""
        integrator, size = self.integrator, self.size
        # What is left of the last batch is filled up with its last torque.
        self.problems = [*problems, *[problems[-1]] * (self.width - len(problems))]
        self.states, self.rows = [DRIVE] * self.width, [[] for _ in range(self.width)]
        forces = np.array([problem.force for problem in self.problems]) / size
        integrator.set_time(0.0)
        integrator.state[:] = forces, np.zeros(self.width)
        integrator.pars[:] = 0.0
        integrator.pars[LOAD], integrator.pars[CONTACT] = forces, 1.0
        first, failure = True, ""
        for end, arc in problems[0].arc_list(cycles):
            self.arc = arc
            if not first:
                integrator.state[1] -= arc.jump / size
            first = False
            integrator.pars[CURVATURE] = arc.curvature / size
            integrator.reset_cooldowns()
            integrator.propagate_until(end)
            outcomes = [outcome for outcome, *_ in integrator.propagate_res]
            if any(outcome != hy.taylor_outcome.time_limit for outcome in outcomes):
                failure = f"heyoka: {outcomes}"
                break
        period = problems[0].period
        return [Record(self.rows[i], period,
                       (self.states[i], *(size * integrator.state[:, i]).tolist()), failure)
                for i in range(len(problems))]
