"""Checksums of a netCDF file by variable, so that damage is told by its place."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

# Attribute of the root that holds the checksums of everything else.
CHECKSUMS = "checksums"


class DamagedFile(ValueError):
    """A result file whose content is not what was written; the text says where."""


def checksums(path: str | Path) -> dict[str, str]:
    """SHA-256 of every variable and of the attributes of every group.

    Parameters
    ----------
    path : str or Path, of a netCDF-4 file

    Returns
    -------
    dict
        "/group/variable" -> hex, over type, shape and numbers; "/group" -> hex, over its
        attributes and those of its variables.

    Raises
    ------
    OSError, RuntimeError
        where the file, or a part of it, cannot be read.
    """
    import netCDF4

    with small_cache(), netCDF4.Dataset(path) as file:
        return _of_file(file)


def _of_file(file: Any) -> dict[str, str]:
    found = {}
    file.set_auto_maskandscale(False)
    for group in (file, *file.groups.values()):
        for name, variable in group.variables.items():
            found[f"{group.path.rstrip('/')}/{name}"] = _of_variable(variable)
        found[group.path] = _of_attributes(group)
    return found


@contextmanager
def small_cache() -> Iterator[None]:
    """Files opened meanwhile keep no more than 1 MB of a variable: what is read or written once.

    Else the library keeps up to 64 MB of each of them until the file is closed.
    """
    import netCDF4

    before = netCDF4.get_chunk_cache()
    netCDF4.set_chunk_cache(2**20)
    try:
        yield
    finally:
        netCDF4.set_chunk_cache(*before)


def store_checksums(path: str | Path) -> dict[str, str]:
    """Write the checksums of a finished file into it; returns them."""
    import netCDF4

    with small_cache(), netCDF4.Dataset(path, "a") as file:
        found = _of_file(file)
        file.setncattr(CHECKSUMS, json.dumps(found, sort_keys=True))
    return found


def verify_file(path: str | Path) -> bool:
    """Compare a file with the checksums in it.

    Returns
    -------
    bool
        False where it has none: a file of an earlier version, of which nothing is known.

    Raises
    ------
    DamagedFile
        naming every variable and group that differs.
    OSError
        where there is no such file or it is no netCDF file.
    """
    import netCDF4

    with netCDF4.Dataset(path) as file:
        try:
            names = {*file.ncattrs()}
            listed = file.getncattr(CHECKSUMS) if CHECKSUMS in names else ""
        except (RuntimeError, AttributeError) as error:  # a damaged attribute has no name
            raise DamagedFile(f"{path} is damaged: {error}") from None
        if "lapwing_version" not in names:
            raise ValueError(f"{path} is no result file of Lapwing")
        # Any attribute that version 0.1 did not have: a damaged name hides no damage.
        if not {"schema_version", CHECKSUMS, "engine_sha256", "interrupted"} & names:
            return False
    try:
        stated = json.loads(listed)
        found = checksums(path)
    except (ValueError, RuntimeError, OSError, AttributeError) as error:
        raise DamagedFile(f"{path} is damaged: {error}") from None
    wrong = sorted(name for name in {*stated, *found} if stated.get(name) != found.get(name))
    if wrong:
        raise DamagedFile(f"{path} is damaged: {', '.join(wrong)}")
    return True


def row_parts(variable: Any) -> Iterator[Any]:
    """Parts of a stored variable along its first axis, whole pieces of its storage each."""
    pieces = variable.chunking()
    if not isinstance(pieces, list):
        yield ...
        return
    for first in range(0, variable.shape[0], pieces[0]):
        yield slice(first, first + pieces[0])


def _of_variable(variable: Any) -> str:
    """Over type, shape and numbers, a part of them in memory at a time."""
    kind = getattr(variable.dtype, "kind", "O")
    whole = hashlib.sha256(f"{kind} {tuple(map(int, variable.shape))}\0".encode())
    if kind in "OU":
        values = np.asarray(np.ma.getdata(variable[...]), dtype=object)
        whole.update(json.dumps(values.tolist()).encode())
        return whole.hexdigest()
    for part in row_parts(variable):
        whole.update(np.ascontiguousarray(np.ma.getdata(variable[part])).reshape(-1).data)
    return whole.hexdigest()


def _of_attributes(group: Any) -> str:
    owners = {"": group, **group.variables}
    content = {f"{owner}:{name}": _plain(holder.getncattr(name))
               for owner, holder in owners.items() for name in holder.ncattrs()
               if (owner, name) != ("", CHECKSUMS)}
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()


def _plain(value: Any) -> Any:
    """An attribute as JSON tells it apart: numbers by their shortest exact spelling."""
    return value if isinstance(value, str) else [str(np.asarray(value).dtype),
                                                 repr(np.asarray(value).tolist())]
