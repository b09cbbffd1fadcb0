"""Error against tolerance with rk4: the promise is event times within about rtol mesh periods.

`python tests/test_convergence.py` prints the tables.
"""

import json
from functools import cache

import numpy as np
import pytest

from helpers import ROOT, events, scene_a, scene_c
from lapwing import EventKind, Status, simulate
from lapwing_bench.scenes import SCENES

TOLERANCES = 10.0 ** -np.arange(4, 11.1, 0.5)


@cache
def twentieth_impact():
    """Errors of the 20th impact, mesh periods, of scene A at 1.8 N·m, by tolerance."""
    data = json.loads((ROOT / "tests/reference/data/scene_a_absolute.json").read_text("utf-8"))
    exact, = (float(run["twentieth_impact_tau"]) for run in data["runs"] if run["name"] == "a_1.8")
    osc = scene_a(1.8)
    runs = [simulate(osc, cycles=exact / osc.period + 0.5, method="rk4", rtol=rtol)
            for rtol in TOLERANCES]
    assert all(run.status == Status.OK for run in runs)
    taus = np.array([events(run, EventKind.IMPACT)["tau"][19] for run in runs])
    return np.abs(taus - exact) / osc.period, [run.work["steps"] for run in runs]


def exact_engaged_state(osc, tau):
    """φ, φ' of the periodic engaged motion from the Fourier gain; model.md's linear response."""
    n = osc.te.harmonics[:, 0] * osc.mesh_frequency_ratio
    gain = n**2 / (1 - n**2 + 2j * osc.damping_ratio * n)
    amplitude = osc.flank_scale * osc.te.harmonics[:, 1] * np.exp(1j * osc.te.harmonics[:, 2])
    wave = gain * amplitude * np.exp(1j * n * tau)
    return osc.force + wave.sum().real, (1j * n * wave).sum().real


@cache
def smooth_compliant():
    """Errors of φ over the angle scale after 10.3 engaged cycles, scene C at 20 N·m."""
    osc = scene_c(20.0, contact_law="compliant")
    start = exact_engaged_state(osc, 0.0)
    exact, _ = exact_engaged_state(osc, 10.3 * osc.period)
    runs = [simulate(osc, ("engagement", *start), cycles=10.3, method="rk4", rtol=rtol)
            for rtol in TOLERANCES]
    assert all(len(run.events["tau"]) == 0 for run in runs)
    error = np.array([abs(run.final.phi - exact) for run in runs]) / osc.angle_scale
    return error, [run.work["steps"] for run in runs]


def order(values, chosen=slice(None)):
    """Least-squares slope of log(values) over log tolerance."""
    return np.polyfit(np.log(TOLERANCES[chosen]), np.log(np.array(values)[chosen]), 1)[0]


@pytest.mark.parametrize(("name", "torque"), [("S2", 3.3), ("S2", 8.0), ("S3", 1.0), ("S3", 2.0),
                                              ("S3b", 1.0), ("S3b", 5.0)])
def test_a_series_limits_no_tolerance(name, torque):
    """Events of three cycles whose errors hardly grow, against the closed form on the series."""
    osc = SCENES[name].oscillator(torque)
    exact = simulate(osc, cycles=3, method="exact").events
    errors = []
    for rtol in (1e-6, 1e-8, 1e-10, 1e-12):
        stepped = simulate(osc, cycles=3, method="rk4", rtol=rtol).events
        assert stepped["kind"].values.tolist() == exact["kind"].values.tolist()
        errors.append(np.abs(stepped["tau"].values - exact["tau"].values).max() / osc.period)
    # The estimate is of fourth order, the result of fifth: a hundredth of the tolerance gives a
    # hundredth of the error or less, until rounding.
    assert errors[1] < errors[0] / 50 and errors[2] < errors[1] / 50
    assert errors[3] < 1e-12


def test_twentieth_impact_converges():
    errors, _ = twentieth_impact()
    assert np.all(np.diff(errors) < 0)
    # One mesh period times rtol is the promise; at this impact the dynamics amplify by 12/P only
    # (`growth` of the reference), so nothing is added to it.
    assert np.all(errors <= TOLERANCES)
    assert errors[-1] <= 1e-12
    # Steps hold the error estimate to the tolerance and the global error falls with it.
    assert 0.75 <= order(errors) <= 1.25


def test_the_closed_form_has_no_tolerance():
    """Twentieth impact and engaged motion to rounding.

    That of the impact is 1e-16 each for some tens of stretches.  The engaged reference itself
    rounds its phase, 3·2π·10.3 rad, to 4e-14 rad, at several angle scales of amplitude.
    """
    data = json.loads((ROOT / "tests/reference/data/scene_a_absolute.json").read_text("utf-8"))
    exact, = (float(run["twentieth_impact_tau"]) for run in data["runs"] if run["name"] == "a_1.8")
    osc = scene_a(1.8)
    run = simulate(osc, cycles=exact / osc.period + 0.5, method="exact")
    assert abs(events(run, EventKind.IMPACT)["tau"][19] - exact) <= 1e-14 * osc.period
    osc = scene_c(20.0, contact_law="compliant")
    run = simulate(osc, ("engagement", *exact_engaged_state(osc, 0.0)), cycles=10.3,
                   method="exact")
    error = abs(run.final.phi - exact_engaged_state(osc, 10.3 * osc.period)[0])
    assert error <= 1e-12 * osc.angle_scale


def test_cost_rises_as_the_estimate_falls():
    _, steps = twentieth_impact()
    # The estimate of a fourth-order step falls as h⁵: steps ~ rtol^(-1/5), once they, not the
    # stretches between events, decide their number.
    assert -0.22 <= order(steps, TOLERANCES <= 1e-7) <= -0.18


def test_smooth_engaged_motion_converges():
    errors, _ = smooth_compliant()
    # The table's own error (1e-12 of its greatest value, 2.4 angle scales at most) and rounding of
    # some 10⁴ steps (random, √10⁴·8 EPS) are a floor of a few 1e-13.
    floor = 4e-13
    above = errors > floor
    assert np.all(errors <= np.maximum(TOLERANCES, floor))
    assert np.count_nonzero(above) >= 8 and np.all(np.diff(errors[above]) < 0)
    assert 0.75 <= order(errors, above) <= 1.25


def _print_table(title, errors, steps):
    print(f"{title}: slope {order(errors):.3f}")
    print("     rtol     error  error/rtol    steps")
    for rtol, error, n in zip(TOLERANCES, errors, steps, strict=True):
        print(f"{rtol:9.1e} {error:9.2e} {error / rtol:11.3f} {n:8d}")


if __name__ == "__main__":
    _print_table("20th impact, scene A, 1.8 N·m (mesh periods)", *twentieth_impact())
    _print_table("engaged, scene C, 20 N·m (angle scales)", *smooth_compliant())
