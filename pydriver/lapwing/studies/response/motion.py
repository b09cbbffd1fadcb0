"""What a response says of its motion beyond its period: stability, confirmation, reasons."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from lapwing.base.arrivals import arrivals_of
from lapwing.base.codes import EventKind, MotionState
from lapwing.engine import columns, of_kind
from lapwing.engine.records import STROBED
from lapwing.studies.orbit import NoOrbit, find_orbit
from lapwing.studies.period import REPEAT_TOLERANCE
from lapwing.studies.stability import CycleMaps, findings

if TYPE_CHECKING:
    from lapwing.engine.numerics import Numerics
    from lapwing.model.gear_pair import GearPair
    from lapwing.model.oscillator import Oscillator
    from lapwing.studies.stability import Exponents

# Motion state that begins with an event.
BEGINS = {EventKind.RELEASE: MotionState.SEPARATION, EventKind.BACK_RELEASE: MotionState.SEPARATION,
          EventKind.ENGAGE: MotionState.ENGAGEMENT, EventKind.CHATTER_END: MotionState.ENGAGEMENT,
          EventKind.BACK_ENGAGE: MotionState.BACK_ENGAGEMENT,
          EventKind.BACK_CHATTER_END: MotionState.BACK_ENGAGEMENT}
SHARES = ("time_separated", "time_engaged", "time_back_engaged")


def shares_of_time(events: NDArray[Any], states: NDArray[Any],
                   period: float) -> dict[str, NDArray[Any]]:
    """Part of each mesh cycle spent in each motion state.

    Parameters
    ----------
    events : table (n,) of events in their order; cycles counted from the first recorded one
    states : array (n,), motion state at the beginning of each cycle
    period : float, mesh period in τ

    Returns
    -------
    dict of SHARES -> array (n,), summing to one; NaN where a state is
    """
    begins = of_kind(events, BEGINS)
    first = np.searchsorted(begins["cycle"], np.arange(len(states) + 1))
    shares = np.zeros((len(states), len(MotionState)))
    for m, state in enumerate(states):
        if np.isnan(state):
            shares[m] = np.nan
            continue
        seen = begins[first[m]:first[m + 1]]
        at = np.concatenate([[0.0], seen["t"], [period]])
        held = [int(state), *(int(BEGINS[EventKind(int(kind))]) for kind in seen["kind"])]
        np.add.at(shares[m], held, np.diff(at) / period)
    return dict(zip(SHARES, shares.T, strict=True))


def fastest_arrivals(events: NDArray[Any], cycles: int, natural_frequency: float,
                     contact_law: str) -> NDArray[Any]:
    """Largest approach speed of each mesh cycle's arrivals, rad/s; 0 without any."""
    fastest = np.zeros(cycles)
    arrivals = of_kind(events, arrivals_of(contact_law).kinds)
    np.maximum.at(fastest, arrivals["cycle"].astype(int),
                  natural_frequency * np.abs(arrivals["velocity_before"]))
    return fastest


def impact_attributes(osc: Oscillator, pair: GearPair, events: NDArray[Any],
                      mesh_force_peak: float) -> dict[str, float]:
    """Mean approach speed (rad/s) and mean energy loss (J) of an arrival, and the dynamic factor.

    The dynamic factor is the peak mesh force over the force that the torques alone would give.
    What there is not (no arrival, no energy lost in an instant, no torque, no spring) is left out.
    """
    law = arrivals_of(osc.contact_law)
    arrivals = of_kind(events, law.kinds)
    before, after = arrivals["velocity_before"], arrivals["velocity_after"]
    energy = 0.5 * pair.torsional_stiffness * (before**2 - after**2)
    static = pair.mesh_stiffness * pair.pinion_base_lever * abs(osc.force)
    found = {}
    if before.size:
        found = {"impact_speed_mean": float(pair.natural_frequency * np.abs(before).mean())}
        if law.threshold:  # the compliant law's engagements take nothing by themselves
            found["energy_per_impact"] = float(energy.mean())
    if static and math.isfinite(mesh_force_peak):
        found["dynamic_factor"] = mesh_force_peak / static
    return found


def motion_attributes(osc: Oscillator, recording: Any, period: int, max_period: int,
                      numerics: Numerics) -> dict[str, Any]:
    """Stability of a response's motion as attributes.

    1. Exponents, their checks and, where there is a period, multipliers (`stability.findings`).
    2. A period is confirmed by Newton's method from the last recorded state: the orbit found must
       have this period, and the distance to it says how far the motion has settled.
    3. Without a period, the reason.

    Parameters
    ----------
    osc : Oscillator
    recording : object with the engine's tables of the recorded cycles, `cycles` (n,) and
        `tangent` (n,), or None there: nothing was wanted
    period, max_period : int
    numerics : Numerics, of the response

    Returns
    -------
    dict
        The names of `quantities.NUMBERS`; `multiplier_real` and `multiplier_imag` (2,),
        `orbit_period` (0: no orbit found) and `orbit_distance` (part of the motion's size, of an
        orbit found) where there is a period, else `aperiodic_reason`; `stability_warning` where
        there is one.
    """
    if recording.tangent is None:
        return {}
    states = columns(recording.cycles, STROBED)
    depth = recording.cycles["deepest_separation"].max()
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


def _confirmation(osc: Oscillator, state: NDArray[Any], period: int, scale: float,
                  numerics: Numerics) -> dict[str, Any]:
    """Period of the orbit that Newton's method finds from a state, and the distance to it."""
    try:
        orbit = find_orbit(osc, (int(state[0]), *state[1:]), period, numerics=numerics)
    except NoOrbit:
        return {"orbit_period": 0}
    return {"orbit_period": orbit.cycles,
            "orbit_distance": float(np.abs(orbit.state[1:] - state[1:]).max() / scale)}


def why_aperiodic(found: Exponents, max_period: int, apart: float) -> str:
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
