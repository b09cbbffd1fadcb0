"""What a map is asked for besides: the numbers of sweeps, whatever the cut, and nothing unasked."""

import numpy as np
import pytest
from test_map import RECORD, SETTLE, TE, mapped

from helpers import dataset_bytes
from lapwing import Numerics, TransmissionError, open_study, parameter_map, sweep
from lapwing.base.quantities import OBSERVED, SHARES
from lapwing.engine import calls
from lapwing.studies.map import shards
from lapwing_bench.scenes import PAIR

ALL = tuple(OBSERVED)
ADDED = {name for names in OBSERVED.values() for name in names}
AVERAGES = ("rms", "forces", "shares")


@pytest.fixture(scope="module", params=["restitution", "compliant"])
def both(request):
    """A map that is asked for all, and the sweeps of its columns."""
    speeds, torques = [900.0, 1500.0], np.linspace(1, 12, 6)
    options = {"settle": 240, "record": RECORD, "contact_law": request.param}
    found = mapped({"pinion_speed_rpm": speeds, "brake_torque": torques}, observe=ALL, **options)
    return found, [sweep(PAIR, TE, values=torques, starts=("rest",), pinion_speed_rpm=speed,
                         observe=("cycles", "exponents", "amplitudes"), **options).isel(start=0)
                   for speed in speeds]


@pytest.mark.parametrize(("name", "error"), [
    ("mesh_force_mean", 1e-9), ("mesh_force_peak", 1e-9), ("lyapunov_exponent", 0.0),
    # That of a sweep is of 400 samples a cycle, whose sum skips kinks by up to half a step.
    ("phi_rms", 1e-4)])
def test_periodic_motions_have_the_numbers_of_a_sweep(both, name, error):
    found, sweeps = both
    for one, (_, column) in zip(sweeps, found.groupby("pinion_speed_rpm"), strict=True):
        column = column.squeeze("pinion_speed_rpm")
        repeats = column["period"].values > 0
        assert repeats.sum() >= 3
        expected = one[name].values[repeats]
        assert np.all(np.isfinite(expected))
        np.testing.assert_allclose(column[name].values[repeats], expected, rtol=error,
                                   atol=1e-9 * np.abs(expected).max() * (error > 0))


def test_shares_are_of_the_states_that_are_visited(both):
    found = both[0]
    total = sum(found[name] for name in SHARES)
    np.testing.assert_allclose(total, 1.0, rtol=1e-12)
    for bit, name in enumerate(SHARES):
        # States are of all recorded cycles, shares of the last period.
        visited = (found["states_visited"].values >> bit & 1) == 1
        assert np.all(visited[found[name].values > 0])
        once = found["period"].values == 1
        assert np.array_equal((found[name].values > 0)[once], visited[once])


def test_an_exponent_of_an_aperiodic_motion_is_that_of_a_sweep(both):
    found, sweeps = both
    free = 0
    for one, (_, column) in zip(sweeps, found.groupby("pinion_speed_rpm"), strict=True):
        where = column["period"].values.ravel() == 0
        free += where.sum()
        assert np.array_equal(column["lyapunov_exponent"].values.ravel()[where],
                              one["lyapunov_exponent"].values[where])
    assert free or found.attrs["contact_law"] == "compliant"


def test_what_is_not_asked_for_is_not_there_and_what_is_changes_nothing():
    plain, found = mapped(), mapped(observe=AVERAGES)
    assert not ADDED & set(plain.variables)
    assert plain.attrs["observe"] == "" and found.attrs["observe"] == "rms forces shares"
    assert ADDED - set(found.variables) == {"lyapunov_exponent"}
    assert dataset_bytes(found[list(plain.data_vars)].drop_attrs()) == dataset_bytes(
        plain.drop_attrs())


@pytest.mark.parametrize("start", ["rest", "down"])
def test_the_numbers_hang_on_no_cut(start, tmp_path, monkeypatch):
    options = {"axes": {"pinion_speed_rpm": [900.0, 1500.0], "brake_torque": np.linspace(1, 9, 5)},
               "start": start, "line": "brake_torque", "observe": ALL}
    expected = mapped(**options)
    # No time at all: each call gets somewhere all the same.
    monkeypatch.setattr(calls, "CALL_SECONDS", 0.0)
    monkeypatch.setattr(shards, "MAPS", 1)
    found = mapped(**options, shard_runs=2, threads=1, folder=tmp_path)
    assert dataset_bytes(found.drop_attrs()) == dataset_bytes(expected.drop_attrs())
    opened = open_study(tmp_path)
    for name in ADDED:
        assert opened[name].attrs == expected[name].attrs
        assert np.array_equal(opened[name].values, expected[name].values, equal_nan=True)
    # One that asks for less is another study.
    notes = []
    mapped(**options | {"observe": ("rms",)}, shard_runs=2, folder=tmp_path, notes=notes.append)
    assert notes and all("is of another study" in note for note in notes)


def test_forces_are_in_newtons_of_each_run():
    levers = [0.03, 0.034, 0.05]
    found = mapped({"pinion_base_lever": levers, "mesh_stiffness": [2e8, 3.12e8]},
                   observe=("forces",), brake_torque=40.0, pinion_speed_rpm=1500.0)
    # In engagement throughout, the mean force carries the torque: F·lever·(25/32) of it.
    assert np.all(found["states_visited"] == 2)
    torque = found["mesh_force_mean"] * found["pinion_base_lever"] * 32 / 25
    np.testing.assert_allclose(torque, 40.0, rtol=1e-9)


def test_a_kinked_table_moved_by_either_method_has_the_same_averages():
    axes = {"pinion_speed_rpm": [480.0], "brake_torque": [6.0, 12.0, 30.0]}
    exact, stepped = (parameter_map(
        PAIR, TransmissionError.parabola(20e-6), axes, settle=SETTLE, record=RECORD,
        numerics=Numerics(method=method, rtol=1e-10), observe=AVERAGES,
        contact_law="compliant") for method in ("exact", "rk4"))
    assert np.all(exact["period"] > 0)
    for name in ADDED - {"lyapunov_exponent"}:
        np.testing.assert_allclose(stepped[name], exact[name], rtol=1e-6)


def test_failed_runs_and_rigid_flanks_have_no_numbers():
    found = mapped(observe=ALL, numerics=Numerics(max_events_per_cycle=5))
    bad = found["status"].values != 0
    assert 0 < bad.sum() < bad.size
    for name in ADDED - {"lyapunov_exponent"}:
        assert np.array_equal(np.isnan(found[name].values), bad)
    assert np.isnan(found["lyapunov_exponent"].values[bad]).all()
    rigid = mapped(observe=ALL, contact_law="rigid")
    assert np.isnan(rigid["mesh_force_peak"]).all() and np.isnan(rigid["mesh_force_mean"]).all()
    assert np.isfinite(rigid["phi_rms"]).all()


@pytest.mark.parametrize("observe", [("depth",), ("rms", "rms"), 3])
def test_refusals(observe):
    with pytest.raises((TypeError, ValueError), match="observe"):
        mapped(observe=observe)
