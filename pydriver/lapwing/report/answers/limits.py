"""Limits in words: rounded to the side on which they stay true; and where something holds."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lapwing.report.numbers import DIGITS

# Bands, and motions, told one by one.
MOST = 4


def at_least(value: float, step: float = 0.0) -> str:
    """A lower limit in words, rounded up: to four digits, or to what a bracket leaves."""
    return _rounded(value, math.ceil, step)


def at_most(value: float, step: float = 0.0) -> str:
    """An upper limit in words, rounded down likewise."""
    return _rounded(value, math.floor, step)


def _rounded(value: float, towards: Callable[..., Any], step: float) -> str:
    if value == 0 or not math.isfinite(value):
        return f"{value:g}"
    places = DIGITS - 1 - math.floor(math.log10(abs(value)))
    if step > 0:
        places = math.ceil(-math.log10(step) - 1e-9)
    unit = 10.0 ** -places
    # What is a multiple of the unit but for rounding stays.
    whole = round(value / unit) if abs(value / unit - round(value / unit)) < 1e-6 \
        else towards(value / unit)
    return f"{whole * unit:.10g}"


def bands(values: NDArray[Any], flags: NDArray[Any]) -> str:
    """Runs of values at which something holds, in words: '1, 2 to 3'; of many the outermost."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], flags, [False]]).astype(int)))
    runs = [f"{values[a]:g}" if b - a == 1 else f"{values[a]:g} to {values[b - 1]:g}"
            for a, b in edges.reshape(-1, 2)]
    return ", ".join(runs if len(runs) <= MOST else [*runs[:MOST // 2], "…", *runs[-MOST // 2:]])
