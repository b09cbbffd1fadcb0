"""Names, units and words of the numbers that studies, result files, summaries and figures share."""

from __future__ import annotations

import re
from collections.abc import Callable, Collection
from enum import IntEnum
from functools import lru_cache
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from lapwing.base.codes import (
    BranchEvent,
    BranchOutcome,
    Ending,
    EventKind,
    Flank,
    FoundFrom,
    FoundMotion,
    MotionState,
    SearchStage,
    SpecialPoint,
    Status,
)
from lapwing.base.registry import give_accessor

if TYPE_CHECKING:
    import xarray as xr


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
    "brake_torque": Parameter("N m", "N·m", "braking torque", "braking torque on the gear"),
    "drive_torque": Parameter("N m", "N·m", "drive torque", "drive torque on the pinion"),
    "pinion_speed_rpm": Parameter("rpm", "rpm", "pinion speed", "pinion speed"),
    "pinion_speed_rad_s": Parameter("rad/s", "rad/s", "pinion speed", "pinion speed"),
    "mesh_frequency_hz": Parameter("Hz", "Hz", "mesh frequency", "mesh frequency"),
    "te_scale": Parameter("1", "", "scale of the transmission error",
                          "factor of the transmission error"),
    "parabola_amplitude": Parameter("rad", "rad", "parabola amplitude",
                                    "amplitude of the parabola that the transmission error is"),
    "harmonic_amplitude": Parameter("rad", "rad", "harmonic amplitude",
                                    "amplitude of a term of the transmission error's series"),
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


# What a study varies that is no number: the transmission error itself, of which there are some by
# their labels.
CURVE = "te"
_TERM = re.compile(r"harmonic_amplitude_(\d{1,4})")


def term(name: str) -> int | None:
    """Which amplitude of a harmonic series a parameter is, counted from 1; None: none."""
    found = _TERM.fullmatch(name)
    return int(found[1]) if found else None


def base_name(name: str) -> str:
    """A parameter without the number of a term, as `PARAMETERS` has it."""
    return name if term(name) is None else "harmonic_amplitude"


def curve_clash(names: Collection[str], spelled: Callable[[str], str] = str) -> str:
    """What is wrong where parameters of the transmission error are varied together."""
    others = [name for name in names if base_name(name) in (
        "harmonic_amplitude", "parabola_amplitude")]
    if CURVE not in names or not others:
        return ""
    both = f"{spelled(CURVE)} and {spelled(others[0])}"
    return f"{both}: each curve has its own, expected one of them"


def are_labels(values: NDArray[Any]) -> bool:
    """Whether values of a parameter are labels, which have no order, not numbers."""
    return values.dtype.kind in "UOS"


def value_words(value: Any) -> str:
    """A value of a parameter, without its unit: a number, or a label."""
    return f"'{value}'" if isinstance(value, str) else f"{value:g}"


def parameter(name: str) -> Parameter:
    """`Parameter` of a name; of one unknown, a bare number."""
    words = name.replace("_", " ")
    if name == CURVE:
        return Parameter("", "", "transmission error", "transmission error, by its label")
    if (number := term(name)) is not None:
        one = PARAMETERS["harmonic_amplitude"]
        return one._replace(words=f"harmonic amplitude {number}",
                            long_name=f"amplitude of term {number} of the transmission error's "
                                      "series")
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
CODES: dict[str, type[IntEnum]] = {
    "status": Status, "motion_state": MotionState, "event_kind": EventKind, "kind": EventKind,
    "impact_flank": Flank, "trial_stage": SearchStage, "special_kind": SpecialPoint,
    "special_outcome": BranchOutcome, "special_flank": Flank, "range_low_kind": SpecialPoint,
    "range_high_kind": SpecialPoint, "ending": Ending, "point_motion_state": MotionState,
    "start_motion_state": MotionState, "rattling_low_kind": SpecialPoint,
    "rattling_high_kind": SpecialPoint, "event_happening": BranchEvent, "event_flank": Flank,
    "motion_kind": FoundMotion, "motion_begun": FoundFrom, "curve_kind": SpecialPoint,
    "meeting_kind": SpecialPoint, "meeting_outcome": BranchOutcome}
RATE = "rad per tau"
# Columns of each table, in the engine's order: name -> unit. Velocities of an event are relative
# to the flank touched; `t` is the time since the cycle's beginning; `flight_depth` the greatest
# depth of the flight that the event ends, NaN where it ends none or one not watched throughout.
EVENT = {"kind": "1", "cycle": "1", "t": "1", "phi": "rad", "velocity_before": RATE,
         "velocity_after": RATE, "flight_depth": "rad"}
SAMPLE = {"motion_state": "1", "phi": "rad", "phi_dot": RATE}
CYCLE = {"cycle": "1", "motion_state": "1", "phi": "rad", "phi_dot": RATE} | dict.fromkeys(
    ("impacts", "back_impacts", "counted_impacts", "counted_back_impacts", "releases",
     "back_releases", "engages", "back_engages", "chatter_ends", "back_chatter_ends"), "1") | {
         "deepest_separation": "rad", "deepest_back_penetration": "rad", "states_visited": "1"}
# Integrals over cycles, where they are wanted (fortran/observers/averages.f90): time by motion
# state, phi, phi**2 and the force of spring and damper over k'*lever; its largest magnitude.
AVERAGES = {"separation_time": "1", "engagement_time": "1", "back_engagement_time": "1",
            "phi_integral": "rad", "phi_square_integral": "rad2", "force_integral": "rad",
            "force_peak": "rad"}
# What a map can be asked to keep of each run besides, and the variables that it adds.
SHARES = {f"{state.name.lower()}_share": f"{state.name.lower()}_time" for state in MotionState}
OBSERVED = {"rms": ("phi_rms",), "forces": ("mesh_force_mean", "mesh_force_peak"),
            "exponent": ("lyapunov_exponent",), "shares": tuple(SHARES)}
# Lines of the tangent map behind its matrix: fortran/observers/tangent.f90.
TANGENT = ("exponent", "log_det", "det_sign", "rank", "drive_time", "coast_time", "impacts",
           "log_rebound", "graze_depth")
# Velocities are rates in dimensionless time, which has no unit.
VELOCITY = "per unit of dimensionless time tau = natural_frequency * t"
# Units (UDUNITS) and long names by variable; a cycle_X is described as X.
DESCRIPTIONS: dict[str, tuple[str | None, str]] = {
    "tau": ("1", "dimensionless time, natural_frequency * t"),
    "time": ("s", "time from the beginning of what is recorded"),
    "phase": ("1", "mesh phase, in mesh periods"),
    "cycle": ("1", "mesh cycle, from the first recorded one"),
    "sample_cycle": ("1", "mesh cycle of the sample, from the first recorded one"),
    "motion_state": (None, "motion state"),
    "phi": ("rad", "relative angle from the drive flank, positive in contact"),
    "phi_dot": ("rad", f"rate of phi, {VELOCITY}"),
    "mesh_force": ("N", "normal mesh force of spring and damper, coast flank negative"),
    "dynamic_te": ("rad", "dynamic transmission error, theta = phi + g"),
    "pinion_angle": ("rad", "angle of the pinion ahead of its nominal rotation"),
    "gear_angle": ("rad", "angle of the gear ahead of its nominal rotation"),
    "pinion_speed": ("rad/s", "speed of the pinion"),
    "gear_speed": ("rad/s", "speed of the gear"),
    "mean_speed": ("rad/s", "mean speed of the pinion: of both wheels' momentum"),
    "event_time": ("s", "time of the event from the first recorded mesh cycle"),
    "event_phase": ("1", "mesh phase of the event, in mesh periods"),
    "event_cycle": ("1", "mesh cycle of the event, from the first recorded one"),
    "event_kind": (None, "kind of event; back: at the coast flank"),
    "kind": (None, "kind of event; back: at the coast flank"),
    "event_phi": ("rad", "relative angle at the event"),
    "velocity_before": ("rad", f"velocity relative to the flank before, {VELOCITY}"),
    "velocity_after": ("rad", f"velocity relative to the flank after, {VELOCITY}"),
    "flight_depth": ("rad", "greatest depth of the flight that the event ends"),
    "complete": (None, "whether the mesh cycle was followed from its beginning to its end"),
    "impact_energy": ("J", "kinetic energy lost in impacts, in the flank's frame"),
    "mesh_force_mean": ("N", "mean normal force of spring and damper"),
    "mesh_force_peak": ("N", "largest magnitude of the force of spring and damper"),
    "phi_rms": ("rad", "root mean square of phi about its mean"),
    "phi_peak_to_peak": ("rad", "greatest less least phi, of even samples"),
    "dynamic_te_rms": ("rad", "root mean square of the dynamic transmission error about its mean"),
    "dynamic_te_peak_to_peak": ("rad", "greatest less least dynamic transmission error, of even "
                                "samples"),
    **{name: ("1", f"share of time in {name.removesuffix('_share').replace('_', ' ')}")
       for name in SHARES},
    "impact_force_mean": ("N", "impulse of the impacts per time"),
    "impacts": ("1", "impacts at the drive flank, all"),
    "back_impacts": ("1", "impacts at the coast flank, all"),
    "counted_impacts": ("1", "impacts at the drive flank after flights deeper than count_depth"),
    "counted_back_impacts": ("1", "impacts at the coast flank after flights deeper than "
                             "count_depth"),
    "releases": ("1", "releases from the drive flank"),
    "back_releases": ("1", "releases from the coast flank"),
    "engages": ("1", "engagements of the drive flank"),
    "back_engages": ("1", "engagements of the coast flank"),
    "chatter_ends": ("1", "complete chatters at the drive flank"),
    "back_chatter_ends": ("1", "complete chatters at the coast flank"),
    "deepest_separation": ("rad", "deepest separation of the drive flank"),
    "deepest_back_penetration": ("rad", "deepest penetration of the coast flank"),
    "states_visited": (None, "motion states visited"),
    "status": (None, "how the run ended"),
    "force": ("rad", "mean force F of the dimensionless oscillator"),
    "motion_class": (None, "p:(i,j), i drive and j coast impacts in p mesh cycles; c: complete "
                     "chatter"),
    "period": ("1", "period in mesh cycles, 0: none found"),
    "arrivals": ("1", "arrivals at the drive flank in a period, or in all recorded cycles of a "
                 "motion without one"),
    "back_arrivals": ("1", "arrivals at the coast flank in a period, or in all recorded cycles of "
                      "a motion without one"),
    "impacts_per_cycle": ("1", "arrivals at the drive flank per mesh cycle"),
    "back_impacts_per_cycle": ("1", "arrivals at the coast flank per mesh cycle"),
    "chatter": (None, "whether a chatter was complete in a recorded cycle"),
    "fastest_arrival": ("rad", f"fastest arrival at a flank, {VELOCITY}"),
    "full_engagement": ("N m", "braking torque above which contact can be kept, T_full"),
    "scramble": ("1", "which of the independent scrambles the draw belongs to"),
    "level": ("1", "part of all that does not exceed the quantile"),
    "event": (None, "what is seen or not"),
    "answer": (None, "what is asked of a run"),
    "parameter": (None, "what is drawn"),
    "seen": ("1", "runs in which it is seen"),
    "known": ("1", "runs of which it is known"),
    **{f"{name}{end}": ("1", f"{words}{of}") for name, words in (
        ("probability", "probability"),
        ("main_effect", "part of the variance that the parameter makes alone"),
        ("total_effect", "part of the variance that the parameter has a part in"),
        ("rank_correlation", "Spearman's rank correlation of parameter and answer"))
       for end, of in (("", ""), ("_low", ", lower 95 % limit"), ("_high", ", upper 95 % limit"))},
    **STABILITY,
    "speed_edge": ("rad", f"edges of the bins of impact speed, {VELOCITY}"),
    "impact_speed_density": ("1", "impacts per mesh cycle in a bin of speed, either flank"),
    "order": ("1", "mesh order, multiples of the mesh frequency"),
    "order_spectrum": ("rad", "amplitude of phi by mesh order, Hann window"),
    "slow_impacts": ("1", "impacts per mesh cycle slower than the first bin"),
    "start": (None, "how each value was begun"),
    "recorded_cycle": ("1", "recorded mesh cycle"),
    "impact_phase": ("1", "mesh phase of the impact, in mesh periods"),
    "impact_velocity": ("rad", f"velocity relative to the flank before the impact, {VELOCITY}"),
    "impact_flank": (None, "flank of the impact"),
    "n_impacts": ("1", "impacts met, also those there was no room for"),
    "kept_impacts": ("1", "impacts of the point that are listed, one after the other"),
    "first_impact": ("1", "place of the point's first impact in the list, from 0"),
    "mean_angle": ("rad", "mean rotation of both wheels on the gear's side, ahead of the nominal"),
    "mean_rate": ("rad", f"rate of mean_angle, {VELOCITY}"),
    "mesh_frequency_ratio": ("1", "mesh frequency over natural frequency"),
    "knots": ("1", "ends of the pieces, in mesh periods"),
    "coefficients": ("rad", "coefficients of ascending powers of (phase - knot), phase in mesh "
                     "periods"),
    "kinks": (None, "whether the slope jump at the beginning of the piece belongs to the data"),
    "claim_value": (None, "parameter value a source reports on"),
    "claim_deepest_separation": ("rad", "deepest separation a source reports"),
    "claim_text": (None, "what a source reports, in words"),
    "branch": ("1", "number of the branch, from 1"),
    "cycles": ("1", "mesh cycles after which the motion repeats"),
    "stable": ("1", "whether both multipliers are below one in magnitude"),
    "rank": ("1", "numbers of a deviation that are left: 2, 1 after chatter, 0 after rigid rest"),
    "strobe_point": ("1", "point that the section belongs to, from 0"),
    "special_branch": ("1", "number of the branch, from 1"),
    "special_kind": (None, "what happens at the special point"),
    "special_outcome": (None, "what becomes of the branch at the special point"),
    "special_flank": (None, "flank concerned"),
    "special_phase": ("1", "mesh phase at which it happens, in mesh periods"),
    "special_phi": ("rad", "relative angle at mesh phase 0"),
    "seed_motions": ("1", "motions looked at"),
    "seed_engaged": ("1", "motions in contact throughout"),
    "seed_aperiodic": ("1", "motions without a period up to 24 mesh cycles"),
    "seed_failed": ("1", "motions whose run failed numerically"),
    "range_branch": ("1", "number of the branch, from 1"),
    **dict.fromkeys(("range_cycles", "curve_cycles"), ("1", "mesh cycles to a repetition")),
    "range_low_kind": (None, "special point at the lower end of the stable range"),
    "range_high_kind": (None, "special point at the upper end of the stable range"),
    "attractor": ("1", "number of the attractor, from 1"),
    "attractor_of_run": ("1", "number of the attractor that the run ends in, 0: not resolved"),
    "ending": (None, "how sure it is where the run ends"),
    "followed_cycles": ("1", "mesh cycles until the end was known"),
    "residual": ("1", "by how much the refined motion misses itself, part of its size"),
    "reached": (None, "whether the value was looked at"),
    "unresolved": ("1", "runs whose end is not known"),
    "failed": ("1", "runs that failed numerically"),
    "presumed": ("1", "runs whose end is presumed"),
    "runs_ended": ("1", "runs that end in the attractor"),
    "share": ("1", "part of the starts that end in the attractor"),
    "share_low": ("1", "part of the starts that end in the attractor, lower 95 % limit"),
    "share_high": ("1", "part of the starts that end in the attractor, upper 95 % limit"),
    "point_motion_state": (None, "motion state of the attractor at mesh phase 0"),
    "point_phi": ("rad", "relative angle of the attractor at mesh phase 0"),
    "point_phi_dot": ("rad", f"rate of phi of the attractor at mesh phase 0, {VELOCITY}"),
    "start_motion_state": (None, "motion state of the start"),
    "start_phi": ("rad", "relative angle of the start"),
    "start_phi_dot": ("rad", f"rate of phi of the start, {VELOCITY}"),
    "start_phase": ("1", "mesh phase of the start, in mesh periods"),
    "start_speed": ("rad", f"speed of the start towards the flank, {VELOCITY}"),
    "event_point": ("1", "point that the event belongs to, from 0"),
    "event_speed": ("rad", f"speed into the flank before the event, {VELOCITY}"),
    "event_happening": (None, "what happens at the event"),
    "event_flank": (None, "flank concerned"),
    "motion_kind": (None, "what the motion is"),
    "motion_begun": (None, "how the motion began"),
    "motion_cycles": ("1", "mesh cycles after which the motion repeats, 0: not"),
    "motion_branch": ("1", "number of the branch that the motion lies on, 0: on none"),
    "motion_distance": ("1", "distance of the motion from its branch, part of its size"),
    "motion_phi": ("rad", "relative angle at mesh phase 0"),
    "motion_phi_dot": ("rad", f"rate of the relative angle at mesh phase 0, {VELOCITY}"),
    "curve_kind": (None, "kind of the curve's special points"),
    "curve_branch": ("1", "number of the branch that the curve begins on, from 1"),
    **dict.fromkeys(("curve_number", "meeting_curve"), ("1", "number of the curve, from 1")),
    "meeting_kind": (None, "what meets the curve or ends it"),
    "meeting_outcome": (None, "what becomes of the curve there"),
    **{f"rattling_{end}_kind": (None, f"what ends the rattling at the {end} end")
       for end in ("low", "high")},
    **{f"rattling_{end}_branch": ("1", f"number of the branch at the {end} end, 0: none")
       for end in ("low", "high")},
    **{name: (one.units, one.long_name) for name, one in PARAMETERS.items()},
}


def worded(dataset: xr.Dataset) -> xr.Dataset:
    """The same dataset, its variables with `units` and `long_name` and coded ones with flags.

    Parameters
    ----------
    dataset : xarray.Dataset
        A response, a sweep, a run or a part of a file.  Attributes of variables are replaced; of
        one that is not known, units and long name stay.
    """
    give_accessor()
    for name, variable in dataset.variables.items():
        units, long_name = (variable.attrs.get(key) for key in ("units", "long_name"))
        variable.attrs = _attributes(
            str(name), units if units is None else str(units),
            long_name if long_name is None else str(long_name), variable.dtype)
    return dataset


@lru_cache(maxsize=1024)
def _attributes(key: str, units: str | None, long_name: str | None,
                dtype: np.dtype[Any]) -> dict[str, Any]:
    """Attributes of a variable that has some units and a long name; xarray copies them."""
    bare = key if key in DESCRIPTIONS else key.removeprefix("cycle_")
    own = ("1" if units is None else units,
           key.replace("_", " ") if long_name is None else long_name)
    if bare == CURVE or term(bare) is not None:
        own = parameter(bare).units, parameter(bare).long_name
    units, long_name = DESCRIPTIONS.get(bare, own)
    attrs = {"long_name": long_name, **({"units": units} if units else {}), **_flags(bare, dtype)}
    for values in attrs.values():
        if isinstance(values, np.ndarray):
            values.flags.writeable = False  # they are those of many variables
    return attrs


def _flags(name: str, dtype: np.dtype[Any]) -> dict[str, Any]:
    """CF flags of a coded variable; its list of impacts, of a count of them."""
    dtype = dtype if dtype.kind in "iu" else np.dtype(np.int32)
    if name == "states_visited":
        return {"flag_masks": np.array([1 << state for state in MotionState], dtype=dtype),
                "flag_meanings": _meanings(MotionState)}
    if name == "kinks":
        return {"flag_values": np.array([0, 1], np.int8), "flag_meanings": "smooth kink"}
    if name == "kept_impacts":
        return {"sample_dimension": "impact"}
    if name not in CODES:
        return {}
    values = [int(code) for code in CODES[name]]
    return {"flag_values": np.array(values).astype(dtype), "flag_meanings": _meanings(CODES[name])}


def _meanings(codes: type[IntEnum]) -> str:
    return " ".join(code.name.lower() for code in codes)
