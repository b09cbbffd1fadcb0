"""What a bifurcation diagram says in words: where rattling ends, by which event, how sure it is."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from lapwing.base.codes import FoundFrom, FoundMotion, SpecialPoint
from lapwing.report.words import markdown, parameter_unit, parameter_words, plural, sections

if TYPE_CHECKING:
    import xarray as xr

    from lapwing.results import Results

# What happens at an end, in a sentence.
EVENTS = {
    SpecialPoint.FOLD: "a fold: a stable motion meets an unstable one",
    SpecialPoint.PERIOD_DOUBLING: "a period doubling",
    SpecialPoint.TORUS: "a pair of multipliers of magnitude one",
    SpecialPoint.BRANCH_POINT: "a crossing of branches",
    SpecialPoint.GRAZING: "a grazing: an arrival without speed is born or lost",
    SpecialPoint.RELEASE: "a release is born or lost",
    SpecialPoint.REBOUND: "a rebound without speed, where the map jumps",
    SpecialPoint.CHATTER: "a chatter that is no longer complete",
    SpecialPoint.KINK: "an impact upon a kink of the transmission error",
    SpecialPoint.KNOT: "an event upon a jump of the curvature",
    SpecialPoint.ENGAGED: "the last separation vanishes: contact is kept",
    SpecialPoint.APERIODIC: "the end of a motion without a period: there none of eight copies "
                            "of it dies in 128,000 mesh cycles, above the bracket all do",
    SpecialPoint.LIMIT: "the end of the values looked at, not of the rattling",
    SpecialPoint.POINTS: "the end of what was asked for, not of the rattling",
    SpecialPoint.CLOSED: "the branch's own beginning",
    SpecialPoint.JOINS: "a part of the branch that is known",
    SpecialPoint.UNRESOLVED: "an event that was not resolved",
    SpecialPoint.NONE: "contact is kept from here on"}
# Ends that are none of the rattling.
OPEN = (SpecialPoint.LIMIT, SpecialPoint.POINTS)
# Rows of a table; digits of a value, at most.
MOST_ROWS, DIGITS = 12, 13


class _End(NamedTuple):
    value: float
    error: float
    kind: SpecialPoint
    branch: int

    def words(self, data: xr.Dataset) -> str:
        """Value, event and branch."""
        unit = parameter_unit(data.attrs["parameter"])
        of = f" (branch {self.branch})" if self.branch else ""
        return f"{exactly(self.value, self.error)} {unit}".rstrip() + f", {EVENTS[self.kind]}{of}"


def exactly(value: float, error: float) -> str:
    """A value to the digits that its error leaves, and the error where it is known and not zero."""
    if not error > 0:
        return f"{value:.{DIGITS}g}"
    step = 10.0 ** math.floor(math.log10(error))
    up = step * math.ceil(error / step * (1 - 1e-12))
    digits = math.floor(math.log10(abs(value))) - math.floor(math.log10(up)) + 1 if value else 4
    return f"{value:.{min(max(digits, 4), DIGITS)}g} ± {up:.1g}"


def section(diagrams: list[xr.Dataset], results: Results) -> list[str]:
    """The summary's part on branches; see `registry`."""
    return sections("Branches", diagrams, branches_text)


def headline(data: xr.Dataset) -> str:
    """Branches, and where rattling ends."""
    last = _intervals(data)[-1:]
    end = f"; rattling {'reaches' if last[0][1].kind in OPEN else 'ends at'} " \
        f"{last[0][1].words(data)}" if last else \
        "; no rattling was found above T_full" if "kept" in data.attrs \
        and data.attrs["low"] <= data.attrs["kept"] else \
        "; no rattling was found there" if "kept" in data.attrs else ""
    return (f"{_branches(data)} of periodic motions along the "
            f"{parameter_words(data.attrs['parameter'])}{end}")


def findings(data: xr.Dataset) -> list[str]:
    """Where rattling ends and why, and where raised slowly it dies; else what was followed."""
    kind, name = data["motion_kind"].values, data.attrs.get("name", "")
    failed = int((kind == FoundMotion.FAILED).sum())
    if failed == kind.size:
        return []
    if "kept" not in data.attrs:
        periodic = kind == FoundMotion.PERIODIC
        on = data["motion_branch"].values > 0
        counts = {"on them": (periodic & on).sum(), "periodic and on none": (periodic & ~on).sum(),
                  "without a period": (kind == FoundMotion.APERIODIC).sum(),
                  "in contact throughout": (kind == FoundMotion.ENGAGED).sum(), "failed": failed}
        told = ", ".join(f"{count} {words}" for words, count in counts.items() if count)
        return [f"**{_branches(data)} of periodic motions** along the {_span(data)} (branches "
                f"`{name}`); of {plural(kind.size, 'motion')} looked at {told}."]
    rows = _intervals(data)
    if not rows:
        # Below the values looked at nothing is known, wherever contact can be kept.
        low, high = data.attrs["low"], data.attrs["high"]
        above = f"above {data.attrs['kept']:.10g} N·m" if low <= data.attrs["kept"] \
            else f"from {low:.10g} to {high:.10g} N·m"
        return [f"**No rattling {above}** among the motions looked at "
                f"and their branches (branches `{name}`)." + f" {failed} failed." * bool(failed)]
    last = rows[-1][1]
    said = f"**Rattling ends at T_safe = {last.words(data)}" if last.kind not in OPEN else \
        f"**Rattling reaches {last.value:g} N·m**, {EVENTS[last.kind]}"
    said += "**" * (last.kind not in OPEN)
    said += ", as far as motions were found; from "
    said += f"{max(data.attrs['kept'], data.attrs['low']):.10g} N·m on it was found in "
    said += "one interval" if len(rows) == 1 else f"{len(rows)} intervals with gaps between them"
    return [f"{said}. {_dies(data)}".rstrip()]


def end_of_rattling(data: xr.Dataset) -> tuple[float, bool] | None:
    """Value above which no branch of rattling was found, and whether one ends there or goes on.

    Returns
    -------
    float, bool; None where none rattles above T_full, or T_full is not known
    """
    rows = _intervals(data) if "kept" in data.attrs else []
    if not rows:
        return None
    last = rows[-1][1]
    return last.value + max(last.error, 0.0), last.kind not in OPEN


def branches_text(data: xr.Dataset) -> list[str]:
    """Findings of one diagram: the answer first, intervals, stable ranges, what it rests on.

    Parameters
    ----------
    data : xarray.Dataset, group `branches_<name>` of a result file

    Returns
    -------
    list of str, lines of Markdown
    """
    lines = [f"- {line}" for line in findings(data) if "kept" in data.attrs]
    rows = interval_rows(data)
    lines += [f"- {_extent(data)}", f"- {_searched(data)}", f"- {_missed(data)}"]
    lines += [f"- {_curves(data)}"] if "curve_kind" in data else []
    if rows:
        unit = _unit_shown(data)
        lines += ["", *markdown([(f"rattling from{unit}", "begins with", f"to{unit}",
                                  "ends with"), *rows])]
    ranges = _ranges(data)
    return lines + (["", *ranges] if ranges else [])


def _unit_shown(data: xr.Dataset) -> str:
    """The unit in a table's heading; nothing of a bare number."""
    unit = parameter_unit(data.attrs["parameter"])
    return f" ({unit})" * bool(unit)


def interval_rows(data: xr.Dataset) -> list[tuple[str, ...]]:
    """Intervals of rattling, ascending: where each begins and ends, and with what."""
    return [_row(*ends) for ends in _intervals(data)]


def _row(low: _End, high: _End) -> tuple[str, ...]:
    return tuple(text for end in (low, high)
                 for text in (exactly(end.value, end.error), EVENTS[end.kind]
                              if end is high or end.kind is not SpecialPoint.NONE else "T_full"))


def _intervals(data: xr.Dataset) -> list[tuple[_End, _End]]:
    """Ends of the intervals of rattling, ascending."""
    if "rattling_low" not in data:
        return []
    ends = [[_End(float(value), float(error), SpecialPoint(int(kind)), int(branch))
             for value, error, kind, branch in zip(
                 *(data[f"rattling_{end}{part}"].values
                   for part in ("", "_error", "_kind", "_branch")), strict=True)]
            for end in ("low", "high")]
    return list(zip(*ends, strict=True))


def _dies(data: xr.Dataset) -> str:
    """Where rattling that is raised slowly dies."""
    attrs = data.attrs
    if "dies" not in attrs:
        return "Where rattling dies that is raised slowly is not known: none was carried up to it."
    end = _End(float(attrs["dies"]), float(attrs["dies_error"]),
               SpecialPoint[str(attrs["dies_kind"]).upper()], int(attrs["dies_branch"]))
    if end.kind in OPEN:
        return f"Raised slowly it does not die up to {end.value:g} N·m."
    return f"Raised slowly it dies at {end.words(data)}."


def _extent(data: xr.Dataset) -> str:
    kinds = [SpecialPoint(int(kind)) for kind in data["special_kind"].values]
    told = ", ".join(f"{kinds.count(kind)} {kind.name.lower().replace('_', ' ')}"
                     for kind in SpecialPoint if kind in kinds)
    return (f"{_branches(data)}, {data.sizes.get('point', 0)} points, {_span(data)}; special "
            f"points by kind: {told or 'none'}")


def _branches(data: xr.Dataset) -> str:
    """How many: '1 branch', '3 branches'."""
    count = int(data["branch"].values.max(initial=0))
    return f"{count} branch{'es' * (count != 1)}"


def _span(data: xr.Dataset) -> str:
    """The parameter and its range."""
    attrs = data.attrs
    return (f"{parameter_words(attrs['parameter'])} {attrs['low']:g} to {attrs['high']:g} "
            f"{parameter_unit(attrs['parameter'])}").rstrip()


def _searched(data: xr.Dataset) -> str:
    """The motions looked at, and how many of them lie on branches."""
    kind, on = data["motion_kind"].values, data["motion_branch"].values > 0
    counts = {one: int((kind == one).sum()) for one in FoundMotion}
    periodic = kind == FoundMotion.PERIODIC
    distance = data["motion_distance"].values[periodic & on]
    text = (f"{plural(len(kind), 'motion')} looked at, at {data.sizes.get('seed', 0)} values: "
            f"{counts[FoundMotion.ENGAGED]} in contact throughout, {int(periodic.sum())} periodic "
            f"(to {data.attrs['highest_period']} mesh cycles), {counts[FoundMotion.APERIODIC]} "
            "without a period")
    if distance.size:
        text += f"; of the periodic ones {int(on[periodic].sum())} lie on a branch, within " \
                f"{distance.max():.1g} of their size"
    lost = int((periodic & ~on).sum())
    return text + f"; **{lost} on none**: what they do is not shown" * bool(lost) \
        + f"; {counts[FoundMotion.FAILED]} failed" * bool(counts[FoundMotion.FAILED])


def _missed(data: xr.Dataset) -> str:
    """What may have been missed."""
    random = data["motion_begun"].values == FoundFrom.RANDOM
    known = data["motion_kind"].values != FoundMotion.FAILED
    value = data["motion_value"].values
    each = min((int(known[random & (value == one)].sum()) for one in np.unique(value[random])),
               default=0)
    total = int((random & known).sum())
    text = "a branch that no motion looked at leads to is not shown, and not excluded: "
    if not random.any():
        return text + "there were no random starts to bound its share by"
    bounds = [f"at most {3 / number:.2g} {where} (3/{number})" for number, where in (
        (each, "at any one value"), (total, "if it is there at all of them")) if number > 3]
    if not bounds:
        return text + "there were too few random starts to bound its share by"
    return (text + "with 95 % confidence the share of starts that lead to it is "
            + ", and ".join(bounds))


def _curves(data: xr.Dataset) -> str:
    """Curves over a second parameter."""
    attrs, kinds = data.attrs, data["curve_kind"].values
    told = ", ".join(f"{int((kinds == kind).sum())} {kind.name.lower().replace('_', ' ')}"
                     for kind in SpecialPoint if (kinds == kind).any())
    text = (f"what ends stable ranges, followed in the "
            f"{parameter_words(attrs['second_parameter'])} {attrs['second_low']:g} to "
            f"{attrs['second_high']:g} {parameter_unit(attrs['second_parameter'])}".rstrip()
            + f": {plural(len(kinds), 'curve')}" + f" ({told})" * bool(told))
    left, lost = int(attrs["curves_left"]), int(attrs["curves_lost"])
    text += f"; {left} more special points were not followed, for there were enough curves" \
        * bool(left)
    why = str(attrs.get("curves_lost_why", ""))
    return text + f"; {lost} could not be followed" * bool(lost) + f": {why}" * bool(why)


def _ranges(data: xr.Dataset) -> list[str]:
    """The stable ranges above T_full, or all, those that end last first."""
    low, high = data["range_low"].values, data["range_high"].values
    rows = np.flatnonzero(high > data.attrs.get("kept", -math.inf))
    rows = rows[np.argsort(-high[rows], kind="stable")]
    if not rows.size:
        return []
    unit = _unit_shown(data)
    names = {end: [SpecialPoint(int(kind)).name.lower().replace("_", " ")
                   for kind in data[f"range_{end}_kind"].values] for end in ("low", "high")}
    table: list[Any] = [("branch", "mesh cycles", f"stable from{unit}", "begins with",
                         f"to{unit}", "ends with")]
    table += [(str(data["range_branch"].values[k]), str(data["range_cycles"].values[k]),
               f"{low[k]:.10g}", names["low"][k], f"{high[k]:.10g}", names["high"][k])
              for k in rows[:MOST_ROWS]]
    more = rows.size - MOST_ROWS
    return [*markdown(table), *["", f"{more} more stable ranges are in the result file."]
            * (more > 0)]
