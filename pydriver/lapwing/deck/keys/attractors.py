"""Keys of &attractors: random starts along a parameter."""

from __future__ import annotations

from typing import TYPE_CHECKING

from lapwing.deck.checks.ranges import range_values
from lapwing.deck.deck import Asked
from lapwing.deck.declare import (
    NAME_PATTERN,
    AlongKeys,
    figures_key,
    figures_of,
    key,
    parameter_name,
)
from lapwing.deck.keys.basins import EndKeys, Span, span

if TYPE_CHECKING:
    from lapwing.deck.checks.assemble import Studies
    from lapwing.deck.load import _GroupReader

# Of an attractor at a value in the result, and so many of them there, at a guess.
ENTRY_BYTES, FEW = 1800, 8


class AttractorsKeys(EndKeys, AlongKeys):
    """In what random starts end, along a parameter."""

    title = "in which motions random starts end, along one parameter; any number of them"
    default_rtol = 1e-8

    name: str = key(text="names its figure and its part of the summary; letters, digits, . _ -",
                    example="torque", pattern=NAME_PATTERN, max_length=64)
    parameter: str = key("brake_torque", "a real number of &gear_pair or &operation; attractors "
                         "are followed from each value to the next higher one")
    runs: int = key(256, "random starts at each value", ge=1, le=1_000_000)
    seed: int = key(0, "decides them", ge=0, le=2**31 - 2)
    phi: Span = span("lowest and highest φ of the starts; left out: the whole gap, and as deep "
                     "into the drive flank as a tooth presses in that falls through it",
                     [-2e-4, 1e-4])
    phi_dot: Span = span("lowest and highest dφ/dτ of the starts; left out: the speed of that "
                         "fall, either way", [-1e-4, 1e-4])
    rtol: float | None = key(None, "relative tolerance; left out: that of &numerics, else 1e-8",
                             example=1e-8, ge=1e-13, le=1e-2)
    figures: figures_of("attractors") | None = figures_key()  # type: ignore[valid-type]

    def build(self, builder: Studies, reader: _GroupReader) -> Asked | None:
        """See `StudyKeys`: the values, and oscillators at both ends of them."""
        name = parameter_name(self.parameter)
        group = builder.parameter(reader, name)
        values = range_values(reader, builder.report)
        self.check_spans(reader, builder.report, ("phi", "phi_dot"))
        if group is None or values is None:
            return None
        name = name.rpartition(".")[2]
        builder.check_values(reader, name, group, values)
        if not builder.ready:
            return None
        operation = {k: v for k, v in builder.operation.items() if k != name}
        builder.check_ends(reader, {name: (group, values)}, operation)
        self.check_laws(reader, builder.report, operation)
        return Asked("attractors", self, operation, builder.rtol(reader),
                     {"parameter": name, "group": group, "values": values})

    def memory(self, asked: Asked) -> tuple[int, str]:
        """See `StudyKeys`."""
        return FEW * ENTRY_BYTES * asked.values.size, "the number of values"

    def disk(self, asked: Asked) -> tuple[int, int]:
        """See `StudyKeys`."""
        return FEW * ENTRY_BYTES * asked.values.size, 1
