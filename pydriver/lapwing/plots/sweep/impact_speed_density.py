"""How often impacts of which speed happen, against the parameter of a sweep, as an image."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from lapwing.base.arrivals import arrivals_in
from lapwing.plots import critical_marks, style
from lapwing.plots.sweep import parts as sweep_parts
from lapwing.results.findings import known

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.figure import Figure


def shows(sweep: xr.Dataset) -> bool:
    """Whether some point has a result, speeds were counted, and there are impacts at all."""
    return bool(known(sweep).any() and "impact_speed_density" in sweep
                and arrivals_in(sweep.attrs).threshold
                and (sweep["impact_speed_density"].values > 0).any())


@style.house_style()
def draw(sweep: xr.Dataset, gear_pair: dict[str, float] | None = None, *, title: str | None = None,
         full_engagement: float | None = None, marks: Any = ()) -> Figure:
    """Draw the density of impact speeds, one panel for each start.

    Parameters
    ----------
    sweep : xarray.Dataset, result of `lapwing.sweep` with 'speeds' observed, as it is or as group
        `sweep_<name>` of a result file
    gear_pair : mapping or None, group `gear_pair`; gives speeds in rad/s and mm/s
    title : str
    full_engagement : float or None, parameter value above which the engaged response never
        separates; default: as stored with the sweep
    marks : sequence of critical_marks.Mark, critical values to draw as bars

    Returns
    -------
    matplotlib.figure.Figure
    """
    from matplotlib.colors import LogNorm

    sweep = sweep_parts.placed(sweep)
    parameter = sweep_parts.parameter_of(sweep)
    values, edges = sweep[parameter].values, sweep["speed_edge"].values
    factor, unit, millimetres = style.speed_unit(gear_pair)
    density = _per_decade(sweep["impact_speed_density"].values, edges)
    figure = style.new_figure(10, 1.6 + 2.9 * len(density))
    axes = figure.subplots(len(density), 1, sharex=True, sharey=True, squeeze=False)[:, 0]
    seen = density[density > 0]
    norm = LogNorm(float(seen.min()) if seen.size else 0.1, float(seen.max()) if seen.size else 1)
    for axis, start, counts, letter in zip(axes, sweep["start"].values, density, "abc",
                                           strict=False):
        image = axis.pcolormesh(
            sweep_parts.edges_of(values), factor * edges, np.where(counts > 0, counts, np.nan).T,
            norm=norm, cmap="viridis_r", rasterized=True)
        axis.set_yscale("log")
        axis.set_ylabel(f"approach speed |φ'|\n({unit})")
        axis.set_title(f"({letter}) {style.START_STYLES[str(start)]['label']}")
        if seen.size:
            style.speed_scale(axis, millimetres)
        if not np.any(counts > 0):
            words = sweep_parts.lost(sweep, start) or "no impact in the recorded cycles"
            (style.note if seen.size else style.nothing)(axis, words)
    if seen.size:
        figure.colorbar(image, ax=list(axes), label="impacts per mesh cycle and decade of speed",
                        pad=0.02, aspect=40)
    critical_marks.mark_sweep(axes, sweep, full_engagement, marks)
    sweep_parts.finish(figure, axes, sweep, "impact speeds", title)
    return figure


def _per_decade(counts: NDArray[Any], edges: NDArray[Any]) -> NDArray[Any]:
    """Impacts per mesh cycle and decade of speed."""
    found: NDArray[Any] = counts / np.diff(np.log10(edges))
    return found


__all__ = ["draw"]
