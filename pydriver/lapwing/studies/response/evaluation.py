"""What a recording comes to: its numbers, period and class, and what is known of their errors."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from lapwing.base.arrivals import arrivals_of
from lapwing.base.codes import MotionState, Status
from lapwing.engine import columns, impacts_of
from lapwing.studies.intervals import mean_interval
from lapwing.studies.period import LABELS, find_period, motion_class
from lapwing.studies.response import motion

if TYPE_CHECKING:
    from lapwing.model.gear_pair import GearPair
    from lapwing.model.oscillator import Oscillator
    from lapwing.studies.response.recording import Recording

# Averages over cycles, and largest values over cycles.
MEANS = ("impacts_per_cycle", "back_impacts_per_cycle", "resolved_impacts_per_cycle",
         "resolved_back_impacts_per_cycle", "chatter_ends_per_cycle", "mesh_force_mean",
         "impact_force_mean", "impact_energy_per_cycle", *motion.SHARES)
PEAKS = ("deepest_separation", "deepest_back_penetration", "mesh_force_peak", "impact_speed_max")
# The difference of two runs is the error of the worse one, less the better one's: a quarter more
# (Roache 1994, J. Fluids Eng. 116, 405-413). Rounding: of the sums of a cycle's arcs.
SAFETY = 1.25
ROUNDING = 64 * float(np.finfo(float).eps)


@dataclass(frozen=True)
class Evaluation:
    """A recording, its statistics by cycle (dict of (record,) arrays), period and class."""

    recording: Recording
    by_cycle: dict[str, Any]
    period: int
    motion_class: str

    @classmethod
    def of(cls, osc: Oscillator, pair: GearPair, recording: Recording,
           max_period: int) -> Evaluation:
        """What a recording comes to."""
        column = recording.cycles
        by_cycle = _by_cycle(osc, pair, recording, column)
        labels = columns(column, LABELS)
        deepest = column["deepest_separation"].max()
        period = find_period(column["phi"], column["phi_dot"], labels,
                             max(abs(osc.force), deepest) or osc.backlash, max_period)
        name = "failed" if recording.status != Status.OK else motion_class(
            period, by_cycle[MEANS[0]], by_cycle[MEANS[1]],
            bool(np.any(by_cycle["chatter_ends_per_cycle"] > 0)))
        return cls(recording, by_cycle, period, name)

    def number(self, key: str, half: int | None = None) -> float:
        """One number of the summary, over all recorded cycles or their first or second half.

        Averages are over as many whole periods as there are (the last ones); each half as well.
        """
        values = self.by_cycle[key]
        window = len(values) if half is None else len(values) // 2
        if self.period and window >= self.period:
            window -= window % self.period
        if window == 0:
            return math.nan
        end = len(values) - window * (half == 0)
        if key in PEAKS:
            return float(np.max(values[end - window if half is not None else 0:end]))
        return float(np.mean(values[end - window:end]))

    def error(self, key: str, change: float) -> float:
        """What is known of a number's error: of one that repeats, or of an average (NaN: nothing).

        `change` is the difference from the other run.
        """
        if not self.period:
            return mean_interval(self.by_cycle[key]).half_width if key in MEANS else math.nan
        size = self.number(key)
        if key == "mesh_force_mean":
            size = np.fmax(abs(size), self.number("mesh_force_peak"))
        counted = key in MEANS[:5]
        return SAFETY * change + abs(self.transient(key)) \
            + (0.0 if counted else ROUNDING * abs(size))

    def transient(self, key: str) -> float:
        """The second half of the record less the first; NaN where it has no two."""
        return self.number(key, 1) - self.number(key, 0)

    @property
    def in_short(self) -> Motion:
        """How the run went and what it led to."""
        return Motion(self.recording.status, self.motion_class, self.number("impacts_per_cycle"),
                      self.number("deepest_separation"))


class Motion(NamedTuple):
    """How a run went and what it led to, in short.

    Attributes
    ----------
    status : Status, None where there was no run
    motion_class : str
    impacts_per_cycle : float
    deepest_separation : float, rad
    """

    status: Status | None
    motion_class: str
    impacts_per_cycle: float
    deepest_separation: float


def _by_cycle(osc: Oscillator, pair: GearPair, recording: Recording,
              column: NDArray[Any]) -> dict[str, NDArray[Any]]:
    """Arrays (record,) of every number whose mean or maximum is summarised."""
    newton = pair.mesh_stiffness * pair.pinion_base_lever
    record = len(recording.cycles)
    mean, peak = recording.forces
    force, energy = np.zeros(record), np.zeros(record)
    impacts = impacts_of(recording.events)
    cycle = impacts["cycle"].astype(int)
    before, after = impacts["velocity_before"], impacts["velocity_after"]
    np.add.at(force, cycle, newton * (before - after) / osc.period)
    np.add.at(energy, cycle, 0.5 * pair.torsional_stiffness * (before**2 - after**2))
    fastest = motion.fastest_arrivals(recording.events, record, pair.natural_frequency,
                                      osc.contact_law)
    if recording.status != Status.OK:
        force, energy, fastest = force * np.nan, energy * np.nan, fastest * np.nan
    law = arrivals_of(osc.contact_law)
    counts = (law.drive, law.coast, law.every_drive, law.every_coast)
    return {**dict(zip(MEANS[:4], (column[key] for key in counts), strict=True)),
            "chatter_ends_per_cycle": column["chatter_ends"] + column["back_chatter_ends"],
            "mesh_force_mean": newton * mean, "mesh_force_peak": newton * peak,
            "impact_force_mean": force, "impact_energy_per_cycle": energy,
            "deepest_separation": column["deepest_separation"],
            "deepest_back_penetration": column["deepest_back_penetration"],
            "states_visited": column["states_visited"], "impact_speed_max": fastest,
            **motion.shares_of_time(recording.events, column["motion_state"], osc.period)}


def findings(main: Evaluation, reference: Evaluation) -> dict[str, Any]:
    """The summary's numbers: each with the changes between runs and halves, and its error."""
    status = main.recording.status
    attrs: dict[str, Any] = {
             "status": int(status), "status_meaning": status.name.lower(),
             "status_reference": int(reference.recording.status), "period": main.period,
             "motion_class": main.motion_class, "motion_class_reference": reference.motion_class,
             "error_kind": "convergence" if main.period else "statistical"}
    for key in (*MEANS, *PEAKS):
        attrs[key] = main.number(key)
        attrs[f"{key}_change"] = abs(main.number(key) - reference.number(key))
        attrs[f"{key}_transient"] = main.transient(key)
        attrs[f"{key}_error"] = main.error(key, attrs[f"{key}_change"])
    visited = np.bitwise_or.reduce(main.by_cycle["states_visited"].astype(int)) \
        if status == Status.OK else 0
    return attrs | {"states_visited": int(visited),
                    "fully_engaged": int(visited == 1 << MotionState.ENGAGEMENT)}


__all__ = ["MEANS", "PEAKS", "Evaluation", "Motion", "findings"]
