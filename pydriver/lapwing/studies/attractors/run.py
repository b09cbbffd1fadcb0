"""The motions that starts of one oscillator end in."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from lapwing.base import arguments, estimates
from lapwing.base.arguments import MAX_INT, Refusals
from lapwing.base.threads import checked_threads, usable_threads
from lapwing.engine import Numerics
from lapwing.model.draw import FEWEST
from lapwing.model.oscillator import Oscillator
from lapwing.studies.attractors.dataset import dataset_of
from lapwing.studies.attractors.search import PIECE, Search
from lapwing.studies.attractors.starts import checked

if TYPE_CHECKING:
    import xarray as xr

# What one run takes, in the result and on the way to it.
RUN_BYTES = 200
MOST_RESOLUTION = 4096


@arguments.complete()
def attractors(osc: Oscillator, starts: Any = "sobol", *, runs: int = 1024,
               scrambles: int = FEWEST, seed: int = 0, phi: Any = None, phi_dot: Any = None,
               phase: float = 0.0, most_cycles: int = 1000, returns: int = 30,
               recurrences: int = 50, resolution: int = 256, numerics: Numerics | None = None,
               threads: int | None = None,
               progress: Callable[[float], None] | None = None) -> xr.Dataset:
    """Follow motions from many starts, and tell in what they end.

    How an end is recognised, and when it is certain: `lapwing.studies.attractors.motions`.

    Parameters
    ----------
    osc : Oscillator, of one degree of freedom
    starts : 'sobol', 'random' or 'grid', over the ranges of phi and phi_dot; or an array (n, 2) of
        φ (rad) and φ' (rad per τ), or (n, 3) with the mesh phase of each. A tooth between the
        flanks begins in separation, one beyond a flank in contact
    runs : int, starts that are drawn; with 'sobol' a power of two in each scramble, of a grid a
        square number
    scrambles : int, independent ones, 16 or more, of 'sobol'
    seed : int, which decides all draws
    phi, phi_dot : (low, high) or None; default: the whole gap and as deep into the drive flank as a
        tooth presses in that falls through it, and the speed of that fall, either way
    phase : float, mesh phase of the starts
    most_cycles : int, mesh cycles after which a run is looked at, or given up
    returns : int, returns to a periodic motion, each nearer than the one before, from which it is
        presumed
    recurrences : int, mesh cycles running that begin in the cells of an aperiodic motion, from
        which it is presumed
    resolution : int, 16 to 4096, cells of the section along φ and along φ', over what aperiodic
        motions span
    numerics : Numerics or None; default: rtol 1e-8
    threads : int or None; default `threads.default_threads`; no number depends on it
    progress : callable(fraction done) or None

    Returns
    -------
    xarray.Dataset, by the dimensions of its variables [unit; of codes the enumeration]:

    (attractor): attractor, period, arrivals, back_arrivals, impacts_per_cycle,
    back_impacts_per_cycle, chatter, states_visited [MotionState], deepest_separation [rad],
    deepest_back_penetration [rad], fastest_arrival [rad per tau], motion_class, lyapunov_exponent,
    lyapunov_exponent_error, residual, runs_ended, share
    (attractor, multiplier): multiplier_real, multiplier_imag
    (attractor, point): point_motion_state [MotionState], point_phi [rad],
    point_phi_dot [rad per tau]
    (run): attractor_of_run, ending [Ending], followed_cycles, status [Status],
    start_motion_state [MotionState], start_phi [rad], start_phi_dot [rad per tau], start_phase,
    scramble

    Attractors are counted from 1, by rising deepest separation; their numbers are those of
    `lapwing.parameter_map` (period 0: aperiodic, then with lyapunov_exponent_error). residual: by
    how much a refined motion misses itself, part of its size (NaN: not refined). point: its states
    at mesh phase 0. share has share_low and share_high, which hold the truth in 95 of 100 cases
    (NaN: not known, as of a grid or of an array). attractor_of_run 0: not resolved.
    Attributes: unresolved, failed, presumed, runs of each kind, and what was fixed.

    Raises
    ------
    TypeError, ValueError
        for every refused argument.
    MemoryError
        before any work, where the result cannot fit.
    """
    taken = Refusals()
    drawn = None
    if taken.take(arguments.instance, "osc", osc, Oscillator) is not None:
        drawn = checked(osc, starts, runs, scrambles, seed, phi, phi_dot, phase, taken)
    search = search_of(osc, most_cycles=most_cycles, returns=returns, recurrences=recurrences,
                       resolution=resolution, numerics=numerics, threads=threads, taken=taken)
    if progress is not None:
        taken.take(arguments.function, "progress", progress)
    taken.raise_if_any("attractors")
    assert drawn is not None  # else it is refused
    estimates.require(len(drawn.rows) * RUN_BYTES, "attractors", "the number of runs")
    search.threads = usable_threads(search.threads, -(-len(drawn.rows) // PIECE))
    ends = search.find(drawn.rows, progress)
    return dataset_of(search, drawn.rows, ends, drawn.sample, drawn.told)


def search_of(osc: Any, *, most_cycles: Any, returns: Any, recurrences: Any, resolution: Any,
              numerics: Any, threads: Any, taken: Refusals) -> Search:
    """A search with checked settings; what is refused is added to `taken`."""
    if isinstance(osc, Oscillator) and osc.degrees_of_freedom != 1:
        taken.problems.append("osc: degrees_of_freedom = 2, expected 1: its section has two states")
    for name, value in (("most_cycles", most_cycles), ("returns", returns),
                        ("recurrences", recurrences)):
        taken.take(arguments.whole, name, value, 1, MAX_INT // 4)
    taken.take(arguments.whole, "resolution", resolution, 16, MOST_RESOLUTION)
    if numerics is not None:
        taken.take(arguments.instance, "numerics", numerics, Numerics)
    count = taken.take(lambda _, value: checked_threads(value), "threads", threads)
    return Search(osc, Numerics(rtol=1e-8) if numerics is None else numerics, most_cycles, returns,
                  recurrences, resolution, count or 1)


__all__ = ["attractors", "search_of"]
