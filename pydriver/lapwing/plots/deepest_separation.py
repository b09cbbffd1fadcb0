"""Deepest separation of a sweep against its parameter, beside what a source reports."""

from __future__ import annotations

import numpy as np

from lapwing.plots import style, sweep_parts


@style.house_style()
def draw(sweep, gear_pair=None, *, title=None, full_engagement=None, claims=None):
    """Draw the deepest separation of the recorded cycles.

    Parameters
    ----------
    sweep, title, full_engagement, claims : as for `orbit_diagram.draw`
    gear_pair : mapping or None, group `gear_pair`; tells the backlash

    Returns
    -------
    matplotlib.figure.Figure
    """
    claims = [one for one in sweep_parts.claims_of(sweep, claims) if np.isfinite(one.depth)]
    figure = style.new_figure(9, 5.2)
    axis = figure.subplots()
    depth_lines(axis, sweep)
    found = float(sweep["deepest_separation"].max())
    deepest = style.URAD * np.nanmax([0.0, found, *(claim.depth for claim in claims)])
    small = style.widen_small_values(
        axis, style.URAD * sweep["deepest_separation"].max("recorded_cycle").values)
    top = (2.0 if small else 1.08) * deepest if deepest > 0 else 1.0
    axis.set_ylim(0, top)
    axis.set_ylabel("deepest separation, max of −φ (µrad)"
                    + small * "\nlogarithmic but near 0")
    style.arcsec_scale(axis)
    _backlash(axis, gear_pair, top)
    parameter = sweep_parts.parameter_of(sweep)
    for place, claim in enumerate(sorted(claims)):
        sweep_parts.claim_marker(axis, claim.value, style.URAD * claim.depth)
        _claim_text(axis, claim, max(0.3, 0.66 - 0.11 * place), sweep[parameter].values)
    sweep_parts.mark_full_engagement(
        [axis], sweep_parts.full_engagement_of(sweep, full_engagement), axis,
        sweep[parameter].values, height=0.86)
    sweep_parts.finish(figure, [axis], sweep,
                       f"deepest separation: {sweep.attrs.get('name', '')}"
                       if title is None else title)
    sweep_parts.legend(figure, axis, sweep, claims=bool(claims))
    return figure


def depth_lines(axis, sweep):
    """Deepest of all recorded cycles, µrad; a failed point leaves a gap."""
    for branch, look in sweep_parts.branches(sweep):
        depth = style.URAD * branch["deepest_separation"].max("recorded_cycle")
        depth = depth.where(branch["status"] == 0)
        axis.plot(branch[sweep_parts.parameter_of(sweep)], depth, color=look["color"],
                  linewidth=1.0 + 0.5 * look["size"])
    axis.set_ylim(bottom=0)


def _backlash(axis, gear_pair, top):
    """The whole gap, where the motion uses enough of it."""
    if gear_pair is None or style.URAD * float(gear_pair["backlash"]) > top:
        return
    backlash = style.URAD * float(gear_pair["backlash"])
    axis.axhline(backlash, color=style.WALL, linewidth=0.9, linestyle=":")
    axis.text(0.35, backlash, f"backlash {backlash:g} µrad", color=style.WALL, fontsize=8.5,
              transform=axis.get_yaxis_transform(), ha="center", va="bottom")


def _claim_text(axis, claim, height, values):
    """What is claimed, to the right of and above its marker, where the depths have fallen."""
    span = values[-1] - values[0]
    place = min(claim.value + 0.07 * span, values[-1] - 0.12 * span)
    depth = style.URAD * claim.depth
    words = f"source: {depth:.3g} µrad" if depth else "source: none"
    axis.annotate(words, (claim.value, depth), xytext=(place, height),
                  textcoords=axis.get_xaxis_transform(),
                  fontsize=8.5, color=style.CLAIM_TEXT, zorder=6,
                  bbox={"facecolor": "white", "edgecolor": "none", "alpha": 0.8, "pad": 1},
                  arrowprops={"arrowstyle": "-", "color": style.CLAIM_TEXT, "linewidth": 0.7})
