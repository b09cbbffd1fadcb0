"""A parameter swept from rest, upwards and downwards."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from lapwing import engine
from lapwing.base import arguments, estimates
from lapwing.base.arguments import Refusals
from lapwing.base.codes import EventKind, Status
from lapwing.base.quantities import CURVE, NUMBERS, worded
from lapwing.base.threads import checked_threads, usable_threads
from lapwing.engine import Wanted, chosen, numbers, work_counts
from lapwing.engine.records import CLASS, CYCLE, IMPACT_TABLE, OUTCOME_TABLE, STROBED
from lapwing.model.gear_pair import GearPair
from lapwing.model.transmission_error import TransmissionError
from lapwing.studies import mean_rotation
from lapwing.studies.labels import settings
from lapwing.studies.period import NO_PERIOD, class_name
from lapwing.studies.stability import CycleMaps, findings, growth
from lapwing.studies.sweep.curves import curves_of, taken_axes
from lapwing.studies.sweep.form import dataset
from lapwing.studies.sweep.shards import SweepJob
from lapwing.studies.sweep.varied import MOST_KEPT, Varied, parameters

if TYPE_CHECKING:
    import xarray as xr

    from lapwing.engine.numerics import Numerics
    from lapwing.engine.sweeps import SweepResult

STARTS = ("rest", "up", "down")
RECORDS = ("cycles", "impacts", "exponents", "speeds", "spectra", "amplitudes")
# Bins of impact speeds, and how far below the fastest they begin.
SPEED_BINS, SPEED_DECADES = 160, 4


@arguments.complete(operation=GearPair.oscillator, varied="parameter")
def sweep(pair: GearPair, te: TransmissionError, *, parameter: str = "brake_torque",
          values: Any, starts: Sequence[str] | None = None, settle: int = 400,
          record: int = 100, observe: Sequence[str] = ("cycles",), phase: float = 0.0,
          method: str = "auto", rtol: float = 1e-6, chatter_tol: float | None = None,
          count_depth: float = 0.01, max_impacts: int = 2000, max_events_per_cycle: int = 1_000_000,
          max_steps_per_cycle: int = 10_000_000, numerics: Numerics | None = None,
          threads: int | None = None, progress: Callable[[float], None] | None = None,
          keep_interrupted: bool = False, **operation: Any) -> xr.Dataset:
    """Run a range of values of one parameter.

    Parameters
    ----------
    pair : GearPair
    te : TransmissionError
    parameter : str, the parameter swept: an operating parameter of `GearPair.oscillator`, a number
        of the pair itself, 'harmonic_amplitude_2' and its like (rad), the amplitude of that term of
        `TransmissionError.harmonic`, from 1, or 'te', the transmission error itself
    values : array (n,); sorted and without repeats in the result. Of 'te' a mapping of label ->
        TransmissionError, which stand for `te`; the result names them by their labels, in order
    starts : of 'rest' (each value from rest), 'up' and 'down' (each value from where the next
        lower or higher one ended); default: all of them, of 'te', whose values have no order,
        'rest', the only one
    settle, record : int, mesh cycles before recording (>= 0), and recorded (>= 1)
    observe : of 'cycles' (statistics of each recorded cycle), 'impacts' (phase and speed of up to
        `max_impacts` recorded impacts), 'exponents' (Lyapunov exponents of every motion, Floquet
        multipliers of the periodic ones; wants 'cycles'), 'speeds' (impacts of every speed,
        counted in bins), 'spectra' (order spectrum of φ over 48 further cycles) and 'amplitudes'
        (rms and peak to peak of φ and of the dynamic transmission error, mean and peak mesh force
        over a further period, or 32 cycles; wants 'cycles'); the rest costs nothing
    phase : float, mesh phase at the start
    method, rtol, chatter_tol, count_depth, max_events_per_cycle, max_steps_per_cycle :
        see `Numerics`
    numerics : Numerics or None, all of these at once
    threads : int or None; default `threads.default_threads`; no result depends on it, and
        `threads.usable_threads` says how many are begun: one in a process born by fork
    progress : callable(fraction done) or None
    keep_interrupted : bool, whether Ctrl-C returns what is finished (attribute `interrupted`,
        status UNFINISHED) instead of raising KeyboardInterrupt
    **operation : the other arguments of `GearPair.oscillator`

    Returns
    -------
    xarray.Dataset, by the dimensions of its variables [unit; of `codes` the enumeration], of which
    `parameter` is the one swept:

    (start, parameter): status [Status]
    (parameter): force [rad]
    (start, parameter, recorded_cycle): motion_state [MotionState], phi [rad], phi_dot [rad per tau]
    with two degrees of freedom (start, parameter, recorded_cycle): mean_speed [rad/s]
    'cycles' (start, parameter): period, motion_class
    'cycles' (start, parameter, recorded_cycle): impacts, back_impacts, counted_impacts,
    counted_back_impacts, releases, back_releases, engages, back_engages, chatter_ends,
    back_chatter_ends, deepest_separation [rad], deepest_back_penetration [rad],
    states_visited [MotionState]
    'impacts' (start, parameter): first_impact, kept_impacts, n_impacts
    'impacts' (impact): impact_phase, impact_velocity [rad per tau], impact_flank [Flank]
    'exponents' (start, parameter): lyapunov_exponent, lyapunov_exponent_error,
    lyapunov_exponent_effective, lyapunov_exponent_per_cycle, second_lyapunov_exponent,
    tangent_rank, near_grazes, determinant_defect, sum_rule_defect
    'exponents' (start, parameter, multiplier): multiplier_real, multiplier_imag
    'speeds' (start, parameter): slow_impacts
    'speeds' (start, parameter, speed_bin): impact_speed_density
    'speeds' (speed_edge): speed_edge [rad per tau]
    'spectra' (order): order
    'spectra' (start, parameter, order): order_spectrum [rad]
    'spectra' (parameter): mesh_frequency_ratio
    'amplitudes' (start, parameter): phi_rms [rad], phi_peak_to_peak [rad], dynamic_te_rms [rad],
    dynamic_te_peak_to_peak [rad], mesh_force_mean [N], mesh_force_peak [N]
    along 'te' (te): curve_source, curve_sha256, curve_peak_to_peak [rad]

    What each is says its `long_name`; `rad per tau` are rad per unit of τ = natural_frequency · t.
    A point that fails keeps its place, with a `status` other than OK. Impacts are one list over
    `impact`: those of a point are `kept_impacts` from `first_impact` on (`.lapwing.impacts`).
    Attributes say what was fixed: laws, numbers of the pair, torques and speed, numerics.

    Raises
    ------
    TypeError, ValueError
        for every refused argument, the oscillator's own refusals included.
    """
    job = job_of(
        pair, te, parameter=parameter, values=values, starts=starts, settle=settle, record=record,
        observe=observe, phase=phase, method=method, rtol=rtol, chatter_tol=chatter_tol,
        count_depth=count_depth, max_impacts=max_impacts, max_steps_per_cycle=max_steps_per_cycle,
        max_events_per_cycle=max_events_per_cycle, numerics=numerics, progress=progress,
        keep_interrupted=keep_interrupted, **operation)
    threads, count = checked_threads(threads), len(job.values)
    lines = _lines(job.starts, count)
    result = engine.sweep(
        job.oscillators.points.repeated(len(job.starts)), lines,
        np.tile([engine.REST, 0.0, 0.0, job.phase], (len(lines), 1)),
        numerics=job.numerics, wanted=job.wanted, settle=job.settle, record=job.record,
        log_room=job.max_impacts, threads=threads, progress=progress,
        keep_interrupted=keep_interrupted, log_table=IMPACT_TABLE)
    further = job.further(
        result.outcome, np.tile(np.arange(count), len(job.starts)), lambda: None,
        usable_threads(threads, job.grid.runs)) if job.besides else {}
    return dataset_of(job, result, further)


def job_of(pair: GearPair, te: TransmissionError, *, parameter: str, values: Any,
           starts: Sequence[str] | None, settle: int, record: int, observe: Sequence[str],
           phase: float, method: str = "auto", rtol: float = 1e-6, chatter_tol: float | None = None,
           count_depth: float = 0.01, max_impacts: int = 2000,
           max_events_per_cycle: int = 1_000_000, max_steps_per_cycle: int = 10_000_000,
           numerics: Numerics | None = None, progress: Callable[[float], None] | None = None,
           keep_interrupted: bool = False, **operation: Any) -> SweepJob:
    """The checked arguments of `sweep`, or every problem at once."""
    values, curves, starts, observe = _check(
        pair, te, parameter, values, starts, settle, record, observe, max_impacts, phase, progress,
        keep_interrupted)
    numerics = chosen(
        numerics, method=(method, "auto"), rtol=(rtol, 1e-6), chatter_tol=(chatter_tol, None),
        count_depth=(count_depth, 0.01),
        max_events_per_cycle=(max_events_per_cycle, 1_000_000),
        max_steps_per_cycle=(max_steps_per_cycle, 10_000_000))
    wanted = Wanted(cycles="cycles" in observe, strobe=True, impacts="impacts" in observe,
                    tangent="exponents" in observe)
    job = SweepJob(pair, curves, parameter, values, starts, int(settle), int(record),
                   int(max_impacts), float(phase), operation, numerics, wanted,
                   tuple(one for one in ("spectra", "amplitudes") if one in observe))
    estimates.require(
        estimates.sweep_bytes(job.grid.runs, job.record, True, job.wanted.impacts,
                              job.wanted.tangent, job.max_impacts),
        "sweep", "values, starts, record or max_impacts")
    if job.oscillators.shared.gap == "one_flank" and np.any(job.oscillators.points.force < 0):
        raise ValueError("sweep: rest with a negative force needs a coast flank to rest on")
    if "speeds" not in observe:
        return job
    return replace(job, wanted=replace(wanted, speed_edges=tuple(_speed_edges(job.oscillators))))


def dataset_of(job: SweepJob, result: SweepResult,
               further: dict[str, NDArray[Any]]) -> xr.Dataset:
    """What `sweep` returns, from the tables of all points and what they went on for."""
    wanted, oscillators = job.wanted, job.oscillators
    data = _dataset(result, oscillators, job.parameter, job.values, job.starts, wanted, job.phase,
                    _settings(job) | {
                        "method": result.method, "settle": job.settle, "record": job.record,
                        "interrupted": int(result.interrupted),
                        **({"max_impacts": job.max_impacts} if wanted.impacts else {})})
    told = curves_of(job.te).told
    if not further and not wanted.speed_edges and not told:
        return data
    data = data.assign(told)
    by_point, shape = data["status"].dims, data["status"].shape
    data = data.assign({name: ((*by_point, "order")[:1 + values.ndim],
                               values.reshape(*shape, *values.shape[1:]))
                        for name, values in further.items()})
    if "order_spectrum" in further:
        from lapwing.studies.sweep.waterfall import orders

        data = data.assign_coords(order=orders(further["order_spectrum"].shape[1])).assign(
            mesh_frequency_ratio=(by_point[1], [osc.mesh_frequency_ratio for osc in oscillators]))
    return worded(data)


def _settings(job: SweepJob) -> dict[str, Any]:
    """`settings`, kept with the oscillator, which is one pair's."""
    osc, key = job.oscillators.shared, ("settings", job.numerics, job.parameter)
    if key not in osc.kept:
        if len(osc.kept) >= MOST_KEPT:
            osc.kept.clear()
        osc.kept[key] = settings(osc, job.numerics, pair=job.pair, varied=(job.parameter,))
    found: dict[str, Any] = osc.kept[key]
    return found


def _check(pair: GearPair, te: TransmissionError, parameter: str, values: Any,
           starts: Sequence[str] | None, settle: int, record: int, observe: Sequence[str],
           max_impacts: int, phase: float, progress: Callable[[float], None] | None,
           keep_interrupted: bool) -> tuple[NDArray[Any], Any, tuple[str, ...], tuple[str, ...]]:
    """Sorted values, the curves they mean, starts and records, or every problem at once."""
    taken = Refusals()
    taken.take(arguments.instance, "pair", pair, GearPair)
    taken.take(arguments.instance, "te", te, TransmissionError)
    taken.take(arguments.choice, "parameter", parameter, parameters(te, curves=True))
    name = parameter if isinstance(parameter, str) else ""
    axes, curves = taken_axes(taken, te, {name: values}, "values")
    if starts is None:
        starts = STARTS if name != CURVE else ("rest",)
    begun = taken.take(arguments.choices, "starts", starts, STARTS, least=1)
    if name == CURVE and begun and set(begun) - {"rest"}:
        taken.problems.append("starts: nothing is carried along 'te', whose values have no order; "
                              "expected 'rest'")
    observed = taken.take(arguments.choices, "observe", observe, RECORDS)
    for key, given, least in (("settle", settle, 0), ("record", record, 1),
                              ("max_impacts", max_impacts, 1)):
        taken.take(arguments.whole, key, given, least)
    taken.take(arguments.phase, "phase", phase)
    taken.take(arguments.flag, "keep_interrupted", keep_interrupted)
    if progress is not None:
        taken.take(arguments.function, "progress", progress)
    for table in ("exponents", "amplitudes"):
        if observed and table in observed and "cycles" not in observed:
            taken.problems.append(f"observe: {table!r} wants 'cycles' beside it")
    taken.raise_if_any("sweep")
    return axes[parameter], curves, begun, observed


def _lines(starts: tuple[str, ...], n: int) -> NDArray[Any]:
    """Lines of the engine, the long ones first so that they are not waited for."""
    carried, single = list[tuple[int, int, bool]](), list[NDArray[Any]]()
    for block, start in enumerate(starts):
        first, last = block * n, block * n + n - 1
        if start == "up":
            carried.append((first, last, True))
        elif start == "down":
            carried.append((last, first, True))
        else:
            points = np.zeros((n, 3), dtype=int)
            points[:, :2] = np.arange(first, last + 1)[:, None]
            single.append(points)
    if not carried:
        return single[0]
    return np.concatenate([np.array(carried, dtype=int), *single])


def _dataset(result: SweepResult, oscillators: Varied, parameter: str,
             values: NDArray[Any], starts: tuple[str, ...], wanted: Wanted, phase: float,
             attrs: dict[str, Any]) -> xr.Dataset:
    shape = (len(starts), len(values))
    by_point = ("start", parameter)
    outcome = result.outcome.reshape(shape)
    data: dict[str, Any] = {
            "status": (by_point, outcome["status"].astype(np.int8)),
            "force": ((parameter,), oscillators.points.force)}
    tables = result.cycles.reshape(*shape, *result.cycles.shape[1:])
    for name in list(CYCLE)[1:] if wanted.cycles else STROBED:
        data[name] = ((*by_point, "recorded_cycle"), tables[name])
    if wanted.cycles:
        period = np.where(np.isnan(outcome["period"]), NO_PERIOD, outcome["period"])
        data["period"] = (by_point, period.astype(np.int16))
        data["motion_class"] = (by_point, _classes(outcome))
    data |= mean_rotation.by_point(oscillators, result.cycle_means, shape, by_point)
    if wanted.tangent:
        data |= _stability(result, tables, data["period"][1], oscillators, by_point)
    if wanted.impacts:
        data |= _impacts(result, oscillators, shape, by_point)
    work = work_counts(_total(result.outcome["work"]))
    attrs = {**attrs, "phase": phase} | {f"work_{name}": count for name, count in work.items()}
    if wanted.speed_edges:
        data |= _speeds(result, shape, by_point, attrs["record"])
    made = dataset(data, {"start": (("start",), np.array(starts)),
                          parameter: ((parameter,), values)}, attrs)
    if wanted.speed_edges:
        made = made.assign_coords(speed_edge=("speed_edge", list(wanted.speed_edges)))
    return made


# Columns of the outcome that a class follows from.
_IN_OUTCOME = [(OUTCOME_TABLE.names or ()).index(name) for name in ("status", *CLASS)]


def _total(rows: NDArray[Any]) -> NDArray[Any]:
    """Sums of columns, without what is not known."""
    found: NDArray[Any] = rows.sum(axis=0)
    return np.nansum(rows, axis=0) if np.isnan(found).any() else found


def _classes(outcome: Any) -> NDArray[Any]:
    """Class of each point, `period.motion_class`, as array of text."""
    rows = numbers(outcome.reshape(-1))[:, _IN_OUTCOME]
    rows[np.isnan(rows)] = 0
    rows[rows[:, 1] == NO_PERIOD, 2:4] = 0
    # Neighbours mostly move alike.
    first = [0, *(np.flatnonzero((rows[1:] != rows[:-1]).any(axis=1)) + 1).tolist()]
    found = np.array([_class(*row) for row in rows[first].tolist()])
    return np.repeat(found, np.diff([*first, len(rows)])).reshape(outcome.shape)


def _class(status: float, period: float, arrivals: float, back_arrivals: float,
           chatter: float) -> str:
    if status != Status.OK:
        return "unfinished" if status == Status.UNFINISHED else "failed"
    return class_name(int(period), int(arrivals), int(back_arrivals), bool(chatter))


def _stability(result: SweepResult, tables: NDArray[Any], periods: NDArray[Any],
               oscillators: Varied,
               by_point: tuple[str, str]) -> dict[str, Any]:
    """Exponents, multipliers and their checks, `stability.findings`; NaN where a run failed."""
    rows = result.tangent.reshape(*periods.shape, *result.tangent.shape[1:])
    depth = tables["deepest_separation"].max(axis=-1)
    grown = growth(CycleMaps.from_rows(rows, 1.0))
    data = {name: np.full(periods.shape, np.nan) for name in NUMBERS}
    values = np.full((*periods.shape, 2), np.nan, dtype=complex)
    for i, j in np.ndindex(*periods.shape):
        if np.any(np.isnan(numbers(rows[i, j]))):
            continue
        osc = oscillators[j]
        found = findings(CycleMaps.from_rows(rows[i, j], osc.period), osc, int(periods[i, j]),
                         max(abs(osc.force), depth[i, j]) or osc.backlash, grown[i, j])[0]
        values[i, j] = found.pop("multipliers")
        for name, number in found.items():
            data[name][i, j] = number
    dims = (*by_point, "multiplier")
    return {name: (by_point, column) for name, column in data.items()} | {
        "multiplier_real": (dims, values.real), "multiplier_imag": (dims, values.imag)}


def _speed_edges(oscillators: Varied) -> NDArray[Any]:
    """Edges of the bins, rad per τ: up to a speed that hardly any impact exceeds.

    That is the speed of a fall through the gap and twice the flank's fastest, both ways.
    """
    phase, points, shared = np.arange(1000) / 1000, oscillators.points, oscillators.shared
    steepest = np.array([np.abs(te.derivative(1, phase)).max() for te in points.curves])
    fall = points.backlash * (1.0 if shared.gap == "one_sided" else 2.0)
    speeds = np.sqrt(2 * np.abs(points.force) * fall) \
        + 4 * np.abs(points.flank_scale) * steepest[points.curve] \
        / (2 * np.pi / points.mesh_frequency_ratio)
    fastest = float(speeds.max()) or 1.0
    return fastest * np.logspace(-SPEED_DECADES, 0, SPEED_BINS + 1)


def _speeds(result: SweepResult, shape: tuple[int, int], by_point: tuple[str, str],
            record: int) -> dict[str, Any]:
    """Impacts per mesh cycle in each bin, the last one with what is faster; and what is slower."""
    counts = result.density.reshape(*shape, -1) / record
    counts[result.outcome["status"].reshape(shape) != Status.OK] = np.nan
    inside = counts[..., 1:-1].copy()
    inside[..., -1] += counts[..., -1]
    return {"impact_speed_density": ((*by_point, "speed_bin"), inside),
            "slow_impacts": (by_point, counts[..., 0])}


def _impacts(result: SweepResult, oscillators: Varied, shape: tuple[int, int],
             by_point: tuple[str, str]) -> dict[str, Any]:
    """Impact section: mesh phase, velocity relative to the flank, flank; and how many were met.

    One list for all points, a contiguous ragged array: those of a point stand together, the points
    in the order of `kept_impacts`.
    """
    log, kept = result.events, result.kept
    period = np.tile(2 * np.pi / oscillators.points.mesh_frequency_ratio, shape[0])
    met = np.nan_to_num(result.outcome["logged"]).reshape(shape).astype(np.int64)
    flank = np.where(log["kind"] == EventKind.IMPACT, 1, 2).astype(np.int8)
    return {"impact_phase": (("impact",), log["t"] / np.repeat(period, kept)),
            "impact_velocity": (("impact",), log["velocity_before"].copy()),
            "impact_flank": (("impact",), flank),
            "first_impact": (by_point, (np.cumsum(kept) - kept).reshape(shape)),
            "kept_impacts": (by_point, kept.reshape(shape)), "n_impacts": (by_point, met)}
