"""Periodic motions to the last digits: Newton on the stroboscopic map.

The map takes the state at phase 0 to the state some mesh cycles later; its matrix comes from the
engine's tangent maps, through impacts and chatter.  Stable or not, a motion is found from near it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lapwing.base import arguments
from lapwing.base.arguments import MAX_INT
from lapwing.base.codes import MotionState, Status
from lapwing.base.messages import Shown
from lapwing.engine import REST, Numerics, TrajectoryCall, Wanted, columns
from lapwing.model.oscillator import Oscillator
from lapwing.studies.stability import CycleMaps, Multipliers, multiplied, multipliers
from lapwing.studies.trajectory import checked_start, engine_start

# The numerics of an orbit: nothing is lost to tolerances.
NUMERICS = Numerics(rtol=1e-13, chatter_tol=1e-13)
MOST_STEPS, MOST_HALVINGS = 40, 12
# A state repeats when it comes back within this part of the motion's size.  Rounding in a state of
# size one, some 1e-15, is magnified by the map itself; Newton ends where it no longer gains.
CLOSED = 1e-10


class NoOrbit(RuntimeError):
    """Newton's method has not found a periodic motion; the message says how far it came.

    `value` is that of the parameter where one was followed, named in the message too, else None.
    """

    def __init__(self, message: str, value: float | None = None) -> None:
        super().__init__(message)
        self.value = value

    def __reduce__(self) -> tuple[type[NoOrbit], tuple[str, float | None]]:
        return type(self), (str(self), self.value)


@dataclass(frozen=True, repr=False)
class Orbit(Shown):
    """A motion that repeats.

    Attributes
    ----------
    oscillator : Oscillator
    state : (motion_state, phi, phi_dot) at phase 0, a start for `simulate`
    cycles : int, mesh cycles after which it repeats, the least number
    residual : float, by how much it misses itself, part of the motion's size
    size : float, rad; max(|F|, deepest separation)
    multipliers : Multipliers
    table : structured array (cycles,), statistics of its mesh cycles, fields of
        `engine.records.CYCLE`
    maps : CycleMaps
    """

    oscillator: Oscillator
    state: tuple[MotionState, float, float]
    cycles: int
    residual: float
    size: float
    multipliers: Multipliers
    table: np.ndarray
    maps: CycleMaps

    def _facts(self) -> dict[str, object]:
        """What tells one from another, in words."""
        motion_state, phi, phi_dot = self.state
        impacts = sum(float(self.table[name].sum()) for name in ("impacts", "back_impacts"))
        return {"mesh cycles": self.cycles, "state": motion_state.name.lower(),
                "phi": f"{phi:.6g} rad", "phi_dot": f"{phi_dot:.6g} rad per tau",
                "impacts": f"{impacts:g}",
                "multipliers": ", ".join(f"{one:.4g}" for one in self.multipliers.values),
                "stable": self.multipliers.stable, "misses itself by": f"{self.residual:.1e}"}


@arguments.complete()
def settled_state(osc: Oscillator, cycles: int, start: Any = "rest", *,
                  numerics: Numerics = NUMERICS) -> tuple[MotionState, float, float]:
    """State at phase 0 after so many mesh cycles.

    Parameters
    ----------
    osc : Oscillator
    cycles : int, >= 1
    start : 'rest' or (motion_state, phi, phi_dot) at phase 0, rad and rad per τ
    numerics : Numerics

    Returns
    -------
    (motion_state, phi, phi_dot)

    Raises
    ------
    TypeError, ValueError
        for a refused argument.
    NoOrbit
        where the run fails numerically.
    """
    cycles = _checked(osc, cycles, numerics)
    start = engine_start(osc, checked_start(osc, start, 0.0))
    call = TrajectoryCall(osc, (*start, 0.0), numerics=numerics,
                          wanted=Wanted())
    follow_cycles(call, cycles)
    return _strobed(call)


def follow_cycles(call: TrajectoryCall, cycles: int) -> None:
    """Run a `TrajectoryCall` to the beginning of a cycle; NoOrbit where it fails numerically."""
    call.run((cycles, 0.0), [])
    if call.status != Status.OK:
        raise NoOrbit(f"the run ended with {call.status.name}")


@arguments.complete()
def find_orbit(osc: Oscillator, start: Any = "rest", cycles: int = 1, *,
               settle: int = 400, numerics: Numerics = NUMERICS) -> Orbit:
    """Newton's method on the map over `cycles` mesh cycles.

    1. The map and its matrix M from one run; the step is (M - 1)⁻¹ (x - map(x)).
    2. A step that misses by more than before, or leaves its motion state, is halved.
    3. It ends when the miss is below 1e-10 of the motion's size and no step makes it smaller.
    4. The period is the least divisor of `cycles` after which the motion is back.

    Parameters
    ----------
    osc : Oscillator
    start : (motion_state, phi, phi_dot) at phase 0, near the motion; its motion state is that of
        the section. 'rest': the state after `settle` mesh cycles from rest
    cycles : int, >= 1
    settle : int, >= 1, mesh cycles from rest
    numerics : Numerics

    Returns
    -------
    Orbit

    Raises
    ------
    TypeError, ValueError
        for a refused argument.
    NoOrbit
        where it does not converge, or every motion nearby is lost.
    """
    cycles = _checked(osc, cycles, numerics)
    numbers = engine_start(osc, start)
    settle = arguments.whole("settle", settle, 1, MAX_INT // 4)
    if numbers[0] == REST:
        numbers = settled_state(osc, settle, numerics=numerics)
    state, x = MotionState(int(numbers[0])), np.array(numbers[1:])
    here = _cycle_map(osc, state, x, cycles, numerics)
    for _ in range(MOST_STEPS):
        if here is None:
            break
        step = _newton_step(here)
        better = None
        for halving in range(MOST_HALVINGS):
            trial = _cycle_map(osc, state, x + step * 0.5**halving, cycles, numerics)
            if trial is not None and trial.miss < here.miss:
                better = trial
                break
            if here.miss < CLOSED:
                break
        if better is None:
            break
        x, here = better.x, better
    if here is None or not here.miss < CLOSED:
        miss = "in another motion state" if here is None else f"{here.miss:.1e} of its size"
        raise NoOrbit(f"no motion of {cycles} mesh cycles found from {state.name.lower()}, "
                      f"phi = {numbers[1]:.6g}, phi_dot = {numbers[2]:.6g}: still off by {miss}")
    return _orbit(osc, state, here, cycles, numerics)


def _checked(osc: Oscillator, cycles: int, numerics: Numerics) -> int:
    """The mesh cycles of an orbit, after a look at what else enters."""
    arguments.instance("osc", osc, Oscillator)
    arguments.instance("numerics", numerics, Numerics)
    return arguments.whole("cycles", cycles, 1, MAX_INT // 4)


@dataclass(frozen=True)
class _Mapped:
    """One evaluation of the map from x, all in rad (per τ): where it leads, its run and miss."""

    x: np.ndarray
    image: np.ndarray
    call: TrajectoryCall
    maps: CycleMaps
    size: float
    miss: float


def _cycle_map(osc: Oscillator, state: MotionState, x: NDArray[Any], cycles: int,
               numerics: Numerics) -> _Mapped | None:
    """The map from a state; None where it is no start or ends in another motion state."""
    start = (state, *x)
    try:
        _, *put = checked_start(osc, start, 0.0)
    except ValueError:
        return None
    x = np.array(put)
    call = TrajectoryCall(osc, (float(state), *x, 0.0), numerics=numerics,
                          wanted=Wanted(cycles=True, tangent=True))
    call.run((cycles, 0.0), [])
    if call.status != Status.OK:
        return None
    end, *image = _strobed(call)
    if end != state:
        return None
    assert call.tangent is not None  # it is wanted
    size = max(abs(osc.force), call.cycles["deepest_separation"].max()) or osc.backlash
    return _Mapped(x, np.array(image), call, CycleMaps.from_rows(call.tangent, osc.period), size,
                   float(np.abs(image - x).max() / size))


def _strobed(call: TrajectoryCall) -> tuple[MotionState, float, float]:
    """Where a call has come: motion state, phi, phi'; events at that instant have happened."""
    return MotionState(call.motion_state), float(call.phi), float(call.phi_dot)


def _newton_step(here: _Mapped) -> NDArray[Any]:
    matrix, exponent, *_ = multiplied(here.maps)
    system = matrix * 2.0**exponent - np.eye(2)
    step: NDArray[Any]
    try:
        step = np.linalg.solve(system, here.x - here.image)
    except np.linalg.LinAlgError:
        step = np.linalg.lstsq(system, here.x - here.image, rcond=None)[0]
    return step


def _orbit(osc: Oscillator, state: MotionState, here: _Mapped, cycles: int,
           numerics: Numerics) -> Orbit:
    """The orbit that Newton found, over its least period."""
    cycle = here.call.cycles
    strobed = columns(cycle, ("phi", "phi_dot"))
    least = next(p for p in range(1, cycles + 1) if cycles % p == 0 and (
        p == cycles or (np.abs(strobed[p] - here.x).max() / here.size < 100 * CLOSED
                        and int(cycle["motion_state"][p]) == state)))
    if least < cycles:
        shorter = _cycle_map(osc, state, here.x, least, numerics)
        if shorter is not None:
            here, cycles = shorter, least
    return Orbit(osc, (state, float(here.x[0]), float(here.x[1])), cycles, here.miss, here.size,
                 multipliers(here.maps, here.size), here.call.cycles, here.maps)
