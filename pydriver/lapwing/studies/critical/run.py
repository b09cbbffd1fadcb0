"""Critical values of a parameter, the braking torque first of all, and how sure each is.

`critical_full`: complete engagement; `critical_safe`: no rattling survives; `critical_back`: the
last back impact seen; `critical_on`: a rigid tooth stays on the flank.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lapwing.base import arguments, quantities
from lapwing.base.threads import checked_threads
from lapwing.engine import Numerics, common_method
from lapwing.model.gear_pair import GearPair
from lapwing.model.linear_response import critical_force
from lapwing.model.rigid_contact import LiftOff, lift_off_force
from lapwing.model.transmission_error import TransmissionError
from lapwing.studies.critical.safe import SafeSearch, Trial
from lapwing.studies.critical.starts import StartGrid, follow, start_grid
from lapwing.studies.critical.value import CriticalValue
from lapwing.studies.intervals import bursts, rate_limit
from lapwing.studies.sweep.varied import oscillator_at, parameters

if TYPE_CHECKING:
    from lapwing.model.oscillator import Oscillator

SAFE_ENDS = ("high", "low")
# In these F is linear, and what it is compared with does not depend on them.
TORQUES = ("brake_torque", "drive_torque")
SWEEP_RTOL = 1e-6
# Why no value is found, besides the reasons of `LiftOff`.
RESONANCE = "resonance"

DESCRIPTIONS = {
    "trial_value": (None, "value tried in the search for a critical value"),
    "trial_stage": ("", "why the value was tried"),
    "trial_starts": ("1", "motions followed"),
    "trial_rattling": ("1", "motions that rattle"),
    "trial_failed": ("1", "motions that failed numerically"),
    "trial_cycles": ("1", "mesh cycles examined"),
    "trial_back_cycles": ("1", "mesh cycles with a back impact"),
    "trial_bursts": ("1", "bursts of mesh cycles with a back impact"),
    "trial_rate_bound": ("1", "upper limit of the rate of bursts of back impacts per mesh cycle"),
    "trial_margin": ("rad", "force F above the one needed for contact")}


def critical_full(pair: GearPair, te: TransmissionError, *, parameter: str = "brake_torque",
                  values: ArrayLike | None = None, safe_end: str = "high",
                  **operation: Any) -> CriticalValue:
    """Value from which on the engaged motion keeps contact: F > F_crit.

    Along a torque F is linear and F_crit constant: a closed form, for any transmission error, to
    rounding. Along another parameter `values` is scanned from its safe end to the first at which
    contact is lost, and F = F_crit is solved in that bracket by Brent's method, to rounding.
    Motions beside the engaged one are not looked at: `critical_safe`.

    Parameters
    ----------
    pair : GearPair
    te : TransmissionError
    parameter : str, as for `lapwing.sweep`
    values : array (n,), needed where the parameter is no torque
    safe_end : 'high' or 'low', the end of `values` at which contact is kept
    **operation : the other arguments of `GearPair.oscillator`

    Returns
    -------
    CriticalValue: value, low and high, and `data`, a Dataset
    without variables for a torque, else over `trial`: trial_value and trial_margin
    (F - F_crit, rad). Attributes: find, parameter, outcome ('found', 'safe_throughout',
    'unsafe_throughout', 'resonance': undamped, no engaged response exists), estimate, bar (of the
    parameter; a bar of 0 is rounding), phase (mesh periods, where contact is lost first).

    Raises
    ------
    ValueError
        for refused arguments, the oscillator's own refusals included, the rigid law among them.
    """
    return of_force("full", critical_force, pair, te, parameter, values, safe_end, operation)


def critical_on(pair: GearPair, te: TransmissionError, *, parameter: str = "brake_torque",
                values: ArrayLike | None = None, safe_end: str = "high",
                **operation: Any) -> CriticalValue:
    """Value from which on a rigid tooth rests on the drive flank: F > max g''; `rigid` law only.

    Arguments, result and errors are those of `critical_full`; outcome may also be 'thrown_off' or
    'struck': no value does, because a kink at `phase` throws the tooth off or strikes it.
    """
    return of_force("on", lift_off_force, pair, te, parameter, values, safe_end, operation)


def critical_safe(pair: GearPair, te: TransmissionError, *, parameter: str = "brake_torque",
                  values: ArrayLike, safe_end: str = "high", resolution: float | None = None,
                  starts: StartGrid | None = None, phase: float = 0.0, settle: int = 200,
                  record: int = 50, further: float = 0, numerics: Numerics | None = None,
                  threads: int | None = None, progress: Callable[..., Any] | None = None,
                  **operation: Any) -> CriticalValue:
    """Value above which no rattling survives, from a stated set of starts.

    1. Try the values from the safe end on, each from rest and from a grid of phase, position and
       speed in separation and engagement, until some motion rattles: after `settle` mesh cycles
       one of `record` cycles sees an impact or anything but drive flank engagement.
    2. Halve the bracket between that value and the one before, and nowhere else; motions that
       rattle at its unsafe end are carried besides.
    3. Carry rattling motions, also those found at `further` values beyond, towards the safe end in
       steps of 2·resolution until none survives.

    Parameters
    ----------
    pair, te, parameter, safe_end, **operation : as for `critical_full`
    values : array (n,)
    resolution : float or None, of the parameter; half the widest bracket allowed, default a fifth
        of the least step of `values`
    starts : StartGrid or None
    phase : float, mesh phase of rest and of the first cell of the grid
    settle, record : int, mesh cycles
    further : int, values tried beyond the first that rattles; what rattles there is carried back
        from each value to the next
    numerics : lapwing.engine.Numerics or None
    threads : int or None; no result depends on it
    progress : callable(fraction) or None

    Returns
    -------
    CriticalValue: value, low and high (the bracket left), and `data`, a Dataset
    over `trial`, in the order tried: trial_value, trial_stage (`SearchStage`),
    trial_starts, trial_rattling, trial_failed (numbers of motions; a failed one counts as
    rattling). Attributes: find, parameter, outcome ('found', 'safe_throughout',
    'unsafe_throughout'), rattling and clean (ends of the bracket), estimate (its middle), bar
    (half its width), and the arguments.

    Raises
    ------
    ValueError
        for refused arguments, the oscillator's own refusals included.
    """
    values = _scan_order(values, safe_end)
    settle, record = arguments.whole("settle", settle), arguments.whole("record", record, 1)
    phase = arguments.phase("phase", phase)
    starts, numerics = _checked(
        pair, te, parameter, starts, StartGrid(), numerics, progress)
    further = arguments.whole("further", further)
    if resolution is None:
        steps = np.abs(np.diff(values))
        resolution = float(steps.min()) / 5 if steps.size else 0.0
    # Finer than this, values could no longer be told from each other.
    finest = 4 * float(np.spacing(np.abs(values).max())) if values.size > 1 else 0.0
    resolution = arguments.real("resolution", resolution, low=finest)

    def at(value: float) -> Oscillator:
        return oscillator_at(pair, te, parameter, value, operation)

    search = SafeSearch(at, starts, phase, settle, record, resolution, numerics,
                        checked_threads(threads), progress)
    rattling, clean = search.run(values, further)
    outcome = "safe_throughout" if math.isnan(rattling) else \
        "unsafe_throughout" if math.isnan(clean) else "found"
    return _found(
        "safe", parameter, outcome, 0.5 * (rattling + clean), 0.5 * abs(clean - rattling),
        _trials(search.trials), rattling=rattling, clean=clean, resolution=resolution,
        **_scan(values, safe_end), **_starts(starts, phase, settle, record),
        method=common_method([at(float(value)) for value in values], numerics), rtol=numerics.rtol,
        n_starts=search.trials[0].starts)


def critical_back(pair: GearPair, te: TransmissionError, *, parameter: str = "brake_torque",
                  values: ArrayLike, safe_end: str = "high", starts: StartGrid | None = None,
                  phase: float = 0.0, settle: int = 200, record: int = 1200,
                  confidence: float = 0.95, numerics: Numerics | None = None,
                  threads: int | None = None, progress: Callable[..., Any] | None = None,
                  **operation: Any) -> CriticalValue:
    """Last value at which a back impact was seen, and how far the values beyond it can be trusted.

    Back impacts are rare events of chaotic motions and come in bands: every value is examined, and
    none is called a threshold. Cycles with a back impact come in bursts, which are told apart by
    their gaps (`intervals.bursts`). The rate at which *bursts* begin is bounded from above by the
    exact one-sided Poisson limit χ²(confidence; 2k + 2)/2 over the cycles examined, k bursts seen
    (k = 0 at 95 %: 3.0 over the cycles, the rule of three). How many cycles a burst takes is in no
    bound where none was seen. The limit takes bursts for independent, those of different starts
    included: it says nothing of a motion that only a start outside of the grid leads to, nor of
    bursts further apart than the cycles followed that all starts would share.

    Parameters
    ----------
    pair, te, parameter, safe_end, starts, phase, settle, numerics, threads, progress,
    **operation : as for `critical_safe`; starts defaults to 2 × 2 × 2, with rest 17 motions
    values : array (n,)
    record : int, mesh cycles examined of each motion
    confidence : float, 0.5 to below 1

    Returns
    -------
    CriticalValue: value, low and high (last seen and next clean), and `data`, a Dataset
    over `trial`, from the safe end: trial_value, trial_cycles (examined),
    trial_back_cycles (with a back impact or back engagement), trial_bursts, trial_rate_bound
    (bursts per cycle),
    trial_starts, trial_failed. Attributes: find, parameter, outcome ('found', 'none_seen',
    'unsafe_throughout'), last_seen, first_clean (next to it on the safe side), clean_end (the last
    value scanned there), clean_cycles (examined over all clean values), rate_bound (of the clean
    values, the greatest), estimate (last_seen), bar (distance to first_clean), and the arguments.

    Raises
    ------
    ValueError
        for refused arguments, the oscillator's own refusals included, and `one_flank`.
    """
    values = _scan_order(values, safe_end)
    settle, record = arguments.whole("settle", settle), arguments.whole("record", record, 1)
    phase = arguments.phase("phase", phase)
    starts, numerics = _checked(
        pair, te, parameter, starts, StartGrid(2, 2, 2), numerics, progress)
    confidence = arguments.real("confidence", confidence, low=0.5, below=1.0)
    oscillators = [oscillator_at(pair, te, parameter, float(value), operation) for value in values]
    if oscillators[0].gap == "one_flank":
        raise ValueError("critical: gap = 'one_flank' has no coast flank to strike")
    begun = [start_grid(osc, starts, phase) for osc in oscillators]
    fates = follow([osc for osc, some in zip(oscillators, begun, strict=True) for _ in some],
                   [start for some in begun for start in some], settle, record, numerics=numerics,
                   threads=checked_threads(threads), progress=progress)
    owner = np.repeat(np.arange(values.size), [len(some) for some in begun])
    seen, failed = (np.bincount(owner, column, values.size).astype(int)
                    for column in (fates.back_cycles, fates.failed))
    followed = np.bincount(owner, minlength=values.size)
    cycles = (followed - failed) * record
    ends = np.cumsum(followed)
    burst = np.array([bursts(fates.back_at[end - many:end])
                      for end, many in zip(ends, followed, strict=True)])
    bound = rate_limit(burst, cycles, confidence)
    outcome, estimate, bar = _last_seen(values, seen)
    return _found(
        "back", parameter, outcome, estimate, bar, confidence=confidence,
        variables={"trial_value": values, "trial_starts": followed, "trial_failed": failed,
                   "trial_cycles": cycles, "trial_back_cycles": seen, "trial_bursts": burst,
                   "trial_rate_bound": bound},
        **_clean(values, seen, cycles, bound), **_scan(values, safe_end),
        **_starts(starts, phase, settle, record),
        method=common_method(oscillators, numerics), rtol=numerics.rtol,
        n_starts=int(followed[0]))


def _last_seen(values: NDArray[Any], seen: NDArray[Any]) -> tuple[str, float, float]:
    """Outcome, estimate and bar of a search for back impacts."""
    hits = np.flatnonzero(seen)
    if not hits.size:
        return "none_seen", math.nan, math.nan
    if hits[0] == 0:
        return "unsafe_throughout", float(values[0]), math.nan
    return "found", float(values[hits[0]]), float(abs(values[hits[0] - 1] - values[hits[0]]))


def _clean(values: NDArray[Any], seen: NDArray[Any], cycles: NDArray[Any],
           bound: NDArray[Any]) -> dict[str, Any]:
    """The clean interval next to the safe end."""
    hits = np.flatnonzero(seen)
    n = hits[0] if hits.size else values.size
    return {"last_seen": float(values[n]) if hits.size else math.nan,
            "first_clean": float(values[n - 1]) if n else math.nan,
            "clean_end": float(values[0]), "clean_values": int(n),
            "clean_cycles": int(cycles[:n].sum()),
            "rate_bound": float(bound[:n].max()) if n else math.nan}


def of_force(find: str, criterion: Callable[..., Any], pair: GearPair, te: TransmissionError,
             parameter: str, values: ArrayLike | None, safe_end: str,
             operation: dict[str, Any]) -> CriticalValue:
    """Where F passes what `criterion(osc)` asks for: a force (rad) and a phase, as `CriticalForce`.

    The other arguments and the result are those of `critical_full`.
    """
    _checked_pair(pair, te, parameter)
    arguments.choice("safe_end", safe_end, SAFE_ENDS)

    def at(value: float) -> Oscillator:
        return oscillator_at(pair, te, parameter, value, operation)

    if parameter in TORQUES:
        rest, unit = at(0.0), at(1.0)
        _check_law(find, rest)
        needed = _needed(criterion, rest)
        outcome = needed.reason or "found"
        value = (needed.force - rest.force) / (unit.force - rest.force)
        known = outcome == "found"
        return _found(find, parameter, outcome, value if known else math.nan,
                        0.0 if known else math.nan, phase=needed.phase)
    if values is None:
        raise ValueError(f"critical: parameter = {parameter!r} is no torque; expected are values "
                         "to search")
    order = _scan_order(values, safe_end)
    _check_law(find, at(float(order[0])))
    return _along(find, criterion, at, parameter, order, safe_end)


def _along(find: str, criterion: Callable[..., Any], at: Callable[..., Any], parameter: str,
           values: NDArray[Any], safe_end: str) -> CriticalValue:
    """The first sign change of F minus what is asked for, from the safe end on."""
    from scipy.optimize import brentq

    def margin(value: float) -> float:
        osc = at(float(value))
        return float(osc.force - _needed(criterion, osc).force)

    margins, previous = [], math.nan
    for value in values:
        margins.append(margin(value))
        if not margins[-1] > 0:
            break
        previous = value
    outcome = "safe_throughout" if margins[-1] > 0 else \
        "unsafe_throughout" if math.isnan(previous) else "found"
    estimate, lost = math.nan, _needed(criterion, at(float(values[len(margins) - 1])))
    if lost.reason:
        outcome = lost.reason
    elif outcome == "found":
        estimate = brentq(margin, value, previous, xtol=1e-300, rtol=4 * np.finfo(float).eps)
        lost = _needed(criterion, at(estimate))
    return _found(find, parameter, outcome, estimate, 0.0 if outcome == "found" else math.nan,
                    {"trial_value": values[:len(margins)], "trial_margin": np.array(margins)},
                    phase=lost.phase, **_scan(values, safe_end))


def _needed(criterion: Callable[..., Any], osc: Oscillator) -> LiftOff:
    """Force asked for, as a `LiftOff`; infinite at an undamped resonance, which grows for ever."""
    try:
        return LiftOff(*criterion(osc))
    except ValueError:
        return LiftOff(math.inf, math.nan, RESONANCE)


def _check_law(find: str, osc: Oscillator) -> None:
    if (osc.contact_law == "rigid") != (find == "on"):
        other = "critical_on" if osc.contact_law == "rigid" else "critical_full"
        raise ValueError(f"critical: critical_{find} does not go with contact_law = "
                         f"{osc.contact_law!r}; expected {other}")


def _scan_order(values: ArrayLike, safe_end: str) -> NDArray[Any]:
    """Values, each once, the safe end first."""
    arguments.choice("safe_end", safe_end, SAFE_ENDS)
    values = np.unique(arguments.reals("values", values))
    return values[::-1] if safe_end == "high" else values


def _checked_pair(pair: GearPair, te: TransmissionError, parameter: str) -> None:
    arguments.instance("pair", pair, GearPair)
    arguments.instance("te", te, TransmissionError)
    arguments.choice("parameter", parameter, parameters())


def _checked(pair: GearPair, te: TransmissionError, parameter: str, starts: StartGrid | None,
             default_starts: StartGrid, numerics: Numerics | None,
             progress: Callable[..., Any] | None) -> tuple[StartGrid, Numerics]:
    """Starts and numerics, given or the default, after a look at what else enters."""
    _checked_pair(pair, te, parameter)
    if progress is not None:
        arguments.function("progress", progress)
    return (default_starts if starts is None else arguments.instance("starts", starts, StartGrid),
            Numerics(rtol=SWEEP_RTOL) if numerics is None
            else arguments.instance("numerics", numerics, Numerics))


def _scan(values: NDArray[Any], safe_end: str) -> dict[str, Any]:
    """Attributes that state the grid of values."""
    return {"safe_end": safe_end, "scan_from": float(values[0]), "scan_to": float(values[-1]),
            "scan_values": values.size}


def _starts(starts: StartGrid, phase: float, settle: int, record: int) -> dict[str, Any]:
    """Attributes that state what was followed."""
    return {"start_phases": starts.phases, "start_positions": starts.positions,
            "start_speeds": starts.speeds, "start_phase": phase, "settle": settle,
            "record": record}


def _trials(trials: list[Trial]) -> dict[str, Any]:
    columns = {f"trial_{name}": [getattr(trial, name) for trial in trials]
               for name in Trial._fields}
    return {**columns, "trial_stage": np.array(columns["trial_stage"], dtype=np.int8)}


def _found(find: str, parameter: str, outcome: str, estimate: float, bar: float,
           variables: dict[str, NDArray[Any]] | None = None, **attrs: Any) -> CriticalValue:
    import xarray as xr

    unit = quantities.parameter(parameter).units
    dataset = xr.Dataset(
        {name: ("trial", np.asarray(column)) for name, column in (variables or {}).items()},
        attrs={"find": find, "parameter": parameter, "units": unit, "outcome": outcome,
               "estimate": estimate, "bar": bar, **attrs})
    for name in dataset.data_vars:
        units, long_name = DESCRIPTIONS[str(name)]
        dataset[name].attrs = {"long_name": long_name,
                               "units": unit if units is None else units}
    return CriticalValue.of(dataset)
