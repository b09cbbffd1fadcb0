"""Critical values by a balance of forces: `critical_full`, complete engagement; `critical_on`."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lapwing.base import arguments
from lapwing.model.gear_pair import GearPair
from lapwing.model.linear_response import critical_force
from lapwing.model.rigid_contact import LiftOff, lift_off_force
from lapwing.model.transmission_error import TransmissionError
from lapwing.studies.critical.checks import SAFE_ENDS, checked_pair, scan_attributes, scan_order
from lapwing.studies.critical.value import CriticalValue, found
from lapwing.studies.labels import settings
from lapwing.studies.sweep.varied import TORQUES, oscillator_at

if TYPE_CHECKING:
    from lapwing.model.oscillator import Oscillator

# Why no value is found, besides the reasons of `LiftOff`.
RESONANCE = "resonance"


@arguments.complete(operation=GearPair.oscillator, varied="parameter")
def critical_full(pair: GearPair, te: TransmissionError, *, parameter: str = "brake_torque",
                  values: ArrayLike | None = None, safe_end: str = "high",
                  **operation: Any) -> CriticalValue:
    """Value from which on the engaged motion keeps contact: F > F_crit.

    Along a torque F is linear and F_crit constant: a closed form, for any transmission error, to
    rounding. Along another parameter `values` is scanned from its safe end to the first at which
    contact is lost, and F = F_crit is solved in that bracket by Brent's method, to rounding.
    Motions beside the engaged one are not looked at: `critical_safe`.

    Parameters
    ----------
    pair : GearPair
    te : TransmissionError
    parameter : str, as for `lapwing.sweep`
    values : array (n,), needed where the parameter is no torque
    safe_end : 'high' or 'low', the end of `values` at which contact is kept
    **operation : the other arguments of `GearPair.oscillator`

    Returns
    -------
    CriticalValue: value, low and high, `why` there is none, and `data`, a Dataset without variables
    for a torque, else, `parameter` being the unit of the parameter:

    (trial): trial_value [parameter], trial_margin [rad]

    trial_margin is F - F_crit. Attributes: find, parameter, outcome ('found', 'safe_throughout',
    'unsafe_throughout', 'resonance': undamped, no engaged response exists), estimate, bar (of the
    parameter; a bar of 0 is rounding), phase (mesh periods, where contact is lost first), and what
    was fixed.

    Raises
    ------
    ValueError
        for refused arguments, the oscillator's own refusals included, the rigid law among them.
    """
    return of_force("full", critical_force, pair, te, parameter, values, safe_end, operation)


@arguments.complete(operation=GearPair.oscillator, varied="parameter")
def critical_on(pair: GearPair, te: TransmissionError, *, parameter: str = "brake_torque",
                values: ArrayLike | None = None, safe_end: str = "high",
                **operation: Any) -> CriticalValue:
    """Value from which on a rigid tooth rests on the drive flank: F > max g''; `rigid` law only.

    Arguments, result and errors are those of `critical_full`; outcome may also be 'thrown_off' or
    'struck': no value does, because a kink at `phase` throws the tooth off or strikes it.
    """
    return of_force("on", lift_off_force, pair, te, parameter, values, safe_end, operation)


def of_force(find: str, criterion: Callable[..., Any], pair: GearPair, te: TransmissionError,
             parameter: str, values: ArrayLike | None, safe_end: str,
             operation: dict[str, Any]) -> CriticalValue:
    """Where F passes what `criterion(osc)` asks for: a force (rad) and a phase, as `CriticalForce`.

    The other arguments and the result are those of `critical_full`.
    """
    checked_pair(pair, te, parameter)
    arguments.choice("safe_end", safe_end, SAFE_ENDS)

    def at(value: float) -> Oscillator:
        return oscillator_at(pair, te, parameter, value, operation)

    if parameter in TORQUES:
        rest, unit = at(0.0), at(1.0)
        _check_law(find, rest)
        needed = _needed(criterion, rest)
        outcome = needed.reason or "found"
        value = (needed.force - rest.force) / (unit.force - rest.force) + 0.0  # -0 is 0
        known = outcome == "found"
        return found(settings(rest, pair=pair, varied=(parameter,)), find, parameter, outcome,
                     value if known else math.nan, 0.0 if known else math.nan, phase=needed.phase)
    if values is None:
        raise ValueError(f"critical: parameter = {parameter!r} is no torque; expected are values "
                         "to search")
    order = scan_order(values, safe_end)
    first = at(float(order[0]))
    _check_law(find, first)
    return _along(settings(first, pair=pair, varied=(parameter,)), find, criterion, at, parameter,
                  order, safe_end)


def _along(about: dict[str, Any], find: str, criterion: Callable[..., Any],
           at: Callable[..., Any], parameter: str, values: NDArray[Any],
           safe_end: str) -> CriticalValue:
    """The first sign change of F minus what is asked for, from the safe end on."""
    from scipy.optimize import brentq

    def margin(value: float) -> float:
        osc = at(float(value))
        return float(osc.force - _needed(criterion, osc).force)

    margins, previous = [], math.nan
    for value in values:
        margins.append(margin(value))
        if not margins[-1] > 0:
            break
        previous = value
    outcome = "safe_throughout" if margins[-1] > 0 else \
        "unsafe_throughout" if math.isnan(previous) else "found"
    estimate, lost = math.nan, _needed(criterion, at(float(values[len(margins) - 1])))
    if lost.reason:
        outcome = lost.reason
    elif outcome == "found":
        estimate = brentq(margin, value, previous, xtol=1e-300, rtol=4 * np.finfo(float).eps)
        lost = _needed(criterion, at(estimate))
    return found(about, find, parameter, outcome, estimate,
                 0.0 if outcome == "found" else math.nan,
                 {"trial_value": values[:len(margins)], "trial_margin": np.array(margins)},
                 phase=lost.phase, **scan_attributes(values, safe_end))


def _needed(criterion: Callable[..., Any], osc: Oscillator) -> LiftOff:
    """Force asked for, as a `LiftOff`; infinite at an undamped resonance, which grows for ever."""
    try:
        return LiftOff(*criterion(osc))
    except ValueError:
        return LiftOff(math.inf, math.nan, RESONANCE)


def _check_law(find: str, osc: Oscillator) -> None:
    if (osc.contact_law == "rigid") != (find == "on"):
        other = "critical_on" if osc.contact_law == "rigid" else "critical_full"
        raise ValueError(f"critical: critical_{find} does not go with contact_law = "
                         f"{osc.contact_law!r}; expected {other}")
