"""The Dataset of a sweep, its form kept for the next sweep that has the same.

To check names, dimensions and coordinates against each other takes longer than the engine takes for
a small sweep.
"""

from __future__ import annotations

from functools import lru_cache
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from lapwing.base.quantities import worded

if TYPE_CHECKING:
    import xarray as xr

# Forms kept; each holds no more than its values.
MOST_KEPT = 16


def dataset(data: dict[str, tuple[Any, NDArray[Any]]], starts: tuple[str, ...], parameter: str,
            values: NDArray[Any], attrs: dict[str, Any]) -> xr.Dataset:
    """Dataset over `start` and the parameter, its variables with units and long names.

    Parameters
    ----------
    data : name -> (dimensions, array)
    starts, values : coordinates of `start` and of the parameter
    attrs : attributes of the whole
    """
    columns = tuple((name, dims if isinstance(dims, tuple) else (dims,), array.shape, array.dtype)
                    for name, (dims, array) in data.items())
    made = _form(starts, parameter, values.tobytes(), values.dtype, columns).copy(
        data={name: array for name, (_, array) in data.items()})
    made.attrs = attrs
    return made


@lru_cache(maxsize=MOST_KEPT)
def _form(starts: tuple[str, ...], parameter: str, values: bytes, kind: np.dtype[Any],
          columns: tuple[tuple[str, tuple[str, ...], tuple[int, ...], np.dtype[Any]], ...]
          ) -> xr.Dataset:
    """The same without data: zeros that take no memory stand for them."""
    import xarray as xr

    nothing = {name: (dims, np.broadcast_to(np.zeros((), dtype), shape))
               for name, dims, shape, dtype in columns}
    return worded(xr.Dataset(nothing, {"start": list(starts),
                                       parameter: np.frombuffer(values, kind)}))
