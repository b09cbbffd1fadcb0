"""Arrivals per mesh cycle over the plane of a map."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from lapwing.base.arrivals import arrivals_in
from lapwing.plots import style
from lapwing.plots.map import parts

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.figure import Figure


def shows(data: xr.Dataset) -> bool:
    """Whether some tooth arrived at a flank."""
    rate = parts.plane(data, "impacts_per_cycle") + parts.plane(data, "back_impacts_per_cycle")
    return bool((parts.known(data) & (rate > 0)).any())


@style.house_style()
def draw(data: xr.Dataset, gear_pair: dict[str, float] | None = None, *,
         title: str = "") -> Figure:
    """Draw how often teeth arrive at the drive flank, and outline where they reach the coast flank.

    Parameters
    ----------
    data : xarray.Dataset, group `map_<name>` of a result file
    gear_pair : mapping or None, not used
    title : str, of the figure

    Returns
    -------
    matplotlib.figure.Figure
    """
    from matplotlib.lines import Line2D

    data = parts.thinned(data)
    law, known = arrivals_in(data.attrs), parts.known(data)
    rate = np.where(known, parts.plane(data, "impacts_per_cycle"), np.nan)
    back = known & (parts.plane(data, "back_impacts_per_cycle") > 0)
    figure, axis = parts.new_plane(f"{title}: {law.word}s per mesh cycle".removeprefix(": "))
    none = known & (rate + parts.plane(data, "back_impacts_per_cycle") == 0)
    handles = parts.none_cells(axis, data, none)
    drawn = parts.cells(axis, data, np.where(none, np.nan, rate), cmap="cividis", vmin=0)
    figure.colorbar(drawn, ax=axis).set_label(
        f"{law.word}s at the drive flank per mesh cycle")
    if back.any():
        parts.outline(axis, data, back, style.VERMILION)
        handles.append(Line2D([], [], color=style.VERMILION, linewidth=1.2,
                              label=f"outline of back {law.word}s"))
    return parts.finish(figure, axis, data, handles)


__all__ = ["draw"]
