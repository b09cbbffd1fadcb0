"""The trials of a search, one record each, that outlive the process that made them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, fields
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from lapwing.model.transmission_error.algebra import parts_of
from lapwing.results.shards import inputs_digest, read_shard, write_shard
from lapwing.studies.critical.starts import Fates, follow

if TYPE_CHECKING:
    from lapwing.engine.numerics import Numerics
    from lapwing.model.oscillator import Oscillator


class Records:
    """What became of the motions of each trial, kept in a folder in the order of the trials.

    Which trials there are follows from those before. A search that is begun again asks for the same
    ones, and reads what lies there of the same values and the same build.

    Parameters
    ----------
    folder : path, made where missing
    notes : callable(text) or None, told of records that were made again, and why
    """

    def __init__(self, folder: Path, notes: Callable[[str], object] | None = None) -> None:
        self._folder, self._notes, self._next = folder, notes or (lambda _: None), 0

    def follow(self, osc: Oscillator, starts: list[tuple[float, float, float, float]], settle: int,
               record: int, *, numerics: Numerics, threads: int) -> Fates:
        """As `starts.follow` of one oscillator, or read; `Fates.back_at` is not kept.

        Raises
        ------
        OSError
            where the record cannot be written.
        """
        index, self._next = self._next, self._next + 1
        told = {"inputs": identity(osc, np.array(starts), settle=settle, record=record,
                                   numerics=asdict(numerics))}
        shard, why = read_shard(self._folder, index, told)
        if why:
            self._notes(f"trial {index} {why}: made again")
        if shard is not None:
            data = shard.data
            return Fates(data["rattles"] == 1, data["back_cycles"], data["failed"] == 1,
                         [tuple(row) for row in data["final"].tolist()])
        fates = follow([osc] * len(starts), starts, settle, record, numerics=numerics,
                       threads=threads)
        write_shard(self._folder, index, {
            "rattles": fates.rattles.astype(np.int8), "failed": fates.failed.astype(np.int8),
            "back_cycles": fates.back_cycles, "final": np.array(fates.final).reshape(-1, 4)}, told)
        return fates


def identity(osc: Oscillator, numbers: NDArray[Any], **others: Any) -> str:
    """SHA-256 of every value that a record follows from: an oscillator, numbers, and others."""
    return inputs_digest({
        **{one.name: getattr(osc, one.name) for one in fields(osc) if one.name != "te"},
        **others}, *parts_of(osc.te), numbers)
