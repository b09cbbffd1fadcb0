"""What was run stands in every result, alike from Python and from a deck."""

import math
from dataclasses import replace

import numpy as np
import pytest
import xarray as xr

import lapwing
from helpers import PAIR, SHIPPED, scene_a
from lapwing.studies.labels import settings

LAWS = {"impact_law": "absolute", "gap": "symmetric", "te_scale": 0.5}
FEW = {"settle": 2, "record": 2}
GRID = lapwing.StartGrid(1, 1, 1)
FOUND = {
    "sweep": lambda **at: lapwing.sweep(PAIR, SHIPPED, parameter="backlash", values=[1e-3, 2e-3],
                                        **FEW, **at),
    "map": lambda **at: lapwing.parameter_map(
        PAIR, SHIPPED, {"backlash": [1e-3, 2e-3], "damping_ratio": [0.1, 0.2]}, **FEW, **at),
    "ensemble": lambda **at: lapwing.ensemble(
        PAIR, SHIPPED, {"backlash": [1e-3, 2e-3, 3e-3]}, **FEW, **at),
    "safe": lambda **at: lapwing.critical_safe(
        PAIR, SHIPPED, parameter="backlash", values=[1e-3, 2e-3], starts=GRID, **FEW, **at),
    "back": lambda **at: lapwing.critical_back(
        PAIR, SHIPPED, parameter="backlash", values=[1e-3, 2e-3], starts=GRID, **FEW, **at),
    "full": lambda **at: lapwing.critical_full(
        PAIR, SHIPPED, parameter="backlash", values=[1e-3, 2e-3], **at),
    "branches": lambda **at: lapwing.branches(
        PAIR, SHIPPED, parameter="backlash", low=1e-3, high=2e-3, seeds=2, settle=1, doublings=0,
        points=1, **at),
}


@pytest.mark.parametrize("study", FOUND)
def test_a_study_says_what_was_fixed_and_not_what_was_varied(study):
    attrs = FOUND[study](brake_torque=3.3, pinion_speed_rpm=240, **LAWS).attrs
    assert {name: attrs[name] for name in LAWS} == LAWS
    assert (attrs["brake_torque"], attrs["pinion_speed_rpm"]) == (3.3, 240.0)
    assert attrs["contact_law"] == "restitution" and attrs["restitution"] == PAIR.restitution
    assert attrs["mesh_stiffness"] == PAIR.mesh_stiffness
    assert "backlash" not in attrs and "drive_torque" not in attrs and attrs["balanced"] == 1
    assert ("damping_ratio" in attrs) == (study != "map")


def test_one_motion_says_all_of_it():
    osc = scene_a(3.3, gap="symmetric", te_scale=0.5)
    run = lapwing.simulate(osc, cycles=3, rtol=1e-9)
    further = lapwing.simulate(osc, run.final, cycles=2)
    response = lapwing.response(osc, PAIR, samples_per_cycle=8, **FEW)
    for data in (run, run.events, run.cycles, run.history(np.array([0.0])), further, response):
        assert {name: data.attrs[name] for name in LAWS} == LAWS
        assert data.attrs["brake_torque"] == 3.3 and data.attrs["pinion_speed_rpm"] == 240.0
        assert data.attrs["backlash"] == PAIR.backlash and data.attrs["force"] == osc.force
    assert run.attrs["start"] == "rest" == further.attrs["start"] and run.attrs["rtol"] == 1e-9
    assert (run.attrs["cycles"], further.attrs["cycles"]) == (3.0, 5.0)
    begun = lapwing.simulate(osc, ("separation", -1e-5, 0.5), phase=0.25, cycles=1)
    assert begun.attrs["start"] == "separation -1e-05 0.5" and begun.attrs["phase"] == 0.25


def test_a_deck_says_the_same_as_the_call(tmp_path):
    deck = tmp_path / "one.nml"
    deck.write_text("""
&gear_pair pinion_teeth = 25, gear_teeth = 32, pinion_inertia = 0.0078, gear_inertia = 0.026,
  pinion_base_lever = 0.034, mesh_stiffness = 3.12e8, backlash = 0.002, restitution = 0.8,
  damping_ratio = 0.1 /
&transmission_error parabola_amplitude = 1e-4 /
&operation brake_torque = 3.3, drive_torque = 2.5, pinion_speed_rpm = 240 /
&scene impact_law = 'absolute' /
&sweep name = 'b', parameter = 'backlash', from = 1e-3, to = 2e-3, count = 2, settle_cycles = 2,
  record_cycles = 2, starts = 'rest' /
""")
    lapwing.run_deck(lapwing.load_deck(deck), tmp_path, figures="none", threads=1)
    with xr.open_dataset(tmp_path / "one" / "result.nc", group="sweep_b") as data:
        stored = data.attrs
    called = lapwing.sweep(
        PAIR, lapwing.TransmissionError.parabola(1e-4), parameter="backlash", values=[1e-3, 2e-3],
        brake_torque=3.3, drive_torque=2.5, pinion_speed_rpm=240, impact_law="absolute",
        starts="rest", threads=1, **FEW).attrs
    assert called.items() <= stored.items()
    assert (called["drive_torque"], called["balanced"]) == (2.5, 0)


def test_what_is_not_known_is_left_out():
    osc = scene_a(3.3)
    other = osc.with_force(1.5 * osc.force)
    assert settings(other)["brake_torque"] == pytest.approx(1.5 * 3.3, rel=1e-15)
    bare = lapwing.Oscillator(SHIPPED, force=1e-5, mesh_frequency_ratio=0.1, restitution=0.8,
                              backlash=2e-3)
    assert {"brake_torque", "balanced", "natural_frequency"}.isdisjoint(settings(bare))
    assert settings(bare)["force"] == 1e-5
    damped = lapwing.GearPair(25, 32, 0.0078, 0.026, 0.034, 3.12e8, 0.002, 0.8, mesh_damping=200.0)
    told = settings(damped.oscillator(SHIPPED, brake_torque=1, mesh_frequency_hz=100.0),
                    pair=damped, varied=("mesh_stiffness",))
    assert told["mesh_damping"] == 200.0 and told["mesh_frequency_hz"] == 100.0
    assert {"damping_ratio", "natural_frequency", "mesh_stiffness"}.isdisjoint(told)


def test_a_speed_is_told_as_far_as_it_holds():
    osc = replace(scene_a(3.3), mesh_frequency_ratio=0.1)
    assert osc.operation["mesh_frequency_hz"] == pytest.approx(
        0.1 * PAIR.natural_frequency / (2 * math.pi), rel=1e-15)
    assert "pinion_speed_rpm" not in osc.operation
