"""What the figures of a map share: the plane, its axes, T_full, what has no result."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from lapwing.base.codes import Status
from lapwing.plots import style
from lapwing.plots.sweep.parts import (
    axis_label,
    edges_of,
    is_log,
    labels_of,
    placed,
    put_labels,
)
from lapwing.results.findings import map_rattles

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

MISSING, NONE = "white", "0.93"
# Values of an axis that are drawn, more than a panel has pixels.
MOST_VALUES = 2000
# Lines of an image whose cells are of different widths, and most edges that are drawn one by one.
PIXELS, MOST_EDGES = 2000, 20_000


def axes_of(data: xr.Dataset) -> tuple[str, str]:
    """Parameters drawn to the right and upwards."""
    return str(data.attrs["x_parameter"]), str(data.attrs["y_parameter"])


def thinned(data: xr.Dataset) -> xr.Dataset:
    """Each n-th value of an axis that has more than can be seen; the axis says so (`every`).

    Labels become places on it (`sweep.parts.placed`).
    """
    data = placed(data, *axes_of(data))
    steps = {name: -(-data[name].size // MOST_VALUES) for name in axes_of(data)}
    found = data.isel({name: slice(None, None, step) for name, step in steps.items()})
    return found.assign_coords({name: found[name].assign_attrs(every=step)
                                for name, step in steps.items()})


def plane(data: xr.Dataset, name: str) -> NDArray[Any]:
    """A variable as array (y, x); real numbers as precise as a picture needs."""
    x, y = axes_of(data)
    values = data[name].transpose(y, x).values
    return values.astype(np.float32) if values.dtype.kind == "f" else values


def known(data: xr.Dataset) -> NDArray[np.bool_]:
    """Which runs have a result, (y, x)."""
    found: NDArray[np.bool_] = plane(data, "status") == Status.OK
    return found


def new_plane(title: str) -> tuple[Figure, Axes]:
    """Figure and panel."""
    figure = style.new_figure(8.4, 6.2)
    axis = figure.subplots()
    axis.grid(False)
    axis.set_facecolor(MISSING)
    figure.suptitle(title)
    return figure, axis


def cells(axis: Axes, data: xr.Dataset, values: NDArray[Any], **look: Any) -> Any:
    """Draw values (y, x) as an image of cells, and label the axes; returns what a colour bar needs.

    Of a million values a mesh of polygons would take ten times the memory, an image coloured pixel
    by pixel, not cell by cell, three times.

    Parameters
    ----------
    axis, data : the panel, and the map
    values : array (y, x), NaN or masked: nothing is drawn
    **look : cmap, norm, vmin, vmax, as for `matplotlib.cm.ScalarMappable`
    """
    from matplotlib.cm import ScalarMappable

    x, y = axes_of(data)
    edges = {name: _edges(data[name].values) for name in (x, y)}
    rows, columns = (_image_lines(data[name].values) for name in (y, x))
    drawn = ScalarMappable(look.pop("norm", None), look.pop("cmap"))
    shown = np.ma.masked_invalid(values)
    drawn.set_array(shown)
    drawn.set_clim(**look)
    drawn.autoscale_None()
    axis.imshow(drawn.to_rgba(shown[rows][:, columns], bytes=True), origin="lower",
                extent=(0, 1, 0, 1), transform=axis.transAxes, interpolation="nearest",
                aspect="auto")
    for name, one, scale in ((x, axis.xaxis, axis.set_xscale), (y, axis.yaxis, axis.set_yscale)):
        if _is_log(data[name].values):
            scale("log")
            style.plain_powers(one)
    for name, label in ((x, axis.set_xlabel), (y, axis.set_ylabel)):
        every = data[name].attrs.get("every", 1)
        if labels_of(data, name):
            put_labels(axis, "x" if name == x else "y", labels_of(data, name))
        label(axis_label(name) + f", one of {every} values drawn" * (every > 1))
    axis.set_xlim(edges[x][0], edges[x][-1])
    axis.set_ylim(edges[y][0], edges[y][-1])
    return drawn


def _image_lines(values: NDArray[Any]) -> Any:
    """Which value each line of an image of the cells shows, the lines at equal distances."""
    edges = _edges(values)
    if _is_log(values):
        edges = np.log(edges)
    widths = np.diff(edges)
    if np.ptp(widths) * values.size < widths.mean() / 4:
        return slice(None)
    # The middle of each line of pixels decides.
    middles = edges[0] + (edges[-1] - edges[0]) * (np.arange(PIXELS) + 0.5) / PIXELS
    return np.clip(np.searchsorted(edges, middles, side="right") - 1, 0, values.size - 1)


def _is_log(values: NDArray[Any]) -> bool:
    """Whether an axis is logarithmic; of two values nobody knows."""
    return values.size > 2 and is_log(values)


def _edges(values: NDArray[Any]) -> NDArray[Any]:
    return np.exp(edges_of(np.log(values))) if _is_log(values) else edges_of(values)


def patch(colour: Any, label: str) -> Any:
    """Entry of a legend for cells of one colour."""
    from matplotlib.patches import Patch

    return Patch(facecolor=colour, edgecolor="0.6", linewidth=0.5, label=label)


def cells_of(axis: Axes, data: xr.Dataset, where: NDArray[np.bool_], colour: Any,
             words: str) -> list[Any]:
    """Draw cells (y, x) of one colour; entries for the legend, none where there is no such cell."""
    from matplotlib.colors import ListedColormap

    cells(axis, data, np.where(where, 0.0, np.nan), cmap=ListedColormap([colour]))
    return [patch(colour, words)] * bool(where.any())


def none_cells(axis: Axes, data: xr.Dataset, none: NDArray[np.bool_]) -> list[Any]:
    """Draw cells (y, x) where there is none of what is shown; entries for the legend."""
    return cells_of(axis, data, none, NONE, "none")


def has_sizes(data: xr.Dataset, name: str) -> bool:
    """Whether some run has such a number above 0."""
    return name in data and bool((known(data) & (plane(data, name) > 0)).any())


def sizes(data: xr.Dataset, name: str, factor: float, title: str, label: str) -> Figure:
    """Draw a variable that is nowhere negative, on a logarithmic scale; grey where it is 0.

    Parameters
    ----------
    data : xarray.Dataset, a map
    name, factor : the variable, and what it is multiplied by
    title, label : of the figure, and of the scale
    """
    from matplotlib.colors import LogNorm

    data = thinned(data)
    values = factor * plane(data, name)
    figure, axis = new_plane(title.removeprefix(": "))
    handles = none_cells(axis, data, known(data) & (values == 0))
    some = np.where(known(data) & (values > 0), values, np.nan)
    low, high = np.nanpercentile(some, 1), np.nanmax(some)
    drawn = cells(axis, data, some, cmap="viridis", norm=LogNorm(min(low, 0.5 * high), high))
    bar = figure.colorbar(drawn, ax=axis, extend="min" if np.nanmin(some) < low else "neither")
    style.plain_powers(bar.ax.yaxis)
    bar.set_label(label)
    return finish(figure, axis, data, handles)


def outline(axis: Axes, data: xr.Dataset, where: NDArray[np.bool_], colour: Any) -> None:
    """Draw the edges of cells (y, x) between those where something holds and all others.

    Where these are very many, the cells within them instead, which then are hardly more than dots.
    """
    x, y = (_edges(data[name].values) for name in axes_of(data))
    ringed = np.pad(where, 1)
    border = ringed[1:-1, 1:-1] & ~(ringed[2:, 1:-1] & ringed[:-2, 1:-1]
                                    & ringed[1:-1, 2:] & ringed[1:-1, :-2])
    if np.count_nonzero(border) > MOST_EDGES:
        from matplotlib.colors import ListedColormap

        cells(axis, data, np.ma.masked_array(np.zeros(where.shape, np.int8), ~border),
              cmap=ListedColormap([colour]))
        return
    j, i = np.nonzero(ringed[1:-1, 1:] != ringed[1:-1, :-1])
    upright = np.stack([[x[i], y[j]], [x[i], y[j + 1]]])
    j, i = np.nonzero(ringed[1:, 1:-1] != ringed[:-1, 1:-1])
    level = np.stack([[x[i], y[j]], [x[i + 1], y[j]]])
    # One line with gaps: they may be too many for objects of their own.
    edges = np.full((3, 2, upright.shape[2] + level.shape[2]), np.nan)
    edges[:2] = np.concatenate([upright, level], axis=2)
    axis.plot(*edges.transpose(1, 2, 0).reshape(2, -1), color=colour, linewidth=1.2,
              solid_capstyle="projecting", rasterized=True)


def mark_full_engagement(axis: Axes, data: xr.Dataset) -> bool:
    """T_full as a line, where it is known; returns whether it is seen."""
    if "full_engagement" not in data or not np.isfinite(data["full_engagement"].values).any():
        return False
    (other,) = data["full_engagement"].dims
    at, torque = data[other].values, data["full_engagement"].values
    if at.size == 1 or labels_of(data, str(other)):  # a level of its own for each column
        edges, gaps = _edges(at), np.full(at.size, np.nan)
        at = np.stack([edges[:-1], edges[1:], gaps], axis=1).ravel()[:-1]
        torque = np.stack([torque, torque, gaps], axis=1).ravel()[:-1]
    upwards = axes_of(data)[0] == other
    low, high = axis.get_ylim() if upwards else axis.get_xlim()
    for width, colour in ((2.6, "white"), (1.2, style.BLACK)):
        axis.plot(*((at, torque) if upwards else (torque, at)), color=colour, linewidth=width,
                  linestyle=(0, (5, 2)))
    return bool(np.nanmin(torque) <= high and np.nanmax(torque) >= low)


def mark_last_rattling(axis: Axes, data: xr.Dataset) -> bool:
    """The braking torque up to which each column or row saw rattling, as a line of steps.

    Below T_safe or at it, by the runs of the map alone: no line where the last run rattles or has
    no result, or none does. Returns whether it is seen.
    """
    x, y = axes_of(data)
    if "brake_torque" not in (x, y):
        return False
    other = x if y == "brake_torque" else y
    rattles, ended = (one.transpose(other, "brake_torque").values
                      for one in (map_rattles(data), data["status"] == Status.OK))
    torques, edges = _edges(data["brake_torque"].values)[1:], _edges(data[other].values)
    last = rattles.shape[1] - 1 - rattles[:, ::-1].argmax(axis=1)
    above = np.arange(rattles.shape[1]) > last[:, None]
    told = rattles.any(axis=1) & ~rattles[:, -1] & (ended | ~above).all(axis=1)
    if not told.any():
        return False
    line = np.append(np.where(told, torques[last], np.nan), np.nan)
    line[-1] = line[-2]
    if y == "brake_torque":
        axis.step(edges, line, where="post", color=style.BLACK, linewidth=0.9)
    else:
        axis.step(line, edges, where="pre", color=style.BLACK, linewidth=0.9)
    return True


def line_handles(full: bool, last: bool) -> list[Any]:
    """Entries of a legend for T_full, and for the last rattling torques."""
    from matplotlib.lines import Line2D

    return [Line2D([], [], color=style.BLACK, linewidth=1.2, linestyle=(0, (5, 2)),
                   label="T_full: the engaged motion keeps contact above")] * full \
        + [Line2D([], [], color=style.BLACK, linewidth=0.9,
                  label="last rattling torque of this map")] * last


def status_handles(data: xr.Dataset) -> tuple[list[Any], NDArray[np.bool_]]:
    """Entries for what failed and what was not reached, and the cells of what failed (y, x)."""
    from matplotlib.patches import Patch

    status = plane(data, "status")
    open_ = status == Status.UNFINISHED
    failed = (status != Status.OK) & ~open_
    handles = [Patch(facecolor=style.BLACK, label="failed")] * bool(failed.any())
    handles += [Patch(facecolor=MISSING, edgecolor="0.6", label="not reached")] * bool(open_.any())
    return handles, failed


def finish(figure: Figure, axis: Axes, data: xr.Dataset, handles: list[Any]) -> Figure:
    """What is below the panel, and between the columns or rows of labels."""
    for name, line in zip(axes_of(data), (axis.axvline, axis.axhline), strict=True):
        for place in range(1, len(labels_of(data, name))):
            line(place - 0.5, color="white", linewidth=2)
    last = mark_last_rattling(axis, data)
    seen = line_handles(mark_full_engagement(axis, data), last)
    lost, failed = status_handles(data)
    if failed.any():
        from matplotlib.colors import ListedColormap

        cells(axis, data, np.where(failed, 0.0, np.nan), cmap=ListedColormap([style.BLACK]))
    handles = [*handles, *lost, *seen]
    # As many columns as there is room for.
    for columns in range(min(4, len(handles)), 0, -1):
        legend = figure.legend(handles=handles, loc="outside lower center", ncols=columns)
        if columns == 1 or legend.get_window_extent().width <= figure.bbox.width:
            break
        legend.remove()
    return figure
