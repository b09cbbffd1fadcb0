"""What is found on a branch: points, special points, and what they are called."""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import IntEnum
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lapwing.studies.branch.motion.curve import Place


class Kind(IntEnum):
    """What happens at a special point of a branch.

    FOLD, PERIOD_DOUBLING, TORUS, BRANCH_POINT: a multiplier, or a pair, has magnitude one.
    GRAZING: a flight touches a flank, or an impact comes to nothing.
    RELEASE: a contact touches its end from inside, or a flight behind a release comes to nothing.
    REBOUND: the speed after an impact passes zero.
    CHATTER: bounces no longer die out.
    KINK: an impact comes upon a kink of the transmission error.
    KNOT: an event passes a place where the curvature alone jumps; this is no bifurcation.
    LIMIT: the end of the range asked for. CLOSED: the branch comes back to where it began.
    POINTS: as many points as were asked for. UNRESOLVED: what ends it was not found out.
    """

    FOLD = 1
    PERIOD_DOUBLING = 2
    TORUS = 3
    BRANCH_POINT = 4
    GRAZING = 5
    RELEASE = 6
    REBOUND = 7
    CHATTER = 8
    KINK = 9
    KNOT = 10
    LIMIT = 11
    CLOSED = 12
    POINTS = 13
    UNRESOLVED = 14


class Outcome(IntEnum):
    """What becomes of the branch there: it goes on the same way, turns back, or ends."""

    PERSISTS = 1
    TURNS_BACK = 2
    ENDS = 3


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
