"""When a rigid tooth rests on the drive flank: while F - g'' presses it, and no kink moves it."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from lapwing.base import arguments
from lapwing.model.linear_response import flank_harmonics, series_steps
from lapwing.model.linear_steps import least_value
from lapwing.model.oscillator import Oscillator

# Why no force keeps contact.
THROWN_OFF, STRUCK = "thrown_off", "struck"


class LiftOff(NamedTuple):
    """Smallest force that keeps a rigid tooth on the drive flank.

    Attributes
    ----------
    force : float, rad; max g'', infinite where no force does
    phase : float, mesh periods; where contact is lost first
    reason : '' or, where no force does, 'thrown_off' (a kink where the flank's slope falls behind
        the tooth) or 'struck' (a kink where it hits the tooth, which bounces)
    """

    force: float
    phase: float
    reason: str = ""


@arguments.complete()
def lift_off_force(osc: Oscillator) -> LiftOff:
    """Smallest mean force F at which a rigid tooth that rests on the drive flank stays there.

    It rests while the flank presses it, F > g'' (docs/model.md, `contact_law` 'rigid').  At a kink
    with Δg' > 0 the flank falls away from under it at any force; one with Δg' < 0 strikes it, and
    with a restitution above 0 it bounces.

    Parameters
    ----------
    osc : Oscillator; its own force and contact law are not used

    Returns
    -------
    LiftOff

    Raises
    ------
    TypeError
        where `osc` is none.
    """
    arguments.instance("osc", osc, Oscillator)
    jumps = osc.flank_scale * osc.te.slope_jumps()
    for reason, where in ((THROWN_OFF, jumps > 0), (STRUCK, (jumps < 0) & (osc.restitution > 0))):
        if where.any():
            worst = int(np.argmax(np.where(where, np.abs(jumps), -math.inf)))
            return LiftOff(math.inf, float(osc.te.knots[worst]), reason)
    least, phase = least_value(*_minus_acceleration(osc))
    return LiftOff(-least, phase)


def _minus_acceleration(osc: Oscillator) -> tuple[NDArray[Any], NDArray[Any]]:
    """Step ends and -g'' (rad per τ²) on each step: of the harmonics, else of the table."""
    if len(osc.te.harmonics):
        order, amplitude = flank_harmonics(osc)
        return series_steps(order, (order * osc.mesh_frequency_ratio) ** 2 * amplitude)
    width = np.diff(osc.te.knots)
    power = np.arange(4)
    factor = -(power + 1) * (power + 2) * osc.flank_scale / osc.period**2
    return osc.te.knots, osc.te.coefficients[:, 2:] * factor * width[:, None] ** power
