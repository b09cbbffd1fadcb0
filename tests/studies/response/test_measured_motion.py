"""The motion of a response on other curves that samples with the same noise might give."""

from collections import Counter
from pathlib import Path

import numpy as np

from lapwing.deck import load_deck
from lapwing.engine import REST, Numerics
from lapwing.studies.of_deck import compute
from lapwing.studies.response.evaluation import Evaluation
from lapwing.studies.response.mesh_force import sample_phases
from lapwing.studies.response.recording import Pass

DECK = Path(__file__).parents[2] / "deck" / "accepted" / "measured.nml"


def silent(*_):
    return lambda fraction: None


def alone(tmp_deck):
    """The deck with its response alone."""
    tmp_deck.studies |= {"critical": (), "sweep": ()}
    return tmp_deck


def motion_of(osc, deck, study):
    """The motion alone, by one run."""
    recording = Pass(osc, (REST, 0.0, 0.0, 0.0), (20, 20), sample_phases(osc, 8)[0],
                     Numerics(**deck.numerics_of(study))).whole()
    return Evaluation.of(osc, deck.gear_pair, recording, deck.numerics["max_period"]).in_short


def test_classes_are_those_of_the_runs_on_the_repeats():
    deck = alone(load_deck(DECK))
    data = compute(deck, 1, silent).studies["response"]["a"]
    classes = [str(one) for one in data["repeat_class"].values]
    words = ", ".join(f"{name} on {count}" for name, count in sorted(
        Counter(classes).items(), key=lambda item: (-item[1], item[0])))
    assert data.attrs["repeat_classes"] == words and data.attrs["curve_repeats"] == 40
    study = deck.responses[0]
    for i in (0, 39):
        osc = deck.gear_pair.oscillator(deck.curve.repeats(40)[i], **study.operation)
        motion = motion_of(osc, deck, study)
        assert motion.motion_class == classes[i]
        assert motion.deepest_separation == data["repeat_deepest_separation"].values[i]
    assert 0 <= data.attrs["deepest_separation_low"] <= data.attrs["deepest_separation"] \
        <= data.attrs["deepest_separation_high"]


def test_the_motion_of_the_curve_itself_is_that_of_the_response():
    deck = alone(load_deck(DECK, [("transmission_error.curve_repeats", "0")]))
    data, study = compute(deck, 1, silent).studies["response"]["a"], deck.responses[0]
    motion = motion_of(deck.oscillator(study), deck, study)
    assert motion.motion_class == data.attrs["motion_class"] and "repeat_class" not in data
    assert np.array_equal([motion.impacts_per_cycle, motion.deepest_separation],
                          [data.attrs["impacts_per_cycle"], data.attrs["deepest_separation"]])


def test_a_curve_beyond_a_standing_coast_flank_has_no_motion(tmp_path):
    """Noise takes some of the other curves there; the deck's own stays clear."""
    text = DECK.read_text(encoding="utf-8") + "&scene back_flank_te = .false. /\n"
    for name in ("measured.nml", *(path.name for path in DECK.parent.glob("*.csv"))):
        (tmp_path / name).write_bytes((DECK.parent / name).read_bytes())
    (tmp_path / "measured.nml").write_text(text, encoding="utf-8")
    clear = load_deck(tmp_path / "measured.nml")
    osc = clear.gear_pair.oscillator(clear.te, **clear.responses[0].operation)
    # So that the deck's own curve has a millionth of its gap left.
    backlash = clear.gear_pair.backlash * -osc.flank_extrema[0] / osc.gap_width * (1 + 1e-6)
    deck = alone(load_deck(tmp_path / "measured.nml", [("gear_pair.backlash", repr(backlash))]))
    data = compute(deck, 1, silent).studies["response"]["a"]
    lost = data["repeat_class"].values == "failed"
    assert 0 < lost.sum() < 40
    assert np.array_equal(np.isnan(data["repeat_impacts_per_cycle"].values), lost)
    assert np.isnan(data.attrs["impacts_per_cycle_low"])
