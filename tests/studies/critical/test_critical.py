"""Critical values: closed forms, the search for the last rattling, the last back impact."""

import math

import numpy as np
import pytest
from scipy.stats import poisson

import lapwing
from helpers import PAIR, ROOT, SHIPPED, dataset_bytes, oscillator, scene_a
from lapwing import StartGrid, TransmissionError, engaged_response
from lapwing.base.codes import SearchStage
from lapwing.deck import load_deck
from lapwing.engine import REST, Numerics
from lapwing.studies.critical import safe as safe_module
from lapwing.studies.critical.safe import SafeSearch
from lapwing.studies.critical.starts import Fates, fitted, start_grid
from lapwing.studies.critical.study import critical_study
from lapwing.studies.trajectory import checked_start

ABSOLUTE = {"pinion_speed_rpm": 240, "impact_law": "absolute"}
SMALL = {"starts": StartGrid(2, 2, 2), "settle": 60, "record": 20, **ABSOLUTE}


# --- closed forms -----------------------------------------------------------------------------


def test_full_engagement_of_the_25x32_pair():
    found = lapwing.critical_full(PAIR, SHIPPED, **ABSOLUTE)
    assert found.outcome == "found" and found.bar == 0
    assert found.estimate == pytest.approx(11.91674543671654, rel=1e-12)
    assert found.phase == pytest.approx(0.951456732183, abs=1e-12)


@pytest.mark.parametrize(("parameter", "given"), [
    ("brake_torque", {"drive_torque": 5.0}), ("drive_torque", {"brake_torque": 9.0})])
def test_either_torque_with_the_other_given(parameter, given):
    """At the torque found, the engaged motion just touches zero."""
    found = lapwing.critical_full(PAIR, SHIPPED, parameter=parameter, **given, **ABSOLUTE)
    osc = PAIR.oscillator(SHIPPED, **{parameter: found.estimate}, **given, **ABSOLUTE)
    assert abs(engaged_response(osc).minimum) < 1e-13 * osc.force


def test_the_highest_speed_of_full_engagement():
    found = lapwing.critical_full(PAIR, SHIPPED, parameter="pinion_speed_rpm", brake_torque=12,
                                  values=np.arange(60, 601, 20), safe_end="low")
    assert found.outcome == "found" and 240 < found.estimate < 242
    for change, kept in ((-1e-9, True), (1e-9, False)):
        osc = PAIR.oscillator(SHIPPED, brake_torque=12,
                              pinion_speed_rpm=found.estimate * (1 + change))
        assert (engaged_response(osc).minimum > 0) == kept
    # The scan stopped at the first value that loses contact.
    assert found.trial_value.values[-2] < found.estimate < found.trial_value.values[-1]
    assert found.trial_margin.values[-2] > 0 > found.trial_margin.values[-1]


def test_a_range_without_a_change():
    options = {"parameter": "pinion_speed_rpm", "brake_torque": 12}
    assert lapwing.critical_full(PAIR, SHIPPED, values=[60, 200], safe_end="low",
                                 **options).outcome == "safe_throughout"
    assert lapwing.critical_full(PAIR, SHIPPED, values=[300, 400], safe_end="low",
                                 **options).outcome == "unsafe_throughout"


def test_rigid_tooth():
    te = TransmissionError.harmonic([1e-5])
    rigid = {"contact_law": "rigid", "pinion_speed_rad_s": 80}
    found = lapwing.critical_on(PAIR, te, **rigid)
    assert found.estimate == pytest.approx(0.342724737180862, rel=1e-14)
    for amplitude, outcome in ((5e-5, "thrown_off"), (-5e-5, "struck")):
        none = lapwing.critical_on(PAIR, TransmissionError.parabola(amplitude), **rigid)
        assert none.outcome == outcome and math.isnan(none.estimate) and none.phase == 0


def test_an_undamped_resonance_is_an_outcome():
    import dataclasses

    pair = dataclasses.replace(PAIR, damping_ratio=0.0)
    hertz = pair.natural_frequency / (2 * math.pi)
    found = lapwing.critical_full(pair, SHIPPED, mesh_frequency_hz=hertz / 3)
    assert found.outcome == "resonance" and math.isnan(found.estimate)


# --- starts -----------------------------------------------------------------------------------

OSCILLATORS = {
    "plain": scene_a(12.0), "one_flank": scene_a(12.0, gap="one_flank"),
    "symmetric": scene_a(12.0, gap="symmetric"), "coasting": scene_a(-2.0),
    "standing": scene_a(2.0, "relative", back_flank_te=False),
    "rigid": scene_a(12.0, "relative", contact_law="rigid")}


@pytest.mark.parametrize("name", OSCILLATORS)
def test_starts_agree_with_their_states(name):
    osc = OSCILLATORS[name]
    starts = start_grid(osc, StartGrid(3, 4, 2), phase=0.3)
    assert len(set(starts)) == len(starts) == 1 + 3 * (4 * 2 + (1 if name == "rigid" else 4 * 2))
    assert starts[0] == (REST, 0.0, 0.0, 0.3)
    for state, phi, phi_dot, phase in starts[1:]:
        assert 0 <= phase < 1
        checked_start(osc, (state, phi, phi_dot), phase)


def test_carried_starts_fit_a_narrower_gap():
    narrow = oscillator(backlash=1.0)
    for start, meant in (((0.0, -1.5, 0.1, 0.2), (0.0, -1.0, 0.1, 0.2)),
                         ((2.0, -1.5, 0.1, 0.2), (2.0, -1.5, 0.1, 0.2)),
                         ((2.0, -0.5, 0.1, 0.2), (0.0, -0.5, 0.1, 0.2)),
                         ((1.0, 0.5, 0.1, 0.2), (1.0, 0.5, 0.1, 0.2))):
        assert fitted(narrow, start) == meant
        if meant[0] != REST:
            checked_start(narrow, meant[:3], 0.2)


# --- the search for the last rattling ---------------------------------------------------------


@pytest.fixture(scope="module")
def safe():
    return lapwing.critical_safe(PAIR, SHIPPED, values=np.arange(12, 13.01, 0.25), further=1,
                                 resolution=0.05, threads=1, **SMALL)


def test_rattling_of_the_25x32_pair_ends_near_12_4(safe):
    assert safe.outcome == "found"
    assert 12.3 <= safe.estimate <= 12.5 and 0 < safe.bar <= 0.05
    assert safe.rattling < safe.estimate < safe.clean
    assert safe.clean - safe.rattling == pytest.approx(2 * safe.bar)


def test_the_search_is_as_stated(safe):
    stage, value, rattling = (safe[f"trial_{key}"].values for key in ("stage", "value", "rattling"))
    scan = value[stage == SearchStage.SCAN]
    assert np.all(np.diff(scan) < 0) and np.all(rattling[stage == SearchStage.SCAN][:-1] == 0)
    assert rattling[stage == SearchStage.SCAN][-1] > 0
    halved = value[stage == SearchStage.BISECTION]
    assert np.all((halved > scan[-1]) & (halved < scan[-2]))
    carried = stage == SearchStage.CARRIED
    # From the further value to the last rattling one, and on to the clean one.
    assert value[carried].tolist() == [safe.rattling, safe.clean] and rattling[carried][-1] == 0
    assert value[stage == SearchStage.CONFIRMATION].tolist() == [safe.rattling]
    assert value[stage == SearchStage.FURTHER].tolist() == [scan[-1] - 0.25]
    assert np.all(safe.trial_starts[stage == SearchStage.SCAN] == safe.n_starts)
    assert not safe.trial_failed.any()


def test_threads_change_no_byte(safe):
    again = lapwing.critical_safe(PAIR, SHIPPED, values=np.arange(12, 13.01, 0.25), further=1,
                                  resolution=0.05, threads=3, **SMALL)
    assert dataset_bytes(again) == dataset_bytes(safe) and again.attrs == safe.attrs


def test_ends_of_the_range():
    above = lapwing.critical_safe(PAIR, SHIPPED, values=[13.0, 13.5], **SMALL)
    assert above.outcome == "safe_throughout" and math.isnan(above.rattling)
    below = lapwing.critical_safe(PAIR, SHIPPED, values=[11.0, 11.5], **SMALL)
    assert below.outcome == "unsafe_throughout" and below.rattling == 11.5
    assert math.isnan(below.clean) and math.isnan(below.estimate)


def test_a_failed_run_is_no_safe_one():
    found = lapwing.critical_safe(PAIR, SHIPPED, values=[12.6, 13.0],
                                  numerics=Numerics(rtol=1e-6, max_events_per_cycle=2), **SMALL)
    assert found.trial_failed.values[0] > 0
    assert found.outcome == "unsafe_throughout" and found.rattling == 13.0


class Imagined:
    """Motions that rattle from the grid below `born` and, carried by less than a step, to `dies`.

    Their state is the value at which they were last seen rattling.
    """

    def __init__(self, born, dies, stride):
        self.born, self.dies, self.stride = born, dies, stride

    def follow(self, oscillators, starts, settle, record, **_):
        value = oscillators[0]
        alive = [value < self.born if start == "grid" else
                 value < self.born or (value < self.dies and value - start < self.stride)
                 for start in starts]
        return Fates(np.array(alive), np.zeros(len(alive), int), np.zeros(len(alive), bool),
                     [value] * len(starts))

    def search(self, values, resolution, monkeypatch, further=0):
        monkeypatch.setattr(safe_module, "follow", self.follow)
        monkeypatch.setattr(safe_module, "start_grid", lambda *_: ["grid"])
        monkeypatch.setattr(safe_module, "fitted", lambda _, start: start)
        search = SafeSearch(lambda value: value, None, 0.0, 1, 1, resolution, None, 1)
        return search.run(values, further)


@pytest.mark.parametrize("born", [0.5, 1.03, 2.0])
@pytest.mark.parametrize("longer", [0.0, 0.02, 0.35, 1.4])
def test_motions_that_only_survive_small_steps_are_followed_up(born, longer, monkeypatch):
    """Whatever the grid of values: the bracket holds the value at which carrying ends."""
    motion = Imagined(born, born + longer, stride=0.03)
    rattling, clean = motion.search(np.arange(4, -0.1, -0.25), 0.01, monkeypatch)
    assert rattling < motion.dies <= clean and 0 < clean - rattling <= 0.02 + 1e-12


class Hidden(Imagined):
    """Beside motions that end at `born`, others born only far below, which survive much longer."""

    def follow(self, oscillators, starts, settle, record, **_):
        value = oscillators[0]
        far = [value < 0.3 or (start != "grid" and start[1] and value < self.dies
                               and value - start[0] < self.stride) for start in starts]
        alive = [one or value < self.born for one in far]
        return Fates(np.array(alive), np.zeros(len(alive), int), np.zeros(len(alive), bool),
                     [(value, one) for one in far])


@pytest.mark.parametrize(("further", "end"), [(0, 1.03), (4, 2.21)])
def test_motions_found_far_beyond_are_carried_back(further, end, monkeypatch):
    motion = Hidden(1.03, 2.21, stride=0.27)
    rattling, clean = motion.search(np.arange(4, -0.1, -0.25), 0.01, monkeypatch, further)
    assert rattling < end <= clean and 0 < clean - rattling <= 0.02 + 1e-12


def test_motions_carried_beyond_the_range(monkeypatch):
    rattling, clean = Imagined(1.1, 9.0, 0.3).search(np.arange(3, 0, -0.5), 0.1, monkeypatch)
    assert rattling == 3 and math.isnan(clean)


# --- back impacts -----------------------------------------------------------------------------


@pytest.fixture(scope="module")
def back():
    return lapwing.critical_back(PAIR, SHIPPED, values=[0.7, 0.78, 0.9, 1.0], confidence=0.9,
                                 threads=1, starts=StartGrid(1, 1, 1), settle=60, record=150,
                                 **ABSOLUTE)


def test_back_impacts_end_between_0_78_and_0_9(back):
    assert (back.last_seen, back.first_clean, back.clean_end) == (0.78, 0.9, 1.0)
    assert back.estimate == 0.78 and back.bar == pytest.approx(0.12)
    assert back.trial_cycles.values.tolist() == [450] * 4 and back.clean_cycles == 900


def test_cycles_are_counted_as_a_sweep_counts_them(back):
    """The motions from rest are those of `sweep`; the others are as many again, each."""
    only_rest = lapwing.sweep(PAIR, SHIPPED, values=[0.7, 0.78], starts=("rest",), settle=60,
                              record=150, **ABSOLUTE).sel(start="rest")
    seen = (only_rest.back_impacts + only_rest.back_engages > 0).sum("recorded_cycle")
    assert np.all(seen.values > 0)
    assert np.all(back.trial_back_cycles.values[::-1][:2] >= seen.values)


def test_the_bound_is_the_exact_poisson_limit(back):
    """Of bursts: one that lasts several cycles counts once."""
    seen, burst = back.trial_back_cycles.values, back.trial_bursts.values
    assert np.all(burst <= seen) and np.all((burst > 0) == (seen > 0)) and np.any(burst < seen)
    for k, n, bound in zip(burst, back.trial_cycles.values, back.trial_rate_bound.values,
                           strict=True):
        # At the limit, so few or fewer would be seen in 1 of 10 cases.
        assert poisson.cdf(k, bound * n) == pytest.approx(0.1, rel=1e-9)
    assert back.rate_bound == pytest.approx(-math.log(0.1) / 450)


def test_threads_and_batches_change_no_byte(back, monkeypatch):
    monkeypatch.setattr("lapwing.studies.critical.starts.MAX_BYTES", 100_000)
    again = lapwing.critical_back(PAIR, SHIPPED, values=[0.7, 0.78, 0.9, 1.0], confidence=0.9,
                                  threads=2, starts=StartGrid(1, 1, 1), settle=60, record=150,
                                  **ABSOLUTE)
    assert dataset_bytes(again) == dataset_bytes(back)


def test_none_seen_and_all_seen():
    options = {"starts": StartGrid(1, 1, 1), "settle": 60, "record": 40, **ABSOLUTE}
    quiet = lapwing.critical_back(PAIR, SHIPPED, values=[5.5, 6], **options)
    assert quiet.outcome == "none_seen" and quiet.clean_values == 2
    loud = lapwing.critical_back(PAIR, SHIPPED, values=[0.2, 0.3], **options)
    assert loud.outcome == "unsafe_throughout" and math.isnan(loud.first_clean)


# --- refusals ---------------------------------------------------------------------------------


@pytest.mark.parametrize(("find", "changed", "said"), [
    ("safe", {"values": []}, "at least one"), ("safe", {"values": [1, np.inf]}, "finite"),
    ("safe", {"safe_end": "left"}, "safe_end"), ("safe", {"settle": -1}, "settle"),
    ("safe", {"record": 0}, "record"), ("safe", {"further": 1.5}, "further"),
    ("safe", {"values": [1.0, 2.0], "resolution": 0.0}, "resolution"),
    ("back", {"confidence": 1.0}, "confidence"),
    ("back", {"gap": "one_flank"}, "coast flank"), ("on", {}, "expected critical_full"),
    ("full", {"contact_law": "rigid", "impact_law": "relative"}, "expected critical_on"),
    ("full", {"parameter": "restitution", "brake_torque": 1, "values": None}, "values"),
])
def test_refusals(find, changed, said):
    arguments = {"values": [1.0], **ABSOLUTE, **changed}
    with pytest.raises(ValueError, match=said):
        getattr(lapwing, f"critical_{find}")(PAIR, SHIPPED, **arguments)


def test_a_grid_of_starts_is_checked():
    with pytest.raises(ValueError, match="speeds = 0"):
        StartGrid(1, 1, 0)


# --- the shipped deck -------------------------------------------------------------------------


@pytest.mark.full
def test_the_shipped_deck():
    deck = load_deck(ROOT / "inputs" / "critical_25x32.nml")
    full, speed, safe, back = (critical_study(deck, study, 2) for study in deck.criticals)
    assert 240 < speed.estimate < 241
    assert full.estimate == pytest.approx(11.91674543671654, rel=1e-12)
    assert safe.estimate == pytest.approx(12.4, abs=0.1) and safe.bar <= 0.05
    assert back.last_seen == pytest.approx(0.82, abs=0.02) and back.bar <= 0.02 + 1e-12
    assert back.trial_cycles.values.min() >= 20_000


@pytest.mark.full
def test_the_shipped_deck_of_rigid_teeth():
    """Resting from F = max g'' on, bouncing beyond it: the two side by side."""
    deck = load_deck(ROOT / "inputs" / "critical_rigid.nml")
    on, safe = (critical_study(deck, study, 2) for study in deck.criticals)
    u = np.linspace(0, 2 * np.pi, 1_000_001)
    terms = ((1, 17e-6, 0), (2, 4.5e-6, 1), (3, 1.5e-6, 2))
    curvature = -1.28 * sum(n**2 * a * np.cos(n * u + shift) for n, a, shift in terms)
    osc = deck.gear_pair.oscillator(deck.te, brake_torque=1, **deck.criticals[0].operation)
    greatest = curvature.max() * osc.mesh_frequency_ratio**2 / PAIR.force_per_torque
    assert on.estimate == pytest.approx(greatest, rel=1e-10)  # flat top, a millionth of a turn
    assert safe.outcome == "found" and safe.rattling > on.estimate and safe.bar <= 0.02
