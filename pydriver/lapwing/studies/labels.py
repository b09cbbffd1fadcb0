"""Under which laws and torques a study ran, as attributes that its report needs."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from lapwing.deck.deck import Asked, Deck


def labels(deck: Deck, study: Asked) -> dict[str, Any]:
    """Attributes that tell under what a study of a deck ran.

    Parameters
    ----------
    deck : lapwing.deck.Deck
    study : lapwing.deck.Response, Sweep or Critical

    Returns
    -------
    dict
        contact_law, impact_law, gap: text; balanced: 1 where the driving torque follows the
        braking torque; own_operation: 1 where anything but the braking torque (of a search for a
        critical value: anything) differs from what the deck gives to all its studies;
        brake_torque (N·m) where it is the same throughout the study.
    """
    operation = study.operation
    torque = {} if operation.get("brake_torque") is None \
        or getattr(study, "parameter", "") == "brake_torque" \
        else {"brake_torque": float(operation["brake_torque"])}
    return torque | {
        **{key: operation[key] for key in ("contact_law", "impact_law", "gap")},
        "balanced": int(operation.get("drive_torque") is None
                        and getattr(study, "parameter", "") != "drive_torque"),
        "own_operation": int(_own(deck, study))}


def _own(deck: Deck, study: Asked) -> bool:
    """Whether a study sets torques or a speed of its own."""
    if hasattr(study, "own_operation"):
        return bool(study.own_operation)
    shared = {key: value for key, value in deck.operation.items() if key != "brake_torque"}
    own = {key: value for key, value in study.operation.items() if key != "brake_torque"}
    parameter: Any = getattr(study, "parameter", None)
    return {**own, parameter: None} != {**shared, parameter: None}
