"""Responses whose mean speed changes, for their torques are not in balance."""

from __future__ import annotations

import math
from typing import Any

from lapwing.report.words import parameter_unit, plural

# rad/s in turns a minute.
RPM = 30 / math.pi


def drifts(responses: Any) -> list[str]:
    """How far the mean speed goes, a sentence in Markdown for each response that drifts.

    Parameters
    ----------
    responses : sequence of Dataset

    Returns
    -------
    list of str
    """
    return [_sentence(one.attrs) for one in responses if not one.attrs["status"]
            and one.attrs.get("mean_acceleration", 0.0) != 0]


def _sentence(attrs: dict[str, Any]) -> str:
    first, last = (attrs[f"mean_speed_{end}"] for end in ("first", "last"))
    seconds = attrs["record_cycles"] * attrs["mesh_period_s"]
    return (f"**The pinion does not keep its speed at {attrs['brake_torque']:g} "
            f"{parameter_unit('brake_torque')} on the gear**: the torques are not in balance, and "
            f"the mean speed goes from {first:.4g} to {last:.4g} rad/s ({RPM * first:.4g} to "
            f"{RPM * last:.4g} rpm) in the {plural(attrs['record_cycles'], 'mesh cycle')} "
            f"recorded, {seconds:.3g} s (response `{attrs['name']}`).")
