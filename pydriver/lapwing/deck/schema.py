"""The keys of a deck: type, unit, range, default and meaning of each, in one place.

Validation, the template, the reference page and `used.nml` are all made from these classes.  The
ranges are wide: they catch a slip of unit or exponent, not an unusual gear.
"""

from __future__ import annotations

from typing import Annotated, ClassVar, Literal, get_args, get_origin

from pydantic import BaseModel, ConfigDict, Field

BIG = 2**31 - 2


def key(default=..., text="", unit="", example=None, **limits):
    """A deck key: its default (`...`: required), meaning, unit, example value and limits."""
    extra = {"unit": unit, "example": example}
    return Field(default, description=text, json_schema_extra=extra, **limits)


class Group(BaseModel):
    """One namelist group.

    `exclusive` lists sets of keys of which at most one is given; `needed`: one must be given.
    """

    model_config = ConfigDict(strict=True, extra="forbid", frozen=True)
    title: ClassVar[str] = ""
    exclusive: ClassVar[tuple] = ()
    needed: ClassVar[bool] = True
    repeatable: ClassVar[bool] = False


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
    te_sign: Literal["printed", "geometric"] = key(
        "printed", "sign of the drive flank's motion g = ±i12·Δφ (i12 = Z2/Z1): 'geometric' is -, "
        "right where Δφ > 0 means that the gear is ahead, and for angle pairs (φ1, φ2); 'printed' "
        "is +, for the opposite count and for the published 25 × 32 example")


class OperationKeys(Group):
    """Torques and speed."""

    title = "torques and speed, for every study that does not set its own"
    exclusive = (("pinion_speed_rpm", "pinion_speed_rad_s", "mesh_frequency_hz"),)
    needed = False

    brake_torque: float | None = key(None, "T_l, mean torque braking the gear; may be left out "
                                     "where every study gives its own", "N·m", 1.8, ge=-1e9,
                                     le=1e9)
    drive_torque: float | None = key(None, "T_m, mean torque driving the pinion; left out: the "
                                     "balance T_l/i12", "N·m", 1.40625, ge=-1e9, le=1e9)
    pinion_speed_rpm: float | None = key(None, "n1, speed of the pinion", "rev/min", 240.0,
                                         ge=1e-3, le=1e7)
    pinion_speed_rad_s: float | None = key(None, "n1, speed of the pinion", "rad/s", 25.13,
                                           ge=1e-4, le=1e6)
    mesh_frequency_hz: float | None = key(None, "Z1·n1, tooth passages per second", "Hz", 100.0,
                                          ge=1e-3, le=1e9)


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


NAME_PATTERN = r"^[A-Za-z0-9][A-Za-z0-9_.-]*$"


class ResponseKeys(OperationKeys):
    """One trajectory, examined closely."""

    title = "one trajectory, examined closely; any number of them"
    repeatable = True

    name: str = key(text="names its figures and its line in the summary; letters, digits, . _ -",
                    example="torque_1.8", pattern=NAME_PATTERN, max_length=64)
    start: Literal["rest", "separation", "engagement", "back_engagement"] = key(
        "rest", "'rest', or a motion state with start_phi and start_phi_dot")
    start_phi: float | None = key(None, "φ at the start, counted from the moving drive flank: > 0 "
                                  "pressed, from -gap to 0 separated, below -gap back contact; "
                                  "needed with a motion state", "rad", -1e-4, ge=-10, le=10)
    start_phi_dot: float | None = key(None, "dφ/dτ at the start, τ = ω'·t, that is (dφ/dt)/ω' with "
                                      "the natural frequency ω' = √(k/J) in rad/s; left out with "
                                      "a motion state: 0", "rad", 0.0, ge=-10, le=10)
    settle_cycles: int = key(400, "mesh cycles before recording", ge=0, le=10_000_000)
    record_cycles: int = key(100, "mesh cycles recorded", ge=1, le=1_000_000)
    samples_per_cycle: int = key(400, "samples of the time history in a mesh cycle", ge=8,
                                 le=100_000)
    exponents: bool = key(True, "whether Floquet multipliers and Lyapunov exponents are found")
    rtol: float | None = key(None, "relative tolerance; left out: that of &numerics, else 1e-8",
                             example=1e-8, ge=1e-13, le=1e-2)
    claim_impacts_per_cycle: float | None = key(
        None, "what somebody else reports: impacts per mesh cycle", example=3.0, ge=0, le=1e6)
    claim_deepest_separation: float | None = key(
        None, "what somebody else reports: deepest separation", "rad", 0.00063, ge=0, le=10)
    claim_text: str | None = key(None, "what somebody else reports, in words",
                                 example="3 impacts per cycle, period 1", max_length=500)


class ValueKeys(Group):
    """Values of a parameter: a list, or ranges."""

    values: list[Annotated[float, Field(ge=-1e15, le=1e15)]] | None = key(
        None, "the values themselves", "of the parameter", [0.8, 1.8, 3.3, 5.5, 12.0],
        min_length=1)
    from_: list[Annotated[float, Field(ge=-1e15, le=1e15)]] | None = key(
        None, "where each range begins", "of the parameter", [0.2], alias="from", min_length=1,
        max_length=100)
    to: list[Annotated[float, Field(ge=-1e15, le=1e15)]] | None = key(
        None, "where each range ends, included", "of the parameter", [14.0], min_length=1,
        max_length=100)
    count: list[Annotated[int, Field(ge=2, le=100_000)]] | None = key(
        None, "how many values each range has", "", [691], min_length=1, max_length=100)
    spacing: Literal["linear", "log"] = key(
        "linear", "equal steps, or equal ratios; for all ranges")


class SweepKeys(ValueKeys):
    """One parameter over a range of values."""

    title = "one parameter over a range of values; any number of them"
    repeatable = True
    exclusive = (("values", "from"),)

    name: str = key(text="names its figures and its part of the summary; letters, digits, . _ -",
                    example="torque", pattern=NAME_PATTERN, max_length=64)
    parameter: str = key(text="a real number of &gear_pair or &operation, as 'brake_torque' or "
                         "'operation.brake_torque'", example="brake_torque")
    starts: list[Literal["rest", "up", "down"]] = key(
        ["rest", "up", "down"], "each value from rest; carried upwards; carried downwards (the "
        "first one of those from rest)",
        min_length=1, max_length=3)
    settle_cycles: int = key(400, "mesh cycles before recording, at every value", ge=0,
                             le=10_000_000)
    record_cycles: int = key(100, "mesh cycles recorded at every value", ge=1, le=100_000)
    impacts: bool = key(True, "whether phase and speed of every impact are kept")
    order_spectra: bool = key(False, "whether order spectra are made, for a waterfall of them")
    amplitudes: bool = key(False, "whether rms and peak to peak of φ and of the dynamic "
                           "transmission error, and mean and peak mesh force are found, for a "
                           "figure of them against the parameter")
    speed_density: bool = key(False, "whether impacts of every speed are counted, for a figure of "
                              "their density")
    exponents: bool = key(False, "whether Lyapunov exponents are found, and Floquet multipliers "
                          "where the motion repeats")
    rtol: float | None = key(None, "relative tolerance; left out: that of &numerics, else 1e-6",
                             example=1e-6, ge=1e-13, le=1e-2)


class CriticalKeys(OperationKeys, ValueKeys):
    """One critical value of a parameter."""

    title = "one critical value of a parameter, the braking torque first of all; any number of them"
    repeatable = True
    exclusive = (*OperationKeys.exclusive, ("values", "from"))

    name: str = key(text="names its figure and its part of the summary; letters, digits, . _ -",
                    example="T_full", pattern=NAME_PATTERN, max_length=64)
    find: Literal["full", "safe", "back", "on"] = key(
        text="'full': the engaged motion keeps contact; 'safe': no rattling survives from the "
        "starts stated; 'back': the last back impact; 'on': a rigid tooth stays on the flank "
        "(contact_law 'rigid' only)", example="full")
    parameter: str = key("brake_torque", "a real number of &gear_pair or &operation, as for "
                         "&sweep; 'full' and 'on' along a torque are closed forms and take no "
                         "values")
    safe_end: Literal["high", "low"] = key(
        "high", "the end of the values at which the teeth are taken to be safe; the search begins "
        "there")
    resolution: float | None = key(
        None, "'safe': half of the widest bracket allowed; left out: a fifth of the least step of "
        "the values", "of the parameter", 0.01, gt=0, le=1e15)
    start_phases: int | None = key(None, "mesh phases at which motions begin; left out: 6 for "
                                   "'safe', 2 for 'back'", "", 6, ge=1, le=1000)
    start_positions: int | None = key(
        None, "positions at each phase, in separation and in engagement; left out: 3 for 'safe', "
        "2 for 'back'", "", 3, ge=1, le=1000)
    start_speeds: int | None = key(None, "speeds at each position; left out: 3 for 'safe', 2 for "
                                   "'back'", "", 3, ge=1, le=1000)
    settle_cycles: int = key(200, "mesh cycles before a motion is looked at", ge=0, le=10_000_000)
    record_cycles: int | None = key(
        None, "mesh cycles looked at, of each motion; left out: 50 for 'safe', 1200 for 'back'", "",
        50, ge=1, le=1_000_000)
    further_values: int = key(0, "'safe': values tried beyond the first that rattles; motions "
                              "found there are carried back to it", ge=0, le=100_000)
    confidence: float = key(0.95, "'back': of the upper limit of the rate of back impacts", ge=0.5,
                            lt=1)
    rtol: float | None = key(None, "relative tolerance; left out: that of &numerics, else 1e-6",
                             example=1e-6, ge=1e-13, le=1e-2)


GROUPS: dict[str, type[Group]] = {
    "gear_pair": GearPairKeys, "transmission_error": TransmissionErrorKeys,
    "operation": OperationKeys, "scene": SceneKeys, "numerics": NumericsKeys,
    "response": ResponseKeys, "sweep": SweepKeys, "critical": CriticalKeys}
STUDIES = tuple(name for name, group in GROUPS.items() if group.repeatable)
REQUIRED = ("gear_pair", "transmission_error")
SPEEDS = OperationKeys.exclusive[0]
OPERATION = tuple(OperationKeys.model_fields)
# Default tolerances of the studies where neither they nor &numerics name one.
RTOL = {"response": 1e-8, "sweep": 1e-6, "critical": 1e-6}
# What a search for a critical value takes where its group says nothing, by what it finds.
CRITICAL_DEFAULTS = {
    "safe": {"start_phases": 6, "start_positions": 3, "start_speeds": 3, "record_cycles": 50},
    "back": {"start_phases": 2, "start_positions": 2, "start_speeds": 2, "record_cycles": 1200}}
TORQUES = ("brake_torque", "drive_torque")


def fields(group):
    """Key -> field of a group by the deck's spelling; what names a study stands first."""
    first = (name for name in ("name", "find", "parameter") if name in group.model_fields)
    order = [*first, *group.model_fields]
    return {(group.model_fields[name].alias or name): group.model_fields[name]
            for name in dict.fromkeys(order)}


class KeyType:
    """What a field's annotation and limits say, in a form to print and to test.

    Attributes
    ----------
    kind : type, one of int, float, bool, str
    is_list : bool
    choices : tuple of str, the allowed texts, or empty
    limits : dict of 'gt', 'ge', 'lt', 'le'
    unit : str
    """

    def __init__(self, field):
        annotation, metadata = field.annotation, list(field.metadata)
        parts = [part for part in get_args(annotation) if part is not type(None)]
        if type(None) in get_args(annotation):
            annotation = parts[0]
        self.is_list = get_origin(annotation) is list
        if self.is_list:
            annotation = get_args(annotation)[0]
            if get_origin(annotation) is Annotated:
                annotation, *inner = get_args(annotation)
                metadata += [limit for item in inner for limit in item.metadata]
        self.choices = get_args(annotation) if get_origin(annotation) is Literal else ()
        self.kind = str if self.choices else annotation
        self.limits = _limits(metadata)
        self.unit = (field.json_schema_extra or {}).get("unit", "")

    @property
    def range(self):
        """Limits in words, such as `> 0` or `from 0 to 1`."""
        (low, above), (high, below) = (
            next(((self._spell(self.limits[name]), name == strict) for name in (strict, other)
                  if name in self.limits), ("", False))
            for strict, other in (("gt", "ge"), ("lt", "le")))
        if not high:
            return (f"> {low}" if above else f">= {low}") if low else ""
        return (f"above {low}" if above else f"from {low}") + (
            f" and below {high}" if below else f" to {high}")

    def _spell(self, limit):
        return str(limit) if self.kind is int else f"{limit:g}"

    @property
    def expected(self):
        """What a value of this key must be, to follow `key = value, expected `."""
        each = "each " if self.is_list else ""
        if self.choices:
            return each + "one of " + ", ".join(f"'{choice}'" for choice in self.choices)
        if self.kind is bool:
            return each + ".true. or .false."
        if self.kind is str:
            return each + "text in quotes"
        what = "a whole number" if self.kind is int else "a number"
        unit = f" ({self.unit})" if self.unit else ""
        return f"{each}{what} {self.range}".rstrip() + unit


def _limits(metadata):
    """Limits among the metadata of a field; pydantic may pack several into one object."""
    limits = {}
    for item in metadata:
        for name in ("gt", "ge", "lt", "le"):
            value = getattr(item, name, None)
            if value is not None:
                limits[name] = value
    return limits


def numeric_parameters():
    """`group`, key of every real number that a sweep may vary."""
    return {name: group for group in ("gear_pair", "operation")
            for name, field in fields(GROUPS[group]).items() if KeyType(field).kind is float}
