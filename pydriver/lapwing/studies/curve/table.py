"""Curves of what ends the stable ranges of a bifurcation diagram, as part of its table."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from lapwing.base import quantities
from lapwing.model.oscillator import Oscillator
from lapwing.studies.branch.ranges import stable_ranges
from lapwing.studies.branch.run import Branch
from lapwing.studies.branch.seeds import Search
from lapwing.studies.branch.special import Special
from lapwing.studies.curve.condition import FOLLOWED
from lapwing.studies.curve.run import Curve, traced
from lapwing.studies.orbit import NoOrbit
from lapwing.studies.sweep.varied import moved_to

if TYPE_CHECKING:
    import xarray as xr

# Special points nearer to a curve than this, parts of the range, lie on it: between two of its
# points, 0.02 of the range apart, it is interpolated by a line.
ON_CURVE = 1e-3
# The end of a range is a special point of the branch within this part of the range.
SAME_VALUE = 1e-9
POINTS = 500


@dataclass(frozen=True)
class Second:
    """A second parameter.

    Attributes
    ----------
    parameter : str
    value : float, its own, where the branches are
    low, high : float, its range
    most : int, curves that are followed at most
    """

    parameter: str
    value: float
    low: float
    high: float
    most: int


@dataclass
class Followed:
    """Curves, the branch of each, and how many special points are on none.

    Attributes
    ----------
    curves : list of (number of the branch, Curve)
    left : int, not followed because there were enough; lost : int, could not be followed
    """

    curves: list[tuple[int, Curve]] = field(default_factory=list)
    left: int = 0
    lost: int = 0


def over(search: Search, second: Second) -> Callable[[float, float], Oscillator]:
    """Oscillator of each pair of values."""
    operation = {name: one for name, one in search.operation.items() if name != second.parameter}

    def make(value: float, number: float) -> Oscillator:
        pair, te, at = moved_to(search.pair, search.te, {
            search.parameter: value, second.parameter: number}, operation)
        return pair.oscillator(te, **at)

    return make


def followed(search: Search, branches: Sequence[Branch], second: Second) -> Followed:
    """Curves of what ends stable ranges, the widest first, each curve once."""
    found, make = Followed(), over(search, second)
    for number, branch, special in _ends(branches):
        unit = branch.follower.problem.unit
        if any(_on(one, special, second, unit) for _, one in found.curves):
            continue
        if len(found.curves) >= second.most:
            found.left += 1
            continue
        try:
            one = traced(branch, special, make, second.value, (second.low, second.high), POINTS,
                         second.parameter)
            found.curves.append((number, one))
        except (NoOrbit, ValueError, ArithmeticError):
            found.lost += 1
    return found


def _ends(branches: Sequence[Branch]) -> Iterator[tuple[int, Branch, Special]]:
    """What ends stable ranges, the widest first, each special point once."""
    seen: set[int] = set()
    for one in sorted(stable_ranges(branches), key=lambda one: one.low.value - one.high.value):
        branch = branches[one.branch - 1]
        for end in (one.high, one.low):
            near = SAME_VALUE * branch.follower.problem.unit
            for special in branch.specials:
                if special.kind is end.kind and special.kind in FOLLOWED \
                        and abs(special.value - end.value) <= near and id(special) not in seen:
                    seen.add(id(special))
                    yield one.branch, branch, special
                    break


def _on(curve: Curve, special: Special, second: Second, unit: float) -> bool:
    """Whether a special point lies on a curve: of its kind and period, at its value."""
    if curve.kind is not special.kind or curve.cycles != special.place.layout.cycles:
        return False
    away = curve.second - second.value
    return any(abs(curve.values[k] + part * (curve.values[k + 1] - curve.values[k])
                   - special.value) < ON_CURVE * unit
               for k in np.flatnonzero((away[:-1] * away[1:] <= 0) & (away[:-1] != away[1:]))
               for part in (away[k] / (away[k] - away[k + 1]),))


def added(diagram: xr.Dataset, found: Followed, second: Second) -> xr.Dataset:
    """A bifurcation diagram with its curves.

    Returns
    -------
    xarray.Dataset with besides, [unit; of codes the enumeration]:

    (curve): curve_kind [SpecialPoint], curve_branch, curve_cycles
    (curve_point): curve_number, curve_value [parameter], curve_value_error [parameter],
    curve_second [second], curve_second_error [second]
    (meeting): meeting_curve, meeting_kind [SpecialPoint], meeting_outcome [BranchOutcome],
    meeting_value [parameter], meeting_second [second]

    Attributes say which second parameter, where the branches are, and over which range.
    """
    curves = [one for _, one in found.curves]
    meetings = [(number, one, meeting) for number, one in enumerate(curves, 1)
                for meeting in one.meetings]
    places = np.array([one.place(meeting) for _, one, meeting in meetings]).reshape(-1, 2)

    def joined(name: str) -> NDArray[Any]:
        return np.concatenate([np.empty(0), *(getattr(one, name) for one in curves)])

    data = diagram.assign({
        "curve_kind": ("curve", np.array([int(one.kind) for one in curves], dtype=np.int8)),
        "curve_branch": ("curve", np.array([number for number, _ in found.curves], dtype=int)),
        "curve_cycles": ("curve", np.array([one.cycles for one in curves], dtype=int)),
        "curve_number": ("curve_point", np.repeat(
            np.arange(1, len(curves) + 1), [len(one.values) for one in curves])),
        "curve_value": ("curve_point", joined("values")),
        "curve_value_error": ("curve_point", joined("error")),
        "curve_second": ("curve_point", joined("second")),
        "curve_second_error": ("curve_point", joined("second_error")),
        "meeting_curve": ("meeting", np.array([number for number, _, _ in meetings], dtype=int)),
        "meeting_kind": ("meeting", np.array([int(one.kind) for _, _, one in meetings],
                                             dtype=np.int8)),
        "meeting_outcome": ("meeting", np.array([int(one.outcome) for _, _, one in meetings],
                                                dtype=np.int8)),
        "meeting_value": ("meeting", places[:, 0]), "meeting_second": ("meeting", places[:, 1])})
    for name, parameter in ((str(diagram.attrs["parameter"]), ("curve_value", "meeting_value",
                                                               "curve_value_error")),
                            (second.parameter, ("curve_second", "meeting_second",
                                                "curve_second_error"))):
        known = quantities.parameter(name)
        for variable in parameter:
            what = "by how much that of each point of a curve may be off" if "error" in variable \
                else "where something meets a curve" if "meeting" in variable \
                else "of each point of a curve"
            data[variable].attrs = {"units": known.units, "long_name": f"{known.words}, {what}"}
    return quantities.worded(data).assign_attrs(
        second_parameter=second.parameter, second_value=second.value, second_low=second.low,
        second_high=second.high, curves_left=found.left, curves_lost=found.lost)
