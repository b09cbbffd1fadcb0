"""The period of a motion in mesh cycles, from its stroboscopic section (decision m)."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from lapwing import engine

MAX_PERIOD = 24
NO_PERIOD = 0
# Strobed states repeat when they agree to this part of the motion's size (period.f90).
REPEAT_TOLERANCE = 1e-8
# Columns of the cycle table that must match between cycles of a periodic motion: the strobed
# motion state, counted impacts, releases, engages and chatter ends. Resolved chatter impacts are
# left out: how many are listed before a chatter is summed is a matter of the last bit.
LABELS = ("motion_state", "counted_impacts", "counted_back_impacts", "releases", "back_releases",
          "engages", "back_engages", "chatter_ends", "back_chatter_ends")


def find_period(phi: NDArray[Any], phi_dot: NDArray[Any], labels: NDArray[Any], scale: float,
                max_period: int = MAX_PERIOD) -> int:
    """Smallest number of cycles after which a motion repeats (docs/model.md, decision m).

    Parameters
    ----------
    phi, phi_dot : array (n,), strobed states of consecutive cycles, rad and rad per τ
    labels : array (n, m), what must match besides: motion state, numbers of events by kind
    scale : float, rad, > 0; max(|F|, deepest separation)
    max_period : int, up to 10,000

    Returns
    -------
    int; NO_PERIOD where none up to max_period is found
    """
    return int(engine.find_period(phi, phi_dot, labels, scale, max_period))


def motion_class(period: int, drive: NDArray[Any], coast: NDArray[Any], chatter: bool) -> str:
    """Class of a motion from the counts of each of its cycles, as `class_name`.

    Parameters
    ----------
    period : int, NO_PERIOD: aperiodic
    drive, coast : array (n,), arrivals at the drive and the coast flank in each cycle, n >= period
    chatter : bool, whether a chatter was complete
    """
    i, j = (int(np.sum(counts[-period:])) if period else 0 for counts in (drive, coast))
    return class_name(period, i, j, chatter)


def class_name(period: Any, drive: Any, coast: Any, chatter: Any) -> str:
    """`p:(i,j)`, i and j arrivals at the drive and the coast flank in p cycles; or `no period`.

    Of a motion in which a chatter was complete, `p:(i,j)c` or `no period (complete chatter)`, it
    depends on the threshold which of its impacts count.

    Parameters
    ----------
    period, drive, coast : int, NO_PERIOD: aperiodic
    chatter : bool
    """
    if not period:
        return "no period" + " (complete chatter)" * bool(chatter)
    return f"{period}:({drive},{coast})" + "c" * bool(chatter)
