"""What the engine's arrays hold, by name; the order of their columns: `base.quantities`.

A table comes out as a structured array, one entry a line: `cycles["phi"]` is a column, and
`events[events["kind"] == EventKind.IMPACT]` are some of the lines, both without a copy of the rest.
"""

from __future__ import annotations

from collections.abc import Iterable
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lapwing.base.codes import EventKind
from lapwing.base.quantities import AVERAGES as AVERAGES
from lapwing.base.quantities import CYCLE as CYCLE
from lapwing.base.quantities import EVENT as EVENT
from lapwing.base.quantities import RATE, TANGENT
from lapwing.base.quantities import SAMPLE as SAMPLE

# Columns of the cycle table that are no whole numbers, and those that a strobe alone fills.
CYCLE_REALS = tuple(name for name, unit in CYCLE.items() if unit != "1")
STROBED = ("motion_state", "phi", "phi_dot")
WORK_NAMES = ("steps", "rejected_steps", "polish_steps", "drive_flank_searches",
              "coast_flank_searches", "samples", "depth_searches", "graze_searches",
              "stretches")

EVENT_TABLE, SAMPLE_TABLE, CYCLE_TABLE = (
    np.dtype([(name, float) for name in columns]) for columns in (EVENT, SAMPLE, CYCLE))
# Columns of an event that a list of impacts keeps.
IMPACT_TABLE = np.dtype([("kind", np.int8), ("t", float), ("velocity_before", float)])
# Behind the columns of a sample or a cycle, where there are two degrees of freedom.
MEAN = {"mean_angle": "rad", "mean_rate": RATE}
MEAN_TABLE = np.dtype([(name, float) for name in MEAN])
# How each point of a sweep ended: `logged` lines of its log were met, also those without room.
# Where cycles are recorded: the period (0: none), the arrivals at either flank in the last period
# (in all cycles without one), whether a chatter was complete (fortran/observers/motion_class.f90)
CLASS = ("period", "arrivals", "back_arrivals", "chatter")
# ... and what they come to: extremes of all recorded cycles, and the fastest arrival (rad per tau).
EXTREMES = ("deepest_separation", "deepest_back_penetration", "states_visited", "fastest_arrival")
# ... and integrals over the last period (over all cycles without one), where they are wanted.
OUTCOME_TABLE = np.dtype([(name, float) for name in ("status", "logged", *SAMPLE, *CLASS,
                                                     *EXTREMES, *AVERAGES)]
                         + [("work", float, (len(WORK_NAMES),))])


@cache
def tangent_table(states: int = 2) -> np.dtype[Any]:
    """Table of tangent maps of a system with so many states."""
    return np.dtype([("matrix", float, (states, states)), *((name, float) for name in TANGENT)])


TANGENT_TABLE = tangent_table()


def with_means(rows: NDArray[Any],
               table: np.dtype[Any]) -> tuple[NDArray[Any], NDArray[Any] | None]:
    """The engine's rows by name, and what two degrees of freedom add behind them, or None."""
    own = table.itemsize // 8
    return named(rows[..., :own], table), \
        named(rows[..., own:], MEAN_TABLE) if rows.shape[-1] > own else None


def named(rows: NDArray[Any], table: np.dtype[Any]) -> NDArray[Any]:
    """The engine's rows by name.

    Parameters
    ----------
    rows : array (..., columns)
    table : dtype, one of those above

    Returns
    -------
    structured array (...), a view where the last axis is contiguous
    """
    return np.ascontiguousarray(rows).view(table)[..., 0]


def numbers(table: NDArray[Any]) -> NDArray[np.float64]:
    """The other way: array (..., columns) of a structured array."""
    return np.ascontiguousarray(table).view(float).reshape(*table.shape, table.itemsize // 8)


def unknown(table: np.dtype[Any], *shape: int) -> NDArray[Any]:
    """A table of NaN, for what was not recorded."""
    return named(np.full((*shape, table.itemsize // 8), np.nan), table)


def columns(table: NDArray[Any], names: Iterable[str]) -> NDArray[np.float64]:
    """Some columns side by side, array (..., names)."""
    return np.stack([table[name] for name in names], axis=-1)


def of_kind(events: NDArray[Any], kinds: Iterable[int]) -> NDArray[Any]:
    """Those of the events that are of some kinds."""
    return events[np.isin(events["kind"], list(kinds))]


def impacts_of(events: NDArray[Any]) -> NDArray[Any]:
    """The impacts among events, at either flank."""
    return of_kind(events, (EventKind.IMPACT, EventKind.BACK_IMPACT))


def work_counts(array: NDArray[Any]) -> dict[str, int]:
    """Named counts of what the engine did, as a dict of int."""
    return {name: int(count) for name, count in zip(WORK_NAMES, array, strict=True)}
