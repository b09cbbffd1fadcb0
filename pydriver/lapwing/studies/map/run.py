"""A map: what happens at every crossing point of two or more axes."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor
from pathlib import Path
from typing import TYPE_CHECKING, Any

from lapwing.base import arguments, estimates
from lapwing.base.arguments import MAX_INT, Refusals
from lapwing.base.quantities import CURVE, OBSERVED, curve_clash, worded
from lapwing.engine import Numerics
from lapwing.model.gear_pair import GearPair
from lapwing.model.transmission_error import TransmissionError
from lapwing.studies.map.cut import shard_size, shared_size
from lapwing.studies.map.grid import Grid, fastest_axis
from lapwing.studies.map.opened import left_in
from lapwing.studies.map.shards import Job, check_settings
from lapwing.studies.map.work import Noted, carry_out, gather, numbers_of
from lapwing.studies.sweep.curves import curves_of, taken_axes
from lapwing.studies.sweep.varied import TORQUES, parameters

if TYPE_CHECKING:
    import xarray as xr

STARTS = ("rest", "up", "down")


@arguments.complete(operation=GearPair.oscillator, varied="axes")
def parameter_map(pair: GearPair, te: TransmissionError, axes: Mapping[str, Any], *,
                  line: str | None = None, start: str = "rest", settle: int = 400,
                  record: int = 100, phase: float = 0.0, numerics: Numerics | None = None,
                  observe: Sequence[str] = (), shard_runs: int | None = None,
                  folder: str | Path | None = None,
                  executor: Executor | None = None, threads: int | None = None,
                  progress: Callable[[float], None] | None = None,
                  notes: Callable[[str], None] | None = None, keep_interrupted: bool = False,
                  **operation: Any) -> xr.Dataset:
    """Run every combination of the values of some parameters.

    Parameters
    ----------
    pair : GearPair
    te : TransmissionError
    axes : mapping of parameter -> array (n,) of values, two or more, each an operating parameter of
        `GearPair.oscillator`, a number of the pair, or the amplitude of a term of a harmonic series
        (`harmonic_amplitude_2`, rad; terms count from 1); sorted and without repeats in the result.
        Or `te`, and label -> TransmissionError: curves that stand for `te`, told by their labels
    line : str or None, the parameter along which motions are carried; with 'rest' it decides
        nothing. Default: the last one
    start : 'rest' (each run from rest), 'up' or 'down' (each value of `line` from where the next
        lower or higher one ended, the first from rest; not along `te`, whose values have no order)
    settle, record : int, mesh cycles before recording (>= 0), and recorded (>= 1)
    phase : float, mesh phase at the start
    numerics : Numerics or None; default: rtol 1e-6
    observe : of 'rms' (phi_rms, rad), 'forces' (mesh_force_mean and mesh_force_peak of spring and
        damper, N; NaN under the rigid law), 'exponent' (lyapunov_exponent, the largest, per τ; NaN
        where a periodic motion grazes) and 'shares' (of time in each motion state), each over the
        last period, or over all recorded cycles of a motion without one; the rest costs nothing
    shard_runs : int or None, runs of a shard; where motions are carried these are whole lines, or,
        of a line that is longer, a chain of shards that go on from each other; default: some 20 s
        of work, and at least 64 shards, but for chains. No number depends on it
    folder : path or None, where shards are kept while there is work. A map that was stopped goes on
        there: shards of the same values and the same build are read, others made again. They stay
        (`lapwing.results.shards.discard_shards`), and `open_study` opens them
    executor : concurrent.futures.Executor or None, which carries out the shards, in other processes
        or on other machines that see `folder`, which is needed then; default: threads
    threads : int or None; default `threads.default_threads`
    progress : callable(fraction done) or None
    notes : callable(text) or None, told of shards that were made again, and why
    keep_interrupted : bool, whether Ctrl-C returns what is finished (attribute `interrupted`, the
        rest with status UNFINISHED) instead of raising KeyboardInterrupt
    **operation : the other arguments of `GearPair.oscillator`

    Returns
    -------
    xarray.Dataset over the axes, in their order, here (x, y); [unit; of codes the enumeration]:

    (x, y): status [Status], period, arrivals, back_arrivals, impacts_per_cycle,
    back_impacts_per_cycle, chatter, states_visited [MotionState], deepest_separation [rad],
    deepest_back_penetration [rad], fastest_arrival [rad per tau]
    'rms' (x, y): phi_rms [rad]
    'forces' (x, y): mesh_force_mean [N], mesh_force_peak [N]
    'exponent' (x, y): lyapunov_exponent
    'shares' (x, y): separation_share, engagement_share, back_engagement_share
    along 'te' (te): curve_source, curve_sha256, curve_peak_to_peak [rad]

    period is in mesh cycles (0: none found), arrivals at either flank are those in it, or in all
    recorded cycles of a motion without period; chatter is 1 where one was complete;
    states_visited are bits. A run that fails has no numbers but its status. Attributes say what was
    fixed: laws, numbers of the pair, torques and speed, numerics.

    Raises
    ------
    TypeError, ValueError
        for every refused argument, the oscillators' own refusals included.
    MemoryError
        before any work, where the result cannot fit.
    OSError
        where a shard cannot be written.
    """
    job = job_of(pair, te, axes, line=line, start=start, settle=settle, record=record, phase=phase,
                 numerics=numerics, observe=observe, shard_runs=shard_runs, **operation)
    found, interrupted = carry_out("parameter_map", job, folder=folder, executor=executor,
                                   threads=threads, progress=progress, notes=notes,
                                   keep_interrupted=keep_interrupted)
    numbers = numbers_of(job, found)
    return _dataset(job, {name: (job.grid.order, values.reshape(job.grid.shape))
                          for name, values in numbers.items()}, found.cpus, interrupted)


def left_map(job: Job, folder: Path, **gathering: Any) -> xr.Dataset:
    """The same, its numbers left in the shards: each is read when it is used, as long as they are.

    What ended how is known. Memory: a byte a run, and what is read.

    Parameters
    ----------
    job : Job
    folder : Path
    **gathering : executor, threads, progress, notes, keep_interrupted, as of `parameter_map`
    """
    grid, notes = job.grid, gathering["notes"]
    estimates.require(grid.runs * estimates.map_read(job.observe), "parameter_map",
                      "the number of runs")
    found = Noted(job, notes or (lambda _: None))
    interrupted = gather("parameter_map", job, found, folder=folder, **gathering)
    variables: dict[str, Any] = {**left_in(folder, found.status, found.least)}
    variables["status"] = grid.order, found.status.reshape(grid.shape)
    return _dataset(job, variables, found.cpus, interrupted)


def job_of(pair: GearPair, te: TransmissionError, axes: Any, *, line: str | None, start: str,
           settle: int, record: int, phase: float, numerics: Numerics | None,
           observe: Sequence[str] = (), shard_runs: int | None, **operation: Any) -> Job:
    """The checked arguments of `parameter_map` as a `Job`, or every problem at once."""
    taken = Refusals()
    taken.take(arguments.instance, "pair", pair, GearPair)
    taken.take(arguments.instance, "te", te, TransmissionError)
    if not isinstance(axes, Mapping) or len(axes) < 2:
        taken.problems.append(arguments.wrong("axes", axes, "two or more: {parameter: values}"))
        axes = {}
    for name in axes:
        if name in operation:
            taken.problems.append(arguments.wrong(name, operation[name], "none beside its axis"))
        taken.take(arguments.choice, "axes", name, parameters(te, curves=True))
    values, curves = taken_axes(taken, te, axes)
    if curve_clash(axes):
        taken.problems.append(f"axes: {curve_clash(axes)}")
    taken.take(arguments.choice, "start", start, STARTS)
    if line is not None:
        taken.take(arguments.choice, "line", line, tuple(values))
    observed = taken.take(arguments.choices, "observe", observe, tuple(OBSERVED))
    check_settings(taken, settle, record, phase, numerics, shard_runs)
    taken.raise_if_any("parameter_map")
    line = fastest_axis(values) if start == "rest" else line or list(values)[-1]
    if start != "rest" and line == CURVE:
        raise ValueError(f"parameter_map: start = {start!r}: nothing is carried along 'te', whose "
                         "values have no order; expected 'rest', or another line")
    grid = Grid(pair, curves, values, line, operation)
    if grid.runs > MAX_INT:
        raise ValueError(f"parameter_map: {grid.runs} runs, expected at most {MAX_INT}")
    if grid.length > MAX_INT // 8:
        raise ValueError(f"parameter_map: {grid.length} values of {grid.line}")
    grid.check_corners("parameter_map")
    length = 1 if start == "rest" else grid.length
    size = shard_size(grid.runs, settle + record, length, shard_runs)
    if shard_runs is None and start == "rest" and line in TORQUES:
        size = shared_size(size, grid.length, grid.pieces)
    return Job(grid, start, int(settle), int(record), float(phase),
               numerics or Numerics(rtol=1e-6), size,
               tuple(one for one in OBSERVED if one in observed))


def _dataset(job: Job, variables: dict[str, Any], cpus: set[str],
             interrupted: bool) -> xr.Dataset:
    import xarray as xr

    grid = job.grid
    drawn = dict(zip(("x_parameter", "y_parameter"), grid.axes, strict=True)) \
        if len(grid.axes) == 2 else {}
    return worded(xr.Dataset({**variables, **curves_of(grid.te).told}, dict(grid.axes), {
        **job.about, **drawn, "shards": job.cut.shards, "interrupted": int(interrupted),
        "cpus": "; ".join(sorted(cpus))})).transpose(*grid.axes)


__all__ = ["parameter_map"]
