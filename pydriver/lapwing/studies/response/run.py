"""One operating point looked at closely: history, events, mesh force, energy, error estimates.

W = k'·(r_m1·n_mt)·(d + 2ξ·d') is the force of spring and damper, d the deflection (rad) of the
flank in contact: φ at the drive flank, φ + width at the coast flank, θ + width at a coast flank
that stands still.  Impacts are instants; their impulses per time are a mean force of their own.
Over whole periods  mean W + impulses per time = k'·(r_m1·n_mt)·F,  the averaged equation of motion.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from lapwing import engine
from lapwing.base import arguments, estimates
from lapwing.base.arguments import MAX_INT, Refusals, renamed
from lapwing.base.codes import EventKind, MotionState, Status
from lapwing.base.quantities import worded
from lapwing.engine import chosen
from lapwing.engine.records import CYCLE, CYCLE_REALS, EVENT, SAMPLE
from lapwing.model.gear_pair import GearPair
from lapwing.model.oscillator import Oscillator
from lapwing.studies import mean_rotation
from lapwing.studies.labels import settings
from lapwing.studies.period import MAX_PERIOD
from lapwing.studies.response import motion
from lapwing.studies.response.evaluation import Evaluation, findings
from lapwing.studies.response.mesh_force import deflection, flank_motion, sample_phases
from lapwing.studies.response.recording import Pass, Recording
from lapwing.studies.trajectory import checked_start, engine_start

if TYPE_CHECKING:
    import xarray as xr

    from lapwing.engine.numerics import Numerics

TIGHTEST_RTOL = 1e-13

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
    settle, record = renamed(
        old, "response", {"settle_cycles": ("settle", settle), "record_cycles": ("record", record)})
    made = prepared(
        osc, pair, name=name, start=start, phase=phase, settle=settle, record=record,
        samples_per_cycle=samples_per_cycle, exponents=exponents, max_period=max_period,
        order=order, numerics=numerics, method=method, rtol=rtol, chatter_tol=chatter_tol,
        count_depth=count_depth, max_events_per_cycle=max_events_per_cycle,
        max_steps_per_cycle=max_steps_per_cycle, claim_impacts_per_cycle=claim_impacts_per_cycle,
        claim_deepest_separation=claim_deepest_separation, claim_text=claim_text)
    return dataset_of(made, (one.whole() for one in made.passes))


@dataclass(frozen=True)
class Prepared:
    """The checked arguments of `response`.

    Attributes
    ----------
    osc : Oscillator
    pair : GearPair
    numerics : Numerics
    passes : Pass, Pass; of the response, and of the run that judges its numbers
    stored : array, which of the phases sampled are stored
    given : dict of attributes
    """

    osc: Oscillator
    pair: GearPair
    numerics: Numerics
    passes: tuple[Pass, Pass]
    stored: NDArray[Any]
    given: dict[str, Any]


def prepared(osc: Oscillator, pair: GearPair, *, name: str, start: Any, phase: float, settle: int,
             record: int, samples_per_cycle: int, exponents: bool, max_period: int = MAX_PERIOD,
             order: int = 0, numerics: Numerics | None = None, method: str = "auto",
             rtol: float = 1e-8, chatter_tol: float | None = None, count_depth: float = 0.01,
             max_events_per_cycle: int = 1_000_000, max_steps_per_cycle: int = 10_000_000,
             claim_impacts_per_cycle: float | None = None,
             claim_deepest_separation: float | None = None,
             claim_text: str | None = None) -> Prepared:
    """The checked arguments of `response`, which says what is refused."""
    _check(phase, settle=settle, record=record, samples_per_cycle=samples_per_cycle,
           max_period=max_period, order=order)
    settle, record, samples_per_cycle, max_period, order = map(
        int, (settle, record, samples_per_cycle, max_period, order))
    _check_others(osc, pair, name, exponents, claim_impacts_per_cycle, claim_deepest_separation,
                  claim_text)
    estimates.require(estimates.response_bytes(record, samples_per_cycle, exponents),
                      "response", "record_cycles or samples_per_cycle")
    start = checked_start(osc, start, phase)
    numerics = chosen(
        numerics, method=(method, "auto"), rtol=(rtol, 1e-8), chatter_tol=(chatter_tol, None),
        count_depth=(count_depth, 0.01),
        max_events_per_cycle=(max_events_per_cycle, 1_000_000),
        max_steps_per_cycle=(max_steps_per_cycle, 10_000_000))
    rtol = numerics.rtol
    grid, stored = sample_phases(osc, samples_per_cycle)
    estimates.require(estimates.response_bytes(record, grid.size, exponents), "response",
                      "record_cycles: so long a mesh period is sampled more closely than asked for")
    span = (settle + (phase > 0), record)
    other = max(rtol / 100, TIGHTEST_RTOL) if rtol >= 10 * TIGHTEST_RTOL else 100 * rtol
    main, reference = (Pass(osc, (*engine_start(osc, start), phase), span, grid, one, exponents)
                       for one in (numerics, replace(numerics, method="rk4", rtol=other)))
    given = {
        "name": name, "order": order, "brake_torque": osc.force / pair.force_per_torque
        if osc.brake_torque is None else osc.brake_torque,
        "mesh_period_s": osc.period / pair.natural_frequency,
        "natural_frequency": pair.natural_frequency,
        "method": engine.method_of(osc, numerics),
        "rtol_reference": other, "start_phase": phase,
        "start": start if isinstance(start, str) else " ".join(map(str, start)),
        "settle_cycles": settle, "record_cycles": record,
        "first_cycle": span[0], "samples_per_cycle": samples_per_cycle,
        "max_period": max_period,
        "claim_impacts_per_cycle": claim_impacts_per_cycle,
        "claim_deepest_separation": claim_deepest_separation, "claim_text": claim_text}
    return Prepared(osc, pair, numerics, (main, reference), stored, given)


def dataset_of(made: Prepared, recordings: Iterable[Recording]) -> xr.Dataset:
    """What `response` returns, from the recordings of both passes."""
    osc, pair, max_period = made.osc, made.pair, made.given["max_period"]
    main, reference = (Evaluation.of(osc, pair, one, max_period) for one in recordings)
    return _dataset(osc, pair, main, made.stored).assign_attrs(
        settings(osc, made.numerics, pair=pair)
        | {key: value for key, value in made.given.items() if value is not None}
        | findings(main, reference)
        | mean_rotation.attributes(osc, main.recording.means[1])
        | motion.impact_attributes(osc, pair, main.recording.events, main.number("mesh_force_peak"))
        | motion.motion_attributes(osc, main.recording, main.period, max_period, made.numerics))


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


def _dataset(osc: Oscillator, pair: GearPair, found: Evaluation,
             stored: NDArray[Any]) -> xr.Dataset:
    """Samples, events and cycles in physical units."""
    import xarray as xr

    second = osc.period / pair.natural_frequency
    parts = {"sample": _sample_columns(osc, pair, found.recording, stored, second),
             "event": _event_columns(pair, found.recording, osc.period, second),
             "cycle": {**_cycle_columns(found),
                       **mean_rotation.by_cycle(osc, found.recording.means[0])}}
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


def _cycle_columns(found: Evaluation) -> dict[str, NDArray[Any]]:
    failed = found.recording.status != Status.OK
    columns = {}
    for key in list(CYCLE)[1:]:
        column = found.recording.cycles[key]
        whole = np.full(len(column), -1) if failed else column
        columns[f"cycle_{key}"] = column if key in CYCLE_REALS else whole.astype(np.int32)
    for key in ("mesh_force_mean", "mesh_force_peak", "impact_force_mean"):
        columns[f"cycle_{key}"] = found.by_cycle[key]
    return {**columns, "cycle_impact_energy": found.by_cycle["impact_energy_per_cycle"]}
