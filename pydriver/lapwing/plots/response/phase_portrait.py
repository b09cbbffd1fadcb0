"""Phase portrait of a response, whole and magnified where the flanks are pressed together."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from lapwing.base.codes import EventKind, MotionState
from lapwing.plots import style
from lapwing.plots.response.trajectory import IMPACTS, cycles_recorded, cycles_shown, path

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from lapwing.plots.response.trajectory import Path


# Cycles of a motion without a period that can be told from each other.
APERIODIC = 40


@style.house_style()
def draw(response: xr.Dataset, gear_pair: dict[str, float] | None = None) -> Figure:
    """Draw φ' against φ.

    Parameters
    ----------
    response : xarray.Dataset, group `response_<name>` of a result file
    gear_pair : mapping or None, group `gear_pair`; gives speeds in rad/s and mm/s

    Returns
    -------
    matplotlib.figure.Figure
    """
    factor, unit, millimetres = style.speed_unit(gear_pair)
    if style.failed(response):
        figure = style.new_figure(8, 4)
        axis = figure.subplots()
        axis.set(xlabel="φ (µrad)", ylabel=f"φ' ({unit})")
        style.nothing(axis, style.motion(response.attrs), x=True)
        figure.suptitle(style.describe(response))
        return figure
    recorded = cycles_recorded(response)
    # One cycle more than the period, so that the curve is closed.
    count = min(cycles_shown(response, repeats=1, aperiodic=APERIODIC) + 1, recorded)
    track = path(response, count).refined(response)
    panels: list[tuple[str, Any, tuple[float, float]]] = [
        ("all of the motion", None, track.limits(response))]
    top, gap = float(np.max(track.phi)), float(response.attrs["gap_width"])
    if track.pressed(response):
        panels.append(("magnified: drive flanks pressed together", MotionState.ENGAGEMENT,
                       (-0.3 * top, top)))
    if track.pressed_back(response):
        low = float(np.min(track.phi))
        panels.append(("magnified: coast flanks pressed together", MotionState.BACK_ENGAGEMENT,
                       (low, -gap + 0.3 * (-gap - low))))
    figure = style.new_figure((8, 11, 13.5)[len(panels) - 1], 5.6, rows=True)
    axes = figure.subplots(1, len(panels), width_ratios=(1.7, 1, 1)[:len(panels)],
                           squeeze=False)[0]
    for axis, letter, (heading, state, (low, high)) in zip(axes, "abc", panels, strict=False):
        pad = 0.06 * (high - low) or 1e-6
        _draw(axis, track, response, factor, (style.URAD * (low - pad), style.URAD * (high + pad)))
        _speed_limits(axis, track, factor, state)
        axis.set_title(f"({letter}) {heading}" if len(panels) > 1 else "")
        axis.set(xlabel="relative displacement φ (µrad)", ylabel=f"φ' ({unit})")
        style.speed_scale(axis, millimetres)
    axes[0].set_xlabel(axes[0].get_xlabel() + _far_flanks(axes[0], response))
    figure.legend(*axes[0].get_legend_handles_labels(), loc="outside lower center", ncols=6)
    figure.suptitle(style.describe(response)
                    + f"; {count} cycles drawn" * (not int(response.attrs["period"])))
    return figure


def _draw(axis: Axes, track: Path, response: xr.Dataset, factor: float,
          limits: tuple[float, float]) -> None:
    """One panel: flanks, jumps, path, section."""
    _flanks(axis, response, limits)
    long = cycles_many(track)
    many = track.phi.size > style.MANY
    for state, look in style.STATE_STYLES.items():
        x, y = track.stretches(state, track.phi, track.phi_dot)
        if x.size:
            thin = {"linewidth": 0.4 * look["linewidth"]} if long else {}
            axis.plot(style.URAD * x, factor * y, **(look | thin), rasterized=many)
    x, y = track.jumps((EventKind.KINK,), track.phi, track.phi_dot)
    if x.size:
        axis.plot(style.URAD * x, factor * y, color=style.GREEN, linewidth=0.9, zorder=3,
                  linestyle=(0, (1, 2)), label="kink of the flank", rasterized=many)
    # Ends of the jumps alone: the way lies on the flank, and many of them would be one bar.
    x, y = track.jumps(IMPACTS, track.phi, track.phi_dot)
    for first, fill, label in ((0, style.BLACK, "impact: before"), (1, "white", "after")):
        if x.size:
            axis.plot(style.URAD * x[first::3], factor * y[first::3], linestyle="", zorder=4,
                      marker="o", markersize=1.6 if long else 3.6, markerfacecolor=fill,
                      markeredgecolor=style.BLACK, markeredgewidth=0.4 if long else 0.8,
                      label=label, rasterized=many)
    _section(axis, response, track, factor)
    axis.set_xlim(limits)


def _speed_limits(axis: Axes, track: Path, factor: float, state: MotionState | None) -> None:
    """Speeds of all of the motion, or in one motion state alone."""
    speeds = factor * track.phi_dot
    if state is not None:
        _, speeds = track.stretches(state, track.phi, speeds)
    low, high = np.nanmin(speeds), np.nanmax(speeds)
    pad = 0.06 * (high - low) or 1.0
    axis.set_ylim(low - pad, high + pad)


def cycles_many(track: Path) -> bool:
    """Whether the path is so long that it must be drawn thin."""
    return bool(track.position[-1] - track.position[0] > 12)


def _section(axis: Axes, response: xr.Dataset, track: Path, factor: float) -> None:
    """The state at phase 0 of each cycle drawn."""
    first = round(float(track.position[0]))
    phi, phi_dot = (response[f"cycle_{key}"].values[first:] for key in ("phi", "phi_dot"))
    size = 3.5 if cycles_many(track) else 7
    axis.plot(style.URAD * phi, factor * phi_dot, linestyle="", marker="D", markersize=size,
              markerfacecolor="none" if size > 5 else style.GREEN, markeredgewidth=1.5 * (size > 5),
              markeredgecolor=style.GREEN, zorder=5, rasterized=phi.size > style.MANY,
              label="stroboscopic section (phase 0)")


def _flanks(axis: Axes, response: xr.Dataset, limits: tuple[float, float]) -> None:
    """Flanks as walls, shaded on the side where the tooth is pressed in."""
    gap = style.URAD * float(response.attrs["gap_width"])
    for wall, inner in ((0.0, limits[1]), (-gap, limits[0])):
        if limits[0] <= wall <= limits[1]:
            axis.axvspan(wall, inner, color="0.93", linewidth=0, zorder=0)
            axis.axvline(wall, color="0.78", linewidth=4, zorder=1)


def _far_flanks(axis: Axes, response: xr.Dataset) -> str:
    """Say where the flanks are that lie outside."""
    gap = style.URAD * float(response.attrs["gap_width"])
    low, high = axis.get_xlim()
    far = [f"coast flank at −{gap:.4g} µrad"] * bool(np.isfinite(gap) and low > -gap)
    far += ["drive flank at 0"] * bool(high < 0)
    return "".join(f"; {one}" for one in far)
