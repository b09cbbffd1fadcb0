"""What is printed may be lost; what is computed is not, and the exit code tells."""

import os
import subprocess
import sys

import pytest

from lapwing.console import Outlet
from test_cli import write_deck

# A run with one figure: drawing is most of its time.
RUN = """
from lapwing import plots
from lapwing.__main__ import main
plots.FIGURES.update(response=(), sweep=())
main()
"""


def run_two(tmp_path, stdout):
    """Two decks whose lines go where they cannot; the exit code and the standard error."""
    decks = [write_deck(tmp_path, name, settle=0) for name in ("a.nml", "b.nml")]
    process = subprocess.Popen(
        [sys.executable, "-c", RUN, "run", *decks, "--out", tmp_path / "r"],
        stdout=stdout, stderr=subprocess.PIPE, text=True, env=os.environ | {"OMP_NUM_THREADS": "1"})
    if process.stdout:
        process.stdout.close()  # the reader has seen enough
    said = process.stderr.read()
    for name in ("a", "b"):
        assert (tmp_path / "r" / name / "summary.md").exists(), said
    assert "Traceback" not in said
    return process.wait(), said


def test_a_reader_that_has_seen_enough_stops_no_deck(tmp_path):
    assert run_two(tmp_path, subprocess.PIPE)[0] == 0


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="has no /dev/full")
def test_a_full_disk_behind_the_output_stops_no_deck(tmp_path):
    with open("/dev/full", "w") as full:
        code, said = run_two(tmp_path, full)
    assert code == 3 and said.count("standard output: No space left on device") == 1


def test_lines_arrive_at_once():
    """A log is not empty until the end: each line is there when the next one is computed."""
    reading, writing = os.pipe()
    code = ("import os, sys; from lapwing.console import open_streams; open_streams()\n"
            "print('begun \\u03bc')\nos._exit(0)")  # nothing is flushed at such an end
    subprocess.run([sys.executable, "-c", code], stdout=writing, check=True,
                   env=os.environ | {"PYTHONIOENCODING": "ascii"})
    os.close(writing)
    with open(reading, "rb") as pipe:
        assert pipe.read() == b"begun \\u03bc\n"


def test_an_outlet_is_lost_once():
    reading, writing = os.pipe()
    outlet = Outlet(writing)
    assert outlet.write(b"one") == 3 and os.read(reading, 10) == b"one" and outlet.lost is None
    os.close(reading)
    assert outlet.write(b"two") == 3
    first = outlet.lost
    assert isinstance(first, BrokenPipeError)
    assert outlet.write(b"three") == 5 and outlet.lost is first
    os.close(writing)
