"""Starts over ranges of φ and φ': random, by Sobol sequences, on a grid, or as they are given."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lapwing.base import arguments
from lapwing.base.arguments import Refusals
from lapwing.base.codes import MotionState
from lapwing.model.draw import FEWEST, sampling_problems
from lapwing.model.oscillator import Oscillator
from lapwing.model.start import coast_flanks
from lapwing.studies.critical.starts import reach
from lapwing.studies.ensemble.points import shares_of
from lapwing.studies.ensemble.statistics import Sample

DRAWS = ("sobol", "random", "grid")
MOST_STARTS = 10_000_000


@dataclass(frozen=True, eq=False)
class Starts:
    """Where motions begin.

    Attributes
    ----------
    rows : array (n, 4), motion state, φ (rad), φ' (rad per τ), mesh phase: as the engine takes them
    sample : Sample, how they were drawn
    told : dict, attributes of a result
    """

    rows: NDArray[np.float64]
    sample: Sample
    told: dict[str, Any]


def motion_states(osc: Oscillator, phi: NDArray[np.float64],
                  phase: NDArray[np.float64]) -> NDArray[np.float64]:
    """The motion state of each φ: a tooth between the flanks, or at one, is separated.

    `compliant` knows no arrival: at a flank it is engaged.
    """
    coast = coast_flanks(osc, phase)
    states = np.where(phi > 0, MotionState.ENGAGEMENT, np.where(
        phi < coast, MotionState.BACK_ENGAGEMENT, MotionState.SEPARATION))
    return states.astype(float)


def ranges(osc: Oscillator, phase: float) -> dict[str, tuple[float, float]]:
    """φ (rad) and φ' (rad per τ) over which starts are spread unless it is said.

    As `studies.critical.starts.start_grid`: φ over the whole gap and as deep into the drive flank
    as a tooth presses in that falls through it; φ' up to the speed of that fall, either way.
    """
    depth, fastest = reach(osc, phase)
    deepest = 0.0 if osc.contact_law == "rigid" else max(osc.force, 0.0) + fastest
    return {"phi": (-depth, deepest), "phi_dot": (-fastest, fastest)}


def drawn_starts(osc: Oscillator, draw: str, runs: int, scrambles: int, seed: int,
                 phi: tuple[float, float], phi_dot: tuple[float, float],
                 phase: float) -> Starts:
    """Starts over a rectangle; of a grid, the middles of √runs × √runs cells."""
    if draw == "grid":
        side = math.isqrt(runs)
        middles = (np.arange(side) + 0.5) / side
        shares = np.stack([one.ravel() for one in np.meshgrid(middles, middles, indexing="ij")],
                          axis=1)
        sample = Sample(runs, -1)
    else:
        shares = shares_of(draw, runs, 2, scrambles, seed)
        sample = Sample(runs, 0 if draw == "random" else scrambles)
    own = np.array([phi, phi_dot])
    values = own[:, 0] + shares * (own[:, 1] - own[:, 0])
    told: dict[str, Any] = {
        "starts": draw, "seed": seed, "scrambles": max(sample.scrambles, 0), "phase": phase,
        "phi_range": np.array(phi), "phi_dot_range": np.array(phi_dot)}
    return Starts(_rows(osc, values, np.full(runs, phase)), sample, told)


def listed_starts(osc: Oscillator, values: NDArray[np.float64], phase: float) -> Starts:
    """Starts that are given: (n, 2) φ and φ', or (n, 3) with the mesh phase of each."""
    phases = values[:, 2] if values.shape[1] == 3 else np.full(len(values), phase)
    return Starts(_rows(osc, values[:, :2], phases), Sample(len(values), -1), {"starts": "listed"})


def _rows(osc: Oscillator, values: NDArray[np.float64],
          phases: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.column_stack([motion_states(osc, values[:, 0], phases), values, phases])


def checked(osc: Oscillator, starts: Any, runs: Any, scrambles: Any, seed: Any, phi: Any,
            phi_dot: Any, phase: Any, taken: Refusals) -> Starts | None:
    """The arguments of `lapwing.attractors` that say where motions begin; None: refused."""
    before = len(taken.problems)
    phase = taken.take(arguments.phase, "phase", phase)
    values = None
    if isinstance(starts, str):
        taken.take(arguments.choice, "starts", starts, DRAWS)
        taken.take(arguments.whole, "runs", runs, 1, MOST_STARTS)
        taken.take(arguments.whole, "scrambles", scrambles, FEWEST, 1000)
        taken.take(arguments.whole, "seed", seed)
    else:
        values = taken.take(arguments.reals, "starts", starts, ndim=2)
        if values is not None and values.shape[1] not in (2, 3):
            taken.problems.append(arguments.wrong(
                "starts", starts, f"one of {', '.join(map(repr, DRAWS))}, or an array (n, 2) of "
                "phi and phi_dot, or (n, 3) with mesh phases"))
        for name, given in (("phi", phi), ("phi_dot", phi_dot)):
            if given is not None:
                taken.problems.append(f"{name} goes with starts that are drawn, not with values")
    spans = checked_spans(taken, phi=phi, phi_dot=phi_dot)
    if len(taken.problems) > before:
        return None
    if values is not None:
        if values.shape[1] == 3 and not np.all((values[:, 2] >= 0) & (values[:, 2] < 1)):
            taken.problems.append("starts: expected mesh phases from 0 to below 1")
            return None
        found = listed_starts(osc, values, phase)
    else:
        problems = [] if starts == "grid" else sampling_problems(starts, runs, scrambles, None)
        if starts == "grid" and math.isqrt(runs) ** 2 != runs:
            problems = [arguments.wrong("runs", runs, "a square number of starts of a grid")]
        if problems:
            taken.problems += problems
            return None
        own = ranges(osc, phase) | spans
        found = drawn_starts(osc, starts, int(runs), int(scrambles), int(seed), **own, phase=phase)
    taken.problems += start_problems(osc, found.rows)
    return found


def checked_spans(taken: Refusals, **spans: Any) -> dict[str, tuple[float, float]]:
    """Those of the ranges that are given, each checked."""
    return {name: taken.take(_checked_span, name, given)
            for name, given in spans.items() if given is not None}


def _checked_span(name: str, value: Any) -> tuple[float, float]:
    """A range (low, high), low below high."""
    low, high = (arguments.reals(name, value, ndim=1).tolist() + [math.nan] * 2)[:2]
    if np.size(value) != 2 or not low < high:
        raise ValueError(arguments.wrong(name, value, "(low, high), low below high"))
    return low, high


def start_problems(osc: Oscillator, rows: NDArray[np.float64]) -> list[str]:
    """What is wrong with starts: a rigid flank lets no tooth in."""
    if osc.contact_law == "rigid" and np.any(rows[:, 0] != MotionState.SEPARATION):
        return ["starts: contact_law = 'rigid' lets no tooth into a flank, expected phi from the "
                "coast flank to 0"]
    return []


__all__ = ["DRAWS", "Starts", "checked", "checked_spans", "drawn_starts",
           "listed_starts", "motion_states", "ranges", "start_problems"]
