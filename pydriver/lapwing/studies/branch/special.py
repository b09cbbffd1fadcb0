"""What is found on a branch: points, special points, and what they are called."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lapwing.base.codes import BranchOutcome as Outcome
from lapwing.base.codes import SpecialPoint as Kind
from lapwing.studies.branch.motion.curve import Place

__all__ = ["Kind", "Outcome", "Point", "Special"]


@dataclass(frozen=True, eq=False)
class Special:
    """A special point.

    Attributes
    ----------
    kind : Kind
    outcome : Outcome
    value : float, of the parameter
    error : float, by how much it may be off; NaN where that is not known
    words : str, what happens, in a few words
    flank : int, the flank concerned, 1 or 2; 0: none
    phase : float, mesh phase at which it happens, NaN: at none
    place : Place
    multipliers : complex array (2,), NaN where the map has no derivative
    """

    kind: Kind
    outcome: Outcome
    value: float
    error: float
    words: str
    flank: int
    phase: float
    place: Place
    multipliers: NDArray[Any]

    def __repr__(self) -> str:
        return (f"<Special {self.kind.name.lower()} at {self.value:.12g}: {self.words}, "
                f"{self.outcome.name.lower().replace('_', ' ')}>")


@dataclass(frozen=True, eq=False)
class Point:
    """A point of a branch.

    Attributes
    ----------
    value : float, of the parameter
    place : Place
    trace, det : float, of the map once round; rank : int
    multipliers : complex array (2,)
    """

    value: float
    place: Place
    trace: float
    det: float
    rank: int
    multipliers: NDArray[Any]

    @property
    def stable(self) -> bool:
        """Whether both multipliers are below one in magnitude; not where they are not known."""
        return bool(np.all(np.abs(self.multipliers) < 1))

    def monitors(self) -> dict[Kind, float]:
        """Functions that pass zero at smooth special points; NaN where there is none."""
        direction = float(self.place.tangent[-1])
        complex_pair = self.trace * self.trace < 4 * self.det
        return {Kind.FOLD: direction, Kind.BRANCH_POINT: 1 - self.trace + self.det,
                Kind.PERIOD_DOUBLING: 1 + self.trace + self.det,
                Kind.TORUS: self.det - 1 if complex_pair else math.nan}
