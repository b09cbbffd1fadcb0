"""Branches as a table: points, special points, and the ranges over which motions are stable."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import groupby
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from lapwing.base import quantities
from lapwing.studies.branch.motion.layout import Happening
from lapwing.studies.branch.motion.witness import states_at
from lapwing.studies.branch.run import Branch
from lapwing.studies.branch.seeds import Found
from lapwing.studies.branch.special import Kind, Point

if TYPE_CHECKING:
    import xarray as xr


# Columns in the unit of the parameter.
VALUES = {"value": "of each point", "special_value": "of each special point",
          "special_error": "by how much that of a special point may be off",
          "range_low": "lower end of each stable range",
          "range_high": "upper end of each stable range",
          "seed_value": "at which motions were looked at"}


def table(found: Sequence[Branch], parameter: str, low: float, high: float,
          values: NDArray[Any], looked: Found) -> xr.Dataset:
    """A bifurcation diagram.

    Parameters
    ----------
    found : sequence of Branch, numbered from 1
    parameter : str, its name
    low, high : float, range
    values : array (n,), at which motions were looked at
    looked : Found, what they were

    Returns
    -------
    xarray.Dataset over
        `point`: the parameter, branch, cycles, stable, rank, arrivals at either flank;
        `multiplier` besides: multiplier_real and multiplier_imag;
        `strobe`: strobe_point, phi and phi_dot at phase 0 of each mesh cycle of a point;
        `special`: special_value, its error, branch, kind, outcome, flank, phase, φ at phase 0;
        `stable_range`: range_low and range_high, the kind of special point at either end, branch.
        `seed`: seed_value, and of the motions looked at there how many in all (seed_motions), in
        contact throughout (seed_engaged), without a period (seed_aperiodic), failed (seed_failed).
        Kinds and outcomes are `branch.Kind` and `branch.Outcome`.
    """
    import xarray as xr

    points = [(k + 1, point) for k, one in enumerate(found) for point in one.points]
    specials = [(k + 1, one, special) for k, one in enumerate(found) for special in one.specials]
    ranges = [row for k, one in enumerate(found) for row in _ranges(k + 1, one)]
    strobes = [_strobes(found[number - 1], point) for number, point in points]
    multipliers = np.array([point.multipliers for _, point in points]).reshape(-1, 2)
    data: dict[str, Any] = {
        "value": ("point", [point.value for _, point in points]),
        "branch": ("point", _whole(number for number, _ in points)),
        "cycles": ("point", _whole(point.place.layout.cycles for _, point in points)),
        "stable": ("point", _whole(point.stable for _, point in points)),
        "rank": ("point", _whole(point.rank for _, point in points)),
        "arrivals": ("point", _whole(_arrivals(point, 1) for _, point in points)),
        "back_arrivals": ("point", _whole(_arrivals(point, 2) for _, point in points)),
        "multiplier_real": (("point", "multiplier"), multipliers.real),
        "multiplier_imag": (("point", "multiplier"), multipliers.imag),
        "strobe_point": ("strobe", np.repeat(np.arange(len(points)),
                                             [one.shape[1] for one in strobes]).astype(int)),
        "phi": ("strobe", np.concatenate([*(one[0] for one in strobes), np.empty(0)])),
        "phi_dot": ("strobe", np.concatenate([*(one[1] for one in strobes), np.empty(0)]))}
    data |= {f"special_{name}": ("special", np.array([get(one) for _, _, one in specials],
                                                     dtype=kind))
             for name, get, kind in (
                 ("value", lambda one: one.value, float), ("error", lambda one: one.error, float),
                 ("kind", lambda one: int(one.kind), np.int8),
                 ("outcome", lambda one: int(one.outcome), np.int8),
                 ("flank", lambda one: one.flank, np.int8),
                 ("phase", lambda one: one.phase, float))}
    data["special_branch"] = ("special", _whole(number for number, _, _ in specials))
    data["special_phi"] = ("special", np.array([one.state(special)[1] for _, one, special
                                                in specials], dtype=float))
    data |= {f"range_{name}": ("stable_range", np.array([row[i] for row in ranges], dtype=kind))
             for i, (name, kind) in enumerate((
                 ("branch", int), ("low", float), ("high", float), ("low_kind", np.int8),
                 ("high_kind", np.int8), ("cycles", int)))}
    data |= {f"seed_{name}": ("seed", getattr(looked, name))
             for name in ("motions", "engaged", "aperiodic", "failed")}
    data["seed_value"] = ("seed", values)
    table = xr.Dataset(data, attrs={"parameter": parameter, "low": low, "high": high})
    known = quantities.parameter(parameter)
    for name, words in VALUES.items():
        table[name].attrs = {"units": known.units, "long_name": f"{known.words}, {words}"}
    return quantities.worded(table)


def _whole(numbers: Any) -> np.ndarray:
    return np.array([int(one) for one in numbers], dtype=np.int64)


def _arrivals(point: Point, flank: int) -> int:
    layout = point.place.layout
    return int(np.sum((layout.kind <= Happening.GO_ON) & (layout.flank == flank)))


def _strobes(one: Branch, point: Point) -> np.ndarray:
    """φ and φ' at phase 0 of each mesh cycle, array (2, cycles)."""
    place = point.place
    return np.array(states_at(one.follower.problem, place.layout, place.z,
                              np.arange(place.layout.cycles, dtype=float))[1:])


def _ranges(number: int, one: Branch) -> list[tuple[Any, ...]]:
    """Stretches of a branch along which it is stable: branch, both ends and their kinds, cycles."""
    stable, found = one.stable, []
    for is_stable, group in groupby(range(len(stable)), key=lambda k: bool(stable[k])):
        if is_stable:
            indices = list(group)
            values = one.values[indices]
            # At a border the point before and the one beyond have no multipliers.
            ends = [_bound(one, indices[0], (indices[0] - 1, indices[0] - 2)),
                    _bound(one, indices[-1], (indices[-1], indices[-1] + 1))]
            low, high = sorted(ends)
            found.append((number, min(low[0], values.min()), max(high[0], values.max()),
                          low[1], high[1], one.cycles))
    return found


def _bound(one: Branch, point: int, positions: tuple[int, int]) -> tuple[float, int]:
    """What ends a stretch: value and kind; a mere knot only where the multipliers jump there."""
    met = [special for position in positions for at, special in
           zip(one.positions, one.specials, strict=True) if at == position]
    met.sort(key=lambda special: special.kind is Kind.KNOT)
    return (met[0].value, int(met[0].kind)) if met else (one.points[point].value, 0)
