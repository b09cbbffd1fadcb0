"""An ensemble: what happens in pairs that are not all alike."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from concurrent.futures import Executor
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from lapwing.base import arguments
from lapwing.base.arguments import MAX_INT, Refusals
from lapwing.base.quantities import CURVE
from lapwing.engine import Numerics
from lapwing.model.draw import (
    FEWEST,
    SAMPLINGS,
    Draw,
    correlation_problem,
    sampling_problems,
)
from lapwing.model.gear_pair import GearPair
from lapwing.model.transmission_error import TransmissionError
from lapwing.studies.ensemble.dataset import dataset_of
from lapwing.studies.ensemble.points import Cloud, drawn, sensitivity_shares, shares_of
from lapwing.studies.ensemble.statistics import Sample
from lapwing.studies.map.cut import shard_size
from lapwing.studies.map.shards import Job, check_settings
from lapwing.studies.map.work import carry_out
from lapwing.studies.sweep.curves import curves_of
from lapwing.studies.sweep.varied import OF_CURVE, parameters

if TYPE_CHECKING:
    import xarray as xr

MOST_RUNS = 10_000_000


@arguments.complete(operation=GearPair.oscillator, varied="draws")
def ensemble(pair: GearPair, te: TransmissionError, draws: Mapping[str, Any], *,
             sampling: str = "sobol", runs: int = 1024, scrambles: int = FEWEST, seed: int = 0,
             correlation: Any = None, sensitivity_draws: int | None = None, settle: int = 400,
             record: int = 100, phase: float = 0.0, numerics: Numerics | None = None,
             shard_runs: int | None = None, folder: str | Path | None = None,
             executor: Executor | None = None, threads: int | None = None,
             progress: Callable[[float], None] | None = None,
             notes: Callable[[str], None] | None = None, keep_interrupted: bool = False,
             **operation: Any) -> xr.Dataset:
    """Run pairs that are drawn, each from rest, and tell what is sure of all.

    Parameters
    ----------
    pair : GearPair
    te : TransmissionError
    draws : mapping of parameter -> `Draw`, each an operating parameter of `GearPair.oscillator`, a
        number of the pair or an amplitude of a harmonic series (`harmonic_amplitude_2`, rad); or of
        parameter -> array (n,), the values of n runs, of which nothing is said beyond them
    sampling : 'sobol', 'latin_hypercube' or 'random'
    runs : int; over scrambles as many in each, with 'sobol' a power of two in each
    scrambles : int, independent ones, 16 or more, from which intervals follow; not with 'random'
    seed : int, which decides all draws
    correlation : array (d, d) or None, of the normal variables behind the draws, in their order
        (a Gaussian copula)
    sensitivity_draws : int or None, a power of two, 16 or more: for Sobol's sensitivities so many
        draws in each of `scrambles` designs of their own, times (d + 2) runs; not with a
        correlation
    settle, record, phase, numerics, shard_runs, folder, executor, threads, progress, notes,
    keep_interrupted : as of `lapwing.parameter_map`
    **operation : the other arguments of `GearPair.oscillator`

    Returns
    -------
    xarray.Dataset, by the dimensions of its variables [unit; of codes the enumeration]:

    (run): status [Status], period, arrivals, back_arrivals, impacts_per_cycle,
    back_impacts_per_cycle, chatter, states_visited [MotionState], deepest_separation [rad],
    deepest_back_penetration [rad], fastest_arrival [rad per tau], full_engagement [N m], scramble
    (level): level, full_engagement_quantile [N m], deepest_separation_quantile [rad],
    impacts_per_cycle_quantile, back_impacts_per_cycle_quantile,
    fastest_arrival_quantile [rad per tau]
    (event): event, probability, seen, known
    (answer, parameter): rank_correlation
    with sensitivity_draws (answer, parameter): main_effect, total_effect
    (parameter): parameter
    (answer): answer

    and over `run` each parameter drawn. Quantiles, probabilities, effects (parts of the variance)
    and rank correlations (Spearman's) have limits beside them, <name>_low and <name>_high, that
    hold the truth in 95 of 100 cases (NaN: not known). full_engagement is T_full in closed form,
    where it is known; the numbers of a run are those of `lapwing.parameter_map`. Attributes say
    what was fixed.

    Raises
    ------
    TypeError, ValueError
        for every refused argument, the oscillators' own refusals included.
    MemoryError
        before any work, where the result cannot fit.
    OSError
        where a shard cannot be written.
    """
    plan = plan_of(pair, te, draws, sampling=sampling, runs=runs, scrambles=scrambles, seed=seed,
                   correlation=correlation, sensitivity_draws=sensitivity_draws, settle=settle,
                   record=record, phase=phase, numerics=numerics, shard_runs=shard_runs,
                   **operation)
    found, interrupted = carry_out("ensemble", plan.job, folder=folder, executor=executor,
                                   threads=threads, progress=progress, notes=notes,
                                   keep_interrupted=keep_interrupted)
    return dataset_of(plan, found, interrupted)


@dataclass(frozen=True, eq=False)
class Plan:
    """An ensemble's runs.

    Attributes
    ----------
    job : Job, all of its runs: those of the draws, then those of the design for sensitivities
    sample : Sample, of the former
    design : Sample, of the latter
    draws : dict of parameter -> Draw; empty where values are listed
    told : dict, attributes of the result that say how it was drawn
    """

    job: Job
    sample: Sample
    design: Sample
    draws: dict[str, Draw]
    told: dict[str, Any]

    @cached_property
    def cloud(self) -> Cloud:
        """The runs' oscillators."""
        assert isinstance(self.job.grid, Cloud)
        return self.job.grid


def plan_of(pair: GearPair, te: TransmissionError, draws: Any, *, sampling: str, runs: int,
            scrambles: int, seed: int, correlation: Any, sensitivity_draws: int | None,
            settle: int, record: int, phase: float, numerics: Numerics | None,
            shard_runs: int | None, **operation: Any) -> Plan:
    """The checked arguments of `ensemble`, or every problem at once."""
    taken = Refusals()
    taken.take(arguments.instance, "pair", pair, GearPair)
    taken.take(arguments.instance, "te", te, TransmissionError)
    given, listed = _draws(draws, te, operation, taken)
    check_settings(taken, settle, record, phase, numerics, shard_runs)
    matrix = _sampling(taken, given, listed, sampling=sampling, runs=runs, scrambles=scrambles,
                       seed=seed, correlation=correlation, sensitivity_draws=sensitivity_draws)
    taken.raise_if_any("ensemble")
    if listed:
        values, extra = listed, 0
        sample = Sample(len(next(iter(listed.values()))), -1)
        told: dict[str, Any] = {"sampling": "table"}
    else:
        values = drawn(given, shares_of(sampling, runs, len(given), scrambles, seed), matrix)
        sample = Sample(int(runs), 0 if sampling == "random" else int(scrambles))
        extra = int(scrambles * (len(given) + 2) * (sensitivity_draws or 0))
        told = {"sampling": sampling, "seed": int(seed)}
        told |= {"correlation": matrix.ravel()} if matrix is not None else {}
    if extra:
        shares = sensitivity_shares(int(sensitivity_draws or 0), len(given), scrambles, seed)
        values = {name: np.concatenate([values[name], more])
                  for name, more in drawn(given, shares).items()}
    cloud = Cloud(pair, curves_of(te), values, "run", operation)
    if cloud.runs > MAX_INT:
        raise ValueError(f"ensemble: {cloud.runs} runs, expected at most {MAX_INT}")
    cloud.check_corners("ensemble")
    size = shard_size(cloud.runs, settle + record, 1, shard_runs)
    job = Job(cloud, "rest", int(settle), int(record), float(phase),
              numerics or Numerics(rtol=1e-6), size)
    return Plan(job, sample, Sample(extra, int(scrambles)), given, told)


def _draws(draws: Any, te: object, operation: dict[str, Any],
           taken: Refusals) -> tuple[dict[str, Draw], dict[str, NDArray[np.float64]]]:
    """The draws, or the values listed; one of the two is empty."""
    if not isinstance(draws, Mapping) or not draws:
        taken.problems.append(arguments.wrong("draws", draws, "{parameter: Draw}, one or more, or "
                                              "{parameter: values}"))
        return {}, {}
    for name in draws:
        if name == CURVE:
            taken.problems.append(f"draws: {CURVE!r} is no number, and curves cannot be drawn or "
                                  "listed: sweep and parameter_map go along them")
            return {}, {}
        taken.take(arguments.choice, "draws", name, parameters(te))
        if operation.get(name) is not None:
            taken.problems.append(arguments.wrong(name, operation[name], "none beside its draw"))
    if set(OF_CURVE) <= set(draws):
        taken.problems.append(f"draws: expected one of {' and '.join(OF_CURVE)}")
    if any(isinstance(one, Draw) for one in draws.values()):
        return {name: taken.take(arguments.instance, f"draws[{name!r}]", one, Draw)
                for name, one in draws.items()}, {}
    listed = {}
    for name, one in draws.items():
        # Draws are not values: a mapping of neither is told so.
        listed[name] = taken.take(arguments.reals, f"draws[{name!r}]", one, ndim=1)
    if len({len(one) for one in listed.values() if one is not None}) > 1:
        taken.problems.append("draws: as many values of each parameter, not " + ", ".join(
            f"{len(one)} of {name}" for name, one in listed.items() if one is not None))
    return {}, listed


def _sampling(taken: Refusals, given: dict[str, Draw], listed: Any, *, sampling: str, runs: int,
              scrambles: int, seed: int, correlation: Any,
              sensitivity_draws: int | None) -> NDArray[np.float64] | None:
    """Check how draws are made; returns the matrix of correlations, or None."""
    known = len(taken.problems)
    taken.take(arguments.choice, "sampling", sampling, SAMPLINGS)
    taken.take(arguments.whole, "runs", runs, 1, MOST_RUNS)
    taken.take(arguments.whole, "scrambles", scrambles, FEWEST, 1000)
    taken.take(arguments.whole, "seed", seed)
    if sensitivity_draws is not None:
        taken.take(arguments.whole, "sensitivity_draws", sensitivity_draws, FEWEST, 2**20)
    matrix = None
    if correlation is not None:
        matrix = taken.take(arguments.reals, "correlation", correlation, ndim=2)
    if listed:
        for name, one in (("correlation", correlation), ("sensitivity_draws", sensitivity_draws)):
            if one is not None:
                taken.problems.append(f"{name} goes with draws, not with values")
        return None
    if len(taken.problems) > known:
        return None
    taken.problems += sampling_problems(sampling, runs, scrambles, sensitivity_draws)
    if matrix is not None:
        if sensitivity_draws is not None:
            taken.problems.append("sensitivity_draws: Sobol's sensitivities are of independent "
                                  "parameters, not with a correlation")
        problem = correlation_problem(matrix, len(given))
        taken.problems += [f"correlation: {problem}"] * bool(problem)
    if sensitivity_draws and scrambles * (len(given) + 2) * sensitivity_draws > MOST_RUNS:
        taken.problems.append(f"sensitivity_draws: more than {MOST_RUNS} runs")
    return matrix


__all__ = ["ensemble"]
