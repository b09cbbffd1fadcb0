"""The keys of a deck: type, unit, range, default and meaning of each, in one place.

Validation, the template, the reference page and `used.nml` are all made from these classes.  The
ranges are wide: they catch a slip of unit or exponent, not an unusual gear.
"""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from lapwing.base.registry import STUDIES as REGISTERED
from lapwing.deck.declare import (
    BIG,
    OPERATION,
    SPEEDS,
    Group,
    KeyType,
    OperationKeys,
    fields,
    key,
    parameter_text,
)
from lapwing.deck.keys.draw import DrawKeys


class GearPairKeys(Group):
    """The two wheels and the mesh between them."""

    title = "the two wheels and the mesh between them"
    exclusive = (("damping_ratio", "mesh_damping"),)

    pinion_teeth: int = key(text="Z1, teeth of the pinion", example=25, ge=1, le=1000)
    gear_teeth: int = key(text="Z2, teeth of the gear", example=32, ge=1, le=1000)
    pinion_inertia: float = key(text="J1, polar inertia of the pinion and its shaft",
                                unit="kg·m²", example=0.0078, ge=1e-12, le=1e6)
    gear_inertia: float = key(text="J2, polar inertia of the gear and its shaft",
                              unit="kg·m²", example=0.026, ge=1e-12, le=1e6)
    pinion_base_lever: float = key(text="r_m1·n_mt, lever of the normal tooth force about the "
                                   "pinion axis", unit="m", example=0.034, ge=1e-6, le=100)
    mesh_stiffness: float = key(text="k', mean stiffness of the mesh along the normal",
                                unit="N/m", example=3.12e8, ge=1, le=1e15)
    backlash: float = key(text="θ0, angular play of the relative angle θ1 - i12·θ2; what the "
                          "pinion can be turned, the gear held", unit="rad", example=0.002,
                          ge=1e-9, le=1)
    restitution: float | None = key(None, "ε, coefficient of restitution; needed unless "
                                    "contact_law = 'compliant', which does not use it",
                                    example=0.8, ge=0, le=1)
    damping_ratio: float | None = key(None, "ξ, damping ratio of the mesh", example=0.1,
                                      ge=0, le=100)
    mesh_damping: float | None = key(None, "c', damping of the mesh along the normal",
                                     "N·s/m", 10600.0, ge=0, le=1e12)


class TransmissionErrorKeys(Group):
    """The transmission error over one mesh period."""

    title = "the transmission error Δφ over one mesh period"
    exclusive = (("file", "parabola_amplitude", "harmonic_amplitude"),)

    file: str | None = key(None, "CSV table, relative to the deck (section \"The file of the "
                           "transmission error\")", example="te_25x32.csv", min_length=1)
    parabola_amplitude: float | None = key(
        None, "A of the kinked parabola -4·A·(phase - 1/2)²", "rad", 125e-6, ge=-1, le=1)
    harmonic_amplitude: list[Annotated[float, Field(ge=-1, le=1)]] | None = key(
        None, "amplitudes of the series Σ amplitude·cos(2π·order·phase + shift)", "rad",
        [17e-6, 4.5e-6, 1.5e-6], min_length=1, max_length=100)
    harmonic_shift: list[Annotated[float, Field(ge=-100, le=100)]] | None = key(
        None, "shift of each harmonic; left out: 0", "rad", [0.0, 1.0, 2.0], min_length=1)
    harmonic_order: list[Annotated[int, Field(ge=0, le=200)]] | None = key(
        None, "order of each harmonic, each once; left out: 1, 2, 3, …", "", [1, 2, 3],
        min_length=1)
    harmonics: int | None = key(
        None, "orders of the mesh in the curve fitted to a file's samples by least squares, kinks "
        "kept (section \"Measured curves\"); left out, and without smoothing: no fit, the curve "
        "passes through every sample", "", 4, ge=1, le=200)
    smoothing: bool = key(False, "whether a smoothing spline is fitted to a file's samples, kinks "
                          "kept; how smooth, cross-validation or noise_level decides")
    noise_level: float | None = key(None, "standard deviation of a sample; left out: estimated "
                                    "from the residuals of the fit", "rad", 2e-6, gt=0, le=1)
    curve_repeats: int | None = key(
        None, "other curves, as samples with the same noise might give them, on which each T_safe "
        "and each &response is found again; 0: none; left out: 39 where a curve is fitted", "", 39,
        ge=0, le=1000)
    te_sign: Literal["printed", "geometric"] = key(
        "printed", "sign of the drive flank's motion g = ±i12·Δφ (i12 = Z2/Z1): 'geometric' is -, "
        "right where Δφ > 0 means that the gear is ahead, and for angle pairs (φ1, φ2); 'printed' "
        "is +, for the opposite count and for the published 25 × 32 example")


class SceneKeys(Group):
    """What the model assumes about contact."""

    title = "what is assumed about contact (docs/model.md, sections 4 to 6)"

    contact_law: Literal["restitution", "compliant", "rigid"] = key(
        "restitution", "'restitution' (of the published 25 × 32 example): bounces, then spring and "
        "damper; 'compliant': spring and damper only; 'rigid': bounces, then no give at all")
    impact_law: Literal["relative", "absolute"] = key(
        "relative", "'relative', the physical law: restitution of the velocity relative to the "
        "flank; 'absolute': of the tooth's own velocity, as the published 25 × 32 example prints "
        "it (with contact_law 'restitution' only)")
    gap: Literal["one_sided", "symmetric", "one_flank"] = key(
        "one_sided", "'one_sided', the usual choice: flanks at φ = 0 and -θ0; 'symmetric', where "
        "θ0 is half of the play: at 0 and -2·θ0; 'one_flank': the drive flank alone")
    back_flank_te: bool = key(True, "whether the coast flank moves with the transmission error, "
                              "too")
    degrees_of_freedom: int = key(
        1, "1: the relative angle of the wheels; 2: their mean rotation as well, which a "
        "drive_torque other than the balance speeds up or slows down (docs/model.md, section 11; "
        "not with contact_law 'rigid', nor with method 'exact')", ge=1, le=2)


class NumericsKeys(Group):
    """Tolerances and bounds."""

    title = "tolerances and bounds, for every study"

    method: Literal["auto", "exact", "rk4"] = key(
        "auto", "motion between events: in closed form ('exact'), by adaptive Runge-Kutta "
        "('rk4'), or the first where it can be ('auto')")
    rtol: float | None = key(None, "relative tolerance of rk4; left out: 1e-8 for a response, 1e-6 "
                             "for a sweep", example=1e-8, ge=1e-13, le=1e-2)
    chatter_tol: float | None = key(None, "error of the end of a complete chatter; left out: 1e-13 "
                                    "in closed form, min(rtol, 1e-10) with rk4",
                                    "mesh periods", 1e-10, gt=0, le=1e-2)
    count_depth: float = key(0.01, "an impact is counted when its flight was deeper than this "
                             "part of the cycle's deepest separation", ge=0, le=1)
    max_events_per_cycle: int = key(1_000_000, "a run ends with a status beyond this", ge=1,
                                    le=BIG)
    max_steps_per_cycle: int = key(10_000_000, "a run ends with a status beyond this", ge=1,
                                   le=BIG)
    max_period: int = key(24, "longest period looked for", "mesh periods", ge=1, le=10_000)
    start_phase: float = key(0.0, "mesh phase at which every run starts", "mesh periods", ge=0,
                             lt=1)


DRAW = "draw"
GROUPS: dict[str, type[Group]] = {
    "gear_pair": GearPairKeys, "transmission_error": TransmissionErrorKeys,
    "operation": OperationKeys, "scene": SceneKeys, "numerics": NumericsKeys, DRAW: DrawKeys,
    **{kind: study.part("keys") for kind, study in REGISTERED.items()}}
STUDIES = tuple(REGISTERED)
# Groups that a deck has any number of, each with its name.
REPEATED = (DRAW, *STUDIES)
REQUIRED = ("gear_pair", "transmission_error")


def numeric_parameters() -> dict[str, str]:
    """`group`, key of every real number that a sweep may vary."""
    found = {name: group for group in ("gear_pair", "operation")
             for name, field in fields(GROUPS[group]).items() if KeyType(field).kind is float}
    return found | dict.fromkeys(("parabola_amplitude", "harmonic_amplitude"),
                                 "transmission_error")


def parameter_words() -> dict[str, str]:
    """The same as a deck writes them; of a list its first element."""
    return {name if name != "harmonic_amplitude" else parameter_text(f"{name}_1"): group
            for name, group in numeric_parameters().items()}


__all__ = ["DRAW", "GROUPS", "OPERATION", "REPEATED", "REQUIRED", "SPEEDS", "STUDIES", "KeyType",
           "fields", "numeric_parameters", "parameter_words"]
