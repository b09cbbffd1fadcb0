"""The variables of a result file: units, long names, flags of coded values, whole numbers."""

from __future__ import annotations

import numpy as np

from lapwing.base.codes import EventKind, Flank, MotionState, SearchStage, Status
from lapwing.base.quantities import PARAMETERS, STABILITY

CODES = {"status": Status, "motion_state": MotionState, "event_kind": EventKind,
         "impact_flank": Flank, "trial_stage": SearchStage}
VELOCITY = "per unit of dimensionless time tau = natural_frequency * t"
# Units (UDUNITS) and long names by variable; a cycle_X is described as X.
DESCRIPTIONS = {
    "time": ("s", "time from the first recorded mesh cycle"),
    "phase": ("1", "mesh phase, in mesh periods"),
    "cycle": ("1", "mesh cycle, from the first recorded one"),
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
    "event_phi": ("rad", "relative angle at the event"),
    "velocity_before": ("rad", f"velocity relative to the flank before, {VELOCITY}"),
    "velocity_after": ("rad", f"velocity relative to the flank after, {VELOCITY}"),
    "impact_energy": ("J", "kinetic energy lost in impacts, in the flank's frame"),
    "mesh_force_mean": ("N", "mean normal force of spring and damper"),
    "mesh_force_peak": ("N", "largest magnitude of the force of spring and damper"),
    "phi_rms": ("rad", "root mean square of phi about its mean"),
    "phi_peak_to_peak": ("rad", "greatest less least phi, of even samples"),
    "dynamic_te_rms": ("rad", "root mean square of the dynamic transmission error about its mean"),
    "dynamic_te_peak_to_peak": ("rad", "greatest less least dynamic transmission error, of even "
                                "samples"),
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
    "knots": ("1", "ends of the pieces, in mesh periods"),
    "coefficients": ("rad", "coefficients of ascending powers of (phase - knot), phase in mesh "
                     "periods"),
    "kinks": (None, "whether the slope jump at the beginning of the piece belongs to the data"),
    "claim_value": (None, "parameter value a source reports on"),
    "claim_deepest_separation": ("rad", "deepest separation a source reports"),
    "claim_text": (None, "what a source reports, in words"),
    **{name: (one.units, one.long_name) for name, one in PARAMETERS.items()},
}
# Whole numbers that the engine's tables hold as reals.
WHOLE = ("motion_state", "impacts", "back_impacts", "counted_impacts", "counted_back_impacts",
         "releases", "back_releases", "engages", "back_engages", "chatter_ends",
         "back_chatter_ends", "states_visited")
FAILED = -1


def described(dataset):
    """The dataset with CF attributes, whole numbers as such, attributes as netCDF can hold them.

    Parameters
    ----------
    dataset : xarray.Dataset, a response, a sweep or a part of the file

    Returns
    -------
    xarray.Dataset
        A shallow copy; each known variable has `units` and `long_name`, coded ones `flag_values`
        (or `flag_masks`) and `flag_meanings`.
    """
    dataset = dataset.assign({name: variable.fillna(FAILED).astype(np.int32)
                              for name, variable in dataset.data_vars.items()
                              if name in WHOLE and variable.dtype.kind == "f"})
    dataset.attrs = {key: _plain(value) for key, value in dataset.attrs.items()
                     if value is not None}
    for name, variable in dataset.variables.items():
        key = str(name)
        bare = key if key in DESCRIPTIONS else key.removeprefix("cycle_")
        own = (variable.attrs.get("units", "1"),
               variable.attrs.get("long_name", key.replace("_", " ")))
        units, long_name = DESCRIPTIONS.get(bare, own)
        variable.attrs = {"long_name": long_name, **({"units": units} if units else {}),
                          **_flags(bare, variable.dtype)}
    return dataset


def _flags(name, dtype):
    """CF flags of a coded variable."""
    if name == "states_visited":
        return {"flag_masks": np.array([1 << state for state in MotionState], dtype=dtype),
                "flag_meanings": _meanings(MotionState)}
    if name == "kinks":
        return {"flag_values": np.array([0, 1], np.int8), "flag_meanings": "smooth kink"}
    if name not in CODES:
        return {}
    values = [int(code) for code in CODES[name]]
    return {"flag_values": np.array(values).astype(dtype), "flag_meanings": _meanings(CODES[name])}


def _meanings(codes):
    return " ".join(code.name.lower() for code in codes)


def _plain(value):
    """An attribute netCDF can hold: no bool, and nothing of Python's own."""
    if isinstance(value, bool | np.bool_):
        return np.int32(value)
    return np.int64(value) if isinstance(value, int) else value
