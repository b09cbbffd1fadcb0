"""Datasets of sweeps and runs, their form kept for the next one that has the same.

To check names, dimensions and coordinates against each other takes longer than the engine takes for
a short run.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from lapwing.base.quantities import worded

if TYPE_CHECKING:
    import xarray as xr

# Forms kept.
MOST_KEPT = 32
# What xarray itself makes a Dataset by whose parts fit together; it is not promised to stay.
SHORT_WAY = "_construct_direct"
Columns = Mapping[str, tuple[tuple[str, ...], NDArray[Any]]]


def dataset(data: Columns, coords: Columns, attrs: dict[str, Any]) -> xr.Dataset:
    """Dataset of arrays that fit together, its variables with units and long names.

    Parameters
    ----------
    data, coords : name -> (dimensions, array), the arrays as long as each other in a dimension; a
        coordinate over the dimension of its name is an index
    attrs : attributes of the whole
    """
    import xarray as xr

    form = _form(tuple((name, dims, array.dtype) for name, (dims, array) in data.items()),
                 tuple((name, dims, array.dtype) for name, (dims, array) in coords.items()))
    variables, sizes, indexes = dict[Any, Any](), dict[Any, int](), dict[Any, Any]()
    for (name, words), (dims, array) in zip(form, (*data.values(), *coords.values()), strict=True):
        if dims == (name,):
            indexes[name] = xr.indexes.PandasIndex(array, name) if array.dtype.kind != "U" \
                else _labels(array.tobytes(), array.dtype, name)
            variables[name] = indexes[name].create_variables()[name]
            variables[name].attrs = words
        else:
            variables[name] = xr.Variable(dims, array, words, fastpath=True)
        sizes.update(zip(dims, array.shape, strict=True))
    directly = getattr(xr.Dataset, SHORT_WAY, None)
    if directly is None:
        return xr.Dataset(variables, attrs=attrs).set_coords(list(coords))
    made: xr.Dataset = directly(variables, set(coords), sizes, attrs, indexes)
    return made


@lru_cache(maxsize=MOST_KEPT)
def _form(*columns: tuple[tuple[str, tuple[str, ...], np.dtype[Any]], ...]
          ) -> list[tuple[str, dict[str, Any]]]:
    """Name and attributes of each variable; a Dataset of one value of each has been made."""
    import xarray as xr

    made = worded(xr.Dataset(*({name: (dims, np.zeros((1,) * len(dims), dtype))
                                for name, dims, dtype in part} for part in columns)))
    return [(name, made.variables[name].attrs) for part in columns for name, _, _ in part]


@lru_cache(maxsize=MOST_KEPT)
def _labels(text: bytes, kind: np.dtype[Any], name: str) -> Any:
    """Index of labels."""
    import xarray as xr

    return xr.indexes.PandasIndex(np.frombuffer(text, kind), name)
