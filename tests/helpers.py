"""What several test files share: gears, scenes, and short ways to read a run."""

import math
from pathlib import Path

import numpy as np

from lapwing import (
    EventKind,
    GearPair,
    MotionState,
    Oscillator,
    TransmissionError,
    critical_torque,
)
from lapwing.engine import flank_motion

ROOT = Path(__file__).parents[1]
EPS = float(np.finfo(float).eps)
PAIR = GearPair(25, 32, 0.0078, 0.026, 0.034, 3.12e8, 0.002, 0.8, damping_ratio=0.1)
SHIPPED = TransmissionError.from_file(ROOT / "inputs" / "te_25x32.csv")
COSINE = TransmissionError.harmonic([1.0])
FLAT = TransmissionError.from_hermite([0.0], [0.0], [0.0])


def scene_a(torque, impact_law="absolute", **options):
    """The published gear, reconstructed (docs/model.md, section 8)."""
    return PAIR.oscillator(SHIPPED, brake_torque=torque, pinion_speed_rpm=240,
                           impact_law=impact_law, **options)


def scene_c(torque, **options):
    """A smooth transmission error of three harmonics at 1500 rpm."""
    te = TransmissionError.harmonic([17e-6, 4.5e-6, 1.5e-6], [0.0, 1.0, 2.0], [1, 2, 3])
    return PAIR.oscillator(te, brake_torque=torque, pinion_speed_rpm=1500, **options)


def scene_d(torque, **options):
    """The parabola with one kink at 480 rpm."""
    return PAIR.oscillator(TransmissionError.parabola(125e-6), brake_torque=torque,
                           pinion_speed_rpm=480, **options)


def oscillator(te=FLAT, *, force=1.0, period=1000.0, restitution=0.8, backlash=1e3, **options):
    """A dimensionless oscillator; unless told otherwise on a flat table in a wide gap."""
    return Oscillator(te, force=force, mesh_frequency_ratio=2 * np.pi / period,
                      restitution=restitution, backlash=backlash, **options)


def ball(gamma, restitution, contact_law="restitution", **options):
    """The bouncing ball g = cos u, Ω = 1, Γ = 1/F; the damping of a contact that never is."""
    return oscillator(COSINE, force=1 / gamma, period=2 * math.pi, restitution=restitution,
                      contact_law=contact_law, **{"damping_ratio": 0.1, **options})


def ball_start(gamma, restitution, n=1):
    """Its stable orbit with one impact every n cycles, at phase 0 after the impact."""
    angle = math.pi - math.asin(n * math.pi * (1 - restitution) / (1 + restitution) / gamma)
    speed = n * 2 * math.pi / gamma / (1 + restitution)
    time = 2 * math.pi - angle
    theta_dot = -math.sin(angle) - restitution * speed
    theta = math.cos(angle) + time * (theta_dot + 0.5 * time / gamma)
    return MotionState.SEPARATION, theta - 1.0, theta_dot + time / gamma


def one_impact_orbits(osc, n):
    """(φ, φ', trace) at phase 0 of the orbits with one impact every n cycles, exactly.

    They strike where -g' = (nPF/2)(1 - ε)/(1 + ε); the trace is 1 + ε² - (1 + ε)² g''/F.
    """
    restitution, force, period = osc.restitution, osc.force, osc.period
    slope = n * period * force / 2 * (1 - restitution) / (1 + restitution)
    t = np.linspace(0, period, 4097)[:-1]
    excess = -flank_motion(osc, t)[1] - slope
    for k in np.flatnonzero(np.diff(np.sign(excess))):
        low, high = t[k], t[k + 1]
        for _ in range(60):
            middle = (low + high) / 2
            same = (-flank_motion(osc, [middle])[1, 0] - slope) * excess[k] > 0
            low, high = (middle, high) if same else (low, middle)
        (g, rate, bend), (g0, rate0, _) = flank_motion(osc, [low, 0.0]).T
        left, speed = period - low, rate - restitution * n * period * force / (1 + restitution)
        trace = 1 + restitution**2 - (1 + restitution) ** 2 * bend / force
        yield (g + speed * left + force * left**2 / 2 - g0, speed + force * left - rate0, trace)


def as_in_a_deck(sweep):
    """A sweep of scene A's torque with what a deck's run knows besides: complete engagement."""
    torque, phase = critical_torque(scene_a(1.0))
    return sweep.assign_attrs(full_engagement=torque, full_engagement_phase=phase)


def kinds(run):
    """Event kinds of a run in order."""
    return [EventKind(k) for k in run.events["kind"].values]


def events(run, *wanted):
    """Events of the wanted kinds, as a dict of arrays."""
    rows = np.isin(run.events["kind"].values, [int(k) for k in wanted])
    return {name: run.events[name].values[rows] for name in run.events}


def dataset_bytes(dataset):
    """Every number of a dataset, bit for bit."""
    return {name: (array.dtype.str, array.values.tobytes())
            for name, array in dataset.variables.items()}


def plane_deck(y_count, settle_cycles, shard_runs):
    """Text of a deck with one map, `plane`: 4 speeds and so many torques, all of which rattle."""
    return f"""
&gear_pair
  pinion_teeth = 25, gear_teeth = 32
  pinion_inertia = 0.0078, gear_inertia = 0.026
  pinion_base_lever = 0.034, mesh_stiffness = 3.12e8, backlash = 0.002
  restitution = 0.8, damping_ratio = 0.1
/
&transmission_error harmonic_amplitude = 17e-6, 4.5e-6, 1.5e-6, harmonic_shift = 0, 1, 2 /
&map
  name = 'plane'
  x_parameter = 'pinion_speed_rpm', x_from = 1500, x_to = 2100, x_count = 4
  y_from = 4, y_to = 9, y_count = {y_count}
  settle_cycles = {settle_cycles}
  shard_runs = {shard_runs}
/
"""


def plane_numbers(result):
    """Checksums of the variables of `plane_deck`'s map in a result file.

    How the work was cut short is no part of them.
    """
    from lapwing.results import checksums

    return {name: one for name, one in checksums(result).items() if name.startswith("/map_plane/")}
