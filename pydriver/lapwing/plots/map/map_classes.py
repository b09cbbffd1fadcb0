"""Kinds of motion over the plane of a map."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from lapwing.plots import style
from lapwing.plots.branch.curves import add_curves
from lapwing.plots.map import parts
from lapwing.results.findings import map_kinds

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.figure import Figure

# Colour of each kind, in the order of `results.findings.KINDS`: grey keeps contact, yellow strikes
# nothing, blue and green are periodic, orange and red strike the coast flank too, purples have no
# period.
COLOURS = ("0.93", style.YELLOW, style.SKY, style.BLUE, style.GREEN, "#00584A", style.ORANGE,
           style.VERMILION, style.PURPLE, "#6B2A57")


def shows(data: xr.Dataset) -> bool:
    """Whether some run has a result."""
    return bool(parts.known(data).any())


@style.house_style()
def draw(data: xr.Dataset, gear_pair: dict[str, float] | None = None, *,
         title: str = "", curves: Sequence[xr.Dataset] = ()) -> Figure:
    """Draw the kind of motion of each run as a coloured cell.

    Parameters
    ----------
    data : xarray.Dataset, group `map_<name>` of a result file
    gear_pair : mapping or None, not used
    title : str, of the figure
    curves : sequence of Dataset, groups `branches_<name>` over the same two parameters, whose
        curves are drawn over the cells

    Returns
    -------
    matplotlib.figure.Figure
    """
    from matplotlib.colors import BoundaryNorm, ListedColormap

    data = parts.thinned(data)
    names, kinds = map_kinds(data)
    found = kinds.transpose(*reversed(parts.axes_of(data))).values
    figure, axis = parts.new_plane(f"{title}: kinds of motion".removeprefix(": "))
    parts.cells(axis, data, np.ma.masked_less(found, 0), cmap=ListedColormap(COLOURS),
                norm=BoundaryNorm(np.arange(len(COLOURS) + 1) - 0.5, len(COLOURS)))
    handles = [parts.patch(COLOURS[i], names[i]) for i in np.unique(found[found >= 0])]
    for diagram in curves:
        handles += add_curves(axis, diagram, parts.axes_of(data)[0])
    return parts.finish(figure, axis, data, handles)


__all__ = ["draw"]
