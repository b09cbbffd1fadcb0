"""Order spectrum of a response: displacement, mesh force, dynamic transmission error."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from lapwing.model.harmonic_series import order_spectrum
from lapwing.plots import style
from lapwing.plots.response.trajectory import IMPACTS, cycles_recorded, events_of, impulses

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# Variable, factor, axis label, heading, colour.
QUANTITIES = (
    ("phi", style.URAD, "φ (µrad)", "relative displacement φ", style.BLUE),
    ("mesh_force", 1.0, "W (N)", "mesh force W", style.VERMILION),
    ("dynamic_te", style.URAD, "θ (µrad)", "dynamic transmission error θ", style.BLACK),
)
DECADES = 6
# Equivalent noise bandwidth of the Hann window, bins.
HANN_BANDWIDTH = 1.5
# Orders shown beyond the highest one, so that its line is whole.
BESIDE = 0.4
# Amplitudes below this quantile of those that mean something may be cut off.
LEAST = 0.02
# More lines than these are no dots.
DOTS = 90
# Parts of a mesh period that impacts are told apart by.
GRID = 8192


@style.house_style()
def draw(response: xr.Dataset, gear_pair: dict[str, float] | None = None) -> Figure:
    """Draw amplitudes against mesh order.

    Parameters
    ----------
    response : xarray.Dataset, group `response_<name>` of a result file
    gear_pair : mapping or None, group `gear_pair`; tells the pinion's lever, for N·m

    Returns
    -------
    matplotlib.figure.Figure
    """
    figure = style.new_figure(9.5, 8, rows=True)
    axes = figure.subplots(3, 1, sharex=True)
    highest = _highest_order(response)
    for axis, quantity, letter in zip(axes, QUANTITIES, "abc", strict=True):
        axis.set_title(f"({letter}) {quantity[3]}"
                       + _panel(axis, response, quantity, highest, gear_pair))
    if not style.failed(response):
        _marks(axes, response, highest)
    for axis, (name, *_) in zip(axes, QUANTITIES, strict=True):
        if axis.get_yscale() == "linear":
            continue
        if name != "mesh_force":
            style.arcsec_scale(axis)
        elif gear_pair is not None:
            style.second_scale(axis, "right", float(gear_pair["pinion_base_lever"]), "(N·m)")
    axes[-1].set_xlim(0, highest + BESIDE)
    axes[-1].set_xlabel("mesh order (multiples of the mesh frequency)\n" + _resolution(response))
    style.second_scale(axes[0], "top", 1 / float(response.attrs["mesh_period_s"]),
                       "frequency (Hz)")
    figure.suptitle(style.describe(response))
    return figure


def _cycles_used(response: xr.Dataset) -> int:
    """The last recorded cycles, whole periods of the motion: its lines then lie on bins."""
    recorded, period = cycles_recorded(response), int(response.attrs["period"])
    return recorded - recorded % period if 0 < period <= recorded else recorded


def _highest_order(response: xr.Dataset) -> int:
    """Orders to show: the natural frequency with half as much again, within 8 and 40."""
    natural = 1 / float(response.attrs["mesh_frequency_ratio"])
    return min(max(8, math.ceil(1.5 * natural)), 40)


def _panel(axis: Axes, response: xr.Dataset, quantity: tuple[Any, ...], highest: int,
           gear_pair: dict[str, float] | None) -> str:
    """One spectrum, as many decades as mean anything; what to add to its heading."""
    name, factor, label, _, colour = quantity
    values = factor * response[name].values
    axis.set_ylabel(f"amplitude of\n{label}")
    if not np.all(np.isfinite(values)):
        style.nothing(axis, style.motion(response.attrs) if style.failed(response) else
                   "none is computed: rigid contact")
        return ""
    cycles = _cycles_used(response)
    used = response["sample_cycle"].values >= cycles_recorded(response) - cycles
    orders, amplitudes = order_spectrum(values[used], cycles)
    shown = orders <= highest + BESIDE
    lines = {"": amplitudes[shown]}
    struck = _of_impacts(response, gear_pair) if name == "mesh_force" else None
    if struck is not None:
        lines["impacts"] = struck[:orders.size][shown]
    top = max(float(line.max()) for line in lines.values())
    if top <= 0:
        style.nothing(axis, "zero or constant in the recorded cycles")
        return ""
    low = max(top * 10.0**-DECADES, 0.3 * min(_least(line, orders[shown], response)
                                              for line in lines.values()))
    axis.set_yscale("log")
    style.plain_powers(axis.yaxis)
    axis.plot(orders[shown], np.maximum(lines.pop(next(iter(lines))), low / 10), color=colour,
              linewidth=0.9, label="spring and damper" if struck is not None else None)
    for line in lines.values():  # as dots where both have lines at the same orders
        some = _lines(orders[shown], response)
        dots = bool(response.attrs["period"]) and some.sum() <= DOTS
        axis.plot(orders[shown][some], line[some], color=style.BLACK, label="impacts",
                  linewidth=0 if dots else 0.9, alpha=0.8, marker="o" if dots else "",
                  markersize=4)
    if not lines:
        axis.fill_between(orders[shown], low / 10, amplitudes[shown], color=colour,
                          linewidth=0, alpha=0.25, rasterized=orders.size > style.MANY)
    axis.set_ylim(low, 4 * top)
    axis.minorticks_off()
    if not lines:
        return ""
    axis.legend(loc="upper right", ncols=2)
    return ": of spring and damper, and of impacts (each an instant: its impulse in every order)"


def _least(line: NDArray[Any], orders: NDArray[Any], response: xr.Dataset) -> float:
    """The lowest amplitude that means something: of lines of the motion, of all without a period.

    A cosine of another order would lie at rounding.
    """
    line = line[_lines(orders, response) & (orders > HANN_BANDWIDTH * orders[1]) & (line > 0)]
    return float(np.quantile(line, LEAST)) if line.size else 1.0


def _lines(orders: NDArray[Any], response: xr.Dataset) -> NDArray[np.bool_]:
    """Orders at which the motion has lines; all of a motion without a period."""
    period = int(response.attrs["period"])
    found: NDArray[np.bool_] = np.abs(orders * period - np.round(orders * period)) < 1e-9
    return found


def _of_impacts(response: xr.Dataset,
                gear_pair: dict[str, float] | None) -> NDArray[Any] | None:
    """Amplitudes (N) of the impulses of impacts, at the orders of the samples and beyond, or None.

    Each impulse is spread over one of `GRID` parts of a mesh period, which moves it by less than
    1/200 of a period of the highest order shown.
    """
    cycles = _cycles_used(response)
    first = cycles_recorded(response) - cycles
    impacts = events_of(response, IMPACTS, first)
    if gear_pair is None or not impacts["position"].size:
        return None
    place = np.round((impacts["position"] - first) * GRID).astype(int) % (cycles * GRID)
    force = np.bincount(place, impulses(impacts, gear_pair), cycles * GRID) \
        * (GRID / float(response.attrs["mesh_period_s"]))
    return order_spectrum(force, cycles)[1]


def _marks(axes: NDArray[Any], response: xr.Dataset, highest: int) -> None:
    """Mesh orders, subharmonics of the period, natural frequency."""
    period = int(response.attrs["period"])
    natural = 1 / float(response.attrs["mesh_frequency_ratio"])
    orders = np.arange(1, highest + 1)
    for axis in axes:
        axis.grid(False, axis="x")
        panel = {"transform": axis.get_xaxis_transform(), "color": "0.85", "zorder": 0}
        axis.vlines(orders, 0, 1, linewidth=0.8, **panel)
        if 1 < period <= 8:
            axis.vlines(np.arange(1, period * highest) / period, 0, 1, linewidth=0.7,
                        linestyle=":", **panel)
        if natural <= highest:
            axis.axvline(natural, color=style.GREEN, linewidth=1.1, linestyle=(0, (5, 3)),
                         zorder=1)
    if natural > highest:
        axes[0].text(0.99, 0.94, f"natural frequency: order {natural:.3g}, beyond →",
                     transform=axes[0].transAxes, ha="right", va="top", fontsize=8.5,
                     color="#006B4F")
    else:
        axes[0].annotate(
            f"natural frequency: order {natural:.3g}", (natural, 0.95),
            xycoords=("data", "axes fraction"), va="top", fontsize=8.5, color="#006B4F",
            xytext=(5 if natural < 0.7 * highest else -5, 0), textcoords="offset points",
            ha="left" if natural < 0.7 * highest else "right",
            bbox={"facecolor": "white", "edgecolor": "none", "alpha": 0.8, "pad": 1})
    axes[0].set_xticks(orders if highest <= 24 else orders[1::2])


def _resolution(response: xr.Dataset) -> str:
    """The window and what it can tell apart, and which lines mark what."""
    cycles = _cycles_used(response)
    period = int(response.attrs["period"])
    words = (f"Hann window over {cycles} cycles: bins 1/{cycles} order apart, "
             f"resolution {HANN_BANDWIDTH / cycles:.3g} order")
    if 1 < period <= 8:
        words += f"; dotted: subharmonics 1/{period}"
    return words
