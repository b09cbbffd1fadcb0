"""What a sweep says in words: a table over its range, the last rattling values, hysteresis."""

from __future__ import annotations

import numpy as np

from lapwing.codes import Status
from lapwing.summary_hysteresis import hysteresis
from lapwing.summary_stability import sweep_stability
from lapwing.summary_words import UNITS, markdown, method_words, plural

# A sweep is told in about so many lines, spread over its range.
TABLE_LINES = 12
START_NAMES = {"rest": "each from rest", "up": "carried upwards", "down": "carried downwards"}


def sweep_text(sweep):
    """Findings of one sweep, as a list."""
    parameter = sweep.attrs["parameter"]
    unit = UNITS.get(parameter, "")
    values = sweep[parameter].values
    unfinished = int((sweep["status"] == Status.UNFINISHED).sum())
    failed = int((sweep["status"] != Status.OK).sum()) - unfinished
    lines = [f"- {parameter.replace('_', ' ')} from {values[0]:g} to {values[-1]:g} {unit}: "
             f"{plural(values.size, 'value')} × {plural(sweep.sizes['start'], 'start')}, "
             f"{plural(sweep.attrs['settle'], 'mesh cycle')} to settle and "
             f"{sweep.attrs['record']} recorded, {method_words(sweep.attrs)}; "
             f"{failed or 'none'} of {sweep['status'].size} failed"
             + f", **{unfinished} not reached**" * bool(unfinished)]
    if "deepest_separation" not in sweep:
        return lines
    depth = sweep["deepest_separation"].max("recorded_cycle")
    back = sweep["back_impacts"].sum("recorded_cycle") + \
        sweep["back_engages"].sum("recorded_cycle") > 0
    ok = sweep["status"] == Status.OK
    lines.append("- last back impact: " + _largest(values, back, ok, unit))
    lines.append("- last separation: " + _largest(values, depth > 0, ok, unit))
    if "full_engagement" in sweep.attrs:
        lines.append("- complete engagement from T_full = "
                     f"{sweep.attrs['full_engagement']:.10g} {unit}: "
                     "above it the engaged motion never separates (contact is first lost at mesh "
                     f"phase {sweep.attrs['full_engagement_phase']:.6f}); other motions may exist "
                     "beside it")
    coexisting = hysteresis(sweep, depth, unit)
    lines.append("- hysteresis: " + coexisting[0])
    lines += sweep_stability(sweep, unit)
    lines.append("- impacts are counted after flights deeper than "
                 f"{100 * sweep.attrs['count_depth']:g} % of their cycle's deepest separation")
    return [*lines, *coexisting[1:], "", *_sweep_table(sweep, depth, values, unit)]


def _sweep_table(sweep, depth, values, unit):
    """Some values of a sweep, spread evenly over it, of the motions from rest if there are any."""
    starts = [str(start) for start in sweep["start"].values]
    start = starts.index("rest") if "rest" in starts else 0
    branch, depth = sweep.isel(start=start), 1e6 * depth.isel(start=start).values
    impacts, back = (branch[key].mean("recorded_cycle").values
                     for key in ("counted_impacts", "counted_back_impacts"))
    name = sweep.attrs["parameter"].replace("_", " ")
    rows = [(name + f" ({unit})" * bool(unit), "impacts per cycle", "back impacts per cycle",
             "period (mesh cycles)", "deepest separation (µrad)")]
    for i in np.unique(np.linspace(0, values.size - 1, TABLE_LINES).round().astype(int)):
        status = Status(int(branch["status"].values[i]))
        if status == Status.OK:
            cells = (f"{impacts[i]:.3g}", f"{back[i]:.3g}",
                     str(int(branch["period"].values[i]) or "none"), f"{depth[i]:.4g}")
        else:
            lost = "not reached" if status == Status.UNFINISHED else "failed"
            cells = (lost, *"–––")
        rows.append((f"{values[i]:g}", *cells))
    return [f"Some of the motions {START_NAMES.get(starts[start], starts[start])}:", "",
            *markdown(rows)]


def _largest(values, seen, ok, unit):
    """Largest value at which something was seen and the next of the grid, for each start."""
    found = {}
    for start in seen["start"].values:
        hits = np.flatnonzero(seen.sel(start=start).values)
        if not hits.size:
            words = "none"
        elif hits[-1] == values.size - 1:
            words = f"{values[-1]:g} {unit} (the end of the range)"
        else:
            after = hits[-1] + 1
            none = "none" if ok.sel(start=start).values[after] else "no result"
            words = f"{values[hits[-1]]:g} {unit}, {none} at {values[after]:g} {unit}"
        found.setdefault(words, []).append(START_NAMES.get(str(start), str(start)))
    return "; ".join(f"{words} ({', '.join(starts)})" for words, starts in found.items())
