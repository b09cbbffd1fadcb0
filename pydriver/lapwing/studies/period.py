"""The period of a motion in mesh cycles, from its stroboscopic section (decision m)."""

from __future__ import annotations

import numpy as np

MAX_PERIOD = 24
NO_PERIOD = 0

# Strobed states repeat when they agree to this part of the motion's size.
REPEAT_TOLERANCE = 1e-8
# Differences this small are rounding; they need not stop falling.
ROUNDING_FLOOR = 1e-11
# Differences whose later half is this much smaller than the earlier half are still falling.
FALLING = 0.5


def find_period(phi, phi_dot, labels, scale, max_period=MAX_PERIOD):
    """Smallest number of cycles after which a motion repeats.

    1. For p = 1, 2, … take the differences of states p cycles apart over the last max(2p, 8)
       such pairs.
    2. A slow transient is no period: where the differences of p, or of a divisor of p, are still
       falling, nothing is decided.
    3. The motion has period p when all these differences are within REPEAT_TOLERANCE·scale and
       the labels of the cycles agree.

    Parameters
    ----------
    phi, phi_dot : array (n,), strobed states of consecutive cycles, rad and rad per τ
    labels : array (n, m), what must match besides: motion state, numbers of events by kind
    scale : float, rad; max(|F|, deepest separation)
    max_period : int

    Returns
    -------
    int; NO_PERIOD where none up to max_period is found
    """
    states = np.column_stack([phi, phi_dot])
    if not np.all(np.isfinite(states)):
        return NO_PERIOD
    falling = set()
    for p in range(1, max_period + 1):
        pairs = max(2 * p, 8)
        if len(states) < pairs + p:
            break
        difference = np.max(np.abs(states[p:] - states[:-p])[-pairs:], axis=1)
        early, late = np.max(difference[:pairs // 2]), np.max(difference[pairs // 2:])
        if ROUNDING_FLOOR * scale < late < FALLING * early:
            falling.add(p)
            continue
        if any(p % q == 0 for q in falling):
            continue
        if max(early, late) <= REPEAT_TOLERANCE * scale \
                and np.array_equal(labels[p:][-pairs:], labels[:-p][-pairs:]):
            return p
    return NO_PERIOD
