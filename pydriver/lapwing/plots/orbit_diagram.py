"""Orbit diagram of a sweep: section, depth, impacts per cycle and period against the parameter."""

from __future__ import annotations

import numpy as np

# Okabe and Ito's palette: told apart by colour-blind readers and by lightness in grey.
START_STYLES = {
    "rest": {"color": "#000000", "label": "each from rest"},
    "up": {"color": "#D55E00", "label": "carried upwards"},
    "down": {"color": "#56B4E9", "label": "carried downwards"},
}
AXIS_LABELS = {"brake_torque": "braking torque (N·m)", "pinion_speed_rpm": "pinion speed (rpm)",
               "mesh_frequency_hz": "mesh frequency (Hz)"}
# Drawn in this order, so that the curve most asked for lies on top.
DRAWING_ORDER = ("down", "up", "rest")


def orbit_diagram(sweep, *, title="", full_engagement=None, claims=()):
    """Draw a sweep.

    Parameters
    ----------
    sweep : xarray.Dataset, result of `lapwing.sweep` with 'cycles' observed
    title : str
    full_engagement : float or None, parameter value above which the engaged response never
        separates; marked by a vertical line
    claims : sequence of (parameter value, depth in rad, text), drawn as markers on the depths

    Returns
    -------
    matplotlib.figure.Figure
    """
    from matplotlib.figure import Figure

    parameter = sweep["status"].dims[1]
    figure = Figure(figsize=(10, 10.5), layout="constrained")
    axes = figure.subplots(4, 1, sharex=True, height_ratios=(3, 2.2, 1.6, 1.2))
    panels = (_section, _depths, _impacts, _periods)
    for axis, panel, letter in zip(axes, panels, "abcd", strict=True):
        heading = panel(axis, sweep, parameter)
        axis.set_title(f"({letter}) {heading}", loc="left", fontsize=10)
        axis.grid(True, color="0.92", linewidth=0.6)
        axis.set_axisbelow(True)
        if full_engagement is not None:
            axis.axvline(full_engagement, color="0.35", linewidth=0.9, linestyle=(0, (5, 3)))
    if full_engagement is not None:
        axes[1].annotate(
            f"{full_engagement:.4g}: engaged\nresponse stays in contact", (full_engagement, 0.96),
            xycoords=("data", "axes fraction"), xytext=(-6, 0), textcoords="offset points",
            ha="right", va="top", fontsize=8.5, color="0.25")
    _draw_claims(axes[1], claims)
    axes[-1].set_xlabel(AXIS_LABELS.get(parameter, parameter.replace("_", " ")))
    axes[-1].set_xlim(float(sweep[parameter][0]), float(sweep[parameter][-1]))
    _legend(axes[0], sweep)
    figure.suptitle(title, fontsize=12)
    return figure


def _branches(sweep):
    """Starts that were swept, in drawing order, with their style."""
    return [(start, START_STYLES[start]) for start in DRAWING_ORDER
            if start in sweep["start"].values]


def _section(axis, sweep, parameter):
    """Strobed displacement, µrad. Every panel returns its heading."""
    for start, style in _branches(sweep):
        branch = sweep.sel(start=start)
        values = np.repeat(branch[parameter].values, branch.sizes["recorded_cycle"])
        axis.plot(values, 1e6 * branch["phi"].values.ravel(), linestyle="", marker="o",
                  markersize=1.3, markeredgewidth=0, alpha=0.6, color=style["color"],
                  rasterized=True)
    axis.axhline(0, color="0.5", linewidth=0.8)
    axis.set_ylabel("φ at phase "
                    f"{sweep.attrs.get('phase', 0):g} (µrad)\n← separated   engaged →")
    return "stroboscopic section: relative displacement once per mesh cycle"


def _depths(axis, sweep, parameter):
    """Deepest separation of the recorded cycles, mrad."""
    for start, style in _branches(sweep):
        depth = 1e3 * sweep["deepest_separation"].sel(start=start).max("recorded_cycle")
        axis.plot(sweep[parameter], depth, color=style["color"], linewidth=1.1)
    axis.set_ylabel("deepest separation\n(mrad)")
    axis.set_ylim(bottom=0)
    return "deepest separation of the drive flanks in the recorded cycles"


def _impacts(axis, sweep, parameter):
    """Counted impacts per cycle at either flank."""
    for start, style in _branches(sweep):
        branch = sweep.sel(start=start)
        axis.plot(branch[parameter], branch["counted_impacts"].mean("recorded_cycle"),
                  color=style["color"], linewidth=1.1)
        back = branch["counted_back_impacts"].mean("recorded_cycle")
        axis.plot(branch[parameter], back.where(back > 0), linestyle="", marker="v",
                  markersize=3, color=style["color"])
    axis.set_ylabel("impacts per cycle")
    axis.set_ylim(bottom=0)
    threshold = 100 * sweep.attrs["count_depth"]
    axis.yaxis.get_major_locator().set_params(integer=True)
    return (f"impacts per cycle after flights deeper than {threshold:g} % of the cycle's deepest; "
            "▾ back impacts")


def _periods(axis, sweep, parameter):
    """Period in mesh cycles; motions without one in a row of their own."""
    highest = 8
    for start, style in _branches(sweep):
        period = sweep["period"].sel(start=start).values
        shown = np.where(period == 0, highest + 2, np.minimum(period, highest))
        axis.plot(sweep[parameter], shown, linestyle="", marker="s", markersize=2.2,
                  color=style["color"])
    axis.set_yticks([1, 2, 4, 6, highest, highest + 2], ["1", "2", "4", "6", f"≥{highest}", "none"])
    axis.set_ylim(0.2, highest + 3)
    axis.set_ylabel("period\n(mesh cycles)")
    return "period of the motion"


def _draw_claims(axis, claims):
    """Values somebody else reports, with what they say of them."""
    for value, depth, text in claims:
        axis.plot(value, 1e3 * depth, marker="D", markersize=6, markerfacecolor="none",
                  markeredgecolor="#CC79A7", markeredgewidth=1.6, linestyle="")
        axis.annotate(text, (value, 1e3 * depth), xytext=(9, 16), textcoords="offset points",
                      fontsize=8.5, color="#8F3F6E",
                      arrowprops={"arrowstyle": "-", "color": "#8F3F6E", "linewidth": 0.7})


def _legend(axis, sweep):
    """One entry for each branch, with markers that can be seen."""
    from matplotlib.lines import Line2D

    handles = [Line2D([], [], linestyle="", marker="o", markersize=5, color=style["color"],
                      label=style["label"]) for _, style in reversed(_branches(sweep))]
    axis.legend(handles=handles, loc="lower right", fontsize=9, framealpha=0.95)


def save(figure, path):
    """Write a figure; the format follows from the name."""
    figure.savefig(path, dpi=170)
