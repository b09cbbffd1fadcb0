"""Tables from rows: values with slopes, samples, angle pairs.

A table is knots (n + 1,), coefficients (n, 6) and kinks (n,), as `TransmissionError` takes them.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.polynomial import polynomial as power
from numpy.typing import ArrayLike, NDArray

from lapwing.base import arguments

# Phases made from angles are good to about 1e-15; a row nearer to 1 than this sits at phase 0.
_PHASE_ROUNDING = 1e-14

# Three arrays: see above, and `samples_of_pairs`.
Table = tuple[NDArray[Any], NDArray[Any], NDArray[Any]]


def hermite_table(phase: ArrayLike, value: ArrayLike, slope_left: ArrayLike,
                  slope_right: ArrayLike | None = None) -> Table:
    """Table of cubic Hermite pieces; arguments and errors as `TransmissionError.from_hermite`."""
    slope_right = slope_left if slope_right is None else slope_right
    at, values, left, right = _rows(
        ("phase", "value", "slope_left", "slope_right"), phase, value, slope_left, slope_right)
    width = np.diff(at, append=at[0] + 1)
    begin, end, rise = right * width, np.roll(left, -1) * width, np.roll(values, -1) - values
    excess = begin + end - 2 * rise
    unit = np.stack([values, begin, rise - begin - excess, excess])
    coefficients = unit.T / width[:, None] ** np.arange(4)
    return _close(at, coefficients, left != right)


def spline_table(phase: ArrayLike, value: ArrayLike, kinks: ArrayLike = ()) -> Table:
    """Table of a broken spline; arguments and errors as `TransmissionError.from_samples`."""
    from scipy.interpolate import CubicSpline

    at = arguments.reals("phase", phase, ndim=1)
    given = arguments.reals("kinks", _numbers(kinks), ndim=1, empty=True)
    given = np.zeros(at.size) if given.size == 0 else given
    at, values, marks = _rows(("phase", "value", "kinks"), at, value, given)
    if not np.all((marks == 0) | (marks == 1)):
        raise ValueError("kinks must be 0 or 1 for every row")
    n, starts = at.size, np.flatnonzero(marks)
    if not starts.size and n < 3:
        raise ValueError("a smooth periodic spline needs at least three rows")
    closure = "not-a-knot" if starts.size else "periodic"
    starts = starts if starts.size else np.array([0])
    coefficients = np.empty((n, 4))
    for first, last in zip(starts, np.append(starts[1:], starts[0] + n), strict=True):
        row = np.arange(first, last + 1)
        arc = CubicSpline(at[row % n] + row // n, values[row % n], bc_type=closure)
        coefficients[row[:-1] % n] = arc.c[::-1].T
    return _close(at, coefficients, marks == 1)


def samples_of_pairs(pinion_angle: ArrayLike, gear_angle: ArrayLike, pinion_teeth: int,
                     gear_teeth: int,
                     reference: ArrayLike = (0.0, 0.0)) -> Table:
    """Samples behind angle pairs: phase, Δφ and kinks (n,), as `TransmissionError.from_tca`."""
    pinion = arguments.reals("pinion_angle", pinion_angle, ndim=1)
    gear = arguments.reals("gear_angle", gear_angle, ndim=1)
    pinion_teeth = arguments.whole("pinion_teeth", pinion_teeth, 1)
    gear_teeth = arguments.whole("gear_teeth", gear_teeth, 1)
    origin = arguments.reals("reference", reference, ndim=1)
    if origin.size != 2:
        raise ValueError("reference: expected are two angles")
    ascending = pinion.ndim == 1 and pinion.size > 1 and np.all(np.diff(pinion) > 0)
    if pinion.shape != gear.shape or not ascending:
        raise ValueError("pinion_angle and gear_angle: expected are two equally long rows, "
                         "pinion_angle ascending")
    turn = pinion - origin[0]
    error = (gear - origin[1]) - pinion_teeth / gear_teeth * turn
    phase = pinion_teeth * turn / (2 * math.pi)
    excess = phase[-1] - phase[0] - 1
    if excess > 1e-9:
        raise ValueError("the pairs cover more than one mesh period: cut the path of contact "
                         "at its transfer points")
    if excess > -1e-9:
        if abs(error[-1] - error[0]) > 1e-3 * np.ptp(error):
            raise ValueError("the two ends of the mesh period differ by "
                             f"{error[-1] - error[0]:.3g} rad: not the transfer points")
        phase, error = phase[:-1], error[:-1]
    phase = np.where(phase % 1 > 1 - _PHASE_ROUNDING, 0.0, phase % 1)
    order = np.argsort(phase)
    return phase[order], error[order], order == 0


def _numbers(flags: ArrayLike) -> ArrayLike:
    """Flags as numbers; True and False are 1 and 0 here."""
    try:
        array = np.asanyarray(flags)
    except ValueError:  # rows of several lengths, which the converter refuses by name
        return flags
    return array.astype(float) if array.dtype == bool else flags


def flags(name: str, value: ArrayLike) -> NDArray[Any]:
    """A new array of True and False, from these or from 1 and 0."""
    numbers = arguments.reals(name, _numbers(value), ndim=1)
    if not np.all((numbers == 0) | (numbers == 1)):
        raise ValueError(f"{name} must be True or False for every piece")
    marked: NDArray[Any] = numbers == 1
    return marked


def _rows(names: tuple[str, ...], phase: ArrayLike,
          *columns: ArrayLike) -> list[NDArray[Any]]:
    """The rows of a table as equally long finite float arrays, phase ascending in [0, 1)."""
    rows = [arguments.reals(name, column, ndim=1) for name, column in
            zip(names, (phase, *columns), strict=True)]
    if any(row.shape != rows[0].shape for row in rows):
        raise ValueError(f"{', '.join(names)} must be equally long")
    if rows[0][0] < 0 or rows[0][-1] >= 1 or not np.all(np.diff(rows[0]) > 0):
        raise ValueError("phase must ascend strictly in [0, 1); the row at phase 1 is left out")
    return rows


def _close(phase: NDArray[Any], cubic: NDArray[Any], kinks: NDArray[Any]) -> Table:
    """Pieces that start at each row, from 0 to 1; the one that wraps is split at phase 0."""
    coefficients = np.zeros((phase.size, 6))
    coefficients[:, : cubic.shape[1]] = cubic
    knots = np.append(phase, 1.0)
    if phase[0] > 0:
        shift = 1 - phase[-1]
        taylor = [power.polyval(shift, power.polyder(coefficients[-1], k)) / math.factorial(k)
                  for k in range(6)]
        coefficients = np.vstack([taylor, coefficients])
        knots, kinks = np.append(0.0, knots), np.append(False, kinks)
    return knots, coefficients, kinks
