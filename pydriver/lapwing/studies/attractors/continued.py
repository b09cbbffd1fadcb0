"""Attractors from one value of a parameter to the next.

1. At each value, in rising order, the attractors of the value before are continued: a periodic
   motion by Newton's method in `STEPS` steps there and, lest another was met on the way, back
   again, where it must be what it was. From the continued state, or else from the last one, a run
   shows in what it ends now.
2. Random starts, new at every value, are followed as by `lapwing.attractors`; the shares are
   theirs alone.
3. An attractor is the one of the value before where the run of 1 ends in the continued motion; an
   aperiodic one where it is aperiodic again. Any other gets the next number.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from lapwing.base.codes import MotionState
from lapwing.base.quantities import worded
from lapwing.studies.attractors.dataset import (
    attractor_variables,
    counts,
    renumbered,
    shares,
)
from lapwing.studies.attractors.motions import Motion
from lapwing.studies.orbit import follow

if TYPE_CHECKING:
    import xarray as xr

    from lapwing.model.oscillator import Oscillator
    from lapwing.studies.attractors.search import Search
    from lapwing.studies.attractors.starts import Starts

# Steps from one value to the next, there and back.
STEPS = 4
# States of an attractor that are kept at each value, and what it takes in the result.
MOST_POINTS = 64
ENTRY_BYTES = 8 * (3 * MOST_POINTS + 24)


@dataclass(frozen=True, eq=False)
class AtValue:
    """What was found at a value.

    Attributes
    ----------
    value : float
    motions : dict of attractor number -> Motion
    variables : Dataset variables over `attractor`, in the order of `motions`
    runs : dict of str -> int, unresolved, failed and presumed runs
    last : int, the highest number given so far
    """

    value: float
    motions: dict[int, Motion]
    variables: dict[str, Any]
    runs: dict[str, int]
    last: int


def at_value(search: Search, value: float, make: Callable[[float], Oscillator],
             before: AtValue | None, starts: Starts) -> AtValue:
    """Find and number the attractors at a value.

    Parameters
    ----------
    search : Search, of the oscillator there
    value : float
    make : callable(value) giving an Oscillator
    before : AtValue or None, of the value before
    starts : Starts, the random ones
    """
    known, last = _continued(search, value, make, before) if before else ({}, 0)
    ends = search.find(starts.rows)
    numbers = []
    for place in range(1, len(search.motions) + 1):
        if place not in known:
            last += 1
        numbers.append(known.get(place, last))
    # As numbered, whatever the order in which they were met here.
    order = (np.argsort(numbers) + 1).tolist()
    labels = renumbered(ends, order)
    return AtValue(
        value, {numbers[place - 1]: search.motions[place - 1] for place in order},
        attractor_variables(search, order, MOST_POINTS)
        | shares(labels, labels > 0, len(order), starts.sample), counts(ends), last)


def _continued(search: Search, value: float, make: Callable[[float], Oscillator],
               before: AtValue) -> tuple[dict[int, int], int]:
    """Attractors before by the place of the motion that they have become here."""
    orbits = {number: _orbit(motion, before.value, value, make)
              for number, motion in before.motions.items()}
    rows = [(*(motion.states[-1] if (orbit := orbits[number]) is None else orbit), 0.0)
            for number, motion in before.motions.items()]
    known: dict[int, int] = {}
    if rows:
        places = search.look_at(np.array(rows, dtype=float))
        for place, (number, motion) in zip(places.tolist(), before.motions.items(), strict=True):
            if not place or place in known:
                continue
            now, orbit = search.motions[place - 1], orbits[number]
            same = now.holds(motion.period, orbit) if orbit is not None \
                else not motion.period and not now.period
            if same:
                known[place] = number
    return known, before.last


def _orbit(motion: Motion, value: float, other: float,
           make: Callable[[float], Oscillator]) -> NDArray[np.float64] | None:
    """A state of a periodic motion at another value; None where it is lost on the way."""
    if not motion.period:
        return None
    there = _followed(make, np.linspace(value, other, STEPS + 1), motion.states[0], motion.period)
    if there is None:
        return None
    back = _followed(make, np.linspace(other, value, STEPS + 1), there, motion.period)
    if back is None or not motion.holds(motion.period, back):
        return None
    return there


def _followed(make: Callable[[float], Oscillator], values: NDArray[np.float64],
              state: NDArray[np.float64], period: int) -> NDArray[np.float64] | None:
    """The state at the last of some values, or None."""
    try:
        orbits = follow(make, values, (MotionState(int(state[0])), float(state[1]),
                                       float(state[2])), period)
    except ValueError:  # a state that rounding puts beyond its flank
        return None
    if orbits.lost or any(one.cycles != period for one in orbits):
        return None
    return np.array(orbits[-1].state, dtype=float)


def dataset_along(parameter: str, values: NDArray[np.float64], found: list[AtValue],
                  told: Mapping[str, Any]) -> xr.Dataset:
    """What `lapwing.attractors_along` returns."""
    import xarray as xr

    count, n = found[-1].last if found else 0, len(values)
    tables: dict[str, Any] = {}
    for i, one in enumerate(found):
        places = np.array([*one.motions], np.intp) - 1
        for name, (dims, array) in one.variables.items():
            if name not in tables:
                own = (dims,) if isinstance(dims, str) else dims
                more = (MOST_POINTS if dim == "point" else 2 for dim in own[1:])
                tables[name] = ((parameter, *own), _nothing(name, array.dtype, (n, count, *more)))
            if array.ndim > 1:
                tables[name][1][i, places, :array.shape[1]] = array
            else:
                tables[name][1][i, places] = array
    reached = np.arange(n) < len(found)
    for name in ("unresolved", "failed", "presumed"):
        tables[name] = (parameter, np.array([one.runs[name] for one in found]
                                            + [-1] * (n - len(found)), np.int32))
    return worded(xr.Dataset(
        tables | {"reached": (parameter, reached.astype(np.int8))},
        {parameter: values, "attractor": np.arange(1, count + 1, dtype=np.int32)},
        {**told, "parameter": parameter, "continuation_steps": STEPS}))


def _nothing(name: str, kind: np.dtype[Any], shape: tuple[int, ...]) -> NDArray[Any]:
    """What stands where an attractor was not found."""
    if kind.kind == "O":
        return np.full(shape, "", object)
    return np.full(shape, 0 if name == "runs_ended" else -1 if kind.kind == "i" else np.nan, kind)


__all__ = ["AtValue", "at_value", "dataset_along"]
