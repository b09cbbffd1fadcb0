"""A pair and two curves as a measurement might give them: samples with seeded noise."""

import numpy as np

from lapwing import GearPair

ARCSEC = np.pi / 648_000
PAIR = GearPair(pinion_teeth=17, gear_teeth=43, pinion_inertia=0.0031, gear_inertia=0.11,
                pinion_base_lever=0.028, mesh_stiffness=2.2e8, backlash=0.003, restitution=0.7,
                damping_ratio=0.06)
OPERATION = {"pinion_speed_rpm": 400, "te_sign": "geometric"}
ROWS = 60
PHASE = np.arange(ROWS) / ROWS
NO_KINK, KINK = np.zeros(ROWS), (PHASE == 0).astype(float)
# T_full (N·m) of the curves themselves.
TRUTH = {"smooth": 0.574103476, "kinked": 5.562338646}


def curve(name, phase=PHASE):
    """The curve itself, rad."""
    first = 9 * np.cos(2 * np.pi * phase) if name == "smooth" else \
        12 * (1 / 3 - 4 * (phase - 0.5) ** 2)
    return ARCSEC * (first + 1.2 * np.cos(4 * np.pi * phase + 0.4))


def kinks(name):
    """Flags of its rows."""
    return KINK if name == "kinked" else NO_KINK


def samples(name, noise, seed):
    """Its samples (rad) with normal noise (arcsec)."""
    return curve(name) + noise * ARCSEC * np.random.default_rng([7, seed]).standard_normal(ROWS)


def oscillator(te, torque=1.0, **options):
    """The pair on a transmission error."""
    return PAIR.oscillator(te, brake_torque=torque, **{**OPERATION, **options})


def write_csv(path, name, noise, seed):
    """The samples as a file."""
    rows = zip(PHASE, samples(name, noise, seed) / ARCSEC, kinks(name), strict=True)
    path.write_text("phase,transmission_error[arcsec],kink\n" + "".join(
        f"{phase!r},{value!r},{flag:g}\n".replace("np.float64(", "").replace(")", "")
        for phase, value, flag in rows), encoding="utf-8")
