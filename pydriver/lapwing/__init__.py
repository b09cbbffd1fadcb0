"""Nonlinear dynamics of lapping gear pairs: engagement, separation and impacts under a brake.

Everything a study needs is here, the classes of what it gives as well: `help(lapwing.sweep)`,
`help(lapwing.Orbit)`. `data.lapwing` of a Dataset is a `LapwingAccessor`: figures, speeds, tables.
The compiled engine is loaded at the first use.
"""

from importlib import import_module

_HOMES = {
    "TransmissionError": "model.transmission_error",
    "Scales": "model.oscillator",
    "ParameterError": "model.oscillator",
    "GearPair": "model.gear_pair",
    "Oscillator": "model.oscillator",
    "critical_back": "studies.critical.run",
    "critical_force": "model.linear_response",
    "critical_full": "studies.critical.force",
    "critical_on": "studies.critical.force",
    "critical_safe": "studies.critical.run",
    "critical_torque": "model.linear_response",
    "engaged_response": "model.linear_response",
    "lift_off_force": "model.rigid_contact",
    "StartGrid": "studies.critical.starts",
    "Numerics": "engine",
    "response": "studies.response.run",
    "exponents": "studies.exponents",
    "NoOrbit": "studies.orbit",
    "load_deck": "deck.load",
    "run_deck": "run",
    "open_results": "results.file",
    "progress_bar": "progress",
    "simulate": "studies.trajectory",
    "sweep": "studies.sweep.run",
    "parameter_map": "studies.map.run",
    "open_study": "studies.map.opened",
    "branch": "studies.branch",
    "branches": "studies.branch",
    "curve": "studies.curve",
    "attractors": "studies.attractors.run",
    "attractors_along": "studies.attractors.along",
    "basins": "studies.attractors.basins",
    "ensemble": "studies.ensemble.run",
    "Draw": "model.draw",
    "find_orbit": "studies.orbit",
    "follow": "studies.orbit",
    "period_doubling": "studies.orbit",
    "cascade": "studies.orbit",
    "settled_state": "studies.orbit",
    # What these give and raise.
    "ArgumentError": "base.arguments",
    "Branch": "studies.branch",
    "CriticalForce": "model.linear_response",
    "CriticalValue": "studies.critical.value",
    "Curve": "studies.curve",
    "CycleMaps": "studies.stability",
    "Deck": "deck.deck",
    "DeckError": "deck.problems",
    "EngagedResponse": "model.linear_response",
    "Exponents": "studies.stability",
    "Followed": "studies.orbit",
    "HybridState": "studies.trajectory",
    "LapwingAccessor": "accessor",
    "LiftOff": "model.rigid_contact",
    "Load": "model.oscillator",
    "MeanRotation": "model.oscillator",
    "Meeting": "studies.curve",
    "Multipliers": "studies.stability",
    "Orbit": "studies.orbit",
    "Outcome": "run",
    "Point": "studies.branch.special",
    "Results": "results.file",
    "Run": "studies.trajectory",
    "Special": "studies.branch.special",
    # Codes.
    "BranchOutcome": "base.codes",
    "Ending": "base.codes",
    "EventKind": "base.codes",
    "MotionState": "base.codes",
    "SearchStage": "base.codes",
    "SpecialPoint": "base.codes",
    "Status": "base.codes",
}
__all__ = [*_HOMES, "__version__"]


def __getattr__(name: str) -> object:
    if name == "__version__":
        return import_module("lapwing._build_info").VERSION
    if name not in _HOMES:
        nearest = import_module("lapwing.base.messages").nearest
        hint = "" if name.startswith("_") else f", {nearest(name, _HOMES, 3)}"
        raise AttributeError(f"module 'lapwing' has no attribute {name!r}{hint}")
    return getattr(import_module(f"lapwing.{_HOMES[name]}"), name)


def __dir__() -> list[str]:
    return sorted(__all__)
