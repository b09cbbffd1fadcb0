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
# A difference fades when the means of two quarters of the record fall by more than this: of the
# motion's size, what noise leaves of a mean of some 25 cycles with a margin of three, and of
# itself, so that the last steps of a transient are not taken for it.
FADING, FADING_PART = 1e-11, 1e-5


def find_period(phi, phi_dot, labels, scale, max_period=MAX_PERIOD):
    """Smallest number of cycles after which a motion repeats.

    1. For p = 1, 2, … take the differences of states p cycles apart over the last max(2p, 8)
       such pairs. All must be within REPEAT_TOLERANCE·scale, and the labels must agree.
    2. A slow transient is no period. Differences above the noise are taken as a geometric series
       whose ratio the whole record shows; what it still sums to must be within the tolerance
       too. (Where they alternate that is less than the last of them.)
    3. A decaying flip is no period 2: while a multiplier is -0.9999 states two cycles apart
       agree to the last bits, those one cycle apart do not. Where the differences at a divisor of
       p still fade, p and its multiples are refused.

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
    states = np.column_stack([phi, phi_dot]) / scale
    if not np.all(np.isfinite(states)):
        return NO_PERIOD
    fading = set()
    for p in range(1, max_period + 1):
        pairs = max(2 * p, 8)
        if len(states) < pairs + p:
            break
        if _remaining(states[p:] - states[:-p], pairs, p) <= REPEAT_TOLERANCE \
                and np.array_equal(labels[p:][-pairs:], labels[:-p][-pairs:]):
            fading |= {q for q in range(1, p) if p % q == 0 and _fades(states, q, p)}
            if all(p % q for q in fading):
                return p
    return NO_PERIOD


def _remaining(steps, pairs, p):
    """How far a motion still is from repeating after p cycles, from its steps over p cycles."""
    difference = np.max(np.abs(steps), axis=1)
    last = np.max(difference[-pairs:])
    if last <= NOISE_FLOOR:
        return last
    half = len(difference) // 2
    early, late = np.max(difference[:half]), np.max(difference[half:])
    ratio = (late / early) ** (p / half)
    if np.sum(steps[p:][-pairs:] * steps[:-p][-pairs:]) < 0:
        return last
    return last / (1 - ratio) if ratio < 1 else np.inf


def _fades(states, q, p):
    """Whether the differences of states q cycles apart, seen every p cycles, still die out."""
    difference = np.max(np.abs(states[q:] - states[:-q]), axis=1)
    quarter = max(len(difference) // (4 * p), 1) * p
    if len(difference) < 2 * quarter:
        return False
    before, now = np.mean(difference[-2 * quarter:-quarter]), np.mean(difference[-quarter:])
    return before - now > max(FADING, FADING_PART * now)


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
