"""Responses and searches of which parts are missing or failed: real ones with parts blanked."""

import math

import numpy as np

from helpers import PAIR, SHIPPED, scene_a, scene_c, scene_d
from lapwing import StartGrid, Status, critical_back, critical_safe
from lapwing.base.codes import SearchStage
from lapwing.studies.response.run import response

SHORT = {"settle": 60, "record": 40, "samples_per_cycle": 64, "rtol": 1e-6}
CLAIM = {"claim_impacts_per_cycle": 3.0, "claim_deepest_separation": 0.00063, "claim_text": "three"}
SEARCH = {"pinion_speed_rpm": 240, "impact_law": "absolute", "settle": 30, "record": 10}


def whole_responses():
    """Name -> a response with every number known as well as it can be."""
    scenes = {
        "periodic": (scene_a(1.8), CLAIM | {"exponents": True}),
        "chaotic": (scene_a(0.8), {"exponents": True}),
        "chatter": (scene_d(5.5), {}), "engaged": (scene_a(14), {}),
        "rigid": (scene_c(3.3, contact_law="rigid"), {"exponents": True}),
        "compliant": (scene_a(1.8, "relative", contact_law="compliant"), {}),
        "short": (scene_a(1.8), {"record": 1})}
    return {name: response(osc, PAIR, name=name, **(SHORT | options))
            for name, (osc, options) in scenes.items()}


def whole(data):
    """As it is."""
    return data


def numbers(data, suffix):
    """Names of the attributes with an ending, such as `_error`."""
    return [key for key in data.attrs if key.endswith(suffix) and key != "lyapunov_exponent_error"]


def failed(data):
    """What a run leaves that failed numerically."""
    data = data.copy(deep=True)
    for name, variable in data.data_vars.items():
        lost = -1 if variable.dtype.kind == "i" else math.nan
        data[name] = variable.dims, np.full(variable.shape, lost, variable.dtype)
    data = data.isel(event=slice(0, 0))
    floats = {key: math.nan for key, value in data.attrs.items() if isinstance(value, float)
              and key not in ("brake_torque", "mesh_period_s", "mesh_frequency_ratio", "gap_width",
                              "rtol", "rtol_reference", "count_depth", "start_phase")
              and not key.startswith("claim_")}
    return data.assign_attrs(floats | {
        "status": int(Status.NOT_FINITE), "status_meaning": "not_finite", "period": 0,
        "motion_class": "failed", "states_visited": 0, "fully_engaged": 0,
        "error_kind": "statistical"})


def second_run_failed(data):
    """Nothing to compare with."""
    lost = {key: math.nan for suffix in ("_change", "_error") for key in numbers(data, suffix)}
    return data.assign_attrs(lost | {"status_reference": int(Status.TOO_MANY_EVENTS),
                                     "motion_class_reference": "failed"})


def second_run_differs(data):
    """The second run ends in another motion."""
    return data.assign_attrs(motion_class_reference="7:(9,1)")


def without_intervals(data):
    """A record too short for any interval of an average."""
    data = without_period(data)
    return data.assign_attrs(dict.fromkeys(numbers(data, "_error"), math.nan))


def without_halves(data):
    """A record without two halves to compare."""
    return data.assign_attrs(dict.fromkeys(numbers(data, "_transient"), math.nan))


def without_period(data):
    """A motion that does not repeat; an average has an interval, a greatest value has none."""
    data = data.assign_attrs(period=0, motion_class="no period", error_kind="statistical",
                             motion_class_reference="no period")
    if "lyapunov_exponent" in data.attrs:
        data.attrs.update(lyapunov_exponent=0.01, lyapunov_exponent_error=math.nan)
    for name in ("multiplier_real", "multiplier_imag", "orbit_period"):
        data.attrs.pop(name, None)
    greatest = ("deepest", "peak", "speed_max")
    return data.assign_attrs({key: math.nan for key in numbers(data, "_error")
                              if any(part in key for part in greatest)})


def of_an_older_version(data):
    """Files of version 0.1 have the difference of the two runs as the error."""
    attrs = {key: value for key, value in data.attrs.items() if not key.endswith("_change")}
    return data.copy().drop_attrs(deep=False).assign_attrs(attrs)


RESPONSE_DAMAGES = (whole, failed, second_run_failed, second_run_differs, without_intervals,
                    without_halves, without_period, of_an_older_version)


def whole_searches():
    """Name -> a search for T_safe or T_back with every motion followed."""
    few = {"starts": StartGrid(2, 2, 2), **SEARCH}
    found = {
        "safe": critical_safe(PAIR, SHIPPED, values=[11.5, 12, 12.5, 13], resolution=0.1,
                              further=1, **few),
        "all_safe": critical_safe(PAIR, SHIPPED, values=[13, 13.5, 14], **few),
        "all_unsafe": critical_safe(PAIR, SHIPPED, values=[11, 11.5], further=1, **few),
        "back": critical_back(PAIR, SHIPPED, values=[0.5, 0.6, 0.7, 0.9, 1.1],
                              **few | {"record": 100}),
        "no_back": critical_back(PAIR, SHIPPED, values=[5, 6, 7], **few),
        "all_back": critical_back(PAIR, SHIPPED, values=[0.2, 0.3], **few | {"record": 100})}
    return {name: data.assign_attrs(name=name) for name, data in found.items()}


def lost_where(data, lost):
    """Every motion of some trials failed."""
    data = data.copy(deep=True)
    lost = np.asarray(lost)
    data["trial_failed"][lost] = data["trial_starts"].values[lost]
    for name in ("trial_rattling", "trial_cycles", "trial_back_cycles", "trial_bursts"):
        if name in data:
            data[name][lost] = 0
    if "trial_rate_bound" in data:
        data["trial_rate_bound"][lost] = math.inf
    return data


def unsafe(data):
    """Trials of a search for T_safe that may fail without changing where it goes."""
    return data["trial_rattling"].values > 0


def nothing_known(data):
    """Every motion failed, at every value: such a search ends at its safe end."""
    if data.attrs["find"] == "back":
        data = lost_where(data, np.ones(data.sizes["trial"], bool))
        return data.assign_attrs(
            outcome="none_seen", last_seen=math.nan, estimate=math.nan, bar=math.nan,
            first_clean=float(data["trial_value"][-1]), clean_end=data.attrs["scan_from"],
            clean_values=data.sizes["trial"], clean_cycles=0, rate_bound=math.inf)
    data = data.isel(trial=data["trial_stage"].values == SearchStage.SCAN).isel(trial=slice(0, 1))
    return lost_where(data, [True]).assign_attrs(
        outcome="unsafe_throughout", rattling=data.attrs["scan_from"], clean=math.nan,
        estimate=math.nan, bar=math.nan)


def unsafe_ones_failed(data):
    """Where motions rattled, or struck back, all of them failed instead."""
    if data.attrs["find"] == "safe":
        return lost_where(data, unsafe(data))
    hit = data["trial_back_cycles"].values > 0
    if not hit.any():
        return data
    n = data.sizes["trial"]
    data = lost_where(data, hit)
    return data.assign_attrs(
        outcome="none_seen", last_seen=math.nan, estimate=math.nan, bar=math.nan,
        first_clean=float(data["trial_value"][-1]), clean_end=data.attrs["scan_from"],
        clean_values=n, clean_cycles=int(data["trial_cycles"].sum()), rate_bound=math.inf)


def every_second_failed(data):
    """Every second trial of those that may fail without changing where the search goes."""
    if data.attrs["find"] == "safe":
        last = data["trial_value"].values == data.attrs["rattling"]
        lost = unsafe(data) & ~last
    else:
        lost = data["trial_value"].values != data.attrs["last_seen"]
    lost &= np.cumsum(lost) % 2 == 1
    data = lost_where(data, lost)
    if data.attrs["find"] == "back":
        n = data.attrs["clean_values"]
        data.attrs["clean_cycles"] = int(data["trial_cycles"].values[:n].sum())
        data.attrs["rate_bound"] = float(np.max(data["trial_rate_bound"].values[:n], initial=0))
    return data


SEARCH_DAMAGES = (whole, nothing_known, unsafe_ones_failed, every_second_failed)
