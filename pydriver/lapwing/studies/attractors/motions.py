"""Motions that runs end in, and by what they are known again.

A *periodic* motion is refined by Newton's method (`find_orbit`) and known by its states on the
section, the mesh phase 0: two are the same where they have the same period and a state of one lies
within `SAME` of the motion's size of a state of the other. Around each of its states lies an
ellipse V = (x - x0)ᵀ S (x - x0) ≤ r², and whoever enters it ends there (`goals_of`):

1. M is the tangent map over one period at x0, ρ its spectral radius, ρ' = (1 + ρ)/2. S solves
   S - (M/ρ')ᵀ S (M/ρ') = 1/size²: in its norm M contracts by ρ' or better.
2. On rings of radius 1, 1/2, 1/4, …, each of `DIRECTIONS` states, the engine gives the image and
   the tangent map after one period. A ring is good where every image is in the same motion state,
   nearer to x0 by the factor q = (1 + ρ')/2, and every tangent map contracts by q.
3. r is half of the largest ring that is good with all those inside it. The map contracts on all of
   the ellipse where it does so at the states that were tried: that is what *certain* rests on.

Where no ring is good (a graze, a map that jumps nearby) no end is certain; there, and in the wider
surroundings of every motion, it is *presumed* after some returns each of which comes nearer.

An *aperiodic* motion is known by the cells of the section that it visits, `RECORD` mesh cycles
long, and their neighbours; a run whose cycles begin there often enough running is presumed to be
it. A motion that ends elsewhere after more cycles than were looked at looks the same.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lapwing import engine
from lapwing.base.codes import MotionState, Status
from lapwing.engine import GOAL_TABLE, Known, Points, Wanted
from lapwing.engine.records import SAMPLE, columns
from lapwing.model.oscillator import Oscillator
from lapwing.model.start import coast_flank
from lapwing.studies.orbit import NUMERICS, NoOrbit, Orbit, find_orbit
from lapwing.studies.period import MAX_PERIOD
from lapwing.studies.stability import CycleMaps, exponents

# Two states are one where they differ by less than this part of the motion's size: settled ones
# are known to 1e-8 of it (fortran/observers/period.f90).
SAME = 1e-6
# Rings around a state, the largest of the motion's own size; in each so many states.
RINGS, DIRECTIONS = 24, 12
# From here on, in the norm of S and parts of the motion's size, nearer returns are counted.
NEAR = 0.1
# Mesh cycles by which an aperiodic motion is known, and the part of them that must lie in the
# cells of another for both to be one.
RECORD, OVERLAP = 16384, 0.5
# The part of its second half that must lie in the cells of the first.
RECURRENT = 0.9
# A motion without a period that comes this near to itself, part of its size, may be on its slow way
# to a periodic one.
NEARLY = 1e-3
BEYOND = 1e30
# Terms of a sum are doubled so many times at most; the ratio of an ellipse's axes, squared, up to
# which it is one; and a multiplier so near to one does not attract in any time that is looked at.
DOUBLINGS, FLATTEST, NEUTRAL = 50, 1e12, 1e-9


@dataclass(frozen=True, eq=False)
class Motion:
    """Something that runs end in.

    Attributes
    ----------
    period : int, mesh cycles; 0: aperiodic
    states : (n, 3) array, motion state, φ, φ' where its cycles begin: of a period, or as recorded
    size : float, rad, max(|F|, deepest separation)
    outcome : structured scalar of `engine.OUTCOME_TABLE`, its class and extremes
    multipliers : (2,) complex array, NaN where there are none
    exponent, exponent_error : float, the largest Lyapunov exponent, per τ
    residual : float, by how much a refined periodic motion misses itself, part of its size; NaN: it
        could not be refined, or has no period
    maps : CycleMaps or None, of a period
    """

    period: int
    states: NDArray[np.float64]
    size: float
    outcome: Any
    multipliers: NDArray[np.complex128]
    exponent: float
    exponent_error: float = math.nan
    residual: float = math.nan
    maps: CycleMaps | None = field(default=None, repr=False)

    def holds(self, period: int, state: NDArray[np.float64]) -> bool:
        """Whether a periodic motion with a state (motion state, φ, φ') is this one."""
        if period != self.period or not period:
            return False
        near = np.abs(self.states[:, 1:] - state[1:]).max(axis=1) <= SAME * self.size
        return bool(np.any(near & (self.states[:, 0] == state[0])))

    @property
    def lost(self) -> bool:
        """Whether it is known not to attract what is near."""
        return bool(np.any(np.abs(self.multipliers) >= 1 - NEUTRAL))


def periodic(osc: Oscillator, cycles: NDArray[Any], outcome: Any) -> Motion:
    """The motion of which a run's cycles (n,) are periods, as `find_period` has found.

    It is refined; where Newton's method does not lead to a motion within `SAME`, it is kept as
    recorded.
    """
    period = int(outcome["period"])
    states = columns(cycles[-period:], SAMPLE)
    size = size_of(osc, cycles)
    orbit = _refined(osc, states[0], period)
    if orbit is not None and np.abs(np.array(orbit.state[1:]) - states[0, 1:]).max() \
            <= SAME * size and orbit.cycles == period:
        return of_orbit(orbit, outcome)
    return Motion(period, states[_from_deepest(states)], size, outcome,
                  np.full(2, complex(np.nan)), math.nan)


def nearly_periodic(osc: Oscillator, cycles: NDArray[Any], outcome: Any) -> Motion | None:
    """The stable periodic motion that a run is slowly coming to, if there is one."""
    states, size = columns(cycles, SAMPLE), size_of(osc, cycles)
    misses = np.array([np.abs(states[-1, 1:] - states[-1 - p, 1:]).max() / size
                       if states[-1, 0] == states[-1 - p, 0] else math.inf
                       for p in range(1, min(MAX_PERIOD, len(states) - 1) + 1)])
    for period in (np.argsort(misses, kind="stable") + 1).tolist():
        miss = float(misses[period - 1])
        if miss > NEARLY:
            return None
        orbit = _refined(osc, states[-1], period)
        if orbit is None or not orbit.multipliers.stable:
            continue
        # What is left of the way, of a geometric series whose last step is the miss.
        left = miss / (1 - float(np.abs(orbit.multipliers.values).max()))
        if np.abs(np.array(orbit.state[1:]) - states[-1, 1:]).max() <= 3 * left * size:
            outcome = outcome.copy()
            outcome["period"] = orbit.cycles
            for name, column in (("arrivals", "counted_impacts"),
                                 ("back_arrivals", "counted_back_impacts")):
                outcome[name] = orbit.table[column].sum()
            return of_orbit(orbit, outcome)
    return None


def aperiodic(osc: Oscillator, start: tuple[float, ...],
              numerics: engine.Numerics) -> Motion | None:
    """The motion from a state at mesh phase 0 on, recorded; one that has a period at last is that.

    None where the run fails.
    """
    result = engine.sweep(
        [osc], [(0, 0, False)], [start], numerics=numerics,
        wanted=Wanted(cycles=True, tangent=True), settle=0, record=RECORD, log_room=1, threads=1)
    rows, outcome = result.cycles[0], result.outcome[0]
    if outcome["status"] != Status.OK:
        return None
    if outcome["period"] > 0:
        return periodic(osc, rows, outcome)
    size = size_of(osc, rows)
    grown = exponents(CycleMaps.from_rows(result.tangent[0], osc.period), 0, size)
    return Motion(0, columns(rows, SAMPLE), size, outcome, np.full(2, complex(np.nan)),
                  grown.largest, grown.error)


def of_orbit(orbit: Orbit, outcome: Any) -> Motion:
    """A periodic motion that is refined; class and extremes as of a run."""
    states = columns(orbit.table, SAMPLE)
    order = _from_deepest(states)
    return Motion(orbit.cycles, states[order], orbit.size, outcome, orbit.multipliers.values,
                  float(orbit.multipliers.exponents[0]), residual=orbit.residual,
                  maps=orbit.maps[order])


def _from_deepest(states: NDArray[np.float64]) -> NDArray[np.intp]:
    """The states of a period in their order, the one with the least φ first."""
    return np.roll(np.arange(len(states)), -int(np.argmin(states[:, 1])))


def _refined(osc: Oscillator, state: NDArray[np.float64], period: int) -> Orbit | None:
    try:
        return find_orbit(osc, (MotionState(int(state[0])), *map(float, state[1:])), period,
                          numerics=NUMERICS)
    except (NoOrbit, ValueError):  # none, or a state that rounding puts beyond its flank
        return None


def size_of(osc: Oscillator, cycles: NDArray[Any]) -> float:
    """The size of a motion, rad: what tolerances refer to."""
    return max(abs(osc.force), float(cycles["deepest_separation"].max())) or osc.backlash


def goals_of(osc: Oscillator, motion: Motion, number: int) -> NDArray[Any]:
    """The ellipses around the states of a periodic motion, `engine.GOAL_TABLE`; see above."""
    goals = np.zeros(motion.period, GOAL_TABLE)
    goals["motion"], goals["period"] = number, motion.period
    for i, name in enumerate(SAMPLE):
        goals[name] = motion.states[:, i]
    scaled, contraction = _metrics(motion)
    for name, (i, j) in {"s11": (0, 0), "s12": (0, 1), "s22": (1, 1)}.items():
        goals[name] = scaled[:, i, j] / motion.size**2
    goals["presumed"], goals["certain"] = NEAR**2, -1.0
    if math.isfinite(contraction):
        goals["certain"] = _certain(osc, motion, scaled, contraction)
    return goals


def _metrics(motion: Motion) -> tuple[NDArray[np.float64], float]:
    """S·size² at each state, and q; without a linear map the plain metric, and NaN."""
    plain = np.broadcast_to(np.eye(2), (motion.period, 2, 2))
    if motion.maps is None or not np.all(np.abs(motion.multipliers) < 1):
        return plain, math.nan
    with np.errstate(over="ignore", invalid="ignore"):
        steps = np.ldexp(motion.maps.matrix, motion.maps.exponent.astype(int)[:, None, None])
        bound = (1 + float(np.abs(motion.multipliers).max())) / 2
        totals = np.array([np.eye(2)] * motion.period)
        for k, total in enumerate(totals):
            for step in (*steps[k:], *steps[:k]):
                total[:] = step @ total
        found = _summed(totals / bound)
    # What is so flat that rounding decides is no ellipse.
    if not np.all(np.isfinite(found)) or np.linalg.cond(found).max() > FLATTEST:
        return plain, math.nan
    return (found + found.swapaxes(1, 2)) / 2, (1 + bound) / 2


def _summed(a: NDArray[np.float64]) -> NDArray[np.float64]:
    """The sum over j of (Aᵀ)ʲ Aʲ for each A (n, 2, 2) of spectral radius below 1, by doubling."""
    found = np.broadcast_to(np.eye(2), a.shape)
    for _ in range(DOUBLINGS):
        found = found + a.swapaxes(1, 2) @ found @ a
        a = a @ a
        if not np.abs(a).max() > np.finfo(float).eps:
            break
    return found


def _certain(osc: Oscillator, motion: Motion, scaled: NDArray[np.float64],
             contraction: float) -> NDArray[np.float64]:
    """V up to which an end is certain at each state of a motion, (period,); -1: nowhere."""
    n = motion.period
    angles = 2 * np.pi * np.arange(DIRECTIONS) / DIRECTIONS
    radii = 0.5 ** np.arange(RINGS)
    circle = np.stack([np.cos(angles), np.sin(angles)])
    lower = np.linalg.cholesky(scaled)                       # S = L Lᵀ, |x|_S = |Lᵀ x|
    rings = np.linalg.solve(lower.swapaxes(1, 2), circle[None])
    offsets = np.einsum("r,kid->krdi", radii, rings) * motion.size
    begin = motion.states[:, None, None, 1:] + offsets
    state = np.broadcast_to(motion.states[:, None, None, 0], begin.shape[:-1])
    there = _in_state(osc, state, begin[..., 0])
    image, map_of, same = _mapped(osc, state[there], begin[there], n)
    shift = (image - np.broadcast_to(motion.states[:, None, None, 1:], begin.shape)[there]) \
        / motion.size
    at = np.nonzero(there)
    own = lower[at[0]].swapaxes(1, 2)                        # Lᵀ
    near = np.linalg.norm(np.einsum("nij,nj->ni", own, shift), axis=1) \
        <= contraction * radii[at[1]]
    contracts = np.linalg.norm(own @ map_of @ np.linalg.inv(own), 2, axis=(1, 2)) <= contraction
    good = np.ones(there.shape, bool)
    good[there] = same & near & contracts
    # From the smallest ring outwards, as long as all of them are good.
    outwards = np.logical_and.reduce(good, axis=2)[:, ::-1]
    whole = np.logical_and.accumulate(outwards, axis=1).sum(axis=1)
    return np.where(whole > 0, (radii[RINGS - np.maximum(whole, 1)] / 2) ** 2, -1.0)


def _in_state(osc: Oscillator, state: NDArray[np.float64],
              phi: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Whether there is such a state at mesh phase 0: beyond a flank it is another one."""
    depth = coast_flank(osc, 0.0)
    rigid = osc.contact_law == "rigid"
    inside: NDArray[np.bool_] = np.where(
        state == MotionState.SEPARATION, (phi <= 0) & (phi >= depth), np.where(
            state == MotionState.ENGAGEMENT, phi >= 0, phi <= depth) & (not rigid))
    return inside


def _mapped(osc: Oscillator, state: NDArray[np.float64], x: NDArray[np.float64],
            cycles: int) -> tuple[NDArray[Any], NDArray[Any], NDArray[np.bool_]]:
    """Images (n, 2) of states, tangent maps (n, 2, 2), and whether the motion state is the same."""
    n = len(state)
    if not n:
        return np.empty((0, 2)), np.empty((0, 2, 2)), np.empty(0, bool)
    result = engine.sweep(
        Points.of([osc]).repeated(n), [(i, i, False) for i in range(n)],
        np.column_stack([state, x, np.zeros(n)]), numerics=NUMERICS,
        wanted=Wanted(strobe=True, tangent=True), settle=0, record=cycles, log_room=1, threads=1)
    outcome = result.outcome
    total = np.broadcast_to(np.eye(2), (n, 2, 2))
    for k in range(cycles):
        step = result.tangent[:, k]
        with np.errstate(invalid="ignore", over="ignore"):
            total = np.ldexp(step["matrix"], np.nan_to_num(step["exponent"]).astype(int)[
                :, None, None]) @ total
    same = (outcome["status"] == Status.OK) & (outcome["motion_state"] == state)
    # Where there is no linear map, or one beyond all bounds, nothing contracts.
    known = np.isfinite(total).all(axis=(1, 2), keepdims=True)
    return columns(outcome, ("phi", "phi_dot")), np.where(known, total, BEYOND * np.eye(2)), same


def cells_of(motions: Sequence[Motion],
             resolution: int) -> tuple[NDArray[np.intc], NDArray[np.float64]]:
    """Cells of the section that aperiodic motions visit, and neighbours; see `engine.Known`."""
    from scipy.ndimage import binary_dilation

    paths = {number: one.states[:, 1:] for number, one in enumerate(motions, 1) if not one.period}
    if not paths:
        return Known().cells, Known().box
    every = np.concatenate(list(paths.values()))
    low, high = every.min(axis=0), every.max(axis=0)
    # A margin of two cells, for neighbours of the outermost ones; a width, also of a point.
    width = np.maximum(high - low, 1e-9 * np.maximum(np.abs(low), np.abs(high)) + 1e-300)
    margin = 2 * width / (resolution - 4)
    low, high = low - margin, high + margin
    cells = np.zeros((resolution, resolution), np.intc)
    for number, path in paths.items():
        visited = np.zeros(cells.shape, bool)
        visited[tuple(((path - low) / (high - low) * resolution).astype(int).T)] = True
        visited = binary_dilation(visited, np.ones((3, 3), bool))
        cells[visited] = np.where(cells[visited] == 0, number, -1)
    return cells, np.array([low[0], high[0], low[1], high[1]])


def recurs(motion: Motion, resolution: int) -> bool:
    """Whether the second half of an aperiodic motion's record lies where its first half was.

    A flight that is longer than the record comes back to nothing.
    """
    half = len(motion.states) // 2
    cells, box = cells_of([replace(motion, states=motion.states[:half])], resolution)
    return inside(cells, box, motion.states[half:], 1) >= RECURRENT


def inside(cells: NDArray[np.intc], box: NDArray[np.float64], states: NDArray[np.float64],
           number: int) -> float:
    """The part of states (n, 3) that lies in the cells of a motion, those of several included."""
    place = (states[:, 1:] - box[[0, 2]]) / (box[[1, 3]] - box[[0, 2]])
    within = np.all((place >= 0) & (place < 1), axis=1)
    found = cells[tuple((place[within] * cells.shape).astype(int).T)]
    return float(np.count_nonzero((found == number) | (found < 0)) / len(states))


__all__ = ["Motion", "aperiodic", "cells_of", "goals_of", "inside", "nearly_periodic", "periodic",
           "recurs"]
