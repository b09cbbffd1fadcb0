"""The order of events of a periodic motion, read from the engine's log."""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import IntEnum
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lapwing.base.codes import BranchEvent as Happening
from lapwing.base.codes import EventKind
from lapwing.model.oscillator import Oscillator
from lapwing.studies.branch.motion.flank_motion import FlankMotion

__all__ = ["Arc", "Happening", "Layout", "of_log", "of_parts"]


class Arc(IntEnum):
    """What leads to an event."""

    FLIGHT = 0
    CONTACT = 1
    CHATTER = 2
    REST = 3


@dataclass(frozen=True, eq=False)
class Layout:
    """Events of one repetition in their order; the first follows on the last.

    Attributes
    ----------
    kind, flank, piece : int arrays (n,): `Happening`, `Flank`, `FlankMotion.piece`
    cycles : int, mesh cycles of a repetition
    arc : int array (n,), `Arc` that leads to each event
    """

    kind: NDArray[Any]
    flank: NDArray[Any]
    piece: NDArray[Any]
    cycles: int
    arc: NDArray[Any]

    @property
    def n(self) -> int:
        """Number of events."""
        return len(self.kind)

    @cached_property
    def table(self) -> NDArray[Any]:
        """Kind, flank, piece and arc as the engine takes them: int array (4, n)."""
        return np.asfortranarray([self.kind, self.flank, self.piece, self.arc], dtype=np.intc)

    @cached_property
    def before(self) -> NDArray[Any]:
        """Number of the event before each."""
        return np.roll(np.arange(self.n), 1)

    @cached_property
    def sign(self) -> NDArray[Any]:
        """1 at the drive flank, -1 at the coast flank."""
        return np.where(self.flank == 1, 1.0, -1.0)

    @cached_property
    def coast(self) -> NDArray[Any]:
        """Numbers of the events at the coast flank."""
        return np.flatnonzero(self.flank == 2)

    @cached_property
    def by_arc(self) -> dict[Arc, NDArray[Any]]:
        """Numbers of the events that each kind of arc leads to, without kinds there are none of."""
        found = {arc: np.flatnonzero(self.arc == arc) for arc in Arc}
        return {arc: events for arc, events in found.items() if len(events)}

    @cached_property
    def one_flank(self) -> NDArray[Any]:
        """Whether each event is at the flank of the one before."""
        found: NDArray[Any] = self.flank == self.flank[self.before]
        return found

    @cached_property
    def arrivals(self) -> NDArray[Any]:
        """Whether a tooth arrives."""
        found: NDArray[Any] = self.kind <= Happening.GO_ON
        return found

    @cached_property
    def chatters(self) -> bool:
        """Whether a chatter ends."""
        return bool(np.any(self.kind == Happening.CHATTER_END))

    def same(self, other: Layout) -> bool:
        """Whether the events are the same ones, on any pieces."""
        return (self.cycles == other.cycles and np.array_equal(self.kind, other.kind)
                and np.array_equal(self.flank, other.flank))

    def on_piece(self, event: int, piece: int) -> Layout:
        """One event on another piece."""
        pieces = self.piece.copy()
        pieces[event] = piece
        return replace(self, piece=pieces)

    def twice(self, pieces: int) -> Layout:
        """The same over two repetitions, with so many pieces in a mesh period."""
        later = np.append(self.piece, self.piece + pieces * self.cycles)
        return Layout(np.tile(self.kind, 2), np.tile(self.flank, 2), later, 2 * self.cycles,
                      np.tile(self.arc, 2))

    def columns_without(self, events: NDArray[Any]) -> NDArray[Any]:
        """Places of the unknowns, the parameter among them, of all events but some."""
        kept = np.setdiff1d(np.arange(self.n), events)
        return np.append(np.ravel([[2 * k, 2 * k + 1] for k in kept]), 2 * self.n).astype(int)

    def without(self, events: NDArray[Any], rigid: bool) -> Layout:
        """Some events taken out."""
        kept = np.setdiff1d(np.arange(self.n), events)
        return of_parts(self.kind[kept], self.flank[kept], self.piece[kept], self.cycles, rigid)

    def summed(self, speed: NDArray[Any], slow: float) -> NDArray[Any]:
        """Numbers of the last bounces of chatters that are slower; the first of each is none.

        What follows on a bounce until it has died out is one arc, however many are listed.
        """
        found: list[int] = []
        for end in np.flatnonzero(self.kind == Happening.CHATTER_END):
            k = int(self.before[end])
            while self.bounces[k] and self.bounces[self.before[k]] and abs(speed[k]) < slow:
                found.append(k)
                k = int(self.before[k])
        return np.array(sorted(found), dtype=int)

    @cached_property
    def bounces(self) -> NDArray[Any]:
        """Which events belong to a chatter that ends: array of bool."""
        found = np.zeros(self.n, dtype=bool)
        for end in np.flatnonzero(self.kind == Happening.CHATTER_END):
            # From the end backwards, once round at most.
            before = np.arange(end - 1, end - 1 - self.n, -1)
            other = np.flatnonzero((self.kind[before] != Happening.REBOUND)
                                   | (self.flank[before] != self.flank[end]))
            found[before[:other[0] if len(other) else None]] = True
        return found


def of_parts(kind: NDArray[Any], flank: NDArray[Any], piece: NDArray[Any], cycles: int,
             rigid: bool) -> Layout:
    """A layout from its events; the arcs follow."""
    kind = np.asarray(kind)
    leaves = (kind == Happening.RELEASE) | (kind == Happening.AT_KINK)
    arc = np.where(kind == Happening.CHATTER_END, int(Arc.CHATTER),
                   np.where(leaves, int(Arc.REST if rigid else Arc.CONTACT), int(Arc.FLIGHT)))
    return Layout(kind, np.asarray(flank), np.asarray(piece), cycles, arc)


def of_log(events: NDArray[Any], osc: Oscillator, motion: FlankMotion,
           cycles: int) -> tuple[Layout, NDArray[Any], NDArray[Any]]:
    """Layout, phases and speeds into the flank from lines of the engine's log.

    Parameters
    ----------
    events : structured array of `engine.records.EVENT`, one repetition
    osc : Oscillator
    motion : FlankMotion
    cycles : int

    Returns
    -------
    Layout, phases (n,) in mesh periods from the first cycle, speeds (n,) in rad per τ
    """
    rows: list[tuple[Any, ...]] = []
    pressed, rigid, last = osc.contact_law != "compliant", osc.contact_law == "rigid", (0.0, 0.0)
    for event in events:
        code = int(event["kind"])
        if code >= EventKind.KINK:
            continue
        flank = 2 - code % 2
        code -= flank - 1
        into = 1.0 if flank == 1 else -1.0
        place = (event["cycle"], event["t"])
        phase = event["cycle"] + event["t"] / osc.period
        speed = into * event["velocity_before"]
        resting = rigid and bool(rows) and rows[-1][0] in (Happening.CHATTER_END, Happening.GO_ON)
        if code == EventKind.IMPACT:
            rows.append((Happening.AT_KINK if resting else Happening.REBOUND, flank, phase, speed))
        elif place == last and rows and rows[-1][0] == Happening.AT_KINK:
            continue  # thrown off by the kink that struck it
        elif code == EventKind.ENGAGE:
            if pressed and rows and place == last and rows[-1][0] == Happening.REBOUND:
                rows[-1] = (Happening.GO_ON, *rows[-1][1:])
            else:
                rows.append((Happening.GO_ON, flank, phase, speed))
        elif code == EventKind.CHATTER_END:
            rows.append((Happening.CHATTER_END, flank, phase, 0.0))
        elif rigid and motion.pieces and phase == motion.begin(motion.piece(phase)):
            rows.append((Happening.AT_KINK, flank, phase, speed))
        else:
            rows.append((Happening.RELEASE, flank, phase, speed))
        last = place
    kinds, flanks = (np.array([row[i] for row in rows], dtype=int) for i in (0, 1))
    phases, speeds = (np.array([row[i] for row in rows], dtype=float) for i in (2, 3))
    return of_parts(kinds, flanks, motion.piece(phases), cycles, rigid), phases, speeds
