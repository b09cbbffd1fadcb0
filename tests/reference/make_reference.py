"""Write tests/reference/data/*.json with the high-precision integrator of exact_flow.py.

Command (from the repository root): python tests/reference/make_reference.py [file stem ...]
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

from exact_flow import WORKING_DIGITS, dimensionless, simulate
from mpmath import mp, mpf

COMMAND = "python tests/reference/make_reference.py"
DATA = Path(__file__).resolve().parent / "data"
STORED_DIGITS = 30
GROWTH_DIGITS = 5
TORQUE_CHANGE = "1e-25"  # relative; far above the rounding of 60 digits, far below any event gap
ANCHOR_IMPACT = 20

GEAR = {
    "pinion_inertia": "0.0078",
    "gear_inertia": "0.026",
    "pinion_teeth": "25",
    "gear_teeth": "32",
    "mesh_stiffness": "3.12e8",
    "pinion_base_lever": "0.034",
    "damping_ratio": "0.1",
    "backlash": "0.002",
    "restitution": "0.8",
    "gap": "one_sided",
    "back_flank_te": True,
    "te_sign": "printed",
}
TE_25X32 = {  # scenes/te_25x32.csv: phase (periods), TE (rad), slope (rad per period)
    "kind": "cubic_hermite",
    "rows": [
        ["0.000", "0.0", "3.380e-3"],
        ["0.030", "6.525e-5", "9.70e-4"],
        ["0.850", "8.985e-5", "-9.10e-4"],
        ["0.915", "-2.80925e-5", "-2.719e-3"],
    ],
}
# -125 urad 4 (phase - 1/2)^2, in powers of the phase; its only kink is at phase 0
TE_PARABOLA = {"kind": "pieces", "pieces": [["0", ["-125e-6", "500e-6", "-500e-6"]]]}

SCENE_A = {**GEAR, "pinion_speed_rpm": "240", "te": TE_25X32}
SCENE_D = {**GEAR, "pinion_speed_rpm": "480", "te": TE_PARABOLA}
ABSOLUTE = {"contact_law": "restitution", "impact_law": "absolute"}
RELATIVE = {"contact_law": "restitution", "impact_law": "relative"}
COMPLIANT = {"contact_law": "compliant", "impact_law": "relative"}
RIGID = {"contact_law": "rigid", "impact_law": "relative"}
STANDING = {"back_flank_te": False}


def cases(name, scene, laws, torques, cycles):
    scene = {**scene, **laws}
    return [(f"{name}_{t}", {**scene, "brake_torque": t}, cycles) for t in torques]


FILES = {
    "scene_a_absolute": cases("a", SCENE_A, ABSOLUTE, ["0.5", "1.8", "3.3", "5.5", "12"], 12),
    "scene_a_relative": cases("a", SCENE_A, RELATIVE, ["0.8", "1.8", "5.5"], 6),
    "scene_d_kinked": cases("d", SCENE_D, RELATIVE, ["2", "5.5", "8"], 8),
    "compliant": cases("a", SCENE_A, COMPLIANT, ["0.8", "3.3"], 8),
    "rigid": cases("a", SCENE_A, RIGID, ["1.8", "5.5"], 8)
    + cases("d", SCENE_D, RIGID, ["2", "5.5", "8"], 8),
    "back_flank_standing": cases("absolute", SCENE_A, {**ABSOLUTE, **STANDING}, ["0.3"], 6)
    + cases("relative", SCENE_A, {**RELATIVE, **STANDING}, ["0.3"], 6),
}


def text(x, digits=STORED_DIGITS):
    return mp.nstr(x, digits) if isinstance(x, mpf) else x


def growth_of(events, changed):
    """|d tau / d ln T| of each event; None from the first event that has no counterpart."""
    growth = []
    for this, other in zip(events, changed, strict=False):
        if (this.kind, this.flank) != (other.kind, other.flank):
            break
        growth.append(abs(other.tau - this.tau) / mpf(TORQUE_CHANGE))
    return growth + [None] * (len(events) - len(growth))


def event_record(event, growth):
    record = {name: text(x) for name, x in event._asdict().items()}
    record["growth"] = text(growth, GROWTH_DIGITS)
    return record


def run_record(name, scene, cycles):
    trajectory = simulate(scene, "rest", cycles)
    torque = mpf(scene["brake_torque"]) * (1 + mpf(TORQUE_CHANGE))
    changed = simulate({**scene, "brake_torque": torque}, "rest", cycles)
    growth = growth_of(trajectory.events, changed.events)
    numbers = dimensionless(scene)
    record = {
        "name": name,
        "scene": scene,
        "start": "rest",
        "cycles": cycles,
        "dimensionless": {key: text(x) for key, x in numbers.items()},
        "dimensionless_double": {key: repr(float(x)) for key, x in numbers.items()},
    }
    impacts = [e for e in trajectory.events if e.kind == "impact"]
    if len(impacts) >= ANCHOR_IMPACT:
        record["twentieth_impact_tau"] = text(impacts[ANCHOR_IMPACT - 1].tau)
    record["cycle_states"] = [
        {key: text(x) for key, x in s._asdict().items()} for s in trajectory.cycle_states
    ]
    record["events"] = [event_record(*pair)
                        for pair in zip(trajectory.events, growth, strict=True)]
    return record


def run_text(record):
    """JSON with one event or cycle state per line, so that a difference shows as one line."""
    lines = []
    for key, entry in record.items():
        if key in ("events", "cycle_states"):
            rows = ",\n   ".join(json.dumps(row) for row in entry)
            body = f"[\n   {rows}\n  ]" if entry else "[]"
        else:
            body = json.dumps(entry)
        lines.append(f"  {json.dumps(key)}: {body}")
    return " {\n" + ",\n".join(lines) + "\n }"


def write_file(stem):
    runs = [run_record(*case) for case in FILES[stem]]
    head = {
        "command": f"{COMMAND} {stem}",
        "working_digits": WORKING_DIGITS,
        "growth": "|d tau / d ln(brake_torque)| per event, null once the event lists differ",
    }
    lines = [f"{json.dumps(key)}: {json.dumps(entry)}" for key, entry in head.items()]
    lines.append('"runs": [\n' + ",\n".join(run_text(run) for run in runs) + "\n]")
    DATA.mkdir(exist_ok=True)
    (DATA / f"{stem}.json").write_text("{\n" + ",\n".join(lines) + "\n}\n", encoding="utf-8")
    return runs


def main(stems):
    mp.dps = WORKING_DIGITS  # differences of event times are taken outside `simulate`
    for stem in stems or FILES:
        for run in write_file(stem):
            print(stem, run["name"], len(run["events"]), "events")


if __name__ == "__main__":
    main(sys.argv[1:])
