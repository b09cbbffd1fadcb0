"""Several decks at a time: the same results as one by one, within the threads and the memory."""

import contextlib
import hashlib
import os
import queue
import select
import signal
import subprocess
import sys

import pytest

from helpers import plane_deck, plane_numbers
from lapwing.base.exit_codes import ExitCode
from lapwing.base.threads import share_of, take_share, usable_threads
from lapwing.commands import side_by_side
from lapwing.deck import load_deck
from test_cli import call, write_deck

# The command, which says when two decks have a shard each.
COMMAND = """
import sys
from pathlib import Path
from lapwing.__main__ import main
from lapwing.commands import side_by_side
out, take, said = Path(sys.argv[sys.argv.index("--out") + 1]), side_by_side._Batch._take, []

def looked(self):
    take(self)
    if not said and all(list(out.glob(f"plane{n}.shards/*/shard-*.nc")) for n in (0, 1)):
        said.append(print("begun", flush=True))

side_by_side._Batch._take = looked
main()
"""
SETTLE = 400  # a second or two of work for a map


def written(out):
    """Name of every deck's result file -> hash of its bytes."""
    return {path.parent.name: hashlib.sha256(path.read_bytes()).hexdigest()
            for path in out.glob("*/result.nc")}


@pytest.fixture(scope="module")
def decks(tmp_path_factory):
    """Three good decks, one that fails numerically and one that is no deck."""
    folder = tmp_path_factory.mktemp("decks")
    paths = [write_deck(folder, f"deck{n}.nml", torque=4 + n) for n in range(3)]
    paths += [write_deck(folder, "fails.nml", events=1), folder / "bad.nml"]
    paths[-1].write_text("&gear_pair /", encoding="utf-8")
    return paths


def one_by_one(out, *decks):
    """The same in this process; exit code and what is said."""
    done = call("run", *decks, "--threads", 1, "--out", out, "--figures", "none")
    return done.exit_code, done.stdout


@pytest.mark.full
def test_the_bytes_and_the_worst_code_are_those_of_one_by_one(decks, tmp_path):
    done = call("run", *decks, "--threads", 2, "--out", tmp_path / "together", "--figures", "none")
    code, out, err = done.exit_code, done.stdout, done.stderr
    expected, said = one_by_one(tmp_path / "one", *decks)
    assert code == expected == 2
    assert written(tmp_path / "together") == written(tmp_path / "one")
    assert len(written(tmp_path / "one")) == 4
    for name in ("deck0", "deck1", "deck2", "fails"):
        assert f"{name}: started; 1 response, 1 sweep\n" in err
        assert f"{name}: done, results in" in out
    assert "fails: sweep torque (" in err and "failed numerically" in err
    # What is said of a deck stands together.
    told = out.replace(str(tmp_path / "together"), "").splitlines()
    alone = said.replace(str(tmp_path / "one"), "").splitlines()
    assert sorted(told) == sorted(alone)
    for name in ("deck0", "deck1", "deck2"):
        at = [lines.index(f"{name}: done, results in /{name}") for lines in (told, alone)]
        assert told[at[0]:at[0] + 3] == alone[at[1]:at[1] + 3]


def long_decks(folder):
    paths = [folder / f"plane{n}.nml" for n in range(3)]
    for path in paths:
        path.write_text(plane_deck(20, SETTLE, 2), encoding="utf-8")
    return paths


def begun(decks, out):
    """Decks under way, two of them with a shard each at least; and their processes."""
    words = ["run", *map(str, decks), "--threads", "2", "--out", str(out), "--figures", "none"]
    job = subprocess.Popen([sys.executable, "-c", COMMAND, *words], stdout=subprocess.PIPE,
                           stderr=subprocess.STDOUT, text=True)
    assert "begun\n" in iter(job.stdout.readline, "")
    return job, workers(job.pid)


def workers(pid):
    rows = subprocess.run(["ps", "-eo", "pid,ppid,args"], capture_output=True, text=True,
                          check=True).stdout.splitlines()
    return [int(row.split()[0]) for row in rows
            if f" {pid} " in f" {row.split()[1]} " and "lapwing.commands.worker" in row]


def wait_for(pid):
    """Until a process has ended that may be nobody's child."""
    with contextlib.suppress(ProcessLookupError):
        process = os.pidfd_open(pid)
        select.select([process], [], [])
        os.close(process)


@pytest.mark.skipif(not os.path.isdir("/proc"), reason="looks at processes")
@pytest.mark.full
@pytest.mark.parametrize("signum", [signal.SIGTERM, signal.SIGKILL])
def test_what_ends_the_command_ends_all_and_the_same_command_goes_on(tmp_path, signum):
    out, paths = tmp_path / "out", long_decks(tmp_path)
    job, pids = begun(paths, out)
    assert len(pids) == 2
    os.kill(job.pid, signum)
    said = job.communicate()[0]
    if signum == signal.SIGTERM:
        assert job.returncode == ExitCode.STOPPED, said
        assert "plane0: stopped" in said and "plane2" not in said
    for pid in pids:  # an orphan hears that nobody listens
        wait_for(pid)
    assert one_by_one(out, *paths)[0] == 0
    assert one_by_one(tmp_path / "alone", paths[0])[0] == 0
    # The deck's name is all that they differ in.
    expected = plane_numbers(tmp_path / "alone" / "plane0" / "result.nc")
    for n in range(3):
        assert plane_numbers(out / f"plane{n}" / "result.nc") == expected


@pytest.mark.full
@pytest.mark.skipif(not os.path.isdir("/proc"), reason="looks at processes")
def test_a_process_that_dies_takes_its_deck_alone(tmp_path):
    out, paths = tmp_path / "out", long_decks(tmp_path)
    job, pids = begun(paths, out)
    os.kill(pids[0], signal.SIGKILL)
    said = job.communicate()[0]
    assert job.returncode == ExitCode.SURROUNDINGS, said
    assert said.count("its process ended by signal 9") == 1
    assert len(list(out.glob("*/result.nc"))) == 2, said


class Stub:
    """Stands in for a process: keeps what it is told."""

    made = ()

    def __init__(self, answers):
        self.deck, self.share, self.answers = None, None, answers
        type(self).made += (self,)

    def order(self, what, *facts):
        assert what == "share"
        self.share = facts[0]

    def begin(self, deck, options, progress):
        assert self.deck is None
        self.deck = deck

    def end(self):
        self.deck = None

    def close(self):
        pass


@pytest.fixture
def batch(monkeypatch, tmp_path):
    """So many decks under so many threads, with processes that do nothing."""
    Stub.made = ()
    monkeypatch.setattr(side_by_side, "Worker", Stub)

    def make(count, threads):
        decks = [load_deck(write_deck(tmp_path, f"d{n}.nml")) for n in range(count)]
        return side_by_side._Batch(decks, threads, {})
    return make


def shares(batch):
    return [worker.share for worker in Stub.made if worker.deck is not None]


def test_the_threads_are_shared_and_what_one_leaves_goes_to_the_others(batch):
    one = batch(5, 4)
    one._hand_out()
    assert shares(one) == [1, 1, 1, 1]
    for left in ([1, 1, 1, 1], [2, 1, 1], [2, 2], [4], []):
        next(worker for worker in Stub.made if worker.deck is not None).answers.put(
            (next(worker for worker in Stub.made if worker.deck is not None), ("ended", 0, [])))
        one._take()
        one._hand_out()
        assert shares(one) == left
    assert len(Stub.made) == 4
    few = batch(2, 7)
    few._hand_out()
    assert shares(few) == [4, 3]


def test_decks_that_do_not_fit_beside_others_wait(batch, monkeypatch):
    monkeypatch.setattr(side_by_side, "_bytes", lambda deck: 10)
    monkeypatch.setattr(side_by_side.estimates, "available_bytes", lambda: 5)
    one = batch(3, 4)
    one._hand_out()
    assert len(one._busy()) == 1  # alone it may try
    monkeypatch.setattr(side_by_side.estimates, "available_bytes", lambda: 10)
    one._hand_out()
    assert len(one._busy()) == 3


def test_an_answer_that_does_not_come_is_not_waited_for(batch, monkeypatch):
    monkeypatch.setattr(side_by_side, "LISTEN", 0)
    one = batch(1, 1)
    one._take()
    assert one.answers.empty() and isinstance(one.answers, queue.SimpleQueue)


def test_a_share_is_the_most_that_is_begun():
    try:
        take_share(2)
        assert (share_of(8), share_of(1), usable_threads(8, 8)) == (2, 1, 2)
        take_share(1)
        assert usable_threads(8, 8) == 1
    finally:
        take_share(None)
    assert share_of(8) == 8
