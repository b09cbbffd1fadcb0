"""Parts of a large study, one file each, that outlive the process that made them.

A shard is written aside, flushed and renamed; it carries checksums of its variables, the hash of
the values it follows from, the engine that made it and its place in the study. It is taken as done
only where all of these agree. No lock is needed: shards are deterministic, and two processes that
make the same one at worst repeat work.
"""

from __future__ import annotations

import contextlib
import os
import re
import threading
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from lapwing.base.signals import held
from lapwing.results.checksums import DamagedFile, store_checksums, verify_file
from lapwing.results.file import engine_digest, provenance
from lapwing.results.store import flush, os_errors

SHARD = re.compile(r"shard-(\d{5,})\.nc$")
ASIDE = re.compile(r"\.shard-\d{5,}\.nc\.\d+\.\d+\.tmp$")
SHARD_FORMAT = 1
# The netCDF library is not made for several threads at a time.
_ONE = threading.Lock()


def shard_path(folder: Path, index: int) -> Path:
    """File of a shard."""
    return folder / f"shard-{index:05d}.nc"


def write_shard(folder: Path, index: int, data: Mapping[str, NDArray[Any]],
                told: Mapping[str, Any]) -> None:
    """Publish one shard.

    Parameters
    ----------
    folder : Path, made where missing
    index : int
    data : name -> array (runs,)
    told : attributes: `inputs`, the hash of all values that the numbers follow from, and the place
        in the study

    Raises
    ------
    OSError
        where it cannot be written; nothing is left behind.
    """
    import xarray as xr

    folder.mkdir(parents=True, exist_ok=True)
    path = shard_path(folder, index)
    aside = folder / f".{path.name}.{os.getpid()}.{threading.get_ident()}.tmp"
    dataset = xr.Dataset({name: ("run", values) for name, values in data.items()}, attrs={
        "title": "Part of a study of Lapwing", **provenance(), "shard_format": SHARD_FORMAT,
        "index": index, **told})
    encoding = {name: {"zlib": True, "complevel": 1, "shuffle": True, "fletcher32": True}
                for name in data}
    with _ONE, held(), os_errors(folder):
        try:
            dataset.to_netcdf(aside, engine="netcdf4", format="NETCDF4", encoding=encoding)
            store_checksums(aside)
            flush(aside)
            os.replace(aside, path)
            flush(folder)
        finally:
            aside.unlink(missing_ok=True)


class Shard(NamedTuple):
    """The numbers of a shard, name -> array (runs,), and the processor they are from."""

    data: dict[str, NDArray[Any]]
    cpu: str


def read_shard(folder: Path, index: int,
               told: Mapping[str, Any]) -> tuple[Shard | None, str]:
    """A shard, or None and why it is not taken: empty text, there is none.

    Parameters
    ----------
    folder : Path
    index : int
    told : attributes that it must have, as given to `write_shard`
    """
    import netCDF4

    path = shard_path(folder, index)
    if not os.path.lexists(path):
        return None, ""
    expected = {**told, "index": index, "shard_format": SHARD_FORMAT,
                "engine_sha256": engine_digest()}
    with _ONE:
        try:
            if not verify_file(path):
                return None, "carries no checksums"
            with netCDF4.Dataset(path) as file:
                file.set_auto_maskandscale(False)
                for name, value in expected.items():
                    found = file.getncattr(name) if name in file.ncattrs() else None
                    if found is None or str(found) != str(value):
                        return None, f"is of another {_WORDS.get(name, name)}"
                return Shard({name: np.array(variable[...])
                              for name, variable in file.variables.items()}, str(file.cpu)), ""
        except DamagedFile as error:
            return None, str(error).removeprefix(f"{path} ")
        except (OSError, RuntimeError, ValueError) as error:
            return None, f"cannot be read ({error})"


_WORDS = {"inputs": "study", "engine_sha256": "build of the engine", "first": "place",
          "stop": "place", "shard_format": "version"}


def shards_in(folder: Path) -> list[int]:
    """Indices of the shards that lie in a folder, whatever is in them."""
    with contextlib.suppress(OSError):
        return sorted(int(found[1]) for path in folder.iterdir()
                      if (found := SHARD.match(path.name)))
    return []


def discard_studies(folder: Path) -> None:
    """`discard_shards` of every study in a folder, and the empty folder."""
    with contextlib.suppress(OSError):
        for path in folder.iterdir():
            discard_shards(path)
        folder.rmdir()


def discard_shards(folder: Path) -> None:
    """Remove the shards of a folder, what dead processes left of them, and the empty folder."""
    with contextlib.suppress(OSError):
        for path in folder.iterdir():
            if SHARD.match(path.name) or ASIDE.match(path.name):
                path.unlink(missing_ok=True)
        folder.rmdir()
