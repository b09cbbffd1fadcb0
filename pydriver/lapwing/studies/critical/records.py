"""The trials of a search, one record each, that outlive the process that made them."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import asdict, fields
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from lapwing.model.transmission_error.algebra import parts_of
from lapwing.results.shards import inputs_digest
from lapwing.studies import records
from lapwing.studies.critical.starts import Fates, follow

if TYPE_CHECKING:
    from lapwing.engine.numerics import Numerics
    from lapwing.model.oscillator import Oscillator


class Records(records.Records):
    """What became of the motions of each trial, kept in a folder in the order of the trials.

    Parameters
    ----------
    folder : path, made where missing
    notes, owner : as of `studies.records.Records`
    """

    def __init__(self, folder: Path, notes: Callable[[str], object] | None = None,
                 owner: str = "") -> None:
        super().__init__(folder, "trial", notes, owner)

    def follow(self, osc: Oscillator, starts: list[tuple[float, float, float, float]], settle: int,
               record: int, *, numerics: Numerics, threads: int) -> Fates:
        """As `starts.follow` of one oscillator, or read; `Fates.back_at` is not kept.

        Raises
        ------
        OSError
            where the record cannot be written.
        """
        return self.taken(
            identity(osc, np.array(starts), settle=settle, record=record,
                     numerics=asdict(numerics)),
            lambda: follow([osc] * len(starts), starts, settle, record, numerics=numerics,
                           threads=threads), _packed, _unpacked)


def _packed(fates: Fates) -> dict[str, NDArray[Any]]:
    return {"rattles": fates.rattles.astype(np.int8), "failed": fates.failed.astype(np.int8),
            "back_cycles": fates.back_cycles, "final": np.array(fates.final).reshape(-1, 4)}


def _unpacked(data: Mapping[str, NDArray[Any]]) -> Fates:
    return Fates(data["rattles"] == 1, data["back_cycles"], data["failed"] == 1,
                 [tuple(row) for row in data["final"].tolist()])


def identity(osc: Oscillator, numbers: NDArray[Any], **others: Any) -> str:
    """SHA-256 of every value that a record follows from: an oscillator, numbers, and others."""
    return inputs_digest({
        **{one.name: getattr(osc, one.name) for one in fields(osc) if one.name != "te"},
        **others}, *parts_of(osc.te), numbers)
