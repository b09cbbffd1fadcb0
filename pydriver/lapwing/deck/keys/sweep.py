"""Keys of &sweep."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Literal

from lapwing.base import estimates
from lapwing.base.quantities import CURVE
from lapwing.deck.checks.axes import axis_of
from lapwing.deck.checks.magnitudes import warn_of_order, warn_of_torques
from lapwing.deck.deck import Asked
from lapwing.deck.declare import (
    NAME_PATTERN,
    AlongKeys,
    figures_key,
    figures_of,
    files_key,
    key,
    labels_key,
    without_files,
)

if TYPE_CHECKING:
    from lapwing.deck.checks.assemble import Studies
    from lapwing.deck.load import _GroupReader


class SweepKeys(AlongKeys):
    """One parameter over a range of values."""

    title = "one parameter over a range of values; any number of them"
    exclusive = (("values", "from", "files"),)

    name: str = key(text="names its figures and its part of the summary; letters, digits, . _ -",
                    example="torque", pattern=NAME_PATTERN, max_length=64)
    parameter: str = key(text="a real number of &gear_pair or &operation, as 'brake_torque' or "
                         "'operation.brake_torque'; 'harmonic_amplitude(2)'; or "
                         "'transmission_error.file' (section \"Sweeps\")", example="brake_torque")
    files: list[str] | None = files_key()
    labels: list[str] | None = labels_key()
    starts: list[Literal["rest", "up", "down"]] = key(
        ["rest", "up", "down"], "each value from rest; carried upwards; carried downwards (the "
        "first one of those from rest); along files 'rest' alone",
        min_length=1, max_length=3)
    settle_cycles: int = key(400, "mesh cycles before recording, at every value", ge=0,
                             le=10_000_000)
    record_cycles: int = key(100, "mesh cycles recorded at every value", ge=1, le=100_000)
    impacts: bool = key(True, "whether phase and speed of every impact are kept")
    order_spectra: bool = key(False, "whether order spectra are made, for a waterfall of them")
    amplitudes: bool = key(False, "whether rms and peak to peak of φ and of the dynamic "
                           "transmission error, and mean and peak mesh force are found, for a "
                           "figure of them against the parameter")
    speed_density: bool = key(False, "whether impacts of every speed are counted, for a figure of "
                              "their density")
    exponents: bool = key(False, "whether Lyapunov exponents are found, and Floquet multipliers "
                          "where the motion repeats")
    rtol: float | None = key(None, "relative tolerance; left out: that of &numerics, else 1e-6",
                             example=1e-6, ge=1e-13, le=1e-2)
    figures: figures_of("sweep") | None = figures_key()  # type: ignore[valid-type]

    def build(self, builder: Studies, reader: _GroupReader) -> Asked | None:
        """See `StudyKeys`: the values, and oscillators at both ends of them."""
        report = builder.report
        axis = axis_of(builder, reader, report)
        if axis is None:
            return None
        name, group, values, tables = axis
        starts = tuple(self.starts)
        if len(set(starts)) != len(starts):
            report.add(reader.places["starts"], "starts: expected each once")
        if name == CURVE:
            if "starts" in reader.places and set(starts) != {"rest"}:
                report.add(reader.places["starts"], "starts: nothing is carried along files, which "
                                                    "have no order; expected 'rest'")
            starts = ("rest",)
        if not builder.ready:
            return None
        operation = {k: v for k, v in builder.operation.items() if k != name}
        builder.check_ends(reader, {name: (group, values)}, operation, tables)
        warn_of_order(reader, report)
        if name == "brake_torque":
            warn_of_torques(reader, builder.pair, operation, values, report)
        return Asked("sweep", self, operation, builder.rtol(reader),
                     {"parameter": name, "group": group, "values": values, "starts": starts,
                      "tables": tables})

    def used(self, asked: Asked) -> dict[str, Any]:
        """See `StudyKeys`: of files no spacing, and the labels that they have."""
        own: dict[str, Any] = {"spacing": None, "labels": asked.values.tolist()} \
            if asked.tables else {}
        return super().used(asked) | {"starts": list(asked.starts)} | own

    def canonical(self, values: dict[str, Any], asked: Asked) -> dict[str, Any]:
        """See `StudyKeys`: files by their numbers."""
        return without_files(super().canonical(values, asked), asked)

    def memory(self, asked: Asked) -> tuple[int, str]:
        """See `StudyKeys`."""
        return (estimates.sweep_bytes(asked.values.size * len(asked.starts), self.record_cycles,
                                      impacts=self.impacts, exponents=self.exponents),
                "record_cycles, the number of values or of starts")

    def disk(self, asked: Asked) -> tuple[int, int]:
        """See `StudyKeys`."""
        points = asked.values.size * len(asked.starts)
        return points * self.record_cycles * estimates.STORED_CYCLE, 2
