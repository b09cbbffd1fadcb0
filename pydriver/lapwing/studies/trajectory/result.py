"""A trajectory that was followed: where it ended, its events, cycles and history."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from lapwing import engine
from lapwing.base import arguments
from lapwing.base.codes import MotionState, Status
from lapwing.base.messages import Shown
from lapwing.base.quantities import worded
from lapwing.engine import TrajectoryCall, Wanted
from lapwing.engine.records import CYCLE, CYCLE_REALS, EVENT, MEAN
from lapwing.model.oscillator import Oscillator
from lapwing.studies.labels import settings
from lapwing.studies.sweep.form import dataset

if TYPE_CHECKING:
    import xarray as xr


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
class Run(Shown):
    """Result of `simulate`.

    Attributes
    ----------
    oscillator : Oscillator
    events, cycles : xarray.Dataset, see below
    final : HybridState
    status : Status; other than OK the run ended early, at `final`
    work : dict, counts of steps, searches and samples
    method : str
    attrs : dict, what was run; attributes of the Datasets, too

    Notes
    -----
    Variables [unit; of codes the enumeration] of `events`; `time` only of an oscillator that was
    made from a gear pair:

    (event): tau, time [s], cycle, phase, kind [EventKind], phi [rad],
    velocity_before [rad per tau], velocity_after [rad per tau], flight_depth [rad]

    Velocities are relative to the flank touched. flight_depth is the greatest depth of the flight
    that an impact or engagement ends; NaN where an event ends none, or one that began while no
    events were observed. `run.events.lapwing.to_csv(path)` writes them into a file. Of `cycles`:

    (cycle): cycle, motion_state [MotionState], phi [rad], phi_dot [rad per tau], impacts,
    back_impacts, counted_impacts, counted_back_impacts, releases, back_releases, engages,
    back_engages, chatter_ends, back_chatter_ends, deepest_separation [rad],
    deepest_back_penetration [rad], states_visited [MotionState], complete
    two degrees of freedom (cycle): mean_angle [rad], mean_rate [rad per tau]

    The state is that at the cycle's beginning; counted impacts by decision l of docs/model.md.
    `complete` is False of a cycle that was not followed from its beginning to its end: the one in
    which the run ended, with what happened up to there, and the one in which it began.
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
    def attrs(self) -> dict[str, Any]:
        """What was run: laws, numbers and operation of the oscillator, start, numerics."""
        (state, *numbers), phase = self.final._origin
        start = "rest" if state == engine.REST else " ".join(
            [MotionState(int(state)).name.lower(), *map(repr, map(float, numbers))])
        return settings(self.oscillator, self._numerics) | {
            "method": self.method, "start": start, "phase": float(phase),
            "cycles": float(self.final._cycles), "status": self.status.name.lower()}

    @cached_property
    def events(self) -> Any:
        """Built when it is first asked for, as `cycles` is."""
        return _event_dataset(self._call.events, self)

    @cached_property
    def cycles(self) -> Any:
        """Statistics of each cycle, also of one in which the run began or ended."""
        return _cycle_dataset(self._call, self)

    def _facts(self) -> dict[str, object]:
        """What tells one from another, in words."""
        complete = self.cycles["complete"].values
        part = f" and {np.sum(~complete)} in part" * (not complete.all())
        return {"status": self.status.name, "tau": f"{self.final.tau:.10g}",
                "events": self.events.sizes["event"], "cycles": f"{complete.sum()}{part}",
                "ends in": self.final.motion_state.name.lower(), "method": self.method}

    @arguments.complete()
    def history(self, taus: NDArray[Any]) -> xr.Dataset:
        """State at given times, from the dense output (fifth order in the step with rk4).

        Parameters
        ----------
        taus : array (n,), τ from 0 to the run's end, rising

        Returns
        -------
        xarray.Dataset; on an event the state after

        (tau): tau, time [s], phase, motion_state [MotionState], phi [rad], phi_dot [rad per tau]
        two degrees of freedom (tau): mean_angle [rad], mean_rate [rad per tau]

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


def tau_of(cycle: Any, t: Any, phase0: float, period: float) -> Any:
    """τ since the start at `phase0`, of times t in mesh cycles; numbers or arrays."""
    return cycle * period + (t - phase0 * period)


def _event_dataset(events: NDArray[Any], run: Run) -> xr.Dataset:
    period = run.oscillator.period
    tau = tau_of(events["cycle"], events["t"], run.final._origin[1], period)
    data = {"tau": tau, "cycle": events["cycle"].astype(np.int64), "phase": events["t"] / period,
            "kind": events["kind"].astype(np.int8)}
    data |= {name: events[name].copy() for name in list(EVENT)[3:]}
    return dataset({name: (("event",), values) for name, values in data.items()},
                   _times("event", tau, run.oscillator), dict(run.attrs))


def _times(dim: str, tau: NDArray[Any], osc: Oscillator) -> dict[str, Any]:
    """The same instants in seconds, where the oscillator knows its units."""
    if osc.scales is None:
        return {}
    return {"time": ((dim,), tau / osc.scales.natural_frequency)}


def _cycle_dataset(call: TrajectoryCall, run: Run) -> xr.Dataset:
    """Cycles from end to end, and the one in which the run ended; the first may lack a part."""
    cycles = np.append(call.cycles, call.unfinished)
    complete = np.arange(len(cycles)) < len(call.cycles)
    complete[:1] &= run._first_seen
    data: dict[str, Any] = {
        name: (("cycle",), cycles[name].copy() if name in CYCLE_REALS
               else cycles[name].astype(np.int64)) for name in CYCLE}
    if call.cycle_means is not None and call.unfinished_means is not None:
        data |= _mean_columns("cycle", np.append(call.cycle_means, call.unfinished_means))
    data["complete"] = (("cycle",), complete)
    return dataset(data, {"cycle": data.pop("cycle")}, dict(run.attrs))


def _mean_columns(dim: str, means: NDArray[Any] | None) -> dict[str, Any]:
    return {name: ((dim,), means[name].copy()) for name in MEAN} if means is not None else {}


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
        coords={"tau": taus, **_times("tau", taus, osc)},
        attrs=run.attrs | {"samples": call.work["samples"] - before}))
