"""Curves of what ends the stable ranges of a bifurcation diagram, as part of its table."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from lapwing.base import quantities
from lapwing.model.oscillator import Oscillator
from lapwing.studies.branch.ranges import stable_ranges
from lapwing.studies.branch.run import Branch
from lapwing.studies.branch.seeds import Search
from lapwing.studies.branch.special import Kind, Special
from lapwing.studies.critical.records import identity
from lapwing.studies.curve.condition import FOLLOWED
from lapwing.studies.curve.run import traced
from lapwing.studies.orbit import NoOrbit
from lapwing.studies.records import Records
from lapwing.studies.sweep.varied import moved_to

if TYPE_CHECKING:
    import xarray as xr

# Special points nearer to a curve than this, parts of the range, lie on it: between two of its
# points, 0.02 of the range apart, it is interpolated by a line.
ON_CURVE = 1e-3
# The end of a range is a special point of the branch within this part of the range.
SAME_VALUE = 1e-9
POINTS = 500
COLUMNS = ("values", "second", "error", "second_error")


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


@dataclass(frozen=True, eq=False)
class Drawn:
    """What a table tells of a curve; see `run.Curve`.

    Attributes
    ----------
    kind : Kind
    cycles : int, mesh cycles of its motions
    values, second, error, second_error : arrays (n,)
    met : array (m, 4), of each meeting its kind, outcome and both parameters
    """

    kind: Kind
    cycles: int
    values: NDArray[Any]
    second: NDArray[Any]
    error: NDArray[Any]
    second_error: NDArray[Any]
    met: NDArray[Any]


@dataclass
class Followed:
    """Curves, the branch of each, and which special points are on none.

    Attributes
    ----------
    curves : list of (number of the branch, Drawn)
    left : int, not followed because there were enough
    lost : list of str, which could not be followed, and why
    """

    curves: list[tuple[int, Drawn]] = field(default_factory=list)
    left: int = 0
    lost: list[str] = field(default_factory=list)


def over(search: Search, second: Second) -> Callable[[float, float], Oscillator]:
    """Oscillator of each pair of values."""
    operation = {name: one for name, one in search.operation.items() if name != second.parameter}

    def make(value: float, number: float) -> Oscillator:
        pair, te, at = moved_to(search.pair, search.te, {
            search.parameter: value, second.parameter: number}, operation)
        return pair.oscillator(te, **at)

    return make


def followed(search: Search, branches: Sequence[Branch], second: Second,
             records: Records | None = None,
             progress: Callable[[float], None] | None = None) -> Followed:
    """Curves of what ends stable ranges, the widest first, each curve once.

    Parameters
    ----------
    search : Search
    branches : in the order of their numbers
    second : Second
    records : Records or None, where each is kept as soon as it is followed
    progress : callable(fraction done) or None
    """
    found, make = Followed(), over(search, second)
    ends = list(_ends(branches))
    for count, (number, branch, special) in enumerate(ends):
        if progress is not None:
            progress(count / len(ends))
        unit = branch.follower.problem.unit
        if any(_on(one, special, second, unit) for _, one in found.curves):
            continue
        if len(found.curves) >= second.most:
            found.left += 1
            continue
        made = _kept(records, search, branch, special, second, make)
        if isinstance(made, Drawn):
            found.curves.append((number, made))
        else:
            found.lost.append(f"{special.kind.name.lower().replace('_', ' ')} at "
                              f"{special.value:.10g} (branch {number}): {made}")
    return found


def _kept(records: Records | None, search: Search, branch: Branch, special: Special,
          second: Second, make: Callable[[float, float], Oscillator]) -> Drawn | str:
    """The curve of a special point, followed or read; or why there is none."""
    def drawn() -> Drawn | str:
        try:
            one = traced(branch, special, make, second.value, (second.low, second.high), POINTS,
                         second.parameter)
        except (NoOrbit, ValueError, ArithmeticError) as error:
            return str(error) or type(error).__name__
        met = [[float(meeting.kind), float(meeting.outcome), *one.place(meeting)]
               for meeting in one.meetings]
        return Drawn(one.kind, one.cycles, one.values, one.second, one.error, one.second_error,
                     np.array(met).reshape(-1, 4))

    if records is None:
        return drawn()
    follower = branch.follower
    numbers = [special.value, follower.low, follower.high, second.value, second.low, second.high,
               *branch.state(special)[1:]]
    return records.taken(
        identity(search.oscillator(special.value), np.array(numbers), kind=special.kind.name,
                 flank=special.flank, phase=special.phase, parameter=search.parameter,
                 second=second.parameter, points=POINTS), drawn, _packed, _unpacked)


def _packed(made: Drawn | str) -> dict[str, NDArray[Any]]:
    if isinstance(made, str):
        return {"why": np.frombuffer(made.encode(), dtype=np.uint8)}
    return {"about": np.array([int(made.kind), made.cycles]), "met": made.met,
            **{name: getattr(made, name) for name in COLUMNS}}


def _unpacked(data: Mapping[str, NDArray[Any]]) -> Drawn | str:
    if "why" in data:
        return data["why"].astype(np.uint8).tobytes().decode()
    kind, cycles = (int(one) for one in data["about"])
    values, second, error, second_error = (data[name] for name in COLUMNS)
    return Drawn(Kind(kind), cycles, values, second, error, second_error,
                 data["met"].reshape(-1, 4))


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


def _on(curve: Drawn, special: Special, second: Second, unit: float) -> bool:
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

    Attributes say which second parameter, where the branches are, over which range, and which
    special points could not be followed, and why (`curves_lost_why`).
    """
    curves = [one for _, one in found.curves]
    met = np.concatenate([np.empty((0, 4)), *(one.met for one in curves)])

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
        "meeting_curve": ("meeting", np.repeat(
            np.arange(1, len(curves) + 1), [len(one.met) for one in curves])),
        "meeting_kind": ("meeting", met[:, 0].astype(np.int8)),
        "meeting_outcome": ("meeting", met[:, 1].astype(np.int8)),
        "meeting_value": ("meeting", met[:, 2]), "meeting_second": ("meeting", met[:, 3])})
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
        second_high=second.high, curves_left=found.left, curves_lost=len(found.lost),
        curves_lost_why="; ".join(found.lost))
