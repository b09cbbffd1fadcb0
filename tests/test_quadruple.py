"""The engine compiled in quadruple precision against the 60-digit integrator (tests/reference).

They share no line, so that this checks both: a constant of double precision anywhere in the engine,
or a wrong closed form in the other, would show at 1e-17 or before.
"""

import json
import sys

import numpy as np
import pytest
from mpmath import mp, mpf

from helpers import EPS, ROOT
from lapwing import EventKind
from lapwing_bench.reference import load, variant
from lapwing_bench.scenes import SCENES, SHORT

sys.path += [str(ROOT / "tests" / "reference"), str(ROOT / "tests" / "hard_cases")]
import make_hard_cases
import quadruple

KINDS = {"impact": EventKind.IMPACT, "release": EventKind.RELEASE, "engage": EventKind.ENGAGE,
         "chatter_end": EventKind.CHATTER_END}
HARD_CASES = sorted((ROOT / "tests" / "hard_cases" / "data").glob("*.json"))
# Runge-Kutta at this tolerance, a few seconds a run; the promise about event times is the one of
# docs/method.md: within it times (P + growth).
TOLERANCE = "1e-17"
# A closed form keeps 33 digits but for some thousand roundings; the end of a chatter is promised to
# 1e-26 mesh periods.
CLOSED_FORM = mpf("1e-26")
# Where flights and rigid contact are exact whatever the step, only the 33 digits limit.
CHATTER = mpf(quadruple.CHATTER_TOLERANCE)


@pytest.fixture(scope="module")
def program():
    return quadruple.build()


def test_only_the_kind_differs(program):
    own = (ROOT / "fortran" / "base" / "kinds.f90").read_text(encoding="utf-8").splitlines()
    made = (program.parent / "quadruple_kinds.f90").read_text(encoding="utf-8").splitlines()
    different = [(a.strip(), b.strip()) for a, b in zip(own, made, strict=True) if a != b]
    assert [b for _, b in different][1:] == ["integer, parameter :: wp = real128"]
    assert len(different) == 2 and all(a.replace("real64", "real128") == b for a, b in different)


RUNS = [pytest.param(stem, run, id=f"{stem}-{run['name']}", marks=(
    () if (stem, run["name"]) == ("scene_a_absolute", "a_1.8") else pytest.mark.full))
    for stem, run in quadruple.reference_runs()]


@pytest.mark.parametrize(("stem", "run"), RUNS)
def test_closed_form(program, stem, run):
    """The closed form has nearly all the digits there are."""
    count, _, scaled = quadruple.compare_run(program, run, method="exact")
    assert count == len(quadruple.without_tails(
        [{**e, "tau": mpf(e["tau"])} for e in run["events"]],
        mpf(run["dimensionless"]["period"])))
    assert scaled <= CLOSED_FORM


@pytest.mark.parametrize(("stem", "run"), RUNS)
def test_event_times(program, stem, run):
    count, _, scaled = quadruple.compare_run(program, run, "rk4", TOLERANCE)
    assert count > 0 or not run["events"]  # one is engaged throughout
    assert scaled <= mpf(TOLERANCE)
    if run["scene"]["contact_law"] == "rigid":
        assert scaled <= CHATTER


def test_states_at_cycle_ends(program):
    run = next(run for stem, run in quadruple.reference_runs()
               if (stem, run["name"]) == ("scene_a_absolute", "a_1.8"))
    own = quadruple.follow(program, run["scene"], run["start"], run["cycles"])
    last = run["cycle_states"][-1]
    assert own["final"]["status"] == 0 and own["final"]["cycle"] == run["cycles"]
    assert own["final"]["motion"] == last["motion"]
    # φ is of the size of F, φ' below it; growth of this period-1 motion is below 100 P.
    size = 1e3 * float(run["dimensionless"]["force"]) * float(TOLERANCE)
    for name in ("phi", "velocity"):
        assert own["final"][name] == pytest.approx(mpf(last[name]), rel=0, abs=size)


@pytest.mark.full
@pytest.mark.parametrize("path", HARD_CASES, ids=lambda path: path.stem)
def test_hard_cases(program, path):
    """The numbers of tests/hard_cases, every event, from a second source."""
    case = json.loads(path.read_text(encoding="utf-8"))
    start = {"phase": case["phase"]}
    if case["start"] != "rest":
        state, phi, velocity = case["start"]
        start |= {"motion": make_hard_cases.FLANKS[state], "phi": phi, "velocity": velocity}
    with mp.workdps(50):
        own = quadruple.follow(program, make_hard_cases.reference_scene(case["scene"]), start,
                               case["cycles"], tolerance=TOLERANCE)
        assert own["final"]["status"] == 0
        events = quadruple.without_tails(own["events"], own["period"])
        assert [make_hard_cases.NAMES[e["kind"], e["flank"]] for e in events] == [
            e["kind"] for e in case["events"]]
        # 25 digits are stored; parameters and time are rounded to 33.
        for one, other in zip(events, case["events"], strict=True):
            condition = other["condition"]["tau"] + own["period"]
            assert abs(one["tau"] - mpf(other["tau"])) <= mpf(TOLERANCE) * condition


@pytest.mark.parametrize("name", ["S1", "S2", "S3", "S3b", "S4"])
def test_references_of_the_benchmark(program, name):
    """Harmonic series as they are: the benchmark's own 60-digit integrator, stored as doubles."""
    scene = SCENES[name]
    stored = load(name, variant(scene, rule=False, table=False))
    for osc, torque in list(zip(scene.oscillators, scene.torques, strict=True))[::8]:
        with mp.workdps(50):
            own = quadruple.follow(program, scene_of(osc), "rest", SHORT)
            rows = [(KINDS[e["kind"]] + (e["flank"] == "coast"), float(e["tau"] / own["period"]))
                    for e in own["events"] if e["kind"] != "kink"]
        events = stored[torque].events
        early = events["cycle"] < SHORT
        ends = zip(events["chatter_since"][early], events["time"][early], strict=True)
        inside = [(since, end) for since, end in ends if not np.isnan(since)]
        inside.append((stored[torque].listed_until[SHORT], np.inf))
        rows = [row for row in rows if not (row[0] <= EventKind.BACK_IMPACT and any(
            since < row[1] < end for since, end in inside))]
        assert [kind for kind, _ in rows] == events["kind"][early].tolist()
        # Both far more exact than a double; cycle and phase are stored apart and added up again.
        times = events["time"][early]
        assert np.all(np.abs(np.array([time for _, time in rows]) - times) <= 2 * EPS * times)


def scene_of(osc):
    """An oscillator of a series or of exact pieces as exact_flow.py takes it."""
    te = {"kind": "harmonic", "terms": [[int(n), a, shift] for n, a, shift in osc.te.harmonics]}
    if not len(osc.te.harmonics):
        te = {"kind": "pieces", "pieces": [[float(knot), [float(x) for x in row]] for knot, row in
                                           zip(osc.te.knots, osc.te.coefficients, strict=False)]}
    return {**{key: getattr(osc, key) for key in (
        "force", "mesh_frequency_ratio", "gear_ratio", "damping_ratio", "restitution", "backlash",
        "contact_law", "impact_law", "gap", "back_flank_te", "te_sign")}, "te": te}


def test_stored_files_name_their_command():
    files = sorted((quadruple.DATA / "quadruple").glob("*.json"))
    assert [path.stem for path in files] == sorted(quadruple.FILES)
    for path in files:
        data = json.loads(path.read_text(encoding="utf-8"))
        assert data["command"] == quadruple.COMMAND
        assert [run["name"] for run in data["runs"]] == [n for n, *_ in quadruple.FILES[path.stem]]
        assert all(run["final"]["status"] == 0 for run in data["runs"])
