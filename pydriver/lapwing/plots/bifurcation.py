"""Bifurcation diagram: branches of periodic motions, stable or not, and what they meet."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from lapwing.plots import style
from lapwing.plots.style import save
from lapwing.plots.sweep.parts import axis_label, dots, unit_of

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

COLOURS = (style.BLACK, style.VERMILION, style.BLUE, style.GREEN, style.PURPLE, style.ORANGE,
           style.SKY)
# Marker of each kind that is drawn, by the name in the flags; others are ends or no bifurcation.
MARKERS = {"fold": "^", "period_doubling": "o", "torus": "s", "branch_point": "P", "grazing": "D",
           "release": "v", "rebound": "X", "chatter": "*", "kink": "d",
           "engaged": "p", "unresolved": "x"}
# Rows of the table of special points under the panels, and branches that have their number beside
# them: those that are stable over the widest ranges.
MOST_ROWS, NUMBERED = 30, 12
ROWS_A_COLUMN = 10
# Where sweeps reach so many times farther than most of what is stable on branches, the scale is
# linear about that and logarithmic beyond it.
FARTHER, MOST = 20.0, 90
# More marks than these are smaller.
CROWD = 60


def shows(diagram: xr.Dataset) -> bool:
    """Whether there is a branch."""
    return bool(diagram.sizes.get("point", 0))


@style.house_style()
def draw(diagram: xr.Dataset, *, title: str | None = None,
         sweeps: Sequence[xr.Dataset] = ()) -> Figure:
    """Draw a bifurcation diagram.

    Parameters
    ----------
    diagram : xarray.Dataset, of `lapwing.branches`
    title : str
    sweeps : sequence of Dataset of `lapwing.sweep` along the parameter, whose points lie behind it

    Returns
    -------
    matplotlib.figure.Figure
        Lines are solid where a motion is stable, dashed where it is not. Special points, numbered
        in the table as their branches are, lie on them; of a motion over several mesh cycles in
        the first one.
    """
    from matplotlib.lines import Line2D

    listed = _listed(diagram)
    rows = min(ROWS_A_COLUMN, max(1, min(len(listed), MOST_ROWS)))
    figure = style.new_figure(10, 7.6 + 0.17 * (rows + 2))
    section, arrivals, words = figure.subplots(3, 1, height_ratios=[
        4.2, 1.8, 0.17 * (rows + 2)])
    arrivals.sharex(section)
    low, high = float(diagram.attrs["low"]), float(diagram.attrs["high"])
    section.set_xlim(low, high)
    _behind(section, diagram, sweeps)
    if shows(diagram):
        _lines(section, diagram)
        _marks(section, diagram, listed)
        _arrivals(arrivals, diagram)
    else:
        for axis in (section, arrivals):
            style.nothing(axis, "no periodic motion with events was found")
    _torques(section, diagram)
    if section.get_legend_handles_labels()[0]:
        # A colour says which branch, not which kind.
        for handle in section.legend(loc="best", ncols=2).legend_handles:
            if isinstance(handle, Line2D) and handle.get_marker() not in ("", "None", None):
                handle.set_markeredgecolor(style.BLACK)
    section.axhline(0, color="0.5", linewidth=0.8)
    logarithmic = _wide(section, diagram)
    section.set_ylabel("φ at phase 0 (µrad)\n← separated   engaged →")
    section.set_title("(a) relative displacement once per mesh cycle: stable solid, unstable "
                      "dashed; marks: special points" + "; dots: the sweep" * bool(sweeps)
                      + f"\n(the scale is logarithmic beyond ±{logarithmic:g} µrad)"
                      * bool(logarithmic))
    arrivals.set_title("(b) arrivals at the drive flank per mesh cycle, bounces of a chatter "
                       "included")
    arrivals.set_ylabel("arrivals\nper cycle")
    arrivals.set_xlabel(axis_label(str(diagram.attrs["parameter"])))
    _table(words, diagram, listed)
    figure.suptitle("bifurcation diagram" if title is None else title)
    return figure


bifurcation = draw


def _behind(axis: Axes, diagram: xr.Dataset, sweeps: Sequence[xr.Dataset]) -> None:
    """What sweeps show, as grey dots."""
    name = str(diagram.attrs["parameter"])
    points = []
    for sweep in sweeps:
        phi = sweep["phi"].transpose("start", name, ...).values
        points.append((np.broadcast_to(sweep[name].values[:, None], phi.shape).ravel(),
                       style.URAD * phi.ravel()))
    if points:
        x, y = (np.concatenate(part) for part in zip(*points, strict=True))
        low, high = axis.get_xlim()
        inside = (x >= low) & (x <= high) & np.isfinite(y)
        if inside.any():
            below, above = y[inside].min(), y[inside].max()
            margin = 0.05 * max(above - below, 1e-3)
            axis.set_ylim(below - margin, above + margin)
            dots(axis, x[inside], y[inside], {"size": 2.0, "alpha": 0.35, "color": "0.55"})
            axis.autoscale(enable=True, axis="y")


def _wide(axis: Axes, diagram: xr.Dataset) -> float:
    """A scale on which branches are seen beside far deeper motions: where it begins; 0: linear."""
    if not shows(diagram):
        return 0.0
    stable = diagram["stable"].values[diagram["strobe_point"].values] > 0
    size = np.abs(style.URAD * diagram["phi"].values)
    most = float(np.percentile(size[stable] if stable.any() else size, MOST))
    farthest = max(map(abs, axis.get_ylim()))
    if not 0 < FARTHER * most < farthest:
        return 0.0
    begin = float(f"{most:.1g}")
    axis.set_yscale("symlog", linthresh=begin, linscale=3.0)
    return begin


def _torques(axis: Axes, diagram: xr.Dataset) -> None:
    """From where on contact can be kept, where rattling ends and where it dies, as lines."""
    attrs = diagram.attrs
    if "kept" not in attrs:
        return
    lines = [(float(attrs["kept"]), "contact can be kept", ":")]
    if diagram.sizes.get("rattling", 0):
        lines.append((float(diagram["rattling_high"].values[-1]), "rattling ends", "--"))
    if "dies" in attrs:
        lines.append((float(attrs["dies"]), "raised rattling dies", "-."))
    low, high = axis.get_xlim()
    for value, words, look in lines:
        if low < value < high:
            axis.axvline(value, color="0.4", linewidth=0.9, linestyle=look, zorder=1, label=words)


def _widest(diagram: xr.Dataset) -> list[int]:
    """Numbers of the branches, those that are stable over the widest ranges first."""
    count = int(diagram["branch"].values.max(initial=0))
    width = np.zeros(count + 1)
    np.add.at(width, diagram["range_branch"].values,
              diagram["range_high"].values - diagram["range_low"].values)
    return [int(number) for number in np.argsort(-width[1:], kind="stable") + 1]


def _kinds(diagram: xr.Dataset) -> list[str]:
    """Name of the kind of each special point."""
    flags = diagram["special_kind"].attrs
    names = dict(zip(np.atleast_1d(flags["flag_values"]).tolist(),
                     str(flags["flag_meanings"]).split(), strict=True))
    return [names[int(kind)] for kind in diagram["special_kind"].values]


def _listed(diagram: xr.Dataset) -> list[int]:
    """Special points that are marked, those at one place of one kind once, in the table's order."""
    kinds, seen, found = _kinds(diagram), set(), []
    values, numbers = diagram["special_value"].values, diagram["special_branch"].values
    span = float(diagram.attrs["high"]) - float(diagram.attrs["low"])
    rank = {number: place for place, number in enumerate(_widest(diagram))}
    for k in np.lexsort((values, np.array([rank[int(number)] for number in numbers]))):
        place = (kinds[k], int(numbers[k]), round(float(values[k]) / span * 1e8))
        if kinds[k] in MARKERS and place not in seen:
            seen.add(place)
            found.append(int(k))
    return found


def _colour(number: int) -> str:
    return COLOURS[(number - 1) % len(COLOURS)]


def _lines(axis: Axes, diagram: xr.Dataset) -> None:
    """Every strobed displacement of every branch."""
    first = np.searchsorted(diagram["strobe_point"].values, np.arange(diagram.sizes["point"]))
    phi, numbered = style.URAD * diagram["phi"].values, _widest(diagram)[:NUMBERED]
    for number in np.unique(diagram["branch"].values):
        points = np.flatnonzero(diagram["branch"].values == number)
        x, stable = diagram["value"].values[points], diagram["stable"].values[points] > 0
        for cycle in range(int(diagram["cycles"].values[points[0]])):
            y = phi[first[points] + cycle]
            for dashed in (False, True):
                axis.plot(x, _where(y, stable, dashed), color=_colour(int(number)),
                          linewidth=0.9 if dashed else 1.6,
                          linestyle=(0, (3, 2)) if dashed else "-",
                          alpha=0.8 if dashed else 1.0)
        if number not in numbered:
            continue
        middle = len(points) // 2
        axis.annotate(str(number), (x[middle], phi[first[points[middle]]]),
                      textcoords="offset points", xytext=(3, 4), fontsize=8,
                      color=_colour(int(number)))


def _where(y: NDArray[Any], stable: NDArray[np.bool_], dashed: bool) -> NDArray[Any]:
    """A line broken where it is of the other kind; a piece next to a stable point is stable."""
    piece = stable[:-1] | stable[1:]
    wanted = np.zeros(len(y), dtype=bool)
    if len(y) > 1:
        piece = ~piece if dashed else piece
        wanted[:-1] |= piece
        wanted[1:] |= piece
    else:
        wanted[:] = stable != dashed
    return np.where(wanted, y, np.nan)


def _marks(axis: Axes, diagram: xr.Dataset, listed: list[int]) -> None:
    kinds, shown = _kinds(diagram), []
    size = 5 if len(listed) <= CROWD else 3
    for k in listed:
        kind = kinds[k]
        axis.plot(diagram["special_value"].values[k],
                  style.URAD * diagram["special_phi"].values[k], MARKERS[kind], markersize=size,
                  markeredgecolor=_colour(int(diagram["special_branch"].values[k])),
                  markerfacecolor="white" if kind != "unresolved" else style.BLACK, zorder=4,
                  color=style.BLACK, linestyle="",
                  label=None if kind in shown else kind.replace("_", " "))
        shown.append(kind)


def _arrivals(axis: Axes, diagram: xr.Dataset) -> None:
    for number in np.unique(diagram["branch"].values):
        one = diagram.isel(point=np.flatnonzero(diagram["branch"].values == number))
        y = one["arrivals"].values / one["cycles"].values
        for dashed in (False, True):
            axis.plot(one["value"].values, _where(y, one["stable"].values > 0, dashed),
                      color=_colour(int(number)), linewidth=0.9 if dashed else 1.8,
                      linestyle=(0, (3, 2)) if dashed else "-")
    most = float(np.max(diagram["arrivals"].values / diagram["cycles"].values))
    axis.set_ylim(0, 1.08 * max(1.0, most))


def _table(axis: Axes, diagram: xr.Dataset, listed: list[int]) -> None:
    """Special points by branch, kind, value and what becomes of the branch."""
    axis.set_axis_off()
    kinds, unit = _kinds(diagram), unit_of(str(diagram.attrs["parameter"]))
    flags = diagram["special_outcome"].attrs
    outcomes = dict(zip(np.atleast_1d(flags["flag_values"]).tolist(),
                        str(flags["flag_meanings"]).split(), strict=True))
    lines = [f"{int(diagram['special_branch'].values[k])}  {kinds[k].replace('_', ' ')} "
             f"{float(diagram['special_value'].values[k]):.12g}, "
             + outcomes[int(diagram["special_outcome"].values[k])].replace("_", " ")
             for k in listed]
    more = len(lines) - MOST_ROWS
    shown = lines[:MOST_ROWS]
    head = "branch, special point" + f" ({unit})" * bool(unit) + ", what becomes of the branch"
    axis.text(0, 1, head + (f"; {more} more in the table of the data" if more > 0 else "")
              + ("" if lines else ": none"), transform=axis.transAxes, va="top", fontsize=8.5)
    for column in range(0, len(shown), ROWS_A_COLUMN):
        axis.text(column / MOST_ROWS, 1, "\n\n" + "\n".join(shown[column:column + ROWS_A_COLUMN]),
                  transform=axis.transAxes, va="top", fontsize=7.5, linespacing=1.25)


__all__ = ["bifurcation", "draw", "save", "shows"]
