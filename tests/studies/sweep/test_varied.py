"""Values of a parameter at once: the numbers are those of the oscillators one by one."""

import numpy as np
import pytest

from helpers import SHIPPED
from lapwing import GearPair, TransmissionError, sweep
from lapwing.base.quantities import base_name
from lapwing.deck.schema import numeric_parameters
from lapwing.engine import Points
from lapwing.engine.points import NUMBERS
from lapwing.studies.period import LABELS, find_period, motion_class
from lapwing.studies.sweep.varied import Varied, moved_to, oscillator_at, parameters, points_at

TE = TransmissionError.harmonic([5e-5])
PAIR = GearPair(pinion_teeth=25, gear_teeth=32, pinion_inertia=0.0078, gear_inertia=0.026,
                pinion_base_lever=0.034, mesh_stiffness=3.12e8, backlash=0.002,
                restitution=0.8, mesh_damping=1e3)
TORQUES = np.random.default_rng(5).uniform(-20, 20, 50)
SPEEDS = np.random.default_rng(6).uniform(1, 3000, 50)


@pytest.mark.parametrize("drive_torque", [None, 3.7])
@pytest.mark.parametrize("parameter", ["brake_torque", "drive_torque", "pinion_speed_rpm",
                                       "pinion_speed_rad_s", "mesh_frequency_hz", "backlash",
                                       "mesh_stiffness", "te_scale"])
@pytest.mark.parametrize("degrees", [1, 2])
def test_numbers_are_those_of_each_oscillator(parameter, drive_torque, degrees):
    values = TORQUES if parameter.endswith("torque") else SPEEDS
    operation = {"brake_torque": 4.4, "drive_torque": drive_torque, "mesh_frequency_hz": 100.0,
                 "te_sign": "geometric", "degrees_of_freedom": degrees}
    if parameter in ("pinion_speed_rpm", "pinion_speed_rad_s"):
        del operation["mesh_frequency_hz"]
    operation.pop(parameter, None)
    found = Varied(PAIR, TE, parameter, values, operation).points
    expected = Points.of([oscillator_at(PAIR, TE, parameter, value, operation)
                          for value in values])
    for name in (*NUMBERS, "peak_to_peak", "flank_scale"):
        assert getattr(found, name).tobytes() == getattr(expected, name).tobytes()


@pytest.mark.parametrize("given", [
    {"te_scale": [0.5, 1.0, -2.0], "backlash": [1e-3, 2e-3, 3e-3]},
    {"drive_torque": [1.0, 2.0, 3.0], "mesh_stiffness": [1e8, 2e8, 3e8],
     "pinion_inertia": [1e-3, 2e-3, 3e-3]},
    {"mesh_frequency_hz": [90.0, 95.0, 99.0], "mesh_damping": [10.0, 20.0, 30.0],
     "restitution": [0.1, 0.5, 0.9], "pinion_base_lever": [0.03, 0.04, 0.05]},
    {"parabola_amplitude": [1e-5, 2e-5, -3e-5], "brake_torque": [1.0, 2.0, 3.0]}])
@pytest.mark.parametrize("degrees", [1, 2])
def test_numbers_of_several_parameters_are_those_of_each_oscillator(given, degrees):
    te = TransmissionError.parabola(4e-5)
    operation = {name: number for name, number in (
        ("brake_torque", 4.4), ("mesh_frequency_hz", 100.0), ("degrees_of_freedom", degrees))
        if name not in given}
    values = {name: np.array(one) for name, one in given.items()}
    found = points_at(PAIR, te, values, operation)
    one_by_one = []
    for i in range(3):
        pair, curve, at = moved_to(PAIR, te, {name: array[i] for name, array in values.items()},
                                   operation)
        one_by_one.append(pair.oscillator(curve, **at))
    expected = Points.of(one_by_one)
    for name in (*NUMBERS, "peak_to_peak", "flank_scale"):
        # A square of many numbers at once may differ in its last bit.
        np.testing.assert_allclose(getattr(found, name), getattr(expected, name), rtol=1e-15)


def test_a_scaled_transmission_error_is_another_transmission_error():
    scaled = sweep(PAIR, TE, parameter="te_scale", values=[0.5, 1.0, 2.0], starts=("rest", "up"),
                   brake_torque=3.0, mesh_frequency_hz=400.0, settle=50, record=20)
    for factor in scaled["te_scale"].values:
        one = sweep(PAIR, float(factor) * TE, values=[3.0], starts=("rest",), settle=50,
                    mesh_frequency_hz=400.0, record=20)
        at = scaled.sel(te_scale=factor, start="rest")
        # By powers of two nothing is rounded.
        for name in ("deepest_separation", "impacts", "phi"):
            assert np.array_equal(at[name].values, one[name].values[0, 0], equal_nan=True)
    assert len(set(scaled["deepest_separation"].values[0, :, -1])) == 3


def test_an_amplitude_is_that_of_a_parabola():
    te = TransmissionError.parabola(1e-4)
    found = oscillator_at(PAIR, te, "parabola_amplitude", 5e-5,
                          {"brake_torque": 1.0, "mesh_frequency_hz": 90.0})
    assert found.te_scale == 0.5 and found.flank_scale == 0.5 * PAIR.gear_ratio
    for other in (TE, TransmissionError.parabola(0.0)):
        with pytest.raises(ValueError, match="parabola_amplitude goes with"):
            oscillator_at(PAIR, other, "parabola_amplitude", 5e-5,
                          {"brake_torque": 1.0, "mesh_frequency_hz": 90.0})


def test_every_parameter_is_one_of_the_functions_that_vary_it():
    assert {"brake_torque", "mesh_frequency_hz", "backlash"} < set(parameters())


def test_python_varies_what_a_deck_varies():
    """Not the numbers of teeth, which are whole."""
    assert set(map(base_name, parameters(TE))) == set(numeric_parameters())
    assert "te" not in parameters(TE) and "te" in parameters(TE, curves=True)


def test_the_first_value_refused_is_named():
    with pytest.raises(ValueError, match="mesh_frequency_hz = -2"):
        Varied(PAIR, TE, "mesh_frequency_hz", np.array([1.0, -2.0, -3.0]), {"brake_torque": 1.0})


def test_oscillators_are_made_when_asked_for():
    found = Varied(PAIR, TE, "brake_torque", np.linspace(1, 2, 1000), {"mesh_frequency_hz": 90.0})
    assert len(found._made) == 1
    assert found[-1].brake_torque == 2.0 and found[:2][0].brake_torque == 1.0
    with pytest.raises(IndexError):
        found[1000]


@pytest.mark.parametrize("law", ["restitution", "compliant"])
def test_periods_and_classes_are_those_of_the_tables(law):
    """The engine's own row for each point, against the same rules on the cycles it recorded."""
    data = sweep(PAIR, SHIPPED, values=np.linspace(0.3, 13.0, 40), settle=300, record=100,
                 mesh_frequency_hz=100.0, contact_law=law, threads=2)
    counts = ("counted_impacts", "counted_back_impacts") if law == "restitution" \
        else ("engages", "back_engages")
    for start in range(data.sizes["start"]):
        for j, force in enumerate(data["force"].values):
            one = data.isel(start=start, brake_torque=j)
            labels = np.column_stack([one[name].values for name in LABELS])
            scale = max(abs(force), one["deepest_separation"].values.max())
            period = find_period(one["phi"].values, one["phi_dot"].values, labels, scale)
            chatter = np.any(one["chatter_ends"] + one["back_chatter_ends"] > 0)
            assert int(one["period"]) == period
            assert str(one["motion_class"].values) == motion_class(
                period, *(one[name].values for name in counts), bool(chatter))
    assert len(set(data["motion_class"].values.ravel())) > 3 and np.any(data["period"] == 0)


def test_what_is_kept_is_never_that_of_others():
    """Pairs, curves and operations that come and go, at places in memory that are used again."""
    draw = np.random.default_rng(11)
    for _ in range(60):
        pair = GearPair(25, 32, 0.0078, 0.026, 0.034, draw.uniform(1e8, 4e8), 0.002, 0.8,
                        damping_ratio=draw.uniform(0, 0.2))
        te = TransmissionError.harmonic([draw.uniform(1e-5, 9e-5)])
        for scale in (1.0, -0.0, 0.0, draw.uniform(-2, 2)):
            operation = {"mesh_frequency_hz": draw.uniform(50, 500), "te_scale": scale}
            values = draw.uniform(1, 9, 3)
            found = Varied(pair, te, "brake_torque", values, operation)
            again = Varied(pair, te, "brake_torque", values + 1, operation)
            assert again.shared is found.shared
            for varied, at in ((found, values), (again, values + 1)):
                one_by_one = [pair.oscillator(te, brake_torque=value, **operation) for value in at]
                expected = Points.of(one_by_one)
                for name in (*NUMBERS, "peak_to_peak", "flank_scale"):
                    assert getattr(varied.points, name).tobytes() \
                        == getattr(expected, name).tobytes()
                assert varied.points.curves == expected.curves and list(varied) == one_by_one
