"""Findings besides those along the braking torque: other parameters, other operating points."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from lapwing.base.arrivals import arrivals_in
from lapwing.base.messages import at_least, at_most
from lapwing.base.quantities import are_labels
from lapwing.report.amplitudes import greatest
from lapwing.report.answers.evidence import Look, failures, looks, together
from lapwing.report.critical import headline
from lapwing.report.words import bands, parameter_unit, parameter_words, plural, span
from lapwing.results.findings import names

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
    """Where the teeth part, and strike the coast flank, along another parameter, by the starts."""
    parameter = str(sweep["status"].dims[1])
    unit = parameter_unit(parameter)
    found = [one for one in looks((), (), [sweep], parameter) if one.motions.any()]
    values = together(found, "rattling").values
    if not values.size:
        return ""
    law = arrivals_in(sweep.attrs)
    at = f" at {sweep.attrs['brake_torque']:g} N·m on the gear" \
        if "brake_torque" in sweep.attrs else ""
    every, words = together(found, "rattling"), parameter_words(parameter)
    many = values.size > 1
    looked = f"{values.size} values looked at, " * many + span(values, unit)
    if every.seen.any() and not every.seen.all() and not are_labels(values):
        text = (f"**Avoid a {words} of {bands(every.values, every.seen)} {unit}".rstrip()
                + f"{at}**: of {looked}, the teeth {_parting(found, unit)}")
    else:
        text = f"**Along the {words}{at}** ({looked}) the teeth {_parting(found, unit)}"
    text += f"; back {law.word}s {_back(found, unit)}"
    moved = greatest(sweep, "dynamic_te_rms", 1e6, "µrad", unit) if "dynamic_te_rms" in sweep \
        else ""
    text += f"; the dynamic transmission error has its greatest rms, {moved}" * bool(moved)
    lost = failures(looks((), (), [sweep], parameter))
    return text + f"; {plural(lost, 'run')} failed" * bool(lost) + "."


def _parting(found: list[Look], unit: str) -> str:
    """Where the teeth part, in words."""
    every = together(found, "rattling")
    if every.seen.all():
        return "part everywhere" + " from some start" * (len(_by_starts(found, "rattling")) > 1)
    if not every.seen.any():
        return "were not seen to part"
    told = _by_starts(found, "rattling")
    if len(told) == 1:
        return f"part at {bands(every.values, every.seen)} {unit}, not at " \
            f"{bands(every.values, ~every.seen)} {unit}".replace(" ,", ",").rstrip()
    return "part " + ", ".join(
        (f"at {where} {unit}".rstrip() if where else "nowhere") + f" ({names(starts)})"
        for where, starts in told.items())


def _back(found: list[Look], unit: str) -> str:
    """Where the coast flanks were met, in words."""
    every = together(found, "back")
    return f"were seen at {bands(every.values, every.seen)} {unit}".rstrip() if every.seen.any() \
        else "were not seen"


def _by_starts(found: list[Look], what: str) -> dict[str, list[str]]:
    """Bands in which something was seen, in words -> the starts that have seen it there."""
    told: dict[str, list[str]] = {}
    for one in found:
        seen = together([one], what)
        told.setdefault(bands(seen.values, seen.seen), []).append(one.how)
    return told
