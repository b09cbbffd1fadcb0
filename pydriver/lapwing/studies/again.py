"""One run of a study once more, as it was, with everything about it kept."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from lapwing import engine
from lapwing.base.codes import Status
from lapwing.engine import Numerics, Points, Wanted, common_method
from lapwing.studies.trajectory import Run, run_from

if TYPE_CHECKING:
    from collections.abc import Sequence

    from lapwing.model.oscillator import Oscillator


@dataclass(frozen=True)
class Again:
    """A run that was carried out once more.

    Attributes
    ----------
    run : Run, its events (near-grazes among them) and cycles from the very start
    place : dict of coordinate -> value, where it lies in its study
    """

    run: Run
    place: dict[str, Any]


def moved_again(points: Points, osc: Oscillator, before: Sequence[int], numerics: Numerics, *,
                settle: int, record: int, phase: float, bounces: bool = True) -> Run:
    """A run of a sweep or a map once more.

    Parameters
    ----------
    points : Points, of all runs that are moved by one method
    osc : Oscillator, of the run
    before : indices of the runs that it was carried on from, in their order; empty: from rest
    numerics : Numerics
    settle, record : int, mesh cycles
    phase : float, mesh phase at the start
    bounces : bool, see `Wanted`
    """
    numerics = replace(numerics, method=common_method(points, numerics))
    start = (engine.REST, 0.0, 0.0)
    if before:
        line = points.take(np.array(before))
        last = engine.sweep(
            line, [(0, len(line) - 1, True)], [(*start, phase)], numerics=numerics,
            wanted=Wanted(cycles=True, bounces=bounces), settle=settle, record=record,
            log_room=1, threads=1, keep_cycles=False).outcome[-1]
        if last["status"] == Status.OK:  # what follows a run that failed begins at rest
            start = float(last["motion_state"]), float(last["phi"]), float(last["phi_dot"])
    return run_from(osc, start, phase, (settle + record, phase * osc.period), numerics, bounces)
