"""Critical values found by searches, drawn as bars through the panels of a sweep."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from lapwing.plots import style
from lapwing.plots.sweep import parts as sweep_parts
from lapwing.results.findings import search_bounded, search_known

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.axes import Axes

SYMBOLS = {"full": "T_full", "safe": "T_safe", "back": "T_back", "on": "T_on"}
# By what is found; T_full has a line of its own where it is stored with the sweep.
COLORS = {"full": "0.35", "safe": style.GREEN, "back": style.BLUE, "on": style.BLACK}
# The words of the next bar on the same side stand so much lower, in parts of the panel.
STAGGER = 0.09


class Mark(NamedTuple):
    """One critical value: what was found, the ends of its bar, and its words."""

    find: str
    low: float
    high: float
    label: str


def marks_of(criticals: list[xr.Dataset], parameter: str) -> list[Mark]:
    """Marks along a parameter; searches at a torque or speed of their own are left out.

    Parameters
    ----------
    criticals : sequence of Dataset, groups `critical_<name>`
    parameter : str

    Returns
    -------
    list of Mark, from low to high
    """
    marks = []
    for one in criticals:
        attrs = one.attrs
        if attrs["parameter"] != parameter or attrs["outcome"] != "found" \
                or attrs.get("own_operation", 0):
            continue
        low, high = sorted(bracket(attrs)) if search_bounded(one) else (attrs["clean"],) * 2
        side = "above" if attrs.get("safe_end", "high") == "high" else "below"
        words = {"back": "T_back: " + label_of(one),
                 "safe": label_of(one) + f": no rattling seen {side}"}
        marks.append(Mark(str(attrs["find"]), float(low), float(high),
                          words.get(attrs["find"], label_of(one))))
    return sorted(marks, key=lambda mark: mark.low)


def bracket(attrs: dict[str, Any]) -> tuple[float, float]:
    """The two ends between which a critical value lies."""
    if attrs["find"] == "back":
        return attrs["last_seen"], attrs["first_clean"]
    return attrs["estimate"] - attrs["bar"], attrs["estimate"] + attrs["bar"]


def label_of(critical: xr.Dataset) -> str:
    """The result in a few words."""
    attrs = critical.attrs
    name = SYMBOLS[attrs["find"]] if attrs["parameter"] == "brake_torque" else "critical value"
    if not search_known(critical):
        return f"{name}: not known"
    if attrs["outcome"] != "found":
        return f"{name}: none in the range searched"
    if not search_bounded(critical):
        limit = "at most" if attrs["safe_end"] == "high" else "at least"
        return f"{name} {limit} {attrs['clean']:g}, motions failed beyond"
    unit = sweep_parts.unit_of(attrs["parameter"])
    if attrs["find"] == "back":
        return f"last seen at {attrs['last_seen']:g}, none at {attrs['first_clean']:g} {unit}"
    noise = f" ({attrs['low']:.3g} to {attrs['high']:.3g}, 95 %)" if "low" in attrs else ""
    if attrs["bar"] > 0:
        places = max(0, 1 - int(np.floor(np.log10(attrs["bar"]))))
        number = f"{attrs['estimate']:.{places}f} ± {attrs['bar']:.2g}"
    else:
        number = f"{attrs['estimate']:.{3 if noise else 4}g}"
    return f"{name} = {number} {unit}".rstrip() + noise


def draw_marks(axes: Any, labelled: Axes, marks: Any, x: NDArray[Any], drawn: float | None = None,
               heights: tuple[float, float] = (0.55, 0.55)) -> None:
    """Bars through all panels, their words beside them in one of the panels.

    Parameters
    ----------
    axes : sequence of Axes, of one horizontal axis
    labelled : Axes, one of them
    marks : sequence of Mark
    x : array, the values swept; what lies outside is left out
    drawn : float or None, T_full where it is drawn already
    heights : two floats, parts of the panel: of the words to the right and to the left of a bar
    """
    span = x[-1] - x[0]
    shown = [mark for mark in marks if x[0] <= mark.high and mark.low <= x[-1]
             and not (mark.find == "full" and drawn is not None)]
    heights = [*heights]
    for mark in shown:
        color = COLORS[mark.find]
        for axis in axes:
            axis.axvspan(mark.low, mark.high, color=color, alpha=0.3, linewidth=0, zorder=1)
            axis.axvline(0.5 * (mark.low + mark.high), color=color, linewidth=0.9, zorder=1,
                         linestyle=(0, (2, 2)))
        right = mark.high - x[0] < 0.5 * span
        labelled.annotate(
            mark.label, (mark.high if right else mark.low, heights[not right]),
            xycoords=("data", "axes fraction"),
            xytext=(5 if right else -5, 0), textcoords="offset points", va="center",
            ha="left" if right else "right", fontsize=8.5, color=color, zorder=6,
            bbox={"facecolor": "white", "edgecolor": "none", "alpha": 0.8, "pad": 1})
        heights[not right] -= STAGGER
