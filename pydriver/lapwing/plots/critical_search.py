"""The search for a critical value: what was tried, what was seen, and the bracket that is left."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from lapwing.base.codes import SearchStage
from lapwing.plots import style
from lapwing.plots.critical_marks import draw_marks, label_of
from lapwing.plots.sweep.parts import axis_label, unit_of
from lapwing.results.findings import search_bounded

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

LOOKS: dict[SearchStage, dict[str, Any]] = {
    SearchStage.SCAN: {"marker": "o", "color": style.BLUE, "label": "scan, from the safe end"},
    SearchStage.BISECTION: {"marker": "s", "color": style.ORANGE, "label": "bisection"},
    SearchStage.CARRIED: {"marker": "^", "color": style.VERMILION, "label": "the rattling motion "
                          "carried here; at 0 %: it had died"},
    SearchStage.FURTHER: {"marker": "o", "color": style.SKY,
                          "label": "scan of the side that rattles"},
}
TITLES = {"full": "contact of the engaged motion", "safe": "rattling motions",
          "back": "back impacts", "on": "rigid tooth on the flank"}
# Parameters of which each value is another gear pair.
PAIR = ("pinion_inertia", "gear_inertia", "pinion_base_lever", "mesh_stiffness")
# The second panel of a search shows so many widths of the bracket to either side.
CLOSE_UP = 6


def shows(critical: xr.Dataset) -> bool:
    """Whether there were trials: a closed form has nothing to show."""
    return "trial" in critical.dims


@style.house_style()
def draw(critical: xr.Dataset, gear_pair: dict[str, float] | None = None, *,
         title: str | None = None, marks: Any = ()) -> Figure:
    """Draw one search.

    Parameters
    ----------
    critical : xarray.Dataset, group `critical_<name>` of a result file, with the dimension `trial`
    gear_pair : mapping or None, group `gear_pair`; gives margins in N·m
    title : str or None
    marks : sequence of critical_marks.Mark, other critical values along the same parameter

    Returns
    -------
    matplotlib.figure.Figure
    """
    find = str(critical.attrs["find"])
    draws = {"safe": _safe, "back": _back}.get(find)
    parameter = str(critical.attrs["parameter"])
    close_up = find == "safe" and critical.attrs["outcome"] == "found"
    figure = style.new_figure(10.5 if close_up else 9, 4.6, rows=True)
    axes = figure.subplots(1, 2 if close_up else 1, width_ratios=[3, 2] if close_up else [1],
                           squeeze=False)[0]
    for axis in axes:
        if draws is not None:
            draws(axis, critical)
        else:
            _margin(axis, critical, None if parameter in PAIR else gear_pair)
        axis.set_xlabel(axis_label(parameter))
    axes[0].set_title("all values tried" if close_up else "")
    draw_marks(axes[:1], marks, np.sort(critical["trial_value"].values))
    if close_up:
        middle, half = critical.attrs["estimate"], critical.attrs["bar"]
        axes[1].set_xlim(middle - CLOSE_UP * half, middle + CLOSE_UP * half)
        axes[1].set_title(f"the bracket, {2 * half:.2g} {unit_of(parameter)}".rstrip() + " wide")
        axes[1].set_ylabel("")
    tried = np.unique(critical["trial_value"].values)
    if tried.size == 1:
        axes[0].set_xticks(tried)
    handles, labels = axes[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=min(5, len(labels)))
    name, found = critical.attrs.get("name", find), label_of(critical)
    head = f"{name}: " * (not found.startswith(str(name))) + TITLES[find]
    figure.suptitle(f"{head}; {found}" if title is None else title)
    return figure


def _safe(axis: Axes, critical: xr.Dataset) -> None:
    """Share of the motions that rattle, at each value tried."""
    stages, values = critical["trial_stage"].values, critical["trial_value"].values
    followed = critical["trial_starts"].values - critical["trial_failed"].values
    axis.set_ylabel("motions that rattle (% of those followed)")
    if not followed.any():
        _nothing(axis, values)
        return
    share = np.full(values.shape, np.nan)
    np.divide(100.0 * critical["trial_rattling"].values, followed, out=share, where=followed > 0)
    for stage, look in LOOKS.items():
        at = (stages == stage) & (followed > 0)
        if stage == SearchStage.CARRIED:  # of these the last step alone, not the way there
            at &= np.isin(values, (critical.attrs["rattling"], critical.attrs["clean"]))
        if at.any():
            carried = stage == SearchStage.CARRIED
            axis.plot(values[at], share[at], linestyle="", markersize=10 if carried else 6,
                      zorder=4, markerfacecolor="none" if carried else look["color"], **look)
    failed = (critical["trial_failed"].values > 0) & (followed > 0)
    if failed.any():
        axis.plot(values[failed], share[failed], linestyle="", marker="x", markersize=9,
                  color=style.BLACK, label="some runs failed", zorder=5)
    _lost(axis, values[followed == 0])
    axis.step(*_known_shares(values, stages, share), where="mid", color="0.75", linewidth=1,
              zorder=2)
    _bracket(axis, critical.attrs["rattling"], critical.attrs["clean"],
             "bracket" if search_bounded(critical) else "one end quiet, the other failed")
    axis.set_ylim(-4, 104)


def _nothing(axis: Axes, values: NDArray[Any]) -> None:
    """A search of which every motion failed: the range, and no numbers of what was not seen."""
    style.nothing(axis, "every motion failed: nothing is known")
    _lost(axis, values)


def _lost(axis: Axes, values: NDArray[Any]) -> None:
    """Values at which every motion failed, at the edge of the panel."""
    if values.size:
        axis.plot(values, np.full(values.size, 0.02), linestyle="", marker="x", markersize=7,
                  color=style.BLACK, label="every run failed: not known", zorder=5,
                  transform=axis.get_xaxis_transform(), clip_on=False)


def _known_shares(values: NDArray[Any], stages: NDArray[Any],
                  share: NDArray[Any]) -> tuple[NDArray[Any], NDArray[Any]]:
    """Values from low to high and the share at each: of all starts, where they were tried there.

    Where several trials were made at one value the greatest counts; the way along which motions
    were carried, and what was followed longer, tell of other motions than the starts.
    """
    whole = np.isin(stages, (SearchStage.SCAN, SearchStage.BISECTION, SearchStage.FURTHER)) \
        & np.isfinite(share)
    order = np.unique(values[whole])
    return order, np.array([share[whole & (values == value)].max() for value in order])


def _back(axis: Axes, critical: xr.Dataset) -> None:
    """Bursts of back impacts per cycle; where none was seen, the upper limit of that rate."""
    values = critical["trial_value"].values
    cycles = np.maximum(critical["trial_cycles"].values, 1)
    # Files of version 0.1 tell no bursts, only cycles.
    bursts = "trial_bursts" in critical
    rate = critical["trial_bursts" if bursts else "trial_back_cycles"].values / cycles
    axis.set_ylabel("bursts of back impacts\n(per mesh cycle examined)" if bursts else
                    "mesh cycles with a back impact\n(share of those examined)")
    seen = rate > 0
    limit = critical["trial_rate_bound"].values
    percent = 100 * critical.attrs["confidence"]
    clean = ~seen & np.isfinite(limit)
    if not (seen | clean).any():
        _nothing(axis, values)
        return
    if seen.any():
        axis.plot(values[seen], rate[seen], linestyle="", marker="o", markersize=5,
                  color=style.VERMILION, label="seen", zorder=4)
    _lost(axis, values[critical["trial_cycles"].values == 0])
    if clean.any():
        axis.plot(values[clean], limit[clean], linestyle="", marker="v", markersize=5,
                  markerfacecolor="none", color=style.BLUE, zorder=4,
                  label=f"none seen: upper limit, {percent:g} % confidence")
    axis.set_yscale("log")
    _bracket(axis, critical.attrs["last_seen"], critical.attrs["first_clean"],
             "last seen to first clean value")


def _margin(axis: Axes, critical: xr.Dataset, gear_pair: dict[str, float] | None) -> None:
    """Force above the one that contact needs, as a braking torque where the pair is one for all.

    F = T/(i12·k) of balanced torques, k = k'·lever² (docs/model.md, section 3).
    """
    factor, label = style.URAD, "force F less the one\nthat contact needs (µrad)"
    if gear_pair is not None:
        factor = float(gear_pair["gear_ratio"]) * float(gear_pair["mesh_stiffness"]) \
            * float(gear_pair["pinion_base_lever"]) ** 2
        label = "braking torque less the one\nthat contact needs (N·m)"
    axis.plot(critical["trial_value"], factor * critical["trial_margin"], color=style.BLUE,
              marker="o", markersize=4, label="margin of contact")
    axis.axhline(0, color="0.5", linewidth=0.8)
    if np.isfinite(critical.attrs["estimate"]):
        axis.plot(critical.attrs["estimate"], 0, marker="D", markersize=8, linestyle="",
                  markerfacecolor="none", markeredgewidth=1.8, color=style.VERMILION,
                  label="solved")
    axis.set_ylabel(label)


def _bracket(axis: Axes, one: float, two: float, label: str) -> None:
    if np.isfinite(one + two):
        axis.axvspan(min(one, two), max(one, two), color=style.ORANGE, alpha=0.35, linewidth=0.8,
                     zorder=1, label=label)
