"""One trajectory: followed, continued, recorded."""

from lapwing.studies.trajectory.result import HybridState, Run
from lapwing.studies.trajectory.run import run_from, simulate
from lapwing.studies.trajectory.start import checked_start, engine_start

__all__ = ["HybridState", "Run", "checked_start", "engine_start", "run_from", "simulate"]
