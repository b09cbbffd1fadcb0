"""The very beginning and the very end of the command: no signal makes a traceback of them."""

import subprocess
import sys

import pytest

from test_cli import write_deck

# A child process that sends itself a signal when a module is looked for, or at its end.
CHILD = """
import os, runpy, signal, sys
signal.signal(signal.SIGINT, signal.default_int_handler)
place = {place!r}

def send():
    os.kill(os.getpid(), signal.{signum})

class Finder:
    def find_spec(self, name, path=None, target=None):
        if name == place:
            send()

sys.meta_path.insert(0, Finder())
if place == "flush":
    from lapwing import console
    flush = console.flush_streams
    console.flush_streams = lambda code: (flush(code), send())[0]
elif place == "end":
    class Late:
        def __del__(self):
            send()
    sys.late = Late()
sys.argv = ["lapwing", "check", "--no-time", {deck!r}]
runpy.run_module("lapwing", run_name="__main__", alter_sys=True)
"""


def child(tmp_path, place, signum):
    code = CHILD.format(place=place, signum=signum, deck=str(write_deck(tmp_path)))
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert "Traceback" not in done.stderr, done.stderr
    return done


@pytest.mark.parametrize(("place", "signum", "code"), [
    ("typer", "SIGINT", 130), ("lapwing.base.estimates", "SIGTERM", 75)])
def test_a_signal_while_modules_are_loaded(tmp_path, place, signum, code):
    done = child(tmp_path, place, signum)
    assert done.returncode == code and "good" not in done.stdout, done.stderr


@pytest.mark.parametrize(("place", "code"), [("flush", 130), ("end", 0)])
def test_a_signal_when_all_is_said(tmp_path, place, code):
    """Once the exit code stands nothing changes it any more."""
    done = child(tmp_path, place, "SIGINT")
    assert done.returncode == code and "good" in done.stdout, done.stderr


def test_the_command_is_one_thread(tmp_path):
    """So the processes that draw for it can be forked."""
    code = ("import os, sys\nfrom lapwing.__main__ import main\n"
            f"sys.argv = ['lapwing', 'check', '--no-time', {str(write_deck(tmp_path))!r}]\n"
            "try:\n    main()\nexcept SystemExit:\n    print(len(os.listdir('/proc/self/task')))")
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines()[-1] == "1", done


def test_the_version_is_said_without_loading_a_command_line():
    code = ("import runpy, sys\n"
            "sys.argv = ['lapwing', '--version']\n"
            "try: runpy.run_module('lapwing', run_name='__main__', alter_sys=True)\n"
            "except SystemExit as end: print(end.code)\n"
            "print('HEAVY', sorted({'typer', 'pydantic', 'numpy', 'rich'} & set(sys.modules)))")
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    version, code, heavy = done.stdout.splitlines()
    assert version.startswith("lapwing ") and (code, heavy) == ("0", "HEAVY []")
