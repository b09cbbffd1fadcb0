"""Gear pair: derived constants, forces, speeds, refusals."""

import math
from dataclasses import replace

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lapwing.model.gear_pair import GearPair
from lapwing.model.transmission_error import TransmissionError

TE = TransmissionError.parabola(5e-5)
PAIR = GearPair(pinion_teeth=25, gear_teeth=32, pinion_inertia=0.0078, gear_inertia=0.026,
                pinion_base_lever=0.034, mesh_stiffness=3.12e8, backlash=0.002, restitution=0.8,
                damping_ratio=0.1)
EPS = 2.0**-52


def test_constants_of_the_source_gear():
    """All digits that are published with the case; the tolerance is half the last one."""
    assert PAIR.gear_ratio == 1.28
    assert PAIR.equivalent_inertia == pytest.approx(5.22956447114e-3, abs=0.5e-14)
    assert PAIR.torsional_stiffness == pytest.approx(360672, rel=4 * EPS)
    assert PAIR.natural_frequency == pytest.approx(8304.69053006, abs=0.5e-8)
    assert PAIR.natural_frequency / (2 * math.pi) == pytest.approx(1321.732549, abs=0.5e-6)
    assert PAIR.force_per_torque == pytest.approx(2.1660955106e-6, abs=0.5e-16)
    assert PAIR.xi == 0.1
    osc = PAIR.oscillator(TE, brake_torque=1.0, pinion_speed_rad_s=100.0)
    assert osc.mesh_frequency_ratio == pytest.approx(0.301034697314, abs=0.5e-12)
    assert osc.force == PAIR.force_per_torque
    assert osc.scales.natural_frequency == PAIR.natural_frequency


def test_three_ways_to_give_the_speed():
    # 240 rpm on 25 teeth is a mesh frequency of 100 Hz.
    ratios = [PAIR.oscillator(TE, brake_torque=1.0, **speed).mesh_frequency_ratio for speed in (
        {"pinion_speed_rpm": 240}, {"pinion_speed_rad_s": 8 * math.pi},
        {"mesh_frequency_hz": 100})]
    assert ratios == pytest.approx([200 * math.pi / PAIR.natural_frequency] * 3, rel=4 * EPS)


def test_mesh_damping_is_the_same_model_as_damping_ratio():
    # c' = 2ξ√(Jk)/(r_m1 n_mt)².
    critical = 2 * math.sqrt(PAIR.equivalent_inertia * PAIR.torsional_stiffness)
    damping = 0.1 * critical / PAIR.pinion_base_lever**2
    assert replace(PAIR, damping_ratio=None, mesh_damping=damping).xi == pytest.approx(
        0.1, rel=4 * EPS)


@given(st.floats(-50, 50), st.floats(0.01, 1), st.floats(0.01, 1), st.integers(3, 60),
       st.integers(3, 60))
@settings(deadline=None)
def test_balanced_torque_is_the_two_torque_formula(torque, inertia1, inertia2, teeth1, teeth2):
    """1/(i J ω'²) = i/(J2 ω'²) + 1/(i J1 ω'²): a dozen roundings."""
    pair = replace(PAIR, pinion_inertia=inertia1, gear_inertia=inertia2, pinion_teeth=teeth1,
                   gear_teeth=teeth2)
    explicit = pair.force(torque, torque / pair.gear_ratio)
    assert explicit == pytest.approx(pair.force(torque), rel=24 * EPS, abs=1e-300)


def test_unbalanced_and_negative_torque():
    force = PAIR.force(2.0, 3.0)
    k_over_j = PAIR.natural_frequency**2
    assert force == pytest.approx((1.28 * 2 / 0.026 + 3 / 0.0078) / k_over_j, rel=8 * EPS)
    osc = PAIR.oscillator(TE, brake_torque=-1, drive_torque=0.0, pinion_speed_rpm=240)
    assert osc.force < 0


@given(st.floats(0.1, 10))
@settings(deadline=None)
def test_torque_and_inertia_units_cancel(factor):
    """Inertia and stiffness in another mass unit, torque likewise: nothing dimensionless moves."""
    other = replace(PAIR, pinion_inertia=0.0078 * factor, gear_inertia=0.026 * factor,
                    mesh_stiffness=3.12e8 * factor)
    assert other.natural_frequency == pytest.approx(PAIR.natural_frequency, rel=8 * EPS)
    assert other.force(factor) == pytest.approx(PAIR.force(1.0), rel=8 * EPS)


@pytest.mark.parametrize(("change", "key"), [
    ({"pinion_teeth": 0}, "pinion_teeth"), ({"pinion_teeth": 25.0}, "pinion_teeth"),
    ({"gear_teeth": True}, "gear_teeth"), ({"pinion_inertia": 0.0}, "pinion_inertia"),
    ({"gear_inertia": -1.0}, "gear_inertia"), ({"pinion_base_lever": math.nan}, "lever"),
    ({"mesh_stiffness": math.inf}, "mesh_stiffness"), ({"backlash": 0.0}, "backlash"),
    ({"restitution": 1.1}, "restitution"), ({"restitution": "0.8"}, "restitution"),
    ({"damping_ratio": -0.1}, "damping_ratio"), ({"mesh_damping": 1.0}, "exactly one"),
    ({"damping_ratio": None}, "exactly one"),
    ({"damping_ratio": None, "mesh_damping": -1.0}, "mesh_damping"),
])
def test_refused_parameters(change, key):
    with pytest.raises(ValueError, match=key) as caught:
        replace(PAIR, **change)
    assert len(caught.value.problems) == 1


def test_all_refusals_at_once():
    with pytest.raises(ValueError) as caught:
        GearPair(0, 1.5, -1, 0, math.nan, "stiff", 0, 2)
    text = str(caught.value)
    for key in ("pinion_teeth", "gear_teeth", "pinion_inertia", "gear_inertia",
                "pinion_base_lever", "mesh_stiffness", "backlash", "restitution", "exactly one"):
        assert key in text
    assert len(caught.value.problems) == 9


@pytest.mark.parametrize(("options", "part"), [
    ({}, "exactly one of pinion_speed_rpm"),
    ({"pinion_speed_rpm": 1, "mesh_frequency_hz": 1}, "pinion_speed_rpm and mesh_frequency_hz"),
    ({"pinion_speed_rpm": -240}, "pinion_speed_rpm = -240"),
    ({"pinion_speed_rpm": 240, "drive_torque": math.inf}, "drive_torque"),
    ({"pinion_speed_rpm": 240, "brake_torque": None}, "brake_torque"),
])
def test_refused_operating_points(options, part):
    with pytest.raises(ValueError, match=part):
        PAIR.oscillator(TE, **({"brake_torque": 1.0} | options))


def test_operating_point_and_laws_are_refused_together():
    with pytest.raises(ValueError) as caught:
        PAIR.oscillator(TE, brake_torque=math.nan, contact_law="rigid", impact_law="absolute",
                        gap="wide", te_sign="plus")
    for part in ("exactly one", "brake_torque", "impact_law", "gap", "te_sign"):
        assert part in str(caught.value)
    assert len(caught.value.problems) == 5
