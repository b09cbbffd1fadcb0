"""Ranges of the parameter over which the motions of branches are stable, and what ends them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import groupby
from typing import NamedTuple

import numpy as np

from lapwing.studies.branch.run import Branch
from lapwing.studies.branch.special import Kind

# A value beyond an end, parts of the range of the parameter: what becomes of the motion there is
# looked at after `SLOWLY` mesh cycles, for close to a fold it lingers.
BEYOND, SLOWLY = 1e-6, 20_000


class End(NamedTuple):
    """An end of a range: value, by how much it may be off, kind, number of the branch (0: none)."""

    value: float
    error: float
    kind: Kind
    branch: int = 0


@dataclass(frozen=True)
class StableRange:
    """A stretch of a branch along which it is stable.

    Attributes
    ----------
    branch : int, its number, from 1
    low, high : End
    first, last : int, its points, in their order
    cycles : int, mesh cycles after which its motions repeat
    """

    branch: int
    low: End
    high: End
    first: int
    last: int
    cycles: int


def stable_ranges(branches: Sequence[Branch]) -> list[StableRange]:
    """Stretches of branches along which they are stable."""
    found = []
    for number, one in enumerate(branches, 1):
        stable = one.stable
        for is_stable, group in groupby(range(len(stable)), key=lambda k: bool(stable[k])):
            if not is_stable:
                continue
            k = list(group)
            # At a border the point before and the one beyond have no multipliers.
            low, high = sorted((_bound(one, number, k[0], (k[0] - 1, k[0] - 2)),
                                _bound(one, number, k[-1], (k[-1], k[-1] + 1))))
            values = one.values[k]
            found.append(StableRange(
                number, low._replace(value=min(low.value, float(values.min()))),
                high._replace(value=max(high.value, float(values.max()))), k[0], k[-1],
                one.cycles))
    return found


def _bound(one: Branch, number: int, point: int, positions: tuple[int, int]) -> End:
    """What ends a stretch; a mere knot only where the multipliers jump there."""
    met = [special for position in positions for at, special in
           zip(one.positions, one.specials, strict=True) if at == position]
    met.sort(key=lambda special: special.kind is Kind.KNOT)
    if met:
        return End(met[0].value, met[0].error, met[0].kind, number)
    return End(one.points[point].value, np.nan, Kind.NONE, number)
