"""What must not change the motion: mirror image, phase origin, table split, units, constants."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from helpers import EPS, PAIR, SHIPPED, events, oscillator
from lapwing import EventKind, GearPair, TransmissionError, simulate

LAWS = [("restitution", "relative"), ("restitution", "absolute"), ("compliant", "relative"),
        ("rigid", "relative")]
MIRROR = {kind: EventKind[kind.name.removeprefix("BACK_") if kind.name.startswith("BACK_")
                          else "BACK_" + kind.name]
          for kind in EventKind if kind != EventKind.KINK} | {EventKind.KINK: EventKind.KINK}
# The same motion computed in other roundings: some 20 EPS of P per event time, and growth of at
# most 1e4 over the one or two cycles compared (the reference's largest over two cycles is 8e3).
SAME_TIME = 20 * EPS * 1e4
# With other knots steps in contact end elsewhere: errors of rtol = 1e-10, growth of 1e3 (as above,
# less the steps' share of rtol).
SAME_TO_RTOL = 1e-10 * 1e3

# Numbers off the binary grid: exact coincidences, such as an impact on a kink, are no matter of
# symmetry (test_decisions.py has them).
tables = st.builds(
    lambda value, slope, jump: TransmissionError.from_hermite(
        [0.0, 0.25, 0.625], np.array(value) / 61, np.array(slope) / 17,
        (np.array(slope) + np.array(jump)) / 17),
    *(st.lists(st.integers(-32, 32), min_size=3, max_size=3) for _ in range(2)),
    st.lists(st.sampled_from([0, 0, 7, -9]), min_size=3, max_size=3))
scenes = st.fixed_dictionaries({
    "te": tables, "force": st.sampled_from([0.2371, 1.013, 1.931]),
    "period": st.sampled_from([1.0, 4.1, 15.7]), "restitution": st.sampled_from([0.0, 0.5, 0.8]),
    "backlash": st.sampled_from([0.513, 2.017]), "damping_ratio": st.sampled_from([0.0, 0.23]),
    "laws": st.sampled_from(LAWS)})
starts = st.sampled_from(["rest", ("separation", -0.2531, 0.0), ("separation", -0.1217, -0.513)])


def build(scene, sign=1.0, **changes):
    scene = {**scene, **changes}
    te = scene["te"]
    if sign < 0:
        te = TransmissionError(te.knots, -te.coefficients, te.kinks)
    contact_law, impact_law = scene["laws"]
    return oscillator(te, force=sign * scene["force"], period=scene["period"],
                      restitution=scene["restitution"], backlash=scene["backlash"],
                      damping_ratio=scene["damping_ratio"], contact_law=contact_law,
                      impact_law=impact_law)


def well_conditioned_until(run, n):
    """Time before the first event that rounding can move far, remove or let change places.

    Such are events very near to each other (a chatter ends in them) and slow meetings, where time
    is the root of rounding.  Events at one and the same instant are one matter.
    """
    osc = run.oscillator
    tau, kind = run.events["tau"].values, run.events["kind"].values
    gap = np.diff(tau)
    close = tau[:-1][(gap > 0) & (gap < 1e-5 * osc.period)]
    slow = tau[(np.abs(run.events["velocity_before"].values) < 1e-2 * osc.angle_scale / osc.period)
               & (kind != EventKind.KINK)]
    return min([run.final.tau, *tau[n:n + 1], *close[:1], *slow[:1]]) - 1e-6 * osc.period


def assert_same(one, other, mirrored=False, n=12, tolerance=SAME_TIME):
    """The same events at the same times, as far as both are well conditioned."""
    osc = one.oscillator
    end = min(well_conditioned_until(run, n) for run in (one, other))
    one, other = ({name: run.events[name].values[run.events["tau"].values < end]
                   for name in run.events} for run in (one, other))
    kind = [MIRROR[EventKind(k)] if mirrored else EventKind(k) for k in one["kind"]]
    assert kind == [EventKind(k) for k in other["kind"]]
    assert np.abs(one["tau"] - other["tau"]).max(initial=0.0) <= tolerance * osc.period
    sign = -1.0 if mirrored else 1.0
    speed = np.abs(one["velocity_after"]).max(initial=0.0) + osc.angle_scale
    assert np.abs(sign * one["velocity_after"] - other["velocity_after"]).max(
        initial=0.0) <= 1e3 * tolerance * speed
    return len(kind)


@given(scenes, starts)
@settings(deadline=None, max_examples=150)
def test_mirror_image_swaps_the_flanks(scene, start):
    """(F, g) -> (-F, -g): φ -> -θ0 - φ, drive flank <-> coast flank."""
    mirrored = start
    if start != "rest":
        mirrored = (start[0], -scene["backlash"] - start[1], -start[2])
    one = simulate(build(scene), start, cycles=2)
    other = simulate(build(scene, -1.0), mirrored, cycles=2)
    assert_same(one, other, mirrored=True)


def moved(te, shift):
    """The same curve with phase 0 at another knot (a whole number of eighths)."""
    cells = np.arange(8) / 8
    at = np.sort((cells + shift) % 1)
    source = (at - shift) % 1
    # A slope read from both sides of a smooth place differs by rounding; that is no kink.
    right = te.slope(source)
    left = np.where(np.isin(source, te.knots[:-1][te.kinks]), te.slope(source, "left"), right)
    return TransmissionError.from_hermite(at, te.value(source), left, right)


@given(scenes, st.integers(0, 7), starts)
@settings(deadline=None, max_examples=100)
def test_phase_origin(scene, shift, start):
    one = simulate(build(scene), start, phase=0.125, cycles=1.5)
    te = moved(scene["te"], shift / 8)
    other = simulate(build(scene, te=te), start, phase=(0.125 + shift / 8) % 1, cycles=1.5)
    assert_same(one, other, tolerance=SAME_TO_RTOL)


@given(scenes, starts, st.lists(st.floats(0.01, 0.99), min_size=1, max_size=4, unique=True))
@settings(deadline=None, max_examples=100)
def test_splitting_the_table(scene, start, cuts):
    te = scene["te"]
    knots = np.unique(np.concatenate([te.knots, np.round(cuts, 3)]))
    rows = np.stack([te.derivative(k, knots[:-1]) / [1, 1, 2, 6, 24, 120][k] for k in range(6)],
                    axis=1)
    kinks = np.isin(knots[:-1], te.knots[:-1][te.kinks])
    split = TransmissionError(knots, rows, kinks)
    one = simulate(build(scene), start, cycles=1.5)
    other = simulate(build(scene, te=split), start, cycles=1.5)
    assert_same(one, other, tolerance=SAME_TO_RTOL)


units = st.tuples(*(st.sampled_from([1.0, 1e-3, 60.0, 0.3048, 1e6, 4.448]) for _ in range(3)))


@given(units, st.sampled_from(["damping_ratio", "mesh_damping"]),
       st.sampled_from(["pinion_speed_rad_s", "mesh_frequency_hz"]))
def test_units_of_the_deck_do_not_matter(unit, damping, speed):
    """Any consistent units of mass, length and time give the same dimensionless numbers."""
    mass, length, time = unit
    torque = mass * length**2 / time**2

    def oscillator_in(mass, length, time, torque):
        xi = {"damping_ratio": 0.1, "mesh_damping": 3e4 * mass / time}
        pair = GearPair(25, 32, 0.0078 * mass * length**2, 0.026 * mass * length**2,
                        0.034 * length, 3.12e8 * mass / time**2, 0.002, 0.8,
                        **{damping: xi[damping]})
        return pair.oscillator(SHIPPED, brake_torque=1.8 * torque, drive_torque=1.2 * torque,
                               **{speed: 25.0 / time})

    here, there = oscillator_in(1, 1, 1, 1), oscillator_in(mass, length, time, torque)
    for name in ("force", "mesh_frequency_ratio", "damping_ratio", "period", "angle_scale"):
        # A dozen rounded operations.
        assert getattr(there, name) == pytest.approx(getattr(here, name), rel=16 * EPS)


@pytest.mark.parametrize("impact_law", ["absolute", "relative"])
def test_units_do_not_change_a_trajectory(impact_law):
    options = {"brake_torque": 3.3, "impact_law": impact_law}
    here = PAIR.oscillator(SHIPPED, pinion_speed_rpm=240, **options)
    inch = GearPair(25, 32, 0.0078 * 8.8507, 0.026 * 8.8507, 0.034 / 0.0254,
                    3.12e8 * 8.8507 * 0.0254**2, 0.002, 0.8, damping_ratio=0.1)
    there = inch.oscillator(SHIPPED, brake_torque=3.3 * 8.8507, pinion_speed_rpm=240,
                            impact_law=impact_law)
    assert_same(simulate(here, cycles=2), simulate(there, cycles=2), n=12)


@pytest.mark.parametrize("gap", ["one_sided", "symmetric", "one_flank"])
@pytest.mark.parametrize("constant", [1e-4, -0.3, 10.0])
def test_a_constant_of_the_table_does_not_matter(gap, constant):
    rows = SHIPPED.coefficients.copy()
    rows[:, 0] += constant
    shifted = TransmissionError(SHIPPED.knots, rows, SHIPPED.kinks)
    runs = [simulate(PAIR.oscillator(te, brake_torque=1.8, pinion_speed_rpm=240, gap=gap,
                                     impact_law="absolute"), cycles=3)
            for te in (SHIPPED, shifted)]
    # The table itself loses EPS·constant of its digits before the engine sees it, and φ is a
    # few 1e-4: as a part of P for impacts at speeds of 1e-5 … 1e-4 per τ over P = 83.
    lost = EPS * abs(constant) / 1e-5 / 83
    assert_same(*runs, n=15, tolerance=SAME_TIME + 30 * lost)


def test_sign_of_the_table_and_te_sign_are_one():
    negative = TransmissionError(SHIPPED.knots, -SHIPPED.coefficients, SHIPPED.kinks)
    options = {"brake_torque": 1.8, "pinion_speed_rpm": 240, "impact_law": "absolute"}
    one = simulate(PAIR.oscillator(SHIPPED, **options), cycles=5)
    other = simulate(PAIR.oscillator(negative, te_sign="geometric", **options), cycles=5)
    for name in one.events:
        np.testing.assert_array_equal(one.events[name].values, other.events[name].values)
    assert events(one, EventKind.IMPACT)["tau"].size > 10
