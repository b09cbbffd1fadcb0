"""How many threads are begun: what a variable says, limits of the system, life after a fork."""

import multiprocessing
import os
import subprocess
import sys
import threading
from pathlib import Path

import pytest

import lapwing
from helpers import PAIR, SHIPPED
from lapwing.base import threads

SWEEP = ("import lapwing, sys; sys.path[:0] = {tests!r}; from helpers import PAIR, SHIPPED\n"
         "print(lapwing.sweep(PAIR, SHIPPED, values=range(1, 41), starts=('rest',), settle=2,"
         " record=1, pinion_speed_rpm=300, threads={threads}).phi.values.tobytes().hex())")


@pytest.mark.parametrize(("value", "meant"), [
    ("4,3,2", 4), (" 1", 1), ("1,1", 1), ("3 ", 3), ("+2", 2), (" 5 , 2 ", 5), ("007", 7)])
@pytest.mark.parametrize("name", ["OMP_NUM_THREADS", "SLURM_CPUS_PER_TASK"])
def test_the_first_number_counts(name, value, meant, monkeypatch):
    monkeypatch.delenv("OMP_NUM_THREADS", raising=False)
    monkeypatch.setenv(name, value)
    assert threads.default_threads() == meant


@pytest.mark.parametrize("value", ["²", "٣", "", "0", "-2", "two", "2x", "1.5", "0,4", ",3", "4,x",
                                   "9" * 5000])
def test_what_is_no_number_is_passed_over(value, monkeypatch):
    monkeypatch.setenv("OMP_NUM_THREADS", value)
    monkeypatch.setenv("SLURM_CPUS_PER_TASK", "3")
    assert threads.default_threads() == 3


@pytest.mark.parametrize(("own", "others", "share"), [
    ({0, 1, 2, 3}, [{0, 1, 2, 3}], 4), ({0, 1, 2, 3}, [{0, 1, 2, 3}] * 2, 2),
    ({0, 1, 2}, [{0, 1, 2}] * 2, 1), ({0}, [{0}] * 5, 1), ({2, 3}, [{0, 1}, {2, 3}], 2),
    ({0, 1, 2, 3}, [{0, 1, 2, 3}, {2, 3}], 3), (set(range(9)), [set(range(9))] * 3, 3)])
def test_workers_share_the_processors_of_their_node(own, others, share):
    assert threads.fair_share(own, others) == share


def test_a_worker_takes_one_thread_or_its_share(monkeypatch):
    assert threads.worker_threads(5) == 1
    try:
        threads.take_share(2)
        assert threads.worker_threads(5) == 2 and threads.worker_threads(1) == 1
        monkeypatch.setitem(threads._state, "forked", True)
        assert threads.worker_threads(5) == 1
    finally:
        threads.take_share(None)


def test_a_huge_wish_is_bounded(monkeypatch):
    monkeypatch.setenv("OMP_NUM_THREADS", "100000")
    assert threads.default_threads() == threads.most_threads()
    assert threads.usable_threads(100_000, 5) <= 5
    assert threads.usable_threads(100_000, 100_000) <= threads.most_threads()


def sweep(wanted):
    return lapwing.sweep(PAIR, SHIPPED, values=range(1, 41), starts=("rest",), settle=2, record=1,
                         pinion_speed_rpm=300, threads=wanted).phi.values.tobytes()


def test_any_number_of_threads_gives_the_same():
    assert sweep(1) == sweep(2) == sweep(100_000)


LIMIT = "resource.setrlimit(resource.RLIMIT_AS, (now + (96 << 20),) * 2)"


def test_threads_that_cannot_begin_are_not_asked_for(tests_folders):
    """Each thread takes 8 MB of address space for its stack; OpenMP would end the process."""
    code = ("import resource, threading, sys, lapwing, lapwing.engine, xarray\n"
            + SWEEP.format(tests=tests_folders, threads=1).replace("print(", "one = (")
            + "\nnow = int(open('/proc/self/statm').read().split()[0]) * resource.getpagesize()\n"
            + LIMIT + "\n" + SWEEP.format(tests=tests_folders, threads=100_000).split("\n")[1]
            .replace("print(", "many = (") + "\nassert one == many; print('same')")
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True,
                          check=False, env=os.environ | {"OMP_STACKSIZE": "8M"})
    assert (done.returncode, done.stdout.strip()) == (0, "same"), done.stderr


@pytest.fixture
def tests_folders():
    return [str(Path(__file__).parent), str(Path(__file__).parents[1])]


FORKED = """
import os, sys, multiprocessing
sys.path[:0] = {tests!r}
from test_threads import sweep
from lapwing.base import threads
before = sweep(2)
"""


@pytest.mark.parametrize("way", [
    "pid = os.fork()\nif pid == 0:\n    os._exit(0 if sweep(2) == before"
    " and threads.usable_threads(8, 8) == 1 else 3)\n"
    "assert os.waitpid(pid, 0)[1] == 0",
    "with multiprocessing.get_context('fork').Pool(2) as pool:\n"
    "    assert pool.map(sweep, [2, 2]) == [before, before]"])
def test_a_process_born_by_fork_computes(way, tests_folders):
    """Its parent has used OpenMP: the child hung for ever. The limit only ends a hang."""
    done = subprocess.run([sys.executable, "-c", FORKED.format(tests=tests_folders) + way],
                          capture_output=True, text=True, check=False, timeout=300)
    assert done.returncode == 0, done.stderr


def test_a_spawned_process_is_not_taken_for_a_forked_one():
    with multiprocessing.get_context("spawn").Pool(1) as pool:
        assert pool.apply(threads.usable_threads, (2, 2)) == 2


def test_a_team_is_begun_once_and_lost_with_its_threads(monkeypatch):
    """A team that stands is not tried again; one that was let go in part is no longer known."""
    tried = []
    monkeypatch.setattr(threads, "_can_begin", lambda count: tried.append(count) or count)
    monkeypatch.setattr(threads._team, "numbers", frozenset())
    if not threads._team.now():
        pytest.skip("the system does not tell the threads of a process")
    release = threading.Event()

    def begin(count):
        for _ in range(count):
            threading.Thread(target=release.wait, daemon=True).start()

    assert threads.usable_threads(3, 8) == 3
    with threads.team_of(3):
        begin(2)
    assert threads.usable_threads(3, 8) == threads.usable_threads(2, 8) + 1 == 3
    assert tried == [2]
    with threads.team_of(4):
        begin(1)
    assert threads.usable_threads(4, 8) == 4 and tried == [2]
    with threads.team_of(2):
        pass  # who of the three is left is not known
    assert threads.usable_threads(2, 8) == 2 and tried == [2, 1]
    with threads.team_of(2):
        begin(1)
    release.set()
    for thread in threading.enumerate():
        if thread is not threading.current_thread() and thread.daemon:
            thread.join(timeout=10)
    assert threads.usable_threads(2, 8) == 2 and tried == [2, 1, 1]


def test_loading_openmp_leaves_no_variable_behind(monkeypatch):
    for name in ("OMP_WAIT_POLICY", "GOMP_SPINCOUNT"):
        monkeypatch.delenv(name, raising=False)
    with threads.short_waits():
        assert int(os.environ["GOMP_SPINCOUNT"]) > 0
    assert "GOMP_SPINCOUNT" not in os.environ
    monkeypatch.setenv("OMP_WAIT_POLICY", "active")
    with threads.short_waits():
        assert "GOMP_SPINCOUNT" not in os.environ
