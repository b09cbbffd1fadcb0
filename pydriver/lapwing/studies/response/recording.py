"""Whole mesh cycles of one motion: events, statistics and samples, in one pass or in pieces of it.

Where a pass is cut changes no bit: a piece hands over the engine's whole state, and what the next
one needs of what was recorded already.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from lapwing import engine
from lapwing.base.codes import Status
from lapwing.engine import TrajectoryCall, Wanted, named, numbers, unknown
from lapwing.engine.calls import BLOB_SIZE
from lapwing.engine.records import (
    CYCLE_TABLE,
    EVENT,
    EVENT_TABLE,
    MEAN_TABLE,
    SAMPLE,
    SAMPLE_TABLE,
    tangent_table,
)
from lapwing.studies.response.mesh_force import contact_forces

if TYPE_CHECKING:
    from lapwing.engine.numerics import Numerics
    from lapwing.model.oscillator import Oscillator


@dataclass(frozen=True)
class Recording:
    """Tables of events (n,), cycles (count,), samples (count·grid + 1,); the phases sampled.

    `means` are Θ and Θ' of the cycles and of the samples, None with one degree of freedom; `forces`
    those of `contact_forces`, (2, count).

    Cycles are counted from the first recorded one; the last sample is the end of the last cycle.
    """

    status: Status
    grid: np.ndarray
    events: np.ndarray
    cycles: np.ndarray
    samples: np.ndarray
    forces: np.ndarray
    means: tuple[NDArray[Any] | None, NDArray[Any] | None] = (None, None)
    tangent: np.ndarray | None = None


class Piece(NamedTuple):
    """A part of a pass.

    Attributes
    ----------
    status : Status; behind one that is not OK nothing follows
    tables : dict of name -> array (n, columns) of the tables of `Recording`, what there is of them
    handed : what the next piece goes on from: status, state of the engine, the last sample, and the
        events met of cycles that are the next piece's
    """

    status: Status
    tables: dict[str, NDArray[np.float64]]
    handed: tuple[float, ...]


@dataclass(frozen=True, eq=False)
class Pass:
    """A motion to be followed over `span[0]` cycles, and the `span[1]` next ones to be recorded.

    The cycle before the first recorded one is watched already, for an impact counts with the
    whole flight before it; and one cycle more is run, for the state at which the last one ends.

    Attributes
    ----------
    osc : Oscillator
    start : state as the engine takes it, and mesh phase
    span : int, int, mesh cycles
    grid : (n,) array of phases to sample
    numerics : Numerics
    exponents : bool, whether tangent maps are recorded
    """

    osc: Oscillator
    start: tuple[float, float, float, float]
    span: tuple[int, int]
    grid: NDArray[Any]
    numerics: Numerics
    exponents: bool = False

    @property
    def cycles(self) -> int:
        """Mesh cycles that are run."""
        return sum(self.span) + 1

    def piece(self, begin: int, end: int, before: tuple[float, ...] | None = None,
              told: Callable[[float], object] = lambda _: None) -> Piece:
        """Mesh cycles `begin` to `end`, from what the piece before hands over.

        Parameters
        ----------
        begin, end : int, the first and the one behind the last; recorded ones begin at whole
            batches of `mesh_force`, for forces to be the same to the bit
        before : `Piece.handed`, None of the first
        told : callable(fraction done), called again and again
        """
        first, count = self.span
        watched, columns = max(0, first - 1), len(SAMPLE) + 2 * self._has_means
        status, blob, start = Status.OK, None, self.start
        sample, early = np.full((1, columns), np.nan), np.empty((0, len(EVENT)))
        if before is not None:
            code, *parts = np.split(np.array(before), [1, 1 + BLOB_SIZE, 1 + BLOB_SIZE + columns])
            status, blob, start = Status(int(code[0])), parts[0], (engine.GO_ON, 0, 0, 0)
            sample, early = parts[1].reshape(1, -1), parts[2].reshape(-1, len(EVENT))

        def between(cycle: int) -> None:
            told((cycle - begin) / (end - begin))

        tables: dict[str, NDArray[np.float64]] = {}
        if status == Status.OK and begin < watched:
            call = TrajectoryCall(self.osc, start, blob, begin, numerics=self.numerics,
                                  wanted=Wanted())
            status = call.run((min(end, watched), 0.0), [], between).status
            start, blob = (engine.GO_ON, 0, 0, 0), call.blob
        if status == Status.OK and end > watched:
            low, high = max(begin, first), min(end, first + count)
            times = np.column_stack([np.repeat(np.arange(low, high), self.grid.size),
                                     np.tile(self.grid * self.osc.period, high - low)])
            times = np.vstack([times, (high, 0.0)])
            if before is not None and begin == low:  # sampled where the piece before ended
                times = times[1:]
            call = TrajectoryCall(
                self.osc, start, blob, max(begin, watched), numerics=self.numerics,
                wanted=Wanted(events=True, cycles=True, tangent=self.exponents))
            call.run((end, 0.0), times, between)
            status, blob = call.status, call.blob
            if status == Status.OK:
                tables, sample, early = self._tables(call, (low, high), sample, early, told)
        return Piece(status, tables, (
            float(status), *(np.zeros(BLOB_SIZE) if blob is None else blob), *sample[0],
            *early.ravel()))

    @property
    def _has_means(self) -> bool:
        return self.osc.mean_rotation is not None

    def _tables(self, call: TrajectoryCall, place: tuple[int, int], before: NDArray[Any],
                early: NDArray[Any], told: Callable[[float], object]) -> tuple[
                    dict[str, NDArray[Any]], NDArray[Any], NDArray[Any]]:
        """Tables of the cycles from `place[0]` up to `place[1]`, last sample, and events beyond.

        `before` is the sample that the piece before ended with, `early` the events beyond it.
        """
        (low, high), (first, count) = place, self.span
        events = np.vstack([early, numbers(call.events)])
        samples = numbers(call.samples)
        if call.sample_means is not None:
            samples = np.hstack([samples, numbers(call.sample_means)])
        whole = samples if len(samples) > (high - low) * self.grid.size else np.vstack(
            [before, samples])
        cycle = events[:, list(EVENT).index("cycle")]
        here = (cycle >= low) & (cycle < high)
        tables = {"events": events[here], "samples": samples}
        rows = (call.cycles["cycle"] >= first) & (call.cycles["cycle"] < first + count)
        tables["cycles"] = numbers(call.cycles[rows])
        if call.cycle_means is not None:
            tables["cycle_means"] = numbers(call.cycle_means[rows])
        if call.tangent is not None:
            tables["tangent"] = numbers(call.tangent[rows])
        local = named(events[here], EVENT_TABLE)
        local["cycle"] -= low
        tables["forces"] = contact_forces(
            self.osc, self.grid, named(whole[:, :len(SAMPLE)], SAMPLE_TABLE), local,
            high - low, told).T
        return tables, samples[-1:] if len(samples) else before, events[cycle >= high]

    def recording(self, pieces: Sequence[tuple[Status, dict[str, NDArray[Any]]]]) -> Recording:
        """What all pieces come to, in their order: status and tables of each; they are used up."""
        count, size = self.span[1], self.span[1] * self.grid.size + 1
        status = next((one for one, _ in pieces if one != Status.OK), Status.OK)
        if status != Status.OK:
            lost = tuple(unknown(MEAN_TABLE, n) if self._has_means else None
                         for n in (count, size))
            return Recording(status, self.grid, unknown(EVENT_TABLE, 0),
                             unknown(CYCLE_TABLE, count), unknown(SAMPLE_TABLE, size),
                             np.full((2, count), np.nan), (lost[0], lost[1]))

        def joined(name: str) -> NDArray[Any]:
            found = [tables.pop(name) for _, tables in pieces if name in tables]
            return found[0] if len(found) == 1 else np.vstack(found)

        events, cycles = named(joined("events"), EVENT_TABLE), named(joined("cycles"), CYCLE_TABLE)
        for table in (events, cycles):
            table["cycle"] -= self.span[0]
        samples, own = joined("samples"), len(SAMPLE)
        means: tuple[NDArray[Any] | None, NDArray[Any] | None] = (None, None)
        if self._has_means:
            means = named(joined("cycle_means"), MEAN_TABLE), named(samples[:, own:], MEAN_TABLE)
        tangent = named(joined("tangent"), tangent_table(2 + 2 * self._has_means)) \
            if self.exponents else None
        return Recording(status, self.grid, events, cycles, named(samples[:, :own], SAMPLE_TABLE),
                         joined("forces").T, means, tangent)

    def whole(self) -> Recording:
        """The recording, in one piece."""
        made = self.piece(0, self.cycles)
        return self.recording([(made.status, made.tables)])


__all__ = ["Pass", "Piece", "Recording"]
