"""Branches as a table: points, special points, stable ranges, the motions they began with."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from lapwing.base import quantities
from lapwing.base.codes import FoundFrom, FoundMotion
from lapwing.studies.branch.motion.layout import Happening
from lapwing.studies.branch.motion.witness import in_full
from lapwing.studies.branch.ranges import StableRange, stable_ranges
from lapwing.studies.branch.rattling import Rattling, rattling
from lapwing.studies.critical.force import critical_full, critical_on
from lapwing.studies.labels import settings

if TYPE_CHECKING:
    import xarray as xr

    from lapwing.studies.branch.family import Found, Request
    from lapwing.studies.branch.motion.layout import Layout
    from lapwing.studies.branch.run import Branch
    from lapwing.studies.branch.seeds import Search

# Columns in the unit of the parameter.
VALUES = {"value": "of each point", "special_value": "of each special point",
          "special_error": "by how much that of a special point may be off",
          "range_low": "lower end of each stable range",
          "range_high": "upper end of each stable range",
          "seed_value": "at which motions were looked at",
          "motion_value": "of each motion that was looked at",
          "rattling_low": "lower end of each interval of rattling",
          "rattling_high": "upper end of each interval of rattling",
          "rattling_low_error": "by how much the lower end may be off",
          "rattling_high_error": "by how much the upper end may be off"}
ENDS = ("low", "high")


def table(request: Request, found: Found) -> xr.Dataset:
    """A bifurcation diagram.

    Parameters
    ----------
    request : family.Request
    found : family.Found

    Returns
    -------
    xarray.Dataset, as of `lapwing.branches`
    """
    import xarray as xr

    search, (low, high) = request.search, request.range
    ranges = stable_ranges(found.branches)
    data = {**_points(found.branches), **_specials(found.branches), **_ranges(ranges),
            **_motions(found)}
    attrs = {"parameter": search.parameter, "low": low, "high": high, "settle": search.settle,
             "doublings": request.doublings, "highest_period": search.highest,
             "random_starts": search.random, "random_seed": search.seed,
             "lost": int(sum(one.kind is FoundMotion.PERIODIC and on is None
                             for one, on in zip(found.motions, found.on, strict=True)))}
    kept = kept_from(search)
    if kept is not None and kept < high:
        rattles = rattling(search, found, ranges, kept)
        data |= _intervals(rattles)
        attrs |= {"kept": kept} | _dies(rattles)
    about = settings(search.oscillator(request.range[0]), search.numerics, pair=search.pair,
                     varied=(search.parameter,))
    diagram = xr.Dataset(data, attrs=about | attrs)
    known = quantities.parameter(search.parameter)
    for name in VALUES.keys() & data.keys():
        diagram[name].attrs = {"units": known.units,
                               "long_name": f"{known.words}, {VALUES[name]}"}
    return quantities.worded(diagram)


def kept_from(search: Search) -> float | None:
    """The braking torque from which on contact can be kept; None along another parameter."""
    if search.parameter != "brake_torque":
        return None
    operation = {key: one for key, one in search.operation.items() if key != "brake_torque"}
    find = critical_on if operation.get("contact_law") == "rigid" else critical_full
    found = find(search.pair, search.te, **operation).attrs
    return float(found["estimate"]) if found["outcome"] == "found" else None


def _points(branches: Sequence[Branch]) -> dict[str, Any]:
    """Points of branches, their strobed states and events."""
    points = [(k, one) for k, branch in enumerate(branches, 1) for one in branch.points]
    strobes = [one for branch in branches for one in branch.strobed]
    multipliers = np.array([one.multipliers for _, one in points]).reshape(-1, 2)
    full = [in_full(branches[number - 1].follower.problem, one.place.layout, one.place.z)
            for number, one in points]
    layouts = [one for one, _ in full]
    events = [one.n for one in layouts]
    return {
        "value": ("point", _real(one.value for _, one in points)),
        "branch": ("point", _whole(number for number, _ in points)),
        "cycles": ("point", _whole(one.cycles for one in layouts)),
        "stable": ("point", _whole(one.stable for _, one in points)),
        "rank": ("point", _whole(one.rank for _, one in points)),
        "arrivals": ("point", _whole(_arrivals(one, 1) for one in layouts)),
        "back_arrivals": ("point", _whole(_arrivals(one, 2) for one in layouts)),
        "multiplier_real": (("point", "multiplier"), multipliers.real),
        "multiplier_imag": (("point", "multiplier"), multipliers.imag),
        "strobe_point": ("strobe", _repeated([one.shape[1] for one in strobes])),
        "phi": ("strobe", np.concatenate([np.empty(0), *(one[0] for one in strobes)])),
        "phi_dot": ("strobe", np.concatenate([np.empty(0), *(one[1] for one in strobes)])),
        "event_point": ("event", _repeated(events)),
        "event_phase": ("event", np.concatenate(
            [np.empty(0), *(one.phase for _, one in full)])),
        "event_speed": ("event", np.concatenate(
            [np.empty(0), *(one.speed for _, one in full)])),
        "event_happening": ("event", np.concatenate(
            [np.empty(0), *(one.kind for one in layouts)]).astype(np.int8)),
        "event_flank": ("event", np.concatenate(
            [np.empty(0), *(one.flank for one in layouts)]).astype(np.int8))}


def _specials(branches: Sequence[Branch]) -> dict[str, Any]:
    rows = [(number, branch, one) for number, branch in enumerate(branches, 1)
            for one in branch.specials]
    specials = [one for _, _, one in rows]
    return {
        "special_value": ("special", _real(one.value for one in specials)),
        "special_error": ("special", _real(one.error for one in specials)),
        "special_branch": ("special", _whole(number for number, _, _ in rows)),
        "special_kind": ("special", _codes(one.kind for one in specials)),
        "special_outcome": ("special", _codes(one.outcome for one in specials)),
        "special_flank": ("special", _codes(one.flank for one in specials)),
        "special_phase": ("special", _real(one.phase for one in specials)),
        "special_phi": ("special", _real(branch.state(one)[1] for _, branch, one in rows))}


def _ranges(ranges: Sequence[StableRange]) -> dict[str, Any]:
    return {"range_branch": ("stable_range", _whole(one.branch for one in ranges)),
            **{f"range_{end}": ("stable_range", _real(getattr(one, end).value for one in ranges))
               for end in ENDS},
            **{f"range_{end}_kind": ("stable_range", _codes(
                getattr(one, end).kind for one in ranges)) for end in ENDS},
            "range_cycles": ("stable_range", _whole(one.cycles for one in ranges))}


def _motions(found: Found) -> dict[str, Any]:
    """Every motion that was looked at, and their numbers by value."""
    numbers = {id(one): number for number, one in enumerate(found.branches, 1)}
    value, kind = (np.array([getattr(one, name) for one in found.motions])
                   for name in ("value", "kind"))
    looked = np.array([one.begun is not FoundFrom.END for one in found.motions])
    values, place = np.unique(value[looked], return_inverse=True)
    counts = {name: kind == code for name, code in (
        ("engaged", FoundMotion.ENGAGED), ("aperiodic", FoundMotion.APERIODIC),
        ("failed", FoundMotion.FAILED))} | {"motions": np.ones(len(kind), dtype=bool)}
    return {
        "motion_value": ("motion", value.astype(float)),
        "motion_kind": ("motion", _codes(kind)),
        "motion_begun": ("motion", _codes(one.begun for one in found.motions)),
        "motion_cycles": ("motion", _whole(one.cycles for one in found.motions)),
        "motion_branch": ("motion", _whole(numbers[id(one.branch)] if one else 0
                                           for one in found.on)),
        "motion_distance": ("motion", _real(one.distance if one else np.nan for one in found.on)),
        "motion_phi": ("motion", _real(one.state[1] for one in found.motions)),
        "motion_phi_dot": ("motion", _real(one.state[2] for one in found.motions)),
        "seed_value": ("seed", values.astype(float)),
        **{f"seed_{name}": ("seed", np.bincount(place[rows[looked]], minlength=len(values)))
           for name, rows in counts.items()}}


def _intervals(rattles: Rattling) -> dict[str, Any]:
    rows = {end: [pair[k] for pair in rattles.intervals] for k, end in enumerate(ENDS)}
    return {f"rattling_{end}{part}": ("rattling", make(getattr(one, name) for one in rows[end]))
            for end in ENDS for part, name, make in (
                ("", "value", _real), ("_error", "error", _real), ("_kind", "kind", _codes),
                ("_branch", "branch", _whole))}


def _dies(rattles: Rattling) -> dict[str, Any]:
    """Attributes: where rattling that is raised slowly dies."""
    if rattles.dies is None:
        return {}
    value, error, kind, branch = rattles.dies
    return {"dies": value, "dies_error": error, "dies_kind": kind.name.lower(),
            "dies_branch": branch}


def _real(numbers: Iterable[float]) -> NDArray[Any]:
    return np.array(list(numbers), dtype=float)


def _codes(numbers: Iterable[int]) -> NDArray[Any]:
    return np.array([int(one) for one in numbers], dtype=np.int8)


def _whole(numbers: Iterable[int]) -> NDArray[Any]:
    return np.array([int(one) for one in numbers], dtype=np.int64)


def _repeated(counts: Sequence[int]) -> NDArray[Any]:
    """Number of the point of each of its rows."""
    return np.repeat(np.arange(len(counts)), np.array(counts, dtype=int))


def _arrivals(layout: Layout, flank: int) -> int:
    return int(np.sum((layout.kind <= Happening.GO_ON) & (layout.flank == flank)))
