"""One trajectory: events, history, statistics of each mesh cycle."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from lapwing import engine
from lapwing.base import arguments, estimates
from lapwing.base.arguments import MAX_INT, renamed, shown
from lapwing.base.codes import MotionState, Status
from lapwing.base.messages import facts_html
from lapwing.base.quantities import worded
from lapwing.engine import Numerics, TrajectoryCall, Wanted, chosen, position, thinned
from lapwing.engine.records import CYCLE, CYCLE_REALS, EVENT, MEAN
from lapwing.model.oscillator import Oscillator
from lapwing.model.start import put_on_flank, start_problem

if TYPE_CHECKING:
    import xarray as xr

RECORDS = ("events", "cycles", "grazes")


@dataclass(frozen=True)
class HybridState:
    """Where a run ended, and all that is needed to go on from there bit for bit.

    Attributes
    ----------
    motion_state : MotionState
    phi, phi_dot : float, rad and rad per τ
    phase : float, mesh phase, 0 to 1
    tau : float, time since the run first started
    mean_angle, mean_rate : float, rad and rad per τ; Θ and Θ' with two degrees of freedom, else 0
    """

    motion_state: MotionState
    phi: float
    phi_dot: float
    phase: float
    tau: float
    mean_angle: float = 0.0
    mean_rate: float = 0.0
    # The engine's state may lie up to one step before the point reported above.
    _oscillator: Any = field(repr=False, default=None, compare=False)
    _origin: tuple[Any, ...] = field(repr=False, default=())
    _cycles: float = field(repr=False, default=0.0)
    # Whether the statistics of the cycle under way run since its beginning.
    _cycle_seen: bool = field(repr=False, default=True, compare=False)
    _blob: np.ndarray | None = field(repr=False, default=None, compare=False)
    # (cycle, time in it, blob) of places on the way here from which a history may go on.
    _checkpoints: tuple[Any, ...] = field(repr=False, default=(), compare=False)


@dataclass(repr=False)
class Run:
    """Result of `simulate`.

    Attributes
    ----------
    oscillator : Oscillator
    events : xarray.Dataset over `event`: tau, cycle, phase, kind (EventKind), phi, the velocity
        relative to the flank touched before and after, and flight_depth (rad), the greatest depth
        of the flight that an impact or engagement ends; NaN where an event ends none, or one that
        began while no events were observed
    cycles : xarray.Dataset over `cycle`: state at the cycle's beginning, events by kind and
        flank, deepest separation; counted impacts by decision l of docs/model.md. `complete` is
        False of a cycle that was not followed from its beginning to its end: the one in which the
        run ended, with what happened up to there, and the one in which it began
    final : HybridState
    status : Status; other than OK the run ended early, at `final`
    work : dict, counts of steps, searches and samples
    method : str
    """

    oscillator: Oscillator
    final: HybridState
    status: Status
    work: dict[str, int]
    method: str
    _numerics: Any = field(repr=False, default=None)
    _call: Any = field(repr=False, default=None)
    # Whether the first cycle was followed from its beginning.
    _first_seen: bool = field(repr=False, default=True)

    @cached_property
    def events(self) -> Any:
        """Built when it is first asked for, as `cycles` is."""
        return _event_dataset(self._call.events, self.final._origin[1], self.oscillator.period)

    @cached_property
    def cycles(self) -> Any:
        """Statistics of each cycle, also of one in which the run began or ended."""
        return _cycle_dataset(self._call, self._first_seen)

    def __repr__(self) -> str:
        return f"<Run {', '.join(f'{name}: {fact}' for name, fact in self._facts().items())}>"

    def _repr_html_(self) -> str:
        return facts_html("Run", self._facts())

    def _facts(self) -> dict[str, object]:
        """What tells one from another, in words."""
        complete = self.cycles["complete"].values
        part = f" and {np.sum(~complete)} in part" * (not complete.all())
        return {"status": self.status.name, "tau": f"{self.final.tau:.10g}",
                "events": self.events.sizes["event"], "cycles": f"{complete.sum()}{part}",
                "ends in": self.final.motion_state.name.lower(), "method": self.method}

    def history(self, taus: NDArray[Any]) -> xr.Dataset:
        """State at given times, from the dense output (fifth order in the step with rk4).

        Parameters
        ----------
        taus : array (n,), τ from 0 to the run's end, rising

        Returns
        -------
        xarray.Dataset over `tau`: phase, motion_state, phi, phi_dot; with two degrees of freedom
        mean_angle, mean_rate; on an event the state after

        Raises
        ------
        ValueError
            if times are not rising or outside the run, or hold anything but finite numbers
            (TypeError where it is no number at all).
        """
        taus = arguments.reals("taus", taus, ndim=1, empty=True)
        if np.any(np.diff(taus) < 0):
            raise ValueError("history: taus must be rising")
        end = self.final.tau
        if len(taus) and (taus[0] < 0 or taus[-1] > end * (1 + 4e-16)):
            raise ValueError(f"history: taus must lie between 0 and the run's end, {end:.17g}")
        return _history(self, taus)


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
    Run

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


def engine_start(osc: Oscillator, start: Any) -> tuple[float, float, float]:
    """Start as the engine takes it: motion state (or REST), phi, phi'.

    Raises
    ------
    ValueError
        where a start contradicts its motion state (decisions e and k of docs/model.md).
    """
    expected = "'rest' or (motion_state, phi, phi_dot)"
    if isinstance(start, str):
        if start != "rest":
            raise ValueError(arguments.wrong("start", start, expected))
        if osc.force < 0 and osc.gap == "one_flank":
            raise ValueError("start = 'rest' with a negative force needs a coast flank to rest on")
        return engine.REST, 0.0, 0.0
    if not isinstance(start, tuple | list | np.ndarray) or start is np.ma.masked:
        raise TypeError(arguments.wrong("start", start, expected))
    if (start.shape != (3,) if isinstance(start, np.ndarray) else len(start) != 3):
        raise ValueError(arguments.wrong("start", start, expected))
    motion_state, phi, phi_dot = start
    if isinstance(motion_state, str):
        known = {state.name.lower(): state for state in MotionState}
        motion_state = known.get(motion_state.lower(), motion_state)
    if isinstance(motion_state, str):
        raise ValueError(f"start: {shown(motion_state)} is no motion state, expected one of "
                         f"{', '.join(known)}")
    # Read back from an array of states, a motion state is a float.
    state = arguments.real("start: motion_state", motion_state, low=0, high=max(MotionState))
    if state % 1:
        raise ValueError(f"start: {shown(motion_state)} is no motion state")
    return (state, arguments.real("start: phi", phi), arguments.real("start: phi_dot", phi_dot))


def checked_start(osc: Oscillator, start: Any, phase: float) -> Any:
    """A start that is not refused, as (motion_state, phi, phi_dot), put on its flank, or 'rest'.

    Raises
    ------
    ValueError
        where it lies on the wrong side of a flank by more than rounding.
    """
    numbers = engine_start(osc, start)
    if numbers[0] == engine.REST:
        return start
    state, phi, phi_dot = numbers
    name = MotionState(int(state)).name.lower()
    problem = start_problem(osc, name, phi, phase)
    if problem:
        raise ValueError(f"start: phi = {phi:.6g} contradicts its motion state: {problem}")
    return start[0], put_on_flank(osc, name, phi, phase), phi_dot


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
        phase=float(at[1] / period), tau=float(_tau(at[0], at[1], phase0, period)),
        **({} if call.sample_means is None or osc.degrees_of_freedom == 1 else
           {name: float(call.sample_means[name][0]) for name in MEAN}),
        _oscillator=osc, _origin=origin, _cycles=cycles, _blob=call.blob,
        _cycle_seen=bool(at[1] == 0 or (call.watches_cycles and (seen or at[0] != call.begun))),
        _checkpoints=thinned((*before, *call.checkpoints, (call.cycle, call.t, call.blob))))
    return Run(oscillator=osc, final=final, status=call.status, work=call.work,
               method=call.method, _numerics=numerics, _call=call, _first_seen=seen)


def _tau(cycle: Any, t: Any, phase0: float, period: float) -> Any:
    return cycle * period + (t - phase0 * period)


def _event_dataset(events: NDArray[Any], phase0: float, period: float) -> xr.Dataset:
    import xarray as xr

    tau = _tau(events["cycle"], events["t"], phase0, period)
    data = {"tau": tau, "cycle": events["cycle"].astype(np.int64), "phase": events["t"] / period,
            "kind": events["kind"].astype(np.int8)}
    data |= {name: events[name].copy() for name in list(EVENT)[3:]}
    return worded(xr.Dataset({name: ("event", values) for name, values in data.items()}))


def _cycle_dataset(call: TrajectoryCall, first_seen: bool) -> xr.Dataset:
    """Cycles from end to end, and the one in which the run ended; the first may lack a part."""
    import xarray as xr

    cycles = np.append(call.cycles, call.unfinished)
    complete = np.arange(len(cycles)) < len(call.cycles)
    complete[:1] &= first_seen
    data = {name: ("cycle", cycles[name].copy() if name in CYCLE_REALS
                   else cycles[name].astype(np.int64)) for name in CYCLE}
    if call.cycle_means is not None and call.unfinished_means is not None:
        data |= _mean_columns("cycle", np.append(call.cycle_means, call.unfinished_means))
    data["complete"] = ("cycle", complete)
    return worded(xr.Dataset(data).set_coords("cycle"))


def _mean_columns(dim: str, means: NDArray[Any] | None) -> dict[str, Any]:
    return {name: (dim, means[name].copy()) for name in MEAN} if means is not None else {}


def _history(run: Run, taus: NDArray[Any]) -> xr.Dataset:
    import xarray as xr

    osc, (start, phase0) = run.oscillator, run.final._origin
    cycle, t = np.divmod(taus + phase0 * osc.period, osc.period)
    times = [(int(number), float(time)) for number, time in zip(cycle, t, strict=True)]
    first, last = (times[0], times[-1]) if times else ((0, phase0 * osc.period),) * 2
    # A sample on a checkpoint itself is taken on the way to it: events may lie there.
    passed = [place for place in run.final._checkpoints if place[:2] < first]
    if passed:
        begin, blob, cycle_begun = (engine.GO_ON, 0, 0, 0), passed[-1][2], passed[-1][0]
    else:
        begin, blob, cycle_begun = (*start, phase0), None, 0
    call = TrajectoryCall(osc, begin, blob, cycle_begun, numerics=run._numerics, wanted=Wanted())
    before = call.work["samples"]
    call.run(last, times)
    samples = call.samples
    return worded(xr.Dataset(
        {"phase": ("tau", t / osc.period),
         "motion_state": ("tau", samples["motion_state"].astype(np.int8)),
         "phi": ("tau", samples["phi"].copy()), "phi_dot": ("tau", samples["phi_dot"].copy()),
         **_mean_columns("tau", call.sample_means)},
        coords={"tau": taus},
        attrs={"samples": call.work["samples"] - before}))


__all__ = ["HybridState", "Run", "simulate"]
