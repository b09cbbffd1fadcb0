"""What basins say in words: which attractors there are, their parts of the plane, the boundary."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from lapwing.base.arrivals import arrivals_in
from lapwing.base.codes import Status
from lapwing.base.messages import percent
from lapwing.report.attractors.words import attractor_rows, lossless, motion_words
from lapwing.report.words import markdown, plural, sections
from lapwing.results.findings import endings

if TYPE_CHECKING:
    import xarray as xr

    from lapwing.results import Results

# Motions of which a sentence tells: those with the largest shares.
MOST_TOLD = 5
PLANES = {"state": "states (φ, dφ/dτ)", "drive": "arrivals at the drive flank (phase, speed)",
          "coast": "arrivals at the coast flank (phase, speed)"}

# What the sides of a plane are in words, the factor to the unit told, and that.
SIDES = {"start_phi": ("φ", 1e6, "µrad"), "start_phi_dot": ("dφ/dτ", 1e6, "µrad"),
         "start_phase": ("phase", 1.0, ""), "start_speed": ("speed", 1e6, "µrad")}


def section(planes: list[xr.Dataset], results: Results) -> list[str]:
    """The summary's part on basins; see `registry`."""
    return sections("Basins", planes, basins_text)


def headline(data: xr.Dataset) -> str:
    """How many attractors, and cells whose end is not known."""
    _, open_, failed = endings(data)
    unresolved = int(data.attrs["unresolved"])
    return (f"{plural(data.sizes['attractor'], 'attractor')} in {data['status'].size} cells"
            + f"; {unresolved} not resolved" * bool(unresolved)
            + f"; {open_} not reached" * bool(open_) + f"; {failed} failed" * bool(failed))


def findings(data: xr.Dataset) -> list[str]:
    """What basins answer, as a sentence or two in Markdown; none where no cell has an end."""
    if not (data["attractor_of_run"].values > 0).any():
        return []
    labels, motions = data["attractor_of_run"].values, data["runs_ended"].values > 0
    lost, there = int((labels <= 0).sum()), np.flatnonzero(motions)
    told, rest = there, 0.0
    if there.size > MOST_TOLD:
        parts = data["share"].values
        told = np.sort(there[np.argsort(-parts[there], kind="stable")[:MOST_TOLD]])
        rest = float(parts[np.setdiff1d(there, told)].sum())
    shares = [f"{percent(float(one['share']))} in {motion_words(one, data)}"
              for i in told for one in (data.isel(attractor=i),)]
    if rest:
        shares.append(f"{percent(rest)} in {there.size - MOST_TOLD} others")
    state = data.attrs["plane"] == "state"
    what = "the start" if state else f"an arrival at the {data.attrs['plane']} flank"
    said = f"{what} decides between {'at least ' * bool(lost)}{there.size} motions" \
        if there.size > 1 else \
        f"all {_starts(data)}{' whose end is known' * bool(lost)} lead to one motion"
    every = f"of {labels.size - lost} {_starts(data)} {_rectangle(data)} end"
    said = said if "brake_torque" in data.attrs else said[0].upper() + said[1:]
    return [f"**{_torque(data)}{said}**: {shares[0].replace(' in ', f' {every} in ', 1)}"
            + "".join(f"; {one}" for one in shares[1:]) + f"; of other starts the shares are others"
            f" (basins `{data.attrs['name']}`)."
            + f" Of {lost} the end is not known." * bool(lost) + lossless(data.attrs)]


def rattling_torques(planes: Sequence[xr.Dataset]) -> list[float]:
    """Braking torques (N·m) of the planes in which some start leads to rattling."""
    return [float(one.attrs["brake_torque"]) for one in planes if "brake_torque" in one.attrs
            and ((one["runs_ended"] > 0) & (one["deepest_separation"] > 0)).any()]


def _torque(data: xr.Dataset) -> str:
    return f"At {float(data.attrs['brake_torque']):g} N·m " if "brake_torque" in data.attrs else ""


def _starts(data: xr.Dataset) -> str:
    """What the cells are, in a sentence."""
    return "starts" if data.attrs["plane"] == "state" \
        else f"arrivals at the {data.attrs['plane']} flank"


def _rectangle(data: xr.Dataset) -> str:
    """From where the starts are taken: 'from φ -300 to 100 µrad and dφ/dτ -150 to 150 µrad'."""
    ends = []
    for side in "xy":
        name = str(data.attrs[f"{side}_parameter"])
        words, factor, unit = SIDES[name]
        values = factor * data[name].values
        span = values[-1] - values[0]
        half = 0.5 * span / max(values.size - 1, 1)
        # What is not 0 but for rounding is 0.
        low, high = (end if abs(end) > 1e-9 * span else 0.0
                     for end in (values[0] - half, values[-1] + half))
        ends.append(f"{words} {low:.4g} to {high:.4g} {unit}".rstrip())
    return f"with {' and '.join(ends)}"


def basins_text(data: xr.Dataset) -> list[str]:
    """Findings of one plane, lists and a table.

    Parameters
    ----------
    data : xarray.Dataset, group `basins_<name>` of a result file

    Returns
    -------
    list of str, lines of Markdown
    """
    attrs = data.attrs
    x, y = (data[str(attrs[f"{side}_parameter"])].size for side in "xy")
    at = f" at mesh phase {float(attrs['phase']):g}" * (attrs["plane"] == "state")
    law = arrivals_in(attrs)
    reached = data["status"].values != Status.UNFINISHED
    lines = [
        f"- {x} × {y} {PLANES[attrs['plane']]}{at}, contact law `{attrs['contact_law']}`, impact "
        f"law `{attrs['impact_law']}`; {int(attrs['failed']) or 'none'} of {reached.sum()} failed, "
        f"{int(attrs['unresolved']) or 'none'} not resolved"
        + f", **{int(attrs['not_reached'])} not reached**" * bool(attrs["not_reached"]),
        f"- of {int((data['attractor_of_run'].values > 0).sum())} cells whose end is known it is "
        f"presumed in {int(attrs['presumed']) or 'none'} and certain in the others (what that "
        "means: docs/attractors.md)",
        f"- {law.word}s are counted: {law.rule(attrs['count_depth'])}"
        + " separation" * law.threshold]
    if not data.sizes["attractor"]:
        return [*lines, "- no motion was recognised: nothing is known"]
    return [*lines, f"- {_boundary(data)}", "", *markdown(attractor_rows(data))]


def _boundary(data: xr.Dataset) -> str:
    """The boundary entropy, and what it says."""
    attrs = data.attrs
    if not attrs["boxes"]:
        return "nothing is known of the boundary: no box of cells has ends that are all known"
    left = f"; {attrs['boxes_left_out']} boxes with an end that is not known are left out" \
        * bool(attrs["boxes_left_out"])
    side = attrs["entropy_box"]
    if not attrs["boundary_boxes"]:
        return f"no boundary in {attrs['boxes']} boxes of {side} × {side} cells{left}"
    value = float(attrs["boundary_entropy"])
    fractal = ", more than ln 2 = 0.69: the boundary is fractal at this resolution" \
        if value > math.log(2) else ", not more than ln 2: this does not tell whether it is fractal"
    return (f"boundary entropy {value:.3g}{fractal}; {attrs['boundary_boxes']} of {attrs['boxes']} "
            f"boxes of {side} × {side} cells hold more than one basin{left}")


__all__ = ["findings", "headline", "section"]
