"""Figures drawn by several processes: the same bytes, and no figure lost with another."""

import contextlib
import os
import shutil
import signal
import subprocess
import sys

import netCDF4
import pytest
from plot_data import make_results

from lapwing import plots
from lapwing.plots.pool import DrawingPool
from lapwing.results import read_results

FORMATS = ("png", "pdf")


@pytest.fixture(scope="module")
def file(tmp_path_factory):
    folder = tmp_path_factory.mktemp("pool")
    make_results(folder, responses=("periodic", "engaged"), sweeps={}, criticals={}).close()
    return folder / "result.nc"


@pytest.fixture(scope="module", autouse=True)
def few_figures():
    """Five figures will do; a process is told what to draw."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(plots.FIGURES, "response", ("response.impact_section", "response.history"))
        yield


@pytest.fixture(scope="module")
def alone(file, tmp_path_factory):
    """All figures, drawn by this process."""
    folder = tmp_path_factory.mktemp("alone")
    with read_results(file) as results:
        return plots.draw_all(results, folder)


def same_files(ones, others):
    assert [one.name for one in ones] == [other.name for other in others]
    for one, other in zip(ones, others, strict=True):
        assert one.read_bytes() == other.read_bytes(), one.name


def test_two_processes_draw_the_same_files(file, alone, tmp_path):
    shares = []
    with read_results(file) as results, DrawingPool(2) as pool:
        written = plots.draw_all(results, tmp_path, pool=pool, progress=shares.append)
    same_files(alone, written)
    assert shares == sorted(shares) and shares[-1] == 1 and len(shares) == len(alone) / 2


def test_a_crew_of_one_is_the_caller(file, tmp_path):
    assert not DrawingPool(1)
    with DrawingPool(2) as pool:
        assert pool
        assert not pool._workers  # none before there is something to draw


@pytest.mark.parametrize("size", [1, pytest.param(2, marks=pytest.mark.full)])
def test_a_figure_that_fails_is_named_and_the_others_are_drawn(file, alone, tmp_path, size):
    damaged = tmp_path / "damaged.nc"
    shutil.copy(file, damaged)
    with netCDF4.Dataset(damaged, "a") as dataset:
        dataset["transmission_error"].renameVariable("kinks", "lost")
    with read_results(damaged, check=False) as results, DrawingPool(size) as pool:
        with pytest.raises(plots.FigureError, match=r"figure te_curve: KeyError: .*kinks") as error:
            plots.draw_all(results, tmp_path, pool=pool)
    assert set(error.value.failures) == {"te_curve"}
    same_files([one for one in alone if one.stem != "te_curve"], error.value.written)


@pytest.mark.full
def test_a_process_that_dies_takes_one_figure_with_it(file, alone, tmp_path):
    with read_results(file) as results, DrawingPool(2) as pool:
        tasks = plots.tasks_of(results)
        outcomes = pool.draw(results.path, tasks, tmp_path)
        found = dict([next(outcomes)])
        busy = next(process for process in pool._workers.values())
        os.kill(busy.pid, signal.SIGKILL)
        found |= dict(outcomes)
    assert set(found) == set(tasks)
    failed = {task.stem: problem for task, problem in found.items() if problem}
    assert len(failed) <= 1
    assert all("ended with code -9" in problem.what for problem in failed.values())
    same_files([one for one in alone if one.stem not in failed],
               [tmp_path / one.name for one in alone if one.stem not in failed])


def test_a_crew_without_processes_says_so(file, tmp_path):
    with read_results(file) as results, DrawingPool(2) as pool:
        tasks = plots.tasks_of(results)
        outcomes = pool.draw(results.path, tasks, tmp_path)
        found = dict([next(outcomes)])
        for process in pool._workers.values():
            process.kill()
        found |= dict(outcomes)
    assert set(found) == set(tasks)
    assert plots.Problem("no process is left to draw it") in found.values()


@pytest.mark.full
def test_a_script_needs_no_guard(file, tmp_path):
    """The processes do not run it again."""
    script = tmp_path / "script.py"
    script.write_text(
        "from lapwing import plots\nfrom lapwing.plots.pool import DrawingPool\n"
        "from lapwing.results import read_results\nprint('once')\n"
        "plots.FIGURES['response'] = ('response.impact_section',)\n"
        f"with read_results({str(file)!r}) as results, DrawingPool(2) as pool:\n"
        f"    plots.draw_all(results, {str(tmp_path)!r}, formats=('png',), pool=pool)\n",
        encoding="utf-8")
    done = subprocess.run([sys.executable, script], capture_output=True, text=True, check=True)
    assert (done.stdout, done.stderr) == ("once\n", "")


DRAWS = """
import sys
from lapwing import plots
from lapwing.plots import pool as pools
pools._may_fork = lambda: {forks}
from lapwing.base import signals
from lapwing.plots.pool import DrawingPool
from lapwing.results import read_results
plots.FIGURES["response"] = ("response.impact_section", "response.history")
with signals.listen():
    try:
        with read_results({file!r}) as results:
            results.transmission_error  # the file is open when the pool begins
            with DrawingPool(2) as pool:
                while True:
                    plots.draw_all(results, {folder!r}, formats=("png",), pool=pool,
                                   progress=lambda share: print(
                        *(process.pid for process in pool._workers.values()), flush=True))
    except KeyboardInterrupt:
        sys.exit(130)
"""


@pytest.fixture(params=[True, False], ids=["forked", "a_python_of_its_own"])
def drawing(request, file, tmp_path):
    """A process that draws for ever, in a group of its own, and the processes that help it."""
    code = DRAWS.format(file=str(file), folder=str(tmp_path), forks=request.param)
    process = subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE,
                               stderr=subprocess.STDOUT, text=True, start_new_session=True)
    try:
        yield process, [int(word) for word in process.stdout.readline().split()]
    finally:
        with contextlib.suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)
        process.stdout.close()
        process.wait()


@pytest.mark.skipif(os.name != "posix", reason="sends a signal to a process group")
def test_an_interruption_leaves_no_process_and_no_noise(drawing):
    """Ctrl-C reaches the whole group; only the command answers."""
    process, _ = drawing
    os.killpg(process.pid, signal.SIGTERM if ignored() else signal.SIGINT)
    # The pipe ends when the last process that holds it does.
    output = process.stdout.read()
    assert process.wait() == 130
    assert all(set(line) <= set("0123456789 ") for line in output.splitlines()), output


@pytest.mark.skipif(os.name != "posix", reason="sends a signal that no process survives")
def test_no_process_outlives_the_one_it_draws_for(drawing):
    process, workers = drawing
    os.kill(process.pid, signal.SIGKILL)
    # As above: the end of the pipe is the end of the last of them.
    process.stdout.read()
    assert len(workers) == 2


def ignored():
    """Whether this process was started in the background, and hands down that Ctrl-C is ignored."""
    return signal.getsignal(signal.SIGINT) is signal.SIG_IGN
