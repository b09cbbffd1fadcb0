"""What the figures of a sweep share: branches, the marked critical value, the source's claims."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from lapwing.base import quantities
from lapwing.base.codes import Status
from lapwing.plots import style
from lapwing.results.findings import evidence_beyond, names

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# Of the branch that all others are compared with, and of those where they differ from it.
START_LABEL = style.START_STYLES["rest"]["label"]
DIFFERENT = ", where different"
# Sections that agree to this part are the same motion.  Of motions without a period their
# distributions: beyond this distance (the greatest difference of the shares below any value) two
# of a hundred points each, of one motion, hardly ever are, even if neighbours are correlated.
SAME, APART = 1e-3, 0.35
# Numbers that differ by less, as a part of them, are drawn on each other.
SEEN = 0.02
# Places told apart over the height of a panel, several to a pixel; and the number of points on
# one after which further ones change little, even at the edge of a small dot.
PLACES, OPAQUE = 4096, 20
# An entry of a legend has about so many letters; of a line of them so many fit.
LETTERS = 105
# What the heading of a sweep without a name tells of its operation.
OPERATION = ("brake_torque", "pinion_speed_rpm", "pinion_speed_rad_s", "mesh_frequency_hz")
# Words on an axis where they are others than a sentence takes.
AXIS_WORDS = {"restitution": "coefficient of restitution"}

# Half of the width of a label's column, whose distance is 1; letters of labels that stand level.
COLUMN, LABEL_LETTERS = 0.35, 90

# Free part of the range at either end, so that the points there are whole.
MARGIN = 0.008


def axis_label(name: str) -> str:
    """A parameter and its unit, for an axis."""
    known = quantities.parameter(name)
    words = AXIS_WORDS.get(name, known.words)
    return f"{words} ({known.shown})" if known.shown else words


class Claim(NamedTuple):
    """What a source reports at one value of the parameter; NaN: nothing.

    Attributes
    ----------
    value : float, of the parameter
    depth : float, rad; deepest separation
    text : str
    impacts : float, impacts per cycle
    """

    value: float
    depth: float = np.nan
    text: str = ""
    impacts: float = np.nan


def unit_of(parameter: str) -> str:
    """Unit of a parameter; empty text where it is a bare number or none of them."""
    return quantities.parameter(parameter).shown


def claims_of(sweep: xr.Dataset, given: list[Claim] | None) -> list[Claim]:
    """Claims within the range of a sweep: as given, or (None) as stored with it."""
    claims = [Claim(*one) for one in given or ()]
    if given is None and "claim_value" in sweep:
        texts = sweep["claim_text"].values if "claim_text" in sweep else itertools.repeat("")
        claims = [Claim(float(value), float(depth), str(text)) for value, depth, text in zip(
            sweep["claim_value"].values, sweep["claim_deepest_separation"].values, texts,
            strict="claim_text" in sweep)]
    values = sweep[parameter_of(sweep)].values
    return [claim for claim in claims if values[0] <= claim.value <= values[-1]]


def parameter_of(sweep: xr.Dataset) -> str:
    """Name of the parameter swept."""
    return str(sweep["status"].dims[1])


def placed(data: xr.Dataset, *names: str) -> xr.Dataset:
    """Labels of some dimensions as places 0, 1, 2 … on an axis, whose `labels` they become.

    Numbers stay. No names: those of the parameter of a sweep.
    """
    return data.assign_coords({
        name: (name, np.arange(data[name].size), {"labels": tuple(map(str, data[name].values))})
        for name in names or (parameter_of(data),) if quantities.are_labels(data[name].values)})


def labels_of(data: xr.Dataset, name: str) -> tuple[str, ...]:
    """Labels at the places of a dimension that is `placed`; none of numbers."""
    return tuple(data[name].attrs.get("labels", ()))


def put_labels(axis: Axes, side: str, labels: tuple[str, ...]) -> None:
    """Labels as ticks of an axis, 'x' or 'y'; slanted where they are long."""
    places = np.arange(len(labels))
    one = axis.xaxis if side == "x" else axis.yaxis
    one.set_ticks(places, labels)
    one.set_tick_params(which="minor", length=0)
    if side == "x" and sum(map(len, labels)) > LABEL_LETTERS:
        axis.tick_params(axis="x", rotation=30)


def in_columns(sweep: xr.Dataset) -> bool:
    """Whether the values of a sweep are labels: what is drawn of one fills a column of its own."""
    return bool(labels_of(sweep, parameter_of(sweep)))


def columns(axis: Axes, x: NDArray[Any], y: NDArray[Any], look: dict[str, Any]) -> None:
    """A level in the column of each label; nothing joins neighbours, which have no order."""
    axis.hlines(y, x - COLUMN, x + COLUMN, color=look["color"], linewidth=2)


def branches(sweep: xr.Dataset) -> list[tuple[xr.Dataset, Any]]:
    """(dataset, style) of each start that was swept, in drawing order."""
    starts = [str(start) for start in sweep["start"].values]
    return [(sweep.isel(start=starts.index(start)), style.START_STYLES[start])
            for start in style.DRAWING_ORDER if start in starts]


def differs(sweep: xr.Dataset, branch: xr.Dataset) -> NDArray[Any]:
    """At which values a branch has another motion than the one from rest, or none to compare.

    The same: both with one period and, whatever the cycle it begins with, one section; or both
    without, and sections that are distributed alike.
    """
    starts = [str(start) for start in sweep["start"].values]
    if str(branch["start"].values) == "rest" or "rest" not in starts:
        return np.ones(branch["status"].shape, bool)
    rest = sweep.isel(start=starts.index("rest"))
    one, two = (np.sort(data["phi"].values, axis=-1) for data in (branch, rest))
    close = np.abs(one - two) <= SAME * np.maximum(np.abs(two), SAME * np.nanmax(
        np.abs(two), initial=0.0))
    done = (branch["status"].values == Status.OK) & (rest["status"].values == Status.OK)
    same = done & (branch["period"].values == rest["period"].values)
    wild = same & (rest["period"].values == 0)
    same &= wild | close.all(axis=-1)
    for i in np.flatnonzero(wild):
        same[i] = _distance(one[i], two[i]) <= APART
    other: NDArray[Any] = ~same
    return other


def stands_apart(sweep: xr.Dataset, branch: xr.Dataset,
                 drawn: Callable[[xr.Dataset], NDArray[Any]]) -> NDArray[Any]:
    """Where a branch has another motion than the one from rest, and is drawn at another place.

    Parameters
    ----------
    sweep, branch : as for `differs`
    drawn : function, a branch -> the numbers drawn, one for each value
    """
    apart = differs(sweep, branch)
    if str(branch["start"].values) == "rest" or "rest" not in sweep["start"].values:
        return apart
    one, two = drawn(branch), drawn(sweep.sel(start="rest"))
    # Without a result from rest (NaN) there is nothing that it would lie on.
    apart &= ~(np.abs(one - two) <= SEEN * np.maximum(np.abs(one), np.abs(two)))
    return apart


def _distance(one: NDArray[Any], two: NDArray[Any]) -> float:
    """Kolmogorov's distance of two sorted samples."""
    at = np.concatenate([one, two])
    shares = [np.searchsorted(some, at, side="right") / some.size for some in (one, two)]
    return float(np.max(np.abs(shares[0] - shares[1])))


def beside(values: NDArray[Any], shown: NDArray[Any]) -> NDArray[Any]:
    """A line where it is shown and at the neighbours on either side, so that it joins the others.

    NaN elsewhere.
    """
    near = shown | np.append(shown[1:], False) | np.append(False, shown[:-1])
    return np.where(near, values, np.nan)


def failed(dataset: xr.Dataset) -> NDArray[Any]:
    """Where a run failed numerically; points that an interrupted sweep never reached are not."""
    status = dataset["status"].values
    found: NDArray[Any] = (status != Status.OK) & (status != Status.UNFINISHED)
    return found


def lost(sweep: xr.Dataset, start: str) -> str:
    """Words for a start without any result; empty where it has one."""
    some = bool((sweep["status"].sel(start=start).values == Status.OK).any())
    return "" if some else "no result at any value"


def full_engagement_of(sweep: xr.Dataset, given: float | None) -> float | None:
    """Critical value of complete engagement: as given, or as stored; None if unknown."""
    stored = sweep.attrs.get("full_engagement")
    given = stored if given is None else given
    return None if given is None or not np.isfinite(given) else float(given)


def beyond(sweep: xr.Dataset, value: float) -> str:
    """What was seen to rattle above a value, in few words: the report says the rest."""
    if "states_visited" not in sweep:
        return "other motions may rattle above"
    evidence = evidence_beyond(sweep, value)
    seen = [one for one in evidence if one.rattling.size]
    looked = [one for one in evidence if one.looked.size]
    if seen:
        last = max(one.rattling[-1] for one in seen)
        starts = names([one.start for one in seen if one.rattling[-1] == last])
        return f"rattling seen up to {last:g} ({starts})"
    if not looked:
        return "what rattles above is not known"
    blind = names([one.start for one in evidence if not one.looked.size])
    return "no rattling seen above" + f" ({blind}: not known)" * bool(blind)


def is_log(values: NDArray[Any]) -> bool:
    """Whether values are in equal ratios, and far apart."""
    return bool(values[0] > 0 and values[-1] > 3 * values[0]
                and np.ptp(np.diff(np.log(values))) < 1e-6)


def edges_of(values: NDArray[Any]) -> NDArray[Any]:
    """Edges of columns around values."""
    if values.size == 1:
        return np.array([values[0] - 0.5, values[0] + 0.5])
    middle = 0.5 * (values[1:] + values[:-1])
    return np.concatenate([[2 * values[0] - middle[0]], middle, [2 * values[-1] - middle[-1]]])


def claim_marker(axis: Axes, value: float, height: float) -> None:
    """An open diamond."""
    axis.plot(value, height, marker="D", markersize=7, markerfacecolor="none", clip_on=False,
              markeredgecolor=style.CLAIM, markeredgewidth=1.8, linestyle="", zorder=6)


def legend(figure: Figure, sweep: xr.Dataset, *, claims: bool = False, failed: bool = False,
           lines: bool = False, more: Sequence[Any] = ()) -> None:
    """One entry for each branch, drawn as the panels have it, outside of them.

    `lines`: the branches are lines with dots; `more`: entries of other things.
    """
    from matplotlib.lines import Line2D

    found = branches(sweep)
    differ = DIFFERENT if any(look["label"] == START_LABEL for _, look in found) else ""
    handles = [Line2D([], [], linestyle="-" if lines else "", marker="o",
                      markersize=3.5 if lines else 5, color=look["color"],
                      linewidth=look["width"],
                      label=look["label"] + (differ if look["label"] != START_LABEL else ""))
               for _, look in found]
    if claims:
        handles.append(Line2D([], [], linestyle="", marker="D", markersize=6, label="source",
                              markerfacecolor="none", markeredgecolor=style.CLAIM,
                              markeredgewidth=1.6))
    if failed:
        handles.append(Line2D([], [], linestyle="", marker="x", markersize=6, label="failed",
                              color=style.BLACK))
    handles += more
    rows = -(-sum(len(str(one.get_label())) + 8 for one in handles) // LETTERS)
    figure.legend(handles=handles, loc="outside lower center", ncols=-(-len(handles) // rows))


def heading(what: str, sweep: xr.Dataset) -> str:
    """What a figure shows, of which sweep: by its name, or by the torque and speed it has."""
    if sweep.attrs.get("name"):
        return f"{what}: {sweep.attrs['name']}"
    known = [(name, quantities.PARAMETERS[name].shown) for name in OPERATION if name in sweep.attrs]
    return ", ".join([what, *(f"{sweep.attrs[name]:g} {unit}" for name, unit in known)])


def finish(figure: Figure, axes: NDArray[Any], sweep: xr.Dataset, what: str,
           title: str | None) -> None:
    """Label and limits of the parameter's axis, and the heading; `title` None: `heading`."""
    parameter = parameter_of(sweep)
    values = sweep[parameter].values
    axes[-1].set_xlabel(axis_label(parameter))
    if in_columns(sweep):
        put_labels(axes[-1], "x", labels_of(sweep, parameter))
        axes[-1].set_xlim(-0.5, values.size - 0.5)
    elif values.size == 1:
        axes[-1].set_xticks(values)
    if values[-1] > values[0] and not in_columns(sweep):
        if is_log(values):
            axes[-1].set_xscale("log")
            style.plain_powers(axes[-1].xaxis)
            wider = (values[-1] / values[0]) ** MARGIN
            axes[-1].set_xlim(values[0] / wider, values[-1] * wider)
        else:
            wider = MARGIN * (values[-1] - values[0])
            axes[-1].set_xlim(values[0] - wider, values[-1] + wider)
    figure.suptitle(heading(what, sweep) if title is None else title)


def dots(axis: Axes, x: NDArray[Any], y: NDArray[Any], look: dict[str, Any],
         wide: bool = False) -> None:
    """All points of a line (x, y of one shape); the scale must be final. `wide`: as columns.

    A periodic motion comes to the same places in every cycle; no more is drawn than can be seen.
    """
    x, y = x[np.isfinite(y)], y[np.isfinite(y)]
    if y.size == 0:
        return
    height = axis.yaxis.get_transform().transform(y)
    row = np.round((height - height.min()) * (PLACES / (np.ptp(height) or 1))).astype(np.int64)
    column = np.unique(x, return_inverse=True)[1]
    _, first, count = np.unique(column * (PLACES + 1) + row, return_index=True,
                                return_counts=True)
    points = np.repeat(first, np.minimum(count, OPAQUE))
    if wide:
        axis.hlines(y[points], x[points] - COLUMN, x[points] + COLUMN, linewidth=0.8,
                    alpha=look["alpha"], color=look["color"], rasterized=True)
        return
    axis.plot(x[points], y[points], linestyle="", marker="o", markersize=look["size"],
              markeredgewidth=0, alpha=look["alpha"], color=look["color"], rasterized=True)
