"""A sweep in blocks of points, so that its log takes the memory of what happened.

The engine wants room for each point's log that is as large as any may get. It is one buffer for a
block of points, which is emptied into a list, and goes on to the next block.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lapwing.base import estimates
from lapwing.base.codes import Status
from lapwing.engine.records import EVENT, EVENT_TABLE


def cut(lines: NDArray[Any], most: int) -> Iterator[NDArray[Any]]:
    """Blocks of about so many points: of each long line a piece, and some of the short ones.

    Parameters
    ----------
    lines : array (n, 3), first and last point of each, and whether it is carried
    most : int

    Yields
    ------
    array (pieces, 4), first and last point, the line's number, and whether the line begins here
    """
    first, last = lines[:, 0], lines[:, 1]
    counts, way = np.abs(last - first) + 1, np.where(last < first, -1, 1)
    blocks = -(-int(counts.sum()) // most)
    number = np.arange(len(lines))
    # Short ones are cut as if they were one behind the other.
    short = counts < blocks
    length = np.where(short, counts[short].sum(), counts)
    offset = (np.cumsum(counts * short) - counts) * short
    for block in range(blocks):
        begin = np.maximum(length * block // blocks - offset, 0)
        end = np.minimum(length * (block + 1) // blocks - offset, counts)
        here = begin < end
        if np.any(here):
            yield np.column_stack([first + way * begin, first + way * (end - 1), number,
                                   begin == 0])[here]


def points_of(pieces: NDArray[Any]) -> NDArray[np.intp]:
    """The points of some pieces, rising."""
    low, high = np.sort(pieces[:, :2], axis=1).T
    return np.sort(np.concatenate([np.arange(a, b + 1) for a, b in zip(low, high, strict=True)]))


class Logs:
    """Logs of points as one list.

    Attributes
    ----------
    kept : array (points,), how many lines of each point are listed

    Parameters
    ----------
    points : int
    table : dtype, the columns kept of `records.EVENT_TABLE`
    """

    def __init__(self, points: int, table: np.dtype[Any] = EVENT_TABLE) -> None:
        self.kept = np.zeros(points, dtype=np.int64)
        self._table = table
        self._parts: list[tuple[NDArray[np.intp], NDArray[Any]]] = []

    def take(self, points: NDArray[np.intp], outcome: NDArray[Any], log: NDArray[Any]) -> None:
        """List what some points, rising, have met.

        Parameters
        ----------
        points : array (n,)
        outcome : array (columns, n), status and lines met first
        log : array (columns, room, n)

        Raises
        ------
        MemoryError
            where the list of all that was met up to here cannot fit.
        """
        room = log.shape[1]
        known = outcome[0] != Status.UNFINISHED
        kept = np.where(known, np.minimum(np.nan_to_num(outcome[1]), room), 0).astype(np.int64)
        self.kept[points] = kept
        estimates.require(int(self.kept.sum()) * self._table.itemsize, "sweep",
                          "the number of values or of starts, or max_impacts")
        rows = log.T[np.arange(room) < kept[:, None]]
        part = np.empty(len(rows), dtype=self._table)
        for name in part.dtype.names or ():
            part[name] = rows[:, list(EVENT).index(name)]
        self._parts.append((points, part))

    def listed(self) -> NDArray[Any]:
        """The list, table (n,): those of a point stand together, the points in order."""
        if len(self._parts) == 1 and len(self._parts[0][0]) == len(self.kept):
            return self._parts.pop()[1]
        found = np.empty(int(self.kept.sum()), dtype=self._table)
        first = np.cumsum(self.kept) - self.kept
        while self._parts:
            points, part = self._parts.pop()
            kept = self.kept[points]
            within = np.arange(len(part)) - np.repeat(np.cumsum(kept) - kept, kept)
            found[np.repeat(first[points], kept) + within] = part
        return found
