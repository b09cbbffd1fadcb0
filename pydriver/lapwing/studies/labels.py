"""Under what a study ran, as attributes of its result."""

from __future__ import annotations

from collections.abc import Collection
from typing import TYPE_CHECKING, Any

from lapwing.model.gear_pair import GearPair
from lapwing.studies.sweep.varied import OF_CURVE, OF_PAIR

if TYPE_CHECKING:
    from lapwing.deck.deck import Asked, Deck
    from lapwing.engine.numerics import Numerics
    from lapwing.model.oscillator import Oscillator

LAWS = ("contact_law", "impact_law", "gap", "te_sign", "te_scale", "degrees_of_freedom",
        "gear_ratio", "damping_ratio", "restitution", "backlash")
# What follows from others; of oscillators that differ in anything nothing is said of these.
DERIVED = ("force", "mesh_frequency_ratio", "gap_width")
# Numbers of a pair that its natural frequency does not follow from.
NO_FREQUENCY = {"backlash", "restitution", "damping_ratio", "mesh_damping"}


def settings(osc: Oscillator, numerics: Numerics | None = None, *, pair: GearPair | None = None,
             varied: Collection[str] = ()) -> dict[str, Any]:
    """Everything that was the same throughout a study, by the names of the arguments.

    Parameters
    ----------
    osc : Oscillator, one of those that ran
    numerics : Numerics or None, how they ran
    pair : GearPair or None, which it was made from
    varied : what was varied, of which nothing is said

    Returns
    -------
    dict
        contact_law, impact_law, gap, te_sign: text; te_scale, degrees_of_freedom, back_flank_te (0
        or 1), restitution, backlash (rad), damping_ratio, gear_ratio; the other numbers of the pair
        and its natural_frequency (rad/s); brake_torque, and drive_torque where one was given (N·m);
        the speed as it was given; balanced: 1 where the driving torque follows the braking torque.
        Where nothing is varied force (rad), mesh_frequency_ratio and gap_width (rad). The fields of
        `Numerics`. What is not known is left out.
    """
    told: dict[str, Any] = {name: getattr(osc, name) for name in LAWS if name != "damping_ratio"
                            or not varied or pair is None or pair.mesh_damping is None}
    told |= osc.operation | {"back_flank_te": int(osc.back_flank_te)}
    told |= {name: value for name, value in (vars(pair) if pair else {}).items()
             if value is not None and name not in told}
    if "brake_torque" in told:
        told["balanced"] = int("drive_torque" not in told)
    if osc.scales is not None and not set(varied) & (set(OF_PAIR) - NO_FREQUENCY):
        told["natural_frequency"] = osc.scales.natural_frequency
    if not varied:
        told |= {name: getattr(osc, name) for name in DERIVED}
    if numerics is not None:
        told |= {name: value for name, value in vars(numerics).items()
                 if value is not None and name != "copy_repeats"}
    unsaid = {*varied, *(OF_CURVE if set(varied) & set(OF_CURVE) else ())}
    return {name: value for name, value in told.items() if name not in unsaid}


def own_operation(deck: Deck, study: Asked) -> dict[str, int]:
    """Whether a study differs from what its deck gives to all, as an attribute.

    Parameters
    ----------
    deck : lapwing.deck.Deck
    study : lapwing.deck.Response, Sweep or Critical

    Returns
    -------
    dict of own_operation: 1 where anything but the braking torque (of a search for a critical
    value: anything) differs from what the deck gives to all its studies
    """
    return {"own_operation": int(_own(deck, study))}


def _own(deck: Deck, study: Asked) -> bool:
    """Whether a study sets torques or a speed of its own."""
    if hasattr(study, "own_operation"):
        return bool(study.own_operation)
    shared = {key: value for key, value in deck.operation.items() if key != "brake_torque"}
    own = {key: value for key, value in study.operation.items() if key != "brake_torque"}
    parameter: Any = getattr(study, "parameter", None)
    return {**own, parameter: None} != {**shared, parameter: None}
