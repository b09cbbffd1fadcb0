"""Critical values found by searches, drawn as bars through the panels of a sweep."""

from __future__ import annotations

import textwrap
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from lapwing.base import quantities
from lapwing.base.arrivals import arrivals_in
from lapwing.base.messages import at_least, at_most, decimals
from lapwing.plots import style
from lapwing.plots.layout import ABOVE
from lapwing.plots.sweep import parts as sweep_parts
from lapwing.results.findings import (
    SYMBOLS,
    known,
    search_bounded,
    search_known,
)

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.axes import Axes

# By what is found; T_full has a line of its own where it is stored with the sweep.
COLORS = {"full": "0.35", "safe": style.GREEN, "back": style.BLUE, "on": style.BLACK}
# Points: a row of words above a panel, and a letter of them; inches beside a panel.
ROW, LETTER, BESIDE = 12.5, 4.7, 1.6


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
        words = {"on": f": a resting rigid tooth stays {side}",
                 "full": f": the engaged motion keeps contact {side}"}
        label = f"T_back: back impacts {label_of(one)}" if attrs["find"] == "back" else \
            label_of(one) + words.get(str(attrs["find"]), "")
        marks.append(Mark(str(attrs["find"]), float(low), float(high), label))
    return sorted(marks, key=lambda mark: mark.low)


def bracket(attrs: dict[str, Any]) -> tuple[float, float]:
    """The two ends between which a critical value lies."""
    if attrs["find"] == "back":
        return attrs["last_seen"], attrs["first_clean"]
    return attrs["estimate"] - attrs["bar"], attrs["estimate"] + attrs["bar"]


def label_of(critical: xr.Dataset) -> str:
    """The result in a few words."""
    attrs = critical.attrs
    name = SYMBOLS[attrs["find"]] if attrs["parameter"] == "brake_torque" else \
        f"critical {quantities.parameter(attrs['parameter']).words}"
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
    if attrs["find"] == "safe" and "low" not in attrs:
        # The report tells the two ends by the same rule.
        ends = (at_most, at_least) if attrs["safe_end"] == "high" else (at_least, at_most)
        step = abs(attrs["clean"] - attrs["rattling"])
        on = " on" if attrs["safe_end"] == "high" else " down"
        return (f"{name}: rattling seen at {ends[0](attrs['rattling'], step)}, none from "
                f"{ends[1](attrs['clean'], step)} {unit}".rstrip() + on)
    noise = f" ({attrs['low']:.3g} to {attrs['high']:.3g}, 95 %)" if "low" in attrs else ""
    if attrs["bar"] > 0:
        number = " ± ".join(decimals(attrs["estimate"], attrs["bar"]))
    else:
        number = f"{attrs['estimate']:.{3 if noise else 4}g}"
    return f"{name} = {number} {unit}".rstrip() + noise


def full_mark(sweep: xr.Dataset, given: float | None = None,
              searched: bool = False) -> Mark | None:
    """T_full of a sweep and what rattles above it; None where it is not known or not in range.

    Parameters
    ----------
    sweep : xarray.Dataset
    given : float or None, its value; default: as stored with the sweep
    searched : bool, whether a search says what rattles above, which then is not said again
    """
    value, x = sweep_parts.full_engagement_of(sweep, given), _values_of(sweep)
    if value is None or not x[0] <= value <= x[-1]:
        return None
    ends = [float(sweep.attrs[key]) for key in ("full_engagement_low", "full_engagement_high")
            if np.isfinite(sweep.attrs.get(key, np.nan))]
    number = at_least(value) if len(ends) < 2 else \
        f"{value:.3g} ({ends[0]:.3g} to {ends[1]:.3g}, 95 %)"
    low, high = ends if len(ends) == 2 else (value, value)
    unit = sweep_parts.unit_of(sweep_parts.parameter_of(sweep))
    return Mark("full", low, high, f"T_full = {number} {unit}: the engaged motion keeps contact "
                "above" + f"; {sweep_parts.beyond(sweep, value)}" * (not searched))


def back_mark(sweep: xr.Dataset) -> Mark | None:
    """The last back impact that a sweep saw along the braking torque; None where it saw no end."""
    if sweep_parts.parameter_of(sweep) != "brake_torque" or "back_impacts" not in sweep:
        return None
    values, done = _values_of(sweep), np.all(known(sweep), axis=0)
    seen = (sweep["back_impacts"] + sweep["back_engages"] > 0).any(
        ("start", "recorded_cycle")).values
    last = np.flatnonzero(seen)
    if not last.size or last[-1] == values.size - 1 or values[0] < 0 \
            or not np.all(done[last[-1] + 1:]):
        return None
    low, high = values[last[-1]], values[last[-1] + 1]
    unit, word = sweep_parts.unit_of("brake_torque"), arrivals_in(sweep.attrs).word
    return Mark("back", float(low), float(high),
                f"back {word}s last seen at {low:g}, none from {high:g} {unit} on")


def mark_sweep(axes: Any, sweep: xr.Dataset, full_engagement: float | None, marks: Any,
               color: str | None = None) -> None:
    """T_full and critical values as lines and bars through panels of a sweep.

    Parameters
    ----------
    axes : sequence of Axes, of one horizontal axis; the words stand above the first of them, under
        its title, which must be there
    sweep : xarray.Dataset
    full_engagement : float or None, as for `full_mark`
    marks : sequence of Mark
    color : of all lines, or None: each its own
    """
    searched = any(mark.find == "safe" for mark in marks)
    own = {mark.find: mark for mark in (full_mark(sweep, full_engagement, searched),
                                        back_mark(sweep)) if mark is not None}
    if any(mark.find == "back" for mark in marks):  # a search looks longer
        own.pop("back", None)
    others = [mark for mark in marks if not (mark.find == "full" and "full" in own)]
    draw_marks(axes, [*own.values(), *others], _values_of(sweep), color)


def _values_of(sweep: xr.Dataset) -> NDArray[Any]:
    values: NDArray[Any] = sweep[sweep_parts.parameter_of(sweep)].values
    return values


def draw_marks(axes: Any, marks: Any, x: NDArray[Any], color: str | None = None) -> None:
    """Lines and bars through all panels, their words above the first.

    Parameters
    ----------
    axes, color : as for `mark_sweep`
    marks : sequence of Mark
    x : array, ascending, the values on the horizontal axis; what lies outside is left out
    """
    shown = [mark for mark in marks if x[0] <= mark.high and mark.low <= x[-1]]
    for mark in shown:
        look = color or COLORS[mark.find]
        dashes = (5, 3) if mark.find == "full" else (2, 2)
        for axis in axes:
            if mark.high > mark.low:
                axis.axvspan(mark.low, mark.high, color=look, linewidth=0, zorder=0.5,
                             alpha=0.15 if mark.find == "full" else 0.3)
            axis.axvline(0.5 * (mark.low + mark.high), color=look, linewidth=0.9, zorder=1,
                         linestyle=(0, dashes))
    _words(axes[0], shown, x)


def _words(axis: Axes, marks: list[Mark], x: NDArray[Any]) -> None:
    """Words in rows above a panel, so that they cover no data, each with a leader to its bar."""
    figure: Any = axis.figure
    spec: Any = axis.get_subplotspec()
    width = 72 * (figure.get_figwidth() / spec.get_gridspec().ncols - BESIDE)
    words = [_Words.of(mark, _part(0.5 * (mark.low + mark.high), x, sweep_parts.is_log(x)), width)
             for mark in marks]
    # Words that go to the left have the leftmost bar lowest, those to the right the rightmost.
    left = sorted((one for one in words if one.to_left), key=lambda one: one.part)
    right = sorted((one for one in words if not one.to_left), key=lambda one: -one.part)
    rows = min((_rows(order) for order in ([*left, *right], [*right, *left])),
               key=lambda found: (found[0], max(found[1].values(), default=0)))[1]
    for one in words:
        mark, color = one.mark, COLORS[one.mark.find]
        axis.annotate(
            "\n".join(one.lines), (0.5 * (mark.low + mark.high), 1),
            xycoords=("data", "axes fraction"), xytext=(0, 3 + ROW * rows[one]),
            textcoords="offset points", ha="right" if one.to_left else "left", va="bottom",
            fontsize=8.5, color=color, annotation_clip=False, gid=ABOVE,
            arrowprops={"arrowstyle": "-", "color": color, "linewidth": 0.9,
                        "shrinkA": 0, "shrinkB": 0, "relpos": (float(one.to_left), 0)})
    if words and axis.get_title("left"):
        high = max(rows[one] + len(one.lines) for one in words)
        axis.set_title(axis.get_title("left"), pad=6 + ROW * high)


class _Words(NamedTuple):
    """The words of a mark: where its bar is and where they begin and end, in parts of the panel."""

    mark: Mark
    part: float
    lines: tuple[str, ...]
    low: float
    high: float

    @classmethod
    def of(cls, mark: Mark, part: float, width: float) -> _Words:
        """Words of a mark at a part of a panel so many points wide."""
        side = part if part > 0.5 else 1 - part
        lines = tuple(textwrap.wrap(mark.label, max(int(side * width / LETTER), 20)))
        wide = max(map(len, lines)) * LETTER / width
        ends = (part - wide, part) if part > 0.5 else (part, part + wide)
        return cls(mark, part, lines, *ends)

    @property
    def to_left(self) -> bool:
        """Whether they stand left of the bar."""
        return self.part > 0.5


def _rows(words: list[_Words]) -> tuple[int, dict[_Words, int]]:
    """The lowest free row for each; and how many leaders then cross other words."""
    rows: dict[_Words, int] = {}
    for one in words:
        rows[one] = next(row for row in range(99) if not any(
            row < at + len(other.lines) and at < row + len(one.lines)
            and one.low <= other.high and other.low <= one.high for other, at in rows.items())
            and not any(row < at and one.low < other.part < one.high
                        for other, at in rows.items()))
    crossed = sum(rows[other] < rows[one] and other.low < one.part < other.high
                  for one in words for other in words)
    return crossed, rows


def _part(value: float, x: NDArray[Any], log: bool) -> float:
    """Where a value lies, from 0 at the left end to 1 at the right."""
    if x[0] == x[-1]:
        return 0.5
    ends = np.log([x[0], x[-1], min(max(value, x[0]), x[-1])]) if log else (x[0], x[-1], value)
    return float((ends[2] - ends[0]) / (ends[1] - ends[0]))
