"""The seam between Python and the compiled engine: kinds, codes, sizes, lazy imports, threads."""

import inspect
import itertools
import os
import re
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from lapwing._engine import api

import lapwing
from helpers import EPS, PAIR, ROOT, SHIPPED, dataset_bytes, scene_a, scene_c, scene_d
from lapwing import Status, engine, simulate
from lapwing.base import codes
from lapwing.base.threads import default_threads
from lapwing.engine import calls, records

FORTRAN = ROOT / "fortran"
PROCEDURES = [name for name in dir(api) if not name.startswith("_")]


def source(name):
    return (FORTRAN / name).read_text(encoding="utf-8")


# --- what f2py made of api.f90 ----------------------------------------------------------------


def test_every_public_procedure_is_wrapped_and_nothing_else():
    public = ", ".join(re.findall(r"public :: (.*)", source("api/api.f90"))).split(", ")
    assert sorted(PROCEDURES) == sorted(public)
    assert all(callable(getattr(api, name)) for name in PROCEDURES)


@pytest.mark.parametrize("name", PROCEDURES)
def test_no_argument_became_single_precision(name):
    """A kind f2py does not know silently becomes float (trap 1)."""
    text = getattr(api, name).__doc__
    arrays = set(re.findall(r"array\('(.)'\)", text))
    assert "f" not in arrays
    assert arrays and arrays <= {"d", "i"}


def test_the_api_file_declares_c_kinds_and_results_of_known_shape():
    """An assumed shape is taken of what comes in, which is contiguous; an array that f2py makes
    says its size."""
    text = source("api/api.f90")
    declared = re.findall(
        r"^ *(\w+\(?\w*\)?)(, contiguous)?, intent\((in|out|inout)\) :: ([^!\n]+)", text, re.M)
    assert len(declared) > 30
    for kind, contiguous, intent, names in declared:
        assert kind in ("integer(c_int)", "real(c_double)")
        assert bool(contiguous) == ("(:" in names)
        assert intent != "out" or "(:" not in names
    assert "optional" not in text.replace("nothing is optional", "")
    assert text.count("!f2py threadsafe") == text.count("end subroutine") - 2


@pytest.mark.parametrize("name", PROCEDURES)
def test_a_procedure_has_few_arguments(name):
    arguments = re.search(rf"subroutine {name}\((.*?)\)", source("api/api.f90"), re.S)[1]
    assert arguments.count(",") < 12


def test_codes_are_those_of_the_engine():
    mirrored = (codes.MotionState, codes.Flank, codes.EventKind, codes.ContactLaw,
                codes.ImpactLaw, codes.Gap, codes.Status, codes.Method, codes.Ending)
    assert api.code_values().tolist() == [int(c) for c in itertools.chain(*mirrored)]


def test_the_order_of_the_codes_is_that_of_their_names():
    """`all_codes` of codes.f90 spells names: they are those of the enumerations."""
    text = re.search(r"all_codes\(\*\) = \[(.*?)\]", source("base/codes.f90"), re.S)[1]
    names = [name.strip() for name in text.replace("&", "").replace("\n", " ").split(",")]
    expected = []
    for enum, prefix in ((codes.MotionState, ""), (codes.Flank, ""), (codes.EventKind, "event_"),
                         (codes.ContactLaw, "law_"), (codes.ImpactLaw, "law_"),
                         (codes.Gap, "gap_"), (codes.Status, "status_"),
                         (codes.Method, "method_"), (codes.Ending, "end_")):
        for member in enum:
            plain = member.name.lower()
            if enum is codes.Flank:
                plain = plain.replace("none", "no") + "_flank"
            after = ""
            if plain.startswith("back_") and enum is codes.EventKind:
                plain, after = plain.removeprefix("back_"), " + 1"
            expected.append(prefix + plain + after)
    assert names == expected


def test_sizes_are_those_of_the_engine():
    assert api.sizes().tolist() == [
        calls.BLOB_SIZE, calls.WORK_SIZE, calls.LOG_COLUMNS, calls.CYCLE_COLUMNS,
        calls.SAMPLE_COLUMNS, calls.N_REALS, calls.N_CHOICES,
        calls.TANGENT_COLUMNS, calls.OUTCOME_COLUMNS, calls.MOST_LOOKED_FOR,
        calls.GOAL_COLUMNS, calls.END_COLUMNS, calls.SUSPENDED_SIZE,
        calls.AVERAGE_COLUMNS]
    for table, size in ((records.EVENT_TABLE, calls.LOG_COLUMNS),
                        (records.SAMPLE_TABLE, calls.SAMPLE_COLUMNS),
                        (records.CYCLE_TABLE, calls.CYCLE_COLUMNS),
                        (records.TANGENT_TABLE, calls.TANGENT_COLUMNS),
                        (records.OUTCOME_TABLE, calls.OUTCOME_COLUMNS),
                        (engine.GOAL_TABLE, calls.GOAL_COLUMNS),
                        (engine.END_TABLE, calls.END_COLUMNS)):
        assert table.itemsize == 8 * size


def test_wrong_sizes_are_refused_before_the_engine_sees_them():
    with pytest.raises((ValueError, TypeError)):
        api.evaluate_table(np.zeros((5, 2), order="F"), 1.0, 1.0, np.zeros(3))


@pytest.mark.parametrize("build", [lambda: scene_a(1.0), lambda: scene_c(1.0),
                                   lambda: scene_d(1.0, te_sign="geometric")])
def test_the_engine_sees_the_table_python_sees(build):
    osc = build()
    phase = (np.arange(2000) + 0.5) / 2000
    te, width = osc.te, np.diff(osc.te.knots)
    # A piece's own size; each derivative may magnify it by degree/width.  A re-expansion costs
    # some ten roundings per coefficient; the place itself, rounded by EPS·P, one derivative more.
    size = (np.abs(te.coefficients) * width[:, None] ** np.arange(6)).sum(axis=1).max()
    g = engine.flank_motion(osc, phase * osc.period)
    for k in range(3):
        exact = osc.flank_scale * te.table_derivative(k, phase) / osc.period**k
        tolerance = (64 * EPS * osc.gear_ratio * size * (5 / width.min()) ** k / osc.period**k
                     * (1 + 5 / width.min() / 64))
        assert np.allclose(g[k], exact, rtol=0, atol=tolerance)
        assert tolerance < 1e-6 * np.abs(exact).max()  # it does say something


# --- importing --------------------------------------------------------------------------------


def run_python(code, **environment):
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True,
                          env={**os.environ, **environment}, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout.strip()


@pytest.mark.parametrize("code", [
    "import lapwing", "import lapwing; lapwing.GearPair; lapwing.TransmissionError",
    "from lapwing import simulate, Oscillator, EventKind, critical_torque"])
def test_importing_does_not_import_the_heavy_ones(code):
    heavy = ("matplotlib", "xarray", "scipy", "netCDF4", "pandas")
    found = run_python(f"import sys; {code}; print([m for m in {heavy} if m in sys.modules])")
    assert found == "[]"


def test_importing_the_package_alone_does_not_load_the_engine():
    assert run_python("import sys, lapwing; print('lapwing._engine' in sys.modules)") == "False"


def test_public_names_are_stable():
    """No submodule takes the place of a public name, in whatever order things are imported."""
    code = ("import pkgutil, importlib, lapwing\n"
            "def load(package):\n"
            "    for m in pkgutil.iter_modules(package.__path__, package.__name__ + '.'):\n"
            "        if m.name.endswith('__main__'): continue\n"
            "        try: module = importlib.import_module(m.name)\n"
            "        except ModuleNotFoundError as error:\n"
            "            if error.name in ('heyoka', 'numba', 'sksundae'): continue  # the extra\n"
            "            raise\n"
            "        if m.ispkg: load(module)\n"
            "load(lapwing)\n"
            "import types\n"
            "print([n for n in lapwing.__all__ if isinstance(getattr(lapwing, n),"
            " types.ModuleType)])")
    assert run_python(code) == "[]"
    for name in lapwing.__all__:
        assert not inspect.ismodule(getattr(lapwing, name))
    assert set(lapwing.__all__) <= set(dir(lapwing))
    with pytest.raises(AttributeError, match="no attribute 'nothing'"):
        lapwing.nothing  # noqa: B018


def test_the_version_is_that_of_the_build_file():
    stated = re.search(r"version: '([^']+)'", (ROOT / "meson.build").read_text("utf-8"))[1]
    assert lapwing.__version__ == stated


# --- calling ----------------------------------------------------------------------------------


def test_calls_from_several_threads_are_independent():
    """The lock of the interpreter is released; no variable of the engine is shared (trap 7)."""
    scenes = [scene_a(1.8), scene_a(5.5, "relative"), scene_d(2.0), scene_c(1.5),
              scene_a(0.8, "relative", contact_law="compliant"),
              scene_d(8.0, contact_law="rigid")]
    alone = [simulate(osc, cycles=20) for osc in scenes]
    with ThreadPoolExecutor(6) as pool:
        together = list(pool.map(lambda osc: simulate(osc, cycles=20), scenes * 3))
    for one, other in zip(alone * 3, together, strict=True):
        assert dataset_bytes(one.events) == dataset_bytes(other.events)
        assert dataset_bytes(one.cycles) == dataset_bytes(other.cycles)
        assert one.final == other.final and one.work == other.work


def test_a_sweep_does_not_wait_for_room_for_ever():
    """Events are never dropped; a log that is too short for them ends the sweep with a word."""
    with pytest.raises(ValueError, match="log_room = 100"):
        engine.sweep([scene_a(5.5)], [(0, 0, False)], [(engine.REST, 0.0, 0.0, 0.0)],
                     numerics=engine.Numerics(), wanted=engine.Wanted(events=True), settle=0,
                     record=20, log_room=100, threads=1)


def test_arguments_are_left_as_they_are():
    osc = scene_a(1.8)
    before = [getattr(SHIPPED, n).tobytes() for n in ("knots", "coefficients", "kinks")]
    run = simulate(osc, cycles=3)
    blob = run.final._blob.tobytes()
    simulate(osc, run.final, cycles=3)
    assert run.final._blob.tobytes() == blob
    assert before == [getattr(SHIPPED, n).tobytes() for n in ("knots", "coefficients", "kinks")]
    assert run.status == Status.OK


@pytest.mark.parametrize(("environment", "threads"), [
    ({"OMP_NUM_THREADS": "3"}, 3), ({"OMP_NUM_THREADS": "3", "SLURM_CPUS_PER_TASK": "5"}, 3),
    ({"SLURM_CPUS_PER_TASK": "5"}, 5), ({"OMP_NUM_THREADS": "0", "SLURM_CPUS_PER_TASK": "2"}, 2),
    ({"OMP_NUM_THREADS": "many", "SLURM_CPUS_PER_TASK": "2"}, 2)])
def test_default_number_of_threads(monkeypatch, environment, threads):
    for name in ("OMP_NUM_THREADS", "SLURM_CPUS_PER_TASK"):
        monkeypatch.delenv(name, raising=False)
    for name, value in environment.items():
        monkeypatch.setenv(name, value)
    assert default_threads() == threads


def test_without_a_word_all_allowed_processors_and_no_more(monkeypatch):
    for name in ("OMP_NUM_THREADS", "SLURM_CPUS_PER_TASK"):
        monkeypatch.delenv(name, raising=False)
    allowed = (len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity")
               else os.cpu_count())
    assert 1 <= default_threads() <= allowed


# --- what is made once -------------------------------------------------------------------------


def test_arguments_are_made_once_and_change_nothing():
    osc = scene_a(3.3)
    first, again = (simulate(osc, cycles=5) for _ in range(2))
    (kept,) = osc.kept.values()
    other = simulate(scene_a(3.3), cycles=5)
    for run in (again, other):
        assert run.final == first.final and dataset_bytes(run.events) == dataset_bytes(first.events)
    simulate(osc, cycles=5, rtol=1e-8)
    assert len(osc.kept) == 2 and kept[1] is next(iter(osc.kept.values()))[1]
    for k in range(3 * calls.MOST_KEPT):
        simulate(osc, cycles=1, rtol=1e-8 * (1 + k))
    assert len(osc.kept) <= calls.MOST_KEPT
    assert "kept" not in osc.__getstate__() and not osc.with_force(1e-5).kept


def test_settings_that_are_kept_are_still_told_by_their_kind():
    simulate(scene_a(3.3), cycles=1, max_events_per_cycle=1)
    for wrong in (True, 1.0, [1]):
        with pytest.raises((TypeError, ValueError), match="max_events_per_cycle"):
            simulate(scene_a(3.3), cycles=1, max_events_per_cycle=wrong)


def test_datasets_of_sweeps_share_no_attributes():
    def swept():
        return lapwing.sweep(PAIR, SHIPPED, values=[1.8], starts=("rest",), settle=0, record=2,
                             mesh_frequency_hz=100.0)

    one = swept()
    one["start"].attrs["mine"] = one["impacts"].attrs["mine"] = 1
    one["phi"][:] = 0
    other = swept()
    assert "mine" not in other["start"].attrs and "mine" not in other["impacts"].attrs
    assert np.any(other["phi"].values != 0)
