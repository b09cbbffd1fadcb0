"""Branches against witnesses of their own: shooting without the engine, differences of the map.

Folds of the compliant oscillator have no closed form; they are solved here a second time, with the
two crossing times of the flank as unknowns, in 30 digits.
"""

import math

import numpy as np
import pytest
from mpmath import mp

import lapwing
from helpers import PAIR, SHIPPED, ball, ball_start, oscillator, scene_a, scene_c
from lapwing import TransmissionError, find_orbit, simulate
from lapwing.studies.branch import Kind, branch
from lapwing.studies.branch.motion.layout import Happening

FORCE, SIZE, DAMPING = 1.0, 0.3, 0.05


def crossing_equations(frequency, engaged, released, speed):
    """What is left of φ = 0 at the release, and of φ = 0, φ' = speed at the next engagement.

    φ'' = F + AΩ² cos u in flight, with 2ξφ' + φ on the left in contact; u = Ωτ at both times.
    """
    period = 2 * mp.pi / frequency
    # Contact: a particular solution F + Re(C e^iu) and a free oscillation about it.
    particular = SIZE * frequency**2 / (1 - frequency**2 + 2j * mp.mpf(DAMPING) * frequency)
    damped = mp.sqrt(1 - mp.mpf(DAMPING)**2)

    def forced(time):
        turned = particular * mp.exp(1j * frequency * time)
        return FORCE + turned.real, (1j * frequency * turned).real

    time = released - engaged
    place, rate = forced(engaged)
    place, rate = -place, speed - rate
    across = (rate + DAMPING * place) / damped
    fade, cosine, sine = mp.exp(-DAMPING * time), mp.cos(damped * time), mp.sin(damped * time)
    free = fade * (place * cosine + across * sine)
    free_rate = fade * (rate * cosine - (DAMPING * across + damped * place) * sine)
    after, after_rate = forced(released)
    left, leaving = free + after, free_rate + after_rate
    # Flight: θ = φ + g is a parabola.
    time = engaged + period - released
    g, g_next = (SIZE * mp.cos(frequency * one) for one in (released, engaged))
    slope, slope_next = (-SIZE * frequency * mp.sin(frequency * one) for one in (released, engaged))
    theta_rate = leaving + slope
    back = g + theta_rate * time + FORCE * time**2 / 2 - g_next
    return [left, back, theta_rate + FORCE * time - slope_next - speed]


def fold_by_shooting(frequency, engaged, released, speed):
    """Frequency at which the equations are solved and their matrix is singular, from a guess."""
    def matrix(number, *unknowns):
        def column(k):
            def moved(x):
                return crossing_equations(number, *unknowns[:k], x, *unknowns[k + 1:])
            step = mp.mpf(10)**-12
            ahead, behind = moved(unknowns[k] + step), moved(unknowns[k] - step)
            return [(one - two) / (2 * step) for one, two in zip(ahead, behind, strict=True)]
        return mp.matrix([column(k) for k in range(3)])

    def equations(*all_of_them):
        return [*crossing_equations(*all_of_them), mp.det(matrix(*all_of_them))]

    return mp.findroot(equations, (frequency, engaged, released, speed), tol=1e-35)[0]


def compliant(frequency):
    """The oscillator of these equations."""
    return oscillator(TransmissionError.harmonic([SIZE]), force=FORCE, gap="one_flank",
                      period=2 * math.pi / frequency, contact_law="compliant",
                      damping_ratio=DAMPING)


def test_folds_of_the_compliant_oscillator():
    """Its jump frequencies, harmonically driven: engaged below both, in flight above."""
    found = branch(find_orbit(compliant(0.9), settle=400), "mesh_frequency_ratio", low=0.7,
                   high=0.95)
    folds = found.of_kind(Kind.FOLD)
    assert len(folds) == 2 and {end.kind for end in found.specials} == {
        Kind.FOLD, Kind.ENGAGED, Kind.LIMIT}
    for fold in folds:
        assert fold.place.layout.kind.tolist() == [Happening.GO_ON, Happening.RELEASE]
        events = found.follower.problem.at(fold.place.z)[0]
        times = events.phase * 2 * math.pi / fold.value
        with mp.workdps(40):
            exact = float(fold_by_shooting(*map(mp.mpf, (fold.value, *times, events.speed[0]))))
        assert fold.value == pytest.approx(exact, rel=1e-11)
        assert abs(fold.value - exact) <= fold.error + 1e-15
    assert folds[0].value - folds[1].value > 0.1


def differenced(osc, start, cycles, size):
    """The map over some mesh cycles differenced to fourth order: matrix (2, 2)."""
    state, *x = start

    def at(k, step):
        beside = list(x)
        beside[k] += step
        end = simulate(osc, (state, *beside), cycles=cycles).final
        assert end.motion_state == state
        return np.array([end.phi, end.phi_dot])

    step = 2e-5 * size
    return np.column_stack([
        (8 * (at(k, step) - at(k, -step)) - at(k, 2 * step) + at(k, -2 * step)) / (12 * step)
        for k in range(2)])


def largest(matrix):
    """The eigenvalue of the largest magnitude, with a nonnegative imaginary part."""
    values = np.linalg.eigvals(matrix)
    found = values[np.argmax(np.abs(values))]
    return complex(found.real, abs(found.imag))


SCENES = {
    "ball": (lambda value: ball(value, 0.7), 0.9, {}, (0.56, 1.0)),
    "compliant": (compliant, 0.88, {"settle": 400}, (0.85, 0.885)),
    "absolute": (scene_a, 1.8, {"settle": 200}, (1.7, 1.9)),
    "three harmonics": (scene_c, 1.8, {"settle": 400}, (1.6, 2.0))}


@pytest.mark.parametrize("name", SCENES)
def test_multipliers_are_those_of_the_differenced_map(name):
    """To 1e-8, stable or not: differences err by 1e-19 of the fifth derivative, 1e-15/2e-5."""
    make, value, options, (low, high) = SCENES[name]
    start = ball_start(value, 0.7) if name == "ball" else None
    orbit = find_orbit(make(value), *([start] if start else []), **options)
    found = branch(orbit, make, value=value, low=low, high=high)
    points = [one for one in found.points[1:-1] if one.rank == 2 and abs(one.multipliers[0]) < 5]
    assert len(points) > 5
    for point in points[::max(1, len(points) // 8)]:
        matrix = differenced(make(point.value), found.state(point), found.cycles, orbit.size)
        one = complex(point.multipliers[0].real, abs(point.multipliers[0].imag))
        assert largest(matrix) == pytest.approx(one, abs=1e-8 * max(1, abs(one)))


@pytest.mark.parametrize("way", [1e-6, 1e-8])
def test_multipliers_close_to_a_fold(way):
    """Node and saddle of the ball within a millionth of their fold: to 1e-5, as a root tells."""
    eps = 0.7
    fold = math.pi * (1 - eps) / (1 + eps)
    found = branch(find_orbit(ball(0.9, eps), ball_start(0.9, eps)), lambda one: ball(one, eps),
                   value=0.9, low=0.9 * fold, high=1.0)
    value = fold * (1 + 0.9 * way)
    both = found.at(value)
    assert sorted(point.stable for point in both) == [False, True]
    for point in both:
        matrix = differenced(ball(value, eps), found.state(point), 1, 1.0)
        assert largest(matrix).real == pytest.approx(point.multipliers[0].real, abs=1e-5)


THREE_HARMONICS = TransmissionError.harmonic([17e-6, 4.5e-6, 1.5e-6], [0.0, 1.0, 2.0], [1, 2, 3])
DIAGRAMS = {
    "three harmonics": (THREE_HARMONICS, scene_c, 1.6, 2.0, {"pinion_speed_rpm": 1500}),
    "absolute": (SHIPPED, scene_a, 1.7, 1.9, {"pinion_speed_rpm": 240, "impact_law": "absolute"})}


@pytest.mark.parametrize("name", [
    "absolute", pytest.param("three harmonics", marks=pytest.mark.full)])
def test_runge_and_kutta_confirm_every_unstable_motion(name):
    """Each of a diagram, over one repetition: 1e-12 of its size, times what the map makes of it."""
    te, make, low, high, operation = DIAGRAMS[name]
    diagram = lapwing.branches(PAIR, te, low=low, high=high, seeds=5, random_starts=4, settle=300,
                               doublings=1, highest_period=3, **operation)
    begin = np.searchsorted(diagram["strobe_point"].values, np.arange(diagram.sizes["point"]))
    grown = np.abs(diagram["multiplier_real"] + 1j * diagram["multiplier_imag"]).max("multiplier")
    unstable = np.flatnonzero((diagram["stable"].values == 0) & (grown.values < 100))
    assert len(unstable) > 20
    for k in unstable:
        phi, phi_dot = (diagram[one].values[begin[k]] for one in ("phi", "phi_dot"))
        osc, cycles = make(float(diagram["value"][k])), int(diagram["cycles"][k])
        end = simulate(osc, (int(phi > 0), phi, phi_dot), cycles=cycles, method="rk4",
                       rtol=1e-12).final
        away = np.hypot(end.phi - phi, end.phi_dot - phi_dot)
        assert away < 1e-9 * max(1.0, grown.values[k]) * osc.angle_scale
