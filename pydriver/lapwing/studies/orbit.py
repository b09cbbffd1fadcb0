"""Periodic motions to the last digits: Newton on the stroboscopic map, continued in a parameter.

The map takes the state at phase 0 to the state some mesh cycles later; its matrix comes from the
engine's tangent maps, through impacts and chatter.  Stable or not, a motion is found from near it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from lapwing.base import arguments
from lapwing.base.arguments import MAX_INT
from lapwing.base.codes import MotionState, Status
from lapwing.engine import REST, Numerics, TrajectoryCall, Wanted, columns
from lapwing.model.oscillator import Oscillator
from lapwing.studies.stability import CycleMaps, Multipliers, multiplied, multipliers
from lapwing.studies.trajectory import checked_start, engine_start

# The numerics of an orbit: nothing is lost to tolerances.
NUMERICS = Numerics(rtol=1e-13, chatter_tol=1e-13)
MOST_STEPS, MOST_HALVINGS = 40, 12
# Steps in the parameter from one doubling to the next.
MOST_FOLLOWED = 60
# A state repeats when it comes back within this part of the motion's size.  Rounding in a state of
# size one, some 1e-15, is magnified by the map itself; Newton ends where it no longer gains.
CLOSED = 1e-10


class NoOrbit(RuntimeError):
    """Newton's method has not found a periodic motion; the message says how far it came.

    `value` is that of the parameter where one was followed, named in the message too, else None.
    """

    def __init__(self, message: str, value: float | None = None):
        super().__init__(message)
        self.value = value

    def __reduce__(self):
        return type(self), (str(self), self.value)


@dataclass(frozen=True)
class Orbit:
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

    oscillator: object
    state: tuple
    cycles: int
    residual: float
    size: float
    multipliers: Multipliers
    table: np.ndarray
    maps: CycleMaps


def settled_state(osc, cycles, start="rest", *, numerics=NUMERICS):
    """State at phase 0 after so many mesh cycles.

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


def follow_cycles(call, cycles):
    """Run a `TrajectoryCall` to the beginning of a cycle; NoOrbit where it fails numerically."""
    call.run((cycles, 0.0), [])
    if call.status != Status.OK:
        raise NoOrbit(f"the run ended with {call.status.name}")


def find_orbit(osc, start="rest", cycles=1, *, settle=400, numerics=NUMERICS):
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


def _checked(osc, cycles, numerics):
    """The mesh cycles of an orbit, after a look at what else enters."""
    arguments.instance("osc", osc, Oscillator)
    arguments.instance("numerics", numerics, Numerics)
    return arguments.whole("cycles", cycles, 1, MAX_INT // 4)


def _made(make, value):
    """The oscillator at a value of the parameter."""
    return arguments.instance("make(value)", make(value), Oscillator)


@dataclass(frozen=True)
class _Mapped:
    """One evaluation of the map from x, all in rad (per τ): where it leads, its run and miss."""

    x: np.ndarray
    image: np.ndarray
    call: TrajectoryCall
    maps: CycleMaps
    size: float
    miss: float


def _cycle_map(osc, state, x, cycles, numerics):
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
    size = max(abs(osc.force), call.cycles["deepest_separation"].max()) or osc.backlash
    return _Mapped(x, np.array(image), call, CycleMaps.from_rows(call.tangent, osc.period), size,
                   float(np.abs(image - x).max() / size))


def _strobed(call):
    """Where a call has come: motion state, phi, phi'; events at that instant have happened."""
    return MotionState(call.motion_state), float(call.phi), float(call.phi_dot)


def _newton_step(here):
    matrix, exponent, *_ = multiplied(here.maps)
    system = matrix * 2.0**exponent - np.eye(2)
    try:
        return np.linalg.solve(system, here.x - here.image)
    except np.linalg.LinAlgError:
        return np.linalg.lstsq(system, here.x - here.image, rcond=None)[0]


def _orbit(osc, state, here, cycles, numerics):
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
    return Orbit(osc, (state, *map(float, here.x)), cycles, here.miss, here.size,
                 multipliers(here.maps, here.size), here.call.cycles, here.maps)


class Followed(list):
    """Orbits along a parameter; `lost` says why there are fewer than values, else None."""

    lost: str | None = None


def follow(make, values, start, cycles=1, *, numerics=NUMERICS):
    """Continue a periodic motion over values of a parameter, one Newton from the next.

    Parameters
    ----------
    make : callable(value) giving an Oscillator
    values : sequence of float, near enough to each other
    start : (motion_state, phi, phi_dot) near the motion at the first value
    cycles : int

    Returns
    -------
    Followed
        a list of Orbit, one for each value; it ends early where the motion is lost, and its
        attribute `lost` says then why, naming the value

    Raises
    ------
    TypeError, ValueError
        for a refused argument; a motion that is lost raises nothing.
    """
    arguments.function("make", make)
    values = [float(value) for value in arguments.reals("values", values, ndim=1, empty=True)]
    orbits = Followed()
    for value in values:
        if len(orbits) > 1:
            start = _predicted(values, orbits, value)
        elif orbits:
            start = orbits[-1].state
        try:
            orbits.append(_found_at(make, value, start, cycles, numerics))
        except NoOrbit as error:
            orbits.lost = str(error)
            if len(orbits) < 2:
                break
            try:
                orbits.append(_found_at(make, value, orbits[-1].state, cycles, numerics))
            except NoOrbit as second:
                orbits.lost = str(second)
                break
            orbits.lost = None
    return orbits


def _found_at(make, value, start, cycles, numerics):
    """`find_orbit` at a value of the parameter, which a failure names."""
    osc = _made(make, value)
    try:
        return find_orbit(osc, start, cycles, numerics=numerics)
    except NoOrbit as error:
        raise NoOrbit(f"at parameter value {value:.10g}: {error}", value) from error


def _predicted(values, orbits, value):
    """State on the secant through the last two."""
    k = len(orbits)
    (_, *one), (state, *two) = orbits[-2].state, orbits[-1].state
    share = (value - values[k - 1]) / (values[k - 1] - values[k - 2])
    return state, *(np.array(two) + share * (np.array(two) - one))


def flip_distance(orbit):
    """(1 + λ₁)(1 + λ₂) = 1 + trace + det: zero where a multiplier is -1, negative beyond."""
    found = orbit.multipliers
    det = found.det_sign * math.exp(found.log_det) if found.rank == 2 else 0.0
    return 1 + found.trace + det


def period_doubling(make, low, high, start, cycles=1, *, numerics=NUMERICS):
    """Parameter value at which a multiplier of a periodic motion passes -1.

    Parameters
    ----------
    make : callable(value) giving an Oscillator
    low, high : float, on either side of it
    start : (motion_state, phi, phi_dot) near the motion at `low`
    cycles : int

    Returns
    -------
    (float, Orbit)
        The value, to some 1e-13 of the interval (what rounding in the map leaves of it), and the
        motion there.

    Raises
    ------
    TypeError, ValueError
        for a refused argument.
    NoOrbit
        where the motion is lost on the way, or its multiplier does not pass -1 in between.
    """
    from scipy.optimize import brentq

    arguments.function("make", make)
    low, high = arguments.real("low", low), arguments.real("high", high)
    known = {}

    def distance(value):
        nearest = min(known, key=lambda other: abs(other - value), default=None)
        orbit = _found_at(make, value, known[nearest].state if known else start, cycles, numerics)
        if orbit.cycles != cycles:
            raise NoOrbit(f"at parameter value {value:.10g} the motion repeats after "
                          f"{orbit.cycles} mesh cycles", value)
        known[value] = orbit
        return flip_distance(orbit)

    ends = distance(low), distance(high)
    if ends[0] * ends[1] > 0:
        raise NoOrbit(f"no multiplier passes -1 between {low:.10g} and {high:.10g}: "
                      f"(1 + λ₁)(1 + λ₂) is {ends[0]:.3g} and {ends[1]:.3g}")
    value = brentq(distance, low, high, xtol=1e-14 * abs(high - low) + 4e-16 * abs(high),
                   rtol=8.9e-16)
    return value, known[value]


def cascade(make, low, high, start, doublings, *, cycles=1, settle=400, numerics=NUMERICS):
    """A period-doubling cascade upwards in a parameter: value and motion of each doubling.

    1. The first doubling lies between `low` and `high` (`period_doubling`).
    2. A third of the expected step beyond it the doubled motion attracts: settle there, polish it.
    3. Follow it on, in quarters of the expected step or less, until its multiplier passes -1.
       Steps are expected to shrink by Feigenbaum's 4.669; the first is taken as a quarter of
       `high` less the doubling itself.

    Returns
    -------
    list of (float, Orbit); shorter than `doublings` where the cascade is lost

    Raises
    ------
    TypeError, ValueError
        for a refused argument.
    NoOrbit
        where already the first doubling is not found.
    """
    doublings = arguments.whole("doublings", doublings, 1, 100)
    settle = arguments.whole("settle", settle, 1, 10_000_000)
    found = [period_doubling(make, low, high, start, cycles, numerics=numerics)]
    step = 0.25 * (high - found[0][0])
    while len(found) < doublings:
        value, orbit = found[-1]
        twice = 2 * orbit.cycles
        if len(found) > 1:
            step = (value - found[-2][0]) / 4.669
        try:
            doubled = _doubled(make, value + step / 3, orbit, settle, numerics)
            before, after, near = _around_flip(make, value + step / 3, step / 4, doubled, numerics)
            found.append(period_doubling(make, before, after, near, twice, numerics=numerics))
        except NoOrbit:
            break
    return found


def _around_flip(make, value, step, orbit, numerics):
    """Two values on either side of an orbit's next doubling, and its state at the first.

    A step that ends on a motion of another period, the old one beside it as a rule, is halved.
    """
    for _ in range(MOST_FOLLOWED):
        try:
            ahead = _found_at(make, value + step, orbit.state, orbit.cycles, numerics)
        except NoOrbit:
            ahead = None
        if ahead is None or ahead.cycles != orbit.cycles:
            step = 0.5 * step
        elif flip_distance(ahead) < 0:
            return value, value + step, orbit.state
        else:
            value, orbit = value + step, ahead
    raise NoOrbit(f"no doubling found up to parameter value {value:.10g}", value)


def _doubled(make, value, orbit, settle, numerics):
    """The motion of twice the period just beyond a doubling, by settling beside the old one."""
    state, phi, phi_dot = orbit.state
    beside = (state, phi, phi_dot + 1e-3 * orbit.size)
    osc, twice = make(value), 2 * orbit.cycles
    settled = settled_state(osc, settle * twice, beside, numerics=numerics)
    doubled = find_orbit(osc, settled, twice, numerics=numerics)
    if doubled.cycles != twice:
        raise NoOrbit(f"at parameter value {value:.10g} the motion still repeats after "
                      f"{doubled.cycles} mesh cycles", value)
    return doubled


__all__ = ["Followed", "NoOrbit", "Orbit", "cascade", "find_orbit", "flip_distance", "follow",
           "period_doubling", "settled_state"]
