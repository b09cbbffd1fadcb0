"""Periodic motions continued in a parameter, to their period doublings."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from lapwing.base import arguments
from lapwing.base.codes import MotionState
from lapwing.engine import Numerics
from lapwing.model.oscillator import Oscillator
from lapwing.studies.orbit.newton import NUMERICS, NoOrbit, Orbit, find_orbit, settled_state

# Steps in the parameter from one doubling to the next.
MOST_FOLLOWED = 60


class Followed(list[Orbit]):
    """Orbits along a parameter; `lost` says why there are fewer than values, else None."""

    lost: str | None = None


@arguments.complete()
def follow(make: Callable[[float], Oscillator], values: ArrayLike,
           start: tuple[MotionState, float, float], cycles: int = 1, *,
           numerics: Numerics = NUMERICS) -> Followed:
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
    numbers = [float(value) for value in arguments.reals("values", values, ndim=1, empty=True)]
    orbits = Followed()
    for value in numbers:
        if len(orbits) > 1:
            start = _predicted(numbers, orbits, value)
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


def _made(make: Callable[..., Any], value: float) -> Oscillator:
    """The oscillator at a value of the parameter."""
    return arguments.instance("make(value)", make(value), Oscillator)


def _found_at(make: Callable[..., Any], value: float, start: tuple[MotionState, float, float],
              cycles: int, numerics: Numerics) -> Orbit:
    """`find_orbit` at a value of the parameter, which a failure names."""
    osc = _made(make, value)
    try:
        return find_orbit(osc, start, cycles, numerics=numerics)
    except NoOrbit as error:
        raise NoOrbit(f"at parameter value {value:.10g}: {error}", value) from error


def _predicted(values: list[float], orbits: Followed,
               value: float) -> tuple[MotionState, float, float]:
    """State on the secant through the last two."""
    k = len(orbits)
    (_, *one), (state, *two) = orbits[-2].state, orbits[-1].state
    share = (value - values[k - 1]) / (values[k - 1] - values[k - 2])
    return state, *(np.array(two) + share * (np.array(two) - one))


def flip_distance(orbit: Orbit) -> float:
    """(1 + λ₁)(1 + λ₂) = 1 + trace + det: zero where a multiplier is -1, negative beyond."""
    found = orbit.multipliers
    det = found.det_sign * math.exp(found.log_det) if found.rank == 2 else 0.0
    return 1 + found.trace + det


@arguments.complete()
def period_doubling(make: Callable[..., Any], low: float, high: float,
                    start: tuple[MotionState, float, float], cycles: int = 1, *,
                    numerics: Numerics = NUMERICS) -> tuple[float, Orbit]:
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
    known: dict[float, Orbit] = {}

    def distance(value: float) -> float:
        nearest = min(known, key=lambda other: abs(other - value), default=math.nan)
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


@arguments.complete()
def cascade(make: Callable[..., Any], low: float, high: float,
            start: tuple[MotionState, float, float], doublings: int, *, cycles: int = 1,
            settle: int = 400, numerics: Numerics = NUMERICS) -> list[tuple[float, Orbit]]:
    """A period-doubling cascade upwards in a parameter: value and motion of each doubling.

    1. The first doubling lies between `low` and `high` (`period_doubling`).
    2. A third of the expected step beyond it the doubled motion attracts: settle there, polish it.
    3. Follow it on, in quarters of the expected step or less, until its multiplier passes -1.
       Steps are expected to shrink by Feigenbaum's 4.669; the first is taken as a quarter of
       `high` less the doubling itself.

    Parameters
    ----------
    make : callable(value) giving an Oscillator
    low, high : float, values of the parameter on either side of the first doubling
    start : (motion_state, phi, phi_dot) near the motion at `low`, rad and rad per τ
    doublings : int, how many are looked for, 1 to 100
    cycles : int, mesh cycles after which the motion at `low` repeats
    settle : int, repetitions followed before a doubled motion is polished
    numerics : Numerics

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


def _around_flip(make: Callable[..., Any], value: float, step: float, orbit: Orbit,
                 numerics: Numerics) -> tuple[float, float, tuple[MotionState, float, float]]:
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


def _doubled(make: Callable[..., Any], value: float, orbit: Orbit, settle: int,
             numerics: Numerics) -> Orbit:
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
