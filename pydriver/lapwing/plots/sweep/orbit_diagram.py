"""Orbit diagram of a sweep: section, impact speeds, impacts per cycle, period."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from lapwing.base.arrivals import arrivals_in, listed_impacts, per_cycle
from lapwing.base.codes import Status
from lapwing.plots import critical_marks, style
from lapwing.plots.style import save
from lapwing.plots.sweep import parts as sweep_parts
from lapwing.results.findings import known

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from lapwing.plots.sweep.parts import Claim

# Periods above this share a row of the strip.
HIGHEST_PERIOD = 8
# Where the row of impacts on the coast flank stands, in parts of the panel.
COAST_ROW = 0.93


def shows(sweep: xr.Dataset) -> bool:
    """Whether some point has a result."""
    return bool(known(sweep).any())


@style.house_style()
def draw(sweep: xr.Dataset, gear_pair: dict[str, float] | None = None, *, title: str | None = None,
         full_engagement: float | None = None, claims: list[Claim] | None = None,
         marks: Any = ()) -> Figure:
    """Draw a sweep.

    Parameters
    ----------
    sweep : xarray.Dataset, result of `lapwing.sweep` with 'cycles' observed, as it is or as group
        `sweep_<name>` of a result file; the impact speeds need 'impacts' observed as well
    gear_pair : mapping or None, group `gear_pair`; gives speeds in rad/s and mm/s
    title : str
    full_engagement : float or None, parameter value above which the engaged response never
        separates; default: as stored with the sweep
    claims : sequence of (parameter value, depth in rad, text, impacts per cycle), the last one or
        two may be missing; default: as stored with the sweep
    marks : sequence of critical_marks.Mark, critical values to draw as bars

    Returns
    -------
    matplotlib.figure.Figure
    """
    sweep = sweep_parts.placed(sweep)
    panels: dict[Any, float] = {_section: 3.0, _impact_speeds: 2.4, _impacts: 1.6, _periods: 1.7}
    if "impact_velocity" not in sweep or not arrivals_in(sweep.attrs).threshold:
        panels[_depths] = panels.pop(_impact_speeds)
        panels = {panel: panels[panel] for panel in (_section, _depths, _impacts, _periods)}
    claims = sweep_parts.claims_of(sweep, claims)
    figure = style.new_figure(10, 10.5, rows=True)
    axes = figure.subplots(4, 1, sharex=True, height_ratios=list(panels.values()))
    for axis, panel, letter in zip(axes, panels, "abcd", strict=True):
        axis.set_title(f"({letter}) {panel(axis, sweep, gear_pair, claims)}")
    critical_marks.mark_sweep(axes, sweep, full_engagement, marks)
    sweep_parts.finish(figure, axes, sweep, "orbit diagram", title)
    shown = [one for one in claims if np.isfinite(one.impacts) or (np.isfinite(one.depth)
             and _depths in panels)]
    sweep_parts.legend(figure, sweep, claims=bool(shown), more=_coast_entries(sweep),
                       failed=bool(sweep_parts.failed(sweep).any()))
    return figure


# The name used by scripts.
orbit_diagram = draw


def _section(axis: Axes, sweep: xr.Dataset, gear_pair: dict[str, float] | None, claims: Any) -> str:
    """Strobed displacement, µrad.  Every panel returns its heading."""
    small = style.widen_small_values(axis, style.URAD * sweep["phi"].values)
    for branch, look in sweep_parts.branches(sweep):
        x = branch[sweep_parts.parameter_of(sweep)].values
        y = np.where(sweep_parts.differs(sweep, branch)[:, None],
                     style.URAD * branch["phi"].values, np.nan)
        sweep_parts.dots(axis, np.broadcast_to(x[:, None], y.shape), y, look,
                         sweep_parts.in_columns(sweep))
    axis.axhline(0, color="0.5", linewidth=0.8)
    axis.set_ylim(axis.get_ylim())
    axis.set_ylabel(f"φ at phase {float(sweep.attrs.get('phase', 0)):g} (µrad)\n"
                    "← separated   engaged →")
    style.arcsec_scale(axis)
    return ("stroboscopic section: relative displacement once per mesh cycle"
            + (f" (logarithmic, linear within ±{style.linear_to(axis):g} µrad)"
               if small else ""))


def _impact_speeds(axis: Axes, sweep: xr.Dataset, gear_pair: dict[str, float] | None,
                   claims: list[Claim]) -> str:
    """Approach speed of the recorded impacts."""
    factor, unit, millimetres = style.speed_unit(gear_pair)
    velocity = sweep["impact_velocity"].values
    for branch, look in sweep_parts.branches(sweep):
        x = branch[sweep_parts.parameter_of(sweep)].values
        place, point = listed_impacts(branch)
        shown = sweep_parts.differs(sweep, branch)[point]
        sweep_parts.dots(axis, x[point[shown]], factor * np.abs(velocity[place[shown]]), look,
                         sweep_parts.in_columns(sweep))
    axis.set_ylabel(f"approach speed |φ'|\n({unit})")
    if velocity.size:
        axis.set_ylim(bottom=0)
        style.speed_scale(axis, millimetres)
    else:
        style.nothing(axis, "no impact at any point that has a result")
    room = int(sweep.attrs["max_impacts"])
    capped = bool((sweep["n_impacts"] > room).any())
    return ("speed of impacts at either flank, relative to it"
            + (f"; of each point the first {room} recorded" if capped else ""))


def _depths(axis: Axes, sweep: xr.Dataset, gear_pair: dict[str, float], claims: list[Any]) -> str:
    """Deepest separation, µrad, where no impact speeds were recorded."""
    from lapwing.plots.sweep.deepest_separation import depth_lines

    depth_lines(axis, sweep)
    for claim in claims:
        if np.isfinite(claim.depth):
            sweep_parts.claim_marker(axis, claim.value, style.URAD * claim.depth)
    axis.set_ylabel("deepest separation\n(µrad)")
    style.arcsec_scale(axis)
    return "deepest separation of the drive flanks in the recorded cycles"


def _impacts(axis: Axes, sweep: xr.Dataset, gear_pair: dict[str, float] | None,
             claims: list[Claim]) -> str:
    """Arrivals per cycle at the drive flank, and at the coast flank where there are any."""
    law = arrivals_in(sweep.attrs)
    struck = np.zeros(sweep.sizes[sweep_parts.parameter_of(sweep)], bool)
    for branch, look in sweep_parts.branches(sweep):
        x = branch[sweep_parts.parameter_of(sweep)].values
        count = sweep_parts.beside(per_cycle(branch), sweep_parts.differs(sweep, branch))
        if sweep_parts.in_columns(sweep):
            sweep_parts.columns(axis, x, count, look)
        else:
            axis.plot(x, count, color=look["color"], linewidth=look["width"])
        struck |= per_cycle(branch, "coast") > 0
    # A row of its own: so few they are, a curve would lie on the axis.
    axis.plot(x[struck], np.full(struck.sum(), COAST_ROW), linestyle="", marker="v",
              markersize=4.5, markeredgewidth=0, color=style.BLUE, zorder=3,
              transform=axis.get_xaxis_transform())
    for claim in claims:
        if np.isfinite(claim.impacts):
            sweep_parts.claim_marker(axis, claim.value, claim.impacts)
    axis.set_ylabel(f"{law.word}s\nper cycle")
    axis.set_ylim(0, 1.15 * max(axis.get_ylim()[1], 1))
    style.upward_ticks(axis, integer=True)
    return (f"{law.word}s per cycle on the drive flank, "
            f"{law.rule(float(sweep.attrs['count_depth']))}")


def _coast_entries(sweep: xr.Dataset) -> list[Any]:
    """The legend's entry of impacts on the coast flank, where there are any."""
    from matplotlib.lines import Line2D

    struck = any((per_cycle(branch, "coast") > 0).any()
                 for branch, _ in sweep_parts.branches(sweep))
    word = arrivals_in(sweep.attrs).word
    return [Line2D([], [], linestyle="", marker="v", markersize=5, markeredgewidth=0,
                   color=style.BLUE, label=f"(c) {word}s on the coast flank, from some start")
            ] * struck


def _periods(axis: Axes, sweep: xr.Dataset, gear_pair: dict[str, float] | None,
             claims: list[Claim]) -> str:
    """Period in mesh cycles; motions without one, and failed runs, in rows of their own."""
    none, lost = HIGHEST_PERIOD + 2, HIGHEST_PERIOD + 4
    rows = [*range(1, HIGHEST_PERIOD + 1), none]
    labels = [*map(str, range(1, HIGHEST_PERIOD)), f"≥{HIGHEST_PERIOD}", "none"]
    if sweep_parts.failed(sweep).any():
        rows, labels = [*rows, lost], [*labels, "failed"]
    for branch, look in sweep_parts.branches(sweep):
        x = branch[sweep_parts.parameter_of(sweep)].values
        period, fails = branch["period"].values, sweep_parts.failed(branch)
        done = (branch["status"].values == Status.OK) & sweep_parts.differs(sweep, branch)
        shown = np.where(period == 0, none, np.minimum(period, HIGHEST_PERIOD))
        axis.plot(x[done], shown[done], linestyle="", marker="s", color=look["color"],
                  markersize=3.2, markeredgewidth=0)
        axis.plot(x[fails], np.full(np.sum(fails), lost), linestyle="", marker="x", markersize=4,
                  color=look["color"])
    axis.set_yticks(rows, labels)
    axis.set_ylim(0, rows[-1] + 1)
    axis.set_ylabel("period\n(mesh cycles)")
    return "period of the motion"


__all__ = ["draw", "orbit_diagram", "save"]
