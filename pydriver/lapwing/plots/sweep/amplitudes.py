"""The classical picture of a sweep: how much the motion moves, mean and peak mesh force."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from lapwing.plots import critical_marks, style
from lapwing.plots.sweep import parts as sweep_parts
from lapwing.results.findings import known, rattles

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# Variable, factor to what is drawn, heading, and unit, of each panel.
PANELS = (("dynamic_te_rms", style.URAD, "dynamic transmission error, rms", "µrad"),
          ("dynamic_te_peak_to_peak", style.URAD, "dynamic transmission error, peak to peak",
           "µrad"),
          ("phi_rms", style.URAD, "displacement φ from the flank, rms", "µrad"),
          ("phi_peak_to_peak", style.URAD, "displacement φ from the flank, peak to peak", "µrad"),
          ("mesh_force_mean", 1.0, "mesh force of spring and damper, mean (impacts apart)", "N"),
          ("mesh_force_peak", 1.0, "mesh force of spring and damper, peak (impacts apart)", "N"))
# Of the mesh frequency in units of the natural one: where resonances of the engaged teeth lie.
RESONANCES = (1, 2, 3)
# Part of the greatest number that the panels reach, so that labels above have room.
ROOM = 1.12
# Behind the values at which the teeth part.
SHADE = "0.91"


def shows(sweep: xr.Dataset) -> bool:
    """Whether some point has a result, and the sweep what is drawn."""
    return bool(known(sweep).any() and "dynamic_te_rms" in sweep)


def leads(sweep: xr.Dataset) -> float:
    """How much of the deck's question it answers: along a speed, amplitudes are the picture."""
    return float(shows(sweep) and sweep_parts.parameter_of(sweep) != "brake_torque")


@style.house_style()
def draw(sweep: xr.Dataset, gear_pair: dict[str, float] | None = None, *, title: str | None = None,
         full_engagement: float | None = None, marks: Any = ()) -> Figure:
    """Draw amplitudes and forces of a sweep.

    Parameters
    ----------
    sweep : xarray.Dataset, result of `lapwing.sweep` with 'cycles' and 'amplitudes' observed, as
        it is or as group `sweep_<name>` of a result file
    gear_pair : mapping or None, group `gear_pair`; tells where resonances lie along a speed
    title, full_engagement, marks : as for `orbit_diagram.draw`

    Returns
    -------
    matplotlib.figure.Figure
    """
    sweep = sweep_parts.placed(sweep)
    figure = style.new_figure(11, 9, rows=True)
    axes = figure.subplots(3, 2, sharex=True)
    for axis, (name, factor, words, unit), letter in zip(axes.flat, PANELS, "abcdef", strict=True):
        axis.set_title(f"({letter}) {words}")
        axis.set_ylabel(f"({unit})")
        _panel(axis, sweep, name, factor)
    parameter = sweep_parts.parameter_of(sweep)
    values = sweep[parameter].values
    critical_marks.mark_sweep(axes.flat, sweep, full_engagement, marks)
    marked = _resonances(axes, parameter, values, gear_pair)
    sweep_parts.finish(figure, axes[:, 0], sweep, "amplitudes", title)
    axes[-1, 1].set_xlabel(axes[-1, 0].get_xlabel())
    if sweep_parts.in_columns(sweep):
        sweep_parts.put_labels(axes[-1, 1], "x", sweep_parts.labels_of(sweep, parameter))
    if marked:
        axes[-1, 0].set_xlabel(f"{axes[-1, 0].get_xlabel()}; Ω: mesh frequency / natural frequency")
    sweep_parts.legend(figure, sweep, failed=bool(sweep_parts.failed(sweep).any()),
                       more=_parting(axes, sweep))
    return figure


def _panel(axis: Axes, sweep: xr.Dataset, name: str, factor: float) -> None:
    """One number of each branch; dots, for neighbours may be different motions."""
    if not np.isfinite(sweep[name].values).any():
        style.nothing(axis, "the rigid law has no spring, hence no force"
                      if name.startswith("mesh_force") else "no amplitude is known")
        return
    for branch, look in sweep_parts.branches(sweep):
        shown = sweep_parts.stands_apart(sweep, branch, lambda one: one[name].values)
        x, y = branch[sweep_parts.parameter_of(sweep)].values[shown], \
            factor * branch[name].values[shown]
        if sweep_parts.in_columns(sweep):
            sweep_parts.columns(axis, x, y, look)
        else:
            axis.plot(x, y, linestyle="", marker="o", markersize=2.8, markeredgewidth=0,
                      color=look["color"], alpha=0.9)
    top = factor * np.nanmax(sweep[name].values)
    bottom = min(0.0, factor * np.nanmin(sweep[name].values))
    axis.set_ylim(ROOM * bottom, ROOM * top if top > 0 else 0.0 if bottom else 1.0)
    if not (top > 0 or bottom):
        axis.set_yticks([0])  # any other number would be made up


def _parting(axes: NDArray[Any], sweep: xr.Dataset) -> list[Any]:
    """Shade the values at which the teeth part, from some start; an entry for the legend."""
    from matplotlib.patches import Patch

    values = sweep[sweep_parts.parameter_of(sweep)].values
    parting = rattles(sweep).any(axis=0) if "states_visited" in sweep else np.zeros(values.size)
    if sweep_parts.is_log(values) or not parting.any() or parting.all():
        return []
    edges = sweep_parts.edges_of(values)
    bounds = np.flatnonzero(np.diff(np.concatenate([[0], parting.astype(int), [0]])))
    for axis in axes.flat:
        for low, high in edges[bounds].reshape(-1, 2):
            axis.axvspan(low, high, color=SHADE, linewidth=0, zorder=0.4)
    return [Patch(facecolor=SHADE, label="teeth part, from some start")]


def _resonances(axes: NDArray[Any], parameter: str, values: NDArray[Any],
                gear_pair: dict[str, float] | None) -> bool:
    """Dotted lines where the mesh frequency is the natural one, a half or a third; whether any."""
    if gear_pair is None or "pinion_teeth" not in gear_pair:
        return False
    natural, teeth = float(gear_pair["natural_frequency"]), int(gear_pair["pinion_teeth"])
    at_natural = {"pinion_speed_rpm": natural / teeth * 30 / math.pi,
                  "pinion_speed_rad_s": natural / teeth,
                  "mesh_frequency_hz": natural / (2 * math.pi)}.get(parameter)
    if at_natural is None:
        return False
    marked = False
    for order in RESONANCES:
        place = at_natural / order
        if not values[0] <= place <= values[-1]:
            continue
        marked = True
        for axis in axes.flat:
            axis.axvline(place, color=style.WALL, linewidth=0.9, linestyle=":", zorder=1)
        axes[0, 0].annotate(f"Ω = 1/{order}" if order > 1 else "Ω = 1", (place, 0.97),
                            xycoords=("data", "axes fraction"), xytext=(4, 0),
                            textcoords="offset points", ha="left", va="top", fontsize=9,
                            color=style.WALL)
    return marked


__all__ = ["draw"]
