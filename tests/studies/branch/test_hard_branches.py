"""Branches that are hard to follow, each a file of `hard/`, and every unstable motion by RK4.

`hard/make_cases.py` wrote the files, from closed forms or in 40 digits, without Lapwing.
"""

import json
from pathlib import Path

import numpy as np
import pytest

from helpers import ball, ball_start, oscillator, scene_a
from lapwing import TransmissionError, find_orbit, simulate
from lapwing.studies.branch import Kind, Outcome, branch
from lapwing.studies.branch.motion.layout import Happening
from lapwing.studies.branch.motion.witness import in_full

CASES = {path.stem: json.loads(path.read_text(encoding="utf-8"))
         for path in sorted((Path(__file__).parent / "hard").glob("*.json"))}


def maker(case):
    """The oscillator of each value of the case's parameter."""
    te = TransmissionError.parabola(case["te"]["parabola"]) if "parabola" in case["te"] \
        else TransmissionError.harmonic(*case["te"]["harmonic"])

    def make(value):
        if "gamma" in case:
            one, two, three = case["gamma"]
            number = {"force": 1 / (one + two * value + three * value**2)}
        else:
            number = {case.get("varied", "force"): value}
        if "mesh_frequency_ratio" in number:
            number = {"period": 2 * np.pi / number["mesh_frequency_ratio"]}
        return oscillator(te, **(case["oscillator"] | number))

    return make


def orbit_of(osc, start):
    """The motion of a case: settled, or begun just after its one impact in so many cycles."""
    if "settle" in start:
        return find_orbit(osc, settle=start["settle"])
    n = start.get("cycles", 1)
    speed = -osc.restitution * n * osc.period * osc.force / (1 + osc.restitution)
    begun = simulate(osc, ("separation", 0.0, speed), phase=start["impact"],
                     cycles=1 - start["impact"]).final
    return find_orbit(osc, (begun.motion_state, begun.phi, begun.phi_dot), n)


def check_specials(found, wanted):
    """Each special point is there, as near as it is said to be and as the branch says it is."""
    for one in wanted:
        exact = float(one["value"])
        near = min(found.of_kind(Kind[one["kind"]]), key=lambda at: abs(at.value - exact))
        assert near.value == pytest.approx(exact, rel=one["within"], abs=1e-14)
        assert abs(near.value - exact) <= near.error + 1e-16 * abs(exact)
        assert near.error < 1e-9 * max(1.0, abs(exact))
        assert near.outcome is Outcome[one.get("outcome", near.outcome.name)]
        if "det" in one:
            assert np.prod(near.multipliers).real == pytest.approx(one["det"], rel=1e-11)
            assert near.multipliers[0] == pytest.approx(-1, abs=1e-8)


@pytest.mark.parametrize("name", [pytest.param(name, marks=pytest.mark.full)
                                  if one.get("full") else name for name, one in CASES.items()])
def test_hard_case(name):
    case = CASES[name]
    make = maker(case)
    parameter = "mesh_frequency_ratio" if "varied" in case else make
    found = branch(orbit_of(make(case["value"]), case["start"]), parameter, low=case["low"],
                   high=case["high"], **({"value": case["value"]} if parameter is make else {}))
    if case.get("chatters"):
        assert found.points[0].place.layout.chatters
    for k, wanted in enumerate(case["levels"]):
        if k:
            found = found.switched(next(one for one in found.of_kind(Kind.PERIOD_DOUBLING)
                                        if one.outcome is Outcome.PERSISTS))
        assert found.cycles == case["start"].get("cycles", 1) * 2**k
        check_specials(found, wanted)
    for kind in case.get("only", []):
        assert len(found.of_kind(Kind[kind])) == sum(one["kind"] == kind for one in wanted)
    if "end" in case:
        assert found.specials[-1].kind is Kind[case["end"]]
    if "ends" in case:
        assert sorted(found.specials[k].kind.name for k in (0, -1)) == case["ends"]
    if "stable" in case:
        assert sorted({point.stable for point in found.points}) == case["stable"]
    if "ratios" in case:
        steps = np.diff([float(one["value"]) for level in case["levels"] for one in level])
        assert (steps[:-1] / steps[1:]).round(3).tolist() == case["ratios"]
    if "impacts_after_release" in case:
        check_impacts(found, case)


def check_impacts(found, case):
    """Mesh phases of a motion's impacts, counted from its release."""
    point, = found.at(case["value"])
    layout, events = in_full(found.follower.problem, point.place.layout, point.place.z)
    begin = int(np.flatnonzero(layout.kind == Happening.RELEASE)[0])
    order = (begin + np.arange(layout.n)) % layout.n
    assert np.all(layout.kind[order[1:1001]] == Happening.REBOUND)
    for number, phase in case["impacts_after_release"].items():
        away = events.phase[order[int(number)]] - float(phase)
        assert away - round(away) == pytest.approx(0, abs=1e-12)


def test_the_hard_cases_are_all_there():
    """What a branch may meet on its way, each by a file."""
    assert {"cascade_half", "end_of_a_chatter", "isola", "two_folds_within_a_millionth",
            "period_of_24", "thousand_impacts", "ends_where_contact_is_kept",
            "border_collision"} <= CASES.keys()


def test_every_unstable_motion_is_one_of_runge_and_kutta_too():
    """Saddles of the ball and of scene A: each cycle leads where the branch says, by RK4."""
    scenes = [(branch(find_orbit(ball(0.9, 0.7), ball_start(0.9, 0.7)),
                      lambda value: ball(value, 0.7), value=0.9, low=0.5, high=1.0), 5),
              (branch(find_orbit(scene_a(1.77), settle=400, cycles=2), "brake_torque", low=1.7,
                      high=1.9), 7)]
    for found, every in scenes:
        unstable = [point for point in found.points[1:-1] if not point.stable
                    and np.all(np.isfinite(point.multipliers))]
        assert len(unstable) > 4
        for point in unstable[::every]:
            osc = found.follower.problem.oscillator(point.value)
            start = found.state(point)
            end = simulate(osc, start, cycles=found.cycles, method="rk4", rtol=1e-12).final
            grown = max(1.0, abs(point.multipliers[0]))
            assert end.motion_state == start[0]
            assert np.abs([end.phi - start[1], end.phi_dot - start[2]]).max() \
                < 1e-9 * grown * osc.angle_scale
