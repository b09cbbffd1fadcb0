"""Reference numbers from the engine's own sources compiled in quadruple precision.

    python tests/reference/quadruple.py            write data/quadruple/*.json
    python tests/reference/quadruple.py check      compare with every run of the 60-digit code
    python tests/reference/quadruple.py check rk4  the same by Runge-Kutta, minutes

All build the program first (Meson and a Fortran compiler are needed; nothing is installed).
"""

from __future__ import annotations

import fcntl
import json
import os
import subprocess
import sys
from pathlib import Path

from exact_flow import dimensionless, flank_pieces, te_pieces
from make_reference import GEAR, run_text
from mpmath import mp, mpf

HERE = Path(__file__).resolve().parent
ROOT = HERE.parents[1]
DATA = HERE / "data"
COMMAND = "python tests/reference/quadruple.py"
PROGRAM = "follow_in_quadruple"
STORED_DIGITS = 33

LAWS = {"contact_law": {"restitution": 1, "compliant": 2, "rigid": 3},
        "impact_law": {"relative": 1, "absolute": 2},
        "gap": {"one_sided": 1, "symmetric": 2, "one_flank": 3}}
METHODS = {"rk4": 1, "exact": 2}
MOTIONS = ["separation", "drive", "coast"]
KINDS = ["impact", "release", "engage", "chatter_end"]

# Of 'rk4', per step, and relative. It takes some 1e5 steps per unit of tau then; its
# errors stay below 1e-19 of a mesh period, far below what a double can show.
TOLERANCE = "1e-18"
# Of the end of a complete chatter, mesh periods.
CHATTER_TOLERANCE = "1e-26"
# Relative; far above the error of the two runs whose difference tells how errors grow.
TORQUE_CHANGE = {"exact": "1e-22", "rk4": "1e-12"}
# Quintic Hermite pieces per mesh period of order 1 that stand for a harmonic series: the remainder
# (2 pi/n)**6/46080 is 3e-24 of the amplitude.
PIECES_PER_ORDER = 8192
COARSE_PIECES = 16


def build(folder=ROOT / "build" / "quadruple"):
    """Compile the program, one process at a time; its path."""
    folder.parent.mkdir(exist_ok=True)
    with open(folder.with_name(f"lock-{folder.name}"), "w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        if not (folder / "build.ninja").exists():
            run_quietly("meson", "setup", "-Dbuildtype=release", folder, cwd=ROOT)
        run_quietly("meson", "compile", "-C", folder, PROGRAM)
    return folder / "tests" / "reference" / PROGRAM


def run_quietly(*command, **options):
    """Run a program that may lie beside this Python; leave with what it says if it fails."""
    path = os.pathsep.join([str(Path(sys.executable).parent), os.environ.get("PATH", "")])
    done = subprocess.run([str(c) for c in command], capture_output=True, text=True,
                          env={**os.environ, "PATH": path}, **options)
    if done.returncode:
        sys.exit(done.stdout + done.stderr)


def number(x):
    """More digits than quadruple precision has."""
    return mp.nstr(mpf(x), 42, strip_zeros=False, min_fixed=1, max_fixed=0)


def harmonic_pieces(terms, pieces_per_order):
    """Quintic Hermite pieces of a series of (order, amplitude, shift)."""
    count = pieces_per_order * max(int(order) for order, _, _ in terms)
    rows = []
    for i in range(count):
        phase = mpf(i) / count
        rows.append([phase] + [sum(
            mpf(a) * (2 * mp.pi * int(n)) ** k
            * mp.cos(2 * mp.pi * int(n) * phase + mpf(shift) + k * mp.pi / 2)
            for n, a, shift in terms) for k in range(3)])
    return {"kind": "quintic_hermite", "rows": rows}


def table_lines(scene, numbers, method):
    """One line per piece: phase, six coefficients, 1 at a kink; and the range of g.

    The closed form moves on a series itself: the table beside it only shows its range.
    """
    te = scene["te"]
    smooth = te["kind"] == "harmonic"
    if smooth:
        te = harmonic_pieces(te["terms"], PIECES_PER_ORDER if method == "rk4" else COARSE_PIECES)
    pieces = te_pieces(te)
    kinks = [False] * len(pieces)
    if not smooth:
        kinks = [p.slope_jump != 0
                 for p in flank_pieces(scene, numbers["gear_ratio"], numbers["period"])]
    lines, values = [], []
    ends = [phase for phase, _ in pieces[1:]] + [mpf(1)]
    for (phase, c), end, kink in zip(pieces, ends, kinks, strict=True):
        c = list(c) + [mpf(0)] * (6 - len(c))
        lines.append(" ".join([number(phase), *(number(x) for x in c), str(int(kink))]))
        # Only the size of tolerances depends on the range: eight points a piece show it.
        values += [mp.polyval(c[::-1], (end - phase) * k / 8) for k in range(8)]
    return lines, numbers["gear_ratio"] * (max(values) - min(values))


def start_numbers(start):
    """Motion state (-1: rest), phi, phi', phase."""
    start = {} if start == "rest" else start
    state = MOTIONS.index(start["motion"]) if "motion" in start else -1
    return [state, start.get("phi", 0), start.get("velocity", 0), start.get("phase", 0)]


def case_text(scene, start, cycles, method, tolerance):
    """The program's input."""
    numbers = dimensionless(scene)
    terms = scene["te"].get("terms", [])
    lines, peak_to_peak = table_lines(scene, numbers, method)
    lines += [" ".join(number(x) for x in term) for term in terms]
    sign = -1 if scene.get("te_sign", "printed") == "geometric" else 1
    case = {
        "force": number(numbers["force"]),
        "mesh_frequency_ratio": number(numbers["mesh_frequency_ratio"]),
        "flank_scale": number(sign * numbers["gear_ratio"]),
        "peak_to_peak": number(peak_to_peak),
        "damping_ratio": number(numbers["damping_ratio"]),
        "restitution": number(scene["restitution"]),
        "backlash": number(scene["backlash"]),
        "tolerance": number(tolerance),
        "chatter_tolerance": number(CHATTER_TOLERANCE),
        **{key: codes[scene.get(key, next(iter(codes)))] for key, codes in LAWS.items()},
        "back_flank_te": int(scene.get("back_flank_te", True)),
        "method": METHODS[method],
        "start": ", ".join(number(x) for x in start_numbers(start)),
        "cycles": cycles,
        "pieces": len(lines) - len(terms),
        "terms": len(terms),
    }
    head = [f"  {key} = {value}" for key, value in case.items()]
    return "\n".join(["&case", *head, "/", *lines, ""])


def event_name(code):
    if code == 9:
        return "kink", "none"
    return KINDS[(code - 1) // 2], ("drive", "coast")[(code - 1) % 2]


def read_result(text, phase):
    """Events, states at the beginnings of cycles and at the end, as mpmath numbers."""
    rows = [line.split() for line in text.splitlines()]
    period = next(mpf(row[1]) for row in rows if row[0] == "period")
    result = {"period": period, "events": [], "cycle_states": []}
    for row in rows:
        if row[0] == "event":
            kind, flank = event_name(int(row[1]))
            t, phi, before, after = (mpf(x) for x in row[3:])
            result["events"].append({
                "tau": (int(row[2]) - phase) * period + t, "kind": kind, "flank": flank,
                "phi": phi, "velocity_before": before, "velocity_after": after})
        elif row[0] == "cycle":
            phi, velocity, deepest = (mpf(x) for x in row[3:])
            result["cycle_states"].append({
                "cycle": int(row[1]), "motion": MOTIONS[int(row[2])], "phi": phi,
                "velocity": velocity, "deepest_separation": deepest})
        elif row[0] == "final":
            phi, velocity = mpf(row[5]), mpf(row[6])
            result["final"] = {"status": int(row[1]), "cycle": int(row[2]),
                               "motion": MOTIONS[int(row[3])], "phi": phi, "velocity": velocity}
    return result


def follow(program, scene, start="rest", cycles=1, method="exact", tolerance=TOLERANCE):
    """Follow a scene as `exact_flow.simulate` takes it, in quadruple precision.

    Parameters
    ----------
    program : path that `build` returned
    scene : dict of decimal strings or doubles, as in exact_flow.py; the transmission error may
        also be {"kind": "harmonic", "terms": [[order, amplitude, shift], ...]}
    start : 'rest', or a dict of phase and, unless at rest, motion, phi and velocity
    cycles : int, followed to phase 0 of this cycle
    method : 'rk4' or 'exact'
    tolerance : relative, per step of 'rk4'

    Returns
    -------
    dict: period, events, cycle_states, final; numbers are mpf of 35 digits
    """
    with mp.workdps(50):
        text = case_text(scene, start, cycles, method, tolerance)
        done = subprocess.run([str(program)], input=text, capture_output=True, text=True)
        if done.returncode:
            raise RuntimeError(done.stderr)
        phase = mpf(0 if start == "rest" else start.get("phase", 0))
        return read_result(done.stdout, phase)


# --- stored runs: what the 60-digit code cannot take, a series instead of a table ---------------


def speed_of(frequency_hz):
    """Pinion speed in rpm of 25 teeth, as a decimal string."""
    return mp.nstr(mpf(frequency_hz) * 60 / 25, 30)


def harmonic_scene(amplitude, frequency_hz, torque, **laws):
    return {**GEAR, "pinion_speed_rpm": speed_of(frequency_hz), "brake_torque": torque,
            "te": {"kind": "harmonic", "terms": [["1", amplitude, "0"]]}, **laws}


SMOOTH = {"kind": "harmonic", "terms": [["1", "17e-6", "0"], ["2", "4.5e-6", "1"],
                                        ["3", "1.5e-6", "2"]]}
COMPLIANT = {"contact_law": "compliant"}
BOUNCING = {"contact_law": "restitution", "impact_law": "relative"}
FILES = {
    "harmonic_compliant": [
        ("engaged", harmonic_scene("5e-5", 300, "12", **COMPLIANT), 3),
        ("rattling", harmonic_scene("1e-4", 600, "5", **COMPLIANT), 3)],
    "harmonic_restitution": [
        ("small", harmonic_scene("1e-4", 300, "2", **BOUNCING), 3),
        ("large", harmonic_scene("3e-4", 300, "5", **BOUNCING), 3),
        ("three_terms", {**GEAR, "pinion_speed_rpm": "1500", "brake_torque": "4", "te": SMOOTH,
                         **BOUNCING}, 3)],
}


def stored(entry):
    """Numbers as strings of the digits they have."""
    if isinstance(entry, dict):
        return {key: stored(x) for key, x in entry.items()}
    if isinstance(entry, list):
        return [stored(x) for x in entry]
    return mp.nstr(entry, STORED_DIGITS) if isinstance(entry, mpf) else entry


def with_growth(program, scene, cycles, method, tolerance):
    """A run, and for each event |d tau / d ln T|; null from the first that has no counterpart."""
    run = follow(program, scene, "rest", cycles, method, tolerance)
    change = mpf(TORQUE_CHANGE[method])
    torque = mpf(scene["brake_torque"]) * (1 + change)
    other = follow(program, {**scene, "brake_torque": torque}, "rest", cycles, method, tolerance)
    alike = True
    for i, event in enumerate(run["events"]):
        pair = other["events"][i] if i < len(other["events"]) else {"kind": None, "flank": None}
        alike &= (event["kind"], event["flank"]) == (pair["kind"], pair["flank"])
        event["growth"] = mp.nstr(abs(pair["tau"] - event["tau"]) / change, 5) if alike else None
    return run


def write_files(program, method, tolerance):
    folder = DATA / "quadruple"
    folder.mkdir(parents=True, exist_ok=True)
    for stem, cases in FILES.items():
        runs = [run_text({"name": name, "scene": scene, "start": "rest", "cycles": cycles,
                          **stored(with_growth(program, scene, cycles, method, tolerance))})
                for name, scene, cycles in cases]
        head = {"command": COMMAND + ("" if method == "exact" else f" {method}"), "method": method}
        lines = [f"{json.dumps(key)}: {json.dumps(entry)}" for key, entry in head.items()]
        lines.append('"runs": [\n' + ",\n".join(runs) + "\n]")
        path = folder / f"{stem}.json"
        path.write_text("{\n" + ",\n".join(lines) + "\n}\n", encoding="utf-8")
        print(path.relative_to(ROOT))


# --- check against the 60-digit code --------------------------------------------------------------

# Bounces this near to the end of a complete chatter, in mesh periods, are listed by convention.
CHATTER_TAIL = mpf("1e-6")


def without_tails(events, period):
    """Events but the last bounces of each complete chatter."""
    ends = [(e["flank"], e["tau"]) for e in events if e["kind"] == "chatter_end"]
    return [e for e in events if not (e["kind"] == "impact" and any(
        flank == e["flank"] and 0 <= end - e["tau"] < CHATTER_TAIL * period
        for flank, end in ends))]


def compare_run(program, run, method="exact", tolerance=TOLERANCE):
    """Largest |difference of event times| in mesh periods, and in units of (P + growth).

    Raises ValueError where the event lists differ.
    """
    own = follow(program, run["scene"], run["start"], run["cycles"], method, tolerance)
    period = own["period"]
    with mp.workdps(50):
        theirs = [{**e, "tau": mpf(e["tau"])} for e in run["events"]]
        pairs = [without_tails(events, period) for events in (own["events"], theirs)]
        names = [[(e["kind"], e["flank"]) for e in events] for events in pairs]
        if names[0] != names[1]:
            raise ValueError(f"{run['name']}: the event lists differ")
        largest, scaled = mpf(0), mpf(0)
        for one, other in zip(*pairs, strict=True):
            error = abs(one["tau"] - other["tau"])
            growth = mpf(other["growth"]) if other["growth"] is not None else mpf("inf")
            largest = max(largest, error / period)
            scaled = max(scaled, error / (period + growth))
        return len(pairs[0]), largest, scaled


def reference_runs():
    """Every stored run of the 60-digit code: (file stem, run)."""
    for path in sorted(DATA.glob("*.json")):
        for run in json.loads(path.read_text(encoding="utf-8"))["runs"]:
            yield path.stem, run


def check(program, method, tolerance):
    print("run, events, largest difference of event times: in mesh periods; over (P + growth)")
    for stem, run in reference_runs():
        count, largest, scaled = compare_run(program, run, method, tolerance)
        print(f"{stem:22} {run['name']:14} {count:5} {mp.nstr(largest, 2):>9} "
              f"{mp.nstr(scaled, 2):>9}", flush=True)


def main(arguments):
    mp.dps = 50
    method = "rk4" if "rk4" in arguments else "exact"
    program = build()
    if "check" in arguments:
        check(program, method, TOLERANCE)
    else:
        write_files(program, method, TOLERANCE)


if __name__ == "__main__":
    main(sys.argv[1:])
