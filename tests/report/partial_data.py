"""Sweeps of which parts are missing, failed or without a period: real ones with parts blanked."""

import numpy as np

from helpers import PAIR, SHIPPED
from lapwing import Status, sweep
from lapwing.results.variables import described

OPTIONS = {"settle": 30, "record": 20, "pinion_speed_rpm": 240, "max_impacts": 60,
           "observe": ("cycles", "impacts", "exponents", "speeds", "spectra", "amplitudes")}
TORQUES = np.array([0.6, 1.8, 5.0, 11.0, 12.0, 12.2, 13.0, 14.0])
KEPT = {"full_engagement": 11.9167454, "full_engagement_phase": 0.951457}


def whole_sweeps():
    """Name -> a sweep with every point computed, as a result file would hold it."""
    absolute = {"impact_law": "absolute", **OPTIONS}
    speed = {key: value for key, value in absolute.items() if key != "pinion_speed_rpm"}
    found = {
        "torque": sweep(PAIR, SHIPPED, values=TORQUES, **absolute).assign_attrs(KEPT),
        "compliant": sweep(PAIR, SHIPPED, values=TORQUES, contact_law="compliant",
                           **OPTIONS).assign_attrs(KEPT),
        "rigid": sweep(PAIR, SHIPPED, values=TORQUES[::2], contact_law="rigid", **OPTIONS),
        "one_branch": sweep(PAIR, SHIPPED, values=TORQUES, starts=("up",),
                            **absolute).assign_attrs(KEPT),
        "single": sweep(PAIR, SHIPPED, values=[12.2], **absolute).assign_attrs(KEPT),
        "negative": sweep(PAIR, SHIPPED, values=[-14.0, -12.5, -5.0], impact_law="relative",
                          **OPTIONS),
        "engaged": sweep(PAIR, SHIPPED, values=[14.0, 13.0], **absolute).assign_attrs(KEPT),
        "speed": sweep(PAIR, SHIPPED, parameter="pinion_speed_rpm", values=[100, 200, 400],
                       brake_torque=3.3, **speed)}
    return {name: described(data.assign_attrs(
        name=name, parameter=data["status"].dims[1])) for name, data in found.items()}


def interrupted(data):
    """Rest and upwards have the lower half of the values, downwards the upper half."""
    half = data["status"].sizes[data.attrs["parameter"]] // 2
    lost = np.zeros(data["status"].shape, bool)
    for row, start in enumerate(data["start"].values):
        lost[row, slice(None, half) if start == "down" else slice(half, None)] = True
    return blanked(data, lost, Status.UNFINISHED)


def some_failed(data):
    """Every third point failed, counted along all starts."""
    lost = np.arange(data["status"].size).reshape(data["status"].shape) % 3 == 1
    return blanked(data, lost, Status.TOO_MANY_EVENTS)


def all_failed(data):
    """No point has a result."""
    return blanked(data, np.ones(data["status"].shape, bool), Status.NOT_FINITE)


def none_reached(data):
    """Stopped before the first point was there."""
    return blanked(data, np.ones(data["status"].shape, bool), Status.UNFINISHED)


def one_start_lost(data):
    """The first start has no result at all."""
    lost = np.zeros(data["status"].shape, bool)
    lost[0] = True
    return blanked(data, lost, Status.STEP_TOO_SMALL)


def aperiodic(data):
    """No motion has a period, and no exponent is known."""
    data = data.copy(deep=True)
    data["period"][:] = 0
    data["motion_class"] = (data["status"].dims, np.full(data["status"].shape, "no period"))
    for name in data:
        if "exponent" in name or "multiplier" in name:
            data[name] = data[name] * np.nan
    return data


def as_it_is(data):
    """All points have a result."""
    return data


DAMAGES = (as_it_is, interrupted, some_failed, all_failed, none_reached, one_start_lost, aperiodic)


def blanked(data, lost, status):
    """The sweep as the engine leaves it where points have no result."""
    data = data.copy(deep=True)
    by_point = data["status"].dims
    mask = data["status"].copy(data=lost)
    for name, variable in data.data_vars.items():
        if variable.dims[:2] == by_point and variable.dtype.kind in "fiu" and name not in (
                "status", "period", "n_impacts", "first_impact", "kept_impacts"):
            data[name] = variable.astype(float).where(~mask).transpose(*variable.dims)
    data["status"] = data["status"].where(~mask, status).astype(np.int8)
    for name in ("period", *({"n_impacts", "kept_impacts"} & set(data))):
        data[name] = data[name].where(~mask, 0).astype(data[name].dtype)
    word = "unfinished" if status == Status.UNFINISHED else "failed"
    data["motion_class"] = data["motion_class"].astype(object).where(~mask, word).astype(str)
    return data
