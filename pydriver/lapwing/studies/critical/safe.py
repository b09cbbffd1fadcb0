"""The search for the value above which no rattling survives from a stated set of starts."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from lapwing.base.codes import SearchStage
from lapwing.studies.critical.starts import StartGrid, fitted, follow, start_grid

if TYPE_CHECKING:
    from lapwing.engine.numerics import Numerics
    from lapwing.model.oscillator import Oscillator
    from lapwing.studies.critical.records import Records

# Of the motions that rattle at one value so many, evenly picked, are carried to the next.
CARRIED = 24
# Rattling at the last rattling value is followed for so many times as long.
PATIENCE = 10


class Trial(NamedTuple):
    """One value tried: how many motions were followed, rattled, failed."""

    value: float
    stage: SearchStage
    starts: int
    rattling: int
    failed: int


@dataclass
class SafeSearch:
    """Scan from the safe end to the first rattling value, then halve that bracket.

    Attributes
    ----------
    oscillator_at : callable(value), the Oscillator of a value of the parameter
    grid : StartGrid
    phase : float, mesh phase of rest
    settle, record : int, mesh cycles
    resolution : float, half of the widest bracket allowed
    numerics, threads, progress : as for `follow`
    records : Records or None, where each trial is kept
    trials : list of Trial, in the order made
    """

    oscillator_at: Callable[[float], Oscillator]
    grid: StartGrid
    phase: float
    settle: int
    record: int
    resolution: float
    numerics: Numerics
    threads: int
    progress: Callable[[float], None] | None = None
    records: Records | None = None
    trials: list[Trial] = field(default_factory=list)

    def run(self, values: NDArray[Any], further: int) -> tuple[float, float]:
        """Search `values`, the safe end first; returns (rattling, clean), NaN where there is none.

        1. Try each value from the grid of starts until some motion rattles. A run that fails
           counts as one that rattles: it does not show the value to be safe.
        2. Halve the bracket; besides the grid, motions that rattle at its unsafe end are carried.
        3. Try `further` values beyond the first rattling one, from the far end on, and carry what
           rattles from each to the next, up to the last rattling value.
        4. Carry motions from there to the clean value, now a step of at most 2·resolution away;
           where some survive, that one rattles and the next step is tried.
        5. Follow what rattles last `PATIENCE` times as long.
        """
        rattling = clean = math.nan
        states: list[Any] = []
        beyond: list[float] = []
        for i, value in enumerate(map(float, values)):
            if self.progress is not None:
                self.progress(i / len(values))
            unsafe, states = self._try(value, SearchStage.SCAN)
            if unsafe:
                rattling, beyond = value, list(values[i + 1:i + 1 + further])
                break
            clean = value
        if not math.isnan(rattling + clean):
            rattling, clean, states = self._halve(rattling, clean, states)
        if beyond:
            states = states + self._from_beyond(beyond, rattling)
        if not math.isnan(rattling + clean):
            rattling, clean, states = self._raise(rattling, clean, states, float(values[0]))
        if states:
            self._try(rattling, SearchStage.CONFIRMATION, states, only=True, times=PATIENCE)
        return rattling, clean

    def _from_beyond(self, beyond: list[float], rattling: float) -> list[Any]:
        """States at the last rattling value of motions found on its unsafe side."""
        states: list[Any] = []
        for value in map(float, reversed(beyond)):
            survivors = self._carried(value, states)
            states = survivors + self._try(value, SearchStage.FURTHER)[1]
        return self._carried(rattling, states)

    def _carried(self, value: float, states: list[Any]) -> list[Any]:
        return self._try(value, SearchStage.CARRIED, states, only=True)[1] if states else []

    def _halve(self, rattling: float, clean: float, states: list[Any]) -> tuple[float, float, Any]:
        while abs(clean - rattling) > 2 * self.resolution:
            middle = 0.5 * (rattling + clean)
            if middle in (rattling, clean):
                break
            unsafe, found = self._try(middle, SearchStage.BISECTION, states)
            if unsafe:
                rattling, states = middle, found
            else:
                clean = middle
        return rattling, clean, states

    def _raise(self, rattling: float, clean: float, states: list[Any],
               safe_end: float) -> tuple[float, float, Any]:
        """Carry what rattles towards the safe end until nothing of it survives a step."""
        step = math.copysign(2 * self.resolution, clean - rattling)
        while True:
            unsafe, found = self._try(clean, SearchStage.CARRIED, states)
            if not unsafe:
                return rattling, clean, states
            rattling, states = clean, found
            if rattling == safe_end:
                return rattling, math.nan, states
            clean = rattling + step
            if (safe_end - clean) * step < 0:
                clean = safe_end

    def _try(self, value: float, stage: SearchStage, carried: Any = (), only: bool = False,
             times: int = 1) -> tuple[bool, Any]:
        """Whether some motion at a value rattles (or fails), and where those that rattle ended."""
        osc = self.oscillator_at(value)
        pick = np.linspace(0, len(carried) - 1, min(CARRIED, len(carried))).round().astype(int)
        starts = [fitted(osc, carried[i]) for i in np.unique(pick)]
        if not only:
            starts = start_grid(osc, self.grid, self.phase) + starts
        cycles = times * self.settle, self.record
        common: Any = {"numerics": self.numerics, "threads": self.threads}
        fates = follow([osc] * len(starts), starts, *cycles, **common) \
            if self.records is None else self.records.follow(osc, starts, *cycles, **common)
        self.trials.append(Trial(value, stage, len(starts), int(fates.rattles.sum()),
                                 int(fates.failed.sum())))
        states = [fates.final[i] for i in np.flatnonzero(fates.rattles)]
        return bool(states) or bool(fates.failed.any()), states
