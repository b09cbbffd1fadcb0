"""Impacts per mesh cycle as a staircase over the parameter of a sweep, with a strip of classes."""

from __future__ import annotations

import re
from itertools import groupby
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from lapwing.base.arrivals import arrivals_in, per_cycle
from lapwing.base.codes import Status
from lapwing.plots import critical_marks, style
from lapwing.plots.sweep import parts as sweep_parts
from lapwing.results.findings import known

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# A run of one class is named in the strip where it is wider than this part of the axis.
NAMED_FROM = 0.045
UNFINISHED = "unfinished"
PERIODIC = re.compile(r"(\d+):\((\d+),(\d+)\)(c?)$")


def shows(sweep: xr.Dataset) -> bool:
    """Whether some point has a result, and the sweep what is drawn."""
    return bool(known(sweep).any() and "motion_class" in sweep)


@style.house_style()
def draw(sweep: xr.Dataset, *, title: str | None = None, full_engagement: float | None = None,
         claims: list[Any] | None = None, marks: Any = ()) -> Figure:
    """Draw counted impacts per cycle and, for each start, the classes p:(i,j).

    Parameters
    ----------
    sweep : xarray.Dataset, result of `lapwing.sweep` with 'cycles' observed, as it is or as group
        `sweep_<name>` of a result file
    title : str
    full_engagement : float or None, parameter value above which the engaged response never
        separates; default: as stored with the sweep
    claims : sequence of (parameter value, depth in rad, text, impacts per cycle); default: as
        stored with the sweep
    marks : sequence of critical_marks.Mark, critical values to draw as bars

    Returns
    -------
    matplotlib.figure.Figure
    """
    parameter = sweep_parts.parameter_of(sweep)
    values = sweep[parameter].values
    branches = list(reversed(sweep_parts.branches(sweep)))
    figure = style.new_figure(10, 4.2 + 0.55 * len(branches))
    axes = figure.subplots(1 + len(branches), 1, sharex=True,
                           height_ratios=[3.4, *[0.55] * len(branches)])
    claims = [one for one in sweep_parts.claims_of(sweep, claims) if np.isfinite(one.impacts)]
    axes[0].set_title(f"(a) {_stairs(axes[0], sweep, claims)}")
    most = max((_impacts(name) for name in sweep["motion_class"].values.ravel()), default=0) or 1
    for axis, (branch, look) in zip(axes[1:], branches, strict=True):
        open_ = branch["status"].values == Status.UNFINISHED
        _strip(axis, values, np.where(open_, UNFINISHED, branch["motion_class"].values), most,
               look["label"])
    word = arrivals_in(sweep.attrs).word
    axes[1].set_title(f"(b) class p:(i,j), i drive and j coast {word}s in p mesh cycles; c: "
                      "complete chatter,\nthe count then hangs on its threshold; hatched: no "
                      "period, crossed: failed, blank: not reached")
    engaged = sweep_parts.full_engagement_of(sweep, full_engagement)
    sweep_parts.mark_full_engagement(axes[:1], engaged, axes[0], sweep, height=0.4)
    critical_marks.draw_marks(axes[:1], axes[0], marks, values, engaged)
    sweep_parts.finish(figure, axes, sweep,
                       f"staircase: {sweep.attrs.get('name', '')}" if title is None else title)
    sweep_parts.legend(figure, axes[0], sweep, claims=bool(claims))
    return figure


def _stairs(axis: Axes, sweep: xr.Dataset, claims: list[Any]) -> str:
    """Impacts per cycle of each start; returns the heading."""
    for branch, look in sweep_parts.branches(sweep):
        x = branch[sweep_parts.parameter_of(sweep)].values
        axis.step(x, per_cycle(branch), where="mid",
                  color=look["color"], linewidth=0.8 + 0.5 * look["size"])
    for claim in claims:
        sweep_parts.claim_marker(axis, claim.value, claim.impacts)
    axis.set_ylim(bottom=0)
    law = arrivals_in(sweep.attrs)
    axis.set_ylabel(f"{law.word}s\nper cycle")
    axis.yaxis.get_major_locator().set_params(integer=True)
    return f"{law.word}s per cycle, {law.rule(float(sweep.attrs['count_depth']))}; drive flank"


def _impacts(name: str) -> float:
    """Drive impacts per cycle of a class; 0 where it has none."""
    found = PERIODIC.match(str(name))
    return int(found[2]) / int(found[1]) if found else 0


def _strip(axis: Axes, values: NDArray[Any], classes: NDArray[Any], most: float,
           label: str) -> None:
    """Runs of one class as boxes, coloured by their impacts per cycle."""
    import matplotlib as mpl

    colours = mpl.colormaps["cividis"]
    edges = sweep_parts.edges_of(values)
    width = edges[-1] - edges[0]
    at = 0
    for name, run in groupby(classes.astype(str)):
        first, at = at, at + len(list(run))
        if name == UNFINISHED:
            continue
        left, right = edges[first], edges[at]
        found = PERIODIC.match(name)
        share = _impacts(name) / most
        look = {"facecolor": colours(0.15 + 0.85 * share)} if found else {
            "facecolor": "white", "hatch": "xxxx" if name == "failed" else "////"}
        axis.axvspan(left, right, edgecolor="0.55" if not found else "none", linewidth=0, **look)
        axis.axvline(left, color="white", linewidth=0.3)
        if right - left > NAMED_FROM * width:
            axis.text(0.5 * (left + right), 0.5, name if found else "none", ha="center",
                      va="center", fontsize=7.5, transform=axis.get_xaxis_transform(),
                      color="black" if share > 0.45 or not found else "white",
                      bbox=None if found else {"facecolor": "white", "edgecolor": "none",
                                               "pad": 0.8})
    if np.all(classes == UNFINISHED):
        style.note(axis, "not reached")
    axis.set_yticks([])
    axis.grid(False)
    axis.set_ylabel(label.replace(" ", "\n", 1), rotation=0, ha="right", va="center", fontsize=8)


__all__ = ["draw"]
