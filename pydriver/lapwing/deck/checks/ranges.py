"""The values of a sweep from its ranges or its list."""

from __future__ import annotations

import math
from collections.abc import Iterable
from fractions import Fraction
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from lapwing.deck.load import _GroupReader
    from lapwing.deck.problems import Report

MAX_VALUES = 100_000


def range_values(reader: _GroupReader, report: Report) -> NDArray[Any] | None:
    """Values of a sweep, ascending and each once; None where the ranges make no sense."""
    keys, places = reader.keys, reader.places
    if keys.values is not None:
        for name in ("to", "count", "spacing"):
            if name in places:
                report.add(reader.key_places[name], f"{name} goes with from, not with values")
        return _ascending(map(float, keys.values))
    parts = {"from": keys.from_, "to": keys.to, "count": keys.count}
    lacking = [name for name, part in parts.items() if part is None]
    if lacking:
        report.add(places["from"], "a range needs from, to and count; lacking: "
                                   + ", ".join(lacking))
        return None
    if len({len(part) for part in parts.values()}) != 1:
        report.add(places["from"], "from, to and count are as many each: "
                   + ", ".join(f"{name} has {len(part)}" for name, part in parts.items()))
        return None
    if sum(keys.count) > MAX_VALUES:
        report.add(places["count"], f"{sum(keys.count)} values; expected at most {MAX_VALUES}")
        return None
    ranges = list(zip(*parts.values(), strict=True))
    for low, high, _ in ranges:
        if low == high or (keys.spacing == "log" and low * high <= 0):
            wanted = "both > 0 or both < 0 for spacing = 'log'" if low != high else "two ends"
            report.add(places["from"], f"from {low:g} to {high:g}: expected {wanted}")
            return None
    spaced = _log if keys.spacing == "log" else _linear
    return _ascending(value for one in ranges for value in spaced(*one))


def _ascending(values: Iterable[Any]) -> NDArray[Any]:
    """Each value once; `np.unique` would import numpy.ma, which takes 20 ms."""
    return np.array(sorted(set(values)))


def _linear(low: float, high: float, count: int) -> list[float]:
    """Equal steps between decimal numbers, each rounded once: 0.2 to 14 in 691 contains 1.8."""
    first = Fraction(repr(low))
    step = (Fraction(repr(high)) - first) / (count - 1)
    return [float(first + i * step) for i in range(count)]


def _log(low: float, high: float, count: int) -> list[float]:
    """Equal ratios; the ends exactly as given."""
    values = math.copysign(1, low) * np.geomspace(abs(low), abs(high), count)
    values[0], values[-1] = low, high
    return [float(value) for value in values]
