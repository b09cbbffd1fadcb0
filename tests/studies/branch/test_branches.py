"""Branches from what a sweep finds: their table, its figure, what ends rattling."""

import math

import numpy as np
import pytest

import lapwing
from helpers import PAIR, SHIPPED, scene_a
from lapwing.base.codes import FoundFrom, FoundMotion, SpecialPoint
from lapwing.studies.branch import rattling
from lapwing.studies.branch.collection import Collection
from lapwing.studies.branch.family import Found, Request, followed
from lapwing.studies.branch.run import branch
from lapwing.studies.branch.seeds import Motion, Search

SCENE_A = {"pinion_speed_rpm": 240, "impact_law": "absolute"}


@pytest.fixture(scope="module")
def upper():
    """The torques about which rattling that was raised slowly dies, scene A."""
    return lapwing.branches(PAIR, SHIPPED, low=12.15, high=12.4, seeds=6,
                            starts=lapwing.StartGrid(2, 2, 1), settle=400, doublings=1,
                            highest_period=3, **SCENE_A)


def test_ranges_end_where_special_points_lie(upper):
    assert upper.sizes["stable_range"] >= 3
    for end in ("low", "high"):
        kinds = upper[f"range_{end}_kind"].values
        for value, kind, number in zip(upper[f"range_{end}"].values, kinds,
                                       upper["range_branch"].values, strict=True):
            mine = (upper["special_branch"] == number) & (upper["special_kind"] == kind)
            nearest = np.abs(upper["special_value"].values[mine.values] - value).min()
            assert nearest == 0
    assert SpecialPoint.REBOUND in upper["range_high_kind"].values
    assert np.all(upper["range_low"] <= upper["range_high"])
    assert np.all((upper["value"] >= 12.15) & (upper["value"] <= 12.4))


def test_what_an_end_means(upper):
    """Just below it the motion is there, and simulating agrees; just above it is not."""
    high = upper.isel(stable_range=upper["range_high_kind"].values == SpecialPoint.REBOUND)
    for k in range(min(2, high.sizes["stable_range"])):
        end, number = float(high["range_high"][k]), int(high["range_branch"][k])
        points = np.flatnonzero(upper["branch"].values == number)
        nearest = points[np.argmin(np.abs(upper["value"].values[points] - end))]
        phi = upper["phi"].values[upper["strobe_point"].values == nearest]
        phi_dot = upper["phi_dot"].values[upper["strobe_point"].values == nearest]
        cycles = int(upper["cycles"][nearest])
        # The branch's own motion a little below its end, and the same start above it.
        arrivals = 20 * int(upper["arrivals"][nearest])
        for torque, stays in ((end - 1e-4, True), (end + 1e-4, False)):
            run = lapwing.simulate(scene_a(torque), (0, phi[0], phi_dot[0]), cycles=400 * cycles)
            last = run.cycles["impacts"].values[run.cycles["complete"].values > 0][-20 * cycles:]
            assert (last.sum() == arrivals) == stays


def test_no_motion_of_the_seeds_is_missed(upper):
    """Each periodic motion lies on a branch, and none has two of the same."""
    assert upper.attrs["lost"] == 0 and not upper["seed_failed"].any()
    # From rest, carried both ways, and 1 + 2·2·2·1 starts of the grid.
    assert upper["seed_motions"].values.tolist() == [12] * 6
    assert (upper["motion_begun"] != FoundFrom.END).sum() == 72
    assert np.all(upper["seed_engaged"] + upper["seed_aperiodic"] <= upper["seed_motions"])
    assert np.any(upper["seed_engaged"] + upper["seed_aperiodic"] < upper["seed_motions"])
    periodic = upper["motion_kind"] == FoundMotion.PERIODIC
    assert np.all((upper["motion_branch"] > 0) == periodic)
    assert upper["motion_distance"].values[periodic.values].max() < 1e-8


def test_a_motion_is_known_by_its_points():
    orbit = lapwing.find_orbit(scene_a(5.5), settle=200)
    found = branch(orbit, "brake_torque", low=5.4, high=5.6)
    other = lapwing.find_orbit(scene_a(5.57), orbit.state)
    known = Collection()
    known.add(found)
    state = np.array(other.state[1:])
    assert known.match(5.57, state, 1).branch is found
    assert known.match(5.57, state * [0.99, 1], 1) is None
    assert known.match(5.57, state, 2) is None
    # Begun elsewhere it is the same branch; a part of it makes room for it.
    known.add(branch(other, "brake_torque", low=5.4, high=5.6))
    assert known.branches == [found]
    part = branch(orbit, "brake_torque", low=5.45, high=5.55)
    for order in ([part, found], [found, part]):
        known = Collection()
        for one in order:
            known.add(one)
        assert known.branches == [found]


def test_the_table_is_stored_and_drawn(upper, tmp_path):
    import xarray as xr

    upper.to_netcdf(tmp_path / "diagram.nc")
    with xr.open_dataset(tmp_path / "diagram.nc") as read:
        figure = read.load().lapwing.bifurcation(title="scene A")
    section, arrivals, _ = figure.axes
    assert figure.get_suptitle() == "scene A"
    assert section.get_xlim() == (12.15, 12.4)
    dashed = [line for line in section.lines if line.get_linestyle() == "--"]
    assert len(section.lines) > upper.sizes["stable_range"] and dashed
    assert arrivals.get_xlabel() == "braking torque (N·m)"
    table = upper.lapwing.table("special")
    assert "rebound" in set(table["special_kind"])


@pytest.mark.parametrize("crisis", [12.40410915, 12.399999])
def test_the_end_of_chaos_is_bracketed(crisis):
    """Transients whose mean life goes with the distance to the power -1.5, as those of scene A."""
    class Crowd(rattling._Crowd):
        def _begun(self, value):
            return [(0, float(number), 0.0) for number in range(rattling.CROWD)]

        def _left(self, value, states, cycles):
            # Each is a member of its own, of which so many cycles have gone by.
            left = [(0, number, age + cycles) for _, number, age in states]
            if value <= crisis:
                return left
            mean = 1e-6 * (value - crisis)**-1.5
            return [one for one in left if one[2] < mean * -np.log(1 - (one[1] + 0.5) / 8)]

    search = Search(PAIR, SHIPPED, "brake_torque", np.array([11.8, 12.5]), {})
    end = Crowd(search, (0, 0.0, 0.0)).bracket(12.398, 12.4055)
    assert abs(end.value - crisis) <= end.error < 1e-7
    assert end.kind is SpecialPoint.APERIODIC


def test_a_range_without_rattling_is_said_so():
    empty = lapwing.branches(PAIR, SHIPPED, low=13.0, high=13.5, seeds=2, settle=50, **SCENE_A)
    assert empty.sizes["point"] == 0
    assert empty["seed_engaged"].values.tolist() == empty["seed_motions"].values.tolist() == [3, 3]
    words = [text.get_text() for axis in lapwing.plots.figure_of("bifurcation", empty).axes
             for text in axis.texts]
    assert "no periodic motion with events was found" in words


def test_what_branches_refuse():
    with pytest.raises(ValueError, match="must be below"):
        lapwing.branches(PAIR, SHIPPED, low=2.0, high=1.0, **SCENE_A)
    with pytest.raises(ValueError, match="parameter"):
        lapwing.branches(PAIR, SHIPPED, parameter="torque", low=1.0, high=2.0, **SCENE_A)
    # As a deck does.
    with pytest.raises(ValueError, match="degrees_of_freedom = 2, expected 1"):
        lapwing.branches(PAIR, SHIPPED, low=1.0, high=2.0, degrees_of_freedom=2, **SCENE_A)
    with pytest.raises(ValueError, match=r"'harmonic_amplitude\(1\)', expected one of"):
        lapwing.branches(PAIR, SHIPPED, parameter="harmonic_amplitude(1)", low=1.0, high=2.0,
                         **SCENE_A)


def test_the_curve_may_be_what_varies():
    """Half the transmission error under half the force is the same motion at half the size."""
    def scaled(factor):
        return lapwing.Oscillator(
            factor * lapwing.TransmissionError.harmonic([1.0]), force=1.0, mesh_frequency_ratio=1.0,
            restitution=0.7, backlash=1e3, damping_ratio=0.1)

    orbit = lapwing.find_orbit(scaled(1.0), (0, -6.594392851053709, 0.5876402982244335))
    found = branch(orbit, scaled, value=1.0, low=0.5, high=1.1)
    fold, = [one for one in found.specials if one.kind is SpecialPoint.FOLD]
    assert fold.value == pytest.approx(np.pi * 0.3 / 1.7, rel=1e-12)


def test_cycles_that_were_spent_end_no_rattling():
    """What is known by then is told: it rattles up to there, and where it ends is not said."""
    search = Search(PAIR, SHIPPED, "brake_torque", np.array([11.8, 12.5]), SCENE_A,
                    rattling_cycles=0)
    motions = [Motion(value, FoundMotion.APERIODIC, FoundFrom.UP, 0, (0, -1e-4, 1e-6))
               for value in (11.9, 12.2)]
    found = Found(motions, on=[None, None])
    rattles = rattling.rattling(search, found, [], 12.0)
    assert (rattles.dies.value, rattles.dies.kind) == (11.9, SpecialPoint.POINTS)
    (low, high), = rattles.intervals
    assert low.value == high.value == 12.2
    assert low.kind is high.kind is SpecialPoint.POINTS and math.isnan(high.error)


def test_what_motions_become_beyond_the_ends_is_looked_at_as_often_as_asked():
    """Not at all, or once: motions beyond the ends then, which begin no branch."""
    search = Search(PAIR, SHIPPED, "brake_torque", np.linspace(11.8, 12.5, 8), SCENE_A)
    none, once = (followed(Request(search, 0, 40, 5, ends)) for ends in (0, 1))
    assert all(one.begun is not FoundFrom.END for one in none.motions)
    assert any(one.begun is FoundFrom.END for one in once.motions)
    assert 0 < len(none.branches) <= len(once.branches)
