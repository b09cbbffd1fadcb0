"""Largest Lyapunov exponent over the plane of a map that was asked for it."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from lapwing.plots import style
from lapwing.plots.map import parts

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.figure import Figure

# What has no colour of the scale: lost in chatter or rest, and not known at a graze.
LOST, UNKNOWN = "#3B3B6D", "0.72"


def shows(data: xr.Dataset) -> bool:
    """Whether some run has one that is finite."""
    return "lyapunov_exponent" in data and bool(
        np.isfinite(data["lyapunov_exponent"].values).any())


@style.house_style()
def draw(data: xr.Dataset, gear_pair: dict[str, float] | None = None, *,
         title: str = "") -> Figure:
    """Draw the largest Lyapunov exponent of each run, blue below zero and red above.

    Parameters
    ----------
    data : xarray.Dataset, group `map_<name>` of a result file
    gear_pair : mapping or None, not used
    title : str, of the figure

    Returns
    -------
    matplotlib.figure.Figure
    """
    from matplotlib.colors import TwoSlopeNorm

    data = parts.thinned(data)
    rate, known = parts.plane(data, "lyapunov_exponent"), parts.known(data)
    figure, axis = parts.new_plane(f"{title}: largest Lyapunov exponent".removeprefix(": "))
    handles = []
    for where, colour, words in (
            (known & np.isneginf(rate), LOST, "-∞: a deviation is lost in chatter or rest"),
            (known & np.isnan(rate), UNKNOWN, "not known: the periodic motion grazes a flank")):
        handles += parts.cells_of(axis, data, where, colour, words)
    finite = np.where(np.isfinite(rate), rate, np.nan)
    # A few far below must not bleach the rest.
    low, high = min(float(np.nanpercentile(finite, 1)), -1e-6), float(np.nanmax(finite))
    drawn = parts.cells(axis, data, finite, cmap="RdBu_r",
                        norm=TwoSlopeNorm(0.0, low, max(high, 1e-2 * -low)))
    bar = figure.colorbar(drawn, ax=axis, extend="min" if np.nanmin(finite) < low else "neither")
    bar.set_label("largest Lyapunov exponent (per τ; above 0 neighbours part)")
    return parts.finish(figure, axis, data, handles)


__all__ = ["draw"]
