"""The search for the motions that starts lead to.

1. Some starts, spread over all, are followed until they have a period (`SETTLES`), and what they
   end in is refined or recorded (`motions`).
2. Every start is followed by the engine until it is one of the motions known, and no further.
3. Of those that are none after `most_cycles`, some are looked at as in 1, from where they ended.
   Where that gives a new motion, all that are open go on from where they ended, as in 2.
4. It ends when nothing is open, or `MOST_LOOKED_AT` starts were looked at: the rest is unresolved.

Nothing depends on the number of threads: a run depends on its start and the motions known alone.
"""

from __future__ import annotations

import math
import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lapwing import engine
from lapwing.base.codes import Ending, Status
from lapwing.engine import END_TABLE, Known, Numerics, Points, Wanted
from lapwing.engine.records import SAMPLE, columns
from lapwing.model.oscillator import Oscillator
from lapwing.studies.attractors.motions import (
    OVERLAP,
    Motion,
    aperiodic,
    cells_of,
    goals_of,
    inside,
    nearly_periodic,
    periodic,
    recurs,
)
from lapwing.studies.map.task import Dropped

# Mesh cycles before each look at a run, and those looked at.
SETTLES, LOOK = (200, 1000, 4000), 100
# Starts looked at in each round, and in all.
EACH, MOST_LOOKED_AT = 64, 512
# ... and without a period at a time.
FEW = 4
# A run of `LOOK` cycles is in an aperiodic motion that is known where so many of them begin there.
THERE = 0.95
# More aperiodic motions than so many are not told apart: what is left is unresolved.
MOST_APERIODIC = 16
# Starts handed to the engine at once.
PIECE = 256
GOLDEN = (math.sqrt(5) - 1) / 2


@dataclass(eq=False)
class Search:
    """Motions that are known of an oscillator, and the rules by which ends are recognised.

    Attributes
    ----------
    osc : Oscillator
    numerics : Numerics
    most_cycles : int, mesh cycles of a run
    returns : int, returns, each nearer, that presume an end
    recurrences : int, cycles in an aperiodic motion's cells that presume an end
    resolution : int, cells of the section along either axis
    threads : int
    """

    osc: Oscillator
    numerics: Numerics
    most_cycles: int
    returns: int
    recurrences: int
    resolution: int
    threads: int
    motions: list[Motion] = field(default_factory=list)
    _goals: list[NDArray[Any]] = field(default_factory=list)
    _cells: tuple[NDArray[np.intc], NDArray[np.float64]] = field(
        default_factory=lambda: (Known().cells, Known().box))

    def known(self) -> Known:
        """What the engine needs to recognise the motions."""
        goals = np.concatenate(self._goals) if self._goals else Known().goals
        return Known(goals, *self._cells, self.most_cycles, self.returns, self.recurrences)

    def find(self, rows: NDArray[np.float64],
             progress: Callable[[float], object] | None = None) -> NDArray[Any]:
        """Where each start (n, 4) ends, `END_TABLE`; motions that are new are added.

        `cycles` counts all that a run has taken; of a run that a look has recognised, those up to
        the look.
        """
        self.look_at(rows[spread(len(rows), EACH)])
        ends = self.follow(rows, progress)
        self.resolve(ends)
        return ends

    def resolve(self, ends: NDArray[Any]) -> None:
        """Look at runs that are open, and follow them further; 3 and 4 above."""
        looked = np.zeros(len(ends), bool)
        while looked.sum() < MOST_LOOKED_AT:
            open_ = _open(ends)
            some = open_[~looked[open_]][:EACH]
            if not some.size:
                break
            looked[some] = True
            before = len(self.motions)
            found = self.look_at(_from(ends[some]))
            recognised = some[found > 0]
            ends["motion"][recognised] = found[found > 0]
            ends["ending"][recognised] = Ending.PRESUMED
            if len(self.motions) > before:
                self._go_on(ends)

    def _go_on(self, ends: NDArray[Any]) -> None:
        """Follow what is open further, now that more is known."""
        open_ = _open(ends)
        more = self.follow(_from(ends[open_]))
        more["cycles"] += ends["cycles"][open_]
        ends[open_] = more

    def follow(self, rows: NDArray[np.float64],
               progress: Callable[[float], object] | None = None) -> NDArray[Any]:
        """Where each start ends among the motions known, `END_TABLE`."""
        return followed(self.osc, self.known(), rows, self.numerics, self.threads, progress)

    def look_at(self, rows: NDArray[np.float64]) -> NDArray[np.intp]:
        """What starts (n, 4) end in: the number of a motion, known or added, from 1; 0: not known.

        What has no period is looked at longer, a few runs at a time: the others mostly are of the
        same aperiodic motion, and known by it then.
        """
        found, left, cycles, outcome = self._look(rows, SETTLES[0])
        while left.size:
            some, left = left[:FEW], left[FEW:]
            found[some] = self._look_longer(
                np.column_stack([columns(outcome[some], SAMPLE), rows[some, 3]]))
            found[left] = [self._in_cells(cycles[i]) for i in left]
            left = left[found[left] == 0]
        return found

    def _look(self, rows: NDArray[np.float64], settle: int) -> tuple[
            NDArray[np.intp], NDArray[np.intp], NDArray[Any], NDArray[Any]]:
        """Motions of starts, which of them are open, their cycles (n, `LOOK`), how they ended."""
        result = engine.sweep(
            Points.of([self.osc]).repeated(len(rows)), [(i, i, False) for i in range(len(rows))],
            rows, numerics=self.numerics, wanted=Wanted(cycles=True, bounces=False), settle=settle,
            record=LOOK, log_room=1, threads=self.threads)
        found = np.zeros(len(rows), np.intp)
        fine = np.flatnonzero(result.outcome["status"] == Status.OK)
        for i in fine:
            found[i] = self._number_of_periodic(result.cycles[i], result.outcome[i]) \
                if result.outcome["period"][i] > 0 else self._in_cells(result.cycles[i])
        open_ = fine[(found[fine] == 0) & (result.outcome["period"][fine] == 0)]
        return found, open_, result.cycles, result.outcome

    def _look_longer(self, rows: NDArray[np.float64]) -> NDArray[np.intp]:
        found = np.zeros(len(rows), np.intp)
        left = np.arange(len(rows))
        for settle in SETTLES[1:]:
            found[left], open_, cycles, outcome = self._look(rows[left], settle)
            rows = rows.copy()
            rows[left[open_], :3] = columns(outcome[open_], SAMPLE)
            left = left[open_]
            if not left.size:
                return found
        for i, k in zip(left, open_, strict=True):
            found[i] = self._number_of_other(cycles[k], outcome[k])
        return found

    def _number_of_periodic(self, cycles: NDArray[Any], outcome: Any) -> int:
        period = int(outcome["period"])
        state = columns(cycles[-period:], SAMPLE)[0]
        known = self._same(period, state)
        return known or self._take(periodic(self.osc, cycles, outcome))

    def _number_of_other(self, cycles: NDArray[Any], outcome: Any) -> int:
        """Of a run without a period."""
        known = self._in_cells(cycles)
        if known:
            return known
        slow = nearly_periodic(self.osc, cycles, outcome)
        if slow is not None:
            return self._take(slow)
        if sum(not one.period for one in self.motions) >= MOST_APERIODIC:
            return 0
        return self._take(aperiodic(
            self.osc, (*columns(cycles[-1], SAMPLE), 0.0), self.numerics))

    def _in_cells(self, cycles: NDArray[Any]) -> int:
        """The aperiodic motion in whose cells a run stays, or 0."""
        states = columns(cycles, SAMPLE)
        return next((number for number, one in enumerate(self.motions, 1)
                     if not one.period and inside(*self._cells, states, number) >= THERE), 0)

    def _take(self, motion: Motion | None) -> int:
        """The number of a motion, which is added where it is new; 0: it is none to end in."""
        if motion is None or motion.lost:
            return 0
        same = self._same(motion.period, motion.states[0])
        if same:
            return same
        if not motion.period:
            if not recurs(motion, self.resolution):
                return 0
            for number, one in enumerate(self.motions, 1):
                if not one.period and inside(*self._cells, motion.states, number) >= OVERLAP:
                    return number
        self.motions.append(motion)
        if motion.period:
            self._goals.append(goals_of(self.osc, motion, len(self.motions)))
        else:
            self._cells = cells_of(self.motions, self.resolution)
        return len(self.motions)

    def _same(self, period: int, state: NDArray[np.float64]) -> int:
        return next((number for number, one in enumerate(self.motions, 1)
                     if one.holds(period, state)), 0)


def followed(osc: Oscillator, known: Known, rows: NDArray[np.float64], numerics: Numerics,
             threads: int, progress: Callable[[float], object] | None = None,
             stop: threading.Event | None = None) -> NDArray[Any]:
    """Where each start (n, 4) ends among the motions known, `END_TABLE`.

    Raises
    ------
    Dropped
        soon after `stop` is set, where it is given.
    """
    ends = np.empty(len(rows), END_TABLE)
    given_up, pieces = stop or threading.Event(), range(0, len(rows), PIECE)

    def told(_: float) -> None:
        if given_up.is_set():
            raise Dropped

    def fill(first: int) -> None:
        part = slice(first, first + PIECE)
        ends[part] = engine.destinations(osc, known, rows[part], numerics=numerics, told=told)

    with ThreadPoolExecutor(max(1, min(threads, len(pieces)))) as pool:
        try:
            for done, _ in enumerate(pool.map(fill, pieces), 1):
                if progress is not None:
                    progress(done / len(pieces))
        except BaseException:
            given_up.set()
            pool.shutdown(cancel_futures=True)
            raise
    return ends


def spread(count: int, wanted: int) -> NDArray[np.intp]:
    """So many places among `count`, spread over them whatever their order: by the golden ratio."""
    parts = np.arange(min(count, wanted)) * GOLDEN % 1
    return np.unique((parts * count).astype(np.intp))


def _open(ends: NDArray[Any]) -> NDArray[np.intp]:
    """Runs that have not failed and whose motion is not known."""
    return np.flatnonzero((ends["status"] == Status.OK) & (ends["motion"] == 0))


def _from(ends: NDArray[Any]) -> NDArray[np.float64]:
    """Starts at mesh phase 0, where runs have ended."""
    return np.column_stack([columns(ends, SAMPLE), np.zeros(len(ends))])


__all__ = ["PIECE", "Search", "followed", "spread"]
