"""What a response says in words: a table of all of them, and a paragraph of each."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

from lapwing.base.arrivals import arrivals_in
from lapwing.base.codes import MotionState
from lapwing.report.measured import motion_words
from lapwing.report.numbers import count_words, doubtful, repeats, uncertainty, value_words
from lapwing.report.stability import aperiodic_words, stability_sentence
from lapwing.report.words import markdown, method_words, plural

if TYPE_CHECKING:
    import xarray as xr

    from lapwing.results.file import Results

# A change between the halves of the record below this part of the number, or of its error, is
# rounding or chance and is not reported as a transient.
SETTLED = 1e-6
# Columns of the table, with what is known of their error.
IN_TABLE = ("impacts_per_cycle", "back_impacts_per_cycle", "deepest_separation", "mesh_force_mean",
            "mesh_force_peak", "impact_energy_per_cycle")


def table(responses: list[xr.Dataset]) -> list[str]:
    """The summary's table of responses; see `registry`."""
    attributes = [one.attrs for one in responses]
    return ["", "## Responses", "", *_table(attributes), "", *_legend(attributes)]


def section(responses: list[xr.Dataset], results: Results) -> list[str]:
    """What the summary says of each response; see `registry`."""
    lines = ["", "## The responses, one by one"]
    for one in responses:
        lines += ["", f"### {one.attrs['name']}", "", _paragraph(one.attrs)]
    return lines


def headline(response: xr.Dataset) -> str:
    """The main result in one line."""
    attrs = response.attrs
    if attrs["status"]:
        return f"failed ({attrs['status_meaning'].replace('_', ' ')})"
    if attrs["fully_engaged"]:
        return "engaged throughout"
    period = attrs["period"]
    motion = f"repeats every {'mesh cycle' if period == 1 else f'{period} mesh cycles'}" \
        if period else f"no period up to {plural(attrs['max_period'], 'mesh cycle')}"
    number = float(f"{attrs['impacts_per_cycle']:.4g}")
    return (f"{motion}, {plural(number, arrivals_in(attrs).word)} per cycle, deepest separation "
            f"{'seen ' * (not period)}{1e6 * attrs['deepest_separation']:.4g} µrad"
            + "; the second run gives another motion" * doubtful(attrs))


def _table(responses: list[dict[str, Any]]) -> list[str]:
    """One line for each response, the source's claim beside it."""
    claimed = any(_claim(one) for one in responses)
    rows = [("response", "braking torque (N·m)", "motion", f"{_arrivals(responses)} per cycle, "
             "drive / coast",
             "deepest separation (µrad)", "contact", "mesh force, mean / peak (N)",
             "impact energy (mJ per cycle)", *["source"] * claimed)]
    for one in responses:
        row: list[str] = [one["name"], f"{one['brake_torque']:g}"]
        if one["status"]:
            row += [f"**failed: {one['status_meaning'].replace('_', ' ')}**", *"–––––"]
        else:
            row += [_motion(one) + " ?" * doubtful(one),
                    f"{count_words(one, '')} / {count_words(one, 'back_')}",
                    value_words(one, "deepest_separation", 1e6, True), _contact(one),
                    " / ".join(value_words(one, f"mesh_force_{key}", 1.0, True)
                               for key in ("mean", "peak")),
                    value_words(one, "impact_energy_per_cycle", 1e3, True)
                    if arrivals_in(one).word == "impact" else "–"]
        rows.append((*row, *[_claim(one) or "–"] * claimed))
    return markdown(rows)


def _arrivals(responses: list[dict[str, float]]) -> str:
    """What is counted, in the plural: one word, or both where the responses have both."""
    return " or ".join(sorted({arrivals_in(one).word + "s" for one in responses}))


def _legend(responses: list[dict[str, float]]) -> list[str]:
    """How to read the table."""
    rules = sorted({(arrivals_in(one).word, arrivals_in(one).rule(one["count_depth"])
                     + " separation" * arrivals_in(one).threshold) for one in responses})
    there = [one for one in responses if not one["status"]]
    if not there:
        return []
    unsure = any(doubtful(one) for one in there)
    known = {uncertainty(one, key)[0] for one in there for key in IN_TABLE}
    fed = any(bool(one["impact_energy_per_cycle"] < 0) for one in responses)
    return ["; ".join(f"{word}s are counted {rule}" for word, rule in rules).capitalize() + ". "
            "Each run is repeated with rk4 at a tolerance of its own. "
            + "Of a motion that repeats, the error is an estimate from the difference of the two "
            "runs and that of the halves of the record, and no bound; it is left out where it lies "
            "below the last digit. " * ("error" in known)
            + "± is half of the 95 % interval of an average over cycles, of a motion without a "
            "period. " * ("±" in known)
            + "≥ marks the greatest value seen of a motion without a period: a longer record may "
            "hold a greater one. " * ("seen" in known)
            + "≈ marks what has neither: the change is the greater of two differences, of the two "
            "runs and of the halves of the record, and says little of the error. "
            * ("change" in known)
            + "“?” marks a motion that the second run does not confirm: it gives another class. "
            * unsure
            + f"A class p:(a,b) repeats every p mesh cycles with a drive and b coast "
            f"{_arrivals(responses)} in that time; c is appended for complete chatter. "
            "Mesh force is that of spring and damper, impacts apart."
            + " Impact energy is what the impacts take; where it is negative the motion gains "
            "it, as it may under the absolute law." * fed]


def _motion(attrs: dict[str, Any]) -> str:
    chatter = ", complete chatter" if attrs["chatter_ends_per_cycle"] > 0 else ""
    return (f"period {attrs['period']}" if attrs["period"] else "no period") + chatter


def _on_coast_flank(attrs: dict[str, Any]) -> bool:
    """Whether the teeth press on the coast flank throughout."""
    return bool(attrs["states_visited"] == 1 << MotionState.BACK_ENGAGEMENT)


def _contact(attrs: dict[str, Any]) -> str:
    if attrs["fully_engaged"]:
        return "engaged throughout"
    if _on_coast_flank(attrs):
        return "on the coast flank throughout"
    visited = [state.name.lower().replace("_", " ") for state in MotionState
               if attrs["states_visited"] >> state & 1]
    return ", ".join(visited)


def _claim(attrs: dict[str, Any]) -> str:
    """What the source says of this response, in one cell."""
    parts = []
    if "claim_impacts_per_cycle" in attrs:
        parts.append(plural(attrs["claim_impacts_per_cycle"], "impact"))
    if "claim_deepest_separation" in attrs:
        parts.append(f"{1e6 * attrs['claim_deepest_separation']:g} µrad")
    text = attrs.get("claim_text", "")
    return ", ".join(parts) + (f" (“{text}”)" if parts and text else text)


def _paragraph(attrs: dict[str, Any]) -> str:
    """One response in sentences."""
    torque = f"At {attrs['brake_torque']:g} N·m"
    run = (f"{plural(attrs['record_cycles'], 'cycle')} recorded after {attrs['settle_cycles']}, "
           f"start `{attrs['start']}`, {method_words(attrs)}")
    if attrs["status"]:
        return (f"{torque} the run failed numerically "
                f"(`{attrs['status_meaning']}`); there are no numbers. ({run}.)")
    sentences = [f"{torque} {_motion_sentence(attrs)}"]
    if attrs["fully_engaged"]:
        sentences.append("The drive flanks never part.")
    elif _on_coast_flank(attrs):
        sentences.append("The coast flanks never part; the drive flanks never touch.")
    else:
        two_flanks, threshold = math.isfinite(attrs["gap_width"]), arrivals_in(attrs).threshold
        width = f" of {1e6 * attrs['gap_width']:g} µrad" * two_flanks
        parts = [f"strike {_times(attrs, '')} per cycle"
                 + f" ({attrs['resolved_impacts_per_cycle']:g} counting every bounce)" * threshold]
        parts += [f"the coast flanks {_times(attrs, 'back_')}"] * two_flanks
        sentences.append("The drive flanks part by up to "
                         f"{value_words(attrs, 'deepest_separation', 1e6)} µrad{width} and "
                         + ", ".join(parts) + "."
                         + " There are no coast flanks." * (not two_flanks))
        words = [_energy_sentence(attrs)] * threshold
        sentences += [*words, *_impact_words(attrs)]
        if attrs["deepest_back_penetration"] > 0:
            sentences.append("The coast flank is pressed in by up to "
                             f"{value_words(attrs, 'deepest_back_penetration', 1e6)} µrad.")
    sentences += [_times_of_states(attrs), _speed_sentence(attrs), stability_sentence(attrs),
                  _force_sentence(attrs), motion_words(attrs), _comparison(attrs), _trust(attrs),
                  f"({run}.)"]
    return " ".join(sentence for sentence in sentences if sentence)


def _times(attrs: dict[str, Any], side: str) -> str:
    text = count_words(attrs, side)
    return text + (" time" if text == "1" else " times")


def _energy_sentence(attrs: dict[str, Any]) -> str:
    """What the impacts take, or what the motion gains: the absolute law may feed energy in."""
    if attrs["impact_energy_per_cycle"] < 0:
        return ("In the impacts the motion gains "
                f"{value_words(attrs, 'impact_energy_per_cycle', -1e3)} mJ in each cycle.")
    return (f"The impacts take {value_words(attrs, 'impact_energy_per_cycle', 1e3)} mJ in each "
            "cycle.")


def _impact_words(attrs: dict[str, Any]) -> list[str]:
    """How fast an arrival is, and how hard where it is an impact; none where nothing arrived."""
    if not math.isfinite(attrs.get("impact_speed_mean", math.nan)):
        return []
    text = (f"The {arrivals_in(attrs).word}s meet the flank at up to "
            f"{value_words(attrs, 'impact_speed_max')} rad/s, at {attrs['impact_speed_mean']:.4g} "
            "rad/s on average")
    if not math.isfinite(attrs.get("energy_per_impact", math.nan)):
        return [text + "."]
    return [text + f", and take {1e3 * attrs['energy_per_impact']:.3g} mJ each on average (every "
            "bounce counted)."]


def _times_of_states(attrs: dict[str, Any]) -> str:
    """Shares of time of the motion states, where there is more than one."""
    if attrs["fully_engaged"] or "time_separated" not in attrs:
        return ""
    shares = [(attrs[f"time_{key}"], words) for key, words in (
        ("separated", "apart"), ("engaged", "on the drive flank"),
        ("back_engaged", "on the coast flank"))]
    return "The teeth are " + ", ".join(f"{100 * share:.3g} % of the time {words}"
                                        for share, words in shares if share > 0) + "."


def _speed_sentence(attrs: dict[str, Any]) -> str:
    """Mean speed of a response with two degrees of freedom."""
    if "mean_speed_last" not in attrs:
        return ""
    first, last = (attrs[f"mean_speed_{end}"] for end in ("first", "last"))
    if attrs["mean_acceleration"] == 0:
        return f"The mean speed of the pinion is {last:.6g} rad/s throughout (torques in balance)."
    return (f"The torques are not in balance: the mean speed of the pinion goes from {first:.6g} "
            f"to {last:.6g} rad/s while it is recorded ({attrs['mean_acceleration']:+.4g} rad/s²); "
            f"the mesh is that of the nominal {attrs['nominal_speed']:.6g} rad/s all the time.")


def _motion_sentence(attrs: dict[str, Any]) -> str:
    chatter = ""
    if attrs["chatter_ends_per_cycle"] > 0:
        number = float(f"{attrs['chatter_ends_per_cycle']:.4g}")
        chatter = f", with {plural(number, 'complete chatter')} per cycle"
    if not attrs["period"]:
        longest = plural(attrs["max_period"], "mesh cycle")
        return f"the motion has no period up to {longest}{aperiodic_words(attrs)}{chatter}."
    cycles = "every mesh cycle" if attrs["period"] == 1 else f"every {attrs['period']} mesh cycles"
    return f"the motion repeats {cycles}, class {attrs['motion_class']}{chatter}."


def _force_sentence(attrs: dict[str, Any]) -> str:
    if not math.isfinite(attrs["mesh_force_mean"]):
        return "The rigid law has no spring, hence no mesh force is given."
    impulse, factor = attrs["impact_force_mean"], attrs.get("dynamic_factor", math.nan)
    share = f" (the impacts push another {impulse:.4g} N on average)" if impulse else ""
    text = f"The mesh force is {value_words(attrs, 'mesh_force_mean')} N on average{share}"
    if not math.isfinite(attrs["mesh_force_peak"]):
        return (text + "; its greatest value is not known, for the mesh period is too long beside "
                "the free oscillation.")
    return (text + f" and {value_words(attrs, 'mesh_force_peak')} N at its greatest"
            + f" (dynamic factor {factor:.4g})" * math.isfinite(factor) + ".")


def _comparison(attrs: dict[str, Any]) -> str:
    """The source's numbers against these."""
    parts = []
    impact = "impact" if attrs.get("claim_impacts_per_cycle") == 1 else "impacts"
    for key, factor, unit in (("impacts_per_cycle", 1, f"{impact} per cycle"),
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


def _trust(attrs: dict[str, Any]) -> str:
    """What the two tolerances and the two halves of the record say."""
    other = attrs["motion_class_reference"]
    if attrs["status_reference"]:
        sentence = "The second run, for the error, failed; no error is known."
    elif doubtful(attrs):
        sentence = ("**The second run, rk4 at tolerance "
                    f"{attrs['rtol_reference']:g}, gives another motion, {other}: "
                    "do not rely on the class.**")
    else:
        sentence = ""
    if not repeats(attrs):
        sentence += (" Without a period only averages over cycles have an interval; greatest "
                     "values are those seen, and a longer record may hold greater ones.")
    halves = [key for key in ("deepest_separation", "mesh_force_mean", "mesh_force_peak",
                              "impact_energy_per_cycle")
              if math.isfinite(attrs[f"{key}_transient"])
              and attrs["period"] <= attrs["record_cycles"] // 2]
    moving = [key for key in halves if _drifts(attrs, key)]
    if not halves:
        sentence += (" Whether the motion has settled is not known: the record has no two halves "
                     "to compare.")
    elif not repeats(attrs) or doubtful(attrs):
        change = attrs["mesh_force_mean_transient"]
        if math.isfinite(change) and change:
            sentence += f" The mean force changes by {change:+.2g} N between the halves."
    elif moving:
        drift = ", ".join(f"{key.replace('_', ' ')} by {attrs[f'{key}_transient']:+.1g}"
                          for key in moving)
        sentence += f" **Not settled:** from the first half to the second {drift} (SI units)."
    else:
        sentence += " Settled: both halves of the record agree."
    return sentence.strip()


def _drifts(attrs: dict[str, Any], key: str) -> bool:
    # Older files have the change between the runs as the error.
    change = attrs.get(f"{key}_change", attrs[f"{key}_error"])
    limit = max(SETTLED * abs(attrs[key]), change)
    return bool(abs(attrs[f"{key}_transient"]) > limit)
