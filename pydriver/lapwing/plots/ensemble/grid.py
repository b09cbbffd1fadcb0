"""Panels of a figure of an ensemble, one for each answer."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

from lapwing.plots import style

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

COLUMNS = 2


class Panels(NamedTuple):
    """A figure and its panels, in reading order."""

    figure: Figure
    axes: list[Axes]


def panels(count: int, height: float) -> Panels:
    """So many panels side by side, each so high (inches); places left over stay empty."""
    rows = -(-count // COLUMNS)
    figure = style.new_figure(9.0, 0.9 + height * rows)
    places = figure.subplots(rows, COLUMNS, squeeze=False).ravel()
    for axis in places[count:]:
        axis.remove()
    return Panels(figure, list(places[:count]))
