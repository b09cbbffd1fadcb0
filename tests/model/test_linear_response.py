"""Engaged periodic response: published numbers, independent routes, the defining equations."""

import math
from dataclasses import replace
from pathlib import Path

import mpmath as mp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lapwing.model.gear_pair import GearPair
from lapwing.model.linear_response import critical_force, critical_torque, engaged_response
from lapwing.model.oscillator import Oscillator
from lapwing.model.transmission_error import TransmissionError

PAIR = GearPair(25, 32, 0.0078, 0.026, 0.034, 3.12e8, 0.002, 0.8, damping_ratio=0.1)
SHIPPED = TransmissionError.from_file(Path(__file__).parents[2] / "inputs" / "te_25x32.csv")
KINKED = TransmissionError.from_hermite([0.1, 0.35, 0.8], [0.3, -0.2, 0.5], [1.0, 2.0, -1.0],
                                        [1.0, -3.0, 0.5])
EPS = np.finfo(float).eps


def oscillator(te, ratio=0.25, xi=0.1, **options):
    return Oscillator(te, force=0.0, mesh_frequency_ratio=ratio, damping_ratio=xi, restitution=0.8,
                      backlash=1.0, **options)


# --- numbers ----------------------------------------------------------------------------------


def test_smallest_torque_of_complete_engagement_of_the_25x32_pair():
    torque, phase = critical_torque(PAIR.oscillator(SHIPPED, brake_torque=1, pinion_speed_rpm=240))
    # 83 units of τ in 85 steps, each adding a few EPS of the largest φ (some 3 times the result).
    assert torque == pytest.approx(11.91674543671654, rel=1e-12)
    assert phase == pytest.approx(0.951456732183, abs=1e-12)


@pytest.mark.parametrize(("amplitude", "torque", "phase"), [
    (5e-5, 7.91172170554951, 0.0544588974985), (-5e-5, 6.37009018606437, 0.175479399301)])
def test_kinked_parabola(amplitude, torque, phase):
    osc = PAIR.oscillator(TransmissionError.parabola(amplitude), brake_torque=1,
                          pinion_speed_rad_s=80)
    assert osc.mesh_frequency_ratio == pytest.approx(0.240827757851025, rel=1e-14)
    assert critical_torque(osc) == (pytest.approx(torque, rel=1e-13),
                                    pytest.approx(phase, abs=1e-12))


def test_one_harmonic():
    osc = PAIR.oscillator(TransmissionError.harmonic([1e-5]), brake_torque=1,
                          pinion_speed_rad_s=80)
    torque, _ = critical_torque(osc)
    # A sum of one term and a minimum between steps: a few roundings.
    assert torque == pytest.approx(0.363351256023877, rel=1e-14)


def without_series(te):
    """The same table, its harmonics forgotten."""
    return replace(te, harmonics=())


@pytest.mark.parametrize("ratio", [0.1, 0.3, 1.7])
def test_the_series_and_its_table_agree(ratio):
    """Two routes: the gain of each harmonic, and the pieces of the table step by step."""
    te = TransmissionError.harmonic([1.0, 0.3, 0.1], [0.0, 1.0, 2.0])
    exact, of_table = (critical_force(oscillator(one, ratio)) for one in (te, without_series(te)))
    # The table is off by 1e-12 of g, 1e-10 of g', 1e-8 of g''; see the test of the gain below.
    assert of_table.force == pytest.approx(exact.force, abs=1.4e-12 * (1 + 1 / 0.2), rel=1e-11)
    assert of_table.phase == pytest.approx(exact.phase, abs=1e-5)


def test_a_constant_of_the_series_moves_nothing():
    with_constant = TransmissionError.harmonic([0.5, 1.0], [0.0, 0.4], [0, 1])
    plain = TransmissionError.harmonic([1.0], [0.4], [1])
    assert critical_force(oscillator(with_constant)) == critical_force(oscillator(plain))


@pytest.mark.parametrize("ratio", [0.01, 0.3, 1.0, 7.0, 60.0])
@pytest.mark.parametrize("xi", [0.02, 1.0, 4.0])
def test_harmonics_against_the_fourier_gain(ratio, xi):
    series = [(1, 1.0, 0.0), (2, 0.3, 1.0), (3, 0.1, 2.0)]
    orders, amplitudes, shifts = zip(*series, strict=True)
    te = TransmissionError.harmonic(amplitudes, shifts, orders)
    response = engaged_response(oscillator(without_series(te), ratio, xi))
    phase = np.arange(400) / 400
    gains = [a * np.exp(1j * s) * (n * ratio) ** 2 / (1 - (n * ratio) ** 2 + 2j * xi * n * ratio)
             for n, a, s in series]
    exact = sum((g * np.exp(2j * np.pi * n * phase)).real
                for g, n in zip(gains, orders, strict=True))
    # Of the table: error 1e-12 of g = 1.4, fed back through damping and spring; rounding of
    # φ' = Ω dφ/du over all steps adds up to a mean force of at most steps·4 EPS·Ω/P per unit of φ.
    largest = np.abs(exact).max()
    rounding = response.edges.size * 4 * EPS * ratio**2 / (2 * math.pi) * largest
    tolerance = 1.4e-12 * (1 + 1 / (2 * xi)) + rounding + 1e-13 * largest
    assert np.allclose(response.penetration(phase), exact, rtol=0, atol=tolerance)
    assert response.minimum <= exact.min() + tolerance
    # Of the series: the two sums differ by roundings of terms and of the phase, 20 at most.
    of_series = engaged_response(oscillator(te, ratio, xi))
    close = 200 * EPS * sum(map(abs, gains))
    assert np.allclose(of_series.penetration(phase), exact, rtol=0, atol=close)
    assert exact.min() - of_series.minimum >= -close


def horner(ascending, s):
    return sum(c * s**k for k, c in enumerate(ascending))


def oracle(te, osc):
    """(particular polynomial, start state) of each piece at 40 digits, by the textbook route."""
    period, xi = 2 * mp.pi / mp.mpf(osc.mesh_frequency_ratio), mp.mpf(osc.damping_ratio)
    matrix = mp.matrix([[0, 1], [-1, -2 * xi]])
    pieces, total, shift = [], mp.eye(2), mp.matrix(2, 1)
    for i in range(te.knots.size - 1):
        width = (mp.mpf(float(te.knots[i + 1])) - mp.mpf(float(te.knots[i]))) * period
        g = [mp.mpf(float(c)) * mp.mpf(osc.flank_scale) / period**k
             for k, c in enumerate(te.coefficients[i])]
        force = [-(k + 2) * (k + 1) * g[k + 2] for k in range(4)]
        q = [mp.mpf(0)] * 6
        for k in reversed(range(4)):
            q[k] = force[k] - 2 * xi * (k + 1) * q[k + 1] - (k + 2) * (k + 1) * q[k + 2]
        pieces.append((width, q, g))
    drops = [mp.mpf(float(j)) * mp.mpf(osc.flank_scale) / period for j in te.slope_jumps()]
    starts = []
    for (width, q, _), drop in zip(pieces, drops, strict=True):
        shift[1] -= drop
        starts.append((total.copy(), shift.copy()))
        step = mp.expm(matrix * width, method="taylor")
        first = mp.matrix([q[0], q[1]])
        last = mp.matrix([horner(q, width), horner([k * c for k, c in enumerate(q)][1:], width)])
        total, shift = step * total, step * (shift - first) + last
    state = mp.lu_solve(mp.eye(2) - total, shift)
    return matrix, [(w, q, m * state + s) for (w, q, _), (m, s) in zip(pieces, starts,
                                                                      strict=True)]


@pytest.mark.parametrize("ratio", [0.3, 1.7])
@pytest.mark.parametrize("xi", [0.0, 0.1, 1.0, 1.0 + 1e-9, 2.5])
def test_against_particular_polynomial_and_matrix_exponential(ratio, xi):
    """Same table, 40 digits, classical split into forced polynomial and free motion."""
    osc = oscillator(KINKED, ratio, xi, te_sign="geometric", gear_ratio=1.28)
    response = engaged_response(osc)
    with mp.workdps(40):
        matrix, pieces = oracle(KINKED, osc)
        for (width, q, state), start, stop in zip(pieces, KINKED.knots[:-1], KINKED.knots[1:],
                                                  strict=True):
            for part in (0.0, 0.3, 0.9):
                s = width * part
                free = mp.expm(matrix * s) * (state - mp.matrix([q[0], q[1]]))
                exact = float(horner(q, s) + free[0])
                at = start + part * (stop - start)
                # φ is of order 1 to 10; rounding of the table's phases and of some 50 steps.
                assert response.penetration(at) == pytest.approx(exact, abs=2e-13)


# --- the defining equations, for any table ----------------------------------------------------

tables = st.builds(
    lambda cells, rows: TransmissionError.from_hermite(
        np.array(sorted(cells)) / 20, *np.array(rows[: len(cells)]).T),
    st.sets(st.integers(0, 19), min_size=1, max_size=5),
    st.lists(st.tuples(*[st.floats(-1, 1, allow_subnormal=False)] * 3), min_size=5, max_size=5))


@given(tables, st.floats(0.05, 20), st.sampled_from([0.03, 0.5, 1.0, 1.0 + 1e-12, 3.0]))
@settings(max_examples=60, deadline=None)
def test_equation_continuity_and_kinks(te, ratio, xi):
    osc = oscillator(te, ratio, xi)
    response = engaged_response(osc)
    # The largest term: a slope or curvature jump of the table acting through 1/(2ξ), or by itself.
    scale = (np.abs(te.coefficients) * np.diff(te.knots)[:, None] ** np.arange(6)).sum(axis=1).max()
    gain = (1 + 1 / (2 * xi)) * (1 + 2 * xi)
    edges, rate = response.edges, 1 / osc.period
    width = np.diff(edges)
    middle = edges[:-1] + 0.4 * width
    value, speed, acceleration = (response.penetration(middle, k) for k in range(3))
    residual = acceleration + 2 * xi * speed + value + te.curvature(middle) * rate**2
    # Second derivatives are sums of terms up to `scale` over the step squared; 100 roundings.
    assert np.all(np.abs(residual) <= 100 * EPS * (scale * gain + 1e-300) / (width / rate) ** 2
                  + 400 * EPS * scale * gain)
    # Left limits at the step ends, periodic: φ continuous, φ' drops by the jump of g'.
    end = response.coefficients.sum(axis=1)
    end_speed = response.coefficients @ np.arange(response.coefficients.shape[1]) / width * rate
    jump = np.zeros(edges.size - 1)
    jump[np.searchsorted(edges, te.knots[:-1])] = te.slope_jumps() * rate
    start_speed = response.penetration(edges[:-1], 1)
    steps = edges.size
    loose = 200 * EPS * steps * scale * gain
    assert np.allclose(np.roll(end, 1), response.penetration(edges[:-1]), rtol=0, atol=loose)
    assert np.allclose(np.roll(end_speed, 1) - jump, start_speed, rtol=0,
                       atol=loose * (1 + rate / width.min()))
    # The minimum is below every sample and is attained at its phase.
    assert response.minimum <= response.penetration(np.arange(3000) / 3000).min() + loose
    assert response.penetration(response.minimum_phase) == pytest.approx(
        response.minimum, abs=loose)


# --- bookkeeping ------------------------------------------------------------------------------


def test_force_shifts_the_response_and_the_critical_force_does_not_see_it():
    osc = oscillator(KINKED)
    force, phase = critical_force(osc)
    for f in (-0.5, 0.25, force):
        response = engaged_response(osc.with_force(f))
        assert response.minimum == pytest.approx(f - force, abs=1e-14)
        assert response.minimum_phase == phase
        assert critical_force(osc.with_force(f)) == (force, phase)


def test_sign_of_the_transmission_error():
    up = critical_force(oscillator(TransmissionError.parabola(-1e-3)))
    down = critical_force(oscillator(TransmissionError.parabola(1e-3), te_sign="geometric"))
    assert up == pytest.approx(down, rel=1e-13)


def test_flat_flank_never_lets_go():
    assert critical_force(oscillator(TransmissionError.parabola(0.0))) == (0.0, 0.0)


@pytest.mark.parametrize("ratio", [1.0, 0.5, 0.25])
def test_undamped_resonance_is_refused(ratio):
    with pytest.raises(ValueError, match="resonance"):
        critical_force(oscillator(KINKED, ratio, 0.0))
    assert math.isfinite(critical_force(oscillator(KINKED, ratio, 1e-3)).force)
    assert math.isfinite(critical_force(oscillator(KINKED, ratio * 1.01, 0.0)).force)


def test_torque_needs_scales():
    with pytest.raises(ValueError, match="scales"):
        critical_torque(oscillator(KINKED))
