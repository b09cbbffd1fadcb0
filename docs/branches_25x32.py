"""Which motions rattle at the top of the shipped example's torques, and what ends each of them.

Run from the checkout: python docs/branches_25x32.py [RESULTS]
Takes some minutes, prints the stable ranges, writes RESULTS/branches_25x32.nc and .png.
"""

import sys
from pathlib import Path

import numpy as np

import lapwing
from lapwing.base.codes import SpecialPoint
from lapwing.plots.style import save

ROOT = Path(__file__).parents[1]
RESULTS = Path(sys.argv[1] if len(sys.argv) > 1 else "results")
# N·m; the seeds are 0.002 apart, each with the starts of a search for T_safe.
LOW, HIGH, SEEDS = 12.1, 12.5, 201


def diagram():
    """Branches of the shipped deck's gear under its own impact law."""
    te = lapwing.TransmissionError.from_file(ROOT / "inputs" / "te_25x32.csv")
    pair = lapwing.GearPair(pinion_teeth=25, gear_teeth=32, pinion_inertia=0.0078,
                            gear_inertia=0.026, pinion_base_lever=0.034, mesh_stiffness=3.12e8,
                            backlash=0.002, restitution=0.8, damping_ratio=0.1)
    return lapwing.branches(pair, te, low=LOW, high=HIGH, seeds=SEEDS, starts=lapwing.StartGrid(),
                            settle=800, doublings=3, pinion_speed_rpm=240,
                            impact_law="absolute")


def main():
    """Print, store, draw."""
    found = diagram()
    count = {name: int(found[f"seed_{name}"].sum())
             for name in ("motions", "engaged", "aperiodic", "failed")}
    print(f"{count['motions']} motions at {SEEDS} torques: {count['engaged']} engaged throughout, "
          f"{count['aperiodic']} without a period, {count['failed']} failed; "
          f"{found.attrs['lost']} that no branch begins with")
    print("stable from          to                   period  begins with       ends with")
    for k in np.argsort(found["range_high"].values):
        low, high = (float(found[f"range_{end}"][k]) for end in ("low", "high"))
        kinds = [SpecialPoint(int(found[f"range_{end}_kind"][k])).name.lower()
                 for end in ("low", "high")]
        print(f"{low:<20.12f} {high:<20.12f} {int(found['range_cycles'][k]):<7d} {kinds[0]:<17} "
              f"{kinds[1]}")
    RESULTS.mkdir(parents=True, exist_ok=True)
    found.to_netcdf(RESULTS / "branches_25x32.nc")
    save(found.lapwing.bifurcation(title="the 25 × 32 pair: motions that rattle above T_full"),
         RESULTS / "branches_25x32.png")


if __name__ == "__main__":
    main()
