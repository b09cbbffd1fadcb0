"""Energy over a hundred thousand mesh periods in closed form (verification.md, section 5)."""

import math

import numpy as np
import pytest

from helpers import EPS, events, oscillator
from lapwing import EventKind, simulate
from test_conservation import compliant, elastic, exact_period

PERIODS = 100_000


def energies(osc, start):
    """E = φ'²/2 - Fφ + ½φ₊² + ½(φ+θ0)₋² at the beginning of each of 10⁵ mesh periods.

    And the number of smooth stretches passed.
    """
    run = simulate(osc, start, cycles=PERIODS, method="exact", observe=("cycles",))
    phi, rate = run.cycles["phi"].values, run.cycles["phi_dot"].values
    assert phi.size >= PERIODS
    energy = rate**2 / 2 - osc.force * phi
    if osc.contact_law == "compliant":
        energy += np.maximum(phi, 0) ** 2 / 2 + np.minimum(phi + osc.gap_width, 0) ** 2 / 2
    return energy, run.work["stretches"]


# Motions that end their mesh periods in ever other places, and ones that do it in a few.
CASES = {
    "bounce": (lambda: elastic(period=10.0, gap="one_flank"), ("separation", -2.0, 0.0)),
    "bounce_short": (lambda: elastic(period=0.7, gap="one_flank"), ("separation", -2.0, 0.0)),
    "ping_pong": (lambda: elastic(period=10.0, backlash=1.0), ("separation", 0.0, -2.0)),
    "compliant": (compliant, ("engagement", 0.0, 2.0)),
    "compliant_short": (lambda: compliant(period=0.7), ("engagement", 0.0, 2.0)),
    "contact": (lambda: compliant(period=3.0), ("engagement", 1.5, 0.0)),
    "contact_short": (lambda: compliant(period=0.7), ("engagement", 1.5, 0.0)),
    "both_flanks": (lambda: elastic(period=8.0, contact_law="compliant", backlash=1.0),
                    ("engagement", 0.0, 2.0)),
}


@pytest.mark.parametrize("case", CASES)
def test_energy_after_a_hundred_thousand_periods(case):
    """|ΔE/E| < 1e-12 in flight, and no secular trend.

    Rounding at random is some 4 EPS a period: √10⁵·4 EPS = 3e-13 in all. EPS/8 a period, always of
    the same sign, would be 3e-12. The trend is that of a straight line through all periods.

    In undamped contact a stretch turns (φ - F, φ') through an angle whose cosine and sine are
    rounded by EPS/2 each: E changes by up to EPS, and by the same amount whenever the stretch lasts
    as long again. More than that a stretch does not lose.
    """
    build, start = CASES[case]
    osc = build()
    energy, stretches = energies(osc, start)
    # Contact alone oscillates about φ = F, where E is not zero: measured from there.
    touches = osc.contact_law == "compliant"
    change = (energy - energy[0]) / (energy[0] + (osc.force**2 / 2 if touches else 0.0))
    limit = 1e-12 + (stretches * EPS if touches else 0.0)
    assert np.abs(change).max() < limit
    assert abs(np.polyfit(np.linspace(0, 1, change.size), change, 1)[0]) < limit


def test_ping_pong_after_a_hundred_thousand_periods():
    """Speeds at both flanks, √(2E) and √(2(E - Fθ0)), and the time of 170,000 flights."""
    run = simulate(elastic(period=2.0, backlash=1.0), ("separation", 0.0, -2.0), cycles=PERIODS,
                   method="exact", observe=("events",))
    front, back = (events(run, kind) for kind in (EventKind.IMPACT, EventKind.BACK_IMPACT))
    assert np.abs((front["velocity_before"] / 2) ** 2 - 1).max() < 1e-12
    assert np.abs(back["velocity_before"] ** 2 / 2 - 1).max() < 1e-12
    n = np.arange(1, front["tau"].size + 1)
    # τ rounds by EPS of itself; each flight's time by a few EPS of the mesh period, at random.
    expected = n * 2 * (2 - math.sqrt(2))
    assert np.abs(front["tau"] / expected - 1).max() < 1e-13 + 8 * EPS
    assert n[-1] > 170_000


def test_the_compliant_period_to_its_last_bits():
    """8.06888787159141 at v/F = 2: the mean of 10⁵ periods."""
    run = simulate(compliant(), ("engagement", 0.0, 2.0), cycles=PERIODS * 1.01, method="exact",
                   observe=("events",))
    taus = events(run, EventKind.ENGAGE)["tau"]
    assert exact_period(2.0, 1.0) == pytest.approx(8.06888787159141, rel=1e-14)
    assert taus[PERIODS - 1] / PERIODS == pytest.approx(exact_period(2.0, 1.0), rel=1e-12)


@pytest.mark.parametrize("damping_ratio", [0.01, 1.0])
def test_damped_contact_rests_where_it_should(damping_ratio):
    """Where nothing moves the tooth it comes to φ = F and stays there to the last bits."""
    osc = oscillator(damping_ratio=damping_ratio, contact_law="compliant", period=5.0)
    run = simulate(osc, ("engagement", 1.5, 0.0), cycles=20_000, method="exact",
                   observe=("cycles",))
    assert np.abs(run.cycles["phi"].values[-100:] - 1.0).max() <= 2 * EPS
    assert np.abs(run.cycles["phi_dot"].values[-100:]).max() <= 2 * EPS
