"""What Datasets of Lapwing can do by themselves: speeds, impacts of a point, figures."""

import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
import xarray as xr

import lapwing
from helpers import PAIR, SHIPPED, scene_a

SWEPT = {"values": [1.8, 3.3], "pinion_speed_rpm": 240, "impact_law": "absolute", "settle": 20,
         "record": 8, "observe": ("cycles", "impacts", "exponents")}


@pytest.fixture(scope="module")
def swept():
    return lapwing.sweep(PAIR, SHIPPED, **SWEPT)


@pytest.fixture(scope="module")
def response():
    return lapwing.response(scene_a(1.8), PAIR, name="r", settle=20, record=8,
                            samples_per_cycle=40)


def test_speeds_have_a_unit(swept, response):
    speed = swept.lapwing.speed()
    np.testing.assert_array_equal(
        speed, swept["impact_velocity"] * PAIR.natural_frequency)
    assert speed.attrs["units"] == "rad/s" and "tau" not in speed.attrs["long_name"]
    along = response.lapwing.speed("phi_dot", "m/s")
    np.testing.assert_allclose(
        along, response["phi_dot"] * PAIR.natural_frequency * PAIR.pinion_base_lever, rtol=4e-16)
    run = lapwing.simulate(scene_a(1.8), cycles=5)
    np.testing.assert_array_equal(run.events.lapwing.speed(gear_pair=PAIR),
                                  run.events["velocity_before"] * PAIR.natural_frequency)


def test_what_has_no_speed_is_refused(swept):
    run = lapwing.simulate(scene_a(1.8), cycles=5)
    bare = lapwing.simulate(replace(scene_a(1.8), scales=None), cycles=5)
    with pytest.raises(ValueError, match="does not tell its natural_frequency"):
        bare.events.lapwing.speed()
    with pytest.raises(ValueError, match="in rad per unit of tau"):
        swept.lapwing.speed("phi")
    with pytest.raises(ValueError, match="one of 'rad/s', 'm/s'"):
        swept.lapwing.speed(unit="mph")
    with pytest.raises(KeyError):
        run.cycles.lapwing.speed("none")


def test_a_sweep_of_the_pair_does_not_claim_one_frequency():
    swept = lapwing.sweep(PAIR, SHIPPED, **{**SWEPT, "values": [3e8, 3.2e8]},
                          parameter="mesh_stiffness", brake_torque=3.3)
    assert "natural_frequency" not in swept.attrs
    backlash = lapwing.sweep(PAIR, SHIPPED, **{**SWEPT, "values": [1e-3, 2e-3]},
                             parameter="backlash", brake_torque=3.3)
    assert backlash.attrs["natural_frequency"] == PAIR.natural_frequency


def test_impacts_of_a_point(swept):
    listed = swept.lapwing.impacts(start="rest", brake_torque=1.8)
    run = lapwing.simulate(scene_a(1.8), cycles=28, rtol=1e-6)
    later = run.events.where((run.events.kind <= 2) & (run.events.cycle >= 20), drop=True)
    np.testing.assert_array_equal(listed["impact_phase"], later["phase"])
    with pytest.raises(KeyError, match="observe"):
        run.cycles.lapwing.impacts()


def test_a_table_has_words_for_codes(swept, response, tmp_path):
    run = lapwing.simulate(scene_a(1.8), cycles=5)
    run.events.lapwing.to_csv(tmp_path / "events.csv")
    head, first, *_ = (tmp_path / "events.csv").read_text().splitlines()
    assert head == ("tau,time [s],cycle,phase,kind,phi [rad],velocity_before [rad per tau],"
                    "velocity_after [rad per tau],flight_depth [rad]")
    tau, time, _, _, kind, *_ = first.split(",")
    assert kind == lapwing.EventKind(int(run.events["kind"][0])).name.lower()
    assert float(time) == pytest.approx(float(tau) / PAIR.natural_frequency, rel=1e-15)
    plain = run.events.lapwing.table()
    assert list(plain) == [name.partition(" ")[0] for name in head.split(",")]
    bare = lapwing.simulate(replace(scene_a(1.8), scales=None), cycles=5)
    assert "time" not in bare.events.lapwing.table()  # without a gear pair no second is known
    with pytest.raises(TypeError, match="path = 3, expected a path"):
        run.events.lapwing.to_csv(3)
    table = response.lapwing.table("cycle")
    np.testing.assert_array_equal(table["cycle_phi"], response["cycle_phi"])
    assert "phi" not in table and len(response.lapwing.table()) == response.sizes["event"]
    for wrong in ("time", np.zeros(2), ""):
        with pytest.raises(ValueError, match="one of start, brake_torque"):
            swept.lapwing.table(wrong)


def test_figures_are_methods(swept, response):
    assert {"orbit_diagram", "exponents"} <= set(swept.lapwing.figures())
    assert "waterfall" not in swept.lapwing.figures()
    diagram = swept.lapwing.orbit_diagram()
    assert len(diagram.axes) == 4 and diagram.get_suptitle() == "orbit diagram, 240 rpm"
    assert "history" in dir(response.lapwing)
    with_units = response.lapwing.phase_portrait(gear_pair=PAIR)
    assert any("rad/s" in axis.get_ylabel() for axis in with_units.axes)
    with pytest.raises(AttributeError, match=r"'waterfall' .*has not what the figure shows"):
        swept.lapwing.waterfall  # noqa: B018
    with pytest.raises(AttributeError, match=r"no method or figure 'tabel' .*mean 'table'\?"):
        swept.lapwing.tabel  # noqa: B018
    with pytest.raises(AttributeError, match=r"mean 'orbit_diagram'\?; its figures are .*stairc"):
        swept.lapwing.orbit_diagramm  # noqa: B018
    with pytest.raises(TypeError, match="no option 'colour'"):
        swept.lapwing.orbit_diagram(colour="red")


def test_figures_of_a_map_are_methods():
    data = lapwing.parameter_map(PAIR, SHIPPED, {"pinion_speed_rpm": [200.0, 300.0],
                                                 "brake_torque": [1.0, 5.0, 13.0]},
                                 settle=5, record=4, threads=1)
    assert {"map_classes", "map_depth"} <= set(data.lapwing.figures())
    assert data.lapwing.map_classes().axes[0].get_xlabel().startswith("pinion speed")


def test_the_time_is_a_coordinate(response):
    assert response["phi"].coords["time"].attrs["units"] == "s"
    lines = response["phi"].plot(x="time")
    np.testing.assert_array_equal(lines[0].get_xdata(), response["time"])


def test_any_dataset_of_another_kind_has_no_figure():
    assert xr.Dataset().lapwing.figures() == ()


def test_lapwing_alone_loads_no_xarray():
    code = ("import sys, lapwing.accessor; lapwing.sweep; assert 'xarray' not in sys.modules; "
            "lapwing.accessor.register(); import xarray; "
            "assert hasattr(xarray.Dataset, 'lapwing')")
    subprocess.run([sys.executable, "-c", code], check=True)


def test_a_bar_is_told_the_fraction_done(monkeypatch):
    from lapwing import progress

    told = []
    monkeypatch.setattr(progress.Bars, "_tell", lambda self, study: told.append(study.fraction))
    with lapwing.progress_bar("torques") as done:
        lapwing.sweep(PAIR, SHIPPED, **SWEPT, progress=done)
    assert told and told[-1] == 1.0


@pytest.mark.parametrize(("cut", "why"), [
    ({"start": 0}, r"of start it has a single value and no axis: isel\(start=\[i\]\) keeps one"),
    ({"brake_torque": 1}, "of brake_torque it has a single value"),
    ({"brake_torque": slice(0, 0)}, "nothing is left of brake_torque"),
    ({"recorded_cycle": slice(0, 0)}, "nothing is left of recorded_cycle"),
    ({"impact": slice(0, 1)}, "parts do not belong together")])
def test_figures_say_what_was_cut_away(cut, why, swept):
    with pytest.raises((AttributeError, ValueError), match=f"orbit_diagram.*{why}"):
        swept.isel(cut).lapwing.orbit_diagram()


def test_a_map_without_an_axis_has_no_figures():
    whole = lapwing.parameter_map(
        PAIR, SHIPPED, {"brake_torque": [1.8, 3.3], "pinion_speed_rpm": [240, 300]}, settle=0,
        record=1, impact_law="absolute")
    assert "map_depth" in whole.lapwing.figures()
    line = whole.isel(pinion_speed_rpm=0)
    assert line.lapwing.figures() == ()
    with pytest.raises(AttributeError, match="of pinion_speed_rpm it has a single value"):
        line.lapwing.map_depth()


@pytest.mark.parametrize("figure", ["deepest_separation", "staircase"])
def test_a_single_cycle_that_was_cut_out_is_named(swept, figure):
    """Of a dimension without coordinates a single value leaves no trace."""
    stored = swept.assign_attrs(kind="sweep")  # as in a result file
    with pytest.raises((AttributeError, ValueError), match="of recorded_cycle it has a single"):
        getattr(stored.isel(recorded_cycle=0).lapwing, figure)()


def test_a_mistake_in_a_call_is_not_taken_for_a_cut(swept):
    with pytest.raises(TypeError, match="no option 'colour'"):
        swept.lapwing.orbit_diagram(colour="red")
