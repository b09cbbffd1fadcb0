"""Random scenes over every law: two methods, and the events of a step's own dense output.

By hand, for other seeds or methods: `python tests/random_scenes.py 0 1000 exact rk4`.
"""

from itertools import pairwise

import numpy as np
import pytest

from helpers import EPS
from lapwing import EventKind, MotionState, simulate
from random_scenes import MANY_KNOTS, TOLERANCE, describe, follow, scene, survey

# 'exact' does not depend on the tolerance; where two runs of one method are compared the second
# one is ten times coarser.
EXACT, FINE = ("exact", TOLERANCE), ("rk4", TOLERANCE)


def report(disagreements):
    return f"{len(disagreements)} disagreements\n\n" + "\n\n".join(disagreements)


def test_scenes_cover_every_law_and_event():
    scenes = [scene(seed) for seed in range(150)]
    for name, values in (
            ("contact_law", {"restitution", "compliant", "rigid"}),
            ("impact_law", {"relative", "absolute"}), ("back_flank_te", {True, False}),
            ("gap", {"one_sided", "symmetric", "one_flank"}),
            ("te_sign", {"printed", "geometric"})):
        assert {getattr(osc, name) for osc, *_ in scenes} == values
    starts = {begin if isinstance(begin, str) else begin[0] for _, begin, *_ in scenes}
    assert starts == {"rest", "separation", "engagement", "back_engagement"}
    assert any(len(osc.te.harmonics) == n for osc, *_ in scenes for n in (1, 2, 3))
    assert any(osc.te.kinks.sum() > 1 for osc, *_ in scenes)
    assert any(osc.damping_ratio > 1 for osc, *_ in scenes)
    assert any(osc.force < 0 for osc, *_ in scenes)
    seen, active = set(), 0
    for osc, begin, phase, cycles in scenes:
        run = simulate(osc, begin, phase, cycles, rtol=1e-4, observe=("events",),
                       max_events_per_cycle=20_000)
        seen |= set(run.events["kind"].values.tolist())
        active += run.events.sizes["event"] > 0
    assert seen == {int(k) for k in EventKind if k <= EventKind.KINK}
    assert active > 100


def test_exact_against_runge_kutta():
    ends, compared, disagreements = survey([*range(160), *range(MANY_KNOTS, MANY_KNOTS + 20)],
                                           (EXACT, FINE))
    assert not disagreements, report(disagreements)
    # The comparison says something: hardly any scene is left early, none for want of events.
    assert compared > 3_000 and ends["all"] > 162


# Beyond those: a slope jump taken twice by rounding, a contact that lasts 0.05 on a series,
# a motion in which force and curve matter by their quotient alone, short pieces strongly damped.
REMARKABLE = [841, 2061, 2761, 2939]


@pytest.mark.parametrize("seed", REMARKABLE)
def test_remarkable_scenes(seed):
    verdict = follow(seed, (EXACT, FINE))
    assert verdict.agrees, f"{describe(seed)}\n{verdict.why}"


def test_most_scenes_allow_the_closed_form():
    methods = []
    for seed in range(60):
        osc, begin, phase, _ = scene(seed)
        methods.append(simulate(osc, begin, phase, 0.01, method="auto", observe=()).method)
    # Only a forcing close to an undamped resonance is left to Runge-Kutta.
    assert methods.count("exact") >= 57


def test_runge_kutta_against_a_coarser_one():
    """No event missed or doubled by the rule down to rtol = 1e-8."""
    for rtol in (1e-11, 1e-8):
        ends, compared, disagreements = survey(range(30), (FINE, ("rk4", rtol)))
        assert not disagreements, report(disagreements)
        assert compared > 750 and ends["all"] > 25


@pytest.mark.full
@pytest.mark.parametrize("part", range(12))
def test_ten_thousand_scenes(part):
    disagreements = survey(range(1000 * part, 1000 * (part + 1)), (EXACT, FINE))[2]
    assert not disagreements, report(disagreements)


@pytest.mark.full
def test_runge_kutta_at_the_tolerance_of_the_promise():
    disagreements = survey(range(1000), (EXACT, ("rk4", 1e-8)))[2]
    assert not disagreements, report(disagreements)


# --- crossings of the dense output --------------------------------------------------------------

POINTS = 60


def intrusion(osc, history):
    """How far each sample lies on the wrong side of a flank (positive: a missed crossing)."""
    state, phi = history["motion_state"].values, history["phi"].values
    back = -phi - osc.gap_width
    if not osc.back_flank_te:
        back = back - osc.flank_scale * osc.te.value(history["phase"].values)
    return np.select([state == MotionState.SEPARATION, state == MotionState.ENGAGEMENT],
                     [np.maximum(phi, back), -phi], -back)


def missed_crossings(run):
    """Largest intrusion at a local maximum inside a stretch between two events, over rounding.

    Ends of stretches are left out: an event is where the *formula* meets the flank, so that the
    dense output may lie a step's error beyond it there. A crossing that was missed goes in and
    out again and shows as a maximum inside.
    """
    osc = run.oscillator
    marks = np.unique(np.concatenate([[0.0], run.events["tau"].values, [run.final.tau]]))
    marks = marks[np.append(True, np.diff(marks) > 1e-9 * osc.period)]
    grid = np.concatenate([np.linspace(a, b, POINTS)[1:-1]
                           for a, b in pairwise(marks)])
    depth = intrusion(osc, run.history(grid)).reshape(-1, POINTS - 2)
    grid = grid.reshape(depth.shape)
    inner = (depth[:, 1:-1] >= depth[:, :-2]) & (depth[:, 1:-1] >= depth[:, 2:])
    rows, columns = np.nonzero(inner)
    if not len(rows):
        return 0.0
    # Once more, finer, about each maximum.
    fine = np.concatenate([np.linspace(grid[i, j], grid[i, j + 2], 21)
                           for i, j in zip(rows, columns, strict=True)])
    fine = np.sort(fine)
    size = osc.angle_scale + osc.te.peak_to_peak * osc.gear_ratio + np.abs(
        run.history(fine)["phi"].values).max()
    return max(depth[:, 1:-1][inner].max(),
               intrusion(osc, run.history(fine)).max()) / (64 * EPS * size)


@pytest.mark.parametrize("rtol", [1e-2, 1e-3, 1e-5, 1e-8])
def test_no_crossing_of_the_dense_output_is_missed(rtol):
    """Runge-Kutta at any tolerance, however wrong the motion then is."""
    for seed in range(40):
        osc, begin, phase, cycles = scene(seed)
        if osc.contact_law == "rigid":
            continue  # a tooth that follows its flank has no dense output
        run = simulate(osc, begin, phase, cycles, method="rk4", rtol=rtol, observe=("events",))
        assert missed_crossings(run) <= 1, f"rtol {rtol}: {describe(seed)}"


def test_the_closed_form_stays_on_its_side_of_the_flanks():
    for seed in range(40):
        osc, begin, phase, cycles = scene(seed)
        if osc.contact_law == "rigid":
            continue
        run = simulate(osc, begin, phase, cycles, method="auto", rtol=1e-10, observe=("events",))
        assert missed_crossings(run) <= 1, describe(seed)


def test_the_search_for_missed_crossings_finds_one():
    """A run whose contacts are hidden from it: some of its samples lie inside a flank."""
    found = 0
    for seed in range(40):
        osc, begin, phase, cycles = scene(seed)
        if osc.contact_law != "compliant":
            continue
        run = simulate(osc, begin, phase, cycles, method="rk4", rtol=1e-3, observe=("events",))
        blind = run.events.isel(event=slice(0, 0))

        class Blind:
            oscillator, final, events = run.oscillator, run.final, blind

            @staticmethod
            def history(tau, run=run):
                history = run.history(tau)
                return history.assign(motion_state=history["motion_state"] * 0)
        found += missed_crossings(Blind) > 1
    assert found >= 5


def test_a_scene_is_its_seed():
    one, other = scene(7), scene(7)
    assert repr(one) == repr(other) or one[0].force == other[0].force
    assert follow(7).agrees
