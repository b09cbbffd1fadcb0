"""Periodic motions over two parameters: a sheet, and the curves on it where a condition is met."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lapwing.model.oscillator import Oscillator
from lapwing.studies.branch.motion.curve import ROUNDING, Bordered, NotCorrected, Problem
from lapwing.studies.branch.motion.layout import Layout

MOST_CORRECTIONS = 12
# As of `branch.motion.curve`: a correction that is rounding, one that no longer shrinks and is
# close, and what may be left of the equations and of the condition then.
DONE, CLOSE, SOLVED = 1e-14, 1e-8, 1e-11
# Step over which the condition and the equations are differenced, parts of the scales: it bears on
# the speed of Newton's method and on nothing that is located.
DIFFERENCE = 1e-6
# Directions longer than this are of nearly singular equations.
REGULAR = 10.0
# The condition is differenced along a direction of at most this length times the step.
MOST_DIFFERENCED = 30.0
# After a correction smaller than this the derivatives are those of the place before.
NEAR = 1e-4
MOST_KEPT = 4

# Roundings of the unknowns by which a condition is tried, and numbers by which signs change.
ULPS, PATTERNS = (-3, -1, 1, 2), (0.1, 1.9, 3.0)

Value = Callable[[Problem, Layout, NDArray[Any]], float]


@dataclass(frozen=True, eq=False)
class Sheet:
    """An oscillator for each pair of values, and the scales of the unknowns.

    The unknowns y are those of `Problem` at the second value, then that value over its unit.

    Attributes
    ----------
    make : callable(value, second) giving an Oscillator
    first : Problem, whose scales are taken
    unit : float, of the second parameter
    """

    make: Callable[[float, float], Oscillator]
    first: Problem
    unit: float
    kept: dict[float, Problem] = field(default_factory=dict)

    def values(self, y: NDArray[Any]) -> tuple[float, float]:
        """Both parameters."""
        return float(y[-2]) * self.first.unit, float(y[-1]) * self.unit

    def problem(self, y: NDArray[Any]) -> Problem:
        """The motions at the second value; the last few are kept."""
        second = float(y[-1]) * self.unit
        if second not in self.kept:
            if len(self.kept) >= MOST_KEPT:
                self.kept.pop(next(iter(self.kept)))
            self.kept[second] = Problem(lambda value: self.make(value, second),
                                        self.first.motions, self.first.scale, self.first.unit)
        return self.kept[second]

    def weights(self, layout: Layout) -> NDArray[Any]:
        """Of the squares of the unknowns in the measure of length."""
        return np.append(self.first.weights(layout), 1.0)

    def residual(self, layout: Layout, y: NDArray[Any]) -> NDArray[Any]:
        """By how much the motion's equations are off, array (2n,)."""
        return self.problem(y).residual(layout, y[:-1])


@dataclass(frozen=True, eq=False)
class Chart:
    """Two directions along the sheet at a place.

    Attributes
    ----------
    off : array (2n + 2,), the correction that leads back to the sheet
    along, across : arrays (2n + 2,); one parameter changes by 0 and by 1
    left : float, by how much the motion's equations are off
    by_value : two arrays (2n,), derivatives of these by both scaled parameters
    bordered : Bordered, the equations with the one parameter that is not held
    columns : int array (2n + 1,), its unknowns among y
    """

    off: NDArray[Any]
    along: NDArray[Any]
    across: NDArray[Any]
    left: float
    by_value: tuple[NDArray[Any], NDArray[Any]]
    bordered: Bordered
    columns: NDArray[Any]

    def answer(self, right: NDArray[Any]) -> NDArray[Any]:
        """By how much y moves where the motion's equations (2n,) are off by so much."""
        found = np.zeros(len(self.columns) + 1)
        found[self.columns] = self.bordered.solve(np.append(right, 0.0))
        return found


def chart(sheet: Sheet, layout: Layout, y: NDArray[Any], near: NDArray[Any],
          tangent: NDArray[Any], known: Chart | None = None) -> Chart:
    """Both directions at a place, the first one on the side of `near` (2n + 2,).

    Close to a place that is known the equations change with the parameters as there.

    The second parameter is held along the first, which is the branch there, but where the branch's
    own equations are singular as well: at a fold that does not feel the first parameter. There the
    first direction is one that the curve's tangent tells.
    """
    weights = sheet.weights(layout)
    pivots = weights * near, weights * (near + tangent)
    problem, z = sheet.problem(y), y[:-1]
    found, blocks = problem.by_events(layout, z)
    if not np.all(np.isfinite(found)):
        raise NotCorrected("not finite")
    by_value = known.by_value if known is not None else (
        problem.by_value(layout, z, found), _by_second(sheet, layout, y, found))
    size, best = len(found), None
    last = np.zeros(size + 1)
    last[-1] = 1.0
    for moved in (0, 1):
        columns = np.append(np.arange(size), size + moved)
        try:
            bordered = Bordered(blocks, by_value[moved], pivots[moved][columns])
            parts = [bordered.solve(right) for right in (
                np.append(-found, 0.0), last, np.append(-by_value[1 - moved], 0.0))]
        except NotCorrected:
            continue
        off, along, across = np.zeros((3, size + 2))
        for whole, part in zip((off, along, across), parts, strict=True):
            whole[columns] = part
        across[size + 1 - moved] = 1.0
        made = Chart(off, along, across, float(np.max(np.abs(found))), by_value, bordered, columns)
        large = float(np.max(np.abs(across)))
        if best is None or large < best[0]:
            best = large, made
        if large < REGULAR:
            break
    if best is None:
        raise NotCorrected("singular equations")
    return best[1]


def _by_second(sheet: Sheet, layout: Layout, y: NDArray[Any],
               found: NDArray[Any]) -> NDArray[Any]:
    """Derivative of the residual, which is `found` at y, by the scaled second parameter."""
    there = y.copy()
    there[-1] += DIFFERENCE * max(1.0, abs(float(y[-1])))
    try:
        moved = sheet.residual(layout, there)
    except ValueError:
        # No oscillator has more than the greatest value allowed.
        there[-1] = 2 * y[-1] - there[-1]
        moved = sheet.residual(layout, there)
    by_second: NDArray[Any] = (moved - found) / (there[-1] - y[-1])
    return by_second


def slopes(sheet: Sheet, layout: Layout, y: NDArray[Any], value: Value,
           known: Chart) -> tuple[float, float]:
    """Derivatives of the condition along both directions."""
    def at(where: NDArray[Any]) -> float:
        return value(sheet.problem(where), layout, where[:-1])

    def slope(direction: NDArray[Any]) -> float:
        # Where the second value moves it does so as for the equations, whose flanks are kept.
        step, large = DIFFERENCE * max(1.0, abs(float(y[-1]))), float(np.max(np.abs(direction)))
        if direction[-1] != 1.0 or large > MOST_DIFFERENCED:
            step /= max(1.0, large)
        try:
            if not direction[-1]:
                return (at(y + step * direction) - at(y - step * direction)) / (2 * step)
            return (at(y + step * direction) - here) / step
        except ValueError:
            return (here - at(y - step * direction)) / step

    here = at(y)
    one, two = slope(known.along), slope(known.across)
    if not (math.isfinite(one) and math.isfinite(two)):
        raise NotCorrected("the condition has no value")
    return one, two


@dataclass(frozen=True, eq=False)
class Spot:
    """A place of a curve on the sheet.

    Attributes
    ----------
    layout : Layout
    y : array (2n + 2,)
    tangent : array (2n + 2,), of the curve, of unit length in the measure
    along : array (2n + 2,), of the branch through it at the second value held, likewise
    slope : float, of the condition along that branch
    aside : array (2n + 2,), along the sheet, across the curve to where the condition is positive
    gradient : float, of the condition along that
    error : array (2,), by how much both values, scaled, may be off
    count : int, corrections that it took
    """

    layout: Layout
    y: NDArray[Any]
    tangent: NDArray[Any]
    along: NDArray[Any]
    slope: float
    aside: NDArray[Any]
    gradient: float
    error: NDArray[Any]
    count: int


def onto(sheet: Sheet, layout: Layout, y: NDArray[Any], spot: Spot) -> NDArray[Any]:
    """Newton's method onto the sheet from near a place of a curve.

    Raises
    ------
    NotCorrected
    """
    known = None
    for _ in range(MOST_CORRECTIONS):
        known = chart(sheet, layout, y, spot.along, spot.tangent, known)
        y = y + known.off
        if float(np.max(np.abs(known.off))) < CLOSE:
            return y
    raise NotCorrected("not on the sheet")


def corrected(sheet: Sheet, layout: Layout, y: NDArray[Any], value: Value, row: NDArray[Any],
              along: NDArray[Any], tangent: NDArray[Any]) -> Spot:
    """Newton's method onto the curve in the plane through y that `row` is normal to.

    Parameters
    ----------
    sheet, layout : which motions
    y : array (2n + 2,), a guess
    value : the condition
    row : array (2n + 2,); that of a single parameter holds it
    along, tangent : arrays (2n + 2,), near those of the place that is looked for

    Raises
    ------
    NotCorrected
    """
    before, count = math.inf, 0
    known, slope = None, (0.0, 0.0)
    for count in range(MOST_CORRECTIONS):  # noqa: B007
        known = chart(sheet, layout, y, along, tangent, known if before < NEAR else None)
        back = y + known.off
        if not before < NEAR:
            slope = slopes(sheet, layout, back, value, known)
        here = value(sheet.problem(back), layout, back[:-1])
        if not math.isfinite(here):
            raise NotCorrected("the condition has no value")
        matrix = np.array([slope, [row @ known.along, row @ known.across]])
        try:
            a, b = np.linalg.solve(matrix, [-here, -float(row @ known.off)])
        except np.linalg.LinAlgError:
            raise NotCorrected("singular equations") from None
        step = known.off + a * known.along + b * known.across
        if not row[:-2].any():
            step[np.flatnonzero(row)] = 0.0  # A value held stays what it is.
        size = float(np.max(np.abs(step)))
        if not size < 10.0:
            raise NotCorrected("far away")
        if size < DONE or (size >= 0.5 * before and before < CLOSE and known.left < SOLVED):
            break
        y, before = y + step, size
    else:
        if not (before < CLOSE and known is not None and known.left < SOLVED):
            raise NotCorrected(f"still off by {before:.1e}")
    known = chart(sheet, layout, y, along, tangent)
    slope = slopes(sheet, layout, y, value, known)
    spot = _spot(sheet, layout, y, known, slope, tangent, count)
    return replace(spot, error=_error(sheet, value, spot, known, slope))


def _error(sheet: Sheet, value: Value, spot: Spot, known: Chart,
           slope: tuple[float, float]) -> NDArray[Any]:
    """By how much both values of a place, scaled, may be off by rounding: array (2,).

    Each of the motion's equations is taken to be off by as much as the worst of them, or by the
    roundings of a phase, with signs of several patterns; the condition by what is left of it and by
    what the last digits of the unknowns make of it. Across the curve: along it a place may lie
    anywhere.
    """
    layout, y = spot.layout, spot.y
    problem, z = sheet.problem(y), y[:-1]
    row = sheet.weights(layout) * spot.tangent
    matrix = np.array([slope, [row @ known.along, row @ known.across]])
    here = value(problem, layout, z)
    noise = abs(here)
    for k in ULPS:
        moved = z * (1 + k * np.finfo(float).eps)
        moved[-1] = z[-1]
        noise = max(noise, abs(value(problem, layout, moved) - here))

    def step(off: NDArray[Any], by: float) -> NDArray[Any]:
        try:
            a, b = np.linalg.solve(matrix, [-by, -float(row @ off)])
        except np.linalg.LinAlgError:
            return np.full(2, math.inf)
        moved: NDArray[Any] = np.abs((off + a * known.along + b * known.across)[-2:])
        return moved

    found = step(np.zeros(len(y)), noise)
    size = max(known.left, ROUNDING * float(np.max(np.abs(y))))
    numbers = np.arange(2 * layout.n)
    worst = np.zeros(2)
    for pattern in PATTERNS:
        off = known.answer(np.where(np.sin(pattern * (numbers + 1)) < 0, -1.0, 1.0))
        h = DIFFERENCE / max(1.0, float(np.max(np.abs(off))))
        ahead = y + h * off
        try:
            by = (value(sheet.problem(ahead), layout, ahead[:-1]) - here) / h
        except ValueError:
            ahead = y - h * off
            by = (here - value(sheet.problem(ahead), layout, ahead[:-1])) / h
        worst = np.maximum(worst, step(off, by))
    found += size * worst + ROUNDING * np.abs(y[-2:])
    return found


def _spot(sheet: Sheet, layout: Layout, y: NDArray[Any], known: Chart,
          slope: tuple[float, float], tangent: NDArray[Any], count: int) -> Spot:
    """A place with its directions, on the sides of those given; its error is still to be told."""
    weights, (one, two) = sheet.weights(layout), slope
    found = two * known.along - one * known.across
    size = math.sqrt(float(weights @ found**2))
    if not size > 0:
        raise NotCorrected("the curve has no direction")
    found *= math.copysign(1.0 / size, float(weights @ (found * tangent)))
    length = math.sqrt(float(weights @ known.along**2))
    aside = one * known.along + two * known.across
    aside -= float((weights * found) @ aside) * found
    width = math.sqrt(float(weights @ aside**2))
    # What is taken off lies along the curve, where the condition does not change.
    return Spot(layout, y, found, known.along / length, one / length, aside / width,
                (one * one + two * two) / width, np.full(2, math.nan), count)
