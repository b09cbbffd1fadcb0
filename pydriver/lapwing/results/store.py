"""Folders of results: written aside, checked, published at once, never mixed, never half there.

A store folder holds files that one run wrote, listed with size and SHA-256 in `manifest.json`, and
perhaps files of the user's, which are never written, moved or removed. A run

1. takes the folder's lock (`FolderLock`), and clears what a dead run left beside it;
2. writes into a staging folder beside it (`Staging`);
3. lists and flushes what it wrote, then exchanges the two folders in one step (`publish`).

Whatever ends a run, the folder holds the files of the run before or those of the new one. Single
files are added to a folder one by one (`add_files`); each is the old or the new one, and listed.

Nothing here knows what the files mean.
"""

from __future__ import annotations

import contextlib
import ctypes
import errno
import hashlib
import json
import os
import shutil
import socket
import sys
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

MANIFEST = "manifest.json"
# In a staging folder as long as it is not complete: nothing else in it is of any worth.
MAKING = ".making"
MANIFEST_FORMAT = 1
COMPLETE, INCOMPLETE = "complete", "incomplete"
CHUNK = 1 << 20
# renameat2(2): paths from the working folder, and both names change places in one step.
AT_FDCWD, RENAME_EXCHANGE = -100, 2


class StoreError(Exception):
    """A folder that may not be written; the text says why and what to do."""


class LockedError(StoreError):
    """Another run is writing into the folder."""


def sha256_of(path: str | Path) -> str:
    """SHA-256 (hex) of a file's content."""
    total = hashlib.sha256()
    with open(path, "rb") as file:
        while block := file.read(CHUNK):
            total.update(block)
    return total.hexdigest()


def flush(path: str | Path) -> None:
    """Have a file or the names in a folder written to the disk."""
    handle = os.open(path, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


@dataclass
class Manifest:
    """What a run wrote into a folder.

    Attributes
    ----------
    state : 'complete' or 'incomplete' (something is left to be computed or drawn)
    inputs : str, hash of the values that the files follow from
    program, engine : str, version, and SHA-256 of the compiled engine
    files : dict of name -> {"size": bytes, "sha256": hex}
    coming : like `files`, new contents on their way: as long as they are listed here, a file may
        have the old content or the new one, or not be there yet
    variables : dict of "/group/variable" -> SHA-256 of its numbers, of the result file
    replaced : list of str, names that were the program's in the folder before
    """

    state: str = COMPLETE
    inputs: str = ""
    program: str = ""
    engine: str = ""
    files: dict[str, dict] = field(default_factory=dict)
    coming: dict[str, dict] = field(default_factory=dict)
    variables: dict[str, str] = field(default_factory=dict)
    replaced: list[str] = field(default_factory=list)

    @classmethod
    def of(cls, folder: Path, **told) -> Manifest:
        """List the files of a folder, which holds nothing else."""
        files = {path.name: {"size": path.stat().st_size, "sha256": sha256_of(path)}
                 for path in sorted(folder.iterdir()) if path.name not in (MANIFEST, MAKING)}
        return cls(files=files, **told)

    @classmethod
    def read(cls, folder: str | Path) -> Manifest | None:
        """The manifest of a folder; None where there is none or it is damaged."""
        try:
            content = json.loads((Path(folder) / MANIFEST).read_text(encoding="utf-8"))
            checksum = content.pop("checksum")
            if checksum != _checksum(content) or content.pop("format") != MANIFEST_FORMAT:
                return None
            return cls(**content)
        except (OSError, ValueError, KeyError, TypeError, AttributeError):
            return None

    def own(self, folder: Path) -> set[str]:
        """Names in a folder that are the program's: what is listed, and what has come."""
        return {*self.files, *(name for name in self.coming if not self.wrong_with(folder / name))}

    def write(self, folder: Path) -> None:
        """Write it into a folder; not flushed."""
        content = {"format": MANIFEST_FORMAT, **vars(self)}
        text = json.dumps({**content, "checksum": _checksum(content)}, indent=1, sort_keys=True)
        (folder / MANIFEST).write_text(text + "\n", encoding="utf-8")

    def damaged(self, folder: str | Path) -> dict[str, str]:
        """Listed files that are not as they were written: name -> what is wrong."""
        return {name: wrong for name in self.files
                if (wrong := self.wrong_with(Path(folder) / name))}

    def wrong_with(self, path: Path) -> str:
        """What is wrong with one listed file; empty where its content is the listed one."""
        listed = [names[path.name] for names in (self.files, self.coming) if path.name in names]
        try:
            size = path.stat().st_size
            of_size = [one["sha256"] for one in listed if one["size"] == size]
            if not of_size:
                return f"{size} bytes, {listed[0]['size']} were written"
            return "" if sha256_of(path) in of_size else "its content has changed"
        except FileNotFoundError:
            return "missing"
        except OSError as error:
            return error.strerror or str(error)


def _checksum(content: dict) -> str:
    text = json.dumps(content, sort_keys=True, ensure_ascii=True)
    return hashlib.sha256(text.encode()).hexdigest()


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

    def __init__(self, folder: str | Path):
        folder = Path(folder)
        self.path = folder.parent / f".{folder.name}.lock"
        self._file = self._take(folder)

    def _take(self, folder: Path):
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

    def __exit__(self, *_) -> None:
        self.release()


def _lock(file) -> None:
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


class Staging:
    """A folder beside the results in which new ones are made; gone at the end, published or not.

    Use it in a `with` statement, under the folder's lock.

    Attributes
    ----------
    path : Path, where to write
    """

    def __init__(self, folder: str | Path):
        self.folder = Path(folder)
        self.path = staging_of(self.folder)

    def __enter__(self) -> Staging:
        recover(self.folder)
        self.path.mkdir(parents=True)
        (self.path / MAKING).touch()
        return self

    def __exit__(self, *_) -> None:
        recover(self.folder)

    def publish(self, manifest: Manifest, known: tuple[str, ...] = ()) -> tuple[str, ...]:
        """Let what was staged take the folder's place, at once.

        Parameters
        ----------
        manifest : Manifest, of the staged files
        known : names in the folder that are the program's own although no manifest lists them

        Returns
        -------
        tuple of str
            Names that could not be published: a file of the user's has this name. They are in no
            manifest.
        """
        own = _own(self.folder) | set(known)
        taken = self._taken(manifest, own)
        for name in taken:
            (self.path / name).unlink()
            del manifest.files[name]
        manifest.replaced = sorted(own - {MANIFEST})
        manifest.write(self.path)
        for path in self.path.iterdir():
            flush(path)
        if self.folder.exists():
            _bring_along(self.folder, self.path, own)
        (self.path / MAKING).unlink()
        flush(self.path)
        if self.folder.exists():
            _exchange(self.path, self.folder)
        else:
            os.rename(self.path, self.folder)
        flush(self.folder.parent)
        return taken

    def _taken(self, manifest: Manifest, own: set[str]) -> tuple[str, ...]:
        """New names that files of the user's have; one of the same content is no matter."""
        return tuple(name for name in manifest.files
                     if os.path.lexists(self.folder / name) and name not in own
                     and manifest.wrong_with(self.folder / name))


def staging_of(folder: Path) -> Path:
    """Where new files of a folder are made."""
    return folder.parent / f".{folder.name}.new"


def _own(folder: Path) -> set[str]:
    """Names in a folder that are the program's."""
    manifest = Manifest.read(folder)
    return {MANIFEST, *(manifest.own(folder) if manifest else ())}


def _bring_along(folder: Path, new: Path, own: set[str]) -> None:
    """Give the user's files a second name in the new folder, so that they never lack one.

    A folder has one name only, as a file has where the file system knows no links: these move
    after the exchange (`recover`).
    """
    for path in folder.iterdir():
        if path.name not in own and not os.path.lexists(new / path.name) \
                and (path.is_symlink() or not path.is_dir()):
            with contextlib.suppress(OSError):
                os.link(path, new / path.name, follow_symlinks=False)


def _exchange(one: Path, other: Path) -> None:
    """Let two folders change names, in one step where the system can."""
    if sys.platform == "linux":
        with contextlib.suppress(AttributeError):  # an old C library
            call = ctypes.CDLL(None, use_errno=True).renameat2
            if call(AT_FDCWD, os.fsencode(one), AT_FDCWD, os.fsencode(other),
                    RENAME_EXCHANGE) == 0:
                return
            code = ctypes.get_errno()
            if code not in (errno.EINVAL, errno.ENOSYS, errno.EOPNOTSUPP):
                raise OSError(code, os.strerror(code), str(other))
    # In between the results lie under the third name alone, from which `recover` takes them.
    third = other.parent / f".{other.name}.old"
    os.rename(other, third)
    os.rename(one, other)
    os.rename(third, one)


def recover(folder: str | Path) -> None:
    """Clear what runs that are dead left of a folder's publication; call it under the lock.

    Files that the run listed or was making go; what the user had in the folder goes back to it.

    Raises
    ------
    StoreError
        where something of the user's cannot go back: something else has its name.
    """
    folder = Path(folder)
    old, staging = folder.parent / f".{folder.name}.old", staging_of(folder)
    if old.exists():
        if folder.exists():
            os.rename(old, staging)
        else:
            os.rename(old, folder)
    if staging.exists():
        _dissolve(staging, folder)
    shutil.rmtree(folder.parent / f".{folder.name}.drawing", ignore_errors=True)
    for path in folder.glob(".result.nc.*.tmp") if folder.exists() else ():
        path.unlink(missing_ok=True)  # of versions that wrote into the folder itself


def _dissolve(staging: Path, folder: Path) -> None:
    """Remove what was staged and not published, or what was published before and replaced."""
    if (staging / MAKING).exists():
        shutil.rmtree(staging)
        return
    published = Manifest.read(folder)
    own = _own(staging) | set(published.replaced if published else ())
    for path in list(staging.iterdir()):
        theirs = folder / path.name
        if path.name in own or (os.path.lexists(theirs) and not path.is_dir()
                                and os.path.samestat(path.lstat(), theirs.lstat())):
            path.unlink()
        elif os.path.lexists(theirs):
            raise StoreError(f"{path}: cannot go back to {folder}, where something else has its "
                             "name; move it by hand")
        else:
            os.rename(path, theirs)
    staging.rmdir()


def add_files(folder: str | Path, made: Path, known: tuple[str, ...] = ()) -> tuple[str, ...]:
    """Publish files one by one into a folder, and list them in its manifest.

    1. List the new contents beside the old ones: whatever is there from now on is vouched for.
    2. Let each file take its place.
    3. List the new contents alone.

    Parameters
    ----------
    folder : str or Path; made where missing
    made : Path, folder of the new files, on the same file system; emptied
    known : names in the folder that are the program's own although no manifest lists them

    Returns
    -------
    tuple of str
        Names that are not published: a file of the user's has this name.
    """
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    manifest, new = Manifest.read(folder) or Manifest(), Manifest.of(made)
    own = {MANIFEST, *known, *manifest.own(folder)}
    taken = tuple(name for name in new.files if name not in own
                  and os.path.lexists(folder / name) and new.wrong_with(folder / name))
    for name in taken:
        (made / name).unlink()
        del new.files[name]
    for name in new.files:
        flush(made / name)
    manifest.coming |= new.files
    _list(manifest, made, folder)
    for name in new.files:
        os.replace(made / name, folder / name)
    flush(folder)
    manifest.files |= new.files
    manifest.coming = {name: one for name, one in manifest.coming.items() if name not in new.files}
    _list(manifest, made, folder)
    return taken


def _list(manifest: Manifest, made: Path, folder: Path) -> None:
    """Let a manifest, made elsewhere on the same file system, take its place in a folder."""
    manifest.write(made)
    flush(made / MANIFEST)
    os.replace(made / MANIFEST, folder / MANIFEST)
    flush(folder)


def discard(folder: str | Path) -> None:
    """Remove what a folder's manifest lists, and the folder itself if nothing else is in it."""
    folder = Path(folder)
    if Manifest.read(folder) is None:
        return
    for name in sorted(_own(folder)):
        (folder / name).unlink(missing_ok=True)
    with contextlib.suppress(OSError):
        folder.rmdir()


def probe(folder: Path) -> None:
    """Write a little into a folder, and remove it; OSError with the system's reason if it fails."""
    path = folder / f".probe.{os.getpid()}"
    try:
        with open(path, "wb") as file:
            file.write(bytes(CHUNK))
            file.flush()
            os.fsync(file.fileno())
    except OSError as error:
        raise OSError(error.errno, error.strerror, str(folder)) from None
    finally:
        with contextlib.suppress(OSError):
            path.unlink(missing_ok=True)


@contextlib.contextmanager
def os_errors(folder: Path) -> Iterator[None]:
    """Name the system's reason where a library says only that writing failed.

    Raises
    ------
    OSError
        with the reason that `probe` finds, else with the library's words.
    """
    try:
        yield
    except (RuntimeError, OSError) as error:
        probe(folder)
        if isinstance(error, OSError) and (error.errno or 0) > 0:
            raise
        raise OSError(errno.EIO, str(error), str(folder)) from error


__all__ = ["COMPLETE", "INCOMPLETE", "MANIFEST", "FolderLock", "LockedError", "Manifest",
           "Staging", "StoreError", "add_files", "discard", "flush", "os_errors", "probe",
           "recover", "sha256_of", "staging_of"]
