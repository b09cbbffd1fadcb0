"""One operating point looked at closely: history, events, mesh force, energy, error estimates.

W = k'·(r_m1·n_mt)·(d + 2ξ·d') is the force of spring and damper, d the deflection (rad) of the
flank in contact: φ at the drive flank, φ + width at the coast flank, θ + width at a coast flank
that stands still.  Impacts are instants; their impulses per time are a mean force of their own.
Over whole periods  mean W + impulses per time = k'·(r_m1·n_mt)·F,  the averaged equation of motion.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from lapwing import engine
from lapwing.base import arguments, estimates
from lapwing.base.arguments import MAX_INT, Refusals, renamed
from lapwing.base.arrivals import arrivals_of
from lapwing.base.codes import EventKind, MotionState, Status
from lapwing.base.quantities import worded
from lapwing.engine import chosen, columns, impacts_of
from lapwing.engine.records import (
    CYCLE,
    CYCLE_REALS,
    EVENT,
    SAMPLE,
)
from lapwing.model.gear_pair import GearPair
from lapwing.model.oscillator import Oscillator
from lapwing.studies import mean_rotation
from lapwing.studies.intervals import mean_interval
from lapwing.studies.labels import settings
from lapwing.studies.period import LABELS, MAX_PERIOD, find_period, motion_class
from lapwing.studies.response import motion
from lapwing.studies.response.mesh_force import (
    contact_forces,
    deflection,
    flank_motion,
    sample_phases,
)
from lapwing.studies.response.recording import Recording, recorded
from lapwing.studies.trajectory import checked_start, engine_start

if TYPE_CHECKING:
    import xarray as xr

    from lapwing.engine.numerics import Numerics

# Averages over cycles, and largest values over cycles.
MEANS = ("impacts_per_cycle", "back_impacts_per_cycle", "resolved_impacts_per_cycle",
         "resolved_back_impacts_per_cycle", "chatter_ends_per_cycle", "mesh_force_mean",
         "impact_force_mean", "impact_energy_per_cycle", *motion.SHARES)
PEAKS = ("deepest_separation", "deepest_back_penetration", "mesh_force_peak", "impact_speed_max")
TIGHTEST_RTOL = 1e-13
# The difference of two runs is the error of the worse one, less the better one's: a quarter more
# (Roache 1994, J. Fluids Eng. 116, 405-413). Rounding: of the sums of a cycle's arcs.
SAFETY = 1.25
ROUNDING = 64 * float(np.finfo(float).eps)


@arguments.complete(old=("settle_cycles", "record_cycles"))
def response(osc: Oscillator, pair: GearPair, *, name: str = "response", start: Any = "rest",
             phase: float = 0.0, settle: int = 400, record: int = 100, samples_per_cycle: int = 400,
             exponents: bool = False, method: str = "auto", rtol: float = 1e-8,
             max_period: int = MAX_PERIOD, count_depth: float = 0.01,
             chatter_tol: float | None = None, max_events_per_cycle: int = 1_000_000,
             max_steps_per_cycle: int = 10_000_000, order: int = 0,
             numerics: Numerics | None = None, claim_impacts_per_cycle: float | None = None,
             claim_deepest_separation: float | None = None, claim_text: str | None = None,
             **old: Any) -> xr.Dataset:
    """Settle, record, repeat by a second run, and say what is known of each number's error.

    1. Follow the motion over the cycles to settle, recording nothing; whole cycles are recorded,
       so that with a start phase above 0 settling ends with the cycle under way.
    2. Record events, statistics of each cycle and samples in one pass of the engine.
    3. Mesh force: mean by momentum and peak from the known motion of each contact arc
       (`mesh_force`); no sampling enters.
    4. Do the same with rk4 at rtol/100 (1e-13 at least; 100·rtol below 1e-12): `X_change` is the
       difference of the two runs, a change and no interval.
       `X_transient` is the second half of the recorded cycles less the first.
    5. `X_error`, by `error_kind`. 'convergence': of a motion that repeats, 1.25 times the change,
       the transient and rounding together. 'statistical': of any other, half of the 95 % interval
       of an average over cycles (`intervals.mean_interval`); NaN, not known, where the record is
       too short for it and for a largest value, which grows with the record.

    Parameters
    ----------
    osc : Oscillator
    pair : GearPair, the pair `osc` was made from; its units
    name : str, by which figures and summaries speak of it
    start, phase : as for `simulate`, but for the end of another run
    settle, record : int, mesh cycles before recording (>= 0), and recorded (>= 1)
    samples_per_cycle : int, >= 1
    exponents : bool, whether Floquet multipliers and Lyapunov exponents are wanted
    method, rtol, count_depth, chatter_tol, max_events_per_cycle, max_steps_per_cycle :
        see `Numerics`
    numerics : Numerics or None, all of these at once
    max_period, order : int; mesh cycles, and the place among the responses of a deck
    **old : settle_cycles, record_cycles, the old names of settle and record
    claim_* : what a source reports (depth in rad), float, float, str; kept, not judged

    Returns
    -------
    xarray.Dataset, by the dimensions of its variables [unit; of codes the enumeration]:

    (sample): time [s], phase, sample_cycle, motion_state [MotionState], phi [rad],
    phi_dot [rad per tau], mesh_force [N], dynamic_te [rad]
    two degrees of freedom (sample): pinion_angle [rad], gear_angle [rad], pinion_speed [rad/s],
    gear_speed [rad/s]
    (event): event_time [s], event_phase, event_cycle, event_kind [EventKind], event_phi [rad],
    velocity_before [rad per tau], velocity_after [rad per tau], flight_depth [rad],
    impact_energy [J]
    (cycle): cycle_motion_state [MotionState], cycle_phi [rad], cycle_phi_dot [rad per tau],
    cycle_impacts, cycle_back_impacts, cycle_counted_impacts, cycle_counted_back_impacts,
    cycle_releases, cycle_back_releases, cycle_engages, cycle_back_engages, cycle_chatter_ends,
    cycle_back_chatter_ends, cycle_deepest_separation [rad], cycle_deepest_back_penetration [rad],
    cycle_states_visited [MotionState], cycle_mesh_force_mean [N], cycle_mesh_force_peak [N],
    cycle_impact_force_mean [N], cycle_impact_energy [J]
    two degrees of freedom (cycle): cycle_mean_speed [rad/s]

    Times and cycles count from the first recorded cycle. Forces are negative at the coast flank
    (NaN with the rigid law). flight_depth is NaN for what ends no flight, or one that began before
    the last mesh cycle left to settle; impact_energy for what is no impact. The numbers of the
    summary and what was fixed are attributes.  A run that fails numerically has its `status`, no
    events and NaN everywhere else (-1 in whole numbers).

    Raises
    ------
    ValueError
        for every refused argument.
    """
    settle_cycles, record_cycles = renamed(
        old, "response", {"settle_cycles": ("settle", settle), "record_cycles": ("record", record)})
    _check(phase, settle=settle_cycles, record=record_cycles,
           samples_per_cycle=samples_per_cycle, max_period=max_period, order=order)
    settle_cycles, record_cycles, samples_per_cycle, max_period, order = map(
        int, (settle_cycles, record_cycles, samples_per_cycle, max_period, order))
    _check_others(osc, pair, name, exponents, claim_impacts_per_cycle, claim_deepest_separation,
                  claim_text)
    estimates.require(estimates.response_bytes(record_cycles, samples_per_cycle, exponents),
                      "response", "record_cycles or samples_per_cycle")
    start = checked_start(osc, start, phase)
    numerics = chosen(
        numerics, method=(method, "auto"), rtol=(rtol, 1e-8), chatter_tol=(chatter_tol, None),
        count_depth=(count_depth, 0.01),
        max_events_per_cycle=(max_events_per_cycle, 1_000_000),
        max_steps_per_cycle=(max_steps_per_cycle, 10_000_000))
    rtol = numerics.rtol
    grid, stored = sample_phases(osc, samples_per_cycle)
    estimates.require(estimates.response_bytes(record_cycles, grid.size, exponents), "response",
                      "record_cycles: so long a mesh period is sampled more closely than asked for")
    span = (settle_cycles + (phase > 0), record_cycles)
    other = max(rtol / 100, TIGHTEST_RTOL) if rtol >= 10 * TIGHTEST_RTOL else 100 * rtol
    main, reference = (
        _Outcome.of(osc, pair, recorded(osc, (*engine_start(osc, start), phase), span, grid,
                                         one, exponents), max_period)
        for one in (numerics, replace(numerics, method="rk4", rtol=other)))
    given = {
        "name": name, "order": order, "brake_torque": osc.force / pair.force_per_torque
        if osc.brake_torque is None else osc.brake_torque,
        "mesh_period_s": osc.period / pair.natural_frequency,
        "natural_frequency": pair.natural_frequency,
        "method": engine.method_of(osc, numerics),
        "rtol_reference": other, "start_phase": phase,
        "start": start if isinstance(start, str) else " ".join(map(str, start)),
        "settle_cycles": settle_cycles, "record_cycles": record_cycles,
        "first_cycle": span[0], "samples_per_cycle": samples_per_cycle,
        "max_period": max_period,
        "claim_impacts_per_cycle": claim_impacts_per_cycle,
        "claim_deepest_separation": claim_deepest_separation, "claim_text": claim_text}
    return _dataset(osc, pair, main, stored).assign_attrs(
        settings(osc, numerics, pair=pair)
        | {key: value for key, value in given.items() if value is not None}
        | _findings(main, reference)
        | mean_rotation.attributes(osc, main.recording.means[1])
        | motion.impact_attributes(osc, pair, main.recording.events, main.number("mesh_force_peak"))
        | motion.motion_attributes(osc, main.recording, main.period, max_period, numerics))


class Motion(NamedTuple):
    """How a run went and what it led to, in short.

    Attributes
    ----------
    status : Status, None where there was no run
    motion_class : str
    impacts_per_cycle : float
    deepest_separation : float, rad
    """

    status: Status | None
    motion_class: str
    impacts_per_cycle: float
    deepest_separation: float


def motion_of(osc: Oscillator, pair: GearPair, *, start: str, phase: float, settle_cycles: int,
              record_cycles: int, max_period: int, numerics: Numerics) -> Motion:
    """The motion of a response alone: one run, nothing kept. Arguments as of `response`."""
    grid, _ = sample_phases(osc, 8)
    start = checked_start(osc, start, phase)
    recording = recorded(osc, (*engine_start(osc, start), phase),
                         (settle_cycles + (phase > 0), record_cycles), grid, numerics)
    outcome = _Outcome.of(osc, pair, recording, max_period)
    return Motion(recording.status, outcome.motion_class, outcome.number("impacts_per_cycle"),
                  outcome.number("deepest_separation"))


def _check(phase: float, **whole: float) -> None:
    taken = Refusals()
    for key, value in whole.items():
        taken.take(arguments.whole, key, value, int(key not in ("settle", "order")), MAX_INT // 4)
    taken.take(arguments.phase, "phase", phase)
    taken.raise_if_any("response")


def _check_others(osc: Oscillator, pair: GearPair, name: str, exponents: bool,
                  impacts: float | None, separation: float | None, text: str | None) -> None:
    taken = Refusals()
    taken.take(arguments.instance, "osc", osc, Oscillator)
    taken.take(arguments.instance, "pair", pair, GearPair)
    taken.take(arguments.instance, "name", name, str)
    taken.take(arguments.flag, "exponents", exponents)
    for key, claim in (("claim_impacts_per_cycle", impacts),
                       ("claim_deepest_separation", separation)):
        if claim is not None:
            taken.take(arguments.not_negative, key, claim)
    if text is not None:
        taken.take(arguments.instance, "claim_text", text, str)
    taken.raise_if_any("response")


@dataclass(frozen=True)
class _Outcome:
    """A recording, its statistics by cycle (dict of (record,) arrays), period and class."""

    recording: Recording
    by_cycle: dict[str, Any]
    period: int
    motion_class: str

    @classmethod
    def of(cls, osc: Oscillator, pair: GearPair, recording: Recording, max_period: int) -> _Outcome:
        column = recording.cycles
        by_cycle = _by_cycle(osc, pair, recording, column)
        labels = columns(column, LABELS)
        deepest = column["deepest_separation"].max()
        period = find_period(column["phi"], column["phi_dot"], labels,
                             max(abs(osc.force), deepest) or osc.backlash, max_period)
        name = "failed" if recording.status != Status.OK else motion_class(
            period, by_cycle[MEANS[0]], by_cycle[MEANS[1]],
            bool(np.any(by_cycle["chatter_ends_per_cycle"] > 0)))
        return cls(recording, by_cycle, period, name)

    def number(self, key: str, half: int | None = None) -> float:
        """One number of the summary, over all recorded cycles or their first or second half.

        Averages are over as many whole periods as there are (the last ones); each half as well.
        """
        values = self.by_cycle[key]
        window = len(values) if half is None else len(values) // 2
        if self.period and window >= self.period:
            window -= window % self.period
        if window == 0:
            return math.nan
        end = len(values) - window * (half == 0)
        if key in PEAKS:
            return float(np.max(values[end - window if half is not None else 0:end]))
        return float(np.mean(values[end - window:end]))

    def error(self, key: str, change: float) -> float:
        """What is known of a number's error: of one that repeats, or of an average (NaN: nothing).

        `change` is the difference from the other run.
        """
        if not self.period:
            return mean_interval(self.by_cycle[key]).half_width if key in MEANS else math.nan
        size = self.number(key)
        if key == "mesh_force_mean":
            size = np.fmax(abs(size), self.number("mesh_force_peak"))
        counted = key in MEANS[:5]
        return SAFETY * change + abs(self.transient(key)) \
            + (0.0 if counted else ROUNDING * abs(size))

    def transient(self, key: str) -> float:
        """The second half of the record less the first; NaN where it has no two."""
        return self.number(key, 1) - self.number(key, 0)


def _by_cycle(osc: Oscillator, pair: GearPair, recording: Recording,
              column: NDArray[Any]) -> dict[str, NDArray[Any]]:
    """Arrays (record,) of every number whose mean or maximum is summarised."""
    newton = pair.mesh_stiffness * pair.pinion_base_lever
    record = len(recording.cycles)
    mean, peak = contact_forces(osc, recording)
    force, energy = np.zeros(record), np.zeros(record)
    impacts = impacts_of(recording.events)
    cycle = impacts["cycle"].astype(int)
    before, after = impacts["velocity_before"], impacts["velocity_after"]
    np.add.at(force, cycle, newton * (before - after) / osc.period)
    np.add.at(energy, cycle, 0.5 * pair.torsional_stiffness * (before**2 - after**2))
    fastest = motion.fastest_arrivals(recording.events, record, pair.natural_frequency,
                                      osc.contact_law)
    if recording.status != Status.OK:
        force, energy, fastest = force * np.nan, energy * np.nan, fastest * np.nan
    law = arrivals_of(osc.contact_law)
    counts = (law.drive, law.coast, law.every_drive, law.every_coast)
    return {**dict(zip(MEANS[:4], (column[key] for key in counts), strict=True)),
            "chatter_ends_per_cycle": column["chatter_ends"] + column["back_chatter_ends"],
            "mesh_force_mean": newton * mean, "mesh_force_peak": newton * peak,
            "impact_force_mean": force, "impact_energy_per_cycle": energy,
            "deepest_separation": column["deepest_separation"],
            "deepest_back_penetration": column["deepest_back_penetration"],
            "states_visited": column["states_visited"], "impact_speed_max": fastest,
            **motion.shares_of_time(recording.events, column["motion_state"], osc.period)}


def _findings(main: _Outcome, reference: _Outcome) -> dict[str, Any]:
    """The summary's numbers: each with the changes between runs and halves, and its error."""
    status = main.recording.status
    attrs: dict[str, Any] = {
             "status": int(status), "status_meaning": status.name.lower(),
             "status_reference": int(reference.recording.status), "period": main.period,
             "motion_class": main.motion_class, "motion_class_reference": reference.motion_class,
             "error_kind": "convergence" if main.period else "statistical"}
    for key in (*MEANS, *PEAKS):
        attrs[key] = main.number(key)
        attrs[f"{key}_change"] = abs(main.number(key) - reference.number(key))
        attrs[f"{key}_transient"] = main.transient(key)
        attrs[f"{key}_error"] = main.error(key, attrs[f"{key}_change"])
    visited = np.bitwise_or.reduce(main.by_cycle["states_visited"].astype(int)) \
        if status == Status.OK else 0
    return attrs | {"states_visited": int(visited),
                    "fully_engaged": int(visited == 1 << MotionState.ENGAGEMENT)}


def _dataset(osc: Oscillator, pair: GearPair, outcome: _Outcome,
             stored: NDArray[Any]) -> xr.Dataset:
    """Samples, events and cycles in physical units."""
    import xarray as xr

    second = osc.period / pair.natural_frequency
    parts = {"sample": _sample_columns(osc, pair, outcome.recording, stored, second),
             "event": _event_columns(pair, outcome.recording, osc.period, second),
             "cycle": {**_cycle_columns(outcome),
                       **mean_rotation.by_cycle(osc, outcome.recording.means[0])}}
    dataset = xr.Dataset({key: (dim, values) for dim, columns in parts.items()
                          for key, values in columns.items()})
    return worded(dataset.set_coords(("time", "event_time")))


def _sample_columns(osc: Oscillator, pair: GearPair, recording: Recording, stored: NDArray[Any],
                    second: float) -> dict[str, NDArray[Any]]:
    record, failed = len(recording.cycles), recording.status != Status.OK
    phase = np.tile(recording.grid[stored], record)
    cycle = np.repeat(np.arange(record), stored.size)
    rows = recording.samples[:-1].reshape(record, -1)[:, stored].reshape(-1)
    state, phi, phi_dot = (rows[name] for name in SAMPLE)
    g, slope = flank_motion(osc, phase)
    depth, rate = deflection(osc, state, phi, phi_dot, g, slope)
    force = pair.mesh_stiffness * pair.pinion_base_lever * (depth + 2 * osc.damping_ratio * rate)
    force = np.where(state == MotionState.SEPARATION, 0.0, force)
    if osc.contact_law == "rigid":
        force = force * np.nan
    state = np.full(state.size, -1) if failed else state
    means = recording.means[1]
    at = np.add.outer(np.arange(record) * recording.grid.size, stored).ravel()
    return {"time": (cycle + phase) * second, "phase": phase,
            "sample_cycle": cycle.astype(np.int32), "motion_state": state.astype(np.int8),
            "phi": phi, "phi_dot": phi_dot, "mesh_force": force, "dynamic_te": phi + g,
            **mean_rotation.shafts(osc, phi + g, phi_dot + slope,
                                   means if means is None else means[at])}


def _event_columns(pair: GearPair, recording: Recording, period: float,
                   second: float) -> dict[str, NDArray[Any]]:
    log = recording.events
    kind, cycle, t, before, after = (log[name] for name in (
        "kind", "cycle", "t", "velocity_before", "velocity_after"))
    energy = 0.5 * pair.torsional_stiffness * (before**2 - after**2)
    impact = np.isin(kind, (EventKind.IMPACT, EventKind.BACK_IMPACT))
    return {"event_time": (cycle + t / period) * second, "event_phase": t / period,
            "event_cycle": cycle.astype(np.int32), "event_kind": kind.astype(np.int8),
            "event_phi": log["phi"], **{name: log[name].copy() for name in list(EVENT)[4:]},
            "impact_energy": np.where(impact, energy, np.nan)}


def _cycle_columns(outcome: _Outcome) -> dict[str, NDArray[Any]]:
    failed = outcome.recording.status != Status.OK
    columns = {}
    for key in list(CYCLE)[1:]:
        column = outcome.recording.cycles[key]
        whole = np.full(len(column), -1) if failed else column
        columns[f"cycle_{key}"] = column if key in CYCLE_REALS else whole.astype(np.int32)
    for key in ("mesh_force_mean", "mesh_force_peak", "impact_force_mean"):
        columns[f"cycle_{key}"] = outcome.by_cycle[key]
    return {**columns, "cycle_impact_energy": outcome.by_cycle["impact_energy_per_cycle"]}
