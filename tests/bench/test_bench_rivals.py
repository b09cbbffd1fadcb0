"""Each rival that is installed gets the motion right; what is not installed is said to be so."""

import numpy as np
import pytest

from lapwing_bench import rivals
from lapwing_bench.judge import judge
from lapwing_bench.problem import problem
from lapwing_bench.reference import load, variant
from lapwing_bench.rivals import RIVALS
from lapwing_bench.scenes import SCENES, SHORT

# Tight enough for every one of them to be far better than the error allowed below.
TIGHT = {rival.name: rival.tolerances[-1] for rival in RIVALS}
# A wrong event, law or sign costs 1e-2 mesh periods and more.
ALLOWED = 1e-5
CASES = [("S2", 60), ("S3b", 0), ("S3b", 30), ("S4", 20), ("A", 0), ("A", 20)]


@pytest.mark.parametrize("rival", [pytest.param(rival, id=rival.name, marks=pytest.mark.skipif(
    not rival.installed, reason=f"{rival.package} is not installed")) for rival in RIVALS])
@pytest.mark.parametrize(("name", "index"), CASES)
def test_a_rival_is_right(rival, name, index):
    scene = SCENES[name]
    reference = load(name, variant(scene, rule=True, table=False))[scene.torques[index]]
    given = problem(scene.oscillators[index])
    outcome = rival.follower(scene, TIGHT[rival.name])(given, SHORT).outcome()
    found = judge(outcome, reference, given, SHORT, TIGHT[rival.name])
    assert outcome.failure == ""
    assert found.compared == np.count_nonzero(
        reference.events["time"] < reference.listed_until[SHORT])
    assert found.error < ALLOWED


@pytest.mark.parametrize("threads", [1, 2])
@pytest.mark.parametrize(("rival", "module"), [
    pytest.param(rival, module, id=module, marks=pytest.mark.skipif(
        not rival.installed, reason=f"{rival.package} is not installed"))
    for rival in RIVALS for module in rival.sweepers])
@pytest.mark.parametrize("name", ["S2", "S3b", "S4", "A"])
def test_a_rivals_sweep_is_right(rival, module, name, threads):
    """Seven torques: no whole number of batches."""
    scene = SCENES[name]
    references = load(name, variant(scene, rule=True, table=False))
    chosen = range(0, len(scene.torques), 10)
    given = [problem(scene.oscillators[i]) for i in chosen]
    records = rival.sweeper(module, scene, TIGHT[rival.name], threads)(given, SHORT)
    assert len(records) == len(given) == 7
    for i, one, record in zip(chosen, given, records, strict=True):
        outcome = record.outcome()
        found = judge(outcome, references[scene.torques[i]], one, SHORT, TIGHT[rival.name])
        assert outcome.failure == "" and found.error < ALLOWED


def test_scipy_converges():
    """A thousandth of the tolerance: an error less than a tenth."""
    scene, errors = SCENES["S3b"], []
    reference, given = load("S3b", "series_rule")[scene.torques[0]], problem(scene.oscillators[0])
    rival = next(rival for rival in RIVALS if rival.name == "SciPy DOP853")
    for tolerance in (1e-5, 1e-8, 1e-11):
        outcome = rival.follower(scene, tolerance)(given, SHORT).outcome()
        errors.append(judge(outcome, reference, given, SHORT, tolerance).event_error)
    assert errors[2] < errors[1] / 10 < errors[0] / 100


def test_a_missing_package_is_no_error():
    absent = rivals.Rival("nothing", "scipy_events", "no-such-package-at-all", (1e-6,), True)
    assert absent.installed is None
