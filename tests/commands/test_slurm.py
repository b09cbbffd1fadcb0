"""The script for Slurm, carried out by a shell with programs that stand in for Slurm's.

Against a real Slurm: tests/slurm.py.
"""

import os
import shutil
import signal
import subprocess
import sys

import pytest
from typer.testing import CliRunner

from helpers import plane_deck
from lapwing.cli import app
from lapwing.commands.slurm import seconds

STAND_IN = """#!/bin/sh
echo "$0 $*" >> "$CALLS"
[ "${0##*/}" = sbatch ] && echo "1$(grep -c sbatch "$CALLS");here"
exit 0
"""
# Stops when it is told to, as `lapwing run` does.
WORK = """#!/bin/sh
echo "work $*" >> "$CALLS"
[ -n "$CODE" ] && exit "$CODE"
trap 'exit 75' USR1
trap 'exit 75' TERM
echo ready
while :; do sleep 0.02; done
"""


@pytest.fixture
def made(tmp_path, monkeypatch):
    """A script of 5 parts in a folder with an awkward name, and what it calls."""
    folder = tmp_path / "it's 100 % ünlike"
    folder.mkdir()
    for name, text in (("sbatch", STAND_IN), ("scontrol", STAND_IN), ("work", WORK)):
        (folder / name).write_text(text, encoding="utf-8")
        (folder / name).chmod(0o755)
    (folder / "plane.nml").write_text(plane_deck(40, 800, 4), encoding="utf-8")
    monkeypatch.setattr(sys, "executable", str(folder / "work"))
    monkeypatch.chdir(folder)
    monkeypatch.setenv("PATH", f"{folder}{os.pathsep}{os.environ['PATH']}")
    monkeypatch.setenv("CALLS", str(folder / "calls"))
    (folder / "plane.sh").write_text(script("plane.nml", "--tasks", 5, "--set", "map.y_to=9.5"),
                                     encoding="utf-8")
    return folder


def script(*words):
    done = CliRunner().invoke(app, ["slurm", *map(str, words)])
    assert done.exit_code == 0, done.output
    return done.stdout


def calls(folder):
    return [line.removeprefix(f"{folder}/")
            for line in (folder / "calls").read_text(encoding="utf-8").splitlines()]


def carried_out(shell, folder, *words, task=None, code=None, told=None):
    """Exit code of the script, told a signal as soon as it works."""
    environment = {**os.environ, "SLURM_JOB_ID": "77",
                   **({"SLURM_ARRAY_TASK_ID": str(task)} if task else {}),
                   **({"CODE": str(code)} if code is not None else {})}
    with subprocess.Popen([shell, "plane.sh", *words], cwd=folder, env=environment,
                          stdout=subprocess.PIPE) as job:
        if told:
            assert job.stdout.readline() == b"ready\n"
            job.send_signal(told)
        return job.wait()


SHELLS = [shell for shell in ("dash", "bash") if shutil.which(shell)] or ["sh"]


@pytest.mark.parametrize("shell", SHELLS)
def test_it_hands_in_the_parts_and_after_any_end_of_them_their_merge(made, shell):
    assert carried_out(shell, made) == 0
    parts, merge = calls(made)
    logs = "results/plane.logs"
    assert parts == f"sbatch --parsable --output={logs}/part-%A_%a.log plane.sh"
    assert merge == (f"sbatch --parsable --output={logs}/merge-%A.log --array=0 "
                     "--dependency=afterany:11 plane.sh merge")
    assert (made / logs).is_dir()


@pytest.mark.parametrize("shell", SHELLS)
def test_a_part_and_the_merge_run_the_deck(made, shell):
    assert carried_out(shell, made, task=4, code=0) == 0
    assert carried_out(shell, made, "merge", task="0", code=1) == 1
    head = "work -m lapwing run plane.nml --out results --threads 1 --set map.y_to=9.5"
    assert calls(made) == [f"{head} --shard 4/5", f"{head} --merge"]


@pytest.mark.parametrize("shell", SHELLS)
@pytest.mark.parametrize(("told", "again"), [(signal.SIGUSR1, True), (signal.SIGTERM, False)])
def test_out_of_time_it_goes_on_later_and_cancelled_it_does_not(made, shell, told, again):
    assert carried_out(shell, made, task=4, told=told) == 75
    assert calls(made)[1:] == ["scontrol requeue 77"] * again


@pytest.mark.parametrize(("code", "again"), [(0, 0), (1, 0), (2, 0), (3, 0), (75, 1)])
def test_only_what_was_stopped_goes_on_later(made, code, again):
    assert carried_out("sh", made, task=4, code=code) == code
    assert len(calls(made)) == 1 + again


def test_what_goes_on_for_ever_is_given_up(made, monkeypatch):
    monkeypatch.setenv("SLURM_RESTART_COUNT", "100")
    assert carried_out("sh", made, task=4, code=75) == 75 and len(calls(made)) == 1


def test_its_head_says_what_was_asked_for(made):
    head = [line for line in (made / "plane.sh").read_text(encoding="utf-8").splitlines()
            if line.startswith("#SBATCH")]
    assert head == [f"#SBATCH --{one}" for one in (
        "job-name=plane", "array=1-5", "time=01:00:00", "mem=2G", "cpus-per-task=1",
        "signal=B:USR1@120", "requeue", "open-mode=append")]
    head = script("plane.nml", "--time", "1-12", "--memory", "500M", "--cpus", 8,
                  "--partition", "long,short")
    for one in ("time=1-12", "mem=500M", "cpus-per-task=8", "partition=long,short",
                "array=1-5"):  # 40 shards
        assert f"\n#SBATCH --{one}\n" in head
    assert " --threads 8 " in head


def test_there_are_no_more_parts_than_the_cluster_takes(made):
    assert "#SBATCH --array=1-40\n" in script("plane.nml")
    assert "#SBATCH --array=1-12\n" in script("plane.nml", "--max-array-size", 13)
    fine = ("--set", "map.shard_runs=1", "--set", "map.y_count=300")
    assert "#SBATCH --array=1-1000\n" in script("plane.nml", *fine)


def test_what_is_too_large_for_this_machine_may_still_be_made_in_parts(made):
    fine = ("--set", "map.x_count=30000", "--set", "map.y_count=30000",
            "--set", "map.shard_runs=1000000")
    assert "#SBATCH --array=1-900\n" in script("plane.nml", *fine)


@pytest.mark.parametrize(("words", "said"), [
    (["--time", "4"], "--time 4: expected a time limit of Slurm above 4 minutes"),
    (["--time", "x\n#SBATCH --uid=0"], "expected a time limit"),
    (["--memory", "2 GB"], "--memory 2 GB: expected a size, as 500M or 2G"),
    (["--partition", "a b"], "--partition a b: expected names"),
    (["--tasks", "1001"], "--tasks 1001: expected fewer than the 1001 of --max-array-size"),
    (["--set", "map.y_count"], "expected GROUP.KEY=VALUE")])
def test_odd_values_are_refused(made, words, said):
    done = CliRunner().invoke(app, ["slurm", "plane.nml", *words])
    assert done.exit_code == 2 and said in done.output and "#!/bin/sh" not in done.output


def test_decks_without_maps_and_bad_decks_are_refused(made):
    text = (made / "plane.nml").read_text(encoding="utf-8")
    for name, deck in (("none", text[:text.index("&map")] + "&operation brake_torque = 1 /"),
                       ("bad", text.replace("backlash", "backlush"))):
        (made / f"{name}.nml").write_text(deck, encoding="utf-8")
        done = CliRunner().invoke(app, ["slurm", f"{name}.nml"])
        assert done.exit_code == 2 and "#!/bin/sh" not in done.output and done.output


@pytest.mark.parametrize(("text", "expected"), [
    ("90", 5400), ("5:30", 330), ("1:00:00", 3600), ("2-0", 172800), ("1-2:3", 93780),
    ("1-2:3:4", 93784), ("1:2:3:4", None), ("", None), ("-1", None), ("²", None)])
def test_times_are_read_as_slurm_reads_them(text, expected):
    assert seconds(text) == expected
