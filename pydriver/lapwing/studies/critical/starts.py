"""A stated set of starts, and what became of the motions begun there."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from lapwing import engine
from lapwing.base import arguments, estimates
from lapwing.base.codes import MotionState, Status
from lapwing.engine import Wanted
from lapwing.engine.records import CYCLE_TABLE, SAMPLE
from lapwing.model.start import coast_flank

if TYPE_CHECKING:
    from lapwing.engine.numerics import Numerics
    from lapwing.engine.sweeps import SweepResult
    from lapwing.model.oscillator import Oscillator

# One call into the engine holds at most this much of the cycle tables.
MAX_BYTES = 1 << 26
# Of one start in a list: a tuple of four and its place.
START_BYTES = 96
ENGAGED = 1 << MotionState.ENGAGEMENT


@arguments.complete()
@dataclass(frozen=True)
class StartGrid:
    """How finely the starts are spread.

    Parameters
    ----------
    phases, positions, speeds : int, >= 1; mesh phases, and at each of them positions × speeds in
        separation and as many in engagement
    """

    phases: int = 6
    positions: int = 3
    speeds: int = 3

    def __post_init__(self) -> None:
        for name in ("phases", "positions", "speeds"):
            object.__setattr__(self, name, arguments.whole(name, getattr(self, name), 1, 1000))


def start_grid(osc: Oscillator, grid: StartGrid,
               phase: float = 0.0) -> list[tuple[float, float, float, float]]:
    """Rest, and middles of equal cells of phase, position and speed.

    Separation: φ over the whole gap (`one_flank`: over the height of a flight of two mesh cycles),
    φ' up to the speed v = √(2aD) of a fall through that depth D under a = max(|F|, Ω²·range of g),
    either way. Engagement: φ up to F + v, the depth to which a tooth of that speed presses in (the
    natural frequency is 1), the same φ'; `rigid` knows only φ = φ' = 0 there.

    Parameters
    ----------
    osc : Oscillator
    grid : StartGrid
    phase : float, mesh phase of rest and of the first cell

    Returns
    -------
    list of (motion state or engine.REST, φ rad, φ' rad per τ, phase), as `engine.sweep` takes them
    """
    estimates.require(START_BYTES * grid.phases * grid.positions * grid.speeds, "critical",
                      "starts (start_phases, start_positions or start_speeds)")
    starts = []
    if osc.force >= 0 or osc.gap != "one_flank":
        starts.append((engine.REST, 0.0, 0.0, phase))
    for at in (phase + np.arange(grid.phases) / grid.phases) % 1.0:
        depth, fastest = reach(osc, at)
        for start in _in_cells(MotionState.SEPARATION, -depth, fastest, grid):
            starts.append((*start, float(at)))
        if osc.contact_law == "rigid":
            starts.append((float(MotionState.ENGAGEMENT), 0.0, 0.0, float(at)))
            continue
        pressed = max(osc.force, 0.0) + fastest
        for start in _in_cells(MotionState.ENGAGEMENT, pressed, fastest, grid):
            starts.append((*start, float(at)))
    return starts


def reach(osc: Oscillator, phase: float) -> tuple[float, float]:
    """How far from the drive flank a start in separation may lie, rad, and how fast it may be."""
    low, high = osc.flank_extrema
    pull = max(abs(osc.force), osc.mesh_frequency_ratio**2 * (high - low))
    depth = 0.5 * pull * osc.period**2 if osc.gap == "one_flank" else -coast_flank(osc, phase)
    return depth, math.sqrt(2 * pull * depth)


def _in_cells(state: MotionState, farthest: float, fastest: float,
              grid: StartGrid) -> Iterator[tuple[float, float, float]]:
    """(motion state, φ, φ') in the middle of each cell."""
    for position in (np.arange(grid.positions) + 0.5) / grid.positions:
        for speed in 2 * (np.arange(grid.speeds) + 0.5) / grid.speeds - 1:
            yield float(state), float(farthest * position), float(fastest * speed)


def fitted(osc: Oscillator,
           start: tuple[float, float, float, float]) -> tuple[float, float, float, float]:
    """A start carried from another oscillator, moved into the gap of this one where it is not."""
    state, phi, phi_dot, phase = start
    if osc.gap == "one_flank" or state in (engine.REST, MotionState.ENGAGEMENT):
        return start
    deepest = coast_flank(osc, phase)
    if phi > deepest:  # in back engagement a tooth that no longer touches is separated
        return float(MotionState.SEPARATION), phi, phi_dot, phase
    return (state, phi if state == MotionState.BACK_ENGAGEMENT else deepest, phi_dot, phase)


@dataclass(frozen=True)
class Fates:
    """What became of motions, one for each start.

    Attributes
    ----------
    rattles : (n,) bool, whether any recorded cycle saw an impact or anything but engagement
    back_cycles : (n,) int, recorded cycles with a back impact or a back engagement
    failed : (n,) bool, whether the run failed numerically
    final : list of n starts, where each motion ended
    back_at : list of n arrays of int, the recorded cycles counted in `back_cycles`
    """

    rattles: np.ndarray
    back_cycles: np.ndarray
    failed: np.ndarray
    final: list[Any]
    back_at: list[NDArray[Any]] = field(default_factory=list)


def follow(oscillators: list[Oscillator], starts: list[tuple[float, float, float, float]],
           settle: int, record: int, *, numerics: Numerics, threads: int,
           progress: Callable[..., Any] | None = None) -> Fates:
    """Follow one motion from each start, side by side.

    Parameters
    ----------
    oscillators : sequence of n Oscillator, of one table and one set of laws
    starts : sequence of n starts, as from `start_grid`
    settle, record : int, mesh cycles before looking, and looked at
    numerics : engine.Numerics
    threads : int; no result depends on it
    progress : callable(fraction) or None

    Returns
    -------
    Fates
    """
    estimates.require(estimates.sweep_bytes(1, record), "critical",
                      "record (record_cycles)")
    batch = max(1, MAX_BYTES // (CYCLE_TABLE.itemsize * record))
    done, total = [], len(starts)
    for first in range(0, total, batch):
        part = slice(first, first + batch)
        some = starts[part]
        result = engine.sweep(
            oscillators[part], [(i, i, False) for i in range(len(some))], some,
            numerics=numerics, wanted=Wanted(cycles=True, strobe=True), settle=settle,
            record=record, log_room=1, threads=threads,
            progress=_part(progress, first / total, len(some) / total))
        done.append(_fates(result, some))
    rattles, back_cycles, failed = (np.concatenate([getattr(one, key) for one in done])
                                    for key in ("rattles", "back_cycles", "failed"))
    return Fates(rattles, back_cycles, failed,
                 [state for one in done for state in one.final],
                 [times for one in done for times in one.back_at])


def _part(progress: Callable[..., Any] | None, begun: float,
          share: float) -> Callable[..., Any] | None:
    """Progress of one batch as part of the whole."""
    return None if progress is None else (lambda fraction: progress(begun + share * fraction))


def _fates(result: SweepResult, starts: list[tuple[float, float, float, float]]) -> Fates:
    failed, cycles = result.outcome["status"] != Status.OK, result.cycles
    rattles = np.any((cycles["states_visited"] != ENGAGED) | (cycles["impacts"] > 0), axis=1)
    back = (cycles["back_impacts"] + cycles["back_engages"] > 0) & ~failed[:, None]
    final = [(*(float(end[name]) for name in SAMPLE), start[3])
             for end, start in zip(result.outcome, starts, strict=True)]
    return Fates(rattles & ~failed, np.sum(back, axis=1), failed, final,
                 [np.flatnonzero(row) for row in back])
