"""Time history of a response: displacement, the pressed part of it, mesh force, impacts."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from lapwing.base.codes import EventKind, MotionState
from lapwing.plots import style
from lapwing.plots.response.trajectory import (
    IMPACTS,
    cycles_recorded,
    cycles_shown,
    events_of,
    impulses,
    path,
)

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from lapwing.plots.response.trajectory import Path


@style.house_style()
def draw(response: xr.Dataset, gear_pair: dict[str, float] | None = None) -> Figure:
    """Draw the last recorded cycles.

    Parameters
    ----------
    response : xarray.Dataset, group `response_<name>` of a result file
    gear_pair : mapping or None, group `gear_pair`; without it no second scales and no impulses

    Returns
    -------
    matplotlib.figure.Figure
    """
    if style.failed(response):
        figure = style.new_figure(9, 3)
        axis = figure.subplots()
        axis.set(xlabel="recorded mesh cycle", ylabel="φ (µrad)")
        style.nothing(axis, style.motion(response.attrs), x=True)
        figure.suptitle(style.describe(response))
        return figure
    count = cycles_shown(response, repeats=2, aperiodic=8)
    first = cycles_recorded(response) - count
    track = path(response, count).refined(response)
    panels: list[Callable[..., str]] = [_displacement]
    if track.pressed(response):
        panels.append(_pressed)
    if track.pressed_back(response):
        panels.append(_pressed_back)
    panels += [_mesh_force, _impulses] if _has_impacts(response, gear_pair) else [_mesh_force]
    figure = style.new_figure(9.5, 1.6 + 2.1 * len(panels), rows=True)
    axes = np.atleast_1d(figure.subplots(len(panels), 1, sharex=True))
    for axis, panel, letter in zip(axes, panels, "abcde", strict=False):
        axis.set_title(f"({letter}) {panel(axis, response, track, first, gear_pair)}")
    axes[-1].set_xlim(first, first + count)
    axes[-1].set_xlabel("recorded mesh cycle")
    second = 1e3 * float(response.attrs["mesh_period_s"])
    style.second_scale(axes[0], "top", second, "time from the first recorded cycle (ms)")
    figure.suptitle(style.describe(response))
    return figure


def _has_impacts(response: xr.Dataset, gear_pair: dict[str, float] | None) -> bool:
    return gear_pair is not None and events_of(response, IMPACTS)["position"].size > 0


def _coloured(axis: Axes, track: Path, scale: float) -> None:
    """φ against time, one colour for each motion state."""
    for state, look in style.STATE_STYLES.items():
        x, y = track.stretches(state, track.position, track.phi)
        if x.size:
            axis.plot(x, scale * y, **look)


def _displacement(axis: Axes, response: xr.Dataset, track: Path, first: int,
                  gear_pair: dict[str, float] | None) -> str:
    """φ with the flanks, µrad."""
    _coloured(axis, track, style.URAD)
    axis.axhline(0, color=style.WALL, linewidth=1.0)
    gap = style.URAD * float(response.attrs["gap_width"])
    low, high = (style.URAD * one for one in track.limits(response))
    pad = 0.06 * (high - low) or 1.0
    if low <= -gap:
        axis.axhline(-gap, color=style.WALL, linewidth=1.0)
        axis.text(0.005, -gap, "coast flank", transform=axis.get_yaxis_transform(), fontsize=8,
                  va="bottom", color=style.WALL,
                  bbox={"facecolor": "white", "edgecolor": "none", "alpha": 0.8, "pad": 0.5})
    axis.set_ylim(low - pad, high + 3.2 * pad)
    axis.legend(loc="upper right", ncols=3)
    axis.set_ylabel("φ (µrad)")
    style.arcsec_scale(axis)
    if high < 0:
        return (f"relative displacement φ; drive flank at 0, coast flank at −{gap:.4g} µrad: "
                "pressed below it")
    return "relative displacement φ from the drive flank: pressed above 0, separated below"


def _pressed(axis: Axes, response: xr.Dataset, track: Path, first: int,
             gear_pair: dict[str, float] | None) -> str:
    """φ > 0 on a scale of its own."""
    _coloured(axis, track, style.URAD)
    top = style.URAD * np.nanmax(track.phi)
    axis.axhline(0, color=style.WALL, linewidth=1.0)
    axis.set_ylim(-0.12 * top, 1.12 * top)
    axis.set_ylabel("φ > 0 (µrad)")
    style.arcsec_scale(axis)
    return f"the same, magnified: drive flanks pressed together by up to {top:.3g} µrad"


def _pressed_back(axis: Axes, response: xr.Dataset, track: Path, first: int,
                  gear_pair: dict[str, float] | None) -> str:
    """φ below the coast flank on a scale of its own."""
    _coloured(axis, track, style.URAD)
    gap = style.URAD * float(response.attrs["gap_width"])
    depth = -gap - style.URAD * np.nanmin(track.phi)
    axis.axhline(-gap, color=style.WALL, linewidth=1.0)
    axis.set_ylim(-gap - 1.12 * depth, -gap + 0.12 * depth)
    axis.set_ylabel("φ at the coast\nflank (µrad)")
    style.arcsec_scale(axis)
    return f"the same, magnified: coast flanks pressed together by up to {depth:.3g} µrad"


def _mesh_force(axis: Axes, response: xr.Dataset, track: Path, first: int,
                gear_pair: dict[str, float] | None) -> str:
    """Force of spring and damper, N, and its torque on the pinion."""
    rows = response["sample_cycle"].values >= first
    force = response["mesh_force"].values[rows]
    axis.set_ylabel("mesh force W (N)")
    if np.all(np.isnan(force)):
        style.note(axis, "none is computed: rigid contact")
        axis.set_yticks([])
        return "mesh force"
    position = response["sample_cycle"].values[rows] + response["phase"].values[rows]
    if not np.any(force):
        style.note(axis, "zero in the cycles shown: never pressed", 0.7)
        axis.set_yticks([])
    axis.plot(position, force, color=style.BLUE, linewidth=1.3)
    axis.axhline(0, color=style.WALL, linewidth=0.8)
    if gear_pair is not None and np.any(force):
        style.second_scale(axis, "right", float(gear_pair["pinion_base_lever"]),
                           "on the pinion (N·m)")
    mean, peak = (float(response.attrs.get(f"mesh_force_{key}", np.nan))
                  for key in ("mean", "peak"))
    state = response["motion_state"].values[rows]
    pulled = np.any(force[state == MotionState.ENGAGEMENT] < 0) \
        or np.any(force[state == MotionState.BACK_ENGAGEMENT] > 0)
    mean_words, peak_words = (f"{one:.3g} N" if np.isfinite(one) else "not known"
                              for one in (mean, peak))
    return (f"normal mesh force of spring and damper; mean {mean_words}, peak {peak_words}"
            " (all recorded cycles)"
            + "\ncontact ends where the spring is slack: right before, the damper pulls, and the "
            "force has the other sign" * bool(pulled))


def _impulses(axis: Axes, response: xr.Dataset, track: Path, first: int,
              gear_pair: dict[str, float]) -> str:
    """Impulse of each impact along the normal, mN·s."""
    impacts = events_of(response, IMPACTS, first)
    impulse = 1e3 * impulses(impacts, gear_pair)
    for kind, marker, label in ((EventKind.IMPACT, "o", "drive flank"),
                                (EventKind.BACK_IMPACT, "v", "coast flank")):
        rows = impacts["event_kind"] == kind
        if np.any(rows):
            axis.vlines(impacts["position"][rows], 0, impulse[rows], color=style.BLACK,
                        linewidth=0.9)
            axis.plot(impacts["position"][rows], impulse[rows], linestyle="", marker=marker,
                      markersize=3.5, color=style.BLACK, label=label)
    axis.axhline(0, color=style.WALL, linewidth=0.8)
    axis.margins(y=0.25)
    if impulse.size and impulse.min() >= 0:
        axis.set_ylim(bottom=0)
    if np.any(impacts["event_kind"] == EventKind.BACK_IMPACT):
        axis.legend(loc="upper right", ncols=2)
    axis.set_ylabel("impulse (mN·s)")
    drive = impacts["event_kind"] == EventKind.IMPACT
    odd = np.any(impulse[drive] < 0) or np.any(impulse[~drive] > 0)
    return ("impacts: impulse of each along the normal (instants, not part of W)"
            + "\nof the other sign: the impact law 'absolute' sends the tooth on into a flank that "
            "it should bounce off" * bool(odd))
