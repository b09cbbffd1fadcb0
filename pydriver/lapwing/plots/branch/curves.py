"""Curves in two parameters: where what ends a stable range lies, and what meets it."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from lapwing.base.codes import SpecialPoint
from lapwing.plots import style
from lapwing.plots.style import save
from lapwing.plots.sweep.parts import axis_label, unit_of

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

COLOURS = {SpecialPoint.FOLD: style.VERMILION, SpecialPoint.PERIOD_DOUBLING: style.BLUE,
           SpecialPoint.TORUS: style.PURPLE, SpecialPoint.GRAZING: style.GREEN,
           SpecialPoint.RELEASE: style.ORANGE, SpecialPoint.REBOUND: style.BLACK,
           SpecialPoint.CHATTER: style.SKY, SpecialPoint.KINK: "0.5", SpecialPoint.KNOT: "0.7"}
# Ends that a figure shows by itself.
PLAIN = (SpecialPoint.LIMIT, SpecialPoint.CLOSED)


def shows(diagram: xr.Dataset) -> bool:
    """Whether there is a curve."""
    return bool(diagram.sizes.get("curve_point", 0))


@style.house_style()
def draw(diagram: xr.Dataset, *, title: str | None = None) -> Figure:
    """Draw the curves of a bifurcation diagram over both parameters.

    Parameters
    ----------
    diagram : xarray.Dataset, group `branches_<name>` of a result file, with a second parameter
    title : str

    Returns
    -------
    matplotlib.figure.Figure
        Colours are kinds of special points; circles where another condition meets a curve, crosses
        where a curve ends inside of both ranges; dotted the value at which branches were followed.
    """
    figure = style.new_figure(8.4, 6.2)
    axis = figure.subplots()
    attrs = diagram.attrs
    axis.set_xlim(float(attrs["second_low"]), float(attrs["second_high"]))
    axis.set_ylim(float(attrs["low"]), float(attrs["high"]))
    axis.axvline(float(attrs["second_value"]), color="0.6", linewidth=0.9, linestyle=":",
                 label=f"branches followed at {float(attrs['second_value']):g} "
                       f"{unit_of(str(attrs['second_parameter']))}".rstrip())
    handles = add_curves(axis, diagram, str(attrs["second_parameter"]))
    _meetings(axis, diagram)
    axis.set_xlabel(axis_label(str(attrs["second_parameter"])))
    axis.set_ylabel(axis_label(str(attrs["parameter"])))
    own, words = axis.get_legend_handles_labels()
    figure.legend(handles=[*handles, *own], labels=[*(str(one.get_label()) for one in handles),
                                                    *words],
                  loc="outside lower center", ncols=3)
    left = int(attrs["curves_left"]) + int(attrs["curves_lost"])
    figure.suptitle(("what ends stable ranges" if title is None else title)
                    + f"\n{left} more special points are on no curve here" * bool(left))
    return figure


curves = draw


def add_curves(axis: Axes, diagram: xr.Dataset, x_parameter: str) -> list[Any]:
    """Draw the curves of a diagram into a plane whose axes are both its parameters.

    Returns
    -------
    list of entries for a legend, one for each kind
    """
    from matplotlib.lines import Line2D

    x, y = ("curve_second", "curve_value") if x_parameter == diagram.attrs["second_parameter"] \
        else ("curve_value", "curve_second")
    numbers, kinds = diagram["curve_number"].values, diagram["curve_kind"].values
    # White behind all of them, so that none hides another that is close.
    for width, colour in ((2.8, "white"), (1.5, None)):
        for number, kind in enumerate(kinds, 1):
            rows = numbers == number
            axis.plot(diagram[x].values[rows], diagram[y].values[rows], linewidth=width, zorder=3,
                      color=colour or COLOURS[SpecialPoint(int(kind))])
    return [Line2D([], [], color=COLOURS[kind], linewidth=1.5,
                   label=f"{kind.name.lower().replace('_', ' ')} of branches")
            for kind in COLOURS if int(kind) in kinds]


def _meetings(axis: Axes, diagram: xr.Dataset) -> None:
    """Where curves are met, and where they end inside of both ranges."""
    kinds = np.array([SpecialPoint(int(kind)) not in PLAIN
                      for kind in diagram["meeting_kind"].values], dtype=bool)
    ends = diagram["meeting_outcome"].values == 3
    for rows, marker, words in ((kinds & ~ends, "o", "met by another condition"),
                                (kinds & ends, "X", "a curve ends")):
        if rows.any():
            axis.plot(diagram["meeting_second"].values[rows], diagram["meeting_value"].values[rows],
                      marker, color=style.BLACK, markerfacecolor="white", markersize=6, zorder=4,
                      linestyle="", label=words)


__all__ = ["curves", "draw", "save", "shows"]
