"""The result file: what is written is read back, whole or not at all, and means what CF says."""

import shutil
import subprocess
import sys

import numpy as np
import pytest
import xarray as xr

import lapwing
from helpers import PAIR, SHIPPED, dataset_bytes, scene_a
from lapwing.results import DESCRIPTIONS, described, read_results, write_results
from lapwing.studies.response.run import response

DECK = "! deck with µ and θ\n&gear_pair\n/\n"
SHORT = {"settle": 20, "record": 24, "samples_per_cycle": 32}
SWEPT = {"pinion_speed_rpm": 240, "impact_law": "absolute", "settle": 20, "record": 8}


@pytest.fixture(scope="module")
def responses():
    """In deck order, which is not the order of names: bouncing, engaged, failed."""
    return [
        response(scene_a(1.8), PAIR, name="z", claim_deepest_separation=0.00063,
                 claim_text="3 impacts", **SHORT),
        response(scene_a(12), PAIR, name="m", **SHORT),
        response(scene_a(1.8), PAIR, name="a", method="rk4",
                 max_steps_per_cycle=3, **SHORT)]


@pytest.fixture(scope="module")
def swept():
    """A few torques; at the lowest step bound every point fails."""
    torques = {"values": (0.5, 1.8, 12.1), "observe": ("cycles", "impacts"), "max_impacts": 50}
    return {"torque": lapwing.sweep(PAIR, SHIPPED, **torques, **SWEPT),
            "broken": lapwing.sweep(PAIR, SHIPPED, **torques, **SWEPT, method="rk4",
                                    max_steps_per_cycle=3)}


@pytest.fixture(scope="module")
def criticals():
    """Without trials, and with those of each kind of search."""
    few = {"starts": lapwing.StartGrid(1, 1, 1), **SWEPT}
    return {"full": lapwing.critical_full(PAIR, SHIPPED, pinion_speed_rpm=240),
            "speed": lapwing.critical_full(PAIR, SHIPPED, parameter="pinion_speed_rpm",
                                           values=[100, 200, 300], safe_end="low",
                                           brake_torque=12),
            "safe": lapwing.critical_safe(PAIR, SHIPPED, values=[11, 14], resolution=2, **few),
            "back": lapwing.critical_back(PAIR, SHIPPED, values=[0.3, 6], **few)}


@pytest.fixture(scope="module")
def write(responses, swept, criticals):
    def write_to(path, **changes):
        arguments = {
            "deck_name": "case", "deck_text": DECK, "used_text": "! used\n", "used_hash": "0a1b",
            "pair": PAIR, "te": SHIPPED, "te_sign": "printed", "found": {
                "response": {one.attrs["name"]: one for one in responses}, "sweep": swept,
                "critical": criticals}, **changes}
        write_results(path, **arguments)
        return path

    return write_to


@pytest.fixture(scope="module")
def path(write, tmp_path_factory):
    return write(tmp_path_factory.mktemp("results") / "result.nc")


def test_responses_read_back_equal(path, responses):
    with read_results(path) as results:
        assert results.responses == ("z", "m", "a")
        for order, given in enumerate(responses[:2]):
            found = results.response(given.attrs["name"])
            assert dataset_bytes(found) == dataset_bytes(given)
            assert dict(found.attrs) == {**given.attrs, "order": order, "kind": "response"}


def test_sweeps_read_back_equal(path, swept):
    with read_results(path) as results:
        assert results.sweeps == ("torque", "broken")
        found = results.sweep("torque")
        for name, given in swept["torque"].variables.items():
            np.testing.assert_array_equal(found[name], given, err_msg=name)
        assert found["states_visited"].dtype == np.int32
        assert found.attrs["parameter"] == "brake_torque"


def test_critical_values_read_back_equal(path, criticals):
    with read_results(path) as results:
        assert results.criticals == ("full", "speed", "safe", "back")
        for order, (name, given) in enumerate(criticals.items()):
            found = results.critical(name)
            assert dataset_bytes(found) == dataset_bytes(given)
            for key, value in {**given.attrs, "name": name, "order": order}.items():
                np.testing.assert_equal(found.attrs[key], value, err_msg=key)
        assert results.critical("safe")["trial_value"].attrs["units"] == "N m"
        assert results.critical("speed")["trial_value"].attrs["units"] == "rpm"
        assert "scan" in results.critical("safe")["trial_stage"].attrs["flag_meanings"]


def test_claims_stand_beside_the_sweep(path):
    with read_results(path) as results:
        sweep = results.sweep("torque")
        assert sweep["claim_value"].values == pytest.approx([1.8], rel=1e-15)
        assert sweep["claim_deepest_separation"].values.tolist() == [0.00063]
        assert sweep["claim_text"].values.tolist() == ["3 impacts"]


def test_failed_runs_keep_their_place(path):
    with read_results(path) as results:
        failed = results.response("a")
        assert failed.attrs["status_meaning"] == "too_many_steps"
        assert np.isnan(failed.attrs["mesh_force_mean"])
        assert failed.sizes["sample"] == 24 * 32
        for name in ("phi", "motion_state", "cycle_impacts"):
            assert np.isnan(failed[name]).all(), name
        broken = results.sweep("broken")
        assert (broken["status"] == lapwing.Status.TOO_MANY_STEPS).all()
        assert np.isnan(broken["states_visited"]).all()


def test_gear_deck_and_provenance(path):
    with read_results(path) as results:
        assert results.gear_pair["gear_teeth"] == 32
        assert results.gear_pair["natural_frequency"] == PAIR.natural_frequency
        assert results.attrs["deck_text"] == DECK
        assert results.attrs["used_hash"] == "0a1b"
        for name in ("lapwing_version", "compiler", "build_flags", "build_type", "cpu",
                     "python_version", "numpy_version"):
            assert results.attrs[name], name
        table = results.transmission_error
        np.testing.assert_array_equal(table["coefficients"], SHIPPED.coefficients)
        assert table.attrs["flank_scale"] == 1.28
        assert table.attrs["source"] == "table of 4 pieces with no kinks"


def test_the_table_can_name_its_source(write, tmp_path):
    with read_results(write(tmp_path / "r.nc", te_source="te.csv", found={})) as results:
        assert results.transmission_error.attrs["source"] == "te.csv"


def test_same_arguments_same_contents(write, path, tmp_path):
    again = write(tmp_path / "again.nc")
    with read_results(path) as one, read_results(again) as two:
        assert one.attrs == two.attrs
        for name in one.responses[:2]:
            assert dataset_bytes(one.response(name)) == dataset_bytes(two.response(name))
            assert str(one.response(name).attrs) == str(two.response(name).attrs)
        assert str(one.sweep("torque").attrs) == str(two.sweep("torque").attrs)


def test_a_failed_write_leaves_the_old_file_and_nothing_else(write, path, tmp_path):
    kept = tmp_path / "result.nc"
    shutil.copy(path, kept)
    before = kept.read_bytes()
    with pytest.raises((TypeError, ValueError)):
        write(kept, used_hash=object())
    assert kept.read_bytes() == before
    assert [file.name for file in tmp_path.iterdir()] == ["result.nc"]


def test_nothing_but_a_result_file_is_read(tmp_path):
    with pytest.raises(OSError):
        read_results(tmp_path / "none.nc")
    xr.Dataset(attrs={"title": "other"}).to_netcdf(tmp_path / "other.nc")
    with pytest.raises(ValueError, match=r"other\.nc is no result file"):
        read_results(tmp_path / "other.nc")


def test_reading_needs_no_engine(path):
    code = ("import sys; from lapwing.results import read_results; "
            "from lapwing.report.summary import summary_text; "
            f"summary_text(read_results({str(path)!r})); "
            "sys.exit('lapwing._engine' in sys.modules)")
    subprocess.run([sys.executable, "-c", code], check=True)


def test_every_variable_is_described(path):
    with read_results(path) as results:
        groups = [results.transmission_error, *map(results.response, results.responses),
                  *map(results.sweep, results.sweeps)]
        for group in map(results.critical, results.criticals):
            assert all(variable.attrs["long_name"] != str(name).replace("_", " ")
                       for name, variable in group.variables.items())
        for group in groups:
            for name, variable in group.variables.items():
                assert {name, str(name).removeprefix("cycle_")} & DESCRIPTIONS.keys(), name
                assert variable.attrs["long_name"]
        codes = results.response("z")["event_kind"].attrs
        assert dict(zip(codes["flag_meanings"].split(), codes["flag_values"].tolist(),
                        strict=True)) == {k.name.lower(): k.value for k in lapwing.EventKind}


def test_cf_conventions(path, tmp_path):
    """Each group on its own: the checker does not look into groups.

    The sweep goes without `start`: the checker subtracts coordinates, and these are words.
    """
    pytest.importorskip("compliance_checker", reason="compliance-checker is not installed")
    from compliance_checker.runner import CheckSuite, ComplianceChecker

    CheckSuite.load_all_available_checkers()
    with read_results(path) as results:
        groups = {"te": results.transmission_error, "z": results.response("z"),
                  **{name: results.critical(name) for name in ("speed", "safe", "back")},
                  "sweep": results.sweep("torque").drop_vars("start")}
        for name, group in groups.items():
            flat = described(group.load()).assign_attrs(
                Conventions="CF-1.11", title=name, history="test")
            for variable in flat.variables.values():
                variable.encoding = {}
            flat.to_netcdf(tmp_path / f"{name}.nc",
                           encoding={key: {"_FillValue": None} for key in flat.variables})
            report = tmp_path / f"{name}.txt"
            passed, errors = ComplianceChecker.run_checker(
                str(tmp_path / f"{name}.nc"), ["cf:1.11"], 0, "strict",
                output_filename=str(report), output_format="text")
            assert passed and not errors, report.read_text()


def test_the_operation_is_that_of_the_deck(write, tmp_path):
    path = tmp_path / "result.nc"
    write(path, used_text="! mesh_frequency_hz = 9\n&scene\n  count_depth = 0.01\n/\n\n&operation\n"
                          "  ! drive_torque: left out, the balance T_l/i12\n"
                          "  brake_torque = 1.8\n  pinion_speed_rpm = 2.4e2  ! default\n/\n\n"
                          "&response\n  brake_torque = 12.0\n/\n")
    with read_results(path) as results:
        assert results.operation == {"brake_torque": 1.8, "pinion_speed_rpm": 240.0}
    write(path)
    with read_results(path) as results:
        assert results.operation == {}
