"""The shipped deck of branches: every periodic motion of its sweep lies on one of them."""

import numpy as np
import pytest

from helpers import ROOT
from lapwing.base.codes import FoundFrom, FoundMotion, SpecialPoint
from lapwing.deck import load_deck
from lapwing.studies.of_deck import compute


@pytest.mark.full
def test_every_periodic_motion_of_the_sweep_lies_on_a_branch():
    deck = load_deck(ROOT / "inputs" / "branches_25x32.nml")
    found = compute(deck, 2, lambda *_: lambda _: None)
    swept, diagram = found.studies["sweep"]["torque"], found.studies["branches"]["torque"]
    looked = diagram["motion_begun"].values <= FoundFrom.DOWN
    assert looked.sum() >= swept["status"].size
    periodic = looked & (diagram["motion_kind"].values == FoundMotion.PERIODIC)
    on = diagram["motion_branch"].values > 0
    assert np.all(on[periodic])
    assert diagram["motion_distance"].values[periodic & on].max() < 1e-8
    # What ends the last rattling is a local event, known as well as the arithmetic lets it.
    high = diagram.isel(rattling=-1)
    assert int(high["rattling_high_kind"]) == SpecialPoint.FOLD
    assert float(high["rattling_high_error"]) < 1e-10
    assert float(high["rattling_high"]) == pytest.approx(12.42754043941, abs=1e-10)


@pytest.mark.full
def test_every_periodic_motion_over_the_whole_range_lies_on_a_branch():
    """Those of the sweep, up to 24 mesh cycles; the others are told as without period."""
    deck = load_deck(ROOT / "inputs" / "diagram_25x32.nml")
    found = compute(deck, 2, lambda *_: lambda _: None)
    swept, diagram = found.studies["sweep"]["torque"], found.studies["branches"]["torque"]
    looked = diagram["motion_begun"].values <= FoundFrom.DOWN
    assert looked.sum() >= swept["status"].size == 3 * 691
    kinds = diagram["motion_kind"].values[looked]
    assert set(kinds) == {FoundMotion.ENGAGED, FoundMotion.PERIODIC, FoundMotion.APERIODIC}
    periodic = looked & (diagram["motion_kind"].values == FoundMotion.PERIODIC)
    assert np.all(diagram["motion_branch"].values[periodic] > 0)
    assert diagram["motion_distance"].values[periodic].max() < 1e-8
