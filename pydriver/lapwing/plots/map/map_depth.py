"""Deepest separation over the plane of a map."""

from __future__ import annotations

from typing import TYPE_CHECKING

from lapwing.plots import style
from lapwing.plots.map import parts

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.figure import Figure


def shows(data: xr.Dataset) -> bool:
    """Whether some run separated."""
    return parts.has_sizes(data, "deepest_separation")


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
    backlash = f", backlash {style.URAD * float(gear_pair['backlash']):g}" if gear_pair else ""
    return parts.sizes(data, "deepest_separation", style.URAD,
                       f"{title}: deepest separation", f"deepest separation (µrad{backlash})")


__all__ = ["draw"]
