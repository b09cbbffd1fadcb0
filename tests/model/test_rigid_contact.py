"""Smallest force that keeps a rigid tooth on the flank: exact values, kinks, the engine itself."""

import math
from dataclasses import replace

import numpy as np
import pytest

from helpers import EPS, PAIR, SHIPPED, kinds, oscillator
from lapwing import EventKind, TransmissionError, lift_off_force, simulate
from lapwing.model.rigid_contact import STRUCK, THROWN_OFF


def rigid(te, **options):
    return oscillator(te, **{"period": 5.0, "contact_law": "rigid", **options})


@pytest.mark.parametrize("sign", ["printed", "geometric"])
def test_one_harmonic(sign):
    """F = A'Ω², where g'' is greatest: at the trough of g."""
    te = TransmissionError.harmonic([1e-5], [0.7])
    osc = PAIR.oscillator(te, brake_torque=1, pinion_speed_rad_s=80, te_sign=sign)
    found = lift_off_force(osc)
    assert found.force == pytest.approx(1.28e-5 * osc.mesh_frequency_ratio**2, rel=8 * EPS)
    trough = (0.5 if sign == "printed" else 0.0) - 0.7 / (2 * math.pi)
    assert found.phase == pytest.approx(trough % 1, abs=1e-7)  # flat top: √EPS
    assert found.reason == ""


def test_published_torque():
    te = TransmissionError.harmonic([1e-5])
    osc = PAIR.oscillator(te, brake_torque=1, pinion_speed_rad_s=80)
    torque = lift_off_force(osc).force / PAIR.force_per_torque
    assert torque == pytest.approx(0.342724737180862, rel=1e-14)


def test_the_series_and_its_table_agree():
    te = TransmissionError.harmonic([1.0, 0.3, 0.1], [0.0, 1.0, 2.0])
    exact, of_table = (lift_off_force(rigid(one)) for one in (te, replace(te, harmonics=())))
    # The table's curvature is promised to 1e-8 of its greatest.
    assert of_table.force == pytest.approx(exact.force, rel=1e-8)


@pytest.mark.parametrize("te_sign", ["printed", "geometric"])
def test_the_greatest_curvature_of_a_table(te_sign):
    osc = rigid(SHIPPED, te_sign=te_sign)
    found = lift_off_force(osc)
    sign = osc.flank_scale / osc.period**2
    sampled = sign * SHIPPED.curvature(np.arange(20_000) / 20_000)
    assert found.force >= sampled.max()
    # Curvature jumps between pieces: one of the two sides attains it.
    attained = [sign * float(SHIPPED.curvature(found.phase, side)) for side in ("left", "right")]
    assert found.force == pytest.approx(max(attained), rel=100 * EPS)


def test_kinks():
    """Cusp down throws off, cusp up strikes, and with no restitution rests again at once."""
    down, up = TransmissionError.parabola(1.0), TransmissionError.parabola(-1.0)
    assert lift_off_force(rigid(down)) == (math.inf, 0.0, THROWN_OFF)
    assert lift_off_force(rigid(up)) == (math.inf, 0.0, STRUCK)
    assert lift_off_force(rigid(down, te_sign="geometric")).reason == STRUCK
    dead = lift_off_force(rigid(up, restitution=0.0))
    assert dead.force == pytest.approx(8 / 25, rel=4 * EPS) and dead.reason == ""


@pytest.mark.parametrize("change", [-1e-6, 1e-6])
def test_the_engine_lets_go_below_and_not_above(change):
    osc = rigid(SHIPPED, backlash=10.0)
    osc = osc.with_force(lift_off_force(osc).force * (1 + change))
    assert (EventKind.RELEASE in kinds(simulate(osc, cycles=2))) == (change < 0)
