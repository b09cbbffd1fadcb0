"""Make docs/source-case.md and its figures from results/ of the commands the page names.

Run from the checkout after those commands: python docs/make_source_case.py [RESULTS]
"""

import re
import sys
import textwrap
from pathlib import Path

import numpy as np
from make_gallery import shrunk

from lapwing.base.codes import BranchOutcome, FoundMotion, SearchStage, SpecialPoint
from lapwing.base.messages import decimals
from lapwing.plots.critical_marks import label_of
from lapwing.report.branches import EVENTS, exactly, interval_rows
from lapwing.results import read_results

DOCS = Path(__file__).parent
RESULTS = Path(sys.argv[1] if len(sys.argv) > 1 else "results")
TORQUES = ("0.8", "1.8", "3.3", "5.5", "12")
FIGURES = {"back": "critical_25x32/critical_search_T_back",
           "safe": "critical_25x32/critical_search_T_safe",
           "depth": "lapping_25x32/deepest_separation_torque",
           "branches": "branches_25x32/bifurcation_torque"}


def motion(attrs):
    """Class, depth and back impacts of a response, in one cell."""
    if attrs["fully_engaged"]:
        return "engaged throughout"
    name = attrs["motion_class"]
    if not attrs["period"]:
        name = "no period" + ", complete chatter" * bool(attrs["chatter_ends_per_cycle"] > 0) \
            + f", {attrs['impacts_per_cycle']:.3g} impacts per cycle"
    back = attrs["back_impacts_per_cycle"]
    return (f"{name}, {1e6 * attrs['deepest_separation']:.0f} µrad"
            + f", {back:.2g} back impacts per cycle" * bool(back > 0))


def point(sweep, torque):
    """Period of the motion from rest at one torque of a sweep, in words."""
    at = sweep.sel(start="rest").sel(brake_torque=torque, method="nearest")
    if not np.isclose(float(at["brake_torque"]), torque):
        raise SystemExit(f"the sweep has no {torque} N·m")
    period = int(at["period"])
    return f"period {period}" if period else "no period"


def listed(words):
    """'a, b and c'."""
    return " and ".join([", ".join(words[:-1]), *words[-1:]]) if len(words) > 1 else words[0]


def of_back(critical):
    """The last back impact and what is known beyond it."""
    attrs = critical.attrs
    seen = critical.isel(trial=int(np.flatnonzero(
        critical["trial_value"].values == attrs["last_seen"])[0]))
    quiet = critical["trial_value"].values[critical["trial_back_cycles"].values == 0]
    below = np.sort(quiet[quiet < attrs["last_seen"]])
    return {"back.last": f"{attrs['last_seen']:g}", "back.first": f"{attrs['first_clean']:g}",
            "back.end": f"{attrs['clean_end']:g}", "back.from": f"{attrs['scan_to']:g}",
            "back.values": f"{attrs['clean_values']}",
            "back.seen": f"{int(seen.trial_back_cycles)}",
            "back.bursts": f"{int(seen.trial_bursts)}",
            "back.cycles": f"{int(seen.trial_cycles):,}", "back.starts": f"{attrs['n_starts']}",
            "back.rare": f"{1 / attrs['rate_bound']:,.0f}",
            "back.quiet": listed([f"{value:g}" for value in below])}


def of_responses(prefix, results):
    """Values of the five responses of a deck."""
    attrs = {torque: results.response(f"torque_{torque}").attrs for torque in TORQUES}
    return {f"{prefix}.{torque}": motion(one) for torque, one in attrs.items()} | {
        f"{prefix}.5.5.depth": f"{1e6 * attrs['5.5']['deepest_separation']:.0f}",
        f"{prefix}.5.5.counted": f"{attrs['5.5']['impacts_per_cycle']:g}",
        f"{prefix}.5.5.resolved": f"{attrs['5.5']['resolved_impacts_per_cycle']:.3g}",
        f"{prefix}.5.5.excess": f"{100 * (attrs['5.5']['deepest_separation'] / 170e-6 - 1):.0f}"}


def of_sweep(sweep):
    """The staircase, its narrow first step, and rattling carried upwards at 12 N·m."""
    rest = sweep.sel(start="rest").where(sweep.sel(start="rest")["period"] == 1, drop=True)
    count = rest["counted_impacts"].mean("recorded_cycle").values
    torques = rest["brake_torque"].values
    # A step of the staircase has some width; single points are coincidences of the threshold.
    steps = [f"{n} from {torques[count == n].min():g}" for n in range(4, 20)
             if np.sum(count == n) > 4]
    resolved = rest["impacts"].mean("recorded_cycle").values
    up = sweep.sel(start="up").sel(brake_torque=12.0, method="nearest")
    return {"abs.staircase": ", ".join(steps), **of_steps(torques, count, resolved),
            "abs.sweep.1.78": point(sweep, 1.78),
            "abs.sweep.2": point(sweep, 2.0),
            "depth.up": f"{1e6 * float(up['deepest_separation'].max()):.0f}"}


def of_steps(torques, count, resolved):
    """First torques at which the counted impacts alone, and at which all impacts are one more."""
    wide = [n for n in range(4, 20) if np.sum(count == n) > 4]
    alone = [torques[count == n].min() for n in wide[1:]
             if np.any((count == n - 1) & (resolved == n) & (torques < torques[count == n].min()))]
    motion = [torques[resolved == n].min() for n in range(5, 20) if np.sum(resolved == n) > 4]
    return {"abs.staircase.counted": listed([f"{torque:g}" for torque in alone]),
            "abs.staircase.motion": listed([f"{torque:g}" for torque in motion])}


def of_branches(diagram):
    """Where rattling was found above T_full, what ends it, and where it dies that is raised."""
    end, attrs = diagram.isel(rattling=-1), diagram.attrs
    kinds = diagram["special_kind"].values
    stops = (diagram["special_outcome"].values == BranchOutcome.ENDS) & ~np.isin(
        kinds, (SpecialPoint.LIMIT, SpecialPoint.PERIOD_DOUBLING, SpecialPoint.CLOSED,
                SpecialPoint.POINTS))
    motions = diagram["motion_kind"].values
    return {"branches.ends": f"{stops.sum()}",
            "branches.rebounds": f"{np.sum(kinds[stops] == SpecialPoint.REBOUND)}",
            "branches.rows": "\n".join(f"| {' | '.join(row)} |" for row in interval_rows(diagram)),
            "branches.end": exactly(float(end["rattling_high"]), float(end["rattling_high_error"])),
            "branches.end.kind": EVENTS[SpecialPoint(int(end["rattling_high_kind"]))],
            "branches.dies": exactly(attrs["dies"], attrs["dies_error"]),
            "branches.dies.kind": EVENTS[SpecialPoint[
                attrs["dies_kind"].upper()]].partition(":")[0],
            "branches.motions": f"{len(motions):,}",
            "branches.periodic": f"{int((motions == FoundMotion.PERIODIC).sum()):,}",
            "branches.aperiodic": f"{int((motions == FoundMotion.APERIODIC).sum()):,}",
            "branches.count": f"{int(diagram['branch'].max())}",
            "branches.low": f"{attrs['low']:g}", "branches.high": f"{attrs['high']:g}"}


def of_searches(results):
    """The critical torques under the source's law."""
    full, safe, back, speed = (results.critical(name) for name in ("T_full", "T_safe", "T_back",
                                                                   "speed_at_12"))
    rpm = float(speed.attrs["estimate"])
    grid = np.isin(safe["trial_stage"], (SearchStage.SCAN, SearchStage.FURTHER))
    at = int(np.flatnonzero(grid & np.isclose(safe["trial_value"], 12.0))[0])
    return {"T_full": f"{full.attrs['estimate']:.10f}",
            "T_full.phase": f"{full.attrs['phase']:.6f}",
            "T_safe": " ± ".join(decimals(safe.attrs["estimate"], safe.attrs["bar"])),
            "speed": f"{rpm:.1f}", "speed.excess": f"{100 * (rpm / 240 - 1):.1f}",
            "share.12": f"{int(safe['trial_rattling'][at])}",
            "starts.12": f"{int(safe['trial_starts'][at])}", **of_back(back)}


def short(results, name):
    """One search in a few words."""
    critical = results.critical(name)
    attrs = critical.attrs
    if name == "T_safe" and attrs["outcome"] == "unsafe_throughout":
        return f"rattling survives beyond {attrs['scan_from']:g} N·m"
    if name == "T_back":
        if attrs["outcome"] == "found":
            return f"the last back impact is seen at {attrs['last_seen']:g} N·m"
        return "no back impact is seen" if attrs["outcome"] == "none_seen" else \
            f"back impacts are seen up to the end of the search, {attrs['scan_from']:g} N·m"
    full = results.critical("T_full").attrs["estimate"]
    same = bool(abs(attrs["estimate"] - full) <= attrs["bar"])
    found = "T_safe = " + " ± ".join(decimals(attrs["estimate"], attrs["bar"])) + " N·m" \
        if attrs["outcome"] == "found" else label_of(critical)
    return found + (
        ", which is T_full within its bar: above it no rattling was seen" * same)


def values():
    """Everything the template asks for."""
    found = {}
    with read_results(RESULTS / "branches_25x32" / "result.nc") as results:
        found |= of_branches(results.study("branches", "torque"))
    with read_results(RESULTS / "lapping_25x32" / "result.nc") as results:
        found |= of_responses("abs", results) | of_sweep(results.sweep("torque"))
    with read_results(RESULTS / "lapping_25x32_relative" / "result.nc") as results:
        found |= of_responses("rel", results)
    with read_results(RESULTS / "critical_25x32" / "result.nc") as results:
        found |= of_searches(results)
    with read_results(RESULTS / "relative" / "critical_25x32" / "result.nc") as results:
        found |= {f"relative.{name}": short(results, name) for name in ("T_safe", "T_back")}
    with read_results(RESULTS / "geometric" / "critical_25x32" / "result.nc") as results:
        found |= {"geometric.T_full": f"{results.critical('T_full').attrs['estimate']:.5f}",
                  "geometric.T_safe": short(results, "T_safe")}
    with read_results(RESULTS / "geometric" / "lapping_25x32" / "result.nc") as results:
        found |= of_responses("geo", results)
    return found


def wrapped(text):
    """The page with its paragraphs broken anew: numbers change their lengths."""
    blocks = [block if re.match(r"[#|!]|\d\.", block) else
              textwrap.fill(" ".join(block.split()), 100, break_long_words=False,
                            break_on_hyphens=False)
              for block in text.rstrip().split("\n\n")]
    return "\n\n".join(blocks) + "\n"


def main():
    """Fill the template; a name it does not find stops everything."""
    found = values()
    text = (DOCS / "source-case.template.md").read_text(encoding="utf-8")
    filled = re.sub(r"{{(.*?)}}", lambda match: found[match[1]], text)
    (DOCS / "source-case.md").write_text(wrapped(filled), encoding="utf-8")
    for name, source in FIGURES.items():
        deck, _, stem = source.partition("/")
        shrunk(stem, RESULTS / deck / "result.nc",
               DOCS / "images" / "source_case" / f"{name}.png")


if __name__ == "__main__":
    main()
