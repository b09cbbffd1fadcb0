"""The Dataset of a sweep, its form kept for the next sweep that has the same.

To check names, dimensions and coordinates against each other, and to make an index, takes longer
than the engine takes for a small sweep.
"""

from __future__ import annotations

from functools import lru_cache
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from lapwing.base.quantities import worded

if TYPE_CHECKING:
    import xarray as xr

# Forms and coordinates kept.
MOST_KEPT = 16
# What xarray itself makes a Dataset by whose parts fit together; it is not promised to stay.
SHORT_WAY = "_construct_direct"


def dataset(data: dict[str, tuple[Any, NDArray[Any]]], starts: tuple[str, ...], parameter: str,
            values: NDArray[Any], attrs: dict[str, Any]) -> xr.Dataset:
    """Dataset over `start` and the parameter, its variables with units and long names.

    Parameters
    ----------
    data : name -> (dimensions, array)
    starts, values : coordinates of `start` and of the parameter
    attrs : attributes of the whole
    """
    import xarray as xr

    columns = tuple((name, dims if isinstance(dims, tuple) else (dims,), array.shape, array.dtype)
                    for name, (dims, array) in data.items())
    form, coords = _form(columns), _coords(starts, parameter, values.tobytes(), values.dtype)
    variables = {name: xr.Variable(one.dims, data[str(name)][1], one.attrs, fastpath=True)
                 for name, one in form.variables.items()}
    variables |= {name: one.copy(deep=False) for name, one in coords.variables.items()}
    directly = getattr(xr.Dataset, SHORT_WAY, None)
    if directly is None:
        return xr.Dataset(variables, attrs=attrs)
    made: xr.Dataset = directly(variables, set(coords.variables), {**coords.sizes, **form.sizes},
                                attrs, dict(coords.xindexes))
    return made


@lru_cache(maxsize=MOST_KEPT)
def _form(columns: tuple[tuple[str, tuple[str, ...], tuple[int, ...], np.dtype[Any]], ...]
          ) -> xr.Dataset:
    """Variables without data: zeros that take no memory stand for them."""
    import xarray as xr

    return worded(xr.Dataset({name: (dims, np.broadcast_to(np.zeros((), dtype), shape))
                              for name, dims, shape, dtype in columns}))


@lru_cache(maxsize=MOST_KEPT)
def _coords(starts: tuple[str, ...], parameter: str, values: bytes,
            kind: np.dtype[Any]) -> xr.Dataset:
    """Coordinates alone."""
    import xarray as xr

    return worded(xr.Dataset(coords={"start": list(starts),
                                     parameter: np.frombuffer(values, kind)}))
