"""What shards need of the study they are parts of, whatever is done in its runs."""

from __future__ import annotations

import threading
from collections.abc import Callable
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple

from numpy.typing import NDArray

from lapwing.results.shards import Shard, write_study
from lapwing.studies.map.cut import Cut, Cuts


class Dropped(Exception):
    """A shard under way that is given up."""


class Made(NamedTuple):
    """Numbers of a shard, and the state (motion state or REST, phi, phi') it hands over."""

    data: dict[str, NDArray[Any]]
    handed: tuple[float, ...] | None


class Task:
    """Runs that are cut into shards. A class for each kind of study says what is done in them.

    Attributes
    ----------
    grid : what `Grid` says of its runs: kind, axes, order, runs, length, besides
    start : 'rest', 'up' or 'down': whether runs go on from each other, and which way
    shard_runs : int, runs of a shard
    identity : str, SHA-256 of every value that the numbers of the study, and its cut, follow from
    kept : dict of variable of a shard -> dtype
    run_bytes : int, what a run takes of memory in the whole study
    thread_bytes : int, what each thread takes beside that, as far as it is known
    about : dict, what a study says of how it was made
    unit : str, what its runs are called where it is not what its results have; empty: it is
    """

    unit = ""

    grid: Any
    start: str
    shard_runs: int
    identity: Any
    run_bytes: Any
    thread_bytes: Any = 0

    @property
    def kept(self) -> dict[str, Any]:
        """See `Task`."""
        raise NotImplementedError

    @property
    def about(self) -> dict[str, Any]:
        """See `Task`."""
        raise NotImplementedError

    def carried_out(self, index: int, progress: Callable[[float], None] | None = None,
                    stop: threading.Event | None = None, before: Shard | None = None,
                    share_work: Callable[[int], int] = lambda _: 1) -> Made:
        """One shard, from the state that the shard before hands over, if any.

        Parameters
        ----------
        index : int
        progress : callable(fraction done) or None
        stop : set by whoever wants no more of it
        before : Shard or None, of a chain the one before
        share_work : callable(lines) -> threads that compute it; no number depends on it

        Raises
        ------
        Dropped
            soon after `stop` is set.
        """
        raise NotImplementedError

    def prepare(self) -> None:
        """Make what all shards need, before there are several threads; nothing by default."""

    @cached_property
    def cut(self) -> Cut | Cuts:
        """Which runs are in which shard."""
        return Cut(self.grid.runs, self.shard_runs, self.grid.length, self.start)

    def told(self, index: int, before: Shard | None = None) -> dict[str, Any]:
        """What a shard's file says of itself, given the one that it goes on from."""
        first, stop = self.cut.place(index)
        return {"inputs": self.identity, "first": first, "stop": stop,
                **({"predecessor": before.digest} if before else {})}

    def write_study(self, folder: Path) -> None:
        """Say in a folder what its shards are parts of."""
        write_study(folder, self.grid.axes, {
            "kind": self.grid.kind, "inputs": self.identity, "order": " ".join(self.grid.order),
            "besides": " ".join(self.grid.besides), **self.about})


__all__ = ["Dropped", "Made", "Task"]
