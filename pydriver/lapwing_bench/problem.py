"""The scene as a rival is given it: plain doubles, time in τ, φ relative to the drive flank."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

# A pressed tooth sticks at the first rebound slower than this part of (peak-to-peak g)·Ω.
STICKING = 1e-6


@dataclass(frozen=True)
class Arc:
    """A stretch of the flank's motion up to the next kink or step of its curvature.

    g'' is `curvature`, constant in a parabolic arc; in a harmonic series it is evaluated.

    Parameters
    ----------
    begin, end : float, τ; in `Problem.arcs` of the first cycle, before which an arc may begin
    slope, curvature : float, g' (rad per τ) at `begin` and g'' (rad per τ²)
    jump : float, jump of g' at `begin`
    """

    begin: float
    end: float
    slope: float
    curvature: float
    jump: float


@dataclass(frozen=True)
class Problem:
    """One operating point.

    Parameters
    ----------
    force : float, F, rad
    omega, period : float, Ω and 2π/Ω
    xi, restitution, backlash : float
    compliant, absolute : bool, contact and impact law
    sticking : float, rad per τ; see `STICKING`
    angle, speed : float, natural sizes of angles (rad) and velocities (rad per τ)
    amplitude : float, rad; of the harmonic g = amplitude·cos(Ωτ), 0 with arcs
    arcs : tuple of Arc, in order from the one that holds phase 0; empty with a harmonic
    """

    force: float
    omega: float
    period: float
    xi: float
    restitution: float
    backlash: float
    compliant: bool
    absolute: bool
    sticking: float
    angle: float
    speed: float
    amplitude: float
    arcs: tuple

    @lru_cache(maxsize=8)  # noqa: B019 - a handful of small tuples
    def arc_list(self, cycles):
        """(τ at the end, arc) of every arc from τ = 0 to the end of the last cycle."""
        end = cycles * self.period
        if not self.arcs:
            return ((end, Arc(0.0, end, 0.0, 0.0, 0.0)),)
        found = []
        for cycle in range(cycles + 1):
            before = cycle * self.period
            found += [replace(arc, begin=before + arc.begin, end=before + arc.end)
                      for arc in self.arcs if before + arc.begin < end]
        return tuple((min(arc.end, end), arc) for arc in found)

    def stretches(self, begin, end):
        """(begin, end, arc) of every smooth stretch between two times."""
        cycles = math.ceil(end / self.period + 1)
        found, before = [], 0.0
        for stop, arc in self.arc_list(cycles):
            if stop > begin and before < end:
                found.append((max(before, begin), min(stop, end), arc))
            before = stop
        return found

    def arc_at(self, tau):
        """The arc that holds τ."""
        return self.stretches(tau, tau * (1 + 1e-15) + 1e-15)[-1][2]

    @property
    def largest_pull(self):
        """Bound of |F - g''|, rad per τ²."""
        curvatures = [abs(arc.curvature) for arc in self.arcs]
        return abs(self.force) + max([abs(self.amplitude) * self.omega**2, *curvatures])

    def curvature(self, arc, tau):
        """g'' at τ."""
        if self.arcs:
            return arc.curvature
        return -self.amplitude * self.omega**2 * np.cos(self.omega * tau)

    def slope(self, arc, tau):
        """g' at τ."""
        if not self.arcs:
            return -self.amplitude * self.omega * np.sin(self.omega * tau)
        return arc.slope + arc.curvature * (tau - arc.begin)


def problem(osc):
    """The problem of an oscillator whose flank moves as one harmonic or in parabolic arcs."""
    low, high = osc.flank_extrema
    series = osc.te.harmonics
    if len(series) > 1 or (len(series) and tuple(series[0, [0, 2]]) != (1.0, 0.0)):
        raise ValueError("the rivals are written for one cosine or for parabolic arcs")
    return Problem(
        osc.force, osc.mesh_frequency_ratio, osc.period, osc.damping_ratio, osc.restitution,
        osc.backlash, osc.contact_law == "compliant", osc.impact_law == "absolute",
        STICKING * (high - low) * osc.mesh_frequency_ratio, osc.angle_scale,
        osc.angle_scale * min(1.0, osc.mesh_frequency_ratio),
        osc.flank_scale * series[0, 1] if len(series) else 0.0,
        () if len(series) else _arcs(osc))


def _arcs(osc):
    """Arcs of a table: neighbouring pieces that are one parabola are joined, across phase 0 too."""
    te, period, scale = osc.te, osc.period, osc.flank_scale
    if np.any(np.abs(te.coefficients[:, 3:]) * np.diff(te.knots)[:, None] ** 3
              > 1e-12 * te.peak_to_peak):
        raise ValueError("expected a table of parabolic arcs")
    slope, curvature = scale * te.coefficients[:, 1] / period, (
        2 * scale * te.coefficients[:, 2] / period**2)
    jumps = scale * te.slope_jumps() / period
    largest = np.abs(curvature).max()
    starts = [k for k in range(len(slope)) if te.kinks[k]
              or abs(curvature[k] - curvature[k - 1]) > 1e-9 * largest]
    begins = [te.knots[k] * period for k in starts]
    ends = [*begins[1:], begins[0] + period]
    arcs = [Arc(begin, end, slope[k], curvature[k], jumps[k])
            for k, begin, end in zip(starts, begins, ends, strict=True)]
    if begins[0] > 0:  # the last arc of the cycle before holds phase 0
        last = arcs[-1]
        arcs = [Arc(last.begin - period, last.end - period, last.slope, last.curvature,
                    last.jump), *arcs[:-1]]
    return tuple(arcs)
