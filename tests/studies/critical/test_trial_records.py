"""Trials of a search that outlive it: the same search goes on from them, another does not."""

import numpy as np
import pytest

from helpers import PAIR, dataset_bytes
from lapwing import Numerics, StartGrid, TransmissionError, critical_safe
from lapwing.deck import load_deck
from lapwing.results.shards import shard_path, shards_in
from lapwing.run import run_deck
from lapwing.studies.critical import records as kept
from lapwing.studies.critical import study
from lapwing.studies.critical.records import Records

TE = TransmissionError.harmonic([17e-6, 4.5e-6, 1.5e-6], [0.0, 1.0, 2.0], [1, 2, 3])
OPTIONS = {"values": np.linspace(9, 14, 6), "starts": StartGrid(2, 2, 1), "settle": 40,
           "record": 10, "further": 2, "pinion_speed_rpm": 1500.0, "threads": 2,
           "numerics": Numerics(rtol=1e-6)}


def searched(folder=None, notes=None, **changed):
    records = None if folder is None else Records(folder, notes)
    return critical_safe(PAIR, TE, **{**OPTIONS, **changed}, records=records).data


@pytest.fixture(scope="module")
def expected():
    found = searched()
    assert found.attrs["outcome"] == "found" and found["trial_value"].size > 8
    return found


@pytest.fixture
def followed(monkeypatch):
    """How many motions of each trial are followed."""
    found, real = [], kept.follow
    monkeypatch.setattr(kept, "follow", lambda oscillators, *rest, **options: (
        found.append(len(oscillators)), real(oscillators, *rest, **options))[1])
    return found


@pytest.mark.parametrize("finished", [0, 1, 5])
def test_a_search_that_was_stopped_repeats_the_trial_under_way_alone(finished, expected, followed,
                                                                    tmp_path, monkeypatch):
    counting = kept.follow

    def stop(*rest, **options):
        if len(followed) == finished:
            raise KeyboardInterrupt
        return counting(*rest, **options)

    monkeypatch.setattr(kept, "follow", stop)
    with pytest.raises(KeyboardInterrupt):
        searched(tmp_path)
    assert shards_in(tmp_path) == list(range(finished))
    followed.clear()
    monkeypatch.setattr(kept, "follow", counting)
    found = searched(tmp_path, pytest.fail)
    assert dataset_bytes(found) == dataset_bytes(expected) and found.attrs == expected.attrs
    assert followed == expected["trial_starts"].values[finished:].tolist()


def test_what_is_damaged_or_of_another_search_is_made_again(expected, followed, tmp_path):
    searched(tmp_path)
    shard_path(tmp_path, 2).write_bytes(b"none")
    followed.clear()
    notes = []
    assert dataset_bytes(searched(tmp_path, notes.append)) == dataset_bytes(expected)
    assert len(followed) == 1 and len(notes) == 1 and notes[0].startswith("trial 2 ")
    for changed in ({"settle": 41}, {"numerics": Numerics(rtol=1e-7)}, {"te_scale": 1.001}):
        notes.clear()
        searched(tmp_path, notes.append, **changed)
        assert notes and all("is of another study" in note for note in notes)


DECK = """
&gear_pair
  pinion_teeth = 25, gear_teeth = 32
  pinion_inertia = 0.0078, gear_inertia = 0.026
  pinion_base_lever = 0.034, mesh_stiffness = 3.12e8, backlash = 0.002
  restitution = 0.8, damping_ratio = 0.1
/
&transmission_error harmonic_amplitude = 17e-6, 4.5e-6, 1.5e-6, harmonic_shift = 0, 1, 2 /
&operation pinion_speed_rpm = 1500 /
&critical
  name = 'T', find = 'safe', from = 9, to = 14, count = 6
  start_phases = 2, start_positions = 2, start_speeds = 1
  settle_cycles = 40, record_cycles = 10
/
"""


def test_a_deck_goes_on_with_its_search(tmp_path, followed, monkeypatch):
    path = tmp_path / "search.nml"
    path.write_text(DECK, encoding="utf-8")
    deck = load_deck(path)
    (asked,) = deck.criticals
    # 9 motions of 50 cycles.
    for cycles, keeps in ((450, False), (449, True)):
        monkeypatch.setattr(study, "TRIAL_CYCLES", cycles)
        assert study.keeps_shards(asked) == keeps
    counting = kept.follow

    def stop(*rest, **options):
        if len(followed) == 4:
            raise KeyboardInterrupt
        return counting(*rest, **options)

    monkeypatch.setattr(kept, "follow", stop)
    assert run_deck(deck, tmp_path, figures="none").interrupted
    assert shards_in(tmp_path / "search.shards" / "critical_T") == [0, 1, 2, 3]
    followed.clear()
    monkeypatch.setattr(kept, "follow", counting)
    outcome = run_deck(deck, tmp_path, figures="none")
    assert not outcome.interrupted and not (tmp_path / "search.shards").exists()
    again = len(followed)
    run_deck(deck, tmp_path, figures="none", force=True)
    assert len(followed) - again == again + 4
