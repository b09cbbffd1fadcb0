"""Programs in processes of their own, born of one that has imported everything already.

For tests of what a process may suffer from or do to itself: what starting one takes is mostly
imports.  Of the command as a whole, its start among it, `subprocess` is the judge.
"""

import json
import os
import subprocess
import sys
from contextlib import suppress
from functools import cache
from importlib import import_module
from typing import NamedTuple

# What a run and its figures load on their way; xarray itself takes up Dask where that is there.
IMPORTED = ("lapwing.run", "lapwing.drawing", "lapwing.studies.of_deck", "lapwing.accessor",
            "lapwing.studies.response.study", "lapwing.studies.sweep.study",
            "lapwing.report.summary", "lapwing.report.response", "lapwing.report.sweep",
            "lapwing.plots.pool", "lapwing.plots.layout", "lapwing.plots.response.history",
            "lapwing.plots.te_curve", "lark", "xarray", "netCDF4", "scipy.interpolate",
            "scipy.optimize", "matplotlib.figure", "matplotlib.backends.backend_agg",
            "matplotlib.backends.backend_pdf", "dask.array", "distributed", "sketches", "pytest")


class Ended(NamedTuple):
    """How a program ended, -9 where signal 9 ended it, and what it said on both streams."""

    code: int
    said: str


def carried_out(program):
    """Run the text of a program as a main module, to its end."""
    server = _server()
    server.stdin.write(json.dumps(program) + "\n")
    server.stdin.flush()
    return Ended(*json.loads(server.stdout.readline()))


@cache
def _server():
    """The process all of them are born of; it ends when nobody can ask for more."""
    return subprocess.Popen([sys.executable, __file__], stdin=subprocess.PIPE,
                            stdout=subprocess.PIPE, text=True)


def _next_program():
    """Serve; comes back in each child, with its program, and with none in the end."""
    for name in IMPORTED:
        with suppress(ImportError):
            import_module(name)
    for line in sys.stdin:
        hearing, saying = os.pipe()  # a file would be under the limits that a child sets itself
        child = os.fork()
        if not child:
            for number, file in ((0, os.open(os.devnull, os.O_RDONLY)), (1, saying), (2, saying)):
                os.dup2(file, number)
            os.close(hearing)
            os.close(saying)
            return json.loads(line)
        os.close(saying)
        with open(hearing, encoding="utf-8") as pipe:
            said = pipe.read()
        code = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
        print(json.dumps([code, said]), flush=True)
    return ""


if __name__ == "__main__":
    exec(compile(_next_program(), "<program>", "exec"), {"__name__": "__main__"})
