"""Keys of &response."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Literal

from lapwing.base import estimates
from lapwing.deck.checks.magnitudes import warn_of_torques
from lapwing.deck.deck import Asked
from lapwing.deck.declare import (
    NAME_PATTERN,
    OperationKeys,
    StudyKeys,
    figures_key,
    figures_of,
    key,
)
from lapwing.model.start import start_problem

if TYPE_CHECKING:
    from lapwing.deck.checks.assemble import Studies
    from lapwing.deck.load import _GroupReader
    from lapwing.deck.problems import Report
    from lapwing.model.oscillator import Oscillator


class ResponseKeys(OperationKeys, StudyKeys):
    """One trajectory, examined closely."""

    title = "one trajectory, examined closely; any number of them"
    default_rtol = 1e-8

    name: str = key(text="names its figures and its line in the summary; letters, digits, . _ -",
                    example="torque_1.8", pattern=NAME_PATTERN, max_length=64)
    start: Literal["rest", "separation", "engagement", "back_engagement"] = key(
        "rest", "'rest', or a motion state with start_phi and start_phi_dot")
    start_phi: float | None = key(None, "φ at the start, counted from the moving drive flank: > 0 "
                                  "pressed, from -gap to 0 separated, below -gap back contact; "
                                  "needed with a motion state", "rad", -1e-4, ge=-10, le=10)
    start_phi_dot: float | None = key(None, "dφ/dτ at the start, τ = ω'·t, that is (dφ/dt)/ω' with "
                                      "the natural frequency ω' = √(k/J) in rad/s; left out with "
                                      "a motion state: 0", "rad", 0.0, ge=-10, le=10)
    settle_cycles: int = key(400, "mesh cycles before recording", ge=0, le=10_000_000)
    record_cycles: int = key(100, "mesh cycles recorded", ge=1, le=1_000_000)
    samples_per_cycle: int = key(400, "samples of the time history in a mesh cycle", ge=8,
                                 le=100_000)
    exponents: bool = key(True, "whether Floquet multipliers and Lyapunov exponents are found")
    rtol: float | None = key(None, "relative tolerance; left out: that of &numerics, else 1e-8",
                             example=1e-8, ge=1e-13, le=1e-2)
    claim_impacts_per_cycle: float | None = key(
        None, "what somebody else reports: impacts per mesh cycle", example=3.0, ge=0, le=1e6)
    claim_deepest_separation: float | None = key(
        None, "what somebody else reports: deepest separation", "rad", 0.00063, ge=0, le=10)
    claim_text: str | None = key(None, "what somebody else reports, in words",
                                 example="3 impacts per cycle, period 1", max_length=500)
    figures: figures_of("response") | None = figures_key()  # type: ignore[valid-type]

    def build(self, builder: Studies, reader: _GroupReader) -> Asked | None:
        """See `StudyKeys`: the start, and the oscillator it belongs to."""
        start = self._start(reader, builder.report)
        if not builder.ready:
            return None
        operation = builder.own_operation(self)
        warn_of_torques(reader, builder.pair, operation, None, builder.report)
        oscillator = builder.oscillator(reader, builder.pair, operation)
        if oscillator is not None:
            self._check_start(builder, reader, oscillator, start)
        return Asked("response", self, operation, builder.rtol(reader), {"start": start})

    def _start(self, reader: _GroupReader, report: Report) -> Any:
        if self.start == "rest":
            for name in ("start_phi", "start_phi_dot"):
                if name in reader.places:
                    report.add(reader.key_places[name],
                               f"{name} goes with a motion state as start, not with 'rest'")
            return "rest"
        if self.start_phi is None:
            report.add(reader.places["start"], f"start = '{self.start}' needs start_phi (rad)")
            return "rest"
        return self.start, float(self.start_phi), float(self.start_phi_dot or 0.0)

    def _check_start(self, builder: Studies, reader: _GroupReader, oscillator: Oscillator,
                     start: Any) -> None:
        """Decisions e and k of docs/model.md."""
        if start == "rest":
            if oscillator.force < 0 and oscillator.gap == "one_flank":
                builder.report.add(reader.place, "start = 'rest' with a negative force needs a "
                                                 "coast flank to rest on")
            return
        state, phi, _ = start
        problem = start_problem(oscillator, state, phi, builder.start_phase)
        if problem:
            builder.report.add(reader.places["start_phi"],
                               f"start_phi = {phi:g} contradicts start = '{state}': {problem}")

    def used(self, asked: Asked) -> dict[str, Any]:
        """See `StudyKeys`."""
        return super().used(asked) | (
            {"start_phi_dot": asked.start[2]} if self.start != "rest" else {})

    def memory(self, asked: Asked) -> tuple[int, str]:
        """See `StudyKeys`."""
        return (estimates.response_bytes(self.record_cycles, self.samples_per_cycle,
                                         self.exponents),
                "record_cycles or samples_per_cycle")

    def disk(self, asked: Asked) -> tuple[int, int]:
        """See `StudyKeys`."""
        cycle = self.samples_per_cycle * estimates.STORED_SAMPLE + estimates.STORED_CYCLE
        return self.record_cycles * cycle, 1
