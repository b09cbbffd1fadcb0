"""How the command `lapwing` ends."""

from __future__ import annotations

import errno
from enum import IntEnum


class ExitCode(IntEnum):
    """Exit codes, each worse than the ones before: of several decks the worst one counts."""

    GOOD = 0
    FAILED = 1
    BAD_INPUT = 2
    SURROUNDINGS = 3
    STOPPED = 75
    INTERRUPTED = 130


MEANINGS = {
    ExitCode.GOOD: "good",
    ExitCode.FAILED: "some run failed numerically, a figure could not be drawn, or "
                     "parts are missing (--merge)",
    ExitCode.BAD_INPUT: "bad input",
    ExitCode.SURROUNDINGS: "the surroundings: disk, memory, permission, threads",
    ExitCode.STOPPED: "stopped by SIGTERM or SIGUSR1; run it again to continue",
    ExitCode.INTERRUPTED: "Ctrl-C",
}
# What the user named wrongly; any other error of the system is one of the surroundings.
_NAMED = (errno.ENOENT, errno.ENOTDIR, errno.EISDIR, errno.ENAMETOOLONG, errno.ELOOP)


def of_signal(signum: int | None) -> ExitCode:
    """The exit code after a signal; None: a Ctrl-C that nobody listened to."""
    from signal import SIGINT

    return ExitCode.INTERRUPTED if signum in (None, SIGINT) else ExitCode.STOPPED


def is_of_surroundings(error: BaseException) -> bool:
    """Whether an error tells of disk, memory, permission or threads, and not of the program."""
    return isinstance(error, OSError | MemoryError) or "can't start new thread" in str(error)


def of_error(error: BaseException) -> ExitCode:
    """The exit code of an error of the system."""
    code = getattr(error, "errno", None)
    if isinstance(error, OSError) and (code in _NAMED or (code or 0) < 0):  # netCDF: below 0
        return ExitCode.BAD_INPUT
    return ExitCode.SURROUNDINGS


def words(error: BaseException, path: object = None) -> str:
    """An error of the system in one line."""
    if isinstance(error, MemoryError):
        return " ".join(str(error).split()) or "out of memory"
    name = getattr(error, "filename", None) or path
    what = getattr(error, "strerror", None) or " ".join(str(error).split())
    return f"{name}: {what}" if name else what
