"""What is printed may be lost; what is computed is not, and the exit code tells."""

import os
import subprocess
import sys

import pytest

import children
from lapwing.console import Outlet
from test_cli import write_deck

# A run with one figure: drawing is most of its time.
RUN = """
import os, sys
from lapwing import plots
from lapwing.__main__ import main
os.environ["OMP_NUM_THREADS"] = "1"
plots.FIGURES.update(response=(), sweep=())
{redirected}
sys.argv = ["lapwing", "run", *{decks!r}, "--out", {out!r}]
main()
"""


def run_two(tmp_path, redirected):
    """Two decks whose lines go where they cannot; the exit code and the standard error."""
    decks = [str(write_deck(tmp_path, name, settle=0)) for name in ("a.nml", "b.nml")]
    code, said = children.carried_out(RUN.format(redirected=redirected, decks=decks,
                                                 out=str(tmp_path / "r")))
    for name in ("a", "b"):
        assert (tmp_path / "r" / name / "summary.md").exists(), said
    assert "Traceback" not in said
    return code, said


def test_a_reader_that_has_seen_enough_stops_no_deck(tmp_path):
    assert run_two(tmp_path, "hearing, saying = os.pipe(); os.dup2(saying, 1); "
                             "os.close(saying); os.close(hearing)")[0] == 0


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="has no /dev/full")
def test_a_full_disk_behind_the_output_stops_no_deck(tmp_path):
    code, said = run_two(tmp_path, "os.dup2(os.open('/dev/full', os.O_WRONLY), 1)")
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
