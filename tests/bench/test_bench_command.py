"""The command as a user gives it, at tiny settings."""

import numpy as np
import pytest
from typer.testing import CliRunner

from lapwing.cli import app
from lapwing_bench import measure, public_calls, rivals, store, whole_calls

RUN = ["bench", "--scene", "S4", "--method", "exact", "--method", "rk4", "--method",
       "SciPy DOP853"]


@pytest.fixture(scope="module")
def outcome(tmp_path_factory):
    """Result of one small run with a page, and its folder."""
    folder = tmp_path_factory.mktemp("bench")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(measure, "QUICK", measure.Plan(
            torques=3, slow_torques=1, slow_short_torques=2, tolerances=4, repeats=1))
        patch.setattr(whole_calls, "CASES", (whole_calls.Case(5, 0, 2), whole_calls.Case(
            9, 2, 3, rivals=False)))
        patch.setattr(whole_calls, "LEAST_SECONDS", 0.0)
        patch.setattr(rivals, "version", lambda package: None if package == "heyoka" else "1.0")
        result = CliRunner().invoke(app, [*RUN, "--out", str(folder), "--page",
                                          str(folder / "docs" / "page.md")])
    return result, folder


def test_everything_is_written(outcome):
    result, folder = outcome
    assert result.exit_code == 0, result.output
    for name in ("bench.nc", "work_precision.png", "work_precision.pdf", "docs/page.md",
                 "docs/images/work_precision.png"):
        assert (folder / name).stat().st_size > 0
        assert str(folder / name) in result.output.replace("\n", "")


def test_numbers_are_stored(outcome):
    datasets, attributes = store.read(outcome[1] / "bench.nc")
    assert list(datasets) == ["S4"] and attributes["command"].startswith("lapwing bench")
    data = datasets["S4"]
    assert data["torque"].values.tolist()[::2] == [0.5, 14.0]
    assert list(data["method"].values) == ["exact"] + ["rk4"] * 3 + ["SciPy DOP853"] * 2
    own = data["method"].values == "rk4"
    # Three cycles at the method's own tolerances: far below 1e-3 mesh periods at the tightest.
    errors = data["error"].values[own][:, :, 0]
    assert np.all(np.isfinite(errors)) and np.all(errors[-1] < 1e-9)
    assert np.all(data["microseconds"].values[own] > 0)
    assert data["identical_bytes"].values[own].max() == 1
    studied = data["identical_bytes"].values >= 0
    assert np.all(data["study_computed"].values[studied] > 0)
    assert np.all(data["study_copied"].values[studied] > 0)
    ran = ~np.isnan(data["error"].values[-2:, :, 0])
    assert ran.sum(axis=1).tolist() == [2, 2]


def test_whole_calls_are_measured_at_the_setting_that_is_right(outcome):
    data = store.read(outcome[1] / "bench.nc")[0]["S4"]
    calls, inside = data["call"].values, data["call_engine"].values
    assert data["case"].values.tolist() == ["5 × 2", "9 × 5"]
    assert np.all(calls[0] > inside[0]) and np.all(inside[0] > 0)
    settings = np.flatnonzero(~np.isnan(calls[:, 0, 0]))
    assert len(settings) == 2 and data["method"].values[settings].tolist() == ["exact", "rk4"]
    assert np.nanmedian(data["error"].values[settings[1], :, 0]) <= whole_calls.CALL_ERROR
    assert np.all(np.isnan(calls[settings[1], 1]))


def test_calls_alone_are_measured_by_the_processor(monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(public_calls, "MOST_CALLS", 3)
    monkeypatch.setattr(public_calls, "SWEEPS", ((4, 0, 2),))
    result = CliRunner().invoke(app, ["bench", "--calls"])
    assert result.exit_code == 0, result.output
    for word in ("Public calls", "simulate, prepared", "sweep S1, 4 × 2, 2 threads"):
        assert word in result.output
    assert not list(tmp_path.iterdir())
    for line in public_calls.lines():
        cost = public_calls.measured(line)
        assert np.all(cost.outside > 0) and np.all(cost.outside < cost.processor)


def test_the_terminal_and_the_page_show_the_tables(outcome):
    result, folder = outcome
    page = (folder / "docs" / "page.md").read_text(encoding="utf-8")
    for text in (result.output, page):
        for word in ("Ratios", "Whole calls", "Outside the engine", "Cost at equal error",
                     "A study", "SciPy DOP853", "rk4"):
            assert word in text
    assert "heyoka: not installed" in result.output
    assert "heyoka not installed" in page and "images/work_precision.png" in page
    assert "{" not in page


def test_stored_numbers_are_reported_without_measuring(outcome, tmp_path, monkeypatch):
    monkeypatch.setattr(measure, "measure", None)
    result = CliRunner().invoke(app, ["bench", "--from", str(outcome[1] / "bench.nc"), "--out",
                                      str(tmp_path)])
    assert result.exit_code == 0 and (tmp_path / "work_precision.png").exists()


def test_unknown_names_are_refused_all_at_once():
    result = CliRunner().invoke(app, ["bench", "--scene", "S9", "--method", "magic"])
    assert result.exit_code == 2
    assert "scene 'S9'" in result.output and "method 'magic'" in result.output


def test_a_missing_result_file_is_bad_input(tmp_path):
    result = CliRunner().invoke(app, ["bench", "--from", str(tmp_path / "none.nc")])
    assert result.exit_code == 2 and "none.nc" in result.output
