"""Where a trajectory may begin, as the engine takes it."""

from __future__ import annotations

from typing import Any

import numpy as np

from lapwing import engine
from lapwing.base import arguments
from lapwing.base.arguments import shown
from lapwing.base.codes import MotionState
from lapwing.model.oscillator import Oscillator
from lapwing.model.start import put_on_flank, start_problem


def engine_start(osc: Oscillator, start: Any) -> tuple[float, float, float]:
    """Start as the engine takes it: motion state (or REST), phi, phi'.

    Raises
    ------
    ValueError
        where a start contradicts its motion state (decisions e and k of docs/model.md).
    """
    expected = "'rest' or (motion_state, phi, phi_dot)"
    if isinstance(start, str):
        if start != "rest":
            raise ValueError(arguments.wrong("start", start, expected))
        if osc.force < 0 and osc.gap == "one_flank":
            raise ValueError("start = 'rest' with a negative force needs a coast flank to rest on")
        return engine.REST, 0.0, 0.0
    if not isinstance(start, tuple | list | np.ndarray) or start is np.ma.masked:
        raise TypeError(arguments.wrong("start", start, expected))
    if (start.shape != (3,) if isinstance(start, np.ndarray) else len(start) != 3):
        raise ValueError(arguments.wrong("start", start, expected))
    motion_state, phi, phi_dot = start
    if isinstance(motion_state, str):
        known = {state.name.lower(): state for state in MotionState}
        motion_state = known.get(motion_state.lower(), motion_state)
    if isinstance(motion_state, str):
        raise ValueError(f"start: {shown(motion_state)} is no motion state, expected one of "
                         f"{', '.join(known)}")
    # Read back from an array of states, a motion state is a float.
    state = arguments.real("start: motion_state", motion_state, low=0, high=max(MotionState))
    if state % 1:
        raise ValueError(f"start: {shown(motion_state)} is no motion state")
    return (state, arguments.real("start: phi", phi), arguments.real("start: phi_dot", phi_dot))


def checked_start(osc: Oscillator, start: Any, phase: float) -> Any:
    """A start that is not refused, as (motion_state, phi, phi_dot), put on its flank, or 'rest'.

    Raises
    ------
    ValueError
        where it lies on the wrong side of a flank by more than rounding.
    """
    numbers = engine_start(osc, start)
    if numbers[0] == engine.REST:
        return start
    state, phi, phi_dot = numbers
    name = MotionState(int(state)).name.lower()
    problem = start_problem(osc, name, phi, phase)
    if problem:
        raise ValueError(f"start: phi = {phi:.6g} contradicts its motion state: {problem}")
    return start[0], put_on_flank(osc, name, phi, phase), phi_dot
