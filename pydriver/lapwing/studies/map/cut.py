"""How a map is cut into shards: a function of the map alone, never of a clock or the machine.

A shard is a row of runs. Runs that are carried along a line need the ones before: a shard is some
whole lines there, or, where a line is longer than a shard, a part of one; such a line is a chain of
shards, each of which begins with the state that the one before it hands over.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

# Mesh cycles of a shard unless the caller says how many runs: some 20 s of one core. A smaller map
# is cut into so many shards all the same, for as many threads to have work.
CYCLES, FEWEST = 4_000_000, 64
# To make a closed form over so many pieces of a table takes as long as some runs do: a shard has as
# many of those that share one as there are, up to so many.
LONG, SHARED = 10_000, 32


@dataclass(frozen=True)
class Cut:
    """Which runs are in which shard.

    Attributes
    ----------
    runs : int, of the map
    size : int, runs of a shard
    length : int, runs of a line
    start : 'rest', 'up' or 'down'
    """

    runs: int
    size: int
    length: int
    start: str

    @property
    def links(self) -> int:
        """Shards of a line, where it is a chain of more than one; else 1."""
        return 1 if self.start == "rest" else -(-self.length // self.size)

    @property
    def shards(self) -> int:
        """How many there are."""
        return -(-self.runs // self.size) if self.links == 1 \
            else self.runs // self.length * self.links

    @property
    def chains(self) -> int:
        """Groups of shards that depend on each other; single shards but for chains."""
        return self.shards // self.links

    def chain(self, index: int) -> range:
        """Shards of a chain, in the order in which they follow from each other."""
        return range(index * self.links, (index + 1) * self.links)

    def before(self, index: int) -> int | None:
        """The shard that one goes on from, or None."""
        return index - 1 if index % self.links else None

    def is_chained(self, index: int) -> bool:
        """Whether a shard is one of a chain of several."""
        return self.links > 1

    def place(self, index: int) -> tuple[int, int]:
        """First run of a shard, and the one behind its last."""
        if self.links == 1:
            first = index * self.size
            return first, min(first + self.size, self.runs)
        line, link = divmod(index, self.links)
        first, stop = link * self.size, min((link + 1) * self.size, self.length)
        if self.start == "down":
            first, stop = self.length - stop, self.length - first
        return line * self.length + first, line * self.length + stop

    def shard_of(self, runs: NDArray[np.int64]) -> NDArray[np.int64]:
        """The shard that holds each run."""
        if self.links == 1:
            return runs // self.size
        line, at = np.divmod(runs, self.length)
        if self.start == "down":
            at = self.length - 1 - at
        found: NDArray[Any] = line * self.links + at // self.size
        return found


@dataclass(frozen=True)
class Line:
    """One chain that is cut where its bounds say; see `Cut`.

    Attributes
    ----------
    bounds : tuple of int, rising, from 0 to the number of runs
    """

    bounds: tuple[int, ...]

    @property
    def runs(self) -> int:
        """How many it has."""
        return self.bounds[-1]

    @property
    def shards(self) -> int:
        """How many there are."""
        return len(self.bounds) - 1

    @property
    def links(self) -> int:
        """All of them are one chain."""
        return self.shards

    @property
    def chains(self) -> int:
        """There is one."""
        return 1

    def chain(self, index: int) -> range:
        """Its shards, in the order in which they follow from each other."""
        return range(self.shards)

    def before(self, index: int) -> int | None:
        """The shard that one goes on from, or None."""
        return index - 1 if index else None

    def place(self, index: int) -> tuple[int, int]:
        """First run of a shard, and the one behind its last."""
        return self.bounds[index], self.bounds[index + 1]


@dataclass(frozen=True)
class Cuts:
    """Several rows of runs one after the other, each with its own cut; see `Cut`."""

    parts: tuple[Cut | Line, ...]

    @property
    def shards(self) -> int:
        """How many there are."""
        return sum(part.shards for part in self.parts)

    @property
    def chains(self) -> int:
        """Groups of shards that depend on each other."""
        return sum(part.chains for part in self.parts)

    def chain(self, index: int) -> range:
        """Shards of a chain, in the order in which they follow from each other."""
        first = 0
        for part in self.parts:
            if index < part.chains:
                own = part.chain(index)
                return range(first + own.start, first + own.stop)
            index, first = index - part.chains, first + part.shards
        raise IndexError(index)

    def before(self, index: int) -> int | None:
        """The shard that one goes on from, or None."""
        part, own, _ = self._of(index)
        before = part.before(own)
        return None if before is None else index - own + before

    def place(self, index: int) -> tuple[int, int]:
        """First run of a shard, and the one behind its last."""
        part, own, runs = self._of(index)
        first, stop = part.place(own)
        return runs + first, runs + stop

    def is_chained(self, index: int) -> bool:
        """Whether a shard is one of a chain of several."""
        return self._of(index)[0].links > 1

    def _of(self, index: int) -> tuple[Cut | Line, int, int]:
        """The cut that a shard is of, its number there, and the runs before this cut's."""
        runs = 0
        for part in self.parts:
            if index < part.shards:
                return part, index, runs
            index, runs = index - part.shards, runs + part.runs
        raise IndexError(index)


def shard_size(runs: int, cycles: int, length: int, wanted: int | None) -> int:
    """Runs of a shard: as wanted, or by `CYCLES` and `FEWEST`.

    Of carried lines of `length` runs it is whole ones, where it holds one at all; a line is not cut
    for threads to have more work: its parts follow from each other.
    """
    most = max(1, CYCLES // max(cycles, 1))
    size = wanted or min(most, max(math.ceil(runs / FEWEST), length))
    return min(runs, math.ceil(size / length) * length if size >= length else size)


def shared_size(size: int, length: int, pieces: int) -> int:
    """Runs of a shard where the runs of a line, from rest, share a closed form.

    Parameters
    ----------
    size : int, runs of a shard, this left aside
    length : int, runs of a line
    pieces : int, of the longest table
    """
    if pieces < LONG or size >= SHARED:
        return size
    # Equal parts of a line, so that few shards have runs of two.
    return max(size, math.ceil(length / math.ceil(length / SHARED)))
