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
