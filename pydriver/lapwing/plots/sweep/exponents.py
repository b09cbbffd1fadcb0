"""Largest Lyapunov exponent under the orbit diagram of a sweep, on a shared axis."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from lapwing.base.codes import Status
from lapwing.plots import critical_marks, style
from lapwing.plots.sweep import parts as sweep_parts
from lapwing.results.findings import known

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


def shows(sweep: xr.Dataset) -> bool:
    """Whether some point has a result, and the sweep what is drawn."""
    return bool(known(sweep).any() and "lyapunov_exponent" in sweep)


@style.house_style()
def draw(sweep: xr.Dataset, *, title: str | None = None, full_engagement: float | None = None,
         marks: Any = ()) -> Figure:
    """Draw a sweep with its exponents.

    Parameters
    ----------
    sweep : xarray.Dataset, result of `lapwing.sweep` with 'cycles' and 'exponents' observed, as it
        is or as group `sweep_<name>` of a result file
    title : str
    full_engagement : float or None, parameter value above which the engaged response never
        separates; default: as stored with the sweep
    marks : sequence of critical_marks.Mark, critical values to draw as bars

    Returns
    -------
    matplotlib.figure.Figure
    """
    sweep = sweep_parts.placed(sweep)
    figure = style.new_figure(10, 9, rows=True)
    axes = figure.subplots(3, 1, sharex=True, height_ratios=[2.4, 2.2, 1.6])
    for axis, panel, letter in zip(axes, (_section, _exponents, _multipliers), "abc", strict=True):
        axis.set_title(f"({letter}) {panel(axis, sweep)}")
    critical_marks.mark_sweep(axes, sweep, full_engagement, marks)
    sweep_parts.finish(figure, axes, sweep, "exponents", title)
    sweep_parts.legend(figure, sweep, failed=bool(sweep_parts.failed(sweep).any()))
    return figure


def _section(axis: Axes, sweep: xr.Dataset) -> str:
    """Strobed displacement, µrad.  Every panel returns its heading."""
    from lapwing.plots.sweep.orbit_diagram import _section as section

    return section(axis, sweep, None, ())


def _exponents(axis: Axes, sweep: xr.Dataset) -> str:
    """Largest exponent per mesh cycle with its error; what is lost, in a row at the bottom."""
    known = _finite(sweep["lyapunov_exponent_per_cycle"].values)
    axis.set_ylabel("largest Lyapunov exponent\n(per mesh cycle)")
    if not known.size and not np.isneginf(sweep["lyapunov_exponent"].values).any():
        style.nothing(axis, "no exponent is known")
        return "largest Lyapunov exponent"
    low = min(float(known.min(initial=0.0)), -1e-3)
    high = max(float(known.max(initial=0.0)), 0.05 * -low)
    floor = low - 0.12 * (high - low)
    lost = 0
    for branch, look in sweep_parts.branches(sweep):
        x = branch[sweep_parts.parameter_of(sweep)].values
        rate = branch["lyapunov_exponent_per_cycle"].values
        error, per_tau = (branch[name].values for name in ("lyapunov_exponent_error",
                                                           "lyapunov_exponent"))
        shown = np.isfinite(error) & np.isfinite(rate) & (per_tau != 0) \
            & (branch["period"].values == 0)
        error = error * np.divide(rate, per_tau, out=np.zeros_like(rate), where=shown)
        error[~shown] = 0
        other = sweep_parts.differs(sweep, branch)
        axis.errorbar(x[other], np.where(np.isfinite(rate), rate, np.nan)[other], error[other],
                      linestyle="", marker="o", markersize=3, markeredgewidth=0,
                      elinewidth=0.8, color=look["color"], alpha=look["alpha"])
        gone = np.isneginf(rate) & other
        lost += int(gone.sum())
        axis.plot(x[gone], np.full(gone.sum(), floor), linestyle="", marker="v", markersize=4,
                  color=look["color"])
    axis.axhspan(0, high + 0.08 * (high - low), color=style.ORANGE, alpha=0.10, linewidth=0)
    axis.axhline(0, color="0.3", linewidth=0.9)
    axis.set_ylim((floor if lost else low) - 0.06 * (high - low), high + 0.08 * (high - low))
    return ("largest Lyapunov exponent; bars: 95 % intervals, chaos where all of one is shaded"
            + "; ▾: -∞, at rest on the rigid flank" * bool(lost))


def _multipliers(axis: Axes, sweep: xr.Dataset) -> str:
    """Magnitude of the larger Floquet multiplier of the periodic motions, and its sign."""
    axis.set_ylabel("larger Floquet\nmultiplier |λ|")
    if not np.isfinite(sweep["multiplier_real"].values).any():
        style.nothing(axis, "no multiplier is known")
        return "periodic motions"
    for branch, look in sweep_parts.branches(sweep):
        x = branch[sweep_parts.parameter_of(sweep)].values
        real, imag = (branch[f"multiplier_{part}"].values[:, 0] for part in ("real", "imag"))
        shown = (branch["status"].values == Status.OK) & np.isfinite(real) \
            & sweep_parts.differs(sweep, branch)
        for kind, marker in ((imag != 0, "s"), ((imag == 0) & (real < 0), "v"),
                             ((imag == 0) & (real >= 0), "^")):
            rows = shown & kind
            axis.plot(x[rows], np.hypot(real, imag)[rows], linestyle="", marker=marker,
                      markersize=3.4, markeredgewidth=0, color=look["color"],
                      alpha=look["alpha"])
    axis.axhline(1, color="0.3", linewidth=0.9)
    axis.set_ylim(0, 1.12)
    return "periodic motions: ▾ λ < 0 (at 1: period doubling), ▴ λ > 0, ■ a complex pair"


def _finite(values: NDArray[Any]) -> NDArray[Any]:
    found: NDArray[Any] = values[np.isfinite(values)]
    return found


__all__ = ["draw"]
