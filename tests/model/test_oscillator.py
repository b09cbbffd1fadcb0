"""Oscillator: derived quantities and every refused combination."""

import itertools
import math
from dataclasses import FrozenInstanceError

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from helpers import EPS, PAIR, SHIPPED
from lapwing.base.codes import ContactLaw, EventKind, Flank, Gap, ImpactLaw, MotionState, Status
from lapwing.model.oscillator import Oscillator, names
from lapwing.model.transmission_error import TransmissionError

TE = TransmissionError.parabola(1e-3)  # values from -1e-3 to 0
BASE = {"te": TE, "force": 1e-4, "mesh_frequency_ratio": 0.25, "gear_ratio": 1.5,
        "damping_ratio": 0.1, "restitution": 0.8, "backlash": 0.002}


def build(**changes):
    options = BASE | changes
    return Oscillator(options.pop("te"), **options)


def test_period_and_flank_scale():
    assert build().period == 8 * math.pi
    assert build().flank_scale == 1.5
    assert build(te_sign="geometric").flank_scale == -1.5
    assert build().flank_extrema == pytest.approx((-1.5e-3, 0), abs=1e-18)
    assert build(te_sign="geometric").flank_extrema == pytest.approx((0, 1.5e-3), abs=1e-18)


def test_gap_width():
    assert build().gap_width == 0.002
    assert build(gap="symmetric").gap_width == 0.004
    assert build(gap="one_flank").gap_width == math.inf


@pytest.mark.parametrize(("changes", "scale"), [
    ({}, 1.5e-3),  # the flank's motion
    ({"force": -1.8e-3}, 1.8e-3),  # a larger force, any sign
    ({"force": 1.0}, 0.002),  # never above the backlash
    ({"te": TransmissionError.parabola(0.0)}, 1e-4),
    ({"te": TransmissionError.parabola(0.0), "force": 0.0}, 0.002),  # nothing else is left
])
def test_angle_scale(changes, scale):
    assert build(**changes).angle_scale == pytest.approx(scale, rel=1e-15)


@given(st.floats(-1, 1))
@settings(deadline=None)
def test_with_force_changes_nothing_else(force):
    osc = build(gap="symmetric", te_sign="geometric")
    other = osc.with_force(force)
    assert other.force == force
    assert other.with_force(osc.force) == osc


def test_oscillators_do_not_change():
    with pytest.raises(FrozenInstanceError):
        build().force = 0.0
    with pytest.raises(ValueError, match="force"):
        build().with_force(math.nan)


@pytest.mark.parametrize(("changes", "part"), [
    ({"force": math.inf}, "force"), ({"force": None}, "force"),
    ({"mesh_frequency_ratio": 0.0}, "mesh_frequency_ratio"),
    ({"gear_ratio": -1.0}, "gear_ratio"), ({"damping_ratio": -1e-9}, "damping_ratio"),
    ({"restitution": -0.1}, "restitution"), ({"restitution": math.nan}, "restitution"),
    ({"backlash": 0.0}, "backlash"), ({"contact_law": "elastic"}, "contact_law"),
    ({"impact_law": "Relative"}, "impact_law"), ({"gap": "two_sided"}, "gap"),
    ({"te_sign": 1}, "te_sign"), ({"back_flank_te": 0}, "back_flank_te"),
    ({"te": [1, 2]}, "te must be"),
])
def test_refused_values(changes, part):
    with pytest.raises(ValueError, match=part) as caught:
        build(**changes)
    assert len(caught.value.problems) == 1


@pytest.mark.parametrize("choice", [*itertools.product(
    names(ContactLaw), names(ImpactLaw), names(Gap), (True, False), ("printed", "geometric"))])
def test_every_combination_of_choices(choice):
    """Refused are exactly the absolute impact law without restitution contact."""
    keys = ("contact_law", "impact_law", "gap", "back_flank_te", "te_sign")
    options = dict(zip(keys, choice, strict=True))
    if options["impact_law"] == "absolute" and options["contact_law"] != "restitution":
        with pytest.raises(ValueError, match="'absolute' goes with"):
            build(**options)
    else:
        assert build(**options).contact_law == options["contact_law"]


def test_standing_coast_flank_must_stay_behind_the_drive_flank():
    # min g = -1.5e-3 with the printed sign, 0 with the geometric one.
    tight = {"backlash": 1.5e-3, "back_flank_te": False}
    with pytest.raises(ValueError, match="standing coast flank"):
        build(**tight)
    assert build(**tight | {"backlash": 1.5001e-3})
    assert build(**tight | {"gap": "symmetric"})
    assert build(**tight | {"gap": "one_flank"})
    assert build(**tight | {"te_sign": "geometric"})
    assert build(**tight | {"back_flank_te": True})


def test_all_refusals_at_once():
    with pytest.raises(ValueError) as caught:
        build(te=None, force="1", mesh_frequency_ratio=-1, restitution=2, backlash=0, gap="x",
              contact_law="rigid", impact_law="absolute")
    assert len(caught.value.problems) == 7


def test_codes_are_the_engines_numbers():
    assert [*MotionState] == [0, 1, 2] and [*Flank] == [0, 1, 2]
    assert [*EventKind] == list(range(1, 12)) and [*Status] == list(range(7))
    assert [*ContactLaw] == [*ImpactLaw, 3] == [*Gap] == [1, 2, 3]
    assert names(Gap) == ("one_sided", "symmetric", "one_flank")
    assert EventKind.BACK_CHATTER_END == 8 and MotionState.BACK_ENGAGEMENT == 2


def test_an_oscillator_knows_the_torque_it_was_made_from():
    """As given, not as recomputed; under another force it is that of the balance."""
    driven = PAIR.oscillator(SHIPPED, brake_torque=1.8, drive_torque=2.0, pinion_speed_rpm=240)
    assert driven.brake_torque == 1.8
    assert driven.brake_torque != driven.force / PAIR.force_per_torque
    balanced = driven.with_force(3 * PAIR.force_per_torque)
    assert balanced.brake_torque == pytest.approx(3, rel=4 * EPS)
    assert build().brake_torque is None
