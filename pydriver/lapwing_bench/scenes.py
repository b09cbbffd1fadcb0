"""The scenes of the benchmark: the source's gear, from rest at phase 0, 50 mesh cycles."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from lapwing.model.gear_pair import GearPair
from lapwing.model.transmission_error import TransmissionError

PAIR = GearPair(pinion_teeth=25, gear_teeth=32, pinion_inertia=0.0078, gear_inertia=0.026,
                pinion_base_lever=0.034, mesh_stiffness=3.12e8, backlash=0.002,
                restitution=0.8, damping_ratio=0.1)
SHORT, LONG = 3, 50
TORQUES = tuple(float(torque) for torque in np.linspace(0.5, 14.0, 64))
# The four parabolic arcs of inputs/te_25x32.csv: phase, rad, rad per period.
SHIPPED_ROWS = ((0.0, 0.0, 3.380e-3), (0.030, 6.525e-5, 9.70e-4), (0.850, 8.985e-5, -9.10e-4),
                (0.915, -2.80925e-5, -2.719e-3))


@dataclass(frozen=True, kw_only=True)
class BenchScene:
    """One scene of the benchmark.

    Parameters
    ----------
    name, title : str
    te : TransmissionError
    mesh_frequency_hz : float, Hz
    contact_law, impact_law : str, as `Oscillator` takes them
    torques : tuple of float, N·m
    swept : (float, float), N·m, least and greatest torque of a sweep
    """

    name: str
    title: str
    te: TransmissionError = field(repr=False)
    mesh_frequency_hz: float
    contact_law: str = "restitution"
    impact_law: str = "relative"
    torques: tuple = field(default=TORQUES, repr=False)
    swept: tuple = (TORQUES[0], TORQUES[-1])

    def oscillator(self, torque):
        """The dimensionless oscillator at one braking torque (N·m)."""
        return PAIR.oscillator(self.te, brake_torque=torque,
                               mesh_frequency_hz=self.mesh_frequency_hz,
                               contact_law=self.contact_law, impact_law=self.impact_law)

    @cached_property
    def oscillators(self):
        """One oscillator for each torque."""
        return [self.oscillator(torque) for torque in self.torques]

    @property
    def is_series(self):
        """Whether the transmission error is a harmonic series (the table only stands for it)."""
        return len(self.te.harmonics) > 0

    def at(self, torques):
        """The same scene at other torques (N·m)."""
        return replace(self, torques=tuple(torques))


def harmonic(amplitude):
    """Δφ = amplitude·cos(2π·phase), rad."""
    return TransmissionError.harmonic([amplitude])


def parabola_kinked_at_half(amplitude):
    """Δφ = -4·amplitude·u², u from -½ to ½ periods about phase 0, kinked at phase ½."""
    arcs = np.zeros((2, 6))
    arcs[0, 2] = -4 * amplitude
    arcs[1, :3] = -amplitude, 4 * amplitude, -4 * amplitude
    return TransmissionError([0.0, 0.5, 1.0], arcs, [False, True])


def shipped():
    """The reconstructed transmission error of the published pair."""
    return TransmissionError.from_hermite(*np.array(SHIPPED_ROWS).T)


SCENES = {scene.name: scene for scene in (
    BenchScene(name="S1", title="compliant, harmonic 50 µrad, 300 Hz, never leaves contact",
               te=harmonic(5e-5), mesh_frequency_hz=300.0, contact_law="compliant",
               torques=(12.0,), swept=(8.0, 14.0)),
    BenchScene(name="S2", title="compliant, harmonic 100 µrad, 600 Hz",
               te=harmonic(1e-4), mesh_frequency_hz=600.0, contact_law="compliant"),
    BenchScene(name="S3", title="restitution, harmonic 100 µrad, 300 Hz",
               te=harmonic(1e-4), mesh_frequency_hz=300.0),
    BenchScene(name="S3b", title="restitution, harmonic 300 µrad, 300 Hz",
               te=harmonic(3e-4), mesh_frequency_hz=300.0),
    BenchScene(name="S4", title="restitution, kinked parabola 50 µrad, 800 Hz",
               te=parabola_kinked_at_half(5e-5), mesh_frequency_hz=800.0),
    BenchScene(name="A", title="the shipped example: absolute impact law, 100 Hz",
               te=shipped(), mesh_frequency_hz=100.0, impact_law="absolute"),
)}
