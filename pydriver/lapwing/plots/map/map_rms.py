"""Root mean square of φ over the plane of a map that was asked for it."""

from __future__ import annotations

from typing import TYPE_CHECKING

from lapwing.plots import style
from lapwing.plots.map import parts

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.figure import Figure


def shows(data: xr.Dataset) -> bool:
    """Whether some run has one, and it is not 0."""
    return parts.has_sizes(data, "phi_rms")


@style.house_style()
def draw(data: xr.Dataset, gear_pair: dict[str, float] | None = None, *,
         title: str = "") -> Figure:
    """Draw the rms of φ of each run, on a logarithmic scale; grey: none.

    Parameters
    ----------
    data : xarray.Dataset, group `map_<name>` of a result file
    gear_pair : mapping or None, not used
    title : str, of the figure

    Returns
    -------
    matplotlib.figure.Figure
    """
    return parts.sizes(data, "phi_rms", style.URAD, f"{title}: rms of φ",
                       "rms of φ about its mean (µrad)")


__all__ = ["draw"]
