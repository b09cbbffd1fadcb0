"""Attractors along a parameter: their states on the section, and their shares of the starts."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from lapwing.base.arrivals import arrivals_in
from lapwing.plots import style
from lapwing.plots.attractors.parts import COLOURS, CONTACT, NOT_KNOWN
from lapwing.plots.map.parts import patch
from lapwing.plots.sweep.parts import axis_label, edges_of

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# Attractors that the legend names: those met over the most values.
MOST_NAMED = 9
# A dot, where so many values or fewer are drawn, and where there are more.
DOT, FEW_VALUES, SMALL_DOT = 3.4, 150, 1.8


def shows(data: xr.Dataset) -> bool:
    """Whether some attractor was met."""
    return bool(data.sizes["attractor"])


@style.house_style()
def draw(data: xr.Dataset, gear_pair: dict[str, float] | None = None, *,
         title: str = "") -> Figure:
    """Draw the orbit diagram of the attractors above their shares, each in a colour it keeps.

    Parameters
    ----------
    data : xarray.Dataset, group `attractors_<name>` of a result file
    gear_pair : mapping or None, not used
    title : str, of the figure

    Returns
    -------
    matplotlib.figure.Figure
        Grey keeps contact; an attractor that does so at some values alone has its own colour at
        the others. Dots are states at mesh phase 0, also of attractors that no random start led
        to: these are continued from the value before. Shares are stacked; black: ends that are not
        known, white: values that were not reached.
    """
    name = str(data.attrs["parameter"])
    values = data[name].values
    reached = data["reached"].values == 1
    there = (data["period"].values >= 0) & reached[:, None]
    moves = there & (data["deepest_separation"].values > 0)
    of_each = _colours(moves)
    figure = style.new_figure(9.2, 7.4)
    section, stacked = figure.subplots(2, 1, height_ratios=[3.2, 2.0], sharex=True)
    size = DOT if values.size <= FEW_VALUES else SMALL_DOT
    for i, colour in enumerate(of_each):
        y = style.URAD * np.where(there[:, i, None], data["point_phi"].values[:, i], np.nan)
        x = np.broadcast_to(values[:, None], y.shape)
        for rows, look in ((~moves[:, i], CONTACT), (moves[:, i], colour)):
            shown = np.isfinite(y) & rows[:, None]
            section.plot(x[shown], y[shown], linestyle="", marker="o", markersize=size,
                         markeredgewidth=0, color=look, rasterized=True)
    section.axhline(0, color="0.5", linewidth=0.8)
    section.set_ylabel("φ at mesh phase 0 (µrad)\n← separated   engaged →")
    section.set_title("(a) the attractors once per mesh cycle")
    _stack(stacked, data, of_each, moves)
    law = arrivals_in(data.attrs)
    stacked.set_title(f"(b) where {int(data.attrs['runs'])} random starts end; "
                      f"{law.word}s counted: {law.rule(data.attrs['count_depth'])}")
    stacked.set_xlabel(axis_label(name))
    figure.suptitle(title or "attractors")
    figure.legend(handles=_handles(data, there, moves, of_each), loc="outside lower center",
                  ncols=2)
    return figure


def _colours(moves: NDArray[np.bool_]) -> list[str]:
    """A colour for each attractor where it parts, in the order of how many values that are."""
    found = [CONTACT] * moves.shape[1]
    order = [i for i in np.argsort(-moves.sum(axis=0), kind="stable") if moves[:, i].any()]
    for place, i in enumerate(order):
        found[i] = COLOURS[min(place, len(COLOURS) - 1)]
    return found


def _stack(axis: Axes, data: xr.Dataset, of_each: list[str], moves: NDArray[np.bool_]) -> None:
    """Columns of shares, one at each value."""
    reached = data["reached"].values == 1
    edges = edges_of(data[str(data.attrs["parameter"])].values)
    widths, total = np.diff(edges), int(data.attrs["runs"])
    ended = np.where(reached[:, None], data["runs_ended"].values, 0)
    lost = np.where(reached, data["unresolved"].values + data["failed"].values, 0)
    # What keeps contact lies below the rest, next to it what keeps it at other values.
    kept = np.where(moves, 0, ended)
    order = sorted(np.flatnonzero(moves.any(axis=0)), key=lambda i: not kept[:, i].any())
    parts = [(kept.sum(axis=1), CONTACT),
             *((np.where(moves[:, i], ended[:, i], 0), of_each[i]) for i in order),
             (lost, NOT_KNOWN)]
    below = np.zeros(len(widths))
    for count, colour in parts:
        axis.bar(edges[:-1], 100 * count / total, widths, bottom=below, align="edge",
                 color=colour, linewidth=0, rasterized=True)
        below += 100 * count / total
    axis.set_xlim(edges[0], edges[-1])
    axis.set_ylim(0, 100)
    axis.set_ylabel("share of the starts (%)")


def _handles(data: xr.Dataset, there: NDArray[np.bool_], moves: NDArray[np.bool_],
             of_each: list[str]) -> list[Any]:
    order = [i for i in np.argsort(-moves.sum(axis=0), kind="stable") if moves[:, i].any()]
    handles = [patch(CONTACT, "contact kept")] * bool((there & ~moves).any())
    handles += [patch(of_each[i], f"motion {i + 1}: {_name(data, moves[:, i], i)}")
                for i in sorted(order[:MOST_NAMED])]
    more = len(order) - MOST_NAMED
    handles += [patch(COLOURS[-1], f"{more} more, met at fewer values")] * (more > 0)
    reached = data["reached"].values == 1
    if np.any(data["unresolved"].values[reached] + data["failed"].values[reached] > 0):
        handles.append(patch(NOT_KNOWN, "not resolved or failed"))
    return handles


def _name(data: xr.Dataset, moves: NDArray[np.bool_], i: int) -> str:
    """What an attractor does where it parts: its periods, impacts and depths."""
    periods = dict.fromkeys(int(one) for one in data["period"].values[moves, i])
    period = " or ".join(f"period {one}" if one else "no period" for one in periods)
    rates = data["impacts_per_cycle"].values[moves, i]
    depths = style.URAD * data["deepest_separation"].values[moves, i]
    word = arrivals_in(data.attrs).word + "s" * bool((rates != 1).any())
    return f"{period}, {_span(rates, '.3g')} {word} a cycle, {_span(depths, '.2g')} µrad deep"


def _span(values: NDArray[Any], form: str) -> str:
    """The least and the greatest of some numbers, one where they are told alike."""
    ends = (f"{float(format(one, form)):g}" for one in (values.min(), values.max()))
    return " to ".join(dict.fromkeys(ends))


__all__ = ["draw", "shows"]
