"""Keys of &basins: a plane of starts of one oscillator."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any, Literal

from pydantic import Field

from lapwing.deck.checks.magnitudes import warn_of_torques
from lapwing.deck.deck import Asked
from lapwing.deck.declare import (
    NAME_PATTERN,
    Group,
    OperationKeys,
    StudyKeys,
    figures_key,
    figures_of,
    key,
)

if TYPE_CHECKING:
    from lapwing.deck.checks.assemble import Studies
    from lapwing.deck.load import _GroupReader
    from lapwing.deck.problems import Report

Span = list[Annotated[float, Field(ge=-10, le=10)]] | None
# What a cell takes of memory, and of disk before compression.
CELL_BYTES, STORED_BYTES = 93, 8


def span(text: str, example: list[float]) -> Any:
    """A key that holds a range of angles or of their rates."""
    return key(None, text, "rad", example, min_length=2, max_length=2)


class EndKeys(Group):
    """By what the end of a run is known; checks that studies of ends share."""

    most_cycles: int = key(1000, "mesh cycles after which a run that is no motion known is looked "
                           "at, or given up as not resolved", ge=1, le=10_000_000)
    returns: int = key(30, "returns to a periodic motion, each nearer than the one before, from "
                       "which it is presumed", ge=1, le=1_000_000)
    recurrences: int = key(50, "mesh cycles running in the cells of an aperiodic motion, from "
                           "which it is presumed", ge=1, le=1_000_000)
    resolution: int = key(256, "cells of an aperiodic motion's section along φ and along dφ/dτ",
                          ge=16, le=4096)

    def check_spans(self, reader: _GroupReader, report: Report, names: tuple[str, ...]) -> None:
        """Ranges begin with their lower end."""
        for name in names:
            ends = getattr(self, name)
            if ends is not None and not ends[0] < ends[1]:
                report.add(reader.places[name], f"{name} = {ends[0]:g}, {ends[1]:g}, expected the "
                                                "lower end first")

    def check_laws(self, reader: _GroupReader, report: Report, operation: dict[str, Any]) -> None:
        """Which degrees of freedom and contact law go with it."""
        if operation.get("degrees_of_freedom", 1) != 1:
            report.add(reader.place, f"&{reader.name} goes with degrees_of_freedom = 1")
        phi: Any = getattr(self, "phi", None)
        if phi is not None and operation.get("contact_law") == "rigid" and phi[1] > 0:
            report.add(reader.places["phi"], f"phi up to {phi[1]:g}, but contact_law = 'rigid' "
                                             "lets no tooth into a flank: expected 0 at most")


class BasinsKeys(EndKeys, OperationKeys, StudyKeys):
    """Which start leads to which attractor."""

    title = "which start of a plane leads to which attractor; any number of them"
    default_rtol = 1e-8

    name: str = key(text="names its figure and its part of the summary; letters, digits, . _ -",
                    example="at_12", pattern=NAME_PATTERN, max_length=64)
    plane: Literal["state", "drive", "coast"] = key(
        "state", "φ to the right and dφ/dτ upwards at mesh phase start_phase; or arrivals at a "
        "flank, mesh phase and speed")
    x_count: int = key(400, "cells from left to right", ge=2, le=20_000)
    y_count: int = key(300, "cells upwards", ge=2, le=20_000)
    phi: Span = span("lowest and highest φ of 'state'; left out: the whole gap, and as deep into "
                       "the drive flank as a tooth presses in that falls through it",
                       [-2e-4, 1e-4])
    phi_dot: Span = span("lowest and highest dφ/dτ of 'state'; left out: the speed of that fall, "
                           "either way", [-1e-4, 1e-4])
    speed: Span = span("lowest and highest speed of arrivals, dφ/dτ; left out: from 0 to that of "
                         "a fall through the gap", [0.0, 1e-4])
    start_phase: float | None = key(None, "mesh phase of the plane of 'state'; left out: that of "
                                    "&numerics", example=0.0, ge=0, lt=1)
    shard_runs: int | None = key(
        None, "cells of a shard, the part of the work that is kept at once; left out: at least 64 "
        "shards; no result depends on it", example=10_000, ge=1, le=10_000_000)
    rtol: float | None = key(None, "relative tolerance; left out: that of &numerics, else 1e-8",
                             example=1e-8, ge=1e-13, le=1e-2)
    figures: figures_of("basins") | None = figures_key()  # type: ignore[valid-type]

    def build(self, builder: Studies, reader: _GroupReader) -> Asked | None:
        """See `StudyKeys`: the plane, and the oscillator."""
        report = builder.report
        self.check_spans(reader, report, ("phi", "phi_dot", "speed"))
        for name in ("phi", "phi_dot", "speed"):
            if getattr(self, name) is not None and (name == "speed") == (self.plane == "state"):
                report.add(reader.key_places[name], f"{name} does not go with plane = "
                                                    f"'{self.plane}'")
        if self.speed is not None and self.speed[0] < 0:
            report.add(reader.places["speed"], f"speed = {self.speed[0]:g}, expected speeds "
                                               "towards the flank, from 0")
        if self.start_phase is not None and self.plane != "state":
            report.add(reader.key_places["start_phase"], "start_phase does not go with plane = "
                                                         f"'{self.plane}'")
        if not builder.ready:
            return None
        operation = builder.own_operation(self)
        warn_of_torques(reader, builder.pair, operation, None, report)
        oscillator = builder.oscillator(reader, builder.pair, operation)
        self.check_laws(reader, report, operation)
        if oscillator is not None and self.plane == "coast" and oscillator.gap == "one_flank":
            report.add(reader.places["plane"], "plane = 'coast', but gap = 'one_flank' has no "
                                               "coast flank")
        phase = builder.start_phase if self.start_phase is None else self.start_phase
        return Asked("basins", self, operation, builder.rtol(reader), {"phase": float(phase)})

    def used(self, asked: Asked) -> dict[str, Any]:
        """See `StudyKeys`."""
        return super().used(asked) | (
            {"start_phase": asked.phase} if self.plane == "state" else {})

    def canonical(self, values: dict[str, Any], asked: Asked) -> dict[str, Any]:
        """See `StudyKeys`: how the work is cut decides nothing."""
        return {name: value for name, value in values.items() if name != "shard_runs"}

    def memory(self, asked: Asked) -> tuple[int, str]:
        """See `StudyKeys`."""
        return CELL_BYTES * self.x_count * self.y_count, "x_count or y_count"

    def disk(self, asked: Asked) -> tuple[int, int]:
        """See `StudyKeys`."""
        return STORED_BYTES * self.x_count * self.y_count, 1
