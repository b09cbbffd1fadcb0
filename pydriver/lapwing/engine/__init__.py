"""The compiled engine as Python sees it: calls, numerics, and what comes out by name."""

from lapwing.engine.calls import (
    CALL_SECONDS,
    GO_ON,
    MOST_LOOKED_FOR,
    REST,
    TrajectoryCall,
    find_period,
    flank_motion,
    position,
    thinned,
)
from lapwing.engine.destinations import END_TABLE, GOAL_TABLE, Known, destinations
from lapwing.engine.flanks import series_is_taken
from lapwing.engine.methods import common_method, method_of, steps
from lapwing.engine.numerics import METHODS, Numerics, Wanted, chosen
from lapwing.engine.points import Points
from lapwing.engine.records import (
    OUTCOME_TABLE,
    columns,
    impacts_of,
    named,
    numbers,
    of_kind,
    unknown,
    work_counts,
)
from lapwing.engine.sweeps import SweepResult, sweep

__all__ = ["CALL_SECONDS", "END_TABLE", "GOAL_TABLE", "GO_ON", "METHODS", "MOST_LOOKED_FOR",
           "OUTCOME_TABLE", "REST", "Known", "Numerics", "Points", "SweepResult", "TrajectoryCall",
           "Wanted", "chosen", "columns", "common_method", "destinations", "find_period",
           "flank_motion", "impacts_of", "method_of", "named", "numbers", "of_kind", "position",
           "series_is_taken", "steps", "sweep", "thinned", "unknown", "work_counts"]
