"""Figures drawn by several processes: the same bytes, and no figure lost with another."""

import contextlib
import os
import shutil
import signal
import subprocess
import sys
import time

import netCDF4
import pytest
from plot_data import make_results

from lapwing import plots
from lapwing.plots.crew import Crew
from lapwing.results import read_results

FORMATS = ("png", "pdf")


@pytest.fixture(scope="module")
def file(tmp_path_factory):
    folder = tmp_path_factory.mktemp("crew")
    make_results(folder, responses=("periodic", "engaged"), sweeps={}, criticals={}).close()
    return folder / "result.nc"


@pytest.fixture(scope="module", autouse=True)
def few_figures():
    """Five figures will do; a process is told what to draw."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(plots, "RESPONSE_FIGURES", ("impact_section", "history"))
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
    with read_results(file) as results, Crew(2) as crew:
        written = plots.draw_all(results, tmp_path, crew=crew, progress=shares.append)
    same_files(alone, written)
    assert shares == sorted(shares) and shares[-1] == 1 and len(shares) == len(alone) / 2


def test_a_crew_of_one_is_the_caller(file, tmp_path):
    assert not Crew(1)
    with Crew(2) as crew:
        assert crew
        assert not crew._workers  # none before there is something to draw


@pytest.mark.parametrize("size", [1, 2])
def test_a_figure_that_fails_is_named_and_the_others_are_drawn(file, alone, tmp_path, size):
    damaged = tmp_path / "damaged.nc"
    shutil.copy(file, damaged)
    with netCDF4.Dataset(damaged, "a") as dataset:
        dataset["transmission_error"].renameVariable("kinks", "lost")
    with read_results(damaged, check=False) as results, Crew(size) as crew:
        with pytest.raises(plots.FigureError, match=r"figure te_curve: KeyError: .*kinks") as error:
            plots.draw_all(results, tmp_path, crew=crew)
    assert set(error.value.failures) == {"te_curve"}
    same_files([one for one in alone if one.stem != "te_curve"], error.value.written)


def test_a_process_that_dies_takes_one_figure_with_it(file, alone, tmp_path):
    with read_results(file) as results, Crew(2) as crew:
        tasks = plots.tasks_of(results)
        outcomes = crew.draw(results.path, tasks, tmp_path, FORMATS)
        found = dict([next(outcomes)])
        busy = next(process for process in crew._workers.values())
        os.kill(busy.pid, signal.SIGKILL)
        found |= dict(outcomes)
    assert set(found) == set(tasks)
    failed = {task.stem: what for task, what in found.items() if what}
    assert len(failed) <= 1
    assert all("ended with code -9" in what for what in failed.values())
    same_files([one for one in alone if one.stem not in failed],
               [tmp_path / one.name for one in alone if one.stem not in failed])


def test_a_crew_without_processes_says_so(file, tmp_path):
    with read_results(file) as results, Crew(2) as crew:
        tasks = plots.tasks_of(results)
        outcomes = crew.draw(results.path, tasks, tmp_path, FORMATS)
        found = dict([next(outcomes)])
        for process in crew._workers.values():
            process.kill()
        found |= dict(outcomes)
    assert set(found) == set(tasks)
    assert "no process is left to draw it" in found.values()


def test_a_script_needs_no_guard(file, tmp_path):
    """The processes do not run it again."""
    script = tmp_path / "script.py"
    script.write_text(
        "from lapwing.plots import draw_all\nfrom lapwing.plots.crew import Crew\n"
        "from lapwing.results import read_results\nprint('once')\n"
        f"with read_results({str(file)!r}) as results, Crew(2) as crew:\n"
        f"    draw_all(results, {str(tmp_path)!r}, formats=('png',), crew=crew)\n",
        encoding="utf-8")
    done = subprocess.run([sys.executable, script], capture_output=True, text=True, check=True)
    assert (done.stdout, done.stderr) == ("once\n", "")


@pytest.mark.skipif(os.name != "posix", reason="sends a signal to a process group")
@pytest.mark.parametrize("delay", [0.6, 2.5])
def test_an_interruption_leaves_no_process_and_no_noise(file, tmp_path, delay):
    """Ctrl-C reaches the whole group; only the command answers."""
    process = subprocess.Popen(
        [sys.executable, "-c",
         "import sys, time\nfrom lapwing.plots.crew import Crew\nfrom lapwing import plots\n"
         "from lapwing.results import read_results\n"
         "try:\n"
         f"    with read_results({str(file)!r}) as results, Crew(2) as crew:\n"
         "        while True:\n"
         f"            plots.draw_all(results, {str(tmp_path)!r}, crew=crew)\n"
         "except KeyboardInterrupt:\n    sys.exit(130)\n"],
        stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, start_new_session=True)
    try:
        time.sleep(delay)
        os.killpg(process.pid, signal.SIGINT)
        # The pipe ends when the last process that holds it does.
        output, _ = process.communicate(timeout=60)
    finally:
        # Whatever has gone wrong: nothing goes on drawing for ever.
        with contextlib.suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)
    assert (process.returncode, output) == (130, "")
