"""Both shafts of a response with two degrees of freedom: their speeds, and the mean of them."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from lapwing.plots import style
from lapwing.plots.response.trajectory import cycles_recorded, cycles_shown

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


def shows(response: xr.Dataset) -> bool:
    """Whether there are two degrees of freedom."""
    return bool("pinion_speed" in response)


def leads(response: xr.Dataset) -> float:
    """How much of the deck's question it answers: a speed that drifts is not seen elsewhere."""
    return abs(float(response.attrs.get("mean_acceleration", 0.0)))


@style.house_style()
def draw(response: xr.Dataset, gear_pair: dict[str, float]) -> Figure:
    """Draw the mean speed over the record, and both shafts' speeds about it in the last cycles.

    Parameters
    ----------
    response : xarray.Dataset, group `response_<name>` of a result file
    gear_pair : mapping, group `gear_pair`

    Returns
    -------
    matplotlib.figure.Figure
    """
    figure = style.new_figure(9.5, 6.4, rows=True)
    figure.suptitle(style.describe(response))
    if style.failed(response):
        style.nothing(figure.subplots(), style.motion(response.attrs), x=True)
        return figure
    axes = figure.subplots(3, 1)
    record = cycles_recorded(response)
    _mean(axes[0], response, record)
    first = record - cycles_shown(response, repeats=2, aperiodic=8)
    rows = response["sample_cycle"].values >= first
    position = response["sample_cycle"].values[rows] + response["phase"].values[rows]
    attrs, ratio = response.attrs, float(gear_pair["gear_ratio"])
    gained = attrs["mean_acceleration"] * attrs["mesh_period_s"] * position
    mean = attrs["mean_speed_first"] + gained
    for axis, name, letter, factor in ((axes[1], "pinion", "b", 1.0),
                                       (axes[2], "gear", "c", ratio)):
        speed = response[f"{name}_speed"].values[rows]
        axis.plot(position, 1e3 * (speed - mean / factor), color=style.BLUE, linewidth=1.1)
        axis.axhline(0, color=style.WALL, linewidth=0.8)
        axis.set_xlim(first, record)
        axis.set_ylabel(f"{name} (mrad/s)")
        axis.set_title(f"({letter}) speed of the {name} less its share of the mean speed")
    axes[2].set_xlabel("recorded mesh cycle")
    return figure


def _mean(axis: Axes, response: xr.Dataset, record: int) -> None:
    """Mean speed of the pinion over the record, and the nominal one."""
    attrs = response.attrs
    speeds = [*response["cycle_mean_speed"].values, attrs["mean_speed_last"]]
    axis.plot(np.arange(record + 1), speeds, color=style.BLACK, linewidth=1.4, label="mean speed")
    axis.axhline(attrs["nominal_speed"], color=style.VERMILION, linewidth=1.0,
                 linestyle=(0, (5, 3)), label="nominal: the mesh's")
    axis.margins(y=0.15)
    axis.set_xlim(0, record)
    axis.set_xlabel("recorded mesh cycle")
    axis.set_ylabel("pinion (rad/s)")
    axis.legend(loc="best", ncols=2)
    axis.set_title(f"(a) mean speed of both wheels, on the pinion's side; drift "
                   f"{attrs['mean_acceleration']:.4g} rad/s²")
