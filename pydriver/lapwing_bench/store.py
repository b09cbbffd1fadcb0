"""The benchmark's result file, and what it says about the machine."""

from __future__ import annotations

import datetime
import os
import platform
from importlib.metadata import version
from pathlib import Path

from lapwing_bench.rivals import RIVALS


def provenance(command):
    """Attributes that say where and how the numbers were made.

    Parameters
    ----------
    command : str, as typed
    """
    from lapwing import _build_info as build

    packages = {rival.package: rival.installed or "not installed" for rival in RIVALS}
    return {
        "title": "Lapwing benchmark: speed against error", "Conventions": "CF-1.11",
        "command": command, "date": datetime.date.today().isoformat(),
        "machine": f"{_processor()}, {os.cpu_count()} processors, {platform.system()}",
        "engine": f"lapwing {build.VERSION}, {build.COMPILER}, {build.FLAGS}, {build.BUILDTYPE}",
        "versions": ", ".join([f"Python {platform.python_version()}",
                               f"numpy {version('numpy')}",
                               *(f"{name} {number}" for name, number in packages.items())])}


def _processor():
    """The processor's own name where the system tells it."""
    try:
        for line in Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    except OSError:
        pass
    return platform.processor() or platform.machine()


def write(path, datasets, attributes):
    """Write the datasets of `measure`, one group for each scene.

    Parameters
    ----------
    path : Path
    datasets : dict of scene name -> Dataset
    attributes : dict, of the root
    """
    import xarray as xr

    xr.Dataset(attrs=attributes).to_netcdf(path, mode="w", engine="netcdf4", format="NETCDF4")
    for name, dataset in datasets.items():
        dataset.to_netcdf(path, mode="a", group=name, engine="netcdf4")


def read(path):
    """(datasets, attributes) of a file written by `write`.

    Raises
    ------
    OSError
        no such file, or another kind of file.
    """
    import netCDF4
    import xarray as xr

    with netCDF4.Dataset(path) as file:
        names = list(file.groups)
        attributes = {key: file.getncattr(key) for key in file.ncattrs()}
    found = {}
    for name in names:
        with xr.open_dataset(path, group=name, engine="netcdf4") as dataset:
            found[name] = dataset.load()
    return found, attributes
