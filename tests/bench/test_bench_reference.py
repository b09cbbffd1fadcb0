"""The stored references: of these very scenes, and equal to another route's numbers."""

import sys

import numpy as np
import pytest

from helpers import EPS, ROOT
from lapwing import EventKind, MotionState
from lapwing_bench.reference import load, variant
from lapwing_bench.scenes import LONG, SCENES, SHORT

KINDS = {"impact": EventKind.IMPACT, "release": EventKind.RELEASE, "engage": EventKind.ENGAGE,
         "chatter_end": EventKind.CHATTER_END}
MOTIONS = {"separation": MotionState.SEPARATION, "drive": MotionState.ENGAGEMENT,
           "coast": MotionState.BACK_ENGAGEMENT}


def variants(scene):
    return {variant(scene, rule=rule, table=table) for rule in (False, True)
            for table in (False, True)} - ({"table_rule"} if scene.is_series else set())


@pytest.mark.parametrize("name", SCENES)
def test_every_variant_is_of_this_scene(name):
    scene = SCENES[name]
    for of in variants(scene):
        references = load(name, of)
        assert tuple(references) == scene.torques
        for reference in references.values():
            cycles = LONG if reference.calm else SHORT
            times = reference.events["time"]
            assert np.all(np.diff(times) >= 0) and np.all((times > 0) & (times < cycles))


@pytest.mark.parametrize("name", SCENES)
def test_the_force_is_the_engine_s_own_double(name):
    import xarray as xr

    from lapwing_bench.reference import DATA

    scene = SCENES[name]
    for of in variants(scene):
        with xr.open_dataset(DATA / f"{name}.nc", group=of) as dataset:
            assert dataset["force"].values.tolist() == [osc.force for osc in scene.oscillators]


@pytest.mark.parametrize("name", SCENES)
def test_calm_torques_are_the_same_in_every_variant_and_calm(name):
    found = [load(name, of) for of in variants(SCENES[name])]
    for torque in SCENES[name].torques:
        assert len({references[torque].calm for references in found}) == 1
        if found[0][torque].calm:
            assert all(references[torque].events["growth"].max(initial=0) < 1e4
                       and references[torque].state_growth[LONG] < 1e4 for references in found)


@pytest.mark.parametrize("name", ["S3", "S3b"])
def test_the_rule_changes_nothing_but_chatter(name):
    """Up to the first chatter the two ends of a chatter give the same doubles."""
    true, rule = (load(name, f"series_{end}") for end in ("true", "rule"))
    for torque in SCENES[name].torques:
        ends = [reference.events["kind"] == EventKind.CHATTER_END
                for reference in (true[torque], rule[torque])]
        n = min(np.argmax(end) if end.any() else end.size for end in ends)
        for key in ("kind", "time", "velocity_after"):
            assert np.array_equal(true[torque].events[key][:n], rule[torque].events[key][:n])


def independent(osc, cycles):
    """The 60-digit integrator of the engine's tests, which works piece by piece of the table."""
    sys.path.insert(0, str(ROOT / "tests" / "reference"))
    try:
        from exact_flow import simulate
    finally:
        sys.path.pop(0)
    te = osc.te
    pieces = [[float(knot), [float(c) for c in row]]
              for knot, row in zip(te.knots, te.coefficients, strict=False)]
    scene = {"force": osc.force, "mesh_frequency_ratio": osc.mesh_frequency_ratio,
             "gear_ratio": osc.gear_ratio, "damping_ratio": osc.damping_ratio,
             "restitution": osc.restitution, "backlash": osc.backlash,
             "contact_law": osc.contact_law, "impact_law": osc.impact_law,
             "te": {"kind": "pieces", "pieces": pieces}}
    return simulate(scene, "rest", cycles)


@pytest.mark.parametrize(("name", "index"), [
    ("S2", 20), ("S3b", 10), ("S4", 12), ("S4", 60), ("A", 0), ("A", 30)])
def test_another_route_gives_the_same(name, index):
    """Both are right to far more digits than are stored; left are rounding and what a joint is.

    The other route takes the slope jump at every joint of the table for a kink, however small; the
    stored one takes θ to be smooth but at the kinks that are marked. The jumps of all joints
    passed, over the largest slope, are a relative error of the velocity, for each flight as large
    as such a change of the torque: the growth says what the rest of the motion makes of it.
    """
    scene = SCENES[name]
    osc, reference = scene.oscillators[index], load(name, "table_true")[scene.torques[index]]
    found = independent(osc, SHORT)
    rows = [(KINDS[e.kind] + (e.flank == "coast"), float(e.tau) / osc.period)
            for e in found.events if e.kind != "kink"]
    stored = reference.events
    keep = stored["cycle"] < SHORT
    ends = zip(stored["chatter_since"][keep], stored["time"][keep], strict=True)
    windows = [(since, end) for since, end in ends if not np.isnan(since)]
    windows.append((reference.listed_until[SHORT], np.inf))
    rows = [row for row in rows if not (row[0] in (EventKind.IMPACT, EventKind.BACK_IMPACT)
                                        and any(a < row[1] < b for a, b in windows))]
    assert [row[0] for row in rows] == stored["kind"][keep].tolist()
    joints = SHORT * joint_error(osc.te)
    times, growth = stored["time"][keep], stored["growth"][keep]
    error = np.abs(np.array([row[1] for row in rows]) - times)
    # τ over P is rounded twice on one side, once on the other.
    assert np.all(error <= 4 * EPS * times + joints * (1 + growth))
    motion, phi, velocity = reference.states[SHORT]
    allowed = (4 * EPS + joints) * (1 + reference.state_growth[SHORT])
    assert MOTIONS[found.final.motion] == motion
    assert abs(float(found.final.phi) - phi) <= allowed * osc.angle_scale
    assert abs(float(found.final.velocity) - velocity) <= allowed * osc.angle_scale


def joint_error(te):
    """Slope jumps at the joints that are no kinks, all of them, over the largest slope."""
    left, right = (te.table_derivative(1, te.knots[:-1], side) for side in ("left", "right"))
    return np.where(te.kinks, 0.0, np.abs(right - left)).sum() / np.abs(right).max()
