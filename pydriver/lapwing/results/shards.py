"""Parts of a large study, one file each, that outlive the process that made them.

A shard is written aside, flushed and renamed; it carries checksums of its variables, the hash of
the values it follows from, the engine that made it and its place in the study. It is taken as done
only where all of these agree. No lock is needed: shards are deterministic, and two processes that
make the same one at worst repeat work.
"""

from __future__ import annotations

import contextlib
import errno
import hashlib
import json
import os
import re
import threading
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from lapwing.base.quantities import DESCRIPTIONS
from lapwing.base.signals import held
from lapwing.results.checksums import CHECKSUMS, DamagedFile, store_checksums, verify_file
from lapwing.results.file import engine_digest, provenance
from lapwing.results.schema import plain_text
from lapwing.results.store import flush, os_errors

if TYPE_CHECKING:
    import netCDF4

SHARD = re.compile(r"shard-(\d{5,})\.nc$")
ASIDE = re.compile(r"\.(shard-\d{5,}|study)\.nc\.\d+\.\d+\.tmp$")
STUDY = "study.nc"
# The deck, and the marks of the processes at work.
BESIDE = re.compile(r"(used\.nml|\.used\.nml\.\d+\.tmp|\.part-\d+-of-\d+\.lock)$")
SHARD_FORMAT = 3
# Runs beyond which compression saves more than the index of compressed pieces takes.
COMPRESS_ABOVE = 2048
# The netCDF library is not made for several threads at a time.
_ONE = threading.Lock()


def inputs_digest(told: Mapping[str, Any], *arrays: NDArray[Any]) -> str:
    """SHA-256 of all values that the numbers of a shard follow from, its `inputs`.

    Parameters
    ----------
    told : name -> value, as JSON, or as text where JSON does not know it
    *arrays : taken to the bit, with dtype and shape
    """
    whole = hashlib.sha256(json.dumps(told, sort_keys=True, default=str).encode())
    for array in arrays:
        whole.update(f"{array.dtype} {array.shape}\0".encode())
        whole.update(np.ascontiguousarray(array).tobytes())
    return whole.hexdigest()


def shard_path(folder: Path, index: int) -> Path:
    """File of a shard."""
    return folder / f"shard-{index:05d}.nc"


def write_shard(folder: Path, index: int, data: Mapping[str, NDArray[Any]],
                told: Mapping[str, Any], handed: tuple[float, ...] | None = None) -> str:
    """Publish one shard.

    Parameters
    ----------
    folder : Path, made where missing
    index : int
    data : name -> array (runs, ...), the first one of all runs; or a list of its own length
    told : attributes: `inputs`, the hash of all values that the numbers follow from, and the place
        in the study
    handed : numbers that the next shard of a chain goes on from, or None

    Returns
    -------
    str
        `Shard.digest`

    Raises
    ------
    OSError
        where it cannot be written; nothing is left behind.
    """
    def fill(file: netCDF4.Dataset) -> None:
        runs = len(next(iter(data.values())))
        for name, values in data.items():
            sizes = {f"{name}_{axis}" if axis or size != runs else "run": size
                     for axis, size in enumerate(values.shape)}
            for dimension, size in sizes.items():
                if dimension not in file.dimensions:
                    file.createDimension(dimension, size)
            packed: dict[str, Any] = {} if not values.size else {"contiguous": True}
            if values.size > COMPRESS_ABOVE:
                packed = {"zlib": True, "complevel": 1, "shuffle": True}
            _put(file, name, tuple(sizes), values, **packed)

    handing = {} if handed is None else {"handed": np.array(handed, dtype=float)}
    return _publish(folder, shard_path(folder, index).name, {"index": index, **told, **handing},
                    fill)


def write_study(folder: Path, axes: Mapping[str, NDArray[Any]], told: Mapping[str, Any]) -> None:
    """Publish what the shards of a folder are parts of, unless that lies there already.

    Parameters
    ----------
    folder : Path, made where missing
    axes : parameter -> values
    told : attributes, `inputs` among them

    Raises
    ------
    OSError
        where it cannot be written; nothing is left behind.
    """
    def fill(file: netCDF4.Dataset) -> None:
        for name, values in axes.items():
            file.createDimension(name, len(values))
            _put(file, name, (name,), values, contiguous=True)

    with contextlib.suppress(OSError, ValueError):
        there = read_study(folder)[1]
        if all(there.get(key) == told[key] for key in told) \
                and there["engine_sha256"] == engine_digest():
            return
    _publish(folder, STUDY, told, fill)


def read_study(folder: Path) -> tuple[dict[str, NDArray[Any]], dict[str, Any]]:
    """What `write_study` wrote: values by axis, attributes.

    Raises
    ------
    OSError
        where there is no such file.
    DamagedFile
        (a ValueError) where it is damaged.
    """
    import netCDF4

    path = folder / STUDY
    if not path.exists():
        raise FileNotFoundError(errno.ENOENT, f"no study here ({STUDY} is missing), expected a "
                                              "folder of shards", str(folder))
    try:
        with _ONE:
            if not verify_file(path):
                raise DamagedFile(f"{path} carries no checksums")
            with netCDF4.Dataset(path) as file:
                file.set_auto_maskandscale(False)
                return ({name: np.array(one[...]) for name, one in file.variables.items()},
                        {name: file.getncattr(name) for name in file.ncattrs()})
    except DamagedFile:
        raise
    except (OSError, RuntimeError, ValueError) as error:
        raise DamagedFile(f"{path} cannot be read ({error})") from None


def _put(file: netCDF4.Dataset, name: str, dimensions: tuple[str, ...], values: NDArray[Any],
         **storage: Any) -> None:
    """Write a variable and its words."""
    units, words = DESCRIPTIONS.get(name, (None, name.replace("_", " ")))
    variable = file.createVariable(name, values.dtype, dimensions, fill_value=False, **storage)
    variable.setncatts({"long_name": words} | ({"units": units} if units else {}))
    variable[:] = values


def _publish(folder: Path, name: str, told: Mapping[str, Any],
             fill: Callable[[netCDF4.Dataset], None]) -> str:
    """Write a file aside, flush it, and let it take its place; returns `Shard.digest` of it."""
    import netCDF4

    folder.mkdir(parents=True, exist_ok=True)
    aside = folder / f".{name}.{os.getpid()}.{threading.get_ident()}.tmp"
    attributes = {"Conventions": "CF-1.11", "title": "Part of a study of Lapwing", **provenance(),
                  "shard_format": SHARD_FORMAT, **told}
    with _ONE, held(), os_errors(folder):
        try:
            with netCDF4.Dataset(aside, "w") as file:
                file.setncatts({key: plain_text(value) for key, value in attributes.items()})
                fill(file)
            found = store_checksums(aside)
            flush(aside)
            os.replace(aside, folder / name)
            flush(folder)
        finally:
            aside.unlink(missing_ok=True)
    return _digest(json.dumps(found, sort_keys=True))


def _digest(listed: str) -> str:
    return hashlib.sha256(listed.encode()).hexdigest()


class Shard(NamedTuple):
    """What is in a shard.

    Attributes
    ----------
    data : name -> array (runs,)
    cpu : str, the processor that they are from
    digest : str, SHA-256 (hex) of its checksums, by which the next one of a chain names it
    handed : what the next one goes on from, or None
    """

    data: dict[str, NDArray[Any]]
    cpu: str
    digest: str = ""
    handed: tuple[float, ...] | None = None


def read_shard(folder: Path, index: int, told: Mapping[str, Any],
               engine: str | None = None) -> tuple[Shard | None, str]:
    """A shard, or None and why it is not taken: empty text, there is none.

    Parameters
    ----------
    folder : Path
    index : int
    told : attributes that it must have, as given to `write_shard`
    engine : SHA-256 (hex) of the engine that it must be from; default: the one of this build
    """
    import netCDF4

    path = shard_path(folder, index)
    if not os.path.lexists(path):
        return None, ""
    expected = {**told, "index": index, "shard_format": SHARD_FORMAT,
                "engine_sha256": engine or engine_digest()}
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
                              for name, variable in file.variables.items()}, str(file.cpu),
                             _digest(file.getncattr(CHECKSUMS)),
                             tuple(map(float, file.getncattr("handed")))
                             if "handed" in file.ncattrs() else None), ""
        except DamagedFile as error:
            return None, str(error).removeprefix(f"{path} ")
        except (OSError, RuntimeError, ValueError) as error:
            return None, f"cannot be read ({error})"


def read_column(folder: Path, index: int, name: str) -> NDArray[Any]:
    """A variable of a shard that `read_shard` has found good, no more of it in memory.

    Raises
    ------
    DamagedFile
        (a ValueError) where the shard is no longer there, or torn.
    """
    import netCDF4

    path = shard_path(folder, index)
    try:
        with _ONE, netCDF4.Dataset(path) as file:
            file.set_auto_maskandscale(False)
            return np.array(file[name][...])
    except (OSError, RuntimeError, IndexError) as error:
        raise DamagedFile(f"{path} cannot be read any more ({error})") from None


def read_status(folder: Path, index: int, told: Mapping[str, Any]) -> NDArray[Any] | None:
    """How the runs of a shard ended, array (runs,) of `Status`; None where it is not taken.

    Of a shard that is whole and of this study: the rest of its numbers is not looked at.
    """
    found: NDArray[Any] | None = _looked_at(folder, index, told,
                                            lambda file: np.array(file["status"][...]))
    return found


def read_digest(folder: Path, index: int, told: Mapping[str, Any]) -> str | None:
    """`Shard.digest`, by which the next one of a chain names it; None as of `read_status`."""
    found: str | None = _looked_at(folder, index, told,
                                   lambda file: _digest(file.getncattr(CHECKSUMS)))
    return found


def read_told(folder: Path, index: int, *names: str) -> dict[str, Any] | None:
    """Attributes of a shard of this build, whatever it follows from; None where one is missing."""
    found: dict[str, Any] | None = _looked_at(
        folder, index, {}, lambda file: {name: file.getncattr(name) for name in names})
    return found


def _looked_at(folder: Path, index: int, told: Mapping[str, Any],
               take: Callable[[netCDF4.Dataset], Any]) -> Any:
    """What is taken from a shard that says of itself what it must; None from another, or none."""
    import netCDF4

    path = shard_path(folder, index)
    expected = {**told, "index": index, "shard_format": SHARD_FORMAT,
                "engine_sha256": engine_digest()}
    with _ONE, contextlib.suppress(OSError, RuntimeError, ValueError, AttributeError, KeyError), \
            netCDF4.Dataset(path) as file:
        file.set_auto_maskandscale(False)
        if all(str(file.getncattr(name)) == str(value) for name, value in expected.items()):
            return take(file)
    return None


_WORDS = {"inputs": "study", "engine_sha256": "build of the engine", "first": "place",
          "stop": "place", "shard_format": "version", "predecessor": "chain"}


def shards_in(folder: Path) -> list[int]:
    """Indices of the shards that lie in a folder, whatever is in them."""
    with contextlib.suppress(OSError):
        return sorted(int(found[1]) for path in folder.iterdir()
                      if (found := SHARD.match(path.name)))
    return []


def discard_studies(folder: Path) -> None:
    """`discard_shards` of every study in a folder, what lies beside them, and the empty folder."""
    with contextlib.suppress(OSError):
        for path in folder.iterdir():
            if BESIDE.match(path.name):
                path.unlink(missing_ok=True)
            else:
                discard_shards(path)
        folder.rmdir()


def discard_shards(folder: Path) -> None:
    """Remove the shards of a folder, what dead processes left of them, and the empty folder."""
    with contextlib.suppress(OSError):
        for path in folder.iterdir():
            if SHARD.match(path.name) or ASIDE.match(path.name) or path.name == STUDY:
                path.unlink(missing_ok=True)
        folder.rmdir()
