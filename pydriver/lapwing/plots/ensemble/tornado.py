"""Which parameter matters most: a tornado, the longest bar on top, for each answer."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from lapwing.base.quantities import parameter
from lapwing.plots import style
from lapwing.plots.ensemble import grid
from lapwing.results.findings import influenced, parameters_of

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


def shows(data: xr.Dataset) -> bool:
    """Whether it is known how some answer goes with two parameters or more."""
    return len(parameters_of(data)) > 1 and bool(_shown(data))


def _shown(data: xr.Dataset) -> dict[str, str]:
    """Answers that vary with something, name -> words."""
    return {name: words for name, words in influenced(data).items()
            if name in data["answer"].values
            and np.isfinite(data["rank_correlation"].sel(answer=name).values).any()}


@style.house_style()
def draw(data: xr.Dataset, gear_pair: dict[str, float] | None = None, *,
         title: str = "") -> Figure:
    """Draw main and total sensitivities with their limits, else rank correlations.

    Parameters
    ----------
    data : xarray.Dataset, group `ensemble_<name>` of a result file
    gear_pair : mapping or None, not used
    title : str, of the figure

    Returns
    -------
    matplotlib.figure.Figure
    """
    shown, names = _shown(data), parameters_of(data)
    figure, axes = grid.panels(len(shown), 0.9 + 0.34 * len(names))
    drawn = set()
    for axis, (answer, words) in zip(axes, shown.items(), strict=True):
        axis.set_title(words)
        drawn.add(_panel(axis, data.sel(answer=answer), names))
    figure.suptitle(f"{title}: what matters".removeprefix(": "))
    if True in drawn:
        figure.legend(handles=_handles(), loc="outside lower center", ncols=3)
    return figure


def _panel(axis: Axes, data: xr.Dataset, names: list[str]) -> bool:
    """One answer; returns whether it has sensitivities."""
    words = [parameter(name).words for name in names]
    at = np.arange(len(names))
    has = "main_effect" in data and bool(np.isfinite(data["main_effect"].values).all())
    if has:
        order = np.argsort(data["total_effect"].values, kind="stable")
        for what, height, colour in (("total", 0.7, style.SKY), ("main", 0.34, style.BLUE)):
            value, low, high = (100 * data[f"{what}_effect{end}"].values[order]
                                for end in ("", "_low", "_high"))
            offset = 0.18 if what == "total" else 0.0
            axis.barh(at, value, height=height, color=colour)
            _limits(axis, at + offset, value, low, high)
        axis.set_xlabel("part of the variance (%)")
        axis.set_xlim(left=min(0.0, axis.get_xlim()[0]))
    else:
        rank, low, high = (data[f"rank_correlation{end}"].values
                           if f"rank_correlation{end}" in data else np.full(len(names), np.nan)
                           for end in ("", "_low", "_high"))
        order = np.argsort(np.abs(np.nan_to_num(rank)), kind="stable")
        rank, low, high = (np.nan_to_num(rank[order]), low[order], high[order])
        axis.barh(at, rank, height=0.6,
                  color=np.where(rank < 0, style.VERMILION, style.BLUE).tolist())
        sure = np.isfinite(low + high)
        _limits(axis, at[sure], *(one[sure] for one in (rank, low, high)))
        axis.set_xlim(-1, 1)
        axis.set_xticks([-1, -0.5, 0, 0.5, 1])
        axis.axvline(0.0, color=style.WALL, linewidth=0.8)
        axis.set_xlabel("rank correlation")
    axis.set_yticks(at, [words[i] for i in order])
    axis.grid(False, axis="y")
    return has


def _limits(axis: Axes, at: NDArray[Any], value: NDArray[Any], low: NDArray[Any],
            high: NDArray[Any]) -> None:
    """95 % limits of bars."""
    axis.errorbar(value, at, xerr=[value - low, high - value], fmt="none", ecolor=style.BLACK,
                  elinewidth=1.0, capsize=2.0)


def _handles() -> list[Any]:
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    return [Patch(color=style.BLUE, label="alone"),
            Patch(color=style.SKY, label="with the other parameters"),
            Line2D([], [], color=style.BLACK, marker="|", linewidth=1.0, label="95 % limits")]


__all__ = ["draw"]
