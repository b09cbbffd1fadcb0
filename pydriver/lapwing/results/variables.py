"""Datasets of studies as a file holds them: whole numbers as such, plain attributes, compressed."""

from __future__ import annotations

import math
from collections.abc import Hashable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from lapwing.base.quantities import CODES, DESCRIPTIONS, VELOCITY, worded
from lapwing.results.checksums import row_parts
from lapwing.results.schema import with_plain_text

if TYPE_CHECKING:
    import xarray as xr

# Whole numbers that the engine's tables hold as reals.
WHOLE = ("motion_state", "impacts", "back_impacts", "counted_impacts", "counted_back_impacts",
         "releases", "back_releases", "engages", "back_engages", "chatter_ends",
         "back_chatter_ends", "states_visited")
FAILED = -1
# Variables larger than this are compressed; the rest is small beside the file's own overhead.
COMPRESS_ABOVE = 1000
# Mark in the `encoding` of a variable that is read where it is used: it is written part by part.
# Its value there is the least number of it, or 0.
IN_PARTS = "in_parts"
# Numbers of it that are stored as one piece, at most: whole rows.
PIECE = 2**20


def described(dataset: xr.Dataset) -> xr.Dataset:
    """The dataset with CF attributes, whole numbers as such, attributes as netCDF can hold them.

    Parameters
    ----------
    dataset : xarray.Dataset, a response, a sweep or a part of the file

    Returns
    -------
    xarray.Dataset
        A shallow copy, `base.quantities.worded`.
    """
    dataset = dataset.assign({name: variable.fillna(FAILED).astype(np.int32)
                              for name, variable in dataset.data_vars.items()
                              if name in WHOLE and variable.dtype.kind == "f"})
    dataset.attrs = {key: _plain(value) for key, value in dataset.attrs.items()
                     if value is not None}
    return worded(dataset)


def _plain(value: Any) -> Any:
    """An attribute netCDF can hold: no bool, and nothing of Python's own."""
    if isinstance(value, bool | np.bool_):
        return np.int32(value)
    return np.int64(value) if isinstance(value, int) else value


def write_groups(path: Path, groups: dict[str | None, xr.Dataset]) -> None:
    """Write datasets into a new file, each into the group of its name; None: the root."""
    import netCDF4
    from xarray import backends

    make_store: Any = backends.NetCDF4DataStore
    # The file is opened once: each opening reads all that is in it already.
    with netCDF4.Dataset(path, "w", format="NETCDF4") as file:
        for name, dataset in groups.items():
            dataset = with_plain_text(described(dataset))
            large = [one for one, variable in dataset.variables.items()
                     if IN_PARTS in variable.encoding]
            rest, group = dataset.drop_vars(large), file if name is None else file.createGroup(name)
            rest.dump_to_store(make_store(group), encoding=_encoding(rest))
            for one in large:
                _write_in_parts(group, str(one), dataset.variables[one])


def _encoding(dataset: xr.Dataset) -> dict[Hashable, dict[str, Any]]:
    """Compress what is large; whole numbers of failed runs are missing and read as NaN.

    Text is stored as characters, not as strings, which Fortran cannot read.
    """
    encoding: dict[Hashable, dict[str, Any]] = {}
    for name, variable in dataset.variables.items():
        missing = variable.dtype.kind == "i" and bool(np.any(variable.values == FAILED))
        encoding[name] = {"_FillValue": FAILED if missing else None, **_storage(variable)}
        if variable.dtype.kind in "UO":
            encoding[name]["dtype"] = "S1"
    return encoding


def _storage(variable: xr.Variable) -> dict[str, Any]:
    """How its numbers lie in the file."""
    small = variable.size <= COMPRESS_ABOVE or variable.dtype.kind not in "fiu"
    # Level 1 takes half the time of 4 for files 5 % larger.
    packed: dict[str, Any] = {} if small else {"zlib": True, "complevel": 1, "shuffle": True}
    if variable.dims and variable.size and variable.dtype.kind in "fiu":
        packed["fletcher32"] = True
    return packed


def _write_in_parts(group: Any, name: str, variable: xr.Variable) -> None:
    """Write a variable of numbers as xarray writes it, a part of it in memory at a time."""
    for dimension, size in variable.sizes.items():
        if dimension not in group.dimensions:
            group.createDimension(dimension, size)
    missing = variable.dtype.kind == "i" and variable.encoding[IN_PARTS] <= FAILED
    rest = variable.shape[1:]
    rows = max(1, PIECE // max(1, math.prod(rest)))
    pieces = {"chunksizes": (rows, *rest)} if rows < variable.shape[0] else {}
    stored = group.createVariable(
        name, variable.dtype, variable.dims, fill_value=FAILED if missing else None, **pieces,
        **_storage(variable))
    stored.set_auto_maskandscale(False)
    stored.setncatts(variable.attrs)
    for part in row_parts(stored):
        stored[part] = variable[part].values


__all__ = ["CODES", "DESCRIPTIONS", "FAILED", "IN_PARTS", "VELOCITY", "WHOLE", "described",
           "write_groups"]
