"""What the searches for a critical value take and state alike."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lapwing.base import arguments
from lapwing.engine import Numerics
from lapwing.model.gear_pair import GearPair
from lapwing.model.transmission_error import TransmissionError
from lapwing.studies.critical.starts import StartGrid
from lapwing.studies.sweep.varied import parameters

SAFE_ENDS = ("high", "low")
SWEEP_RTOL = 1e-6


def scan_order(values: ArrayLike, safe_end: str) -> NDArray[Any]:
    """Values, each once, the safe end first."""
    arguments.choice("safe_end", safe_end, SAFE_ENDS)
    values = np.unique(arguments.reals("values", values))
    return values[::-1] if safe_end == "high" else values


def checked_pair(pair: GearPair, te: TransmissionError, parameter: str) -> None:
    """Refuse what is no pair, no transmission error, or no parameter."""
    arguments.instance("pair", pair, GearPair)
    arguments.instance("te", te, TransmissionError)
    arguments.choice("parameter", parameter, parameters(te))


def checked(pair: GearPair, te: TransmissionError, parameter: str, starts: StartGrid | None,
             default_starts: StartGrid, numerics: Numerics | None,
             progress: Callable[..., Any] | None) -> tuple[StartGrid, Numerics]:
    """Starts and numerics, given or the default, after a look at what else enters."""
    checked_pair(pair, te, parameter)
    if progress is not None:
        arguments.function("progress", progress)
    return (default_starts if starts is None else arguments.instance("starts", starts, StartGrid),
            Numerics(rtol=SWEEP_RTOL) if numerics is None
            else arguments.instance("numerics", numerics, Numerics))


def scan_attributes(values: NDArray[Any], safe_end: str) -> dict[str, Any]:
    """Attributes that state the grid of values."""
    return {"safe_end": safe_end, "scan_from": float(values[0]), "scan_to": float(values[-1]),
            "scan_values": values.size}


def start_attributes(starts: StartGrid, phase: float, settle: int, record: int) -> dict[str, Any]:
    """Attributes that state what was followed."""
    return {"start_phases": starts.phases, "start_positions": starts.positions,
            "start_speeds": starts.speeds, "start_phase": phase, "settle": settle,
            "record": record}
