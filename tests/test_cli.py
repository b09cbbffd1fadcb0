"""The command line: what it prints, what it writes, how it ends."""

import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from typer.testing import CliRunner

from lapwing.cli import BAD_INPUT, FAILED, INTERRUPTED, OK, app
from lapwing.deck import load_deck
from lapwing.results import read_results

INPUTS = Path(__file__).parents[1] / "inputs"
SMALL = """&gear_pair
  pinion_teeth = 25, gear_teeth = 32, pinion_inertia = 0.0078, gear_inertia = 0.026
  pinion_base_lever = 0.034, mesh_stiffness = 3.12e8, backlash = 0.002, restitution = 0.8
  damping_ratio = 0.1
/
&transmission_error parabola_amplitude = 5e-5 /
&operation pinion_speed_rpm = 480, brake_torque = {torque} /
&numerics max_events_per_cycle = {events} /
&response name = 'one', settle_cycles = 2, record_cycles = 2, samples_per_cycle = 20 /
&sweep name = 'torque', parameter = 'brake_torque', from = {first}, to = 6, count = {count},
  settle_cycles = {settle}, record_cycles = 8 /
"""


def write_deck(folder, name="small.nml", **changed):
    values = {"torque": 5, "events": 1000, "first": 4, "count": 2, "settle": 2, **changed}
    path = folder / name
    path.write_text(SMALL.format(**values), encoding="utf-8")
    return path


def call(*words):
    result = CliRunner().invoke(app, [str(word) for word in words])
    assert result.exception is None or isinstance(result.exception, SystemExit), result.exception
    return result


@pytest.fixture
def no_figures(monkeypatch):
    """Figures have tests of their own; drawing them is most of a short run's time."""
    monkeypatch.setattr("lapwing.plots.draw_all", lambda *_, **__: [])


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    """One deck, run once."""
    folder = tmp_path_factory.mktemp("run")
    deck = write_deck(folder)
    result = call("run", deck, "--out", folder / "results", "--threads", 1)
    assert result.exit_code == OK, result.output
    return deck, folder / "results", result


def test_run_writes_everything(finished):
    _, out, result = finished
    folder = out / "small"
    assert str(folder) in result.output
    names = {path.name for path in folder.iterdir()}
    assert {"result.nc", "summary.md", "used.nml"} <= names
    assert any(name.endswith(".png") for name in names)
    assert any(name.endswith(".pdf") for name in names)
    assert not any(name.endswith(".tmp") for name in names)
    with read_results(folder / "result.nc") as results:
        assert tuple(results.responses) == ("one",) and tuple(results.sweeps) == ("torque",)


def test_same_values_are_reused(finished):
    deck, out, _ = finished
    before = (out / "small" / "result.nc").stat().st_mtime_ns
    again = call("run", deck, "--out", out)
    assert again.exit_code == OK and "reused" in again.output
    assert (out / "small" / "result.nc").stat().st_mtime_ns == before


def test_other_values_are_refused_and_named(finished):
    deck, out, _ = finished
    before = (out / "small" / "result.nc").read_bytes()
    refused = call("run", deck, "--out", out, "--set", "operation.brake_torque=5.5")
    assert refused.exit_code == BAD_INPUT
    assert "operation.brake_torque" in refused.output and "--force" in refused.output
    assert (out / "small" / "result.nc").read_bytes() == before


def test_force_replaces_and_override_is_recorded(tmp_path, no_figures):
    deck = write_deck(tmp_path)
    for words in ((), ("--set", "operation.brake_torque=5.5", "--force")):
        assert call("run", deck, "--out", tmp_path / "r", *words).exit_code == OK
    used = (tmp_path / "r" / "small" / "used.nml").read_text(encoding="utf-8")
    assert re.search(r"brake_torque\s*=\s*5\.5\s*! --set", used)


def test_used_deck_reads_back(finished, tmp_path):
    _, out, _ = finished
    assert call("check", out / "small" / "used.nml").exit_code == OK


def test_threads_change_no_number(finished, tmp_path, no_figures):
    deck, out, _ = finished
    assert call("run", deck, "--out", tmp_path, "--threads", 2).exit_code == OK
    with read_results(out / "small" / "result.nc") as one, \
            read_results(tmp_path / "small" / "result.nc") as two:
        assert one.sweep("torque").load().identical(two.sweep("torque").load())
        assert one.response("one").load().identical(two.response("one").load())


def test_bad_deck_stops_no_other(tmp_path, no_figures):
    bad = tmp_path / "bad.nml"
    bad.write_text("&gear_pair pinion_tooth = 25 /\n", encoding="utf-8")
    good = write_deck(tmp_path, "good.nml")
    result = call("run", bad, good, "--out", tmp_path / "r")
    assert result.exit_code == BAD_INPUT
    assert f"{bad}:1:12:" in result.output and "pinion_teeth" in result.output
    assert (tmp_path / "r" / "good" / "result.nc").exists()
    assert not (tmp_path / "r" / "bad").exists()


def test_equal_stems_are_refused(tmp_path):
    (tmp_path / "a").mkdir()
    decks = write_deck(tmp_path), write_deck(tmp_path / "a")
    result = call("run", *decks, "--out", tmp_path / "r")
    assert result.exit_code == BAD_INPUT and not (tmp_path / "r").exists()


def test_numerical_failure_is_exit_1_and_written(tmp_path, no_figures):
    """Four events allowed in a cycle that rattles: a status in the file, its neighbours kept."""
    deck = write_deck(tmp_path, events=4, torque=20, first=5)
    result = call("run", deck, "--out", tmp_path / "r", "--set", "sweep.to=20")
    assert result.exit_code == FAILED and "failed numerically" in result.output
    with read_results(tmp_path / "r" / "small" / "result.nc") as results:
        status = results.sweep("torque").status.values
        assert (status == 1).any() and (status == 0).any()


@pytest.mark.parametrize(("words", "said"), [
    (["--set", "operation.brake_torque"], "GROUP.KEY=VALUE"),
    (["--set", "operation.torque=1"], "unknown key torque"),
    (["--set", "operation.brake_torque=abc"], "brake_torque"),
])
def test_bad_overrides(tmp_path, words, said):
    result = call("run", write_deck(tmp_path), "--out", tmp_path / "r", *words)
    assert result.exit_code == BAD_INPUT and said in result.output
    assert not (tmp_path / "r").exists()


def test_missing_deck(tmp_path):
    result = call("check", tmp_path / "none.nml")
    assert result.exit_code == BAD_INPUT and "none.nml" in result.output


def test_new_writes_a_good_deck_and_never_overwrites(tmp_path):
    deck = tmp_path / "mine.nml"
    assert call("new", deck).exit_code == OK
    text = deck.read_text(encoding="utf-8")
    assert call("check", deck).exit_code == OK
    assert call("new", deck).exit_code == BAD_INPUT
    assert deck.read_text(encoding="utf-8") == text
    assert call("new").output == text


def test_plot_draws_from_the_file_alone(finished, tmp_path):
    _, out, _ = finished
    result = call("plot", out / "small" / "result.nc", "--out", tmp_path)
    assert result.exit_code == OK
    drawn = sorted(path.name for path in tmp_path.iterdir())
    assert drawn == sorted(path.name for path in (out / "small").iterdir()
                           if path.suffix in (".png", ".pdf") or path.name == "manifest.json")
    for name in drawn:
        if name.endswith(".png"):
            assert (tmp_path / name).read_bytes() == (out / "small" / name).read_bytes()


def test_plot_refuses_what_is_no_result(tmp_path):
    other = tmp_path / "x.nc"
    other.write_text("no netCDF", encoding="utf-8")
    assert call("plot", other).exit_code == BAD_INPUT
    assert call("plot", tmp_path / "none.nc").exit_code == BAD_INPUT


def test_shipped_decks_are_good():
    result = call("check", *sorted(INPUTS.glob("*.nml")))
    assert result.exit_code == OK, result.output


def test_version_and_help():
    assert re.match(r"lapwing \d+\.\d+\.\d+ \(.*-O3", call("--version").output)
    text = call("--help").output
    for word in ("run", "check", "new", "plot", "lapwing run my_pair.nml"):
        assert word in text


def test_light_commands_import_nothing_heavy():
    """`check` and `--help` must answer at once: no engine, SciPy, xarray or matplotlib."""
    code = ("import sys; from lapwing.cli import app\n"
            "sys.argv = ['lapwing', 'check', sys.argv[1]]\n"
            "try: app()\nexcept SystemExit: pass\n"
            "heavy = {'scipy', 'xarray', 'matplotlib', 'netCDF4', 'lapwing._engine'}\n"
            "print('HEAVY', sorted(heavy & set(sys.modules)))")
    done = subprocess.run([sys.executable, "-c", code, INPUTS / "minimal.nml"],
                          capture_output=True, text=True, check=True)
    assert "HEAVY []" in done.stdout


def test_interruption_keeps_what_is_finished(tmp_path):
    """Ctrl-C during a long sweep: exit 130 within seconds, the response is in the file."""
    # Most of these torques are chaotic: no cycle comes back, every one is computed.
    deck = write_deck(tmp_path, first=0.5, count=200, settle=200_000)
    process = subprocess.Popen(
        [sys.executable, "-m", "lapwing", "run", deck, "--out", tmp_path / "r", "--threads", "1"],
        stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, env=os.environ,
        start_new_session=True)
    time.sleep(4)
    assert process.poll() is None
    process.send_signal(signal.SIGINT)
    output, _ = process.communicate(timeout=30)
    assert process.returncode == INTERRUPTED, output
    folder = tmp_path / "r" / "small"
    assert not [*folder.glob("*.png"), *folder.glob("*.pdf")]
    with read_results(folder / "result.nc") as results:
        assert tuple(results.responses) == ("one",)
        assert (results.sweep("torque").status.values == 5).any()


CRITICAL = """&critical name = 'T_full', find = 'full' /
&critical name = 'T_safe', find = 'safe', from = 8, to = 8.5, count = 2, start_phases = 1,
  start_positions = 1, start_speeds = 1, settle_cycles = 30, record_cycles = 8 /
"""


def test_critical_prints_and_writes_nothing(tmp_path):
    deck = write_deck(tmp_path)
    assert call("critical", deck).exit_code == BAD_INPUT  # no &critical in it
    deck.write_text(deck.read_text() + CRITICAL, encoding="utf-8")
    result = call("critical", deck, "--threads", 1)
    assert result.exit_code == OK, result.output
    found = re.search(r"\*\*T_full = ([0-9.]+) N·m\*\*", result.output)
    assert 0 < float(found[1]) < 8
    assert "**none between 8.5 and 8 N·m**: no motion rattles" in result.output
    assert [path.name for path in tmp_path.iterdir()] == ["small.nml"]


def test_critical_values_of_a_run(tmp_path, no_figures):
    deck = write_deck(tmp_path)
    deck.write_text(deck.read_text() + CRITICAL, encoding="utf-8")
    result = call("run", deck, "--out", tmp_path / "out", "--threads", 1)
    assert result.exit_code == OK and "T_full: contact can be kept from: T_full = " in result.output
    assert "2 critical values" in call("check", deck).output
    with read_results(tmp_path / "out" / "small" / "result.nc") as results:
        assert results.criticals == ("T_full", "T_safe")
        assert results.critical("T_safe").attrs["outcome"] == "safe_throughout"
    summary = (tmp_path / "out" / "small" / "summary.md").read_text(encoding="utf-8")
    assert summary.index("## Critical values") < summary.index("## Sweep torque")
    again = call("run", deck, "--out", tmp_path / "out", "--set", "critical.T_safe.count=3")
    assert again.exit_code == BAD_INPUT and "critical.T_safe.values" in again.output


def test_full_engagement_of_a_sweep_knows_the_driving_torque(tmp_path, no_figures):
    """With the driving torque given, less braking torque is needed than at balance."""
    deck = write_deck(tmp_path)
    found = {}
    for drive in (None, 5.0):
        given = ["--set", f"operation.drive_torque={drive}"] if drive else []
        out = tmp_path / f"out{drive}"
        assert call("run", deck, "--out", out, "--threads", 1, *given).exit_code == OK
        with read_results(out / "small" / "result.nc") as results:
            found[drive] = results.sweep("torque").attrs["full_engagement"]
            force_per_torque = results.gear_pair["force_per_torque"]
    pair = load_deck(deck).gear_pair
    assert pair.force(found[5.0], 5.0) == pytest.approx(force_per_torque * found[None], rel=1e-12)


def test_failed_motions_of_a_search_are_reported(tmp_path):
    deck = write_deck(tmp_path, events=1)
    deck.write_text(deck.read_text() + CRITICAL, encoding="utf-8")
    result = call("critical", deck, "--set", "critical.T_safe.from=1", "--threads", 1)
    assert result.exit_code == FAILED
