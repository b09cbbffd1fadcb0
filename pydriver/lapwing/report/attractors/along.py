"""What attractors along a parameter say in words: which there are, where, and how often met."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from lapwing.base.arrivals import arrivals_in
from lapwing.base.messages import percent
from lapwing.report.answers.conditions import Conditions
from lapwing.report.attractors.words import lossless
from lapwing.report.words import markdown, parameter_unit, parameter_words, plural, sections, span

if TYPE_CHECKING:
    import xarray as xr

    from lapwing.results import Results

# Rows of the table: the attractors that are met over the most values.
MOST_ROWS = 24
# Classes of one attractor told; of more the outermost.
MOST_CLASSES = 5


def section(lines: list[xr.Dataset], results: Results) -> list[str]:
    """The summary's part on attractors; see `registry`."""
    return sections("Attractors", lines, along_text)


def headline(data: xr.Dataset) -> str:
    """How many attractors along how many values, and what is not known."""
    reached = data["reached"].values == 1
    open_ = int(reached.size - reached.sum())
    unresolved, failed = (int(data[name].values[reached].sum()) for name in (
        "unresolved", "failed"))
    return (f"{plural(data.sizes['attractor'], 'attractor')} along "
            f"{plural(int(reached.sum()), 'value')} of "
            f"{parameter_words(str(data.attrs['parameter']))}"
            + f"; {plural(unresolved, 'run')} not resolved" * bool(unresolved)
            + f"; {plural(open_, 'value')} not reached" * bool(open_)
            + f"; {failed} failed" * bool(failed))


def findings(data: xr.Dataset) -> list[str]:
    """What it answers, as a sentence or two in Markdown; none where no motion was recognised."""
    reached = data["reached"].values == 1
    if not (data["period"].values[reached] >= 0).any():
        return []
    name, runs = str(data.attrs["parameter"]), int(data.attrs["runs"])
    values, unit = data[name].values[reached], parameter_unit(name)
    there = data["period"].values[reached] >= 0
    most = int(there.sum(axis=1).max())
    at = values[there.sum(axis=1) == most]
    words = parameter_words(name)
    safe, quiet = [], quiet_values(data)
    if quiet.size:
        conditions = Conditions.of(data.attrs, float(data.attrs.get("pinion_teeth", math.nan)))
        told = "; ".join(filter(None, [conditions.words(data.attrs),
                                       plural(runs, "random start")
                                       + f" at each of {quiet.size} values" * (quiet.size > 1)]))
        where = ("from " if quiet.size > 1 else "at ") + span(quiet, unit)
        safe = [f"**No start rattles {where}" + " on the gear" * (name == "brake_torque")
                + f"** ({told})."]
    coexist = f"Up to {most} motions coexist** ({span(at, unit)})" if most > 1 \
        else "No two motions were found together**"
    said = [f"**{coexist}, along {words} {span(values, unit)}, from "
            f"{plural(runs, 'random start')} at each of {plural(values.size, 'value')} "
            f"(attractors `{data.attrs['name']}`)"]
    moves = _rattles(data)[reached]
    rattling = np.nansum(np.where(moves, data["share"].values[reached], 0.0), axis=1)
    last = np.flatnonzero(moves.any(axis=1))
    if last.size:
        share = rattling[last[-1]]
        said.append(f"the last value at which separation was found is {values[last[-1]]:g} {unit}"
                    .rstrip() + f", from {percent(float(share))} of the starts there"
                    + " (the last one looked at)" * bool(last[-1] == values.size - 1))
    else:
        said.append("no separation was found")
    lost = data["unresolved"].values[reached] + data["failed"].values[reached]
    return [*safe, "; ".join(said) + ". A motion that no start led to is not excluded"
            + f"{_bound(lost, runs)}."
            + f" Of {plural(int(lost.sum()), 'run')} the end is not known." * bool(lost.any())
            + lossless(data.attrs)]


def _bound(lost: NDArray[Any], runs: int) -> str:
    """Below which share of the starts a motion that none led to lies: those lost may lead to it."""
    from scipy.special import betaincinv

    most = int(lost.max())
    if most >= runs:
        return ""
    return (": its share of the starts at a value is below "
            f"{percent(float(betaincinv(most + 1, runs - most, 0.95)))}, with 95 % confidence")


def rattling_torques(lines: Sequence[xr.Dataset]) -> list[float]:
    """Braking torques (N·m) at which some start leads to rattling, of lines along it."""
    return [float(value) for one in lines if one.attrs["parameter"] == "brake_torque"
            for value in one["brake_torque"].values[_rattles(one).any(axis=1)]]


def quiet_values(data: xr.Dataset) -> NDArray[Any]:
    """Values above the last rattling, ascending, where the end of every start is known."""
    values = data[str(data.attrs["parameter"])].values
    lost = (data["reached"].values != 1) | (data["unresolved"].values > 0) \
        | (data["failed"].values > 0)
    order = np.argsort(values)
    known = ~(lost | _rattles(data).any(axis=1))[order]
    above: NDArray[Any] = values[order][np.logical_and.accumulate(known[::-1])[::-1]]
    return above


def _rattles(data: xr.Dataset) -> NDArray[np.bool_]:
    """Which attractors are there at which value (value, attractor), and part."""
    moves: NDArray[np.bool_] = (data["reached"].values == 1)[:, None] \
        & (data["period"].values >= 0) & (data["deepest_separation"].values > 0)
    return moves


def along_text(data: xr.Dataset) -> list[str]:
    """Findings along one parameter, lists and a table.

    Parameters
    ----------
    data : xarray.Dataset, group `attractors_<name>` of a result file

    Returns
    -------
    list of str, lines of Markdown
    """
    attrs, reached = data.attrs, data["reached"].values == 1
    name = str(attrs["parameter"])
    law, unit = arrivals_in(attrs), parameter_unit(name)
    open_ = int(reached.size - reached.sum())
    lost = {what: int(data[what].values[reached].sum()) for what in (
        "failed", "unresolved", "presumed")}
    values = data[name].values
    lines = [
        f"- {parameter_words(name)} {span(values, unit)}, {plural(values.size, 'value')}"
        + f", **{open_} not reached**" * bool(open_)
        + f"; {attrs['runs']} random starts at each (seed {attrs['seed']}), contact law "
        f"`{attrs['contact_law']}`, impact law `{attrs['impact_law']}`; {lost['failed'] or 'none'} "
        f"of {int(attrs['runs']) * int(reached.sum())} failed, {lost['unresolved'] or 'none'} not "
        f"resolved, the end of {lost['presumed'] or 'none'} is presumed (docs/attractors.md)",
        "- an attractor keeps its number from a value to the next where its motion was continued "
        "there and a run ends in it; shares are parts of the random starts, limits of them are in "
        "the file",
        f"- {law.word}s are counted: {law.rule(attrs['count_depth'])}"
        + " separation" * law.threshold]
    if not data.sizes["attractor"]:
        return [*lines, "- no motion was recognised: nothing is known"]
    return [*lines, "", *_table(data, unit)]


def _table(data: xr.Dataset, unit: str) -> list[str]:
    name = str(data.attrs["parameter"])
    there = (data["period"].values >= 0) & (data["reached"].values == 1)[:, None]
    order = np.argsort(-there.sum(axis=0), kind="stable")[:MOST_ROWS]
    rows = [("attractor", f"{parameter_words(name)}" + f" ({unit})" * bool(unit), "values",
             "class, lowest to highest", "deepest separation (µrad)", "share")]
    for i in np.sort(order):
        at = np.flatnonzero(there[:, i])
        if not at.size:
            continue
        kinds = list(dict.fromkeys(str(data["motion_class"].values[k, i]) for k in at))
        kinds = kinds if len(kinds) <= MOST_CLASSES else [*kinds[:2], "…", *kinds[-2:]]
        depth = 1e6 * data["deepest_separation"].values[at, i]
        shares = data["share"].values[at, i]
        rows.append((str(i + 1), span(data[name].values[at], ""), str(at.size), ", ".join(kinds),
                     _from_to(f"{depth.min():.3g}", f"{depth.max():.3g}"),
                     _from_to(percent(float(shares.min())), percent(float(shares.max())))))
    more = data.sizes["attractor"] - len(order)
    return [*markdown(rows), *["", f"{plural(more, 'attractor')} more, met at fewer values, "
                               "in the file."] * (more > 0)]


def _from_to(low: str, high: str) -> str:
    return low if low == high else f"{low} to {high}"


__all__ = ["along_text", "findings", "headline", "section"]
