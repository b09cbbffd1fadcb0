"""Impact section of a response: mesh phase and speed of every recorded arrival at a flank."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from lapwing.base.arrivals import arrivals_in
from lapwing.plots import style
from lapwing.plots.response.trajectory import cycles_recorded, events_of

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# The drive flank, then the coast flank.
FLANKS = ({"color": style.BLUE, "marker": "o", "label": "drive flank"},
          {"color": style.ORANGE, "marker": "v", "label": "coast flank"})
# Speeds that span more than this, as those of a chatter, are drawn on a logarithmic scale.
LOGARITHMIC = 100.0
# More impacts than these are not numbered.
NUMBERED = 30
# Numbers nearer than this part of the panel stand together, so many of them; room for a letter.
BESIDE, NAMED, ROOM = 0.02, 6, 0.012


def shows(response: xr.Dataset) -> bool:
    """Whether anything strikes."""
    return bool(events_of(response, arrivals_in(response.attrs).kinds)["position"].size)


@style.house_style()
def draw(response: xr.Dataset, gear_pair: dict[str, float] | None = None) -> Figure:
    """Draw the speed of impacts against their phase.

    Parameters
    ----------
    response : xarray.Dataset, group `response_<name>` of a result file
    gear_pair : mapping or None, group `gear_pair`; gives speeds in rad/s and mm/s

    Returns
    -------
    matplotlib.figure.Figure
    """
    figure = style.new_figure(8.5, 4.6, rows=True)
    axis = figure.subplots()
    factor, unit, millimetres = style.speed_unit(gear_pair)
    law = arrivals_in(response.attrs)
    impacts = events_of(response, law.kinds)
    speed = factor * np.abs(impacts["velocity_before"])
    for kind, look in zip(law.kinds, FLANKS, strict=True):
        rows = impacts["event_kind"] == kind
        if np.any(rows):
            _points(axis, impacts["event_phase"][rows], speed[rows], look)
    axis.set(xlim=(0, 1), xlabel=f"mesh phase of the {law.word} (mesh periods)",
             ylabel=f"approach speed |φ'| ({unit})")
    if speed.size == 0:
        style.nothing(axis, style.motion(response.attrs) if style.failed(response) else
                   f"no {law.word} in {cycles_recorded(response)} recorded cycles")
    else:
        _speed_limits(axis, speed)
        figure.legend(loc="outside lower center", ncols=2)
        style.speed_scale(axis, millimetres)
        numbered = _numbers(axis, response, impacts, speed)
        axis.set_title(f"all {speed.size} {law.word}s in {cycles_recorded(response)} recorded "
                       "cycles" + (", numbered in the order of one period" if numbered else
                                   ", whatever the depth of their flights"))
    figure.suptitle(style.describe(response))
    return figure


def _numbers(axis: Axes, response: xr.Dataset, impacts: dict[str, NDArray[Any]],
             speed: NDArray[Any]) -> bool:
    """Number the impacts of the last period of a motion, where they are few; whether it is done."""
    period, recorded = int(response.attrs["period"]), cycles_recorded(response)
    last = np.flatnonzero(impacts["event_cycle"] >= recorded - period)
    if not 0 < period <= recorded or not 0 < last.size <= NUMBERED:
        return False
    # Those at one place, as far as can be seen, share one label; the limits are final.
    at = np.column_stack([impacts["event_phase"][last], speed[last]])
    place = (axis.transData + axis.transAxes.inverted()).transform(at)
    found: dict[int, list[int]] = {}
    for i in range(last.size):
        near = next((one for one in found if np.all(np.abs(place[one] - place[i]) < BESIDE)), i)
        found.setdefault(near, []).append(i + 1)
    for i, numbers in found.items():
        words = ", ".join(map(str, numbers[:NAMED])) + ", …" * (len(numbers) > NAMED)
        left = place[i, 0] > 1 - ROOM * len(words)
        axis.annotate(words, tuple(at[i]), xytext=(-5 if left else 5, 4), fontsize=8,
                      textcoords="offset points", color=style.QUIET,
                      ha="right" if left else "left")
    return True


def _points(axis: Axes, phase: NDArray[Any], speed: NDArray[Any], look: dict[str, str]) -> None:
    """Large markers for the few places of a periodic motion, dots for a cloud."""
    places = len(np.unique(np.round(np.column_stack([phase, speed / speed.max()]), 4), axis=0))
    size = 6.0 if places <= 100 else 3.5 if places <= 1000 else 1.8
    axis.plot(phase, speed, linestyle="", marker=look["marker"], markersize=size,
              markeredgewidth=0.5 if places <= 100 else 0, markeredgecolor="white",
              color=look["color"], alpha=0.95 if places <= 100 else 0.6,
              label=look["label"], rasterized=phase.size > style.MANY)


def _speed_limits(axis: Axes, speed: NDArray[Any]) -> None:
    positive = speed[speed > 0]
    if positive.size and positive.max() > LOGARITHMIC * positive.min():
        axis.set_yscale("log")
        axis.set_ylim(top=2 * positive.max())  # room for the words above the topmost
        style.plain_powers(axis.yaxis)
    else:
        axis.set_ylim(0, 1.08 * speed.max())
