"""What a sweep says in words: a table over its range, the last rattling values, hysteresis."""

from __future__ import annotations

import numpy as np

from lapwing.codes import Status
from lapwing.summary_stability import sweep_stability

# Branches carried up and down differ in depth when they do so by more than this part of it.
DEPTH_DIFFERS = 0.02
UNITS = {"brake_torque": "N·m", "drive_torque": "N·m", "pinion_speed_rpm": "rpm",
         "pinion_speed_rad_s": "rad/s", "mesh_frequency_hz": "Hz", "mesh_stiffness": "N/m",
         "backlash": "rad", "pinion_base_lever": "m", "mesh_damping": "N·s/m",
         "pinion_inertia": "kg·m²", "gear_inertia": "kg·m²"}
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
             f"{sweep.attrs['record']} recorded, tolerance {sweep.attrs['rtol']:g}; "
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
    lines.append("- hysteresis: " + _hysteresis(sweep, depth, values, unit))
    lines += sweep_stability(sweep, unit)
    lines.append("- impacts are counted after flights deeper than "
                 f"{100 * sweep.attrs['count_depth']:g} % of their cycle's deepest separation")
    return [*lines, "", *_sweep_table(sweep, depth, values, unit)]


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


def _hysteresis(sweep, depth, values, unit):
    """Intervals in which the branches carried up and down end in different motions."""
    if not {"up", "down"} <= set(sweep["start"].values.tolist()):
        return "not looked for (needs the starts up and down)"
    one, two = (sweep.sel(start=start) for start in ("up", "down"))
    greatest = np.fmax(depth.sel(start="up").values, depth.sel(start="down").values)
    apart = np.abs(depth.sel(start="up").values - depth.sel(start="down").values)
    settled = (one["period"] > 0).values & (two["period"] > 0).values
    differ = settled & (apart > DEPTH_DIFFERS * greatest)
    differ |= (one["period"] != two["period"]).values
    # An impact count beside a complete chatter hangs on its threshold: no class boundary.
    chatter = (one["chatter_ends"].sum("recorded_cycle")
               + two["chatter_ends"].sum("recorded_cycle")).values > 0
    for key in ("counted_impacts", "counted_back_impacts"):
        means = [branch[key].mean("recorded_cycle").values for branch in (one, two)]
        differ |= settled & ~chatter & (means[0] != means[1])
    differ &= (one["status"] == Status.OK).values & (two["status"] == Status.OK).values
    runs = _runs(differ)
    if not runs:
        return "none: up and down agree in period, impacts and depth"
    wide = [f"{values[first]:g}–{values[last]:g}" for first, last in runs if last > first]
    single = [first for first, last in runs if last == first]
    chaos = ((one["period"] == 0) | (two["period"] == 0)).values
    beside = sum(bool(chaos[max(i - 1, 0):i + 2].any()) for i in single)
    parts = [", ".join(wide) + f" {unit}"] if wide else []
    if single:
        parts.append(plural(len(single), "single value")
                     + f" ({beside} in or beside chaotic bands)" * bool(beside))
    return "up and down differ in period, impacts or depth at " + " and ".join(parts)


def _runs(flags):
    """First and last index of each run of flags; a single gap between long runs is bridged."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], flags, [False]]).astype(int)))
    runs = []
    for first, last in (edges.reshape(-1, 2) - (0, 1)).tolist():
        if runs and first - runs[-1][1] == 2 and (last > first and runs[-1][1] > runs[-1][0]):
            runs[-1][1] = last
        else:
            runs.append([first, last])
    return runs


def markdown(rows):
    """Lines of a table; the first row is its heading."""
    lines = ["| " + " | ".join(row) + " |" for row in rows]
    return [lines[0], "|---" * len(rows[0]) + "|", *lines[1:]]


def plural(number, word):
    """Number and word, the word with an s unless the number is one."""
    return f"{number:g} {word}" + "s" * bool(number != 1)
