"""A periodic motion as equations between its events: what continuation solves.

Unknowns are phase u and speed w into the flank of each event. The arc from one event to the next
is a formula, so each event gives two equations: the tooth is at the flank, and as fast as said.
Both stay smooth, and their matrix regular, where an approach or rebound speed passes zero: a graze
is a point on a curve like any other, which an iteration over the map from cycle to cycle, whose
matrix grows as 1/w there, can only come near.

With X the distance pressed into a flank, σ = 1 at the drive flank and -1 at the coast flank,
h = g or the fixed place of a standing flank, s the length of the arc in τ:

    flight    X = σ(h_i + (h'_i + σw₊)s + F s²/2 - h_j); along one flank over s, where the
              equation of a bounce keeps its digits however short it is
    contact   X = σ(F + q_j) + E(s)(-σ(F + q_i), w₊ - σq'_i), over s; E the free oscillation
    chatter   bounce by bounce, until s = 2U/(a(1-ε)) - 4jU²/(3a³(1-ε)²) is the rest of it,
              U = -w₊, a = σ(F - h''), j = -σh'''
    rest      σ(F - h'') = 0, or the phase of a kink

w₊ is the speed after the event: -εw, under `absolute` -εw - (1+ε)σh', w where no impact law acts.
The engine has the equations and their derivatives (`engine.motions`), this module what is known at
each event.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lapwing.model.oscillator import Oscillator
from lapwing.studies.branch.motion.flank_motion import FlankMotion
from lapwing.studies.branch.motion.layout import Arc, Happening, Layout


@dataclass(frozen=True)
class Events:
    """Where a motion's events are.

    Attributes
    ----------
    phase : array (n,), mesh periods since the first cycle's beginning; may leave 0 to `cycles`
    speed : array (n,), rad per τ; into the flank, before the event
    """

    phase: NDArray[Any]
    speed: NDArray[Any]


@dataclass(frozen=True)
class AtEvents:
    """What is known at each event, arrays (n,)."""

    sign: NDArray[Any]
    h: NDArray[Any]
    response: NDArray[Any]
    after: NDArray[Any]


def at_events(layout: Layout, events: Events, osc: Oscillator, motion: FlankMotion,
              engaged: bool = True) -> AtEvents:
    """Flanks, their derivatives (6, n), response (2, n) and speeds after each event.

    The response is 0 unless asked for (`engaged`).
    """
    sign, coast = layout.sign, layout.coast
    h = motion.derivatives(events.phase, layout.piece)
    if len(coast):
        if osc.back_flank_te:
            h[0, coast] -= osc.gap_width
        else:
            h[:, coast] = 0.0
            h[0, coast] = -osc.gap_width
    response = np.zeros((2, layout.n))
    if engaged and Arc.CONTACT in layout.by_arc:
        response = motion.response(events.phase, layout.piece)
        if not osc.back_flank_te:
            response[:, coast] = 0.0
    after = events.speed.copy()
    if osc.contact_law != "compliant":
        struck = layout.arrivals | ((layout.kind == Happening.AT_KINK) & (events.speed > 0))
        after *= np.where(struck, -osc.restitution, 1.0)
        if osc.impact_law == "absolute":
            after += np.where(struck, -(1 + osc.restitution) * sign, 0.0) * h[1]
    if layout.chatters:
        ended = layout.kind == Happening.CHATTER_END
        after[ended] = 0.0
    return AtEvents(sign, h, response, after)


def pressing(known: AtEvents, osc: Oscillator) -> NDArray[Any]:
    """Acceleration into its flank at each event, without contact force: σ(F - h'')."""
    press: NDArray[Any] = known.sign * (osc.force - known.h[2])
    return press
