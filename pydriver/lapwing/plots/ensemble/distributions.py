"""How the answers of an ensemble are distributed."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from lapwing.plots import style
from lapwing.results.findings import Answer, answers

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

COLUMNS, MOST_BINS = 2, 60
# Quantiles that are marked, and how.
MARKED = {0.01: ("1 %", style.BLUE), 0.5: ("median", style.BLACK), 0.99: ("99 %", style.VERMILION)}


def shows(data: xr.Dataset) -> bool:
    """Whether anything is known of some run."""
    return any(np.isfinite(data[one.name].values).any() for one in answers(data))


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
    shown = [one for one in answers(data) if np.isfinite(data[one.name].values).any()]
    rows = -(-len(shown) // COLUMNS)
    figure = style.new_figure(9.0, 0.9 + 2.4 * rows)
    panels = figure.subplots(rows, COLUMNS, squeeze=False).ravel()
    for axis, answer in zip(panels, shown, strict=False):
        _panel(axis, data, answer)
    for axis in panels[len(shown):]:
        axis.set_axis_off()
    figure.suptitle(f"{title}: distributions".removeprefix(": "))
    _legend(figure, data)
    return figure


def _panel(axis: Axes, data: xr.Dataset, answer: Answer) -> None:
    """One answer."""
    values = answer.factor * data[answer.name].values
    values = values[np.isfinite(values)]
    none, some = np.mean(values == 0), values[values != 0]
    unit = f" ({answer.unit})" * bool(answer.unit)
    axis.set_xlabel(answer.words + unit)
    axis.set_ylabel("pairs")
    lost = data["status"].size - values.size
    axis.set_title("; ".join(
        [f"0 in {100 * none:.3g} % of {values.size}, not drawn"] * bool(none and some.size)
        + [f"{lost} without a result"] * bool(lost)), fontsize=8.5, color=style.QUIET)
    if not some.size or np.ptp(some) == 0:
        style.nothing(axis, f"{values[0]:.4g} in all" if not none or not some.size else
                      f"{some[0]:.4g} or 0", x=True)
        return
    axis.hist(some, bins=int(np.clip(np.sqrt(some.size), 8, MOST_BINS)), color="0.8",
              edgecolor="0.65", linewidth=0.4)
    for level, (_, colour) in MARKED.items():
        found, low, high = (answer.factor * float(
            data[f"{answer.name}_quantile{end}"].sel(level=level)) for end in ("", "_low", "_high"))
        if none and found == 0:
            continue
        if np.isfinite(low) and np.isfinite(high) and high > low:
            axis.axvspan(low, high, color=colour, alpha=0.2, linewidth=0)
        axis.axvline(found, color=colour, linewidth=1.3)
    if answer.name == "full_engagement" and "brake_torque" in data.attrs:
        axis.axvline(float(data.attrs["brake_torque"]), color=style.GREEN, linewidth=1.5,
                     linestyle=(0, (5, 2)))
    axis.margins(x=0.02)
    style.upward_ticks(axis, integer=True)


def _legend(figure: Figure, data: xr.Dataset) -> None:
    """What the lines mean, below all panels."""
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    handles: list[Any] = [Line2D([], [], color=colour, linewidth=1.3, label=f"{words}"
                      + " of pairs have at most" * (level != 0.5))
               for level, (words, colour) in MARKED.items()]
    if int(data.attrs["scrambles"]) >= 0:
        handles.append(Patch(color="0.5", alpha=0.3, linewidth=0, label="95 % limits of it"))
    if "full_engagement" in data and "brake_torque" in data.attrs:
        handles.append(Line2D([], [], color=style.GREEN, linewidth=1.5, linestyle=(0, (5, 2)),
                              label="torque of the runs"))
    figure.legend(handles=handles, loc="outside lower center", ncols=len(handles))


__all__ = ["draw"]
