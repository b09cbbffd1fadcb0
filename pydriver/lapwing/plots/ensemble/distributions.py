"""How the answers of an ensemble are distributed."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from lapwing.plots import style
from lapwing.plots.ensemble import grid
from lapwing.results.findings import Answer, answers

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

MOST_BINS = 60
# Numbers that differ by less, in parts of them, are one but for rounding.
ROUNDING = 1e-12
# Quantiles that are marked, and how.
MARKED = {0.01: ("1 %", style.BLUE), 0.5: ("median", style.BLACK), 0.99: ("99 %", style.VERMILION)}


def shows(data: xr.Dataset) -> bool:
    """Whether anything is known of some run."""
    return any(np.isfinite(data[one.name].values).any() for one in answers(data))


def leads(data: xr.Dataset) -> float:
    """How much of the deck's question it answers: at the highest torque most pairs keep contact."""
    return float(data.attrs.get("brake_torque", 0.0))


@style.house_style()
def draw(data: xr.Dataset, gear_pair: dict[str, float] | None = None, *,
         title: str = "") -> Figure:
    """Draw a histogram of each answer, with its quantiles and their 95 % limits.

    Parameters
    ----------
    data : xarray.Dataset, group `ensemble_<name>` of a result file
    gear_pair : mapping or None, not used
    title : str, of the figure

    Returns
    -------
    matplotlib.figure.Figure
    """
    known = [one for one in answers(data) if np.isfinite(data[one.name].values).any()]
    shown = [one for one in known if _differ(_other_than_0(data, one))]
    alike = [one for one in known if one not in shown]
    panels = grid.panels(len(shown) + bool(alike), 2.4)
    for axis, answer in zip(panels.axes, shown, strict=False):
        _panel(axis, data, answer)
    if alike:
        _in_words(panels.axes[-1], data, alike)
    panels.figure.suptitle(f"{title}: distributions{_share(data)}".removeprefix(": "))
    if shown:
        _legend(panels.figure, data)
    return panels.figure


def _known(data: xr.Dataset, answer: Answer) -> NDArray[Any]:
    """Values of an answer, of the runs that have one."""
    values = answer.factor * data[answer.name].values
    known: NDArray[Any] = values[np.isfinite(values)]
    return known


def _other_than_0(data: xr.Dataset, answer: Answer) -> NDArray[Any]:
    """Those of them that are not 0, which is told in words; [0] where all are."""
    values = _known(data, answer)
    return values[values != 0] if values.any() else values[:1]


def _differ(values: NDArray[Any]) -> bool:
    """Whether values differ by more than the rounding of one number."""
    return bool(np.ptp(values) > ROUNDING * np.abs(values).max())


def _share(data: xr.Dataset) -> str:
    """How many rattle, in words, for the heading."""
    one = data.sel(event="rattles")
    return f"; {int(one['seen'])} of {int(one['known'])} pairs rattle" if int(one["known"]) else ""


def _lost(data: xr.Dataset, values: NDArray[Any]) -> list[str]:
    lost = data["status"].size - values.size
    return [f"{lost} without a result"] * bool(lost)


def _in_words(axis: Axes, data: xr.Dataset, alike: list[Answer]) -> None:
    """The answers that have no distribution, in the last panel."""
    lines = []
    for answer in alike:
        values, some = _known(data, answer), _other_than_0(data, answer)
        number = f"{some[0]:.4g} {answer.unit}".rstrip()
        count = int(np.isclose(values, some[0], rtol=ROUNDING, atol=0).sum())
        words = f"{number} in all" if count == values.size else \
            f"{number} in {count} of {values.size}, 0 in the others"
        lines.append("; ".join([f"{answer.words}: {words}", *_lost(data, values)]))
    axis.set_axis_off()
    axis.text(0.02, 0.5, "\n\n".join(lines), transform=axis.transAxes, va="center",
              color=style.QUIET)


def _panel(axis: Axes, data: xr.Dataset, answer: Answer) -> None:
    """One answer."""
    values, some = _known(data, answer), _other_than_0(data, answer)
    none = np.mean(values == 0)
    unit = f" ({answer.unit})" * bool(answer.unit)
    axis.set_xlabel(answer.words + unit)
    axis.set_ylabel("pairs")
    axis.set_title("; ".join([f"0 in {100 * none:.3g} % of {values.size}, not drawn"] * bool(none)
                             + _lost(data, values)), fontsize=8.5, color=style.QUIET)
    axis.hist(some, bins=int(np.clip(np.sqrt(some.size), 8, MOST_BINS)), color="0.8",
              edgecolor="0.65", linewidth=0.4)
    for level, (_, colour) in MARKED.items():
        found, low, high = (answer.factor * float(
            data[f"{answer.name}_quantile{end}"].sel(level=level)) for end in ("", "_low", "_high"))
        if none and found == 0:
            continue
        if np.isfinite(low) and np.isfinite(high) and high > low:
            axis.axvspan(low, high, color=colour, alpha=0.2, linewidth=0)
        axis.axvline(found, color=colour, linewidth=1.0)
    if answer.name == "full_engagement" and "brake_torque" in data.attrs:
        axis.axvline(float(data.attrs["brake_torque"]), color=style.GREEN, linewidth=2.6)
    axis.margins(x=0.02)
    style.upward_ticks(axis, integer=True)


def _legend(figure: Figure, data: xr.Dataset) -> None:
    """What the lines mean, below all panels."""
    from matplotlib.legend_handler import HandlerTuple
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    handles: list[Any] = [Line2D([], [], color=colour, linewidth=1.0, label=f"{words}"
                      + " of pairs have at most" * (level != 0.5))
               for level, (words, colour) in MARKED.items()]
    if int(data.attrs["scrambles"]) >= 0:
        handles.append(tuple(Patch(color=colour, alpha=0.2, linewidth=0)
                             for level, (_, colour) in MARKED.items() if level != 0.5))
    if "full_engagement" in data and "brake_torque" in data.attrs:
        handles.append(Line2D([], [], color=style.GREEN, linewidth=2.6,
                              label=f"torque of the runs, {float(data.attrs['brake_torque']):g} "
                              "N·m"))
    labels = ["95 % limits of the lines" if isinstance(one, tuple) else str(one.get_label())
              for one in handles]
    figure.legend(handles, labels, handler_map={tuple: HandlerTuple(None)},
                  loc="outside lower center", ncols=3)


__all__ = ["draw"]
