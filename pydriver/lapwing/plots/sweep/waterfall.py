"""Order spectra against the parameter of a sweep, as an image."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from lapwing.plots import critical_marks, style
from lapwing.plots.sweep import parts as sweep_parts
from lapwing.results.findings import known

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.figure import Figure

DECADES = 5


def shows(sweep: xr.Dataset) -> bool:
    """Whether some point has a result, and the sweep what is drawn."""
    return bool(known(sweep).any() and "order_spectrum" in sweep)


@style.house_style()
def draw(sweep: xr.Dataset, *, title: str | None = None, full_engagement: float | None = None,
         marks: Any = ()) -> Figure:
    """Draw the order spectra of φ, one panel for each start.

    Parameters
    ----------
    sweep : xarray.Dataset, result of `lapwing.sweep` with 'spectra' observed, as it is or as group
        `sweep_<name>` of a result file
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
    values, orders = sweep[parameter].values, sweep["order"].values
    spectra = style.URAD * sweep["order_spectrum"].values.astype(float)
    top = float(np.nanmax(spectra, initial=0.0)) or 1.0
    figure = style.new_figure(10, 1.6 + 2.9 * len(spectra))
    axes = figure.subplots(len(spectra), 1, sharex=True, sharey=True, squeeze=False)[:, 0]
    natural = 1 / sweep["mesh_frequency_ratio"].values
    for axis, start, amplitude, letter in zip(axes, sweep["start"].values, spectra, "abc",
                                              strict=False):
        image = axis.pcolormesh(
            sweep_parts.edges_of(values), sweep_parts.edges_of(orders),
            np.maximum(amplitude, top * 10.0**-DECADES).T,
            norm=LogNorm(top * 10.0**-DECADES, top), cmap="viridis", rasterized=True)
        axis.plot(values, natural, color="white", linewidth=1.2, linestyle=(0, (5, 3)))
        axis.set_ylim(0, orders[-1])
        axis.set_yticks(np.arange(0, orders[-1] + 1, 2 if orders[-1] > 10 else 1))
        axis.set_ylabel("mesh order\n(multiples of the mesh frequency)")
        axis.set_title(f"({letter}) {style.START_STYLES[str(start)]['label']}; dashed: natural "
                       "frequency")
        axis.grid(False)
        if sweep_parts.lost(sweep, start):
            style.note(axis, sweep_parts.lost(sweep, start))
    figure.colorbar(image, ax=list(axes), label="amplitude of φ (µrad)", pad=0.02, aspect=40,
                    extend="min")
    critical_marks.mark_sweep(axes, sweep, full_engagement, marks, color="white")
    sweep_parts.finish(figure, axes, sweep, "order spectra", title)
    return figure


__all__ = ["draw"]
