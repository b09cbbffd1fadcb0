"""The form of the result file: its version, what older ones had otherwise, how text is stored.

2   Text is characters (NC_CHAR), also in attributes, so that netCDF-Fortran reads it.  The mesh
    cycle of a sample is `sample_cycle`; `cycle` is a dimension alone.  Impacts of a sweep are one
    list, a contiguous ragged array (CF 9.3.3) whose count is `kept_impacts`; `time` is a
    coordinate.  A sweep without claims has no variables of claims.  The first such files have no
    `flight_depth` of events: it is read as NaN, not known; and their motions without a period are
    `aperiodic`, not `no period`.
1   Impacts were padded, (start, parameter, impact); strings were NC_STRING.
0   Version 0.1: as 1, without a version, checksums and interruptions.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from lapwing.base.quantities import DESCRIPTIONS

if TYPE_CHECKING:
    import xarray as xr

SCHEMA_VERSION = 2


def as_of_today(dataset: xr.Dataset, version: int) -> xr.Dataset:
    """A group of a file of any version, in the form of today; an older one is read and closed.

    Parameters
    ----------
    dataset : xarray.Dataset, as read
    version : int, attribute `schema_version` of the file; 0 where it has none
    """
    if "event_kind" in dataset and "flight_depth" not in dataset:
        units, long_name = DESCRIPTIONS["flight_depth"]
        dataset["flight_depth"] = ("event", np.full(dataset.sizes["event"], np.nan),
                                   {"long_name": long_name, "units": units})
    if "motion_class" in dataset:
        dataset["motion_class"] = dataset["motion_class"].copy(
            data=np.vectorize(_class_of_today, otypes=[object])(dataset["motion_class"].values))
    for name in ("motion_class", "motion_class_reference"):
        if name in dataset.attrs:
            dataset.attrs[name] = _class_of_today(dataset.attrs[name])
    if version >= SCHEMA_VERSION:
        return dataset
    with dataset:
        dataset = dataset.load()
    if "cycle" in dataset.variables and dataset["cycle"].dims == ("sample",):
        dataset = dataset.rename_vars(cycle="sample_cycle").reset_coords("sample_cycle")
        dataset = dataset.set_coords(("time", "event_time"))
    if "impact_phase" in dataset and dataset["impact_phase"].ndim == 3:
        dataset = _listed(dataset)
    return dataset


def _class_of_today(text: str) -> str:
    """A motion class, as the first files spelled it or not."""
    return {"aperiodic": "no period", "aperiodic c": "no period (complete chatter)"}.get(text, text)


def _listed(dataset: xr.Dataset) -> xr.Dataset:
    """Padded impacts as one list."""
    names = ("impact_phase", "impact_velocity", "impact_flank")
    kept = np.isfinite(dataset["impact_phase"].values)
    count = kept.sum(axis=-1)
    by_point, room = dataset["status"].dims, dataset.sizes["impact"]
    columns = {name: ("impact", dataset[name].values[kept], dataset[name].attrs) for name in names}
    first = (np.cumsum(count) - count.ravel()).reshape(count.shape)
    return dataset.drop_vars(names).assign(
        columns | {"first_impact": (by_point, first), "kept_impacts": (by_point, count)}
    ).assign_attrs(max_impacts=room)


def with_plain_text(dataset: xr.Dataset) -> xr.Dataset:
    """The dataset, texts of its attributes that are not ASCII as bytes of UTF-8.

    netCDF4 writes these as NC_CHAR, and text as NC_STRING, which netCDF-Fortran cannot read; both
    are read back as text.
    """
    dataset = dataset.copy(deep=False)
    dataset.attrs = {key: plain_text(value) for key, value in dataset.attrs.items()}
    for variable in dataset.variables.values():
        variable.attrs = {key: plain_text(value) for key, value in variable.attrs.items()}
    return dataset


def plain_text(value: Any) -> Any:
    """An attribute as `with_plain_text` has it."""
    return value.encode() if isinstance(value, str) and not value.isascii() else value
