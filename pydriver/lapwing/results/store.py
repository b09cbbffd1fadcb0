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
import os
import shutil
import sys
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

from lapwing.results.lock import FolderLock, LockedError, StoreError
from lapwing.results.manifest import (
    CHUNK,
    COMPLETE,
    INCOMPLETE,
    MAKING,
    MANIFEST,
    Manifest,
    flush,
    sha256_of,
)

# renameat2(2): paths from the working folder, and both names change places in one step.
AT_FDCWD, RENAME_EXCHANGE = -100, 2


class Staging:
    """A folder beside the results in which new ones are made; gone at the end, published or not.

    Use it in a `with` statement, under the folder's lock.

    Attributes
    ----------
    path : Path, where to write
    """

    def __init__(self, folder: str | Path) -> None:
        self.folder = Path(folder)
        self.path = staging_of(self.folder)

    def __enter__(self) -> Staging:
        recover(self.folder)
        self.path.mkdir(parents=True)
        (self.path / MAKING).touch()
        return self

    def __exit__(self, *_: Any) -> None:
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


def add_files(folder: str | Path, made: Path, known: tuple[str, ...] = (),
              figures: Iterable[str] = ()) -> tuple[str, ...]:
    """Publish files one by one into a folder, and list them in its manifest.

    1. List the new contents beside the old ones: whatever is there from now on is vouched for.
    2. Let each file take its place.
    3. List the new contents alone.

    Parameters
    ----------
    folder : str or Path; made where missing
    made : Path, folder of the new files, on the same file system; emptied
    known : names in the folder that are the program's own although no manifest lists them
    figures : words to add to those of the manifest

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
    manifest.figures = sorted({*(manifest.figures or ()), *figures})
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
