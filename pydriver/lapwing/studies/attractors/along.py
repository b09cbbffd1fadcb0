"""Attractors along a parameter, each with its number as long as it can be continued."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np

from lapwing.base import arguments, estimates
from lapwing.base.arguments import Refusals
from lapwing.engine import Numerics
from lapwing.model.gear_pair import GearPair
from lapwing.model.transmission_error import TransmissionError
from lapwing.studies.attractors.continued import (
    ENTRY_BYTES,
    AtValue,
    at_value,
    dataset_along,
)
from lapwing.studies.attractors.dataset import rules
from lapwing.studies.attractors.run import RUN_BYTES, search_of
from lapwing.studies.attractors.starts import (
    MOST_STARTS,
    Starts,
    checked_spans,
    drawn_starts,
    ranges,
    start_problems,
)
from lapwing.studies.labels import settings
from lapwing.studies.sweep.varied import oscillator_at, parameters

if TYPE_CHECKING:
    import xarray as xr

    from lapwing.model.oscillator import Oscillator


@arguments.complete(operation=GearPair.oscillator, varied="parameter")
def attractors_along(pair: GearPair, te: TransmissionError, *, values: Any,
                     parameter: str = "brake_torque", runs: int = 256, seed: int = 0,
                     phi: Any = None, phi_dot: Any = None, phase: float = 0.0,
                     most_cycles: int = 1000, returns: int = 30, recurrences: int = 50,
                     resolution: int = 256, numerics: Numerics | None = None,
                     threads: int | None = None,
                     progress: Callable[[float], None] | None = None,
                     keep_interrupted: bool = False, **operation: Any) -> xr.Dataset:
    """Tell in what random starts end along a parameter, and follow the attractors along it.

    How they are followed: `lapwing.studies.attractors.continued`.

    Parameters
    ----------
    pair : GearPair
    te : TransmissionError
    values : array (n,), of the parameter; sorted and without repeats in the result
    parameter : str, an operating parameter of `GearPair.oscillator` or a number of the pair
    runs : int, random starts at each value
    seed : int, which decides them
    phi, phi_dot : (low, high) or None, over which they are spread; default: at each value as of
        `lapwing.attractors`
    phase, most_cycles, returns, recurrences, resolution, numerics, threads : as of
        `lapwing.attractors`
    progress : callable(fraction done) or None
    keep_interrupted : bool, whether Ctrl-C returns what is finished (attribute `interrupted`, the
        rest with `reached` 0) instead of raising KeyboardInterrupt
    **operation : the other arguments of `GearPair.oscillator`

    Returns
    -------
    xarray.Dataset, by the dimensions of its variables [unit; of codes the enumeration]:

    (parameter): reached, unresolved, failed, presumed
    (attractor): attractor
    (parameter, attractor): period, arrivals, back_arrivals, impacts_per_cycle,
    back_impacts_per_cycle, chatter, states_visited [MotionState], deepest_separation [rad],
    deepest_back_penetration [rad], fastest_arrival [rad per tau], motion_class, lyapunov_exponent,
    lyapunov_exponent_error, residual, runs_ended, share
    (parameter, attractor, multiplier): multiplier_real, multiplier_imag
    (parameter, attractor, point): point_motion_state [MotionState], point_phi [rad],
    point_phi_dot [rad per tau]

    The first dimension has the parameter's name. Attractors are numbered in the order in which they
    are met; where one was not found its period is -1 and its numbers are NaN. runs_ended is 0 where
    the continued motion alone led to it. All else as of `lapwing.attractors`.

    Raises
    ------
    TypeError, ValueError
        for every refused argument, the oscillators' own refusals included.
    MemoryError
        before any work, where the result cannot fit.
    """
    taken = Refusals()
    taken.take(arguments.instance, "pair", pair, GearPair)
    taken.take(arguments.instance, "te", te, TransmissionError)
    taken.take(arguments.choice, "parameter", parameter, parameters(te))
    numbers = taken.take(arguments.reals, "values", values, ndim=1)
    for name, value, most in (("runs", runs, MOST_STARTS), ("seed", seed, 2**31 - 2)):
        taken.take(arguments.whole, name, value, int(name == "runs"), most)
    taken.take(arguments.phase, "phase", phase)
    taken.take(arguments.flag, "keep_interrupted", keep_interrupted)
    spans = checked_spans(taken, phi=phi, phi_dot=phi_dot)
    if progress is not None:
        taken.take(arguments.function, "progress", progress)
    given: dict[str, Any] = {"most_cycles": most_cycles, "returns": returns,
                             "recurrences": recurrences, "resolution": resolution,
                             "numerics": numerics, "threads": threads}
    search_of(None, **given, taken=taken)
    taken.raise_if_any("attractors_along")
    numbers = np.unique(numbers)

    def make(value: float) -> Oscillator:
        return oscillator_at(pair, te, parameter, value, operation)

    def starts(osc: Oscillator, at: int) -> Starts:
        own = ranges(osc, phase) | spans
        number = int(np.random.SeedSequence([seed, at]).generate_state(1)[0])
        return drawn_starts(osc, "random", int(runs), 1, number, **own, phase=float(phase))

    for value in (numbers[-1], numbers[0]):
        osc = make(float(value))
        search = search_of(osc, **given, taken=taken)
        taken.problems += start_problems(osc, starts(osc, 0).rows)
    taken.raise_if_any("attractors_along")
    estimates.require(runs * RUN_BYTES + len(numbers) * ENTRY_BYTES, "attractors_along",
                      "runs or the number of values")
    found: list[AtValue] = []
    interrupted = False
    try:
        for i, value in enumerate(numbers):
            search = search_of(make(float(value)), **given, taken=taken)
            found.append(at_value(search, float(value), make, found[-1] if found else None,
                                  starts(search.osc, i)))
            if progress is not None:
                progress((i + 1) / len(numbers))
    except KeyboardInterrupt:
        if not keep_interrupted:
            raise
        interrupted = True
    return dataset_along(parameter, numbers, found, {
        **settings(osc, search.numerics, pair=pair, varied=(parameter,)), **rules(search),
        "starts": "random", "seed": int(seed), "runs": int(runs), "phase": float(phase),
        **{f"{name}_range": np.array(span) for name, span in spans.items()},
        "interrupted": int(interrupted)})


__all__ = ["attractors_along"]
