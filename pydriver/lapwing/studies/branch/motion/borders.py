"""What a motion must keep to stay the motion that it is: conditions at its own events."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lapwing.studies.branch.motion.curve import Problem
from lapwing.studies.branch.motion.equations import at_events, pressing
from lapwing.studies.branch.motion.layout import Happening, Layout

# Bounces of a chatter that ends, slower than this part of scale/P, pass knots unlisted.
SLOW = 0.5


class Condition(IntEnum):
    """A tooth arrives, leaves, rebounds (or goes on), is pressed; an event is on its piece."""

    ARRIVES = 0
    LEAVES = 1
    REBOUNDS = 2
    PRESSED = 3
    BEGUN = 4
    NOT_ENDED = 5


@dataclass(frozen=True, eq=False)
class Borders:
    """Conditions of a layout: arrays (m,)."""

    condition: NDArray[Any]
    event: NDArray[Any]


def borders_of(problem: Problem, layout: Layout, z: NDArray[Any]) -> Borders:
    """The conditions; z tells which bounces are slow."""
    _, osc, motion = problem.at(z)
    kind, found = layout.kind, []
    arrives = np.flatnonzero(kind <= Happening.GO_ON)
    found += [(Condition.ARRIVES, k) for k in arrives]
    found += [(Condition.LEAVES, k) for k in np.flatnonzero(kind == Happening.RELEASE)
              if osc.contact_law != "rigid"]
    if osc.impact_law == "absolute":
        found += [(Condition.REBOUNDS, k) for k in arrives
                  if osc.back_flank_te or layout.flank[k] == 1]
    found += [(Condition.PRESSED, k) for k in np.flatnonzero(kind == Happening.CHATTER_END)]
    if motion.pieces:
        for k in np.flatnonzero((kind != Happening.AT_KINK) & ~slow(layout, z)):
            found += [(Condition.BEGUN, k), (Condition.NOT_ENDED, k)]
    rows = np.array(found, dtype=int).reshape(-1, 2)
    return Borders(rows[:, 0], rows[:, 1])


def slow(layout: Layout, z: NDArray[Any]) -> NDArray[Any]:
    """Bounces of a chatter that are small already, and its end: array of bool."""
    last = layout.bounces & (np.abs(z[1:-1:2]) < SLOW)
    found: NDArray[Any] = last | (layout.kind == Happening.CHATTER_END)
    return found


def fewer(problem: Problem, layout: Layout, z: NDArray[Any]) -> tuple[Layout, NDArray[Any]]:
    """A motion as the equations take it: its slow bounces are left to what follows on the last."""
    last = layout.summed(z[1:-1:2], SLOW)
    if not len(last):
        return layout, z
    osc = problem.oscillator(problem.value(z))
    return layout.without(last, osc.contact_law == "rigid"), z[layout.columns_without(last)]


def border_values(problem: Problem, layout: Layout, z: NDArray[Any],
                  borders: Borders) -> NDArray[Any]:
    """Positive where a condition holds, array (m,); smooth in z, also beyond zero."""
    events, osc, motion = problem.at(z)
    known = at_events(layout, events, osc, motion, engaged=False)
    unit = problem.scale / osc.period
    k, which = borders.event, borders.condition
    goes_on = layout.kind[k] == Happening.GO_ON
    after = np.where(goes_on, 1.0, -1.0) * known.after[k] / unit
    by = [events.speed[k] / unit, -events.speed[k] / unit, after,
          pressing(known, osc)[k] * osc.period / unit, np.ones(len(k)), np.ones(len(k))]
    if motion.pieces:
        by[Condition.BEGUN] = events.phase[k] - motion.begin(layout.piece[k])
        by[Condition.NOT_ENDED] = motion.begin(layout.piece[k] + 1) - events.phase[k]
    found: NDArray[Any] = np.choose(which, by)
    return found


def moved_on(problem: Problem, layout: Layout, z: NDArray[Any]) -> Layout:
    """Slow bounces put on the pieces that they lie on."""
    _, _, motion = problem.at(z)
    last = slow(layout, z)
    if not motion.pieces or not last.any():
        return layout
    pieces = np.where(last, motion.piece(z[:-1:2]), layout.piece)
    if np.array_equal(pieces, layout.piece):
        return layout
    return Layout(layout.kind, layout.flank, pieces, layout.cycles, layout.arc)
