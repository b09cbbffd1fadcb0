"""What made a result file: program, compiler, processor, libraries."""

from __future__ import annotations

import platform

import numpy as np

from lapwing.results.store import sha256_of


def provenance() -> dict[str, str]:
    """What made the file: program, compiler, processor, libraries."""
    import netCDF4
    import xarray

    from lapwing import _build_info as build

    return {"lapwing_version": build.VERSION, "compiler": build.COMPILER,
            "build_flags": build.FLAGS, "build_type": build.BUILDTYPE, "cpu": processor(),
            "engine_sha256": engine_digest(),
            "python_version": platform.python_version(), "numpy_version": np.__version__,
            "xarray_version": xarray.__version__, "netcdf4_version": netCDF4.__version__}


def engine_digest() -> str:
    """SHA-256 (hex) of the compiled engine: only the same engine is sure to give the same bits."""
    from importlib.util import find_spec

    found = find_spec("lapwing._engine")
    assert found is not None and found.origin is not None
    return sha256_of(found.origin)


def processor() -> str:
    """Model of the processor, as far as the system tells."""
    try:
        with open("/proc/cpuinfo", encoding="utf-8", errors="replace") as file:
            for line in file:
                if line.lower().startswith("model name"):
                    return line.partition(":")[2].strip()
    except OSError:
        pass
    return platform.processor() or platform.machine()
