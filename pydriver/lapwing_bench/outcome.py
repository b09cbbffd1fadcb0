"""What every method of the benchmark hands back."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Outcome:
    """One run.

    Attributes
    ----------
    kind : (n,) int array, numbers of `EventKind`; kinks left out
    time : (n,) array, mesh periods since the start
    velocity : (n,) array, φ' after the event, rad per τ
    state : (motion state, φ, φ') at the end
    failure : str, why the run ended early; empty if it did not
    """

    kind: np.ndarray
    time: np.ndarray
    velocity: np.ndarray
    state: tuple
    failure: str = ""


@dataclass(frozen=True)
class Record:
    """What a rival leaves behind when its clock stops: nothing is put in order yet.

    Attributes
    ----------
    rows : sequence of (kind, τ, φ' after)
    period : float, mesh period in τ
    state : (motion state, φ, φ') at the end
    failure : str, see `Outcome`
    """

    rows: object
    period: float
    state: tuple
    failure: str = ""

    def outcome(self):
        """The `Outcome`."""
        table = np.array(self.rows, dtype=float).reshape(-1, 3)
        return Outcome(table[:, 0].astype(int), table[:, 1] / self.period, table[:, 2],
                       self.state, self.failure)
