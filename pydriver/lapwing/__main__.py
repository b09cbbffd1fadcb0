"""`python -m lapwing` and the command `lapwing`: signals are listened to before all else."""

from __future__ import annotations

import gc
import os
import sys
from typing import Any

from lapwing import console
from lapwing.base import exit_codes, signals

# New objects after which garbage is looked for. The usual 700 are few for tables by name; more of
# them would keep tables that nobody has any more.
GARBAGE = 10_000


def main() -> None:
    """Entry point: every way to end is one of `ExitCode`, and no traceback."""
    with signals.listen():
        try:
            code = _carried_out()
            signals.ignore()
        except KeyboardInterrupt:
            code = exit_codes.of_signal(signals.heard())
            signals.ignore()
    sys.exit(code)


def _carried_out() -> Any:
    """Carry out the command line and write out what it says; the exit code."""
    console.open_streams()
    # Nothing of this process is shown in a window, whatever a notebook or a matplotlibrc says.
    os.environ["MPLBACKEND"] = "agg"
    os.environ["MATPLOTLIBRC"] = os.path.join(os.path.dirname(__file__), "plots", "matplotlibrc")
    code = exit_codes.ExitCode.SURROUNDINGS
    try:
        if sys.argv[1:] == ["--version"]:  # one line, which needs no command line loaded
            print(console.version_line())
            return console.flush_streams(exit_codes.ExitCode.GOOD)
        gc.disable()  # what is loaded stays
        from lapwing.cli import called  # first: it settles how many threads numpy begins
        from lapwing.executors import hide_dask

        hide_dask()
        gc.enable()
        gc.freeze()  # nor is it looked through again
        gc.set_threshold(GARBAGE)
        signals.check()  # while modules are loaded a signal waits
        code = called()
    except KeyboardInterrupt:
        code = exit_codes.of_signal(signals.heard())
    except (OSError, MemoryError) as error:
        print(exit_codes.words(error), file=sys.stderr)
        code = exit_codes.of_error(error)
    return console.flush_streams(code)


if __name__ == "__main__":
    main()
