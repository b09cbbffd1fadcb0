"""Engaged response where one of two scales is far away: against 120 digits, memory, old route."""

import itertools
import json
import math
import sys

import mpmath as mp
import numpy as np
import pytest

import children
from lapwing.model import linear_response
from lapwing.model.linear_response import critical_force, engaged_response
from lapwing.model.oscillator import Oscillator
from lapwing.model.transmission_error import TransmissionError

EPS = np.finfo(float).eps
# Tables whose numbers are exact in binary: their joints hold to the last digit, as those of a
# table that was rounded do not (a jump of g' by EPS is data, to be seen at low speed).
EIGHTHS = np.array([1, 3, 5, 7]) / 8
TABLES = {
    "cusp down": TransmissionError.parabola(1.0),
    "cusp up": TransmissionError.parabola(-1.0),
    "kinked": TransmissionError.from_hermite(EIGHTHS, [0.25, -0.5, 0.5, 0.0], [1., 2., -1., 0.],
                                             [1., -3., 0.5, 0.]),
    "smooth": TransmissionError.from_hermite(EIGHTHS, [0.25, -0.5, 0.5, 0.0], [1., 2., -1., 0.]),
    "quintic": TransmissionError([0.0, 1.0], [[0.0, 1.0, -0.5, -0.5, -0.5, 0.5]], [True]),
}
# (ξ, Ω), ξ/Ω from 1e-14 to 1e7: more short steps than are taken, of one scale and of two; or so
# few that they would cancel.
SCALES = [(1e2, 1e-3), (1e4, 1.0), (1e4, 1e-3), (1e7, 1.0), (1e6, 1e3), (1e9, 1e2), (3.0, 1e-5),
          (1e3, 1e4), (1e7, 1e10), (10.0, 1e15), (2.0, 1e6), (2.0, 1e-4), (1.99, 1e-4), (1.0, 1e-4),
          (1 + 1e-6, 1e-6), (0.5, 1e-5), (0.17, 1e-4), (0.1, 1e-4), (0.01, 1e-5), (1e-4, 1e-5),
          (1e-6, 1e-5), (1e-7, 1e-4), (1e-9, 1e-6)]


def oscillator(te, ratio, xi):
    return Oscillator(te, force=0.0, mesh_frequency_ratio=ratio, damping_ratio=xi, restitution=0.8,
                      backlash=100.0)


class Reference:
    """The textbook route at 120 digits: forced polynomial and free motion on each piece."""

    def __init__(self, osc):
        te, self.xi = osc.te, mp.mpf(osc.damping_ratio)
        self.period = period = 2 * mp.pi / mp.mpf(osc.mesh_frequency_ratio)
        # A double root is parted by what 120 digits do not see.
        self.root = mp.sqrt(self.xi**2 - 1) if self.xi != 1 else mp.mpf("1e-40")
        self.knots = [mp.mpf(float(knot)) for knot in te.knots]
        self.forced, starts = [], []
        total, shift = mp.eye(2), mp.matrix(2, 1)
        jumps = [mp.mpf(float(jump)) / period for jump in te.slope_jumps()]
        for i, jump in enumerate(jumps):
            g = [mp.mpf(float(c)) / period**k for k, c in enumerate(te.coefficients[i])]
            q = [mp.mpf(0)] * 6
            for k in reversed(range(4)):
                q[k] = (-(k + 2) * (k + 1) * (g[k + 2] + q[k + 2])
                        - 2 * self.xi * (k + 1) * q[k + 1])
            self.forced.append(q)
            shift[1] -= jump
            starts.append((total.copy(), shift.copy()))
            width = (self.knots[i + 1] - self.knots[i]) * period
            step = self.free(width)
            shift = step * (shift - mp.matrix(q[:2])) + self.of_forced(i, width)
            total = step * total
        state = mp.lu_solve(mp.eye(2) - total, shift)
        self.states = [matrix * state + vector for matrix, vector in starts]

    def free(self, time):
        rates = -self.xi + self.root, -self.xi - self.root
        first, second = (mp.exp(rate * time) for rate in rates)
        speed = (first - second) / (2 * self.root)
        slope = (rates[0] * first - rates[1] * second) / (2 * self.root)
        return mp.matrix([[slope + 2 * self.xi * speed, speed], [-speed, slope]]).apply(mp.re)

    def of_forced(self, i, time):
        q = self.forced[i]
        return mp.matrix([sum(c * time**k for k, c in enumerate(q)),
                          sum(k * c * time**(k - 1) for k, c in enumerate(q) if k)])

    def at(self, phase):
        """(φ, φ') at a phase."""
        phase = mp.mpf(float(phase))
        i = max(k for k in range(len(self.states)) if self.knots[k] <= phase)
        time = (phase - self.knots[i]) * self.period
        begun = self.states[i] - mp.matrix(self.forced[i][:2])
        return self.free(time) * begun + self.of_forced(i, time)


def phases(te):
    """Even ones, and ones that close in on each knot from the right."""
    near = np.concatenate([np.arange(8) / 8, 10.0**-np.arange(1, 13)])
    return np.unique(te.knots[:-1, None] + np.diff(te.knots)[:, None] * near)


@pytest.mark.parametrize(("xi", "ratio"), SCALES)
@pytest.mark.parametrize("name", TABLES)
def test_against_120_digits(name, xi, ratio):
    osc = oscillator(TABLES[name], ratio, xi)
    response = engaged_response(osc)
    assert response.edges.size < 100
    at = phases(osc.te)
    with mp.workdps(120):
        reference = Reference(osc)
        exact = np.array([[float(x) for x in reference.at(phase)] for phase in at])
        least = float(reference.at(response.minimum_phase)[0])
    value, slope = np.abs(exact).max(axis=0)
    # Ten roundings of the largest φ; and those of the time that an oscillation lasts, as often as
    # it comes round before it is lost.
    close = 10 * EPS
    if xi < 1:
        turns = np.exp(complex(-xi, math.sqrt(1 - xi**2)) * osc.period)
        close += 4 * EPS * min(osc.period, 1 / xi) / abs(1 - turns)
    assert np.abs(response.penetration(at) - exact[:, 0]).max() <= close * value
    assert np.abs(response.penetration(at, 1) - exact[:, 1]).max() <= close * slope
    assert response.minimum == pytest.approx(least, rel=0, abs=close * value)
    assert response.minimum <= exact[:, 0].min() + close * value


@pytest.mark.parametrize(("xi", "ratio"), [(30.0, 0.04), (2.5, 4e-3), (1.5, 2e-3), (1.0, 2e-3),
                                           (0.3, 1e-3), (0.1, 1e-3), (0.01, 1e-3), (1e-4, 1e-3)])
@pytest.mark.parametrize("name", TABLES)
def test_both_routes_agree_where_either_is_taken(name, xi, ratio):
    """The least value among thousands of short steps, and that of a few long ones."""
    osc = oscillator(TABLES[name], ratio, xi)
    assert linear_response._short_steps(osc) <= linear_response._MOST_STEPS
    short, of_long = linear_response._unforced(osc), linear_response._long_response(osc)
    assert of_long.edges.size < 0.1 * short.edges.size
    at = phases(osc.te)
    # Roundings of thousands of steps, of φ and of g', as often as the free motion goes round.
    largest = np.abs(short.penetration(at)).max() + np.abs(osc.te.slope(at)).max() / osc.period
    close = 20 * short.edges.size * EPS / (1 - math.exp(-min(xi, 0.5 / xi) * osc.period))
    assert np.abs(of_long.penetration(at) - short.penetration(at)).max() <= close * largest
    assert of_long.minimum == pytest.approx(short.minimum, rel=0, abs=close * largest)
    assert of_long.penetration(of_long.minimum_phase) == pytest.approx(
        of_long.minimum, rel=0, abs=close * largest)


def test_many_pieces_of_every_kind_of_length():
    """Widths from 1e-5 to 0.3 of a period: short against both decays, one, none."""
    rng = np.random.default_rng(7)
    width = 10.0 ** rng.uniform(-5, -0.5, 200)
    knots = np.cumsum(width / width.sum())[:-1]
    te = TransmissionError.from_samples(knots, rng.standard_normal(199), rng.integers(0, 2, 199))
    osc = oscillator(te, 0.05, 40.0)
    short, of_long = linear_response._response_to_table(osc), linear_response._long_response(osc)
    response = linear_response.EngagedResponse(
        *short, np.zeros((len(short[1]), 2)), osc.period, 40.0, 0.0, 0.0)
    at = np.linspace(0, 1, 4000, endpoint=False)
    exact = response.penetration(at)
    # Ten thousand steps, a few roundings each.
    close = 4 * EPS * response.edges.size * np.abs(exact).max()
    assert np.abs(of_long.penetration(at) - exact).max() <= close
    assert of_long.minimum <= exact.min() + close


@pytest.mark.parametrize("derivative", [2, 3])
def test_derivatives_follow_the_equation(derivative):
    osc = oscillator(TABLES["smooth"], 1e-4, 0.5)
    response = engaged_response(osc)
    at = np.arange(1, 40) / 41
    speed = osc.mesh_frequency_ratio / (2 * math.pi)
    value, slope, acceleration = (response.penetration(at, k + derivative - 2) for k in range(3))
    pushed = osc.te.derivative(derivative, at) * speed**derivative
    assert acceleration == pytest.approx(-pushed - 2 * 0.5 * slope - value, rel=0,
                                         abs=1e-14 * np.abs(pushed).max())


def test_the_ends_of_what_is_accepted():
    for xi, ratio in itertools.product((1e-9, 1.0, 1e3, 1e70), (1e-70, 1.2345, 1e70)):
        force, phase = critical_force(oscillator(TABLES["kinked"], ratio, xi))
        assert math.isfinite(force) and 0 <= phase < 1


CHILD = """
import json
from lapwing import Oscillator, TransmissionError, critical_force

def peak():  # of this program alone: ru_maxrss also counts the process that began it
    with open("/proc/self/status") as file:
        return next(int(line.split()[1]) for line in file if line.startswith("VmHWM"))

tables = [TransmissionError.parabola(1e-4), TransmissionError.harmonic([1e-4, 2e-5]),
          TransmissionError.from_samples([0.0, 0.1, 0.35, 0.8], [0.0, 2e-5, -1e-5, 3e-5])]
begun = peak()
count = 0
for te in tables:
    for xi in (1e-12, 1e-3, 0.1, 1.0, 100.0, 1e7):
        for power in range(-3, 8):
            ratio = xi / 10.0**power
            count += critical_force(Oscillator(
                te, force=0.0, mesh_frequency_ratio=ratio, damping_ratio=xi, restitution=0.5,
                backlash=1.0)).force >= 0
print(json.dumps([int(count), (peak() - begun) / 1024]))
"""


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="reads /proc")
def test_memory_does_not_follow_the_ratio_of_two_scales():
    count, megabytes = json.loads(children.carried_out(CHILD).said)
    # SciPy's linear algebra among them.
    assert count == 3 * 6 * 11 and megabytes < 100
