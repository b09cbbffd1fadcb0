"""What a study finds one after the other, each kept as soon as it is found.

How many there will be is not known beforehand, as of the trials of a search or of branches. Which
ones there are follows from those before: a study that is begun again asks for the same ones, and
takes those that lie there of the same values and the same build.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, TypeVar

from numpy.typing import NDArray

from lapwing.results.shards import read_shard, read_told, shards_in, write_shard

Thing = TypeVar("Thing")


class Records:
    """Records in the order in which they are asked for.

    Parameters
    ----------
    folder : Path, made where missing
    word : str, what one of them is
    notes : callable(text) or None, told of records that were made again, and why
    owner : str, whose records they are, by which `seconds_of` counts them; no number depends on it
    """

    def __init__(self, folder: Path, word: str, notes: Callable[[str], object] | None = None,
                 owner: str = "") -> None:
        self._folder, self._word, self._owner = folder, word, owner
        self._notes, self._next = notes or (lambda _: None), 0

    def taken(self, inputs: str, make: Callable[[], Thing],
              packed: Callable[[Thing], Mapping[str, NDArray[Any]]],
              unpacked: Callable[[Mapping[str, NDArray[Any]]], Thing]) -> Thing:
        """The next one, read where it lies there, else made and kept.

        Parameters
        ----------
        inputs : str, `shards.inputs_digest` of all values that it follows from
        make : callable()
        packed, unpacked : callable, to name -> array and back, bit for bit

        Raises
        ------
        OSError
            where it cannot be written.
        """
        index, self._next = self._next, self._next + 1
        told = {"inputs": inputs}
        shard, why = read_shard(self._folder, index, told)
        if why:
            self._notes(f"{self._word} {index} {why}: made again")
        if shard is not None:
            known = read_told(self._folder, index, "owner", "seconds")
            if known is not None and known["owner"] != self._owner:
                write_shard(self._folder, index, shard.data,
                            told | {"owner": self._owner, "seconds": known["seconds"]})
            return unpacked(shard.data)
        begun = time.monotonic()
        made = make()
        write_shard(self._folder, index, packed(made), told | {
            "owner": self._owner, "seconds": time.monotonic() - begun})
        return made


def seconds_of(folder: Path, owner: str) -> list[float]:
    """How long each record of an owner took, those of this build, s, on the clock."""
    told = (read_told(folder, index, "owner", "seconds") for index in shards_in(folder))
    return [float(one["seconds"]) for one in told if one is not None and one["owner"] == owner]


__all__ = ["Records", "seconds_of"]
