"""Names, units and words of the numbers that studies, result files, summaries and figures share."""

from __future__ import annotations

from typing import NamedTuple


class Parameter(NamedTuple):
    """A number of the pair or of its operation, as it is spoken of.

    Attributes
    ----------
    units : str, as UDUNITS spells them, for files
    shown : str, as a person reads them
    words : str, without the unit
    long_name : str
    """

    units: str
    shown: str
    words: str
    long_name: str


# Every number that a sweep may vary. The only table of their units.
PARAMETERS = {
    "brake_torque": Parameter("N m", "N·m", "brake torque", "brake torque on the gear"),
    "drive_torque": Parameter("N m", "N·m", "drive torque", "drive torque on the pinion"),
    "pinion_speed_rpm": Parameter("rpm", "rpm", "pinion speed", "pinion speed"),
    "pinion_speed_rad_s": Parameter("rad/s", "rad/s", "pinion speed", "pinion speed"),
    "mesh_frequency_hz": Parameter("Hz", "Hz", "mesh frequency", "mesh frequency"),
    "pinion_base_lever": Parameter("m", "m", "pinion base lever",
                                   "lever of the normal mesh force about the pinion axis"),
    "mesh_stiffness": Parameter("N/m", "N/m", "mesh stiffness", "normal mesh stiffness"),
    "mesh_damping": Parameter("N s/m", "N·s/m", "mesh damping", "normal mesh damping"),
    "backlash": Parameter("rad", "rad", "backlash", "angular backlash"),
    "pinion_inertia": Parameter("kg m2", "kg·m²", "pinion inertia",
                                "polar inertia of the pinion"),
    "gear_inertia": Parameter("kg m2", "kg·m²", "gear inertia", "polar inertia of the gear"),
    "restitution": Parameter("1", "", "restitution", "coefficient of restitution"),
    "damping_ratio": Parameter("1", "", "damping ratio", "damping ratio"),
}


def parameter(name: str) -> Parameter:
    """`Parameter` of a name; of one unknown, a bare number."""
    words = name.replace("_", " ")
    return PARAMETERS.get(name, Parameter("1", "", words, words))


# Numbers of one motion: name -> UDUNITS, long name.
NUMBERS = {
    "lyapunov_exponent": (
        "1", "largest Lyapunov exponent per unit of tau = natural_frequency * t"),
    "lyapunov_exponent_error": (
        "1", "95 % half width, or of a periodic motion the change from one repetition to the next"),
    "lyapunov_exponent_effective": (
        "1", "independent mesh cycles that would tell as much of the exponent"),
    "lyapunov_exponent_per_cycle": ("1", "largest Lyapunov exponent per mesh cycle"),
    "second_lyapunov_exponent": (
        "1", "second Lyapunov exponent per unit of tau, -inf: lost in chatter or rest"),
    "tangent_rank": (
        "1", "numbers of a deviation that are left: 2, 1 after chatter, 0 after rigid rest"),
    "near_grazes": ("1", "recorded mesh cycles with an impact too near to grazing"),
    "determinant_defect": ("1", "check: determinant of a cycle's map against its factors"),
    "sum_rule_defect": ("1", "check: determinant against impacts and time in contact"),
}
STABILITY = NUMBERS | {
    "multiplier_real": ("1", "Floquet multipliers over one repetition, real parts"),
    "multiplier_imag": ("1", "Floquet multipliers over one repetition, imaginary parts"),
}
