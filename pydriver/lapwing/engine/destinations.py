"""Where motions from many starts of one oscillator end (fortran/run/destination.f90)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from lapwing.base.codes import Status
from lapwing.engine import calls
from lapwing.engine.flanks import flank_argument
from lapwing.engine.methods import method_of
from lapwing.engine.numerics import Wanted
from lapwing.engine.points import Points
from lapwing.engine.records import SAMPLE, named

if TYPE_CHECKING:
    from lapwing.engine.numerics import Numerics
    from lapwing.model.oscillator import Oscillator

# A state on the section of a known periodic motion: the number of the motion, from 1, the metric
# S of V = (x - x0)' S (x - x0), and V up to which an end there is certain, and can be presumed.
GOAL_TABLE = np.dtype([(name, float) for name in (
    "motion", "motion_state", "period", "phi", "phi_dot", "s11", "s12", "s22", "certain",
    "presumed")])
# How a run ended: the number of its motion (0: not known), `Ending`, cycles completed, and the
# state with which the last cycle began.
END_TABLE = np.dtype([(name, float) for name in ("status", "motion", "ending", "cycles", *SAMPLE)])
# f2py takes no empty array: a goal that no state is near to.
_NO_GOAL = np.full((calls.GOAL_COLUMNS, 1), -1.0, order="F")


@dataclass(frozen=True, eq=False)
class Known:
    """Motions that are known, and when a run counts as one of them.

    Attributes
    ----------
    goals : structured array (n,) of `GOAL_TABLE`
    cells : array (n_phi, n_phi_dot) of int, the aperiodic motion whose section visits a cell; 0:
        none does, -1: several do
    box : array (4,), least and greatest phi (rad) and phi' (rad per τ) that the cells span
    most_cycles : int, mesh cycles after which a run is given up
    returns : int, returns to a goal, each nearer than the one before, that presume an end there
    recurrences : int, cycles running in the cells of an aperiodic motion that presume it
    """

    goals: NDArray[Any] = field(default_factory=lambda: np.empty(0, GOAL_TABLE))
    cells: NDArray[np.intc] = field(default_factory=lambda: np.zeros((1, 1), np.intc))
    box: NDArray[np.float64] = field(default_factory=lambda: np.array([0.0, 1.0, 0.0, 1.0]))
    most_cycles: int = 1000
    returns: int = 30
    recurrences: int = 100


def destinations(osc: Oscillator, known: Known, starts: NDArray[np.float64], *,
                 numerics: Numerics,
                 told: Callable[[float], object] | None = None) -> NDArray[Any]:
    """Follow a motion from each start until it is one that is known; by the calling thread alone.

    Parameters
    ----------
    osc : Oscillator, of one degree of freedom
    known : Known
    starts : array (n, 4): motion state or REST, phi (rad), phi' (rad per τ), mesh phase
    numerics : Numerics
    told : callable(fraction done), called between calls into the engine, or None

    Returns
    -------
    structured array (n,) of `END_TABLE`
    """
    wanted = Wanted(bounces=False)
    method = method_of(osc, numerics)
    fixed = (flank_argument(osc.te, osc.back_flank_te, method),
             calls.real_parameters(Points.of([osc]), numerics, method, wanted)[:, 0],
             calls.choices(osc, numerics, method, wanted),
             np.array([known.most_cycles, known.returns, known.recurrences], np.intc),
             np.asfortranarray(known.goals.view(float).reshape(-1, calls.GOAL_COLUMNS).T)
             if known.goals.size else _NO_GOAL,
             known.box, np.asfortranarray(known.cells, dtype=np.intc),
             np.asfortranarray(starts.T))
    ends = np.full((calls.END_COLUMNS, len(starts)), np.nan, order="F")
    ends[0] = Status.UNFINISHED
    suspended = np.zeros(calls.SUSPENDED_SIZE)
    suspended[0] = 1
    while suspended[0] <= len(starts):
        calls.api.destinations(*fixed, calls.CALL_SECONDS, suspended, ends)
        if told is not None:
            told((suspended[0] - 1) / len(starts))
    return named(ends.T, END_TABLE)
