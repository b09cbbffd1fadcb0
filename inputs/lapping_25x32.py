"""Braking torque of a 25 x 32 spiral bevel pair on the lapping machine, swept from 0.2 to 14 N·m.

Writes results/lapping_25x32/: orbit_diagram.png, table.md and sweep.nc. The pair is the one of the
published example; transmission error and speed, which the source does not give, are reconstructed
(docs/model.md, section "The published example").
"""

import sys
from pathlib import Path

import numpy as np

import lapwing
from lapwing.plots.orbit_diagram import orbit_diagram, save

TE_FILE = Path(__file__).with_name("te_25x32.csv")
RESULTS = Path("results") / "lapping_25x32"

PAIR = lapwing.GearPair(
    pinion_teeth=25, gear_teeth=32, pinion_inertia=0.0078, gear_inertia=0.026,
    pinion_base_lever=0.034, mesh_stiffness=3.12e8, backlash=0.002, restitution=0.8,
    damping_ratio=0.1)
OPERATION = {"pinion_speed_rpm": 240, "contact_law": "restitution", "impact_law": "absolute"}
TORQUES = np.round(np.linspace(0.2, 14, 691), 2)
RESPONSES = (0.8, 1.8, 3.3, 5.5, 12.0)

# What the source reports: torque, impacts per cycle, deepest separation, in words.
CLAIMS = {
    0.8: (None, None, "back impacts vanish above"),
    1.8: (3, 0.00063, "3 impacts per cycle, period 1"),
    3.3: (5, 0.00032, "5 impacts per cycle, period 1"),
    5.5: (7, 0.00017, "7 impacts per cycle, period 1"),
    12.0: (0, 0.0, "separation vanishes"),
}


def table_of_responses(te):
    """The source's five torques from rest, one line of the table each."""
    lines = ["| T_l (N·m) | impacts per cycle | back impacts | period | deepest separation (rad) "
             "| states | source |", "|---|---|---|---|---|---|---|"]
    responses = lapwing.sweep(PAIR, te, values=RESPONSES, starts=("rest",), settle=400,
                              record=100, rtol=1e-9, **OPERATION).sel(start="rest")
    for torque in RESPONSES:
        point = responses.sel(brake_torque=torque)
        _, depth, words = CLAIMS[torque]
        source = words if depth is None else f"{words}, depth {depth:g}"
        engaged_only = bool((point["states_visited"] == 1 << lapwing.MotionState.ENGAGEMENT).all())
        lines.append(
            f"| {torque:g} | {float(point['counted_impacts'].mean()):.4g} "
            f"| {float(point['back_impacts'].sum()):g} in 100 cycles "
            f"| {int(point['period']) or 'none'} "
            f"| {float(point['deepest_separation'].max()):.6f} "
            f"| {'engaged throughout' if engaged_only else 'separates'} | {source} |")
    return lines


def last_back_impact(sweep):
    """Largest torque at which any recorded cycle of any start saw a back impact."""
    seen = (sweep["back_impacts"].sum("recorded_cycle") > 0).any("start")
    return float(sweep["brake_torque"].where(seen).max())


def show_progress(fraction):
    """One line, rewritten, where somebody looks."""
    if sys.stderr.isatty():
        print(f"\r  sweep {100 * fraction:3.0f} %", end="" if fraction < 1 else "\n",
              file=sys.stderr, flush=True)


def main():
    """Run the sweep and write figure, table and data."""
    te = lapwing.TransmissionError.from_file(TE_FILE)
    RESULTS.mkdir(parents=True, exist_ok=True)
    full = lapwing.critical_torque(PAIR.oscillator(te, brake_torque=1.0, **OPERATION))
    print("Sweeping the braking torque: from rest, upwards, downwards ...")
    sweep = lapwing.sweep(PAIR, te, values=TORQUES, settle=400, record=100,
                          progress=show_progress, **OPERATION)
    claims = [(torque, depth, f"source: {depth:g} rad") for torque, (_, depth, _) in CLAIMS.items()
              if depth]
    figure = orbit_diagram(
        sweep, title="25 × 32 pair, 240 rpm, reconstructed transmission error: "
                     "lapping under a braking torque",
        full_engagement=full[0], claims=claims)
    save(figure, RESULTS / "orbit_diagram.png")
    sweep.to_netcdf(RESULTS / "sweep.nc")
    failed = int((sweep["status"] != lapwing.Status.OK).sum())
    lines = ["# 25 × 32 pair, from rest, after 400 mesh cycles, over 100 more", "",
             *table_of_responses(te), "",
             f"- last back impact seen in the sweeps at {last_back_impact(sweep):g} N·m",
             f"- the engaged response stays in contact from {full[0]:.12g} N·m "
             f"(contact first lost at mesh phase {full[1]:.9f})",
             f"- impacts counted: after flights deeper than {sweep.attrs['count_depth']:g} of "
             "their cycle's deepest separation",
             f"- {sweep['status'].size} sweep points, {failed} failed", ""]
    (RESULTS / "table.md").write_text("\n".join(lines), encoding="utf-8")
    print("\n".join(lines))
    print(f"Written: {RESULTS}/orbit_diagram.png, table.md, sweep.nc")


if __name__ == "__main__":
    main()
