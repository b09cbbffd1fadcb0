"""Deepest separation of a sweep against its parameter, beside what a source reports."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from lapwing.plots import critical_marks, style
from lapwing.plots.sweep import parts as sweep_parts
from lapwing.results.findings import known

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from lapwing.plots.sweep.parts import Claim

# Places for a claim's words that are tried at once.
BLOCK = 32


def shows(sweep: xr.Dataset) -> bool:
    """Whether teeth part at some point, or somebody says that they do."""
    return bool(known(sweep).any() and (sweep["deepest_separation"].values > 0).any()) \
        or bool(known(sweep).any() and "claim_value" in sweep)


@style.house_style()
def draw(sweep: xr.Dataset, gear_pair: dict[str, float] | None = None, *, title: str | None = None,
         full_engagement: float | None = None, claims: list[Any] | None = None,
         marks: Any = ()) -> Figure:
    """Draw the deepest separation of the recorded cycles.

    Parameters
    ----------
    sweep, title, full_engagement, claims, marks : as for `orbit_diagram.draw`
    gear_pair : mapping or None, group `gear_pair`; tells the backlash

    Returns
    -------
    matplotlib.figure.Figure
    """
    sweep = sweep_parts.placed(sweep)
    claims = [one for one in sweep_parts.claims_of(sweep, claims) if np.isfinite(one.depth)]
    figure = style.new_figure(9, 5.4, rows=True)
    axis = figure.subplots()
    depth_lines(axis, sweep)
    found = float(sweep["deepest_separation"].max())  # NaN where no point has a result
    deepest = style.URAD * np.nanmax([0.0, found, *(claim.depth for claim in claims)])
    small = style.widen_small_values(
        axis, style.URAD * sweep["deepest_separation"].max("recorded_cycle").values)
    top = (2.0 if small else 1.08) * deepest if deepest > 0 else 1.0
    axis.set_ylim(0, top)
    if deepest == 0:
        axis.set_yticks([0])  # any other number would be made up
    axis.set_ylabel("deepest separation, max of −φ (µrad)"
                    + small * "\nlogarithmic, linear near 0")
    style.arcsec_scale(axis)
    _backlash(axis, gear_pair, top)
    curves = [points for line in axis.lines if len(points := np.asarray(line.get_xydata())) > 2]
    for claim in claims:
        sweep_parts.claim_marker(axis, claim.value, style.URAD * claim.depth)
    critical_marks.mark_sweep([axis], sweep, full_engagement, marks)
    sweep_parts.finish(figure, np.array([axis]), sweep, "deepest separation", title)
    _claim_texts(axis, sorted(claims), sweep, curves)
    sweep_parts.legend(figure, sweep, claims=bool(claims), lines=True)
    return figure


def depth_lines(axis: Axes, sweep: xr.Dataset) -> None:
    """Deepest of all recorded cycles, µrad; neighbours of one kind of motion are joined.

    A failed point leaves a gap.  Motions without a period, whose depth depends on how long one
    looks, are dots.
    """
    for branch, look in sweep_parts.branches(sweep):
        depth = np.where((branch["status"].values == 0) & sweep_parts.stands_apart(
            sweep, branch, _depth), _depth(branch), np.nan)
        x, period = branch[sweep_parts.parameter_of(sweep)].values, branch["period"].values
        if sweep_parts.in_columns(sweep):
            sweep_parts.columns(axis, x, depth, look)
            continue
        joined = (period[1:] == period[:-1]) & (period[1:] > 0)
        breaks = np.flatnonzero(~joined) + 1
        axis.plot(np.insert(x, breaks, np.nan), np.insert(depth, breaks, np.nan),
                  color=look["color"], linewidth=look["width"], marker="o",
                  markersize=1.5 * look["width"], markeredgewidth=0)
    axis.set_ylim(bottom=0)


def _depth(branch: xr.Dataset) -> NDArray[Any]:
    """Deepest of all recorded cycles, µrad."""
    depth: NDArray[Any] = style.URAD * branch["deepest_separation"].max("recorded_cycle").values
    return depth


def _backlash(axis: Axes, gear_pair: dict[str, float] | None, top: float) -> None:
    """The whole gap, where the motion uses enough of it."""
    if gear_pair is None or style.URAD * float(gear_pair["backlash"]) > top:
        return
    backlash = style.URAD * float(gear_pair["backlash"])
    axis.axhline(backlash, color=style.WALL, linewidth=0.9, linestyle=":")
    axis.text(0.35, backlash, f"backlash {backlash:g} µrad: the depth of back impacts",
              color=style.WALL, fontsize=8.5,
              transform=axis.get_yaxis_transform(), ha="center", va="bottom")


def _here(sweep: xr.Dataset, value: float) -> str:
    """What the sweep found at a value, of all starts that have a result there; empty: nothing."""
    parameter = sweep_parts.parameter_of(sweep)
    at = int(np.argmin(np.abs(sweep[parameter].values - value)))
    if not np.isclose(sweep[parameter].values[at], value):
        return ""
    depth = style.URAD * sweep["deepest_separation"].max("recorded_cycle").values[:, at]
    depth = depth[known(sweep)[:, at]]
    if not depth.size:
        return ""
    ends = [f"{one:.3g}" if one else "none" for one in (depth.min(), depth.max())]
    return ", here " + " or ".join(dict.fromkeys(ends))


def _claim_texts(axis: Axes, claims: list[Claim], sweep: xr.Dataset,
                 curves: list[NDArray[Any]]) -> None:
    """What is claimed, each beside its marker where words and leader cross least of the data.

    All is done in parts of the panel, whose limits must be final.
    """
    to_panel = axis.transData + axis.transAxes.inverted()
    lines = [to_panel.transform(curve[np.isfinite(curve).all(1)]) for curve in curves]
    segments = np.concatenate([np.zeros((0, 4)), *(np.hstack([line[:-1], line[1:]])
                                                   for line in lines)])
    markers = [to_panel.transform((claim.value, style.URAD * claim.depth)) for claim in claims]
    for x, y in markers:
        segments = np.vstack([segments, (x - 0.01, y, x + 0.01, y), (x, y - 0.02, x, y + 0.02)])
    for claim, marker in zip(claims, markers, strict=True):
        depth = style.URAD * claim.depth
        words = (f"source: {depth:.3g} µrad" if depth else "source: none") \
            + _here(sweep, claim.value)
        place, box = _free_place(segments, marker, 0.0095 * len(words))
        segments = np.vstack([segments, box])
        axis.annotate(words, (claim.value, depth), xytext=place, ha="center", va="center",
                      textcoords="axes fraction",
                      fontsize=8.5, color=style.CLAIM_TEXT, zorder=6,
                      bbox={"facecolor": "white", "edgecolor": "none", "alpha": 0.8, "pad": 1},
                      arrowprops={"arrowstyle": "-", "color": style.CLAIM_TEXT, "linewidth": 0.7,
                                  "shrinkB": 5})


def _free_place(segments: NDArray[Any], marker: NDArray[Any], width: float,
                height: float = 0.05) -> tuple[tuple[float, float], NDArray[Any]]:
    """Middle of a box (parts of the panel) that crosses least, then lies nearest; its diagonals."""
    x, y = np.meshgrid(np.arange(0.5 * width + 0.01, 1 - 0.5 * width, 0.02),
                       np.arange(0.05, 0.78, 0.03), indexing="ij")
    distance = np.hypot(x - marker[0], 0.6 * (y - marker[1]))
    clear = distance >= 0.5 * width
    nearest = np.argsort(distance[clear], kind="stable")
    x, y = x[clear][nearest], y[clear][nearest]
    left, right, low, high = x - 0.5 * width, x + 0.5 * width, y - 0.5 * height, y + 0.5 * height
    # The leader starts clear of its own marker.
    leader = (*(marker[i] + 0.15 * (at - marker[i]) for i, at in enumerate((x, y))), x, y)
    # What lies under the words crosses a diagonal or an edge of their box, or its middle.
    middle = 0.5 * (left + right)
    lines = np.array([(left, low, right, high), (left, high, right, low), leader,
                      (left, low, right, low), (left, high, right, high),
                      (middle, low, middle, high)])
    crossed: list[int] = []
    for begin in range(0, x.size, BLOCK):
        crossed.extend(np.sum([_crossings(segments, line[:, begin:begin + BLOCK])
                               for line in lines], axis=0))
        if min(crossed) == 0:
            break
    best = int(np.argmin(crossed))
    return (x[best], y[best]), lines[:2, :, best]


def _crossings(segments: NDArray[Any], lines: NDArray[Any]) -> NDArray[Any]:
    """How many segments (rows x, y, x, y) each line (columns x, y, x, y) crosses."""
    def side(a: NDArray[Any], b: NDArray[Any], c: NDArray[Any]) -> NDArray[Any]:
        turned: NDArray[Any] = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
        return turned

    one, two = segments[:, :2].T[..., None], segments[:, 2:].T[..., None]
    start, end = lines[:2, None], lines[2:, None]
    count: NDArray[Any] = np.sum((side(start, end, one) * side(start, end, two) < 0)
                                 & (side(one, two, start) * side(one, two, end) < 0), axis=0)
    return count
