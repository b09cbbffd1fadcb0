"""Work and precision: processor time per mesh cycle against the error it buys."""

from __future__ import annotations

import numpy as np

from lapwing.plots import style

COLUMNS = 2
# Colour, marker, line style, width. The engine's own methods are drawn last, and thick.
STYLES = {
    "exact": (style.BLACK, "*", "-", 2.4), "rk4": (style.VERMILION, "o", "-", 2.4),
    "heyoka": (style.PURPLE, "D", "-", 1.4), "numba DOPRI5": (style.GREEN, "s", "-", 1.4),
    "CVODE": (style.ORANGE, "v", "--", 1.4), "SciPy RK45": (style.SKY, "^", ":", 1.4),
    "SciPy DOP853": (style.BLUE, "^", "--", 1.4), "SciPy LSODA": ("0.45", "^", "-.", 1.4)}
OTHER = ("0.2", "x", "-", 1.4)
# Labels of one panel stand at least so far apart, as part of the axis.
LABEL_GAP = 0.062
# Room for the labels at the right, as part of the width of the data.
LABEL_ROOM = 0.52
NOTE = "one marker for each tolerance; hollow: an event is missed or doubled at some torque"


@style.house_style()
def draw(panels):
    """Draw one panel for each scene.

    Parameters
    ----------
    panels : sequence of (title, curves, error label); curves: dict of method name -> (errors,
        costs in µs per mesh cycle, events missed or doubled), from loose to tight; what is not
        finite is left out

    Returns
    -------
    matplotlib.figure.Figure
    """
    rows = -(-len(panels) // COLUMNS)
    columns = min(COLUMNS, len(panels))
    figure = style.new_figure(5.0 * columns, 3.5 * rows)
    axes = np.atleast_1d(figure.subplots(rows, columns, squeeze=False)).ravel()
    for axis, (title, curves, label) in zip(axes, panels, strict=False):
        _panel(axis, title, curves, label)
    for axis in axes[len(panels):]:
        axis.remove()
    figure.supxlabel(NOTE, fontsize=8.5, color=style.QUIET)
    return figure


def _panel(axis, title, curves, label):
    ends = []
    for name in sorted(curves, key=lambda name: list(STYLES).index(name) if name in STYLES else 99,
                       reverse=True):
        errors, costs, wrong = (np.asarray(values, dtype=float) for values in curves[name])
        good = np.isfinite(errors) & np.isfinite(costs) & (errors > 0)
        if not good.any():
            continue
        errors, costs, wrong = (values[good] for values in (errors, costs, wrong))
        colour, marker, line, width = STYLES.get(name, OTHER)
        size = 11 if marker == "*" else 5
        axis.plot(errors, costs, color=colour, linestyle=line, linewidth=width)
        for which, look in ((wrong == 0, {"markeredgecolor": "white", "markeredgewidth": 0.4}),
                            (wrong > 0, {"markerfacecolor": "white", "markeredgewidth": 1.2})):
            axis.plot(errors[which], costs[which], color=colour, marker=marker, markersize=size,
                      linestyle="", **look)
        ends.append((name, errors[0], costs[0], colour))
    axis.set_xscale("log")
    axis.set_yscale("log")
    bottom, top = axis.get_ylim()
    axis.set_ylim(10 ** np.floor(np.log10(bottom)), 10 ** np.ceil(np.log10(top)))
    axis.set_title(title)
    axis.set_xlabel(label)
    axis.set_ylabel("µs per mesh cycle, one core")
    if ends:
        _labels(axis, ends)
    else:
        style.note(axis, "nothing measured")


def _labels(axis, ends):
    """Names beside the loose ends of the curves, moved apart, with a thin line to each."""
    low, high = np.log10(axis.get_xlim())
    ticks = [tick for tick in axis.get_xticks() if low <= np.log10(tick) <= high]
    axis.set_xlim(10**low, 10 ** (high + LABEL_ROOM * (high - low)))
    axis.set_xticks(ticks)
    axis.minorticks_off()
    low, high = np.log10(axis.get_xlim())
    at = 10 ** (high - 0.93 * LABEL_ROOM / (1 + LABEL_ROOM) * (high - low))
    bottom, top = np.log10(axis.get_ylim())
    ends = sorted(ends, key=lambda end: end[2])
    wanted = np.array([(np.log10(end[2]) - bottom) / (top - bottom) for end in ends])
    for (name, error, cost, colour), height in zip(ends, _apart(wanted), strict=True):
        y = 10 ** (bottom + height * (top - bottom))
        # The typeface of all figures has no bold letters.
        ours = {"fontweight": "bold", "fontfamily": "DejaVu Sans"} if name in ("exact", "rk4") \
            else {}
        axis.annotate(name, (error, cost), (at, y), va="center", fontsize=8.5, color=colour, **ours,
                      arrowprops={"arrowstyle": "-", "color": colour, "linewidth": 0.5,
                                  "alpha": 0.6, "shrinkA": 0, "shrinkB": 3})


def _apart(wanted):
    """Rising heights near the wanted ones, none nearer to another than `LABEL_GAP`."""
    heights = wanted.copy()
    for _ in range(100):
        for i in range(len(heights) - 1):
            excess = LABEL_GAP - (heights[i + 1] - heights[i])
            if excess > 0:
                heights[i] -= excess / 2
                heights[i + 1] += excess / 2
        heights = np.clip(heights, 0.03, 0.97)
    return heights
