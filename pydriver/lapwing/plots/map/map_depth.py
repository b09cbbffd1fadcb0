"""Deepest separation over the plane of a map."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from lapwing.plots import style
from lapwing.plots.map import parts

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.figure import Figure


def shows(data: xr.Dataset) -> bool:
    """Whether some run separated."""
    depth = parts.plane(data, "deepest_separation")
    return bool((parts.known(data) & (depth > 0)).any())


@style.house_style()
def draw(data: xr.Dataset, gear_pair: dict[str, float] | None = None, *,
         title: str = "") -> Figure:
    """Draw the deepest separation of each run, on a logarithmic scale; grey: none.

    Parameters
    ----------
    data : xarray.Dataset, group `map_<name>` of a result file
    gear_pair : mapping or None, whose backlash is named at the scale
    title : str, of the figure

    Returns
    -------
    matplotlib.figure.Figure
    """
    from matplotlib.colors import LogNorm

    data = parts.thinned(data)
    depth = style.URAD * parts.plane(data, "deepest_separation")
    figure, axis = parts.new_plane(f"{title}: deepest separation".removeprefix(": "))
    none = parts.known(data) & (depth == 0)
    handles = parts.none_cells(axis, data, none)
    deep = np.where(parts.known(data) & (depth > 0), depth, np.nan)
    low, high = np.nanpercentile(deep, 1), np.nanmax(deep)
    drawn = parts.cells(axis, data, deep, cmap="viridis",
                        norm=LogNorm(min(low, 0.5 * high), high))
    bar = figure.colorbar(drawn, ax=axis, extend="min" if np.nanmin(deep) < low else "neither")
    style.plain_powers(bar.ax.yaxis)
    backlash = f", backlash {style.URAD * float(gear_pair['backlash']):g}" if gear_pair else ""
    bar.set_label(f"deepest separation (µrad{backlash})")
    return parts.finish(figure, axis, data, handles)


__all__ = ["draw"]
