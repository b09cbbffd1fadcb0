"""Newton on the stroboscopic map: period doubling of the bouncing ball and its cascade, exact."""

import math
import pickle

import numpy as np
import pytest

from helpers import ball, ball_start, oscillator
from lapwing import MotionState
from lapwing.studies.orbit import NoOrbit, cascade, find_orbit, follow, period_doubling

LAWS = ("restitution", "rigid")
# Γ_PD = √([nπ(1-ε)/(1+ε)]² + [2(1+ε²)/(1+ε)²]²) for n = 1.
EXACT = {0.0: 3.72419177824, 0.3: 2.12733368723, 0.5: 1.52682370052, 0.8: 1.07083646825,
         0.9: 1.0163107123}


def first_doubling(restitution):
    return math.hypot(math.pi * (1 - restitution) / (1 + restitution),
                      2 * (1 + restitution**2) / (1 + restitution) ** 2)


@pytest.mark.parametrize("contact_law", LAWS)
@pytest.mark.parametrize("restitution", list(EXACT))
def test_first_period_doubling(contact_law, restitution):
    """To 1e-8, which is how well the table holds the curvature of its harmonic."""
    exact = first_doubling(restitution)
    assert exact == pytest.approx(EXACT[restitution], rel=1e-11)
    found, orbit = period_doubling(lambda gamma: ball(gamma, restitution, contact_law),
                                   0.97 * exact, 1.01 * exact,
                                   ball_start(0.97 * exact, restitution))
    assert found == pytest.approx(exact, rel=1e-8)
    assert orbit.multipliers.values == pytest.approx([-1, -(restitution**2)], abs=1e-11)
    assert orbit.multipliers.rank == (2 if restitution else 1)


# The ratios (Γ_k - Γ_(k-1))/(Γ_(k+1) - Γ_k), four digits, and for ε = 0.5 the values themselves.
RATIOS = {0.3: [4.366, 4.599, 4.651], 0.5: [4.732, 4.633, 4.651],
          0.8: [6.085, 5.962, 4.824, 4.664]}
CASCADE = [1.526823701, 1.667130661, 1.696780746, 1.703180526]


@pytest.mark.parametrize("restitution", list(RATIOS))
def test_cascade(restitution):
    expected = RATIOS[restitution]
    first = first_doubling(restitution)
    found = cascade(lambda gamma: ball(gamma, restitution), 0.98 * first, 1.1 * first,
                    ball_start(0.98 * first, restitution), len(expected) + 2)
    values = np.array([value for value, _ in found])
    steps = np.diff(values)
    assert (steps[:-1] / steps[1:]).round(3).tolist() == expected
    if restitution == 0.5:
        assert values[:4] == pytest.approx(CASCADE, rel=1e-8)
    assert [orbit.cycles for _, orbit in found] == [2**k for k in range(len(found))]
    for _, orbit in found:
        assert orbit.multipliers.values[0] == pytest.approx(-1, abs=1e-9)
        assert orbit.multipliers.log_det == pytest.approx(
            2 * orbit.cycles * math.log(restitution), rel=1e-13)


def test_no_doubling_where_there_is_none():
    with pytest.raises(NoOrbit, match="no multiplier passes -1"):
        period_doubling(lambda gamma: ball(gamma, 0.7), 0.9, 1.0, ball_start(0.9, 0.7))


def test_no_orbit_is_said_so():
    """A ball at 1 % below the saddle-node has no such orbit."""
    gamma = 0.99 * math.pi * 0.3 / 1.7
    start = ball_start(math.pi * 0.3 / 1.7 * 1.0001, 0.7)
    with pytest.raises(NoOrbit, match="no motion of 1 mesh cycles found"):
        find_orbit(ball(gamma, 0.7), start)


def test_a_start_that_contradicts_itself_is_no_orbit():
    with pytest.raises(NoOrbit, match="in another motion state"):
        find_orbit(oscillator(), (MotionState.SEPARATION, 1.0, 0.0))


def test_a_motion_that_is_lost_says_why_and_where():
    """The ball's orbit ends in a saddle-node at Γ = 0.3π/1.7 for ε = 0.7."""
    end = math.pi * 0.3 / 1.7
    values = np.linspace(1.1 * end, 0.9 * end, 9)
    found = follow(lambda gamma: ball(gamma, 0.7), values, ball_start(values[0], 0.7))
    assert 0 < len(found) < len(values)
    lost = values[len(found)]
    assert f"at parameter value {lost:.10g}" in found.lost
    assert "no motion of 1 mesh cycles found" in found.lost


def test_a_motion_followed_to_the_end_is_not_lost():
    values = [0.9, 0.91]
    found = follow(lambda gamma: ball(gamma, 0.7), values, ball_start(values[0], 0.7))
    assert len(found) == 2
    assert found.lost is None


def test_no_orbit_names_the_parameter():
    end = math.pi * 0.3 / 1.7
    with pytest.raises(NoOrbit, match=r"at parameter value 0\.\d+: no motion") as caught:
        period_doubling(lambda gamma: ball(gamma, 0.7), 0.9 * end, 0.95 * end,
                        ball_start(1.1 * end, 0.7))
    assert caught.value.value == 0.9 * end
    again = pickle.loads(pickle.dumps(caught.value))
    assert (str(again), again.value) == (str(caught.value), caught.value.value)
