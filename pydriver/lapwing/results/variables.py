"""Datasets of studies as a file holds them: whole numbers as such, plain attributes."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from lapwing.base.quantities import CODES, DESCRIPTIONS, VELOCITY, worded

if TYPE_CHECKING:
    import xarray as xr

# Whole numbers that the engine's tables hold as reals.
WHOLE = ("motion_state", "impacts", "back_impacts", "counted_impacts", "counted_back_impacts",
         "releases", "back_releases", "engages", "back_engages", "chatter_ends",
         "back_chatter_ends", "states_visited")
FAILED = -1


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


__all__ = ["CODES", "DESCRIPTIONS", "FAILED", "VELOCITY", "WHOLE", "described"]
