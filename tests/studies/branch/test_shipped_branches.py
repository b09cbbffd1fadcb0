"""The shipped deck of branches: every periodic motion of its sweep lies on one of them."""

import numpy as np
import pytest

from helpers import ROOT
from lapwing.base.codes import FoundFrom, FoundMotion, SpecialPoint
from lapwing.deck import load_deck
from lapwing.studies.of_deck import compute


def looked_at(name):
    """Table of a shipped deck's branches, and which of its motions the sweep saw.

    Each of these that repeats lies on a branch, within 1e-8 of its size.
    """
    found = compute(load_deck(ROOT / "inputs" / name), 2, lambda *_: lambda _: None)
    swept, diagram = found.studies["sweep"]["torque"], found.studies["branches"]["torque"]
    looked = diagram["motion_begun"].values <= FoundFrom.DOWN
    assert looked.sum() >= swept["status"].size
    periodic = looked & (diagram["motion_kind"].values == FoundMotion.PERIODIC)
    assert np.all(diagram["motion_branch"].values[periodic] > 0)
    assert diagram["motion_distance"].values[periodic].max() < 1e-8
    assert diagram["motion_cycles"].values[periodic].max() <= 24
    return diagram, looked


def several_times(diagram):
    """Branches that go along one of fewer mesh cycles, beyond an end where they meet it."""
    of_point, found = diagram["strobe_point"].values, []
    for number in np.unique(diagram["branch"].values):
        points = np.flatnonzero(diagram["branch"].values == number)
        cycles = int(diagram["cycles"].values[points[0]])
        phis = [diagram["phi"].values[of_point == k] for k in points]
        sooner = [any(cycles % part == 0 and np.ptp([phi, np.roll(phi, part)], axis=0).max()
                      < 1e-8 * np.abs(phi).max() for part in range(1, cycles)) for phi in phis]
        if sum(sooner) > 4:
            found.append(int(number))
    return found


@pytest.mark.full
def test_what_ends_the_last_rattling():
    """A local event, known as well as the arithmetic lets it; raised slowly it dies before."""
    diagram, _ = looked_at("branches_25x32.nml")
    high = diagram.isel(rattling=-1)
    assert int(high["rattling_high_kind"]) == SpecialPoint.FOLD
    assert float(high["rattling_high_error"]) < 1e-10
    assert float(high["rattling_high"]) == pytest.approx(12.42754043941, abs=1e-10)
    assert diagram.attrs["dies_error"] < 1e-7
    assert diagram.attrs["dies"] == pytest.approx(12.40410915, abs=1e-7)


@pytest.mark.full
@pytest.mark.parametrize("name", ["25x32", "25x32_relative", "1500rpm", "480rpm"])
def test_the_whole_range(name):
    """Motions beyond 24 mesh cycles are told as without period."""
    diagram, looked = looked_at(f"diagram_{name}.nml")
    assert looked.sum() >= 3 * 691
    assert not several_times(diagram)
    assert set(diagram["motion_kind"].values[looked]) == {
        FoundMotion.ENGAGED, FoundMotion.PERIODIC, FoundMotion.APERIODIC}
