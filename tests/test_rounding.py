"""RK4 where rounding is larger than the tolerance: work follows what happens."""

import pytest

from lapwing import Oscillator, Status, TransmissionError, simulate

FORCE = 0.00415384


@pytest.mark.parametrize("rtol", [1e-13, 1e-11, 1e-9, 1e-6])
@pytest.mark.parametrize("gap", [1e-12, 1e-9, 6.172e-10, 1e-6, 1e-3, 1.0])
def test_a_tooth_that_creeps_to_rest_in_a_narrow_gap(gap, rtol):
    """The natural size of angles is the gap, that of the motion the force over it.

    Creep over 175 units of time at a rate of 2ξ = 10: RK4 is stable for steps below 2.785/9.9,
    which makes 623 of them, and a tolerance below rounding takes some ten times as many.
    """
    osc = Oscillator(TransmissionError.harmonic([0.0]), force=FORCE, mesh_frequency_ratio=.35883,
                     damping_ratio=5., restitution=0., backlash=FORCE * gap)
    start = ("separation", 0., 0.)
    run = simulate(osc, start, cycles=10, rtol=rtol, method="rk4")
    exact = simulate(osc, start, cycles=10, method="exact")
    assert run.status == Status.OK and run.work["steps"] < 10_000
    # A sum of this many roundings of the force, or the tolerance of the smallest size there is.
    assert run.final.phi == pytest.approx(exact.final.phi, rel=1e-13, abs=rtol * osc.angle_scale)
