"""Write tests/hard_cases/data/*.json: hard cases and what must come out of them.

Command (from the repository root): python tests/hard_cases/make_hard_cases.py [name ...]

Numbers come from the 60-digit integrator of tests/reference, and wherever a closed form exists it
is evaluated too and must agree to 25 digits. `condition` of a number is the sum over all parameters
of |its change over a relative change of the parameter|: what a rounding of the input does to it.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

from mpmath import mp, mpf

HERE = Path(__file__).resolve().parent
sys.path.append(str(HERE.parent / "reference"))
import exact_flow  # noqa: E402

COMMAND = "python tests/hard_cases/make_hard_cases.py"
DATA = HERE / "data"
DIGITS = 25
CHANGE = mpf("1e-25")
AGREEMENT = mpf("1e-25")
NAMES = {("impact", "drive"): "IMPACT", ("impact", "coast"): "BACK_IMPACT",
         ("release", "drive"): "RELEASE", ("release", "coast"): "BACK_RELEASE",
         ("engage", "drive"): "ENGAGE", ("engage", "coast"): "BACK_ENGAGE",
         ("chatter_end", "drive"): "CHATTER_END", ("chatter_end", "coast"): "BACK_CHATTER_END",
         ("kink", "none"): "KINK"}
MOTIONS = {"separation": "separation", "drive": "engagement", "coast": "back_engagement"}
FLANKS = {name: key for key, name in MOTIONS.items()}
DEFAULTS = {"force": 1.0, "period": 8.0, "damping_ratio": 0.1, "restitution": 0.5, "backlash": 1e3,
            "contact_law": "restitution", "impact_law": "relative", "gap": "one_sided",
            "back_flank_te": True, "te": [[0.0, 0.0, 0.0, 0.0]]}
CASES = {}


def case(make):
    """Register a function that returns (what, scene, start, phase, cycles[, options])."""
    CASES[make.__name__] = make
    return make


# --- curves: rows of phase, value, slope before, slope after ------------------------------------


def parabola(bend, kink=True):
    """g with g'' = bend (per period²) but for the kink at phase 0: bend (w² - w)/2."""
    return [[0.0, 0.0, bend / 2, -bend / 2]]


TRIANGLE = [[0.0, 0.0, -0.5, 0.5], [0.5, 0.25, 0.5, -0.5]]
# Three arcs of one bend with kinks between them: each throws a pressed tooth off, and again.
THREE_ARCS = [[0.0, 0.0, -1.5, 1.5], [0.375, 0.0, -1.5, 1.25], [0.6875, 0.0, -1.25, 1.25]]
SMOOTH = [[0.0, 0.0, 1.0, 1.0], [0.25, 0.5, 0.25, 0.25], [0.625, -0.25, -1.5, -1.5]]
SCENE_A = [[0.0, 0.0, 3.380e-3, 3.380e-3], [0.030, 6.525e-5, 9.70e-4, 9.70e-4],
           [0.850, 8.985e-5, -9.10e-4, -9.10e-4], [0.915, -2.80925e-5, -2.719e-3, -2.719e-3]]


def scaled(rows, factor):
    return [[row[0], *(factor * x for x in row[1:])] for row in rows]


def table_rows(te):
    """Rows of a table; a long one is named by its number of rows and its height."""
    if isinstance(te, list):
        return te
    rows = []
    for i in range(te["bump_rows"]):
        w = i / te["bump_rows"]
        slope = te["height"] * 32 * w * (1 - w) * (1 - 2 * w)
        rows.append([w, te["height"] * 16 * (w * (1 - w)) ** 2, slope, slope])
    return rows


def hermite(rows):
    """Cubic pieces through rows, in full precision."""
    pieces = []
    for this, after in zip(rows, [*rows[1:], [1.0, *rows[0][1:]]], strict=True):
        h = mpf(after[0]) - mpf(this[0])
        y0, y1, d0, d1 = mpf(this[1]), mpf(after[1]), mpf(this[3]) * h, mpf(after[2]) * h
        c = [y0, d0, 3 * (y1 - y0) - 2 * d0 - d1, 2 * (y0 - y1) + d0 + d1]
        pieces.append([mpf(this[0]), [c[k] / h**k for k in range(4)]])
    return {"kind": "pieces", "pieces": pieces}


# --- following a case in full precision ---------------------------------------------------------


def reference_scene(scene):
    """As exact_flow.py takes it; `scale` multiplies the curve."""
    known = {key: scene[key] for key in ("force", "damping_ratio", "restitution", "backlash",
                                         "contact_law", "impact_law", "gap", "back_flank_te")}
    return {**known, "mesh_frequency_ratio": 2 * mp.pi / mpf(scene["period"]),
            "gear_ratio": scene.get("scale", 1), "te": hermite(table_rows(scene["te"]))}


def follow(scene, start, phase, cycles):
    """Events and final state."""
    begin = {"phase": phase}
    if start != "rest":
        begin |= {"motion": FLANKS[start[0]], "phi": start[1], "velocity": start[2]}
    return exact_flow.simulate(reference_scene(scene), begin, cycles)


def changes(scene, start):
    """Every parameter in turn changed by 1e-25 of itself."""
    for key in ("force", "period", "damping_ratio", "restitution", "backlash"):
        if scene[key] and not (key == "restitution" and scene[key] == 1):
            yield {**scene, key: mpf(scene[key]) * (1 + CHANGE)}, start
    yield {**scene, "scale": 1 + CHANGE}, start
    if start != "rest":
        # On the flank and beyond the gap's own depth, phi stays where the case needs it.
        if start[0] == "separation" and start[1] not in (0, -scene["backlash"]):
            yield scene, (start[0], mpf(start[1]) * (1 + CHANGE), start[2])
        if start[0] == "engagement" and start[1]:
            yield scene, (start[0], mpf(start[1]) * (1 + CHANGE), start[2])
        yield scene, (*start[:2], mpf(start[2]) * (1 + CHANGE))


COLUMNS = ("tau", "phi", "velocity_before", "velocity_after")


def conditions(base, scene, start, phase, cycles, coincidence):
    """Condition of every column of every event that counts, and of the final state.

    At a coincidence, which any change undoes, there is none: zeros.
    """
    listed_events = listed(base, scene)
    events = [dict.fromkeys(COLUMNS, mpf(0)) for _ in listed_events]
    final = {"phi": mpf(0), "velocity": mpf(0)}
    names = [(e.kind, e.flank) for e in listed_events]
    for changed_scene, changed_start in () if coincidence else changes(scene, start):
        changed = follow(changed_scene, changed_start, phase, cycles)
        changed_events = listed(changed, changed_scene)
        if [(e.kind, e.flank) for e in changed_events] != names:
            raise ArithmeticError("a change of 1e-25 changes the events: the case is not certain")
        for row, one, other in zip(events, listed_events, changed_events, strict=True):
            for name in COLUMNS:
                row[name] += abs(getattr(other, name) - getattr(one, name)) / CHANGE
        for name in final:
            final[name] += abs(getattr(changed.final, name) - getattr(base.final, name)) / CHANGE
    return events, final


def text(x):
    return mp.nstr(x, DIGITS)


def size(x):
    return float(mp.nstr(x, 3))


def listed(base, scene):
    """The events that count: the last bounces of a complete chatter do not."""
    period = mpf(scene["period"])
    ends = [(e.flank, e.tau) for e in base.events if e.kind == "chatter_end"]
    return [e for e in base.events if not (e.kind == "impact" and any(
        e.flank == flank and 0 <= end - e.tau <= mpf("1e-6") * period for flank, end in ends))]


def record(name):
    """Follow a case, compare with its closed form, and return what is stored."""
    with mp.workdps(exact_flow.WORKING_DIGITS):
        what, scene, start, phase, cycles, *rest = CASES[name]()
        options = rest[0] if rest else {}
        scene = {**DEFAULTS, **scene}
        base = follow(scene, start, phase, cycles)
        rows, final = conditions(base, scene, start, phase, cycles,
                                 options.get("coincidence", False))
        closed = options.get("closed", {})
        for (kind, nth, column), value in closed.items():
            if kind == "final":
                found = getattr(base.final, column)
            else:
                same = [e for e in base.events if NAMES[e.kind, e.flank] == kind]
                found = getattr(same[nth], column)
            if abs(found - value) > AGREEMENT * max(1, abs(value)):
                raise ArithmeticError(f"{name}: {column} of {kind} {nth}: {found}, "
                                      f"by hand {value}")
        events = [{"kind": NAMES[event.kind, event.flank],
                   **{c: text(getattr(event, c)) for c in COLUMNS},
                   "condition": {c: size(row[c]) for c in COLUMNS}}
                  for event, row in zip(listed(base, scene), rows, strict=True)]
        kinds = options.get("kinds")
        if kinds is not None and [e["kind"] for e in events][:len(kinds) or None] != kinds:
            raise ArithmeticError(f"{name}: {[e['kind'] for e in events]}, by hand {kinds}")
        return {
            "what": what, "command": f"{COMMAND} {name}",
            "source": "60-digit integrator" + (", by hand: " + options["by"] if "by" in options
                                               else ""),
            "scene": scene, "start": start, "phase": phase, "cycles": cycles,
            "coincidence": options.get("coincidence", False),
            "events": events,
            "final": {"motion": MOTIONS[base.final.motion], "phi": text(base.final.phi),
                      "velocity": text(base.final.velocity),
                      "condition": {c: size(final[c]) for c in final}}}


def file_text(entry):
    """JSON with one event per line."""
    lines = []
    for key, part in entry.items():
        body = json.dumps(part)
        if key == "events" and part:
            body = "[\n  " + ",\n  ".join(json.dumps(row) for row in part) + "\n ]"
        lines.append(f" {json.dumps(key)}: {body}")
    return "{\n" + ",\n".join(lines) + "\n}\n"


def main(names):
    DATA.mkdir(exist_ok=True)
    for name in names or CASES:
        entry = record(name)
        (DATA / f"{name}.json").write_text(file_text(entry), encoding="utf-8")
        print(f"{name:38} {len(entry['events']):4} events, ends in {entry['final']['motion']}",
              flush=True)


if __name__ == "__main__":
    import hard_case_list  # noqa: F401  registers the cases

    sys.modules["make_hard_cases"].main(sys.argv[1:])
