"""Write pydriver/lapwing_bench/data/*.nc, what `lapwing bench` judges against.

Command (from the repository root, minutes): python tests/reference/make_bench_reference.py
It needs gmpy2 and the installed package, from which it takes the scenes' numbers as the doubles
the engine is given. Every other route to the motion may take the place of `follow`.

A file per scene, a group per variant, `<series|table>_<true|rule>`: the transmission error as a
harmonic series or as the table that stands for it, the end of a chatter as it is or by the
sticking rule (bench_flow.py). All torques for 3 cycles; those for 50 where no variant lets a
relative change of 1e-25 of the torque grow to 1e4 times that.
"""

from __future__ import annotations

import sys
import time
from pathlib import Path

import gmpy2
import numpy as np
from bench_flank import Series, table_pieces
from bench_flow import CHATTER_END, DIGITS, IMPACT, Follower, Setup, working_precision
from gmpy2 import mpfr

from lapwing_bench.reference import write_reference
from lapwing_bench.scenes import LONG, SCENES, SHORT

DATA = Path(__file__).resolve().parents[2] / "pydriver" / "lapwing_bench" / "data"
COMMAND = "python tests/reference/make_bench_reference.py"
CHANGE = "1e-25"
CALM = 1e4


def variants(scene):
    """(forcing, end of chatter) pairs that differ for a scene."""
    if scene.contact_law == "compliant":
        return [("series", "true"), ("table", "true")]
    if scene.is_series:
        return [("series", "true"), ("series", "rule"), ("table", "true")]
    return [("table", "true"), ("table", "rule")]


def follow(osc, forcing, ending, change="0"):
    """Events (kind, cycle, s, before, after), states at cycle ends and P, to all digits."""
    te, scale, omega = osc.te, osc.flank_scale, osc.mesh_frequency_ratio
    if forcing == "series":
        stretches = [Series(te.harmonics.tolist(), scale, omega)]
    else:
        stretches = table_pieces(te.knots.tolist(), te.coefficients.tolist(), te.kinks.tolist(),
                                 scale, omega)
    low, high = osc.flank_extrema
    follower = Follower(Setup(
        osc.force, omega, osc.damping_ratio, osc.restitution, osc.backlash,
        osc.contact_law == "compliant", osc.impact_law == "absolute", stretches, high - low,
        ending == "rule", change)).run(LONG)
    return follower.events, follower.cycle_ends, follower.period


def without_chatter(events, period):
    """Events less the bounces inside complete chatters, and where each chatter begins (cycles).

    A complete chatter's bounces are the impacts before its end, each slower than the one before;
    the first of them, which ends a flight of its own, stays.
    """
    keep, since = np.ones(len(events), dtype=bool), np.full(len(events), np.nan)
    for end, event in enumerate(events):
        if event[0] not in (CHATTER_END, CHATTER_END + 1):
            continue
        kind, first = event[0] - CHATTER_END + IMPACT, end - 1
        while first > 0 and events[first - 1][0] == kind and (
                abs(events[first - 1][3]) > abs(events[first][3])):
            first -= 1
        keep[first + 1:end] = False
        opened = [float(events[i][1] + events[i][2] / period) for i in (first, first + 1)]
        since[end] = sum(opened) / 2
    rows = [event for event, kept in zip(events, keep, strict=True) if kept]
    return rows, since[keep]


def growth_of(rows, changed, period):
    """|dτ/dlnT| of each event in mesh periods; infinite from where the lists differ."""
    growth = np.full(len(rows), np.inf)
    for i, (one, other) in enumerate(zip(rows, changed, strict=False)):
        if one[0] != other[0]:
            break
        moved = (other[1] - one[1]) + (other[2] - one[2]) / period
        growth[i] = float(abs(moved) / mpfr(CHANGE))
    return growth


def state_growth(osc, one, other):
    """The same of a state, in parts of the natural sizes of angle and velocity."""
    if one[0] != other[0]:
        return np.inf
    speed = min(1.0, osc.mesh_frequency_ratio) * osc.angle_scale
    moved = max(abs(one[1] - other[1]) / mpfr(osc.angle_scale),
                abs(one[2] - other[2]) / mpfr(speed))
    return float(moved / mpfr(CHANGE))


def one_torque(osc, forcing, ending):
    """All that is known of one torque, before it is decided how far it is stored."""
    events, ends, period = follow(osc, forcing, ending)
    changed, changed_ends, _ = follow(osc, forcing, ending, CHANGE)
    rows, since = without_chatter(events, period)
    others, _ = without_chatter(changed, period)
    growth = growth_of(rows, others, period)
    states = [(0 if flank is None else (1 if flank > 0 else 2), float(phi), float(velocity))
              for flank, phi, velocity in (ends[SHORT - 1], ends[LONG - 1])]
    grown = [state_growth(osc, ends[n - 1], changed_ends[n - 1]) for n in (SHORT, LONG)]
    same = len(rows) == len(others)
    return {
        "kind": [int(row[0]) for row in rows], "cycle": [int(row[1]) for row in rows],
        "phase": [float(row[2] / period) for row in rows],
        "velocity_before": [float(row[3]) for row in rows],
        "velocity_after": [float(row[4]) for row in rows],
        "growth": growth, "chatter_since": since, "states": states, "state_growth": grown,
        "calm": same and max([*growth, grown[1]]) < CALM,
        "listed_events": [sum(e[1] < n for e in events) for n in (SHORT, LONG)]}


def one_scene(scene):
    """Variants of a scene, {'series_true': [record of each torque]}, calm where all are."""
    records = {f"{forcing}_{ending}": [one_torque(osc, forcing, ending)
                                       for osc in scene.oscillators]
               for forcing, ending in variants(scene)}
    calm = np.all([[record["calm"] for record in rows] for rows in records.values()], axis=0)
    for rows in records.values():
        for record, quiet in zip(rows, calm, strict=True):
            record["calm"] = bool(quiet)
    return records


def main(names):
    scenes = {name: SCENES[name] for name in names or SCENES}
    for name, scene in scenes.items():
        begun = time.process_time()
        with working_precision():
            records = one_scene(scene)
        write_reference(DATA / f"{name}.nc", scene, records,
                        {"command": f"{COMMAND} {name}", "digits": DIGITS,
                         "program": f"gmpy2 {gmpy2.version()}"})
        calm = sum(record["calm"] for record in next(iter(records.values())))
        size = (DATA / f"{name}.nc").stat().st_size
        print(f"{name}: {calm} of {len(scene.torques)} torques for {LONG} cycles, {size} bytes, "
              f"{time.process_time() - begun:.0f} s", flush=True)


if __name__ == "__main__":
    main(sys.argv[1:])
