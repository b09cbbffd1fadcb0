"""Critical values from motions that are followed, and how sure each is.

`critical_safe`: no rattling survives; `critical_back`: the last back impact seen. By a balance of
forces alone: `critical.force`.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lapwing.base import arguments
from lapwing.base.threads import checked_threads
from lapwing.engine import Numerics, common_method
from lapwing.model.gear_pair import GearPair
from lapwing.model.transmission_error import TransmissionError
from lapwing.studies.critical.checks import (
    checked,
    scan_attributes,
    scan_order,
    start_attributes,
)
from lapwing.studies.critical.safe import SafeSearch, Trial
from lapwing.studies.critical.starts import StartGrid, follow, start_grid
from lapwing.studies.critical.value import CriticalValue, found
from lapwing.studies.intervals import bursts, rate_limit
from lapwing.studies.labels import settings
from lapwing.studies.sweep.varied import oscillator_at

if TYPE_CHECKING:
    from lapwing.model.oscillator import Oscillator
    from lapwing.studies.critical.records import Records


@arguments.complete(operation=GearPair.oscillator, varied="parameter")
def critical_safe(pair: GearPair, te: TransmissionError, *, parameter: str = "brake_torque",
                  values: ArrayLike, safe_end: str = "high", resolution: float | None = None,
                  starts: StartGrid | None = None, phase: float = 0.0, settle: int = 200,
                  record: int = 50, further: float = 0, numerics: Numerics | None = None,
                  threads: int | None = None, progress: Callable[..., Any] | None = None,
                  records: Records | None = None, **operation: Any) -> CriticalValue:
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
    records : Records or None (studies.critical.records), where each trial is kept for a later call

    Returns
    -------
    CriticalValue: value, low and high (the bracket left), `why` there is none, and `data`, a
    Dataset in the order tried, `parameter` being the unit of the parameter:

    (trial): trial_value [parameter], trial_stage [SearchStage], trial_starts, trial_rattling,
    trial_failed

    The last three are numbers of motions; a failed one counts as rattling. Attributes: find,
    parameter, outcome ('found', 'safe_throughout', 'unsafe_throughout'), rattling and clean (ends
    of the bracket), estimate (its middle), bar (half its width), and what was fixed.

    Raises
    ------
    ValueError
        for refused arguments, the oscillator's own refusals included.
    """
    values = scan_order(values, safe_end)
    settle, record = arguments.whole("settle", settle), arguments.whole("record", record, 1)
    phase = arguments.phase("phase", phase)
    starts, numerics = checked(
        pair, te, parameter, starts, StartGrid(), numerics, progress)
    further = arguments.whole("further", further)
    if resolution is None:
        resolution = float(np.abs(np.diff(values)).min()) / 5 if values.size > 1 else 0.0
    # Finer than this, values could no longer be told from each other.
    finest = 4 * float(np.spacing(np.abs(values).max())) if values.size > 1 else 0.0
    resolution = arguments.real("resolution", resolution, low=finest)

    def at(value: float) -> Oscillator:
        return oscillator_at(pair, te, parameter, value, operation)

    search = SafeSearch(at, starts, phase, settle, record, resolution, numerics,
                        checked_threads(threads), progress, records)
    rattling, clean = search.run(values, further)
    outcome = "safe_throughout" if math.isnan(rattling) else \
        "unsafe_throughout" if math.isnan(clean) else "found"
    return found(
        settings(at(float(values[0])), numerics, pair=pair, varied=(parameter,)),
        "safe", parameter, outcome, 0.5 * (rattling + clean), 0.5 * abs(clean - rattling),
        _trials(search.trials), rattling=rattling, clean=clean, resolution=resolution,
        **scan_attributes(values, safe_end), **start_attributes(starts, phase, settle, record),
        method=common_method([at(float(value)) for value in values], numerics),
        n_starts=search.trials[0].starts)


@arguments.complete(operation=GearPair.oscillator, varied="parameter")
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
    CriticalValue: value, low and high (last seen and next clean), `why` there is none, and `data`,
    a Dataset from the safe end on, `parameter` being the unit of the parameter:

    (trial): trial_value [parameter], trial_starts, trial_failed, trial_cycles, trial_back_cycles,
    trial_bursts, trial_rate_bound

    Numbers of motions, of mesh cycles examined, of those with a back impact or back engagement, of
    their bursts; bursts per cycle. Attributes: find, parameter, outcome ('found', 'none_seen',
    'unsafe_throughout'), last_seen, first_clean (next to it on the safe side), clean_end (the last
    value scanned there), clean_cycles (examined over all clean values), rate_bound (of the clean
    values, the greatest), estimate (last_seen), bar (distance to first_clean), and what was fixed.

    Raises
    ------
    ValueError
        for refused arguments, the oscillator's own refusals included, and `one_flank`.
    """
    values = scan_order(values, safe_end)
    settle, record = arguments.whole("settle", settle), arguments.whole("record", record, 1)
    phase = arguments.phase("phase", phase)
    starts, numerics = checked(
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
    return found(
        settings(oscillators[0], numerics, pair=pair, varied=(parameter,)),
        "back", parameter, outcome, estimate, bar, confidence=confidence,
        variables={"trial_value": values, "trial_starts": followed, "trial_failed": failed,
                   "trial_cycles": cycles, "trial_back_cycles": seen, "trial_bursts": burst,
                   "trial_rate_bound": bound},
        **_clean(values, seen, cycles, bound), **scan_attributes(values, safe_end),
        **start_attributes(starts, phase, settle, record),
        method=common_method(oscillators, numerics),
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


def _trials(trials: list[Trial]) -> dict[str, Any]:
    columns = {f"trial_{name}": [getattr(trial, name) for trial in trials]
               for name in Trial._fields}
    return {**columns, "trial_stage": np.array(columns["trial_stage"], dtype=np.int8)}
