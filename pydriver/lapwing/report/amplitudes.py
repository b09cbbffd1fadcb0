"""What a sweep says of amplitudes and mesh forces, in words."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from lapwing.base.quantities import value_words
from lapwing.results.findings import START_NAMES

if TYPE_CHECKING:
    import xarray as xr

# Of what the greatest is told: variable, words, factor, unit.
NUMBERS = (("dynamic_te_rms", "rms of the dynamic transmission error", 1e6, "µrad"),
        ("phi_rms", "rms of φ", 1e6, "µrad"),
        ("mesh_force_peak", "mesh force of spring and damper", 1.0, "N"))


def amplitude_lines(sweep: xr.Dataset, unit: str) -> list[str]:
    """Where amplitudes and forces are greatest; none where they were not asked for.

    Parameters
    ----------
    sweep : Dataset, group `sweep_<name>` of a result file
    unit : str, of the parameter

    Returns
    -------
    list of str, lines of Markdown
    """
    if "dynamic_te_rms" not in sweep:
        return []
    lines = [f"- greatest {words}: {words_of}" for name, words, factor, of in NUMBERS
             if (words_of := greatest(sweep, name, factor, of, unit))]
    return lines + [f"- mean mesh force: {span}" for span in _mean(sweep)]


def greatest(sweep: xr.Dataset, name: str, factor: float, of: str, unit: str) -> str:
    """The greatest of a number and where: '131.4 µrad at 2400 rpm (carried downwards)'.

    Empty text where none is known.
    """
    values = sweep[name].values
    if not np.isfinite(values).any():
        return ""
    start, at = np.unravel_index(np.nanargmax(values), values.shape)
    value = sweep[sweep["status"].dims[1]].values[at]
    begun = str(sweep["start"].values[start])
    return (f"{factor * values[start, at]:.4g} {of} at {value_words(value)} {unit}".rstrip()
            + f" ({START_NAMES.get(begun, begun)})")


def _mean(sweep: xr.Dataset) -> list[str]:
    values = sweep["mesh_force_mean"].values
    known = values[np.isfinite(values)]
    return [f"{known.min():.4g} to {known.max():.4g} N"] if known.size else []
