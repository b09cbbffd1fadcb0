"""One trajectory followed."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from lapwing import engine
from lapwing.base import arguments, estimates
from lapwing.base.arguments import MAX_INT, renamed
from lapwing.base.codes import MotionState, Status
from lapwing.engine import Numerics, TrajectoryCall, Wanted, chosen, position, thinned
from lapwing.engine.records import MEAN
from lapwing.model.oscillator import Oscillator
from lapwing.studies.trajectory.result import HybridState, Run, tau_of
from lapwing.studies.trajectory.start import checked_start, engine_start

RECORDS = ("events", "cycles", "grazes")


@arguments.complete(old=("record",))
def simulate(osc: Oscillator, start: Any = "rest", phase: float = 0.0, cycles: float = 50,
             method: str = "auto", rtol: float = 1e-10, *,
             observe: Sequence[str] = ("events", "cycles"), graze_distance: float | None = None,
             chatter_tol: float | None = None, count_depth: float = 0.01,
             max_events_per_cycle: int = 1_000_000, max_steps_per_cycle: int = 10_000_000,
             numerics: Numerics | None = None, **old: Any) -> Run:
    """Follow one trajectory.

    Parameters
    ----------
    osc : Oscillator
    start : 'rest', (motion_state, phi, phi_dot), or the `final` of another run: a run of the same
        oscillator is continued bit for bit, under another one a new run begins in that state; one
        beyond a flank by no more than rounding begins on it (decision e of docs/model.md). A new
        run of two degrees of freedom begins with the nominal rotation
    phase : float, mesh phase at the start, 0 <= phase < 1 (not used with a `final`, which has one)
    cycles : float, mesh cycles to run, > 0
    observe : what is recorded, of 'events', 'cycles', 'grazes'; the rest costs nothing
    graze_distance : float, rad; a closest approach nearer than this is logged as a near-graze
        (default 1e-3 of the angle scale, with 'grazes')
    method, rtol, chatter_tol, count_depth, max_events_per_cycle, max_steps_per_cycle :
        see `Numerics`
    numerics : Numerics or None, all of these at once
    **old : record, the old name of observe

    Returns
    -------
    Run: `events`, `cycles`, `final`, `history(taus)`; variables and units: `help(lapwing.Run)`

    Raises
    ------
    TypeError, ValueError
        for a start that contradicts itself and for every refused argument.
    MemoryError
        before any work, where the table of cycles cannot fit.
    """
    arguments.instance("osc", osc, Oscillator)
    observe = renamed(old, "simulate", {"record": ("observe", observe)})[0]
    numerics = chosen(
        numerics, method=(method, "auto"), rtol=(rtol, 1e-10), chatter_tol=(chatter_tol, None),
        count_depth=(count_depth, 0.01),
        max_events_per_cycle=(max_events_per_cycle, 1_000_000),
        max_steps_per_cycle=(max_steps_per_cycle, 10_000_000))
    if isinstance(start, HybridState) and start._blob is not None \
            and not _same(osc, start._oscillator):
        start, phase = (start.motion_state, start.phi, start.phi_dot), start.phase
    observe = arguments.choices("observe", observe, RECORDS)
    cycles = arguments.real("cycles", cycles, above=0.0, low=0.0, high=MAX_INT - 2)
    if "cycles" in observe:
        estimates.require(estimates.sweep_bytes(1, math.ceil(cycles)), "simulate",
                          "cycles, or leave 'cycles' out of observe")
    if isinstance(start, HybridState):
        if start._blob is None:
            raise ValueError("start: this state is no end of a run")
    else:
        phase = arguments.phase("phase", phase)
        start = checked_start(osc, start, phase)
    if graze_distance is None:
        graze_distance = 1e-3 * osc.angle_scale
    else:
        graze_distance = arguments.not_negative("graze_distance", graze_distance)
    wanted = Wanted(events="events" in observe, depths="events" in observe,
                    cycles="cycles" in observe, grazes="grazes" in observe,
                    graze_distance=graze_distance)
    seen = phase == 0
    if isinstance(start, HybridState):
        origin, before, seen = start._origin, start._cycles, start._cycle_seen
        cycle, _ = position(origin[1], before, osc.period)
        call = TrajectoryCall(osc, (engine.GO_ON, 0, 0, 0), start._blob, cycle,
                              numerics=numerics, wanted=wanted)
    else:
        origin, before = (engine_start(osc, start), phase), 0.0
        call = TrajectoryCall(osc, (*origin[0], phase), numerics=numerics, wanted=wanted)
    target = position(origin[1], before + cycles, osc.period)
    passed = start._checkpoints if isinstance(start, HybridState) else ()
    return _moved(osc, call, origin, before + cycles, target, numerics, passed, seen)


def run_from(osc: Oscillator, start: tuple[float, float, float], phase: float,
             target: tuple[int, float], numerics: Numerics, bounces: bool = True) -> Run:
    """A run from where the engine began another, every event, near-graze and cycle kept.

    Parameters
    ----------
    osc : Oscillator
    start : motion state (or `engine.REST`), phi, phi', as the engine had them: nothing is checked
    phase : float, mesh phase at the start
    target : mesh cycle at which it ends, and τ in it
    numerics : Numerics
    bounces : bool, see `Wanted`; those that are summed are no events
    """
    wanted = Wanted(events=True, depths=True, cycles=True, grazes=True, bounces=bounces,
                    graze_distance=1e-3 * osc.angle_scale)
    call = TrajectoryCall(osc, (*start, phase), numerics=numerics, wanted=wanted)
    cycles = target[0] + target[1] / osc.period - phase
    return _moved(osc, call, (start, phase), cycles, target, numerics, (), phase == 0)


def _same(one: Oscillator, other: Oscillator) -> bool:
    """Whether two oscillators are the same in every number."""
    if one is other:
        return True
    plain = [replace(osc, te=one.te) for osc in (one, other)]
    return plain[0] == plain[1] and all(
        np.array_equal(getattr(one.te, name), getattr(other.te, name))
        for name in ("knots", "coefficients", "kinks"))


def _moved(osc: Oscillator, call: TrajectoryCall, origin: tuple[tuple[float, float, float], float],
           cycles: float, target: tuple[int, float], numerics: Numerics, before: Any,
           seen: bool) -> Run:
    """Move a run to its target: what the engine recorded, and the state there.

    `seen` tells whether the cycle in which the run began was followed from its beginning.
    """
    # A target inside a stretch is reported by a sample; one at a cycle's end is reached exactly.
    call.run(target, [target] if target[1] > 0 or osc.degrees_of_freedom == 2 else [])
    phase0, period = origin[1], osc.period
    at = (call.cycle, call.t, call.motion_state, call.phi, call.phi_dot)
    if call.status == Status.OK and (call.cycle, call.t) != target:
        state, phi, phi_dot = call.samples[0]
        at = (*target, int(state), phi, phi_dot)
    final = HybridState(
        motion_state=MotionState(at[2]), phi=float(at[3]), phi_dot=float(at[4]),
        phase=float(at[1] / period), tau=float(tau_of(at[0], at[1], phase0, period)),
        **({} if call.sample_means is None or osc.degrees_of_freedom == 1 else
           {name: float(call.sample_means[name][0]) for name in MEAN}),
        _oscillator=osc, _origin=origin, _cycles=cycles, _blob=call.blob,
        _cycle_seen=bool(at[1] == 0 or (call.watches_cycles and (seen or at[0] != call.begun))),
        _checkpoints=thinned((*before, *call.checkpoints, (call.cycle, call.t, call.blob))))
    return Run(oscillator=osc, final=final, status=call.status, work=call.work,
               method=call.method, _numerics=numerics, _call=call, _first_seen=seen)
