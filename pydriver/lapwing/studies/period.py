"""The period of a motion in mesh cycles, from its stroboscopic section (decision m)."""

from __future__ import annotations

import numpy as np

MAX_PERIOD = 24
NO_PERIOD = 0

# Strobed states repeat when they agree to this part of the motion's size.
REPEAT_TOLERANCE = 1e-8
# Differences this small need not fall any further: the last bits of a state move the adaptive
# steps, and those move the cycles of a settled motion by up to some 1e-11 of its size.
NOISE_FLOOR = 1e-10


def find_period(phi, phi_dot, labels, scale, max_period=MAX_PERIOD):
    """Smallest number of cycles after which a motion repeats.

    1. For p = 1, 2, … take the differences of states p cycles apart over the last max(2p, 8)
       such pairs. All must be within REPEAT_TOLERANCE·scale, and the labels must agree.
    2. A slow transient is no period. Differences above the noise are taken as a geometric series
       whose ratio the whole record shows; what it still sums to must be within the tolerance too.
       (A decaying flip with multiplier -0.9999 repeats to 1e-8 after two cycles while it is 1e-5
       away from its period 1.)

    Parameters
    ----------
    phi, phi_dot : array (n,), strobed states of consecutive cycles, rad and rad per τ
    labels : array (n, m), what must match besides: motion state, numbers of events by kind
    scale : float, rad, > 0; max(|F|, deepest separation)
    max_period : int

    Returns
    -------
    int; NO_PERIOD where none up to max_period is found
    """
    states = np.column_stack([phi, phi_dot])
    if not np.all(np.isfinite(states)):
        return NO_PERIOD
    for p in range(1, max_period + 1):
        pairs = max(2 * p, 8)
        if len(states) < pairs + p:
            break
        difference = np.max(np.abs(states[p:] - states[:-p]), axis=1) / scale
        if _remaining(difference, pairs, p) <= REPEAT_TOLERANCE \
                and np.array_equal(labels[p:][-pairs:], labels[:-p][-pairs:]):
            return p
    return NO_PERIOD


def _remaining(difference, pairs, p):
    """How far a motion still is from repeating after p cycles, from its differences."""
    last = np.max(difference[-pairs:])
    if last <= NOISE_FLOOR:
        return last
    half = len(difference) // 2
    early, late = np.max(difference[:half]), np.max(difference[half:])
    ratio = (late / early) ** (p / half)
    return last / (1 - ratio) if ratio < 1 else np.inf


def motion_class(period, drive, coast, chatter):
    """`p:(i,j)`, i and j impacts counted at the drive and the coast flank in p cycles.

    Parameters
    ----------
    period : int, NO_PERIOD: aperiodic
    drive, coast : array (n,), counted impacts of each cycle, n >= period
    chatter : bool, whether a chatter was complete; marked `c`, for the count then hangs on its
        threshold

    Returns
    -------
    str
    """
    if not period:
        return "aperiodic" + " c" * bool(chatter)
    i, j = (int(np.sum(counts[-period:])) for counts in (drive, coast))
    return f"{period}:({i},{j})" + "c" * bool(chatter)
