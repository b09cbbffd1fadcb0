"""A critical torque against the highest order of the curve fitted to measured samples."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from lapwing.plots import style
from lapwing.results.findings import SYMBOLS

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.figure import Figure

# Values beyond so many times those of the fit used would hide it.
HEADROOM = 4.0


def shows(critical: xr.Dataset) -> bool:
    """Whether the orders of a fit to measured samples were tried."""
    return "fit_order" in critical.dims


@style.house_style()
def draw(critical: xr.Dataset, *, title: str | None = None) -> Figure:
    """Draw T_full, and how well samples and curve go together, against the highest order.

    Parameters
    ----------
    critical : xarray.Dataset, group `critical_<name>` of a result file, with `fit_order`
    title : str or None

    Returns
    -------
    matplotlib.figure.Figure
    """
    from matplotlib.ticker import MaxNLocator

    attrs = critical.attrs
    order = critical["fit_order"].values
    value, low, high = (critical[f"fit_{name}"].values for name in ("estimate", "low", "high"))
    figure = style.new_figure(8.5, 6.2, rows=True)
    axes = figure.subplots(2, 1, sharex=True, height_ratios=(1.6, 1))
    symbol = SYMBOLS[str(attrs["find"])]
    axes[0].errorbar(order, value, yerr=np.abs([value - low, high - value]), color=style.BLUE,
                     linestyle="", marker="o", markersize=6, capsize=4, elinewidth=1.4, zorder=3,
                     label="fit of all orders up to it, 95 % interval")
    axes[0].axhspan(attrs["low"], attrs["high"], color=style.ORANGE, alpha=0.3, linewidth=0,
                    label="of the curve used, 95 % interval")
    axes[0].axhline(attrs["estimate"], color=style.VERMILION, linewidth=1.2,
                    label=f"of the curve used: {symbol} = {attrs['estimate']:.3g} N·m")
    top = min(float(np.max(high)), HEADROOM * max(float(attrs["high"]), 1e-300))
    axes[0].set_ylim(-0.04 * top, 1.04 * top)
    beyond = high > 1.04 * top
    if beyond.any():
        axes[0].plot(order[beyond], np.full(beyond.sum(), 0.97), linestyle="", marker="^",
                     color=style.BLUE, markersize=6, clip_on=False,
                     transform=axes[0].get_xaxis_transform(), label="interval goes on")
    axes[0].set_ylabel(f"{symbol} (N·m)")
    axes[0].set_title("(a) critical torque; noise alone makes it climb with the order")
    root = np.sqrt(critical["fit_gcv"].values)
    best = int(np.argmin(root))
    axes[1].plot(order, style.URAD * critical["fit_noise"].values, color=style.BLACK, marker="s",
                 markersize=4.5, linewidth=1, label="noise of a sample by the residuals")
    axes[1].plot(order, style.URAD * root, color=style.GREEN, marker="D", markersize=4.5,
                 linewidth=1, label="generalised cross-validation, square root")
    axes[1].plot(order[best], style.URAD * root[best], marker="o", markersize=13, linestyle="",
                 markerfacecolor="none", markeredgewidth=1.6, color=style.VERMILION,
                 label=f"least: order {int(order[best])}")
    if root.max() > 10 * root.min():
        axes[1].set_yscale("log")
        style.plain_powers(axes[1].yaxis)
    axes[1].set_ylabel("(µrad)")
    axes[1].set_title("(b) samples against curve; enough orders: the noise falls no more")
    axes[1].set_xlabel("highest order of the mesh in the curve")
    axes[1].xaxis.set_major_locator(MaxNLocator(integer=True))
    named = [pair for axis in axes
             for pair in zip(*axis.get_legend_handles_labels(), strict=True)]
    figure.legend(*zip(*named, strict=True), loc="outside lower center", ncols=2)
    name = attrs.get("name", symbol)
    figure.suptitle(f"{name} against the highest order of the fitted curve"
                    if title is None else title)
    return figure
