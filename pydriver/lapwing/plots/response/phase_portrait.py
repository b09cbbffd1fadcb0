"""Phase portrait of a response, whole and magnified where the flanks are pressed together."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from lapwing.base.codes import EventKind, MotionState
from lapwing.plots import style
from lapwing.plots.response.trajectory import IMPACTS, cycles_recorded, cycles_shown, path

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from lapwing.plots.response.trajectory import Path


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
    count = min(cycles_shown(response, repeats=1, aperiodic=recorded) + 1, recorded)
    track = path(response, count)
    if not cycles_many(track):
        track = track.refined(response)
    both = track.pressed()
    figure = style.new_figure(11 if both else 8, 5.6)
    axes = np.atleast_1d(figure.subplots(1, 2, width_ratios=(1.7, 1)) if both
                         else figure.subplots())
    limits = [_whole(track, response), _pressed(track)]
    headings = ["(a) all of the motion", "(b) magnified: drive flanks pressed together"]
    for axis, limit, heading in zip(axes, limits, headings, strict=False):
        _draw(axis, track, response, factor, limit)
        _speed_limits(axis, track, factor, pressed=axis is not axes[0])
        axis.set_title(heading if both else "")
        axis.set(xlabel="relative displacement φ (µrad)", ylabel=f"φ' ({unit})")
        style.speed_scale(axis, millimetres)
    _coast_flank_far(axes[0], response)
    handles, labels = axes[0].get_legend_handles_labels()
    shown = figure.legend(handles, labels, loc="outside lower center", ncols=len(labels))
    for handle in shown.get_lines():
        handle.set(alpha=1, linewidth=max(1.3, handle.get_linewidth()))
    figure.suptitle(style.describe(response)
                    + f"; {count} cycles drawn" * (not int(response.attrs["period"])))
    return figure


def _whole(track: Path, response: xr.Dataset) -> tuple[float, float]:
    """Limits of φ (µrad) around the motion; the coast flank too where the motion comes near."""
    low, high = style.URAD * np.min(track.phi), style.URAD * np.max(track.phi)
    gap = style.URAD * float(response.attrs["gap_width"])
    if low < -0.5 * gap:
        low = min(low, -gap)
    low, high = min(low, 0), max(high, 0)
    pad = 0.06 * (high - low) or 1.0
    return low - pad, high + pad


def _pressed(track: Path) -> tuple[float, float]:
    top = style.URAD * np.max(track.phi)
    return -0.3 * top, 1.1 * top


def _draw(axis: Axes, track: Path, response: xr.Dataset, factor: float,
          limits: tuple[float, float]) -> None:
    """One panel: flanks, jumps, path, section."""
    _flanks(axis, response, limits)
    light = 0.55 if cycles_many(track) else 0.9
    many = track.phi.size > style.MANY
    for kinds, color, dash, label in (
            (IMPACTS, style.BLACK, (0, (4, 3)), "impact"),
            ((EventKind.KINK,), style.GREEN, (0, (1, 2)), "kink of the flank")):
        x, y = track.jumps(kinds, track.phi, track.phi_dot)
        if x.size:
            axis.plot(style.URAD * x, factor * y, color=color, linewidth=0.9, zorder=3,
                      linestyle=dash, label=label, rasterized=many)
    for state, look in style.STATE_STYLES.items():
        x, y = track.stretches(state, track.phi, track.phi_dot)
        if x.size:
            thin = {"linewidth": 0.45 * look["linewidth"]} if cycles_many(track) else {}
            axis.plot(style.URAD * x, factor * y, **(look | thin), alpha=light, rasterized=many)
    _section(axis, response, track, factor)
    axis.set_xlim(limits)


def _speed_limits(axis: Axes, track: Path, factor: float, pressed: bool) -> None:
    """Speeds of all of the motion, or of engagement alone."""
    speeds = factor * track.phi_dot
    if pressed:
        _, speeds = track.stretches(MotionState.ENGAGEMENT, track.phi, speeds)
    low, high = np.nanmin(speeds), np.nanmax(speeds)
    pad = 0.06 * (high - low) or 1.0
    axis.set_ylim(low - pad, high + pad)


def cycles_many(track: Path) -> bool:
    """Whether the path is so long that it must be drawn thin."""
    return track.position[-1] - track.position[0] > 12


def _section(axis: Axes, response: xr.Dataset, track: Path, factor: float) -> None:
    """The state at phase 0 of each cycle drawn."""
    first = round(float(track.position[0]))
    phi, phi_dot = (response[f"cycle_{key}"].values[first:] for key in ("phi", "phi_dot"))
    size = 2.5 if cycles_many(track) else 5.5
    axis.plot(style.URAD * phi, factor * phi_dot, linestyle="", marker="o", markersize=size,
              markerfacecolor="white" if size > 3 else style.BLACK, markeredgewidth=1.1,
              markeredgecolor=style.BLACK, zorder=5, rasterized=phi.size > style.MANY,
              label="stroboscopic section (phase 0)")


def _flanks(axis: Axes, response: xr.Dataset, limits: tuple[float, float]) -> None:
    """Flanks as walls, shaded on the side where the tooth is pressed in."""
    gap = style.URAD * float(response.attrs["gap_width"])
    for wall, inner in ((0.0, limits[1]), (-gap, limits[0])):
        if limits[0] <= wall <= limits[1]:
            axis.axvspan(wall, inner, color="0.93", linewidth=0, zorder=0)
            axis.axvline(wall, color="0.78", linewidth=4, zorder=1)


def _coast_flank_far(axis: Axes, response: xr.Dataset) -> None:
    """Say where the coast flank is when it lies outside."""
    gap = style.URAD * float(response.attrs["gap_width"])
    if np.isfinite(gap) and axis.get_xlim()[0] > -gap:
        axis.text(0.015, 0.02, f"← coast flank at −{gap:.4g} µrad", transform=axis.transAxes,
                  fontsize=8.5, color=style.QUIET)
