"""Multipliers and exponents as sweeps, responses, result files, summaries and figures give them."""

import math

import numpy as np
import pytest

from helpers import PAIR, SHIPPED, ball, ball_start, dataset_bytes, scene_a, scene_c
from lapwing import sweep
from lapwing.base.quantities import NUMBERS, STABILITY
from lapwing.engine import Numerics, TrajectoryCall, Wanted
from lapwing.plots.sweep import exponents as figure
from lapwing.report.summary import summary_text
from lapwing.results import read_results, write_results
from lapwing.studies.orbit import find_orbit, settled_state
from lapwing.studies.period import find_period, motion_class
from lapwing.studies.response.motion import why_aperiodic
from lapwing.studies.response.run import response
from lapwing.studies.stability import CycleMaps, Exponents, exponents

OPERATION = {"pinion_speed_rpm": 240, "impact_law": "relative"}
OBSERVE = ("cycles", "exponents")
TORQUES = [1.8, 3.3, 5.5, 8.0, 12.5]


@pytest.fixture(scope="module")
def swept():
    return sweep(PAIR, SHIPPED, values=TORQUES, observe=OBSERVE, settle=200, record=100,
                 rtol=1e-8, threads=2, **OPERATION)


@pytest.fixture(scope="module")
def rigid():
    return sweep(PAIR, SHIPPED, values=[5.5, 8.0], starts=("rest",), observe=OBSERVE, settle=50,
                 record=20, contact_law="rigid", **OPERATION)


def test_a_sweep_gives_what_the_orbits_give(swept):
    for torque in (5.5, 8.0, 12.5):
        osc = scene_a(torque, "relative")
        orbit = find_orbit(osc, settled_state(osc, 300))
        point = swept.sel(start="rest", brake_torque=torque)
        assert point["period"] == 1
        # The sweep's tolerance, 1e-8, on the matrix, whose trace may be a hundredth of it.
        assert point["multiplier_real"].values == pytest.approx(
            orbit.multipliers.values.real, rel=1e-5, abs=1e-12)
        assert float(point["lyapunov_exponent"]) == pytest.approx(
            orbit.multipliers.exponents[0], rel=1e-5)
        assert float(point["lyapunov_exponent_per_cycle"]) == pytest.approx(
            orbit.multipliers.exponents[0] * osc.period, rel=1e-5)
        assert point["tangent_rank"] == (2 if torque > 12 else 1)
        second = float(point["second_lyapunov_exponent"])
        assert second == (pytest.approx(-0.1) if torque > 12 else -math.inf)


def test_chaos_is_told_with_its_error(swept):
    point = swept.sel(start="rest", brake_torque=1.8)
    assert point["period"] == 0
    assert float(point["lyapunov_exponent"]) > 2 * float(point["lyapunov_exponent_error"]) > 0
    assert np.all(np.isnan(point["multiplier_real"]))


def test_checks_of_a_sweep(swept, rigid):
    for data in (swept, rigid):
        assert float(data["determinant_defect"].max()) <= 1e-12
        assert float(data["sum_rule_defect"].max()) <= 1e-12
    assert np.all(np.isneginf(rigid["lyapunov_exponent"]))
    assert np.all(rigid["tangent_rank"] == 0)


def test_results_do_not_depend_on_threads(swept):
    again = sweep(PAIR, SHIPPED, values=TORQUES, observe=OBSERVE, settle=200, record=100,
                  rtol=1e-8, threads=1, **OPERATION)
    assert dataset_bytes(again) == dataset_bytes(swept)


def test_what_is_not_wanted_is_not_there_and_changes_nothing(swept):
    plain = sweep(PAIR, SHIPPED, values=TORQUES, settle=200, record=100, rtol=1e-8, **OPERATION)
    assert not set(STABILITY) & set(plain.variables)
    shared = dataset_bytes(plain)
    assert shared.items() <= dataset_bytes(swept).items()


def test_exponents_want_cycles():
    with pytest.raises(ValueError, match="'exponents' wants 'cycles'"):
        sweep(PAIR, SHIPPED, values=[1.0], observe=("exponents",), **OPERATION)


def test_a_failed_point_has_no_numbers():
    data = sweep(PAIR, SHIPPED, values=[1.0, 14.0], starts=("rest",), observe=OBSERVE, settle=5,
                 record=20, max_events_per_cycle=2, **OPERATION)
    assert data["status"].values[0].tolist() == [1, 0]
    # A motion that repeats has no sample to be effective.
    for name in set(NUMBERS) - {"lyapunov_exponent_effective"}:
        assert np.isnan(data[name].values[0, 0]) and not np.isnan(data[name].values[0, 1])


# --- responses, files, summary ------------------------------------------------------------------

SHORT = {"settle": 200, "record": 100, "samples_per_cycle": 16, "exponents": True}


@pytest.fixture(scope="module")
def results(tmp_path_factory, swept, rigid):
    path = tmp_path_factory.mktemp("stability") / "result.nc"
    responses = [
        response(scene_a(3.3), PAIR, name="focus", **SHORT),
        response(scene_a(8.0, "relative"), PAIR, name="chatter", **SHORT),
        response(scene_a(1.8, "relative"), PAIR, name="chaos", **SHORT),
        response(scene_a(8.0, "relative", contact_law="rigid"), PAIR, name="rest", **SHORT),
        response(scene_a(3.3), PAIR, name="plain", **{**SHORT, "exponents": False}),
        response(scene_a(3.3), PAIR, name="failed", **{**SHORT, "max_events_per_cycle": 2})]
    write_results(path, deck_name="test", deck_text="", used_text="", used_hash="0", pair=PAIR,
                  te=SHIPPED, te_sign="printed", found={
                      "response": {one.attrs["name"]: one for one in responses},
                      "sweep": {"torque": swept, "rigid": rigid}})
    with read_results(path) as opened:
        yield opened


def test_attributes_of_responses(results):
    focus = results.response("focus").attrs
    assert focus["orbit_period"] == 1 and focus["orbit_distance"] < 1e-9
    assert focus["multiplier_real"] == pytest.approx([-0.22870650, 0.00226684], abs=1e-7)
    assert focus["lyapunov_exponent"] == pytest.approx(
        math.log(0.22870650) / scene_a(3.3).period, rel=1e-6)
    assert results.response("chatter").attrs["second_lyapunov_exponent"] == -math.inf
    assert results.response("chaos").attrs["aperiodic_reason"].startswith("chaos")
    assert results.response("rest").attrs["lyapunov_exponent"] == -math.inf
    for name in ("plain", "failed"):
        assert "multiplier_real" not in results.response(name).attrs
    assert "lyapunov_exponent" not in results.response("plain").attrs


def test_summary(results):
    text = summary_text(results)
    assert "Floquet multipliers over one mesh cycle: -0.2287 and 0.002267; the largest Lyapunov " \
           "exponent is -1.475 per mesh cycle (-0.01776 per τ)." in text
    assert "the other lost in complete chatter (exponent -∞)" in text
    assert "no period up to 24 mesh cycles (chaos: nearby motions part)" in text
    assert "forgets every deviation (largest Lyapunov exponent -∞)" in text
    assert ("- chaos (all of the 95 % interval of the largest Lyapunov exponent above zero): "
            "at 6 of 15 motions") in text
    assert text.count("- checks of the exponents kept") == 2
    assert "broken" not in text


def test_a_broken_rule_is_told(results):
    from lapwing.report.stability import stability_sentence, sweep_stability

    attrs = dict(results.response("focus").attrs)
    assert "broken" not in stability_sentence(attrs)
    assert "broken by 1.0e-06" in stability_sentence(attrs | {"sum_rule_defect": 1e-6})
    data = results.sweep("torque")
    assert "**broken**" in sweep_stability(
        data.assign(sum_rule_defect=data["sum_rule_defect"] + 1e-6), "N·m")[-1]


def test_near_grazing_is_a_warning_in_the_summary(results):
    from lapwing.report.stability import stability_sentence

    attrs = dict(results.response("focus").attrs)
    warned = stability_sentence(attrs | {"stability_warning": "1 of 1 cycles graze: no linear map"})
    assert "No multipliers" in warned and "0.2287" not in warned


def test_the_figure_has_a_row_for_what_is_lost(results):
    drawn = figure.draw(results.sweep("rigid"))
    drawn.draw_without_rendering()
    assert "-∞" in drawn.axes[1].get_title("left")
    markers = [line for line in drawn.axes[1].lines if line.get_marker() == "v"]
    assert sum(len(line.get_xdata()) for line in markers) == 2
    drawn = figure.draw(results.sweep("torque"))
    assert "-∞" not in drawn.axes[1].get_title("left")


# --- period -------------------------------------------------------------------------------------


def recorded(osc, start, settle, cycles):
    state, *numbers = settled_state(osc, settle, start)
    call = TrajectoryCall(osc, (float(state), *numbers, 0.0), numerics=Numerics(rtol=1e-13),
                          wanted=Wanted(cycles=True, tangent=True))
    call.run((cycles, 0.0), [])
    return call


def period_of(osc, start, settle, cycles=100):
    call = recorded(osc, start, settle, cycles)
    size = call.cycles["deepest_separation"].max()
    phi, phi_dot = call.cycles["phi"], call.cycles["phi_dot"]
    return find_period(phi, phi_dot, np.zeros((cycles, 1)), size), call, size


DOUBLING = math.hypot(math.pi / 3, 2 * 1.25 / 1.5**2)  # of the ball at ε = 0.5


@pytest.mark.parametrize("settle", [100, 3000, 10_000, 13_000, 15_000, 17_000, 19_000, 22_000,
                                    30_000])
def test_a_decaying_flip_is_never_period_two(settle):
    """Just before the doubling a multiplier is -0.9994: states alternate for 20,000 cycles.

    The multiplier found while it still alternates is that of the period to come.
    """
    gamma = DOUBLING * (1 - 1e-4)
    osc = ball(gamma, 0.5)
    state, phi, phi_dot = ball_start(gamma, 0.5)
    period, call, size = period_of(osc, (state, phi, phi_dot + 1e-3), settle)
    assert period == (1 if settle >= 22_000 else 0)
    orbit = find_orbit(osc, ball_start(gamma, 0.5), 2)
    assert orbit.cycles == 1
    multiplier = orbit.multipliers.values[0].real
    assert -1 < multiplier < -0.999
    found = exponents(CycleMaps.from_rows(call.tangent, osc.period), period, size)
    assert found.per_cycle[0] == pytest.approx(math.log(-multiplier), abs=1e-4)


def test_just_beyond_the_doubling_it_is_period_two():
    gamma = DOUBLING * (1 + 1e-3)
    start = ball_start(gamma, 0.5)
    assert period_of(ball(gamma, 0.5), (*start[:2], start[2] + 1e-3), 20_000)[0] == 2


@pytest.mark.parametrize(("largest", "error", "words"), [
    (0.1, 0.01, "chaos"), (0.1, 0.2, "undecided"), (-0.1, 0.02, "or not settled"),
    (-math.inf, math.nan, "not chaos"), (0.1, math.nan, "undecided")])
def test_reasons(largest, error, words):
    found = Exponents(largest, -1.0, error, np.empty(0), 2, 0, 10.0)
    assert words in why_aperiodic(found, 24, 1e-4)


def test_a_slow_transient_is_told_how_long_it_still_takes():
    found = Exponents(-0.001, -1.0, 1e-5, np.empty(0), 2, 0, 10.0)
    # ln(1e-4/1e-8)/0.01 cycles.
    assert "some 9.2e+02 more" in why_aperiodic(found, 24, 1e-4)


def test_classes():
    drive, coast = np.array([9, 3, 2, 3, 2.0]), np.array([0, 0, 1, 0, 1.0])
    assert motion_class(2, drive, coast, False) == "2:(5,1)"
    assert motion_class(1, drive, coast, True) == "1:(2,1)c"
    assert motion_class(0, drive, coast, True) == "no period (complete chatter)"


def test_chaos_of_scene_c_beside_a_period():
    """Scene C at 4.5 N·m: chaos, the exponent positive; at 2 N·m the focus, ln ε per impact."""
    data = sweep(PAIR, scene_c(1).te, values=[2.0, 4.5], starts=("rest",), observe=OBSERVE,
                 pinion_speed_rpm=1500, settle=300, record=400, rtol=1e-8)
    focus, chaos = data["lyapunov_exponent_per_cycle"].values[0]
    assert focus == pytest.approx(math.log(0.8), rel=1e-12)
    assert chaos > data["lyapunov_exponent_error"].values[0, 1] * scene_c(4.5).period


def test_a_sweep_has_the_classes_of_its_motions(swept):
    names = swept["motion_class"].sel(start="rest").values.tolist()
    assert names[0].startswith("no period") and names[4] == "1:(0,0)"
    assert names[2] == "1:(12,0)c"
    compliant = sweep(PAIR, SHIPPED, values=[5.5], starts=("rest",), contact_law="compliant",
                      settle=100, record=20, **OPERATION)
    assert compliant["motion_class"].values.tolist() == [["1:(4,0)"]]
    assert compliant["counted_impacts"].sum() == 0
