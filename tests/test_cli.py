"""The command line: what it prints, what it writes, how it ends."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
from typer.testing import CliRunner

import children
import sketches
from lapwing import plots
from lapwing.base.exit_codes import ExitCode
from lapwing.cli import BAD_INPUT, FAILED, INTERRUPTED, OK, app
from lapwing.deck import load_deck
from lapwing.report.answers.findings import findings_in, on_console
from lapwing.results import read_results

INPUTS = Path(__file__).parents[1] / "inputs"
# All that are drawn here: most of a short run's time goes into them.
FIGURES = {"response": ("response.history",), "sweep": ("sweep.deepest_separation",)}
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
    monkeypatch.setattr("lapwing.plots.Drawing", NoDrawing)


class NoDrawing:
    """In place of `lapwing.plots.Drawing`."""

    def __init__(self, *_, **__):
        pass

    def finish(self, _):
        return []


@pytest.fixture(scope="module", autouse=True)
def few_figures():
    with pytest.MonkeyPatch.context() as patch:
        for kind, figures in FIGURES.items():
            patch.setitem(plots.FIGURES, kind, figures)
        yield


@pytest.fixture(scope="module")
def finished(tmp_path_factory, few_figures):
    """One deck, run once."""
    folder = tmp_path_factory.mktemp("run")
    deck = write_deck(folder)
    result = call("run", deck, "--out", folder / "results", "--threads", 1, "--figures", "all")
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


def test_figures_are_drawn_in_the_formats_asked_for(tmp_path, monkeypatch):
    sketches.draw_two(monkeypatch)
    deck, out = write_deck(tmp_path, torque=6), tmp_path / "out"

    def formats(*words):
        result = call("run", deck, "--out", out, "--threads", 1, *words)
        assert result.exit_code == OK, result.output
        names = {path.name for path in (out / "small").iterdir()}
        assert {"result.nc", "summary.md", "used.nml", "manifest.json"} <= names
        return "reused" in result.output, {name[-3:] for name in names
                                              if name.startswith("history_")}

    assert formats("--figures", "none") == (False, set())
    before = (out / "small" / "result.nc").read_bytes()
    assert formats("--figures", "none") == (True, set())
    assert formats() == (False, {"png"})  # the default; nothing is computed again
    assert formats("--figures", "all") == (False, {"png", "pdf"})
    assert formats() == formats("--figures", "none") == (True, {"png", "pdf"})
    # What was drawn once is kept up with the rest.
    (out / "small" / "history_one.pdf").unlink()
    assert formats() == (False, {"png", "pdf"})
    assert (out / "small" / "result.nc").read_bytes() == before
    assert call("run", deck, "--out", out, "--figures", "svg").exit_code == BAD_INPUT


def test_the_findings_head_summary_and_console(finished):
    deck, out, first = finished
    summary = (out / "small" / "summary.md").read_text(encoding="utf-8")
    _, _, figure, findings = summary.splitlines()[:4]
    assert figure.startswith("Figure to look at first: [") and findings == "## Findings"
    assert (out / "small" / re.search(r"\((.*?)\)", figure)[1]).exists()
    said = on_console(findings_in(summary))
    assert "Separation was" in said or "The teeth" in said
    again = call("run", deck, "--out", out)
    for output in (first.output, again.output):
        assert f"{out / 'small'}\n{said}\n" in output


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
    assert call("check", "--no-time", out / "small" / "used.nml").exit_code == OK


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
    assert call("check", "--no-time", deck).exit_code == OK
    assert call("new", deck).exit_code == BAD_INPUT
    assert deck.read_text(encoding="utf-8") == text
    assert call("new").output == text


def test_plot_draws_from_the_file_alone(finished, tmp_path, monkeypatch):
    monkeypatch.setenv("OMP_NUM_THREADS", "1")
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
    folder = call("plot", tmp_path)
    assert folder.exit_code == BAD_INPUT
    assert "a folder, expected a result file" in " ".join(folder.output.split())


def test_shipped_decks_are_good():
    result = call("check", "--no-time", *sorted(INPUTS.glob("*.nml")))
    assert result.exit_code == OK, result.output


def test_version_and_help():
    assert re.match(r"lapwing \d+\.\d+\.\d+ \(.*-O3", call("--version").output)
    text = call("--help").output
    for word in ("run", "check", "new", "plot", "lapwing run my_pair.nml"):
        assert word in text


def test_light_commands_import_nothing_heavy():
    """`check` and `--help` must answer at once: no engine, xarray or matplotlib.

    What tells the time that a deck takes is another process, which is not begun here.
    """
    code = ("import subprocess, sys; from lapwing.cli import app\n"
            "def run(*_, **__): raise OSError\n"
            "subprocess.run = run\n"
            "sys.argv = ['lapwing', 'check', sys.argv[1]]\n"
            "try: app()\nexcept SystemExit: pass\n"
            "heavy = {'xarray', 'matplotlib', 'netCDF4', 'lapwing._engine'}\n"
            "print('HEAVY', sorted(heavy & set(sys.modules)))")
    done = subprocess.run([sys.executable, "-c", code, INPUTS / "minimal.nml"],
                          capture_output=True, text=True, check=True)
    assert "HEAVY []" in done.stdout


# A child process that sends itself a signal at a place of the code, as if from outside.
SIGNALLED = """
import importlib, os, signal, sys
os.setsid()
signal.signal(signal.SIGINT, signal.default_int_handler)
module, _, name = {where!r}.partition(":")
owner = importlib.import_module(module)
original = getattr(owner, name)

def signalled(*given, **more):
    os.kill(os.getpid(), signal.{signum})
    return original(*given, **more)

setattr(owner, name, signalled)
from lapwing import plots
from lapwing.__main__ import main
plots.FIGURES.update(response=("response.history",), sweep=())
sys.argv = ["lapwing", "run", {deck!r}, "--out", {out!r}, "--threads", "{threads}"]
main()
"""
PLACES = {"lapwing.deck:load_deck": False, "lapwing.studies.response.study:prepared": False,
          "lapwing.studies.sweep.study:sweep": True, "lapwing.results.file:store_checksums": True,
          "lapwing.plots:attempt": True, "lapwing.plots.pool:wait": True}


def signalled(tmp_path, where, signum):
    deck, out = write_deck(tmp_path), tmp_path / "r"
    threads = 2 if where == "lapwing.plots.pool:wait" else 1
    code = SIGNALLED.format(where=where, signum=signum, deck=str(deck), out=str(out),
                            threads=threads)
    ended = children.carried_out(code)
    assert "Traceback" not in ended.said, ended.said
    return deck, out, ended


EVERY_DAY = {("SIGINT", "lapwing.deck:load_deck"),
             ("SIGINT", "lapwing.studies.response.study:prepared"),
             ("SIGINT", "lapwing.plots.pool:wait"), ("SIGTERM", "lapwing.plots:attempt"),
             ("SIGUSR1", "lapwing.results.file:store_checksums")}


@pytest.mark.parametrize(("signum", "code", "where"), [
    pytest.param(signum, code, where,
                 marks=[] if (signum, where) in EVERY_DAY else pytest.mark.full)
    for signum, code in (("SIGINT", 130), ("SIGTERM", 75), ("SIGUSR1", 75)) for where in PLACES])
def test_a_signal_keeps_what_is_finished(tmp_path, where, signum, code, no_figures):
    deck, out, ended = signalled(tmp_path, where, signum)
    assert ended.code == code, ended.said
    folder = out / "small"
    assert not list(folder.glob("*.p[nd][gf]"))
    if PLACES[where]:
        assert "what is finished lies in" in ended.said
        with read_results(folder / "result.nc") as results:
            assert results.responses == ("one",)
    assert [path.name for path in out.iterdir()] == ["small"] if out.exists() else True
    if signum == "SIGUSR1":
        assert call("run", deck, "--out", out, "--threads", 1).exit_code == OK
        with read_results(folder / "result.nc") as results:
            assert results.sweeps == ("torque",) and not results.interrupted


def test_the_points_of_a_sweep_that_are_finished_are_kept(tmp_path, no_figures, monkeypatch):
    from lapwing.engine import calls

    original, made = calls.api.sweep, []

    def interrupted(*arguments):
        made.append(1)
        if len(made) == 3:
            raise KeyboardInterrupt
        return original(*arguments)

    class Api:
        sweep = staticmethod(interrupted)

        def __getattr__(self, name):
            return getattr(api, name)

    api = calls.api
    monkeypatch.setattr(calls, "api", Api())
    monkeypatch.setattr(calls, "CALL_SECONDS", 1e-4)
    deck = write_deck(tmp_path, first=0.5, count=50, settle=2000)
    result = call("run", deck, "--out", tmp_path / "r", "--threads", 1)
    assert result.exit_code == INTERRUPTED
    with read_results(tmp_path / "r" / "small" / "result.nc") as results:
        status = results.sweep("torque").status.values
        assert (status == 5).any() and results.interrupted


DRAWS_FEW = f"""
from lapwing import plots
from lapwing.__main__ import main
plots.FIGURES.update({FIGURES})
main()
"""


@pytest.mark.parametrize("setting", [
    {"MPLBACKEND": "module://matplotlib_inline.backend_inline", "PYTHONIOENCODING": "ascii"},
    pytest.param({"MPLBACKEND": "no such", "PYTHONIOENCODING": "cp1252"}, marks=pytest.mark.full),
    pytest.param({"MATPLOTLIBRC": "/dev/full", "LC_ALL": "C", "PYTHONUTF8": "0",
                  "PYTHONCOERCECLOCALE": "0"}, marks=pytest.mark.full)])
def test_the_surroundings_change_no_byte(finished, tmp_path, setting):
    deck, out, _ = finished
    done = subprocess.run(
        [sys.executable, "-c", DRAWS_FEW, "run", deck, "--out", tmp_path / "r", "--threads", "2",
         "--figures", "all"],
        capture_output=True, env=os.environ | setting, check=False)
    assert done.returncode == OK, done.stderr
    assert b"Traceback" not in done.stderr and b"Error" not in done.stderr
    for path in (out / "small").iterdir():
        assert (tmp_path / "r" / "small" / path.name).read_bytes() == path.read_bytes()


def shell(line, deck="", **setting):
    return subprocess.run(["sh", "-c", line], capture_output=True, text=True, check=False,
                          env=os.environ | setting | {"PYTHON": sys.executable, "DECK": str(deck)})


@pytest.mark.parametrize(("line", "code"), [
    ('"$PYTHON" -m lapwing check --no-time "$DECK" > /dev/full', 3),
    ('"$PYTHON" -m lapwing check --no-time "$DECK" >&-', 0),
    ('"$PYTHON" -m lapwing check --no-time "$DECK" >&- 2>&- <&-', 0),
    ('"$PYTHON" -m lapwing check nosuch.nml 2>&-', 2)])
def test_every_end_is_an_exit_code(tmp_path, line, code):
    done = shell(line, write_deck(tmp_path))
    assert done.returncode == code and "Traceback" not in done.stderr, done.stderr


@pytest.mark.parametrize("words", [
    ["nosuch"], ["run"], ["run", INPUTS / "minimal.nml", "--out", "/proc/nosuch"],
    ["run", INPUTS / "minimal.nml", "--out", "/dev/full/r"]])
def test_what_cannot_be_begun_is_bad_input(words):
    assert call(*words).exit_code == BAD_INPUT


@pytest.mark.parametrize("encoding", ["utf-8", "ascii", "cp1252"])
def test_a_printed_deck_is_utf_8_in_a_file(tmp_path, encoding):
    path = tmp_path / "new.nml"
    shell(f'"$PYTHON" -m lapwing new > {path}', PYTHONIOENCODING=encoding)
    assert load_deck(path)
    call("new", tmp_path / "other.nml")
    assert path.read_bytes() == (tmp_path / "other.nml").read_bytes()


def test_a_deck_whose_name_is_no_text_is_told(tmp_path):
    deck = write_deck(tmp_path).rename(Path(os.fsdecode(os.fsencode(tmp_path) + b"/d\xff.nml")))
    for words, code in ((["check", "--no-time"], 0), (["run", "--out", tmp_path / "r"], 2)):
        done = subprocess.run([sys.executable, "-m", "lapwing", words[0], deck, *words[1:]],
                              capture_output=True, check=False)
        assert done.returncode == code and b"Traceback" not in done.stderr, done.stderr
        assert b"d\\udcff" in done.stdout + done.stderr


@pytest.mark.parametrize("error", [MemoryError("no room for it"), OSError(28, "No space left"),
                                   RuntimeError("can't start new thread"),
                                   PermissionError(13, "Permission denied")])
def test_what_the_surroundings_refuse_stops_no_other_deck(tmp_path, no_figures, monkeypatch, error):
    from lapwing.studies import of_deck

    original = of_deck.compute

    def compute(deck, *given, **keeping):
        if deck.stem == "first":
            raise error
        return original(deck, *given, **keeping)

    monkeypatch.setattr(of_deck, "compute", compute)
    decks = [write_deck(tmp_path, f"{name}.nml") for name in ("first", "second")]
    result = call("run", *decks, "--out", tmp_path / "r", "--threads", 1)
    assert result.exit_code == ExitCode.SURROUNDINGS
    said = [line for line in result.output.splitlines() if line.startswith("first: ")]
    assert len(said) == 2 and str(error.args[-1]) in said[1]
    assert (tmp_path / "r" / "second" / "result.nc").exists()


def test_an_error_of_the_program_is_not_hidden(tmp_path, no_figures, monkeypatch):
    def broken(*_, **__):
        raise RuntimeError("a mistake")

    monkeypatch.setattr("lapwing.studies.of_deck.compute", broken)
    result = CliRunner().invoke(app, ["run", str(write_deck(tmp_path)), "--out",
                                      str(tmp_path / "r")])
    assert isinstance(result.exception, RuntimeError)


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
    head, findings = result.output.split("\n\n", 1)
    assert head.endswith("# small")
    assert re.match(r"  - Choose at least 8 N·m on the gear \([^)]*the lowest torque\s+searched",
                    findings)
    assert [path.name for path in tmp_path.iterdir()] == ["small.nml"]


def test_critical_values_of_a_run(tmp_path, no_figures):
    deck = write_deck(tmp_path)
    deck.write_text(deck.read_text() + CRITICAL, encoding="utf-8")
    result = call("run", deck, "--out", tmp_path / "out", "--threads", 1)
    assert result.exit_code == OK and "T_full: contact can be kept above T_full = " in result.output
    assert "2 critical values" in call("check", "--no-time", deck).output
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
