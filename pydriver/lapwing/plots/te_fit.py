"""A measured transmission error: samples over the curve, residuals, and the curvature."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from lapwing.plots import style
from lapwing.plots.te_curve import BEYOND, POINTS

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

SAMPLE: dict[str, Any] = {
    "linestyle": "", "marker": "o", "markersize": 4.5, "markerfacecolor": "none",
    "markeredgewidth": 1.1, "color": style.BLACK}


@style.house_style()
def draw(te: xr.Dataset) -> Figure:
    """Draw a curve fitted to samples.

    Parameters
    ----------
    te : xarray.Dataset, group `transmission_error` of a result file, with samples and a fit

    Returns
    -------
    matplotlib.figure.Figure
    """
    figure = style.new_figure(8.5, 8.2, rows=True)
    axes = figure.subplots(3, 1, sharex=True, height_ratios=(1.3, 0.8, 1.2))
    knots, kinks = te["knots"].values[:-1], te["kinks"].values.astype(bool)
    _curve(axes[0], te)
    _residual(axes[1], te)
    _curvature(axes[2], te)
    for axis in axes:
        for at in _copies(knots[kinks])[0]:
            axis.axvline(at, color=style.VERMILION, linewidth=1.0, linestyle=(0, (5, 3)), zorder=1,
                         label="kink" if axis is axes[0] and 0 <= at < 1 else None)
        axis.axvspan(-BEYOND, 0, color="0.95", linewidth=0, zorder=0)
        axis.axvspan(1, 1 + BEYOND, color="0.95", linewidth=0, zorder=0)
    axes[0].set_xlim(-BEYOND, 1 + BEYOND)
    axes[2].set_xlabel("mesh phase (mesh periods); shaded: the next periods")
    for axis in axes:
        style.arcsec_scale(axis)
    named = [pair for axis in axes
             for pair in zip(*axis.get_legend_handles_labels(), strict=True)]
    figure.legend(*zip(*named, strict=True), loc="outside lower center", ncols=min(5, len(named)))
    figure.suptitle(f"measured transmission error: {te.attrs['source']}"[:95])
    return figure


def _copies(phase: NDArray[Any], *columns: NDArray[Any]) -> list[NDArray[Any]]:
    """One period and its copies as far as they are drawn."""
    where = np.concatenate([np.asarray(phase) + shift for shift in (-1, 0, 1)])
    shown = (where >= -BEYOND) & (where <= 1 + BEYOND)
    order = np.argsort(where[shown], kind="stable")
    return [np.tile(column, 3)[shown][order] if column is not None else where[shown][order]
            for column in (None, *columns)]


def _of_table(te: xr.Dataset, order: int) -> tuple[NDArray[Any], NDArray[Any]]:
    """Phase and derivative (µrad) of the curve, broken at kinks, over what is drawn."""
    knots, kinks = te["knots"].values, te["kinks"].values.astype(bool)
    x: list[Any] = []
    y: list[Any] = []
    points = max(3, POINTS * 8 // kinks.size)
    for i, row in enumerate(te["coefficients"].values):
        if kinks[i]:
            x.append([knots[i]])
            y.append([np.nan])
        t = np.linspace(0, knots[i + 1] - knots[i], points)
        x.append(knots[i] + t)
        y.append(style.URAD * np.polynomial.Polynomial(row).deriv(order)(t) if order else
                 style.URAD * np.polynomial.Polynomial(row)(t))
    return np.concatenate(x), np.concatenate(y)


def _line(axis: Axes, te: xr.Dataset, order: int, **look: Any) -> None:
    x, y = _of_table(te, order)
    for shift in (0, -1, 1):
        axis.plot(x + shift, y, **look)
        look.pop("label", None)


def _curve(axis: Axes, te: xr.Dataset) -> None:
    attrs = te.attrs
    x, value = _copies(te["sample_phase"].values, te["sample_value"].values)
    axis.plot(x, style.URAD * value, label="samples", zorder=4, **SAMPLE)
    _line(axis, te, 0, color=style.BLUE, linewidth=1.8, zorder=3, label="fitted curve")
    how = f"all orders to {int(attrs['curve_order'])}, least squares" \
        if attrs["curve"] == "harmonics" else \
        f"smoothing spline, {attrs['curve_freedom']:.1f} degrees of freedom"
    axis.set_title(f"(a) {int(attrs['samples'])} samples and curve: {how}")
    axis.set_ylabel("Δφ (µrad)")


def _residual(axis: Axes, te: xr.Dataset) -> None:
    attrs = te.attrs
    x, value = _copies(te["sample_phase"].values, te["sample_residual"].values)
    axis.plot(x, style.URAD * value, zorder=4, **SAMPLE)
    noise = style.URAD * float(attrs["noise_level"])
    axis.axhspan(-2 * noise, 2 * noise, color=style.SKY, alpha=0.25, linewidth=0, zorder=0.5,
                 label="± 2 noise levels")
    axis.axhline(0, color=style.WALL, linewidth=0.6)
    whence = "stated" if attrs["noise_stated"] else "estimated"
    axis.set_title(f"(b) residual; noise of a sample {noise:.3g} µrad ({whence})")
    axis.set_ylabel("sample − curve\n(µrad)")


def _curvature(axis: Axes, te: xr.Dataset) -> None:
    x, low, high = _copies(te["curve_phase"].values, te["curve_curvature_low"].values,
                           te["curve_curvature_high"].values)
    axis.fill_between(x, style.URAD * low, style.URAD * high, color=style.ORANGE, alpha=0.35,
                      linewidth=0, zorder=2, label="95 % at each phase, without smoothing")
    _line(axis, te, 2, color=style.BLUE, linewidth=1.8, zorder=3)
    axis.axhline(0, color=style.WALL, linewidth=0.6)
    axis.set_title("(c) curvature, which moves the teeth: orders to "
                   f"{int(te.attrs['curve_wide_order'])} in the band")
    axis.set_ylabel("d²Δφ/dphase²\n(µrad per mesh period²)")
