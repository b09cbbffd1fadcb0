"""States that the program returns are starts; those that contradict themselves are none."""

import numpy as np
import pytest

from helpers import scene_a
from lapwing import MotionState, Status, simulate, sweep
from lapwing.deck import load_deck
from lapwing.deck.problems import DeckError
from lapwing.model.start import put_on_flank, rounding, start_problem
from odd_values import PAIR, TE

CYCLES = {"relative": 28, "absolute": 12}


def runs(law, method):
    """The oscillator run and another one, of another torque; the run; and times of its events."""
    osc, other = scene_a(1.8, law), scene_a(1.9, law)
    run = simulate(osc, cycles=CYCLES[law], method=method)
    taus = run.events.tau.values
    return osc, other, run, taus[taus > 0]


@pytest.mark.parametrize("method", ["rk4", "exact"])
@pytest.mark.parametrize("law", ["relative", "absolute"])
def test_every_cut_at_an_event_is_a_start_of_another_oscillator(law, method):
    osc, other, _, taus = runs(law, method)
    assert len(taus) > 70
    for tau in taus:
        end = simulate(osc, cycles=float(tau / osc.period), method=method).final
        begun = simulate(other, start=end, cycles=0.01, method=method)
        assert begun.status == Status.OK
        # What the state lies beyond its flank is a few roundings, far below what is let pass.
        beyond = max(end.phi, -osc.gap_width - end.phi) \
            if end.motion_state == MotionState.SEPARATION else -end.phi
        assert beyond < rounding(osc) / 4


@pytest.mark.parametrize("law", ["relative", "absolute"])
def test_rows_of_a_history_are_starts(law):
    _, other, run, taus = runs(law, "rk4")
    history = run.history(taus)
    for row in range(taus.size):
        start = tuple(float(history[name][row]) for name in ("motion_state", "phi", "phi_dot"))
        assert simulate(other, start, phase=float(history.phase[row]), cycles=0.01,
                        method="rk4").status == Status.OK


def test_cuts_at_impacts_are_starts():
    """At each of the nearest times, some of which rounding puts on the flank's wrong side.

    At one of them a run by RK4 ended between the sample that it waited for and the impact.
    """
    beyond = 0
    for osc in (scene_a(torque, "relative") for torque in (0.6, 1.5, 1.8)):
        run = simulate(osc, cycles=2, method="rk4")
        for at in run.events.tau.values[:12] / osc.period:
            for cycles in (at, np.nextafter(at, 0), np.nextafter(at, 9), at + 2 * np.spacing(at)):
                end = simulate(osc, cycles=float(cycles), method="rk4").final
                assert np.isfinite([end.phi, end.phi_dot]).all()
                beyond += end.motion_state == MotionState.SEPARATION and end.phi > 0
                assert simulate(scene_a(0.7, "relative"), start=end, cycles=0.1).status == Status.OK
    assert beyond > 3
    simulate(scene_a(1.8, "relative"), cycles=0.16184850877380522, method="rk4")


def test_ends_of_a_sweep_are_starts():
    found = sweep(PAIR, TE, values=np.linspace(1, 14, 14), starts=("up",), settle=20, record=3,
                  pinion_speed_rpm=300)
    other = PAIR.oscillator(TE, brake_torque=5.3, pinion_speed_rpm=300)
    for row in range(14):
        start = tuple(float(found[name][0, row, -1]) for name in ("motion_state", "phi", "phi_dot"))
        assert simulate(other, start, cycles=0.1).status == Status.OK


STATES = {"separation": (1.0, "separation lies between"),
          "engagement": (-1.0, "engagement means phi >= 0"),
          "back_engagement": (1.0, "back engagement means")}


@pytest.mark.parametrize("state", STATES)
def test_rounding_passes_and_ten_times_it_does_not(state):
    """A start within rounding of its flank is put on it; a real contradiction is refused."""
    osc = scene_a(1.8, "relative")
    sign, said = STATES[state]
    flank = -osc.gap_width if state == "back_engagement" else 0.0
    near, far = (flank + sign * times * rounding(osc) for times in (0.5, 10.0))
    assert start_problem(osc, state, near, 0.0) is None
    assert put_on_flank(osc, state, near, 0.0) == flank
    with pytest.raises(ValueError, match=said):
        simulate(osc, (state, far, 0.0), cycles=1)
    inside = flank - sign * 1e-4
    assert put_on_flank(osc, state, inside, 0.0) == inside


DECK = """&gear_pair pinion_teeth = 25 gear_teeth = 32 pinion_inertia = 7.8e-3
  gear_inertia = 1.24e-2 pinion_base_lever = 0.0414 mesh_stiffness = 3.12e8 backlash = 2e-3
  restitution = 0.8 damping_ratio = 0.07 /
&transmission_error parabola_amplitude = 7.5e-5 /
&operation brake_torque = 1.8 pinion_speed_rpm = 300 /
&response name = 'a' start = '{state}' start_phi = {phi!r} start_phi_dot = 0.0 /
"""


@pytest.mark.parametrize("times", [-10.0, -0.5, 0.5, 10.0])
@pytest.mark.parametrize("state", STATES)
def test_deck_and_call_agree(state, times, tmp_path):
    osc = PAIR.oscillator(TE, brake_torque=1.8, pinion_speed_rpm=300)
    phi = (-osc.gap_width if state == "back_engagement" else 0.0) + times * rounding(osc)
    path = tmp_path / "deck.nml"
    path.write_text(DECK.format(state=state, phi=phi), encoding="utf-8")
    refused = []
    for load in (lambda: load_deck(path), lambda: simulate(osc, (state, phi, 0.0), cycles=0.1)):
        try:
            load()
            refused.append(False)
        except (DeckError, ValueError):
            refused.append(True)
    assert refused == [STATES[state][0] * times > 1] * 2
