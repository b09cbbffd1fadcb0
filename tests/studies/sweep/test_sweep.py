"""Sweeps: the published table, equality with single runs, threads, cuts, failures, refusals."""

from pathlib import Path

import numpy as np
import pytest

import lapwing
from lapwing.base.codes import Status
from lapwing.engine import calls

TE = lapwing.TransmissionError.from_file(Path(__file__).parents[3] / "inputs" / "te_25x32.csv")
PAIR = lapwing.GearPair(
    pinion_teeth=25, gear_teeth=32, pinion_inertia=0.0078, gear_inertia=0.026,
    pinion_base_lever=0.034, mesh_stiffness=3.12e8, backlash=0.002, restitution=0.8,
    damping_ratio=0.1)
ABSOLUTE = {"pinion_speed_rpm": 240, "impact_law": "absolute"}
RELATIVE = {"pinion_speed_rpm": 240, "impact_law": "relative"}
TORQUES = (0.6, 1.8, 5.5, 12.1)


def as_bytes(dataset):
    return {name: np.ascontiguousarray(dataset[name].values).tobytes()
            for name in dataset.variables}


@pytest.fixture(scope="module")
def small():
    return lapwing.sweep(PAIR, TE, values=TORQUES, settle=20, record=12, threads=1,
                         observe=("cycles", "impacts"), **RELATIVE)


@pytest.mark.parametrize("observe", [("cycles",), ("cycles", "impacts"), ("cycles", "speeds")])
def test_a_sweep_of_torques_makes_no_oscillator_for_each(observe, monkeypatch):
    """Each of 2000 made would cost thirty times what else is outside the engine."""
    made, check = [], lapwing.Oscillator.__post_init__
    monkeypatch.setattr(lapwing.Oscillator, "__post_init__",
                        lambda osc: made.append(osc) or check(osc))
    for count in (2, 40):
        made.clear()
        lapwing.sweep(PAIR, TE, values=np.linspace(1, 2, count), settle=0, record=1, threads=1,
                      observe=observe, **ABSOLUTE)
        assert len(made) <= 2


def test_published_table():
    """3, 5 and 7 impacts, period 1, depths to 1 %; engaged from rest at 12 N·m.

    Depths: the independent computation that the reconstruction was made with.
    """
    points = lapwing.sweep(PAIR, TE, values=(1.8, 3.3, 5.5, 12), starts=("rest",), settle=300,
                           record=60, **ABSOLUTE).sel(start="rest")
    np.testing.assert_array_equal(points.counted_impacts.mean("recorded_cycle"), [3, 5, 7, 0])
    np.testing.assert_array_equal(points.period, 1)
    np.testing.assert_array_equal(points.back_impacts, 0)
    np.testing.assert_allclose(points.deepest_separation.max("recorded_cycle"),
                               [0.000610, 0.000321, 0.000237, 0], rtol=0.01)


@pytest.mark.parametrize("threads", [2, 5])
def test_threads_change_no_byte(small, threads):
    again = lapwing.sweep(PAIR, TE, values=TORQUES, settle=20, record=12, threads=threads,
                          observe=("cycles", "impacts"), **RELATIVE)
    assert as_bytes(again) == as_bytes(small)


def test_cuts_change_no_byte(small, monkeypatch):
    """Calls that end at once, hundreds of them, between every few segments."""
    monkeypatch.setattr(calls, "CALL_SECONDS", 0.0)
    again = lapwing.sweep(PAIR, TE, values=TORQUES, settle=20, record=12, threads=2,
                          observe=("cycles", "impacts"), **RELATIVE)
    assert as_bytes(again) == as_bytes(small)


def test_rest_points_equal_single_runs(small):
    """A point of a sweep is the run that `simulate` makes."""
    for torque in TORQUES:
        osc = PAIR.oscillator(TE, brake_torque=torque, **RELATIVE)
        run = lapwing.simulate(osc, cycles=32, rtol=1e-6)
        point = small.sel(start="rest", brake_torque=torque)
        for name in ("phi", "phi_dot", "impacts", "counted_impacts", "deepest_separation"):
            np.testing.assert_array_equal(point[name].values, run.cycles[name].values[20:], name)
        section = run.events.where((run.events.kind <= 2) & (run.events.cycle >= 20), drop=True)
        listed = small.lapwing.impacts(start="rest", brake_torque=torque)
        assert listed.sizes["impact"] == int(point.n_impacts) == int(point.kept_impacts)
        np.testing.assert_array_equal(listed.impact_velocity, section.velocity_before)


def test_carried_points_continue_their_neighbour(small):
    """Up: each torque begins with the state in which the lower one ended; down likewise."""
    for start, order in (("up", TORQUES), ("down", TORQUES[::-1])):
        begin = "rest"
        for torque in order:
            osc = PAIR.oscillator(TE, brake_torque=torque, **RELATIVE)
            run = lapwing.simulate(osc, start=begin, cycles=32, rtol=1e-6)
            np.testing.assert_array_equal(
                small.sel(start=start, brake_torque=torque).phi.values,
                run.cycles.phi.values[20:])
            begin = (run.final.motion_state, run.final.phi, run.final.phi_dot)


def test_start_phase_and_no_settling():
    """Strobes belong to mesh cycles; the first begins at the start phase."""
    point = lapwing.sweep(PAIR, TE, values=[3.3], starts=("rest",), settle=0, record=6, phase=0.3,
                          **ABSOLUTE)
    osc = PAIR.oscillator(TE, brake_torque=3.3, **ABSOLUTE)
    run = lapwing.simulate(osc, phase=0.3, cycles=6, rtol=1e-6)
    np.testing.assert_array_equal(point.phi.values[0, 0], run.cycles.phi.values[:6])


def test_failed_point_keeps_its_neighbours():
    """A bound on events fails the rattling torques; the engaged one and its line are there."""
    result = lapwing.sweep(PAIR, TE, values=TORQUES, settle=5, record=5, max_events_per_cycle=4,
                           **RELATIVE)
    status = result.status.sel(start="rest").values
    assert status[1] == Status.TOO_MANY_EVENTS and status[3] == Status.OK
    assert np.all(np.isfinite(result.phi.sel(start="rest", brake_torque=12.1)))
    assert int(result.period.sel(start="rest", brake_torque=1.8)) == 0


@pytest.mark.parametrize("settle", [0, 6])
def test_rows_that_a_failed_point_did_not_reach_are_unknown(settle):
    """Its cycles up to there are those of a run that did not fail."""
    def rows(bound):
        data = lapwing.sweep(PAIR, TE, values=torques, starts=("rest",), settle=settle, record=12,
                             max_events_per_cycle=bound, **RELATIVE)
        columns = [name for name in data.data_vars if data[name].dims[-1] == "recorded_cycle"]
        return data["status"].values[0], np.array([data[name].values[0] for name in columns])

    torques, reached = np.linspace(0.2, 12.1, 12), set()
    status, whole = rows(1_000_000)
    assert not np.any(status)
    for bound in range(3, 30, 4):
        status, cut = rows(bound)
        for point in range(len(torques)):
            known = np.isfinite(cut[:, point])
            count = int(known[0].sum())
            assert np.all(known == (np.arange(12) < count))
            np.testing.assert_array_equal(cut[:, point, :count], whole[:, point, :count])
            assert (count == 12) == (status[point] == Status.OK)
            reached.add(count)
    assert reached > {0, 12} if settle == 0 else 0 in reached


def test_a_sweep_of_the_same_form_has_its_own_data(small):
    """Names, dimensions and coordinates are those of the one before; nothing else is shared."""
    def again():
        return lapwing.sweep(PAIR, TE, values=TORQUES, settle=20, record=12, threads=1,
                             observe=("cycles",), **RELATIVE)

    first, second = again(), again()
    assert as_bytes(first) == as_bytes(second) and first.attrs == second.attrs
    assert first["phi"].attrs == {"long_name": small["phi"].attrs["long_name"], "units": "rad"}
    first["phi"].values[:] = 0
    first["phi"].attrs["units"] = "mrad"
    first.attrs["settle"] = 7
    first["brake_torque"].attrs["units"] = "lbf ft"
    third = again()
    assert as_bytes(third) == as_bytes(second)
    assert third["phi"].attrs["units"] == "rad" and third.attrs["settle"] == 20
    assert third["brake_torque"].attrs["units"] == "N m"


def test_any_number_may_be_swept():
    speeds = lapwing.sweep(PAIR, TE, parameter="pinion_speed_rpm", values=[200, 240],
                           starts=("rest",), settle=5, record=5, brake_torque=3.3)
    assert speeds.sizes["pinion_speed_rpm"] == 2
    osc = PAIR.oscillator(TE, brake_torque=3.3, pinion_speed_rpm=200)
    run = lapwing.simulate(osc, cycles=10, rtol=1e-6)
    np.testing.assert_array_equal(speeds.phi.values[0, 0], run.cycles.phi.values[5:])
    restitution = lapwing.sweep(PAIR, TE, parameter="restitution", values=[0.5, 0.8],
                                starts=("rest",), settle=5, record=5, brake_torque=3.3,
                                **ABSOLUTE)
    assert not np.array_equal(*restitution.deepest_separation.values[0])


@pytest.mark.parametrize(("changed", "said"), [
    ({"values": []}, "at least one"), ({"values": [1, np.nan]}, "finite"),
    ({"starts": "reset"}, "starts"), ({"starts": ("sideways",)}, "starts"),
    ({"starts": ()}, "starts is empty"), ({"settle": -1}, "settle"), ({"record": 0}, "record"),
    ({"record": 1.5}, "record"), ({"observe": ("all",)}, "observe"),
    ({"rtol": 1.0}, "rtol"), ({"contact_law": "rigid", "impact_law": "absolute"}, "absolute"),
])
def test_refusals(changed, said):
    arguments = {"values": [1.0], "settle": 1, "record": 1, **RELATIVE, **changed}
    with pytest.raises(ValueError, match=said):
        lapwing.sweep(PAIR, TE, **arguments)


def test_all_refusals_at_once():
    with pytest.raises(ValueError, match=r"values.*starts.*settle.*record"):
        lapwing.sweep(PAIR, TE, values=[], starts=("x",), settle=-1, record=0, **RELATIVE)


@pytest.mark.full
def test_bands_of_back_impacts_end_near_0_82():
    """The last torque with a back impact is 0.82 ± 0.02; none from 0.84 to 1.30 in 2,000 cycles."""
    result = lapwing.sweep(PAIR, TE, values=np.round(np.arange(0.74, 1.31, 0.02), 2),
                           starts=("rest",), settle=100, record=2000, **ABSOLUTE)
    seen = (result.back_impacts.sum("recorded_cycle") > 0).any("start")
    last = float(result.brake_torque.where(seen).max())
    assert 0.80 <= last <= 0.84
