"""The period finder on motions whose period is known."""

import numpy as np
import pytest

from lapwing.studies.period import NO_PERIOD, find_period

CYCLES = 100


def labels(n=CYCLES):
    return np.zeros((n, 1))


@pytest.mark.parametrize("p", [1, 2, 3, 5, 12, 24])
def test_repeating_states_have_their_period(p):
    phi = np.resize(np.linspace(0.1, 1.0, p), CYCLES)
    assert find_period(phi, -phi, labels(), scale=1.0) == p


def test_random_states_have_no_period():
    phi = np.random.default_rng(1).normal(size=CYCLES)
    assert find_period(phi, phi, labels(), scale=1.0) == NO_PERIOD


def test_labels_must_repeat_too():
    """Equal states, but a chatter in every other cycle: period 2."""
    chatter = np.resize([0, 1], CYCLES)[:, None]
    phi = np.full(CYCLES, 0.3)
    assert find_period(phi, phi, chatter, scale=1.0) == 2


@pytest.mark.parametrize("multiplier", [-0.9, -0.99, -0.999, -0.9999])
def test_decaying_flip_is_not_period_two(multiplier):
    """States two cycles apart agree to 1e-8 long before the alternation has died out."""
    phi = 1e-6 * multiplier ** np.arange(CYCLES)
    alternation = np.abs(np.diff(phi))[-1]
    expected = 1 if alternation < 1e-8 else NO_PERIOD
    assert find_period(phi, phi, labels(), scale=1.0) == expected


def test_fast_transient_ends_in_its_period():
    """0.5**100 is far below rounding: what is left is the period."""
    phi = np.resize([0.2, 0.7, 0.4], CYCLES) + 0.5 ** np.arange(CYCLES)
    assert find_period(phi, phi, labels(), scale=1.0) == 3


def test_slow_drift_is_no_period():
    """1e-9 per cycle, never falling: within the tolerance from one cycle to the next, and yet."""
    phi = 1e-9 * np.arange(CYCLES)
    assert find_period(phi, phi, labels(), scale=1.0) == NO_PERIOD


def test_too_few_cycles_decide_nothing():
    phi = np.zeros(8)
    assert find_period(phi, phi, labels(8), scale=1.0) == NO_PERIOD
    phi = np.zeros(9)
    assert find_period(phi, phi, labels(9), scale=1.0) == 1


def test_failed_cycles_have_no_period():
    phi = np.full(CYCLES, np.nan)
    assert find_period(phi, phi, labels(), scale=1.0) == NO_PERIOD


@pytest.mark.parametrize("multiplier", [-0.9, -0.999, -0.9999, -0.99999])
@pytest.mark.parametrize("noise", [0.0, 1e-11])
def test_the_end_of_a_decaying_flip_is_not_period_two(multiplier, noise):
    """Down to an alternation that only just counts, period 2 is never read; 1 is, in the end."""
    random = np.random.default_rng(3)
    found = []
    for alternation in 10.0 ** np.arange(-3.0, -11.0, -0.5):
        if abs(alternation * (1 - abs(multiplier)) * CYCLES / 4) < 1e-11:
            # It fades by less than noise within the record: only the multiplier could tell.
            alternation = 1e-9
        phi = 0.5 * alternation * multiplier ** np.arange(CYCLES)
        phi += noise * random.uniform(-1, 1, CYCLES)
        found.append(find_period(phi, phi, labels(), scale=1.0))
    assert set(found) <= {NO_PERIOD, 1} and found[-1] == 1


def test_a_settled_motion_of_small_period_two_is_found():
    """An alternation of 1e-6 that stays, with the noise of a settled motion."""
    random = np.random.default_rng(4)
    for _ in range(200):
        phi = 1e-6 * (-1.0) ** np.arange(CYCLES) + 1e-11 * random.uniform(-1, 1, CYCLES)
        assert find_period(phi, phi, labels(), scale=1.0) == 2


def test_the_last_of_a_transient_does_not_hide_a_period():
    """Period 6 whose transient, a tenth a cycle, has come down to 1e-9 within the record."""
    phi = np.resize([0.1, 0.5, 0.2, 0.9, 0.3, 0.4], CYCLES) + 1e-2 * 0.8 ** np.arange(CYCLES)
    assert find_period(phi, phi, labels(), scale=1.0) == 6
