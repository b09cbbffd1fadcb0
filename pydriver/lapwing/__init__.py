"""Nonlinear dynamics of lapping gear pairs: engagement, separation and impacts under a brake.

Everything a study needs is here; the compiled engine is loaded at the first use.
"""

from importlib import import_module

_HOMES = {
    "TransmissionError": "transmission_error",
    "GearPair": "gear_pair",
    "Oscillator": "oscillator",
    "critical_back": "studies.critical",
    "critical_force": "linear_response",
    "critical_full": "studies.critical",
    "critical_on": "studies.critical",
    "critical_safe": "studies.critical",
    "critical_torque": "linear_response",
    "engaged_response": "linear_response",
    "lift_off_force": "rigid_contact",
    "StartGrid": "studies.critical_starts",
    "simulate": "studies.trajectory",
    "sweep": "studies.sweep",
    "find_orbit": "studies.orbit",
    "follow": "studies.orbit",
    "period_doubling": "studies.orbit",
    "cascade": "studies.orbit",
    "settled_state": "studies.orbit",
    "EventKind": "codes",
    "MotionState": "codes",
    "Status": "codes",
}
__all__ = [*_HOMES, "__version__"]


def __getattr__(name):
    if name == "__version__":
        return import_module("lapwing._build_info").VERSION
    if name not in _HOMES:
        raise AttributeError(f"module 'lapwing' has no attribute {name!r}")
    return getattr(import_module(f"lapwing.{_HOMES[name]}"), name)


def __dir__():
    return sorted(__all__)
