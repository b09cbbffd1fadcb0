"""Basins: the attractor that each start of a plane leads to."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from lapwing.base.codes import Status
from lapwing.base.messages import percent
from lapwing.plots import style
from lapwing.plots.attractors.parts import NOT_KNOWN, colours, name_of
from lapwing.plots.map import parts

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

LABELS = {"start_phi": "φ at the start (µrad)      ← separated   engaged →",
          "start_phi_dot": "dφ/dτ at the start (µrad)",
          "start_phase": "mesh phase of the arrival",
          "start_speed": "speed of the arrival, dφ/dτ towards the flank (µrad)"}
# Attractors that the legend names; their cells are drawn all the same.
MOST_NAMED = 12


def shows(data: xr.Dataset) -> bool:
    """Whether the end of some cell is known."""
    return bool((data["attractor_of_run"].values > 0).any())


def leads(data: xr.Dataset) -> float:
    """How much of the deck's question it answers: rattling at the highest torque tells most."""
    return float(data.attrs.get("brake_torque", 0.0))


@style.house_style()
def draw(data: xr.Dataset, gear_pair: dict[str, float] | None = None, *,
         title: str = "") -> Figure:
    """Draw each cell in the colour of the attractor it leads to, and the attractors in it.

    Parameters
    ----------
    data : xarray.Dataset, group `basins_<name>` of a result file, or of `lapwing.basins`
    gear_pair : mapping or None, not used
    title : str, of the figure

    Returns
    -------
    matplotlib.figure.Figure
        The points are the attractors' states at mesh phase 0; they lie in the plane of the states
        at that phase, and in no other.
    """
    from matplotlib.colors import BoundaryNorm, ListedColormap

    data = parts.thinned(data)
    labels = parts.plane(data, "attractor_of_run").astype(int)
    status = parts.plane(data, "status")
    reached = status != Status.UNFINISHED
    of_each = colours(data)
    figure, axis = parts.new_plane(title or "basins")
    parts.cells(axis, data, np.ma.masked_array(labels, ~reached),
                cmap=ListedColormap([NOT_KNOWN, *of_each]),
                norm=BoundaryNorm(np.arange(len(of_each) + 2) - 0.5, len(of_each) + 1))
    _label(axis, data)
    handles = _points(axis, data, of_each) if _in_plane(data) else []
    entries = [parts.patch(of_each[i], f"{name_of(data, i)}: "
                           f"{percent(float(data['share'][i]))}")
               for i in range(min(len(of_each), MOST_NAMED))]
    more = len(of_each) - MOST_NAMED
    entries += [parts.patch("white", f"and {more} more")] * (more > 0)
    counts = (("not resolved", int(data.attrs["unresolved"])),
              ("failed", int(data.attrs["failed"])))
    entries += [parts.patch(NOT_KNOWN, ", ".join(f"{count} cells {what}" for what, count in counts
                                                 if count))] * any(n for _, n in counts)
    entries += [parts.patch(parts.MISSING, f"{int(data.attrs['not_reached'])} cells not reached")] \
        * bool(data.attrs["not_reached"])
    figure.legend(handles=[*entries, *handles], loc="outside lower center", ncols=2)
    return figure


def _label(axis: Axes, data: xr.Dataset) -> None:
    """Axes in µrad, the flanks of the plane of states, and what the plane is one of."""
    x, y = parts.axes_of(data)
    for name, one, label in ((x, axis.xaxis, axis.set_xlabel), (y, axis.yaxis, axis.set_ylabel)):
        label(LABELS[name])
        if name != "start_phase":
            one.set_major_formatter(lambda value, _: f"{style.URAD * value:g}")
    if x == "start_phi":
        axis.axvline(0.0, color="0.25", linewidth=0.9, linestyle=(0, (5, 3)))
        axis.set_title(f"starts at mesh phase {float(data.attrs['phase']):g}; dashed: the drive "
                       "flank; shares: of this rectangle")
    else:
        axis.set_title(f"starts are arrivals at the {data.attrs['plane']} flank; shares: of this "
                       "rectangle")


def _in_plane(data: xr.Dataset) -> bool:
    """Whether the attractors' states, those at mesh phase 0, lie in the plane."""
    return data.attrs["plane"] == "state" and float(data.attrs["phase"]) == 0


def _points(axis: Axes, data: xr.Dataset, of_each: list[str]) -> list[Any]:
    """Draw the attractors' states at mesh phase 0; entries for the legend."""
    from matplotlib.lines import Line2D

    limits = axis.get_xlim(), axis.get_ylim()
    drawn = False
    for i, colour in enumerate(of_each):
        one = data.isel(attractor=i)
        x, y = one["point_phi"].values, one["point_phi_dot"].values
        inside = (limits[0][0] <= x) & (x <= limits[0][1]) & (limits[1][0] <= y) \
            & (y <= limits[1][1])
        if not inside.any():
            continue
        drawn = True
        # Of an aperiodic motion dots, black on its own colour.
        few = int(one["period"]) > 0
        axis.plot(x[inside], y[inside], linestyle="none", marker="o",
                  markersize=6.5 if few else 0.9, rasterized=not few,
                  markerfacecolor=colour if few else style.BLACK, markeredgecolor=style.BLACK,
                  markeredgewidth=1.2 * few)
    axis.set_xlim(*limits[0])
    axis.set_ylim(*limits[1])
    return [Line2D([], [], linestyle="none", marker="o", markersize=6.5, markerfacecolor="white",
                   markeredgecolor="black", markeredgewidth=1.2,
                   label="a motion's states at mesh phase 0, one for each cycle of its "
                   "period")] * drawn


__all__ = ["draw", "shows"]
