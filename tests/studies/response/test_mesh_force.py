"""Mean and peak of the mesh force against quadrature and search on the run's own dense states."""

import dataclasses
import math
import re

import numpy as np
import pytest

from helpers import PAIR, scene_a, scene_c, scene_d
from lapwing import EventKind, MotionState, simulate
from lapwing.report.response import _paragraph, _table
from lapwing.studies.response.mesh_force import MOST_PHASES, sample_phases
from lapwing.studies.response.run import response

NEWTON = PAIR.mesh_stiffness * PAIR.pinion_base_lever
# Nodes of a Gauss rule on pieces of a fiftieth of a cycle: an oscillation of unit frequency, and
# the knots are among the ends, so that what it leaves out is far below rounding.
NODES, WEIGHTS = np.polynomial.legendre.leggauss(12)
PIECES = 50
SETTLED = 1500


def force(osc, run, taus):
    """W/(k'·lever) at some times, rad; both flanks move."""
    state = run.history(taus)
    phi, coast = state.phi.values, state.motion_state.values == MotionState.BACK_ENGAGEMENT
    depth = np.where(coast, phi + osc.gap_width, phi)
    found = depth + 2 * osc.damping_ratio * state.phi_dot.values
    return np.where(state.motion_state.values == MotionState.SEPARATION, 0.0, found)


def from_dense_states(osc, cycles):
    """Mean and peak over some cycles after a long run, N; no series, no momentum.

    Begun anew where that ended: times are counted from there and lose no digits.
    """
    settled = simulate(osc, cycles=SETTLED, observe=()).final
    run = simulate(osc, start=(settled.motion_state, settled.phi, settled.phi_dot),
                   cycles=cycles + 1, observe=("events",))
    events = run.events.tau.values[run.events.kind.values != EventKind.KINK]
    knots = np.union1d(np.arange(PIECES) / PIECES, osc.te.knots[:-1])
    edges = np.concatenate([(m + knots) * osc.period for m in range(cycles)]
                           + [[cycles * osc.period]])
    edges = np.union1d(edges, events[events < edges[-1]])
    # Pieces of a few ulp are chatter's last bounces: they carry nothing.
    left, width = edges[:-1], np.diff(edges)
    taus = left[:, None] + 0.5 * width[:, None] * (1 + NODES)
    values = force(osc, run, taus.ravel()).reshape(taus.shape)
    mean = np.sum(0.5 * width[:, None] * WEIGHTS * values) / (cycles * osc.period)
    # The ends of arcs too: just inside.
    inside = np.sort(np.concatenate([taus.ravel(), left + 1e-9 * width, left + (1 - 1e-9) * width]))
    values = np.abs(force(osc, run, inside))
    at = int(np.argmax(values))
    peak, low, high = values[at], inside[max(at - 1, 0)], inside[min(at + 1, inside.size - 1)]
    for _ in range(4):
        some = np.linspace(low, high, 101)
        values = np.abs(force(osc, run, some))
        at = int(np.argmax(values))
        peak, low, high = max(peak, values[at]), some[max(at - 1, 0)], some[min(at + 1, 100)]
    return NEWTON * mean, NEWTON * peak


CASES = [scene(torque) for scene, torques in (
    (scene_a, (1.78, 1.8, 3.3, 5.5, 6.0, 7.0, 8.0, 9.0, 10.0, 11.0, 12.0, 12.5, 13.0, 14.0)),
    (scene_c, (4.0, 6.0, 7.0, 8.0, 9.0, 10.0, 12.0, 13.0, 14.0)),
    (scene_d, (2.5, 3.0, 4.0, 5.5, 6.0, 7.0, 8.0, 9.0, 10.0, 11.0, 12.0, 13.0)),
) for torque in torques] + [scene_d(torque, contact_law="compliant")
                            for torque in (3.0, 4.0, 5.5, 7.0, 8.0, 9.0, 13.0)]
# Of all cases, and of every third.
PERIODIC = {1: 30, 3: 10}


def misses(options, cases):
    """Cases that repeat, and those whose stated error is exceeded."""
    periodic, exceeded = 0, []
    for i, osc in enumerate(cases):
        found = response(osc, PAIR, name="case", settle=400, record=48,
                         samples_per_cycle=64, **options).attrs
        if not found["period"]:
            continue
        periodic += 1
        for key, true in zip(("mesh_force_mean", "mesh_force_peak"),
                             from_dense_states(osc, found["period"]), strict=True):
            off, stated = abs(found[key] - true), found[f"{key}_error"]
            if not off <= stated:
                exceeded.append((i, key, off, stated))
    return periodic, exceeded


@pytest.mark.parametrize(("options", "every"), [
    ({}, 3), pytest.param({}, 1, marks=pytest.mark.full),
    pytest.param({"method": "rk4"}, 1, marks=pytest.mark.full)])
def test_no_stated_error_of_periodic_responses_is_exceeded(options, every):
    periodic, exceeded = misses(options, CASES[::every])
    assert exceeded == []
    assert periodic >= PERIODIC[every]


@pytest.mark.parametrize("rpm", [1.0, 1e-3])
def test_a_long_mesh_period_takes_no_more_samples_than_it_may(rpm):
    """As many as the series needs, or no peak; the mean comes from momentum all the same."""
    osc = dataclasses.replace(scene_d(5.5), mesh_frequency_ratio=scene_d(5.5).mesh_frequency_ratio
                              * rpm / 240)
    grid, stored = sample_phases(osc, 64)
    assert grid.size <= MOST_PHASES + osc.te.knots.size
    assert np.array_equal(grid[stored], np.arange(64) / 64)
    found = response(osc, PAIR, name="slow", settle=1, record=2, samples_per_cycle=64).attrs
    # Over a period the momentum of the relative motion comes back: what presses is F.
    assert found["mesh_force_mean"] + found["impact_force_mean"] == pytest.approx(
        NEWTON * osc.force, rel=1e-6)
    assert math.isfinite(found["mesh_force_peak"]) == (rpm == 1.0)
    told = _paragraph(found)
    assert ("greatest value is not known" in told) == (rpm < 1.0)
    assert not re.search(r"\b(nan|inf)\b", told + " ".join(_table([found])))


@pytest.mark.parametrize("osc", [scene_a(3.3), scene_d(5.5), scene_c(12)])
def test_the_peak_does_not_hang_on_the_samples(osc):
    """Series begun at other states of the same motion: rounding."""
    few, many = (response(osc, PAIR, name="case", settle=400, record=24,
                          samples_per_cycle=n).attrs for n in (7, 1000))
    for key in ("mesh_force_mean", "mesh_force_peak"):
        assert few[key] == pytest.approx(many[key], rel=1e-12)
