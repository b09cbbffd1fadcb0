"""What happens between last back impact and last separation, by motions that stand for many."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from lapwing.base.arrivals import arrivals_in, per_cycle
from lapwing.report.hysteresis import Branch
from lapwing.report.numbers import doubtful
from lapwing.report.words import MOST, listed, parameter_unit, plural, runs_of
from lapwing.results.findings import START_NAMES, known, rattles

if TYPE_CHECKING:
    import xarray as xr

# Parts of the range that are told one by one.
PARTS = 3
# A coexisting motion is told of where it is seen at so many neighbouring values, at this share of
# all or more.
NEIGHBOURS, SHARE = 3, 0.05
# A depth that rises with the torque is told where it does so by this factor.
RISE = 2.0
# How other motions than those from rest are come to.
WAYS = {"up": "Where the torque is raised step by step (carried upwards)",
        "down": "Where the torque is lowered step by step (carried downwards)"}


def of_sweep(sweep: xr.Dataset, low: float | None, high: float) -> str:
    """The motions of a sweep along the braking torque between two torques, in a few sentences.

    The range is told in parts: of each the period that most of its motions have, and one of these
    whose depth is the middle one. Then the motions that live beside those from rest.

    Parameters
    ----------
    sweep : xarray.Dataset
    low, high : float, N·m; the last torque with back impacts (None: there is none), and with
        separation

    Returns
    -------
    str, empty where the teeth are not seen to part between them
    """
    starts = [str(start) for start in sweep["start"].values]
    branch = sweep.isel(start=starts.index("rest") if "rest" in starts else 0)
    values = sweep["brake_torque"].values
    between = low is not None and low < high
    part = _parting(branch) & (values <= high)
    part &= values > (low if between and low is not None else -math.inf)
    at = np.flatnonzero(part)
    if not at.size:
        return ""
    start, unit = str(branch["start"].values), parameter_unit("brake_torque")
    told = [_part(branch, values, rows, unit)
            for rows in np.array_split(at, PARTS if at.size > PARTS else at.size)]
    text = _beside(sweep, branch, part, values, unit)
    text += f"**{'In between' if between else 'Where the teeth part'}**, " \
        f"{START_NAMES.get(start, start)}: {'; '.join(told)}"
    wild = values[at[branch["period"].values[at] == 0]]
    text += f"; no period at {wild.size} of {plural(at.size, 'torque')}, the highest " \
        f"{wild[-1]:g} {unit}." if wild.size else "; every motion has a period."
    return text + _rise(branch, values, at, unit)


def _rise(branch: xr.Dataset, values: NDArray[Any], at: NDArray[Any], unit: str) -> str:
    """The last place where more torque means markedly deeper separation; empty: none.

    By the middle of three neighbours each, so that no single motion stands for a rise.
    """
    if at.size < NEIGHBOURS:
        return ""
    depth = np.median(np.lib.stride_tricks.sliding_window_view(_depths(branch)[at], 3), axis=1)
    ahead = np.maximum.accumulate(depth[::-1])[::-1]
    risen = np.flatnonzero(ahead >= RISE * depth)
    if not risen.size:
        return ""
    low = int(risen[-1])
    high = low + int(np.argmax(depth[low:]))
    # From the bottom of the hollow before the hump.
    deeper = np.flatnonzero(depth[:low] > depth[high])
    begin = int(deeper[-1]) + 1 if deeper.size else 0
    low = begin + int(np.argmin(depth[begin:high]))
    ends = [f"{depth[i]:.3g} µrad near {values[at[i + 1]]:g} {unit}" for i in (low, high)]
    return f" **More torque is not always better**: separation rises from {ends[0]} to {ends[1]}."


def _parting(branch: xr.Dataset) -> NDArray[Any]:
    """Where the drive flanks are pressed together, and part."""
    seen: NDArray[Any] = known(branch) & rattles(branch) & (branch["force"].values > 0)
    return seen


def _depths(branch: xr.Dataset) -> NDArray[Any]:
    """Deepest separation of each point, µrad."""
    depth: NDArray[Any] = 1e6 * branch["deepest_separation"].max("recorded_cycle").values
    return depth


def _part(branch: xr.Dataset, values: NDArray[Any], rows: NDArray[Any], unit: str) -> str:
    """A part of the range: its commonest period, and the motion of middle depth that has it."""
    periods, counts = np.unique(branch["period"].values[rows], return_counts=True)
    period, depth = int(periods[np.argmax(counts)]), _depths(branch)
    alike = rows[branch["period"].values[rows] == period]
    typical = alike[np.argsort(depth[alike], kind="stable")[(alike.size - 1) // 2]]
    motion = (f"{_count(per_cycle(branch)[typical], arrivals_in(branch.attrs).word)} per mesh "
              f"cycle and {depth[typical]:.4g} µrad of separation")
    words = f"period {period}" if period else "no period"
    if rows.size == 1:
        return f"at {values[typical]:g} {unit} {motion} ({words})"
    share = 100 * alike.size / rows.size
    return (f"from {values[rows[0]]:g} to {values[rows[-1]]:g} {unit} "
            f"{'all' if alike.size == rows.size else f'{share:.0f} %'} have {words}, as at "
            f"{values[typical]:g} {unit} with {motion}")


def _beside(sweep: xr.Dataset, rest: xr.Dataset, part: NDArray[Any], values: NDArray[Any],
            unit: str) -> str:
    """The other start whose motions differ at most torques, where these are many in a row."""
    best: tuple[int, xr.Dataset | None, list[tuple[int, int]]] = 0, None, []
    for other in (sweep.isel(start=i) for i in range(sweep.sizes["start"])):
        apart = Branch(rest).differs(Branch(other)) & part & _parting(other)
        wide = [(a, b) for a, b in runs_of(apart) if b - a + 1 >= NEIGHBOURS]
        size = sum(b - a + 1 for a, b in wide)
        if size > max(best[0], SHARE * part.sum()):
            best = size, other, wide
    size, found, wide = best
    if found is None:
        return ""
    widest = sorted(wide, key=lambda run: run[0] - run[1])
    at, start = sum(widest[0]) // 2, str(found["start"].values)
    more = "most of them at " * (len(wide) > MOST)
    return (f"**{WAYS.get(start, START_NAMES.get(start, start))} other motions live** than "
            f"{START_NAMES.get(str(rest['start'].values), 'the first').removeprefix('each ')} at "
            f"{100 * size / part.sum():.0f} % of the torques at which the teeth part ({more}"
            f"{listed(sorted(widest[:MOST]), values)} {unit}): at {values[at]:g} {unit} "
            f"{_depths(found)[at]:.4g} µrad deep instead of {_depths(rest)[at]:.4g}. ")


def of_responses(responses: Any) -> str:
    """The responses that part, one by one.

    Parameters
    ----------
    responses : sequence of Dataset

    Returns
    -------
    str, empty where none parts
    """
    there = [one.attrs for one in responses if not one.attrs["status"]
             and not one.attrs["fully_engaged"] and one.attrs["force"] > 0]
    there = sorted(there, key=lambda one: one["brake_torque"])
    if not there:
        return ""
    unit, parts = parameter_unit("brake_torque"), []
    for one in there[:MOST]:
        period = one["period"]
        motion = f"period {period}" if period else "no period found"
        motion += ", which the second run does not confirm" * doubtful(one)
        parts.append(f"at {one['brake_torque']:g} {unit} "
                     f"{_count(one['impacts_per_cycle'], arrivals_in(one).word)} per mesh cycle, "
                     f"{1e6 * one['deepest_separation']:.4g} µrad of separation ({motion})")
    more = f"; {len(there) - MOST} more below" * (len(there) > MOST)
    return f"**Where the teeth part**: {'; '.join(parts)}{more}."


def _count(number: float, word: str) -> str:
    """A number of impacts to three digits, in words."""
    return plural(float(f"{number:.3g}"), word)
