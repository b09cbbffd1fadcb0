"""What a run found, in words and tables (Markdown), from the result file alone."""

from __future__ import annotations

import math

import numpy as np

from lapwing.codes import MotionState, Status

# A change between the halves of the record below this part of the number, or of its error, is
# rounding or chance and is not reported as a transient.
SETTLED = 1e-6
# Branches carried up and down differ in depth when they do so by more than this part of it.
DEPTH_DIFFERS = 0.02
UNITS = {"brake_torque": "N·m", "drive_torque": "N·m", "pinion_speed_rpm": "rpm",
         "pinion_speed_rad_s": "rad/s", "mesh_frequency_hz": "Hz", "mesh_stiffness": "N/m",
         "backlash": "rad", "pinion_base_lever": "m", "mesh_damping": "N·s/m",
         "pinion_inertia": "kg·m²", "gear_inertia": "kg·m²"}
START_NAMES = {"rest": "each from rest", "up": "carried upwards", "down": "carried downwards"}


def summary_text(results):
    """The summary of a result file.

    Parameters
    ----------
    results : Results, from `lapwing.results.read_results`

    Returns
    -------
    str
        Markdown: gear and operation, a table and a paragraph for each response, the findings of
        each sweep, provenance.
    """
    responses = [results.response(name).attrs for name in results.responses]
    lines = [f"# {results.attrs['deck_name']}", "", *_gear(results, responses)]
    if responses:
        lines += ["", "## Responses", "", *_table(responses), "", *_legend(responses)]
        for attrs in responses:
            lines += ["", f"### {attrs['name']}", "", _paragraph(attrs)]
    for name in results.sweeps:
        lines += ["", f"## Sweep {name}", "", *_sweep(results.sweep(name))]
    return "\n".join([*lines, "", "## Provenance", "", *_provenance(results)]) + "\n"


def with_error(value, error, brief=False):
    """`value ± error`, the value to the digits its error leaves (at most six).

    Parameters
    ----------
    value, error : float; an error that is not finite, or zero, is left out
    brief : bool, leave out an error too small to touch the digits shown

    Returns
    -------
    str
    """
    if not math.isfinite(value):
        return "–"
    if not math.isfinite(error):
        return f"{value:.4g}"
    if error == 0:
        return f"{value:.6g}"
    digits = 6
    if value != 0:
        digits = math.floor(math.log10(abs(value))) - math.floor(math.log10(error)) + 1
    if brief and digits > 6:
        return f"{value:.6g}"
    return f"{_plain(value, digits)} ± {_plain(error, 1)}"


def _plain(value, digits):
    """A number to so many digits (1 to 6), without an exponent where it can be avoided."""
    text = f"{value:.{min(max(digits, 1), 6)}g}"
    return f"{float(text):g}" if "e" in text else text


def _gear(results, responses):
    """What was computed: gear, transmission error, laws."""
    pair, table = results.gear_pair, results.transmission_error.attrs
    lines = [
        f"{pair['pinion_teeth']} × {pair['gear_teeth']} teeth, backlash "
        f"{1e6 * pair['backlash']:g} µrad, restitution {pair['restitution']:g}, damping ratio "
        f"{pair['damping_ratio']:g}, natural frequency "
        f"{pair['natural_frequency'] / (2 * math.pi):.6g} Hz. Transmission error: "
        f"{table['source']}, {1e6 * table['peak_to_peak']:.4g} µrad peak to peak, sign "
        f"`{table['te_sign']}`."]
    if responses:
        laws = sorted({f"contact law `{one['contact_law']}`, impact law `{one['impact_law']}`, gap "
                       f"`{one['gap']}`, mesh frequency {1 / one['mesh_period_s']:.6g} Hz"
                       for one in responses})
        lines.append("Responses: " + "; ".join(laws) + ".")
    return [" ".join(lines)]


def _table(responses):
    """One line for each response, the source's claim beside it."""
    rows = [("response", "brake torque (N·m)", "motion", "impacts per cycle, drive / coast",
             "deepest separation (µrad)", "contact", "mesh force, mean / peak (N)",
             "impact energy (mJ per cycle)", "source")]
    for one in responses:
        row = [one["name"], f"{one['brake_torque']:g}"]
        if one["status"]:
            row += [f"**failed: {one['status_meaning'].replace('_', ' ')}**", *"–––––"]
        else:
            row += [_motion(one), f"{_count(one, '')} / {_count(one, 'back_')}",
                    _value(one, "deepest_separation", 1e6, True), _contact(one),
                    " / ".join(_value(one, f"mesh_force_{key}", 1.0, True)
                               for key in ("mean", "peak")),
                    _value(one, "impact_energy_per_cycle", 1e3, True)]
        rows.append((*row, _claim(one) or "–"))
    lines = ["| " + " | ".join(row) + " |" for row in rows]
    return [lines[0], "|---" * len(rows[0]) + "|", *lines[1:]]


def _legend(responses):
    """How to read the table."""
    depth = sorted({one["count_depth"] for one in responses})
    shown = " and ".join(f"{100 * value:g} %" for value in depth)
    return [f"Impacts are counted that end a flight deeper than {shown} of the deepest separation "
            "of their cycle (without restitution: every arrival). ± is the difference to a second "
            "run at another tolerance; in this table it is left out where it lies below the last "
            "digit. ≈ marks a motion without a period: ± is then the greater of two differences of "
            "averages or greatest values, between the two runs and between the halves of the "
            "record. Mesh force is that of spring and damper, impacts apart."]


def _value(attrs, key, factor=1.0, brief=False):
    """One number with its error, marked where it is a statistic."""
    text = with_error(factor * attrs[key], factor * _error(attrs, key), brief)
    chance = attrs["error_kind"] != "convergence" and attrs[key] != 0 and text != "–"
    return ("≈ " if chance else "") + text


def _error(attrs, key):
    """Difference of the two runs; without a period not less than that of the two halves."""
    error = attrs[f"{key}_error"]
    if attrs["error_kind"] == "convergence":
        return error
    return float(np.fmax(error, abs(attrs[f"{key}_transient"])))


def _count(attrs, side):
    key = f"{side}impacts_per_cycle"
    error = _error(attrs, key)
    return f"{attrs[key]:g}" if error == 0 else with_error(attrs[key], error)


def _motion(attrs):
    chatter = ", complete chatter" if attrs["chatter_ends_per_cycle"] > 0 else ""
    return (f"period {attrs['period']}" if attrs["period"] else "no period") + chatter


def _contact(attrs):
    if attrs["fully_engaged"]:
        return "engaged throughout"
    visited = [state.name.lower().replace("_", " ") for state in MotionState
               if attrs["states_visited"] >> state & 1]
    return ", ".join(visited)


def _claim(attrs):
    """What the source says of this response, in one cell."""
    parts = []
    if "claim_impacts_per_cycle" in attrs:
        parts.append(f"{attrs['claim_impacts_per_cycle']:g} impacts")
    if "claim_deepest_separation" in attrs:
        parts.append(f"{1e6 * attrs['claim_deepest_separation']:g} µrad")
    text = attrs.get("claim_text", "")
    return ", ".join(parts) + (f" (“{text}”)" if parts and text else text)


def _paragraph(attrs):
    """One response in sentences."""
    torque = f"At {attrs['brake_torque']:g} N·m"
    run = (f"{attrs['record_cycles']} cycles recorded after {attrs['settle_cycles']}, "
           f"start `{attrs['start']}`, tolerance {attrs['rtol']:g}")
    if attrs["status"]:
        return (f"{torque} the run failed numerically "
                f"(`{attrs['status_meaning']}`); there are no numbers. ({run}.)")
    sentences = [f"{torque} {_motion_sentence(attrs)}"]
    if attrs["fully_engaged"]:
        sentences.append("The drive flanks never part.")
    else:
        sentences.append(
            f"The drive flanks part by up to {_value(attrs, 'deepest_separation', 1e6)} µrad of "
            f"{1e6 * attrs['gap_width']:g} µrad and strike {_count(attrs, '')} times per cycle "
            f"({attrs['resolved_impacts_per_cycle']:g} counting every bounce), the coast flanks "
            f"{_count(attrs, 'back_')} times.")
        if attrs["contact_law"] != "compliant":
            sentences.append("The impacts take "
                             f"{_value(attrs, 'impact_energy_per_cycle', 1e3)} mJ in each cycle.")
        if attrs["deepest_back_penetration"] > 0:
            sentences.append("The coast flank is pressed in by up to "
                             f"{_value(attrs, 'deepest_back_penetration', 1e6)} µrad.")
    sentences += [_force_sentence(attrs), _comparison(attrs), _trust(attrs), f"({run}.)"]
    return " ".join(sentence for sentence in sentences if sentence)


def _motion_sentence(attrs):
    chatter = ""
    if attrs["chatter_ends_per_cycle"] > 0:
        chatter = f", with {attrs['chatter_ends_per_cycle']:.4g} complete chatters per cycle"
    if not attrs["period"]:
        return f"the motion has no period up to {attrs['max_period']} mesh cycles{chatter}."
    cycles = "every mesh cycle" if attrs["period"] == 1 else f"every {attrs['period']} mesh cycles"
    return f"the motion repeats {cycles}, class {attrs['motion_class']}{chatter}."


def _force_sentence(attrs):
    if not math.isfinite(attrs["mesh_force_mean"]):
        return "The rigid law has no spring, hence no mesh force is given."
    impulse = attrs["impact_force_mean"]
    share = f" (the impacts push another {impulse:.4g} N on average)" if impulse else ""
    return (f"The mesh force is {_value(attrs, 'mesh_force_mean')} N on average{share} and "
            f"{_value(attrs, 'mesh_force_peak')} N at its greatest.")


def _comparison(attrs):
    """The source's numbers against these."""
    parts = []
    for key, factor, unit in (("impacts_per_cycle", 1, "impacts per cycle"),
                              ("deepest_separation", 1e6, "µrad deepest separation")):
        claim = attrs.get(f"claim_{key}")
        if claim is None:
            continue
        value = attrs[key]
        if claim == value:
            verdict = "as here"
        elif claim == 0 or value == 0:
            verdict = f"here {factor * value:.4g}"
        else:
            verdict = f"here {100 * (value / claim - 1):+.2g} %"
        parts.append(f"{factor * claim:g} {unit} ({verdict})")
    text = f" “{attrs['claim_text']}”" if "claim_text" in attrs else ""
    if not parts and not text:
        return ""
    return f"The source reports{text}{': ' if text and parts else ' ' * bool(parts)}" \
           f"{' and '.join(parts)}."


def _trust(attrs):
    """What the two tolerances and the two halves of the record say."""
    other = attrs["motion_class_reference"]
    if attrs["status_reference"]:
        sentence = "The second run, for the error, failed; no error is known."
    elif other != attrs["motion_class"]:
        sentence = (f"**The run at tolerance {attrs['rtol_reference']:g} gives another motion, "
                    f"{other}: do not rely on the class.**")
    elif attrs["error_kind"] != "convergence":
        sentence = "Without a period single numbers do not converge, only their averages do."
    else:
        sentence = ""
    moving = [key for key in ("deepest_separation", "mesh_force_mean", "mesh_force_peak",
                              "impact_energy_per_cycle") if _drifts(attrs, key)]
    if attrs["error_kind"] != "convergence":
        change = attrs["mesh_force_mean_transient"]
        if math.isfinite(change):
            sentence += f" The mean force changes by {change:+.2g} N between the halves."
    elif moving:
        drift = ", ".join(f"{key.replace('_', ' ')} by {attrs[f'{key}_transient']:+.1g}"
                          for key in moving)
        sentence += f" **Not settled:** from the first half to the second {drift} (SI units)."
    else:
        sentence += " Settled: both halves of the record agree."
    return sentence.strip()


def _drifts(attrs, key):
    limit = max(SETTLED * abs(attrs[key]), attrs[f"{key}_error"])
    return abs(attrs[f"{key}_transient"]) > limit


def _sweep(sweep):
    """Findings of one sweep, as a list."""
    parameter = sweep.attrs["parameter"]
    unit = UNITS.get(parameter, "")
    values = sweep[parameter].values
    unfinished = int((sweep["status"] == Status.UNFINISHED).sum())
    failed = int((sweep["status"] != Status.OK).sum()) - unfinished
    lines = [f"- {parameter.replace('_', ' ')} from {values[0]:g} to {values[-1]:g} {unit}: "
             f"{values.size} values × {sweep.sizes['start']} starts, {sweep.attrs['settle']} mesh "
             f"cycles to settle and {sweep.attrs['record']} recorded, tolerance "
             f"{sweep.attrs['rtol']:g}; {failed or 'none'} of {sweep['status'].size} failed"
             + f", **{unfinished} not reached**" * bool(unfinished)]
    if "deepest_separation" not in sweep:
        return lines
    depth = sweep["deepest_separation"].max("recorded_cycle")
    back = sweep["back_impacts"].sum("recorded_cycle") + \
        sweep["back_engages"].sum("recorded_cycle") > 0
    lines.append("- last back impact: " + _largest(values, back, unit, "none seen"))
    lines.append("- last separation: " + _largest(values, depth > 0, unit, "none"))
    if "full_engagement" in sweep.attrs:
        lines.append(f"- complete engagement from {sweep.attrs['full_engagement']:.10g} {unit}: "
                     "above it the engaged motion never separates (contact is first lost at mesh "
                     f"phase {sweep.attrs['full_engagement_phase']:.6f}); other motions may exist "
                     "beside it")
    lines.append("- hysteresis: " + _hysteresis(sweep, depth, values, unit))
    lines.append("- impacts are counted after flights deeper than "
                 f"{100 * sweep.attrs['count_depth']:g} % of their cycle's deepest separation")
    return lines


def _largest(values, seen, unit, none):
    """Largest value at which something was seen, for each start."""
    parts = []
    for start in seen["start"].values:
        hits = values[seen.sel(start=start).values]
        found = f"{hits[-1]:g} {unit}" if hits.size else none
        if hits.size and hits[-1] == values[-1]:
            found += " (the end of the range)"
        parts.append(f"{found} ({START_NAMES.get(str(start), start)})")
    return ", ".join(parts)


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
    runs = [f"{first:g}" if first == last else f"{first:g}–{last:g}"
            for first, last in _intervals(values, differ)]
    return ("up and down differ in period, impacts or depth at " + ", ".join(runs) + f" {unit}"
            if runs else "none: up and down agree in period, impacts and depth")


def _intervals(values, flags):
    """First and last value of each run of flags."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], flags, [False]]).astype(int)))
    return [(values[first], values[last - 1]) for first, last in edges.reshape(-1, 2)]


def _provenance(results):
    attrs = results.attrs
    return [f"Lapwing {attrs['lapwing_version']} ({attrs['compiler']}, {attrs['build_flags']}, "
            f"{attrs['build_type']}) on {attrs['cpu']}; Python {attrs['python_version']}, NumPy "
            f"{attrs['numpy_version']}. Deck `{attrs['deck_name']}`, hash of the values used "
            f"`{attrs['used_hash']}`."]
