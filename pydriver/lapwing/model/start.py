"""Which starts contradict their motion state (decision e of docs/model.md), and by how much."""

from __future__ import annotations

import math
import sys

import numpy as np
from numpy.typing import NDArray

from lapwing.model.oscillator import Oscillator

# An angle is known to so many units of the last place of the largest angle it is computed from.
# A state is θ - g by Runge-Kutta and a response plus a free oscillation in closed form; a handful
# of roundings each, and the interpolation inside a step adds some twenty terms.
ROUNDINGS = 64


def rounding(osc: Oscillator) -> float:
    """What rounding leaves uncertain in φ near a flank, rad.

    φ = θ - g and φ = response + free oscillation are differences of angles as large as the static
    deflection F, the flank's motion and the gap; φ near a flank cannot be known better than
    `ROUNDINGS` units of the last place of these.
    """
    gap = osc.gap_width if math.isfinite(osc.gap_width) else osc.backlash
    largest = abs(osc.force) + max(map(abs, osc.flank_extrema)) + gap
    return ROUNDINGS * sys.float_info.epsilon * largest


def coast_flank(osc: Oscillator, phase: float) -> float:
    """φ of the coast flank at a mesh phase, rad; minus infinity where there is none."""
    return float(coast_flanks(osc, np.array(phase)))


def coast_flanks(osc: Oscillator, phases: NDArray[np.float64]) -> NDArray[np.float64]:
    """The same at many mesh phases, an array of their shape."""
    depth = np.full(phases.shape, -osc.gap_width)
    return depth if osc.back_flank_te else depth - osc.flank_scale * osc.te.value(phases)


def start_problem(osc: Oscillator, state: str, phi: float, phase: float) -> str | None:
    """What a start in `state` would have to be, or None where it is.

    Parameters
    ----------
    osc : Oscillator
    state : 'separation', 'engagement' or 'back_engagement'
    phi : float, rad
    phase : float, mesh phase
    """
    depth, slack = coast_flank(osc, phase), rounding(osc)
    if state == "separation" and not depth - slack <= phi <= slack:
        return f"separation lies between {depth:.6g} and 0"
    if state == "engagement" and (phi < -slack or (osc.contact_law == "rigid" and phi > slack)):
        return "engagement means phi >= 0 (rigid: phi = 0)"
    if state == "back_engagement" and math.isinf(depth):
        return "there is no coast flank (gap = 'one_flank')"
    if state == "back_engagement" and phi > depth + slack:
        return f"back engagement means phi <= {depth:.6g}"
    return None


def put_on_flank(osc: Oscillator, state: str, phi: float, phase: float) -> float:
    """φ of a start that `start_problem` lets pass: on the flank where rounding put it beyond."""
    depth = coast_flank(osc, phase)
    if state == "separation":
        return min(max(phi, depth), 0.0)
    if state == "engagement":
        return 0.0 if osc.contact_law == "rigid" else max(phi, 0.0)
    return min(phi, depth)
