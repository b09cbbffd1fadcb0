"""The right to write a folder of results: one run at a time."""

from __future__ import annotations

import contextlib
import errno
import os
import socket
from pathlib import Path
from typing import Any


class StoreError(Exception):
    """A folder that may not be written; the text says why and what to do."""


class LockedError(StoreError):
    """Another run is writing into the folder."""


class FolderLock:
    """The right to write a folder, held by one process; it dies with its holder.

    A file `.NAME.lock` beside the folder is locked by the operating system (flock). Over NFS Linux
    keeps such locks on the server, unless the mount says `local_lock`; where a file system knows no
    locks, nothing is locked, and two runs at worst do the same work twice.

    Raises
    ------
    LockedError
        where another process holds it, naming that process.
    OSError
        where the lock file cannot be made.
    """

    def __init__(self, folder: str | Path) -> None:
        folder = Path(folder)
        self.path = folder.parent / f".{folder.name}.lock"
        self._file = self._take(folder)

    def _take(self, folder: Path) -> Any:
        while True:
            file = open(self.path, "a+", encoding="utf-8")  # held until `release`
            try:
                _lock(file)
            except BlockingIOError:
                file.seek(0)
                holder = file.read().strip() or "another process"
                file.close()
                raise LockedError(f"{folder}: {holder} is writing into it; wait for its end, or "
                                  "name another folder (--out)") from None
            # The holder before may have removed the file while this one waited to open it.
            with contextlib.suppress(FileNotFoundError):
                if os.path.samestat(os.fstat(file.fileno()), os.stat(self.path)):
                    break
            file.close()
        with contextlib.suppress(OSError):  # a full disk: the lock holds without a name in it
            file.truncate(0)
            file.write(f"process {os.getpid()} on {socket.gethostname()}\n")
            file.flush()
        return file

    def release(self) -> None:
        """Give it back."""
        if not self._file.closed:
            self.path.unlink(missing_ok=True)
            with contextlib.suppress(OSError):  # its few bytes may not have found room
                self._file.close()

    def __enter__(self) -> FolderLock:
        return self

    def __exit__(self, *_: Any) -> None:
        self.release()


def _lock(file: Any) -> None:
    """Lock an open file, or raise BlockingIOError; nothing where the file system has no locks."""
    try:
        import fcntl
    except ImportError:  # pragma: no cover - Windows
        return
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        raise
    except OSError as error:
        if error.errno not in (errno.ENOLCK, errno.EOPNOTSUPP, errno.ENOSYS):
            raise
