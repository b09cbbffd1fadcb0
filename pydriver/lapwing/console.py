"""Standard output and error that take every character and never stop a run; the version."""

from __future__ import annotations

import contextlib
import io
import os
import sys
from typing import Any

from lapwing.base.exit_codes import ExitCode

_STREAMS = ("stdout", "stderr")


def version_line() -> str:
    """What `lapwing --version` says: the version and how the engine was built."""
    from lapwing import _build_info as build

    return f"lapwing {build.VERSION} ({build.COMPILER}, {build.FLAGS}, {build.BUILDTYPE})"


class Outlet(io.RawIOBase):
    """A descriptor that can be lost: after the first error what is written goes nowhere.

    Attributes
    ----------
    lost : OSError or None, the first error
    """

    def __init__(self, descriptor: int) -> None:
        self._descriptor = descriptor
        self.lost: OSError | None = None

    def write(self, data: Any) -> int:
        """Write what the descriptor takes."""
        if self.lost is None:
            try:
                return os.write(self._descriptor, data)
            except OSError as error:
                self.lost = error
        return len(data)

    def writable(self) -> bool:
        """Anything can be written."""
        return True

    def fileno(self) -> int:
        """The descriptor."""
        return self._descriptor

    def isatty(self) -> bool:
        """Whether somebody looks on."""
        return os.isatty(self._descriptor)


def open_streams() -> None:
    """Put outlets under `sys.stdout` and `sys.stderr`; each line is written at once.

    What no encoding of the console can show is written as an escape.  A closed descriptor would be
    given to the next file that is opened: it leads nowhere instead.
    """
    for number in range(3):
        try:
            os.fstat(number)
        except OSError:
            os.open(os.devnull, os.O_RDWR)
    for name, number in zip(_STREAMS, (1, 2), strict=True):
        stream = getattr(sys, name)
        with contextlib.suppress(OSError, ValueError, AttributeError):
            stream.flush()
        setattr(sys, name, io.TextIOWrapper(
            io.BufferedWriter(Outlet(number)), encoding=getattr(stream, "encoding", "utf-8"),
            errors="backslashreplace", line_buffering=True))


def flush_streams(code: int) -> int:
    """Write out what is waiting; the exit code, in view of what could not be written.

    A reader that has seen enough is no error; nor are lost messages, of which the code tells.
    """
    for name in _STREAMS:
        getattr(sys, name).flush()
    outlet: Any = sys.stdout.buffer
    lost: OSError | None = outlet.raw.lost
    if lost is None or isinstance(lost, BrokenPipeError):
        return code
    print(f"standard output: {lost.strerror}", file=sys.stderr, flush=True)
    return max(code, ExitCode.SURROUNDINGS)


def complain(text: str) -> None:
    """A line on standard error."""
    print(text, file=sys.stderr)
