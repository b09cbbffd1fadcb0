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

# A run of one class is named in the strip where it is wider than this part of what is shown.
NAMED_FROM = 0.036
# Runs without a name in each strip that are worth a second look, and the part then magnified.
FEW, MAGNIFIED = 4, 0.2
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
    sweep = sweep_parts.placed(sweep)
    values = sweep[sweep_parts.parameter_of(sweep)].values
    branches = sweep_parts.branches(sweep)
    strips = [(np.where(branch["status"].values == Status.UNFINISHED, UNFINISHED,
                        branch["motion_class"].values).astype(str), look["label"])
              for branch, look in branches]
    near = _crowded(values, [classes for classes, _ in strips])
    figure = style.new_figure(10, 4.2 + (0.55 * len(strips) + 0.9) * (1 + (near is not None)) - 0.7,
                              rows=True)
    rows = len(strips) * (1 + (near is not None))
    axes = figure.subplots(1 + rows, 1, height_ratios=[3.4, *[0.55] * rows])
    for axis in axes[1:1 + len(strips)]:
        axis.sharex(axes[0])
    claims = [one for one in sweep_parts.claims_of(sweep, claims) if np.isfinite(one.impacts)]
    axes[0].set_title(f"(a) {_stairs(axes[0], sweep, claims)}")
    most = max((_impacts(name) for name in sweep["motion_class"].values.ravel()), default=0) or 1
    whole = sweep_parts.edges_of(values)[[0, -1]]
    for first, ends in ((1, whole), (1 + len(strips), near)):
        if ends is None:
            continue
        for axis, (classes, label) in zip(axes[first:], strips, strict=False):
            _strip(axis, values, classes, most, label, ends, sweep_parts.in_columns(sweep))
            axis.tick_params(labelbottom=False)
        axes[first + len(strips) - 1].tick_params(labelbottom=True)
    law = arrivals_in(sweep.attrs)
    axes[1].set_title(f"(b) class p:(i,j), i drive and j coast {law.word}s in p mesh cycles"
                      + "; c: complete chatter,\nwhose count depends on the threshold"
                      * law.threshold + "; hatched: no period, crossed: failed, blank: not "
                      "reached")
    if near is not None:
        axes[1 + len(strips)].set_title("(c) the same, magnified where classes are closest")
        for axis in axes[1 + len(strips):]:
            axis.set_xlim(*near)
        axes[-1].set_xlabel(sweep_parts.axis_label(sweep_parts.parameter_of(sweep)))
    critical_marks.mark_sweep(axes[:1], sweep, full_engagement, marks)
    sweep_parts.finish(figure, axes[:1 + len(strips)], sweep, "staircase", title)
    axes[0].tick_params(labelbottom=False)
    if near is not None:
        axes[len(strips)].set_xlabel("")
    sweep_parts.legend(figure, sweep, claims=bool(claims), lines=True)
    return figure


def _crowded(values: NDArray[Any], strips: list[NDArray[Any]]) -> tuple[float, float] | None:
    """The part of the range with most runs too narrow for a name, or None where they are few."""
    edges = sweep_parts.edges_of(values)
    width = edges[-1] - edges[0]
    narrow = np.sort([0.5 * (left + right) for classes in strips
                      for name, left, right in _runs(classes, edges)
                      if PERIODIC.match(name) and right - left < NAMED_FROM * width])
    if narrow.size < FEW * len(strips):
        return None
    inside = np.searchsorted(narrow, narrow + MAGNIFIED * width) - np.arange(narrow.size)
    left = max(narrow[np.argmax(inside)] - 0.02 * width, edges[0])
    return float(left), float(min(left + MAGNIFIED * width, edges[-1]))


def _runs(classes: NDArray[Any], edges: NDArray[Any],
          alone: bool = False) -> list[tuple[str, float, float]]:
    """Neighbours of one class: its name, and where they begin and end. `alone`: each by itself."""
    found, at = [], 0
    for _, run in groupby(enumerate(classes), lambda one: one[0] if alone else one[1]):
        names = [name for _, name in run]
        first, at = at, at + len(names)
        found.append((str(names[0]), float(edges[first]), float(edges[at])))
    return found


def _stairs(axis: Axes, sweep: xr.Dataset, claims: list[Any]) -> str:
    """Impacts per cycle of each start; returns the heading."""
    for branch, look in sweep_parts.branches(sweep):
        x = branch[sweep_parts.parameter_of(sweep)].values
        count = sweep_parts.beside(per_cycle(branch), sweep_parts.differs(sweep, branch))
        if sweep_parts.in_columns(sweep):
            sweep_parts.columns(axis, x, count, look)
            continue
        axis.step(x, count, where="mid", color=look["color"], linewidth=look["width"])
    for claim in claims:
        sweep_parts.claim_marker(axis, claim.value, claim.impacts)
    axis.set_ylim(0, max(axis.get_ylim()[1], 1))
    law = arrivals_in(sweep.attrs)
    axis.set_ylabel(f"{law.word}s\nper cycle")
    style.upward_ticks(axis, integer=True)
    return f"{law.word}s per cycle, {law.rule(float(sweep.attrs['count_depth']))}; drive flank"


def _impacts(name: str) -> float:
    """Drive impacts per cycle of a class; 0 where it has none."""
    found = PERIODIC.match(str(name))
    return int(found[2]) / int(found[1]) if found else 0


def _strip(axis: Axes, values: NDArray[Any], classes: NDArray[Any], most: float, label: str,
           ends: Any, alone: bool) -> None:
    """Runs of one class as boxes, coloured by their impacts per cycle; named where that is seen."""
    import matplotlib as mpl

    edges = sweep_parts.edges_of(values)
    width = ends[1] - ends[0]
    share = np.array([_impacts(name) / most if PERIODIC.match(name) else np.nan
                      for name in classes])
    axis.pcolormesh(edges, (0, 1), share[None], vmin=-0.18, vmax=1,  # none quite black
                    cmap=mpl.colormaps["cividis"], rasterized=True, zorder=0.5)
    runs = [(name, max(left, ends[0]), min(right, ends[1]))
            for name, left, right in _runs(classes, edges, alone) if name != UNFINISHED
            and left < ends[1] and right > ends[0]]
    axis.vlines([left for _, left, _ in runs], 0, 1, color="white", linewidth=0.3, zorder=0.6)
    for failed, hatch in ((False, "////"), (True, "xxxx")):
        axis.broken_barh([(left, right - left) for name, left, right in runs
                          if not PERIODIC.match(name) and (name == "failed") == failed], (0, 1),
                         facecolor="white", edgecolor="0.55", linewidth=0, hatch=hatch, zorder=0.6)
    for name, left, right in runs:
        if right - left > NAMED_FROM * width:
            found = PERIODIC.match(name)
            light = found is None or _impacts(name) / most > 0.45
            axis.text(0.5 * (left + right), 0.5, name if found else "none", ha="center",
                      va="center", fontsize=7, transform=axis.get_xaxis_transform(),
                      color="black" if light else "white",
                      bbox=None if found else {"facecolor": "white", "edgecolor": "none",
                                               "pad": 0.8})
    if np.all(classes == UNFINISHED):
        style.note(axis, "not reached")
    axis.set(ylim=(0, 1), yticks=[])
    axis.grid(False)
    axis.set_ylabel(label.replace(" ", "\n", 1), rotation=0, ha="right", va="center", fontsize=8)


__all__ = ["draw"]
