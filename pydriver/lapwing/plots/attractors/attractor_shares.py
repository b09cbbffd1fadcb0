"""Attractors along a parameter: their states on the section, and their shares of the starts."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from lapwing.plots import style
from lapwing.plots.attractors.parts import COLOURS, CONTACT, NOT_KNOWN
from lapwing.plots.map.parts import patch
from lapwing.plots.sweep.parts import axis_label, edges_of

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# Attractors that the legend names: those met over the most values.
MOST_NAMED = 9
# A dot, where so many values or fewer are drawn, and where there are more.
DOT, FEW_VALUES, SMALL_DOT = 3.4, 150, 1.8


def shows(data: xr.Dataset) -> bool:
    """Whether some attractor was met."""
    return bool(data.sizes["attractor"])


@style.house_style()
def draw(data: xr.Dataset, gear_pair: dict[str, float] | None = None, *,
         title: str = "") -> Figure:
    """Draw the orbit diagram of the attractors above their shares, each in a colour it keeps.

    Parameters
    ----------
    data : xarray.Dataset, group `attractors_<name>` of a result file
    gear_pair : mapping or None, not used
    title : str, of the figure

    Returns
    -------
    matplotlib.figure.Figure
        Dots are states at mesh phase 0, also of attractors that no random start led to: these are
        continued from the value before. Shares are stacked; black: ends that are not known, white:
        values that were not reached.
    """
    name = str(data.attrs["parameter"])
    values = data[name].values
    reached = data["reached"].values == 1
    there = (data["period"].values >= 0) & reached[:, None]
    of_each = _colours(data, there)
    figure = style.new_figure(9.2, 7.4)
    section, stacked = figure.subplots(2, 1, height_ratios=[3.2, 2.0], sharex=True)
    size = DOT if values.size <= FEW_VALUES else SMALL_DOT
    for i, colour in enumerate(of_each):
        y = style.URAD * np.where(there[:, i, None], data["point_phi"].values[:, i], np.nan)
        x = np.broadcast_to(values[:, None], y.shape)
        dark = "0.35" if colour == CONTACT else colour
        section.plot(x[np.isfinite(y)], y[np.isfinite(y)], linestyle="", marker="o",
                     markersize=size, markeredgewidth=0, color=dark, rasterized=True)
    section.axhline(0, color="0.5", linewidth=0.8)
    section.set_ylabel("φ at mesh phase 0 (µrad)\n← separated   engaged →")
    section.set_title("(a) the attractors once per mesh cycle")
    _stack(stacked, data, of_each, reached)
    stacked.set_title(f"(b) in which of them {int(data.attrs['runs'])} random starts end; "
                      "p:(i,j): i drive and j coast arrivals in p mesh cycles")
    stacked.set_xlabel(axis_label(name))
    figure.suptitle(title or "attractors")
    figure.legend(handles=_handles(data, there, of_each), loc="outside lower center", ncols=3)
    return figure


def _colours(data: xr.Dataset, there: NDArray[np.bool_]) -> list[str]:
    """Grey for what mostly keeps contact; the others in the order of how many values they have."""
    depth = np.nan_to_num(data["deepest_separation"].values)
    quiet = 2 * np.count_nonzero((depth > 0) & there, axis=0) < np.count_nonzero(there, axis=0)
    found = [CONTACT] * there.shape[1]
    order = [i for i in np.argsort(-there.sum(axis=0), kind="stable") if not quiet[i]]
    for place, i in enumerate(order):
        found[i] = COLOURS[min(place, len(COLOURS) - 1)]
    return found


def _stack(axis: Axes, data: xr.Dataset, of_each: list[str], reached: NDArray[np.bool_]) -> None:
    """Columns of shares, one at each value."""
    name = str(data.attrs["parameter"])
    edges = edges_of(data[name].values)
    widths, total = np.diff(edges), int(data.attrs["runs"])
    below = np.zeros(len(widths))
    # What keeps contact lies below the rest.
    for i in sorted(range(len(of_each)), key=lambda place: of_each[place] != CONTACT):
        colour = of_each[i]
        part = np.where(reached, data["runs_ended"].values[:, i], 0) / total
        axis.bar(edges[:-1], 100 * part, widths, bottom=100 * below, align="edge", color=colour,
                 linewidth=0, rasterized=True)
        below += part
    lost = np.where(reached, data["unresolved"].values + data["failed"].values, 0) / total
    axis.bar(edges[:-1], 100 * lost, widths, bottom=100 * below, align="edge", color=NOT_KNOWN,
             linewidth=0)
    axis.set_xlim(edges[0], edges[-1])
    axis.set_ylim(0, 100)
    axis.set_ylabel("share of the starts (%)")


def _handles(data: xr.Dataset, there: NDArray[np.bool_], of_each: list[str]) -> list[Any]:
    order = np.argsort(-there.sum(axis=0), kind="stable")[:MOST_NAMED]
    handles = [patch(of_each[i], f"{i + 1}: {_name(data, there[:, i], i)}") for i in np.sort(order)]
    more = data.sizes["attractor"] - len(order)
    handles += [patch(COLOURS[-1], f"{more} more, met at fewer values")] * (more > 0)
    reached = data["reached"].values == 1
    if np.any(data["unresolved"].values[reached] + data["failed"].values[reached] > 0):
        handles.append(patch(NOT_KNOWN, "not resolved or failed"))
    return handles


def _name(data: xr.Dataset, there: NDArray[np.bool_], i: int) -> str:
    """What an attractor does where it begins and where it ends."""
    at = np.flatnonzero(there)
    kinds = dict.fromkeys("contact kept" if data["deepest_separation"].values[k, i] == 0
                          else str(data["motion_class"].values[k, i]) for k in (at[0], at[-1]))
    return " … ".join(kinds)


__all__ = ["draw", "shows"]
