"""What the searches for critical values found, in sentences that say what they rest on."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from lapwing.base.codes import SearchStage
from lapwing.base.messages import decimals
from lapwing.report.measured import critical_words, has_interval, value_and_interval
from lapwing.report.words import (
    listed,
    markdown,
    parameter_unit,
    parameter_words,
    plural,
    runs_of,
)
from lapwing.results.findings import SYMBOLS, search_bounded, search_known, words_beyond

if TYPE_CHECKING:
    import xarray as xr

    from lapwing.results.file import Results

MEANINGS = {"full": "contact can be kept", "safe": "no rattling seen",
            "back": "last back impact seen", "on": "a resting rigid tooth stays on"}
BANDS = 8  # of back impacts, named one by one; of more the outermost
REASONS = {"thrown_off": "a kink that throws the tooth off",
           "struck": "a kink that strikes the resting tooth, which bounces"}


def critical_table(criticals: list[xr.Dataset]) -> list[str]:
    """The values found by all searches, lines of a table in Markdown."""
    rows = [("name", "what", "parameter", "value", "uncertainty")]
    rows += [(one.attrs["name"], _meaning(one), parameter_words(one.attrs["parameter"])
              + f" ({_unit(one)})" * bool(_unit(one)), *_cells(one)) for one in criticals]
    return markdown(rows)


def table(criticals: list[xr.Dataset]) -> list[str]:
    """The summary's table of critical values; see `registry`."""
    return ["", "## Critical values", "", *critical_table(criticals)]


def section(criticals: list[xr.Dataset], results: Results) -> list[str]:
    """What the summary says of the searches; see `registry`."""
    sweeps = [results.sweep(name) for name in results.sweeps]
    return ["", "## The searches for critical values", "", *critical_text(criticals, sweeps)]


def critical_text(criticals: list[xr.Dataset], sweeps: Any = ()) -> list[str]:
    """Findings of all searches, a paragraph each.

    Parameters
    ----------
    criticals : sequence of Dataset, groups `critical_<name>` of a result file
    sweeps : sequence of Dataset, groups `sweep_<name>`; those along the braking torque tell what
        was seen to rattle above T_full

    Returns
    -------
    list of str, lines of Markdown
    """
    lines = [f"- `{one.attrs['name']}`: {_sentences(one)}{_seen(one, sweeps)}"
             for one in criticals]
    return [*lines, *_together(criticals)]


def headline(critical: Any) -> str:
    """The result of one search in one line."""
    attrs, (value, bar) = critical.attrs, _cells(critical)
    if attrs["outcome"] != "found" or not search_bounded(critical):
        name = SYMBOLS[attrs["find"]] if attrs["parameter"] == "brake_torque" else "critical value"
        return f"{name}: {value}"
    if attrs["find"] == "back":
        return (f"{_meaning(critical)} at {_with_unit(critical, attrs['last_seen'])}; "
                f"none at the {_quiet(critical)}")
    if has_interval(attrs) and not bar.startswith("±"):
        return f"{_meaning(critical)} {_name(critical)} {value} {_unit(critical)}: {bar}"
    bar = f" {bar}" * bar.startswith("±")
    if attrs.get("curve") == "samples":
        bar = " (samples used raw)"
    return f"{_meaning(critical)} {_name(critical)} {value}{bar} {_unit(critical)}".rstrip()


def _meaning(critical: Any) -> str:
    """What holds, and on which side of the value."""
    find = str(critical.attrs["find"])
    return MEANINGS[find] + f" {_sides(critical)[0]}" * (find != "back")


def _cells(critical: Any) -> tuple[str, str]:
    """Value of the table and how sure it is: rounding, half a bracket, the next value tried."""
    attrs = critical.attrs
    if not search_known(critical):
        return "not known", "–"
    if attrs["outcome"] != "found":
        end = "down" if attrs.get("safe_end") == "high" else "up"
        return {"safe_throughout": f"none {end} to {attrs.get('scan_to', 0):g}",
                "none_seen": f"none seen {end} to {attrs.get('scan_to', 0):g}",
                "unsafe_throughout": f"not found: beyond {attrs.get('scan_from', 0):g}, if any"
                }.get(attrs["outcome"], "none"), "–"
    if attrs["find"] in ("full", "on"):
        if has_interval(attrs):
            return value_and_interval(attrs)
        if attrs.get("curve") == "samples":
            return f"{attrs['estimate']:.6g}", "not known: samples used raw"
        return f"{attrs['estimate']:.12g}", "rounding"
    if attrs["find"] == "back":
        return f"{attrs['last_seen']:g}", f"none seen at the next, {attrs['first_clean']:g}"
    if not search_bounded(critical):
        limit = "at most" if attrs["safe_end"] == "high" else "at least"
        return f"{limit} {attrs['clean']:g}", "motions failed beyond"
    value, bar = decimals(attrs["estimate"], attrs["bar"])
    noise = f"; {value_and_interval(attrs)[1]}" if has_interval(attrs) else ""
    return value, f"± {bar}{noise}"


def _tried(critical: xr.Dataset) -> xr.Dataset:
    """The trials without the one that follows rattling longer."""
    return critical.isel(trial=critical["trial_stage"].values < SearchStage.CONFIRMATION)


def _unit(critical: Any) -> str:
    return parameter_unit(critical.attrs["parameter"])


def _name(critical: Any) -> str:
    """T_full and the like along the braking torque, else the parameter's name."""
    attrs = critical.attrs
    if attrs["parameter"] == "brake_torque":
        return SYMBOLS[attrs["find"]] + " ="
    return parameter_words(attrs["parameter"]) + " ="


def _seen(critical: xr.Dataset, sweeps: Any) -> str:
    """What sweeps with the same T_full saw rattle above it; empty for the other searches."""
    attrs = critical.attrs
    if attrs["find"] != "full" or attrs["outcome"] != "found":
        return ""
    same = [one for one in sweeps if one.attrs["parameter"] == attrs["parameter"]
            and "states_visited" in one and math.isclose(
                one.attrs.get("full_engagement", math.nan), attrs["estimate"], rel_tol=1e-9)]
    return "".join(f" Sweep {one.attrs['name']} above it: "
                   f"{words_beyond(one, attrs['estimate'], _unit(critical))}." for one in same)


def _with_unit(critical: Any, value: float) -> str:
    return f"{value:.10g} {_unit(critical)}".rstrip()


def _sides(critical: Any) -> tuple[str, str]:
    """On which side of a value it is safe, and on which not."""
    return ("above", "below") if critical.attrs.get("safe_end", "high") == "high" \
        else ("below", "above")


def _sentences(critical: xr.Dataset) -> str:
    sentences = {"full": _full, "on": _on, "safe": _safe, "back": _back}[critical.attrs["find"]]
    own = " (At a torque or speed of its own, set in its group.)"
    return sentences(critical) + critical_words(critical, _unit(critical)) \
        + own * bool(critical.attrs.get("own_operation", 0))


def _full(critical: xr.Dataset) -> str:
    attrs = critical.attrs
    if attrs["outcome"] == "resonance":
        return ("**none**: without damping and at a whole number of natural periods in the mesh "
                "period there is no engaged response.")
    if attrs["outcome"] != "found":
        return _throughout(critical, "the engaged motion keeps contact",
                           "the engaged motion loses contact")
    how = "closed form" if "scan_from" not in attrs else \
        f"scan of {attrs['scan_values']} values from {attrs['scan_from']:g}, then solved"
    side, other = _sides(critical)
    how += ", to rounding" * ("curve" not in attrs)
    return (f"**{_name(critical)} {_cells(critical)[0]} {_unit(critical)}** ({how}): {side} it "
            f"contact *can* be kept, by the engaged motion; just {other} it, contact is lost first "
            f"at mesh phase {attrs['phase']:.9f}. Other motions may rattle beside the engaged one: "
            "this search does not look for them.")


def _on(critical: xr.Dataset) -> str:
    attrs = critical.attrs
    if attrs["outcome"] in REASONS:
        return (f"**none**: at mesh phase {attrs['phase']:.6g} the transmission error has "
                f"{REASONS[attrs['outcome']]}, whatever the force.")
    if attrs["outcome"] != "found":
        return _throughout(critical, "a rigid tooth stays on the flank",
                           "a rigid tooth leaves the flank")
    side, other = _sides(critical)
    return (f"**{_name(critical)} {_cells(critical)[0]} {_unit(critical)}** (F = max g''"
            + ", to rounding" * ("curve" not in attrs) + f"): {side} it a rigid tooth that rests "
            f"on the drive flank stays there; just {other} it, the tooth leaves first at mesh "
            f"phase {attrs['phase']:.9f}. Bouncing may exist beside it.")


def _throughout(critical: xr.Dataset, good: str, bad: str) -> str:
    """A search whose range holds no change."""
    attrs = critical.attrs
    if attrs["outcome"] == "safe_throughout":
        end = _with_unit(critical, attrs["scan_to"])
        return (f"**none between {attrs['scan_from']:g} and {end}**: {good} at all "
                f"{attrs['scan_values']} values tried.")
    return (f"**beyond {_with_unit(critical, attrs['scan_from'])}**: already at this value, the "
            f"safe end of the search, {bad}; begin farther out.")


def _safe(critical: xr.Dataset) -> str:
    attrs = critical.attrs
    looked = (f"Motions: from rest and {attrs['n_starts'] - 1} starts "
              f"({attrs['start_phases']} phases × {attrs['start_positions']} positions × "
              f"{attrs['start_speeds']} speeds, in separation and in engagement), each looked at "
              f"for {plural(attrs['record'], 'mesh cycle')} after {attrs['settle']}; starts "
              "outside of this set are not covered.")
    if attrs["outcome"] != "found":
        bad = "some motion rattles" if search_known(critical) else \
            "some motion failed numerically, and whether any rattles is not known"
        return " ".join((_throughout(critical, "no motion rattles", bad),
                         _failures(critical) + looked))
    last, first = attrs["rattling"], attrs["clean"]
    trials = _tried(critical)
    at_last = _worst(trials, last)
    scanned = critical["trial_value"].values[critical["trial_stage"].values == SearchStage.SCAN]
    beyond = int(np.sum((scanned - first) * (first - last) > 0))
    value, bar = decimals(attrs["estimate"], attrs["bar"])
    others = f" and at the {plural(beyond, 'value')} tried {_sides(critical)[0]} it, as far as " \
             f"{attrs['scan_from']:g}," if beyond else ""
    still = f"{at_last['rattling']} of {at_last['starts']} motions still rattle" \
        if at_last["rattling"] else "some motion failed numerically, and none is seen to rattle"
    head = f"**{_name(critical)} {value} ± {bar} {_unit(critical)}** (the middle of a bracket " \
        "and half its width)" if at_last["rattling"] else \
        f"**{_name(critical).removesuffix(' =')} {_cells(critical)[0]} {_unit(critical)}**"
    return (f"{head}: at {_with_unit(critical, last)} {still}, "
            f"at {_with_unit(critical, first)}{others} none. "
            + _failures(trials) + _confirmation(critical) +
            f"Rattling motions were carried on in steps of {2 * attrs['resolution']:.3g} "
            f"{_unit(critical)} or less until none survived. " * bool(at_last["rattling"])
            + _died_before(critical) + _further(critical) + looked)


def _worst(trials: xr.Dataset, value: float) -> dict[str, int]:
    """Numbers of the trial with most rattling at one value."""
    at = np.flatnonzero(trials["trial_value"].values == value)
    best = at[np.argmax(trials["trial_rattling"].values[at])]
    return {key: int(trials[f"trial_{key}"].values[best]) for key in ("rattling", "starts")}


def _failures(trials: xr.Dataset) -> str:
    failed = int(trials["trial_failed"].sum())
    how = "no value with one is taken as safe" if "trial_rattling" in trials else \
        "they are left out"
    return f"**{plural(failed, 'motion')} failed numerically; {how}.** " if failed else ""


def _confirmation(critical: xr.Dataset) -> str:
    stage = critical["trial_stage"].values
    if not np.any(stage == SearchStage.CONFIRMATION):
        return ""
    one = critical.isel(trial=int(np.flatnonzero(stage == SearchStage.CONFIRMATION)[0]))
    starts, rattling, failed = (int(one[f"trial_{key}"]) for key in (
        "starts", "rattling", "failed"))
    if starts == failed:
        return f"All {starts} of those followed ten times as long failed. "
    transient = ": there, rattling is a long transient" * (not rattling and not failed)
    lost = f", {failed} failed" * bool(failed)
    return (f"Of {starts} of those followed ten times as long {rattling} still "
            f"{'rattles' if rattling == 1 else 'rattle'}{lost}{transient}. ")


def _died_before(critical: xr.Dataset) -> str:
    """That what was carried to the last rattling value had died on the way, where it had."""
    last = critical.isel(trial=critical["trial_value"].values == critical.attrs["rattling"])
    carried = last["trial_rattling"].values[last["trial_stage"].values == SearchStage.CARRIED]
    if not carried.size or carried.any() or not last["trial_rattling"].any():
        return ""
    return (f"Those carried to {_with_unit(critical, critical.attrs['rattling'])} from "
            f"{_sides(critical)[1]} died on the way: what rattles there is of its own starts. ")


def _further(critical: xr.Dataset) -> str:
    """What rattles at the values tried beyond the first rattling one."""
    further = critical.isel(trial=critical["trial_stage"].values == SearchStage.FURTHER)
    count = further.sizes["trial"]
    if not count:
        return ""
    side = _sides(critical)[1]
    still = further["trial_rattling"].values == 0
    blind = still & (further["trial_failed"].values > 0)
    quiet = further["trial_value"].values[still & ~blind]
    carried = "and motions found there were carried back to it"
    if blind.any():
        found = ((int((~still).sum()), "some motion rattles"), (quiet.size, "none does"),
                 (int(blind.sum()), "motions failed and none is seen to rattle"))
        return f"Of the {plural(count, 'value')} tried {side} the bracket, " + ", ".join(
            f"at {number} {words}" for number, words in found if number) + ". "
    if not quiet.size:
        return (f"At each of the {plural(count, 'value')} tried {side} the bracket some motion "
                f"rattles, {carried}. ")
    return (f"Of the {plural(count, 'value')} tried {side} the bracket none rattles at "
            + ", ".join(f"{value:g}" for value in np.sort(quiet))
            + f": not one threshold. At the others some motion rattles, {carried}. ")


def _back(critical: xr.Dataset) -> str:
    attrs = critical.attrs
    looked = (f"Motions: from rest and {attrs['n_starts'] - 1} starts "
              f"({attrs['start_phases']} phases × {attrs['start_positions']} positions × "
              f"{attrs['start_speeds']} speeds, in separation and in engagement), each examined "
              f"for {plural(attrs['record'], 'mesh cycle')} after {attrs['settle']}.")
    examined = critical["trial_cycles"].values[:attrs["clean_values"]] > 0
    if attrs["outcome"] == "none_seen" and not examined.any():
        return "**not known**: every motion failed numerically. " + looked
    if attrs["outcome"] == "none_seen":
        return (f"**no back impact seen** at any of {plural(examined.sum(), 'value')} examined "
                f"from {attrs['scan_from']:g} to {_with_unit(critical, attrs['scan_to'])}. "
                + _bound(critical) + _failures(critical) + looked)
    if attrs["outcome"] == "unsafe_throughout":
        return _throughout(critical, "", "a back impact is seen") + " " \
            + _failures(critical) + looked
    at = int(np.flatnonzero(critical["trial_value"].values == attrs["last_seen"])[0])
    seen, cycles = (int(critical[f"trial_{key}"].values[at]) for key in ("back_cycles", "cycles"))
    bursts = f", in {plural(int(critical['trial_bursts'].values[at]), 'burst')}" \
        if "trial_bursts" in critical else ""
    return (f"**last back impact seen at {_with_unit(critical, attrs['last_seen'])}** ({seen:,} of "
            f"{cycles:,} mesh cycles{bursts}); none at the {_quiet(critical)}, "
            f"{attrs['clean_cycles']:,} cycles in all. "
            + _bound(critical) + _bands(critical) + " " + _failures(critical) + looked)


def _quiet(critical: Any) -> str:
    """The values without a back impact next to the safe end, those at which anything is known."""
    attrs = critical.attrs
    examined = np.flatnonzero(critical["trial_cycles"].values[:attrs["clean_values"]] > 0)
    blind = attrs["clean_values"] - examined.size
    return (f"{plural(examined.size, 'value')} examined from {attrs['first_clean']:g} to "
            f"{_with_unit(critical, attrs['clean_end'])}"
            + f" (every motion failed at {blind} more)" * bool(blind))


def _bound(critical: xr.Dataset) -> str:
    """The one-sided limit of the rate in words."""
    attrs = critical.attrs
    quiet = critical["trial_back_cycles"].values[:attrs["clean_values"]]
    examined = critical["trial_cycles"].values[:quiet.size]
    blind = int((examined == 0).sum())
    percent = f"{100 * attrs['confidence']:g} %"
    if blind:
        return (f"**At {plural(blind, 'value')} of this range every motion failed; nothing is "
                "known there.** ")
    least = int(examined.min())
    return ("At each of these a burst of back impacts begins, if at all, less often than once in "
            f"{1 / attrs['rate_bound']:,.0f} mesh cycles, with {percent} confidence (one-sided; "
            f"exact Poisson limit for none seen in {least:,} cycles, bursts taken as "
            "independent). ")


def _bands(critical: xr.Dataset) -> str:
    """Values with and without a back impact, from low to high."""
    order = np.argsort(critical["trial_value"].values)
    order = order[critical["trial_cycles"].values[order] > 0]
    blind = order.size < critical.sizes["trial"]
    values = critical["trial_value"].values[order]
    hit = critical["trial_back_cycles"].values[order] > 0
    found, bands = runs_of(hit), listed(runs_of(hit), values, BANDS)
    if len(found) == 1:
        return (f"Back impacts at {bands} {_unit(critical)}, at every value of the grid "
                f"{'examined ' * blind}between.")
    return (f"**Not one threshold:** back impacts come in {len(found)} bands of the grid, "
            f"{bands} {_unit(critical)}, and none is seen at the values "
            f"{'examined ' * blind}between them.")


def _together(criticals: list[xr.Dataset]) -> list[str]:
    """What T_full (rigid teeth: T_on) and T_safe say together."""
    found = {one.attrs["find"]: one.attrs for one in criticals
             if one.attrs["parameter"] == "brake_torque" and one.attrs["outcome"] == "found"
             and not one.attrs.get("own_operation", 0)}
    first = "full" if "full" in found else "on"
    if not {first, "safe"} <= found.keys():
        return []
    kept, safe = found[first]["estimate"], found["safe"]
    if abs(safe["estimate"] - kept) <= safe["bar"]:
        return ["", f"T_safe agrees with {SYMBOLS[first]} within its bar: above it nothing but "
                "engagement was found from the starts looked at."]
    if safe["estimate"] < kept:
        return []
    trials = next(one for one in criticals if one.attrs is safe)
    between = (trials["trial_value"].values > kept) & (trials["trial_value"].values
                                                       <= safe["rattling"])
    tried, seen = (np.unique(trials["trial_value"].values[rows]).size for rows in (
        between, between & (trials["trial_rattling"].values > 0)))
    if not seen:
        return []
    return ["", f"Between {kept:.4g} and {safe['estimate']:.4g} N·m contact can be kept, and "
            f"rattling was seen at {seen} of {plural(tried, 'value')} tried there: the start "
            "decides, and a disturbance may start the rattling."]
