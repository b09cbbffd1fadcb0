"""The transmission error curve: knots, slopes, kinks."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from lapwing.plots import style

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# The curve is drawn this far beyond one mesh period, to show how it goes on.
BEYOND = 0.12
POINTS = 60
FEW_KNOTS = 40
# Places of the curve in all, and lines at kinks: more cannot be told apart.
MOST, MANY_KINKS = 4000, 400


@style.house_style()
def draw(te: xr.Dataset, gear_pair: dict[str, float] | None = None) -> Figure:
    """Draw value and slope against mesh phase.

    Parameters
    ----------
    te : xarray.Dataset, group `transmission_error` of a result file
    gear_pair : mapping or None, group `gear_pair`; tells the teeth, for slopes per degree

    Returns
    -------
    matplotlib.figure.Figure
    """
    figure = style.new_figure(8.5, 6.6, rows=True)
    axes = figure.subplots(2, 1, sharex=True, height_ratios=(1.3, 1))
    knots, kinks = te["knots"].values, te["kinks"].values.astype(bool)
    slope, unit = _slope_unit(gear_pair)
    for axis, order, factor in zip(axes, (0, 1), (style.URAD, slope), strict=True):
        _curve(axis, te, order, factor)
        for phase in _copies(knots[:-1][kinks])[:MANY_KINKS]:
            axis.axvline(phase, color=style.VERMILION, linewidth=1.0, linestyle=(0, (5, 3)))
        axis.axvspan(-BEYOND, 0, color="0.95", linewidth=0, zorder=0)
        axis.axvspan(1, 1 + BEYOND, color="0.95", linewidth=0, zorder=0)
    # Of a fitted curve the knots are of the program's own making: figure `te_fit`.
    if te.attrs.get("curve", "samples") == "samples" and len(kinks) <= FEW_KNOTS:
        _knots(axes, te, slope)
    _slopes_at_kinks(axes[1], te, slope, unit)
    _labels(figure, axes, te, unit)
    return figure


def _slope_unit(gear_pair: dict[str, float] | None) -> tuple[float, str]:
    """Factor from rad per mesh period to the unit of slopes, and the unit.

    Per degree that the pinion turns, where its teeth are known.
    """
    if gear_pair is None or "pinion_teeth" not in gear_pair:
        return style.URAD, "µrad per mesh period"
    return style.URAD * int(gear_pair["pinion_teeth"]) / 360, "µrad per degree of the pinion"


def _labels(figure: Figure, axes: NDArray[Any], te: xr.Dataset, unit: str) -> None:
    count, kinks = te["kinks"].size, int(te["kinks"].sum())
    span = style.URAD * float(te.attrs["peak_to_peak"])
    if te.attrs.get("curve", "samples") != "samples":
        pieces = f", orders to {int(te.attrs['curve_order'])}"
    else:
        pieces = f", {count} pieces" * (count > 1)
    axes[0].set_title(f"(a) transmission error: {span:.4g} µrad peak to peak{pieces}, "
                      f"{kinks or 'no'} {'kink' if kinks == 1 else 'kinks'}")
    axes[1].set_title("(b) its slope" + ("; ○ left and ● right of a kink" if kinks else ""))
    axes[0].set_ylabel("Δφ (µrad)")
    axes[1].set_ylabel(f"slope of Δφ\n({unit})")
    axes[1].set_xlabel("mesh phase (mesh periods); shaded: the next periods")
    axes[1].set_xlim(-BEYOND, 1 + BEYOND)
    style.arcsec_scale(axes[0])
    style.second_scale(axes[1], "right", style.ARCSEC_PER_URAD,
                       f"({unit.replace('µrad', 'arcsec')})")
    handles, labels = axes[0].get_legend_handles_labels()
    if labels:
        figure.legend(handles, labels, loc="outside lower center", ncols=len(labels))
    figure.suptitle(_short(f"transmission error: {te.attrs['source']}"))


def _short(text: str, room: int = 90) -> str:
    return text if len(text) <= room else text[:room - 1] + "…"


def _copies(phases: NDArray[Any]) -> NDArray[Any]:
    """Phases of one period and the same a period away, as far as they are drawn."""
    phases = np.concatenate([np.asarray(phases) + shift for shift in (-1, 0, 1)])
    return phases[(phases >= -BEYOND) & (phases <= 1 + BEYOND)]


def _evaluate(coefficients: NDArray[Any], t: NDArray[Any] | float, order: int,
              factor: float) -> NDArray[Any]:
    """Value or slope, times a factor, of a piece at distances t from its knot."""
    polynomial = np.polynomial.Polynomial(coefficients)
    value: NDArray[Any] = factor * (polynomial.deriv(order) if order else polynomial)(t)
    return value


def _curve(axis: Axes, te: xr.Dataset, order: int, factor: float) -> None:
    """All pieces as one line, broken at kinks."""
    knots, kinks = te["knots"].values, te["kinks"].values.astype(bool)
    # Rows are pieces: all ends of one, and as many places between as the picture can show.
    t = np.diff(knots)[:, None] * np.linspace(0, 1, max(3, min(POINTS, MOST // kinks.size)))
    powers = te["coefficients"].values
    if order:
        powers = powers[:, 1:] * np.arange(1, powers.shape[1])
    y = factor * sum(column[:, None] * t**n for n, column in enumerate(powers.T))
    x = knots[:-1, None] + t
    x, y = (np.hstack([np.where(kinks[:, None], np.nan, column[:, :1]), column])
            for column in (x, y * np.ones_like(x)))
    for shift in (-1, 0, 1):
        axis.plot((x + shift).ravel(), y.ravel(), color=style.BLUE,
                  linewidth=1.8 if shift == 0 else 1.0)
    axis.axhline(0, color=style.WALL, linewidth=0.6)


def _knots(axes: NDArray[Any], te: xr.Dataset, slope: float) -> None:
    """Knots as dots on the curve and, where it is smooth, on its slope."""
    kinks = te["kinks"].values.astype(bool)
    coefficients = te["coefficients"].values
    for axis, order, rows in ((axes[0], 0, ~kinks), (axes[1], 1, ~kinks), (axes[0], 0, kinks)):
        if not np.any(rows):
            continue
        kink = rows is kinks
        phases = te["knots"].values[:-1][rows]
        values = np.array([_evaluate(row, 0.0, order, slope if order else style.URAD)
                           for row in coefficients[rows]])
        repeated = _copies(phases)
        values = values[[np.argmin(np.abs((phase - phases + 0.5) % 1 - 0.5))
                         for phase in repeated]]
        axis.plot(repeated, values, linestyle="", zorder=4, markersize=8 if kink else 5,
                  marker="D" if kink else "o", color=style.VERMILION if kink else style.BLACK,
                  label="kink" if kink else "knot")


def _slopes_at_kinks(axis: Axes, te: xr.Dataset, factor: float, unit: str) -> None:
    """Left slope open, right slope filled, with the jump in figures."""
    kinks = np.flatnonzero(te["kinks"].values)
    knots, coefficients = te["knots"].values, te["coefficients"].values
    for i in kinks:
        left = _evaluate(coefficients[i - 1], np.diff(knots)[i - 1], 1, factor)
        right = _evaluate(coefficients[i], 0.0, 1, factor)
        for phase in _copies(knots[i:i + 1]):
            axis.plot([phase, phase], [left, right], linestyle="", marker="o", markersize=6,
                      markerfacecolor="white", markeredgecolor=style.VERMILION, zorder=4)
            axis.plot(phase, right, marker="o", markersize=6, color=style.VERMILION, zorder=5)
        if len(kinks) <= 4:
            axis.annotate(f"jump {right - left:+.4g} {unit}", (knots[i], 0.5 * (left + right)),
                          xytext=(6, 10), textcoords="offset points", fontsize=8.5,
                          color=style.VERMILION)
