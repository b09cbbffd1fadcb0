"""What a response says of its motion beyond its period: stability, confirmation, reasons."""

from __future__ import annotations

import math

import numpy as np

from lapwing.engine import CYCLE_NAMES
from lapwing.studies.orbit import NoOrbit, find_orbit
from lapwing.studies.period import REPEAT_TOLERANCE
from lapwing.studies.stability import CycleMaps, findings

SECTION = [CYCLE_NAMES.index(name) for name in ("motion_state", "phi", "phi_dot")]


def motion_attributes(osc, recording, period, max_period, numerics):
    """Stability of a response's motion as attributes.

    1. Exponents, their checks and, where there is a period, multipliers (`stability.findings`).
    2. A period is confirmed by Newton's method from the last recorded state: the orbit found must
       have this period, and the distance to it says how far the motion has settled.
    3. Without a period, the reason.

    Parameters
    ----------
    osc : Oscillator
    recording : object with the engine's lines of the recorded cycles, `cycles` (n, 17) and
        `tangent` (n, 13), or None there: nothing was wanted
    period, max_period : int
    numerics : Numerics, of the response

    Returns
    -------
    dict
        The names of `stability_names.NUMBERS`; `multiplier_real` and `multiplier_imag` (2,),
        `orbit_period` (0: no orbit found) and `orbit_distance` (part of the motion's size, NaN)
        where there is a period, else `aperiodic_reason`; `stability_warning` where there is one.
    """
    if recording.tangent is None:
        return {}
    states = recording.cycles[:, SECTION]
    depth = recording.cycles[:, CYCLE_NAMES.index("deepest_separation")].max()
    scale = max(abs(osc.force), depth) or osc.backlash
    numbers, found = findings(CycleMaps.from_rows(recording.tangent, osc.period), osc, period,
                              scale)
    values = numbers.pop("multipliers")
    if period:
        numbers |= {"multiplier_real": values.real, "multiplier_imag": values.imag,
                    **_confirmation(osc, states[-1], period, scale, numerics)}
    else:
        apart = np.abs(states[-1] - states[max(0, len(states) - 1 - max_period):-1])[:, 1:]
        numbers["aperiodic_reason"] = why_aperiodic(
            found, max_period, float(np.min(apart.max(axis=1), initial=scale)) / scale)
    return numbers | ({"stability_warning": found.warning} if found.warning else {})


def _confirmation(osc, state, period, scale, numerics):
    """Period of the orbit that Newton's method finds from a state, and the distance to it."""
    try:
        orbit = find_orbit(osc, (int(state[0]), *state[1:]), period, numerics=numerics)
    except NoOrbit:
        return {"orbit_period": 0, "orbit_distance": math.nan}
    return {"orbit_period": orbit.cycles,
            "orbit_distance": float(np.abs(orbit.state[1:] - state[1:]).max() / scale)}


def why_aperiodic(found, max_period, apart):
    """Why no period was found, in words.

    Parameters
    ----------
    found : Exponents of the motion
    max_period : int, longest period looked for
    apart : float, least difference of the last cycle's state from an earlier one, of its size

    Returns
    -------
    str
    """
    rate, error = found.per_cycle
    if math.isfinite(error) and rate - error > 0:
        return "chaos: nearby motions part"
    if (math.isfinite(error) and rate + error < 0) or rate == -math.inf:
        words = f"not chaos, for deviations die out: longer than {max_period} mesh cycles"
        if -math.inf < rate < 0 and apart > REPEAT_TOLERANCE:
            more = math.log(REPEAT_TOLERANCE / apart) / rate
            words += f", or not settled, which would take some {more:.2g} more"
        return words
    return f"undecided: neither a period up to {max_period} mesh cycles nor a sign of the exponent"
