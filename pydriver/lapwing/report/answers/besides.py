"""Findings besides those along the braking torque: other parameters, other operating points."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from numpy.typing import NDArray

from lapwing.base.arrivals import arrivals_in
from lapwing.report.amplitudes import greatest
from lapwing.report.answers.evidence import failures, looks, together
from lapwing.report.answers.limits import at_least, at_most, bands
from lapwing.report.critical import headline
from lapwing.report.words import parameter_unit, parameter_words, plural

if TYPE_CHECKING:
    import xarray as xr


def besides(criticals: Any, sweeps: Any) -> list[str]:
    """Critical values at other operating points in one sentence, and each sweep in one.

    Parameters
    ----------
    criticals, sweeps : sequences of Dataset

    Returns
    -------
    list of str
    """
    said = []
    for one in criticals:
        attrs = one.attrs
        if attrs["parameter"] == "brake_torque" and not int(attrs.get("own_operation", 0)) \
                and attrs.get("safe_end", "high") == "high":
            continue
        at = f"at {attrs['brake_torque']:g} N·m " if "brake_torque" in attrs else ""
        if attrs["find"] == "full" and attrs["outcome"] == "found":
            value, unit = attrs["estimate"], parameter_unit(attrs["parameter"])
            limit = ("from", at_least(value)) if attrs.get("safe_end", "high") == "high" \
                else ("up to", at_most(value))
            said.append(f"{at}contact can be kept {limit[0]} a "
                        f"{parameter_words(attrs['parameter'])} of {limit[1]} {unit}".rstrip())
        else:
            said.append(f"{at}(`{attrs['name']}`) {headline(one)}")
    said = ["**Besides**: " + "; ".join(said) + "."] if said else []
    along = [_along(one) for one in sweeps if one["status"].dims[1] != "brake_torque"]
    return said + [sentence for sentence in along if sentence]


def _along(sweep: xr.Dataset) -> str:
    """Where the teeth part, and strike the coast flank, along another parameter."""
    parameter = str(sweep["status"].dims[1])
    unit, law = parameter_unit(parameter), arrivals_in(sweep.attrs)
    found = looks((), (), [sweep], parameter)
    parting, back = (together(found, what) for what in ("rattling", "back"))
    if not parting.values.size:
        return ""
    at = f", at {sweep.attrs['brake_torque']:g} N·m" if "brake_torque" in sweep.attrs else ""
    text = f"**Along the {parameter_words(parameter)}** ({_span(parting.values, unit)}{at}) the " \
           "teeth "
    text += "part everywhere" if parting.seen.all() else "were not seen to part" \
        if not parting.seen.any() else f"part at {bands(parting.values, parting.seen)} {unit}, " \
        f"not at {bands(parting.values, ~parting.seen)} {unit}".replace(" ,", ",").rstrip()
    text += f"; back {law.word}s " + (f"at {bands(back.values, back.seen)} {unit}".rstrip()
                                      if back.seen.any() else "were not seen")
    moved = greatest(sweep, "dynamic_te_rms", 1e6, "µrad", unit) if "dynamic_te_rms" in sweep \
        else ""
    text += f"; the dynamic transmission error has its greatest rms, {moved}" * bool(moved)
    lost = failures(found)
    return text + f"; {plural(lost, 'run')} failed" * bool(lost) + "."


def _span(values: NDArray[Any], unit: str) -> str:
    if values.size == 1:
        return f"{values[0]:g} {unit}".rstrip()
    return f"{values.size} values, {values[0]:g} to {values[-1]:g} {unit}".rstrip()
