"""Branches from the motions that sweeps and starts find: a bifurcation diagram as a table."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from lapwing.base import arguments
from lapwing.base.arguments import Refusals
from lapwing.base.codes import FoundFrom, FoundMotion
from lapwing.base.threads import checked_threads
from lapwing.model.gear_pair import GearPair
from lapwing.model.transmission_error import TransmissionError
from lapwing.studies.branch.collection import Collection, Match
from lapwing.studies.branch.ranges import BEYOND, SLOWLY, stable_ranges
from lapwing.studies.branch.run import Branch, branch, follower_of
from lapwing.studies.branch.seeds import RATTLING_CYCLES, Motion, Search, find, followed_on
from lapwing.studies.branch.special import Special
from lapwing.studies.branch.trace.follower import Follower
from lapwing.studies.branch.trace.record import recorded, restored
from lapwing.studies.critical.records import identity
from lapwing.studies.critical.starts import StartGrid
from lapwing.studies.orbit import NoOrbit, Orbit, find_orbit
from lapwing.studies.period import MAX_PERIOD
from lapwing.studies.records import Records
from lapwing.studies.sweep.varied import parameters

if TYPE_CHECKING:
    import xarray as xr

# How many times it is looked what becomes of motions where branches end.
MOST_TURNS = 5
# Part of the progress that looking for motions is taken to be.
LOOKING = 0.2


@dataclass(frozen=True)
class Request:
    """What is to be followed.

    Attributes
    ----------
    search : Search, whose values' ends are the range
    doublings : int, how many times over branches of twice the period are followed
    points, unstable : int, the most points of a branch either way, and of them in a row that are
        not stable
    ends : int, how many times over it is looked what becomes of motions beyond the ends of their
        stable ranges; those found the last time begin no branch
    """

    search: Search
    doublings: int
    points: int
    unstable: int
    ends: int = MOST_TURNS

    @property
    def range(self) -> tuple[float, float]:
        """Ends of the range."""
        return float(self.search.values[0]), float(self.search.values[-1])


@dataclass
class Found:
    """Motions, branches, and which motion lies where.

    Attributes
    ----------
    motions : list of Motion
    branches : list of Branch, shorter repetitions first, then by the least value
    on : list of Match or None, of each motion, where it lies
    """

    motions: list[Motion]
    branches: list[Branch] = field(default_factory=list)
    on: list[Match | None] = field(default_factory=list)


@arguments.complete(operation=GearPair.oscillator, varied="parameter")
def branches(pair: GearPair, te: TransmissionError, *, parameter: str = "brake_torque", low: float,
             high: float, seeds: int = 41, starts: StartGrid | None = None,
             random_starts: int = 0, random_seed: int = 0, settle: int = 400,
             highest_period: int = MAX_PERIOD, doublings: int = 2, points: int = 2000,
             unstable: int = 200, rattling_cycles: int = RATTLING_CYCLES,
             threads: int | None = None, progress: Callable[[float], None] | None = None,
             **operation: Any) -> xr.Dataset:
    """The branches of the periodic motions that sweeps find, each followed to both of its ends.

    1. Motions at `seeds` values from `low` to `high`: from rest, carried both ways, from a grid of
       starts and from random starts at each value.
    2. Each periodic one (up to `highest_period`) that lies on no branch yet begins one.
    3. At each period doubling the branch of twice the period is followed, so many times over.
    4. A little beyond each end of a range in which a motion is stable, what becomes of it is looked
       at, and may begin a branch, too.
    5. Of two branches that are one, by their points, one is kept.

    A motion that no such branch reaches is not in the diagram: what is not shown may exist.

    Parameters
    ----------
    pair : GearPair
    te : TransmissionError
    parameter : str, a number of the pair or its operation, as of `sweep`
    low, high : float, range of the parameter
    seeds : int, values of the sweep
    starts : StartGrid or None, of each value; None: rest and the carried motions alone
    random_starts, random_seed : int, starts drawn at each value besides, and what decides them
    settle : int, mesh cycles at each value before a motion is looked at
    highest_period : int, mesh cycles, at most 24; longer ones count as without period
    doublings : int, how many times a branch of twice the period is followed
    points, unstable : int, the most points of a branch either way, and in a row that are unstable
    rattling_cycles : int, mesh cycles, at most, for which motions are followed in all to find where
        rattling ends that is on no branch; an end not found by then is of kind POINTS
    threads : int or None; no result depends on it
    progress : callable(fraction done) or None
    **operation : the other arguments of `GearPair.oscillator`

    Returns
    -------
    xarray.Dataset, by the dimensions of its variables [unit; of codes the enumeration], of which
    `parameter` is the unit of the parameter:

    (point): value [parameter], branch, cycles, stable, rank, arrivals, back_arrivals
    (point, multiplier): multiplier_real, multiplier_imag
    (strobe): strobe_point, phi [rad], phi_dot [rad per tau]
    (event): event_point, event_phase, event_speed [rad per tau], event_happening [BranchEvent],
    event_flank [Flank]
    (special): special_value [parameter], special_error [parameter], special_branch,
    special_kind [SpecialPoint], special_outcome [BranchOutcome], special_flank [Flank],
    special_phase, special_phi [rad]
    (stable_range): range_low [parameter], range_high [parameter], range_low_kind [SpecialPoint],
    range_high_kind [SpecialPoint], range_branch, range_cycles
    (motion): motion_value [parameter], motion_kind [FoundMotion], motion_begun [FoundFrom],
    motion_cycles, motion_branch, motion_distance, motion_phi [rad], motion_phi_dot [rad per tau]
    (seed): seed_value [parameter], seed_motions, seed_engaged, seed_aperiodic, seed_failed
    (rattling): rattling_low [parameter], rattling_low_error [parameter],
    rattling_low_kind [SpecialPoint], rattling_low_branch, rattling_high [parameter],
    rattling_high_error [parameter], rattling_high_kind [SpecialPoint], rattling_high_branch

    strobe: phi and phi_dot at phase 0 of each mesh cycle of a point; motion: those looked at, on
    which branch (0: on none) and how far from it, part of its size; rattling: its intervals above
    the value from which on contact can be kept (attribute `kept`), where that is known, with
    attributes dies, dies_error, dies_kind, dies_branch: where rattling dies that is raised slowly.
    Other attributes say what was fixed.

    Raises
    ------
    TypeError, ValueError
        for a refused argument.
    """
    from lapwing.studies.branch.diagram import table

    request = _checked(pair, te, parameter, low, high, starts, progress, {
        "seeds": (seeds, 2), "random_starts": (random_starts, 0), "random_seed": (random_seed, 0),
        "settle": (settle, 1), "highest_period": (highest_period, 1), "doublings": (doublings, 0),
        "points": (points, 1), "unstable": (unstable, 1),
        "rattling_cycles": (rattling_cycles, 1)}, checked_threads(threads), operation)
    return table(request, followed(request, progress))


class Kept:
    """Branches in the order in which they are followed, kept in a folder as soon as each is.

    Parameters
    ----------
    records : Records, or None: nothing is kept
    """

    def __init__(self, records: Records | None = None) -> None:
        self._records = records

    def branch(self, request: Request, value: float, orbit: Orbit) -> Branch:
        """`run.branch` of a motion at a value, or read."""
        search, (low, high) = request.search, request.range
        follower = follower_of(search.oscillator, value, low, high)
        return self._taken(request, follower, value, orbit.state[1:], lambda: branch(
            orbit, search.oscillator, value=value, low=low, high=high, points=request.points,
            unstable=request.unstable))

    def switched(self, request: Request, one: Branch, special: Special) -> Branch:
        """`Branch.switched` at a period doubling, or read."""
        return self._taken(
            request, one.follower, special.value, one.state(special)[1:],
            lambda: one.switched(special, request.points, request.unstable))

    def _taken(self, request: Request, follower: Follower, value: float,
               state: tuple[float, float], make: Callable[[], Branch]) -> Branch:
        if self._records is None:
            return make()

        def read(data: Mapping[str, NDArray[Any]]) -> Branch:
            points, specials, positions = restored(data)
            return Branch(points, specials, positions, points[0].place.layout.cycles, follower)

        return self._records.taken(
            identity(request.search.oscillator(value), np.array([value, *request.range, *state]),
                     points=request.points, unstable=request.unstable,
                     parameter=request.search.parameter),
            make, lambda one: recorded(one.points, one.specials, one.positions), read)


def followed(request: Request, progress: Callable[[float], None] | None = None,
             kept: Kept | None = None) -> Found:
    """Motions looked for, and the branches that they lie on."""
    keep = kept or Kept()

    def told(fraction: float) -> None:
        if progress is not None:
            progress(LOOKING + (1 - LOOKING) * fraction)

    search, known = request.search, Collection()
    found = Found(find(search, progress and (lambda part: progress(LOOKING * part))))
    looked = 0
    for turn in range(request.ends + 1):
        seeds = [k for k in range(looked, len(found.motions))
                 if found.motions[k].kind is FoundMotion.PERIODIC]
        looked = len(found.motions)
        found.on += [None] * (looked - len(found.on))
        if turn and turn == request.ends:
            for k in seeds:
                found.on[k] = _on(known, found.motions[k])
            break
        for count, k in enumerate(_spread(seeds)):
            found.on[k] = _placed(request, known, found.motions[k], keep)
            told((turn + (count + 1) / (len(seeds) + 1)) / max(1, request.ends))
        for _ in range(request.doublings):
            for one, special in known.doublings(search.highest):
                try:
                    known.add(keep.switched(request, one, special))
                except (NoOrbit, ArithmeticError):
                    continue
        if not request.ends:
            break
        found.motions += _beyond_ends(search, known, found.motions)
        if len(found.motions) == looked:
            break
    found.branches = sorted(known.branches, key=lambda one: (one.cycles, one.values.min()))
    # A branch that another one contains has made room for it.
    left = {id(one) for one in found.branches}
    for k, match in enumerate(found.on):
        if match is not None and id(match.branch) not in left:
            found.on[k] = _on(known, found.motions[k])
    told(1.0)
    return found


def _beyond_ends(search: Search, known: Collection, motions: Sequence[Motion]) -> list[Motion]:
    """What becomes of motions a little beyond the ends of stable ranges, at values not seen yet."""
    low, high = float(search.values[0]), float(search.values[-1])
    tried = {one.value for one in motions if one.begun is FoundFrom.END}
    begun = []
    for stretch in stable_ranges(known.branches):
        one = known.branches[stretch.branch - 1]
        for end, way in ((stretch.low, -1), (stretch.high, 1)):
            value = end.value + way * BEYOND * (high - low)
            if low < value < high and value not in tried:
                at = min((stretch.first, stretch.last), key=lambda k: abs(one.values[k] - value))
                begun.append((value, one.state(one.points[at])))
                tried.add(value)
    return followed_on(search, begun, SLOWLY)


def _spread(seeds: Sequence[int]) -> list[int]:
    """Each number once, those that follow each other far apart: halves, quarters, ..."""
    bits = max(1, len(seeds) - 1).bit_length()
    order = (int(f"{k:0{bits}b}"[::-1], 2) for k in range(1 << bits))
    return [seeds[k] for k in order if k < len(seeds)]


def _on(known: Collection, motion: Motion) -> Match | None:
    return known.match(motion.value, np.array(motion.state[1:]), motion.cycles)


def _placed(request: Request, known: Collection, motion: Motion, keep: Kept) -> Match | None:
    """Where a periodic motion lies, on a new branch if on none; None where it begins none."""
    match = _on(known, motion)
    if match is not None:
        return match
    try:
        orbit = find_orbit(request.search.oscillator(motion.value), motion.state, motion.cycles)
        exact = Motion(motion.value, motion.kind, motion.begun, orbit.cycles, orbit.state)
        match = _on(known, exact)
        if match is None:
            known.add(keep.branch(request, motion.value, orbit))
            match = _on(known, exact)
    except NoOrbit:
        return None
    return match


def _checked(pair: Any, te: Any, parameter: Any, low: Any, high: Any, starts: Any, progress: Any,
             whole: dict[str, tuple[Any, int]], threads: int,
             operation: dict[str, Any]) -> Request:
    """The request, or every problem at once."""
    taken = Refusals()
    taken.take(arguments.instance, "pair", pair, GearPair)
    taken.take(arguments.instance, "te", te, TransmissionError)
    taken.take(arguments.choice, "parameter", parameter, parameters(te))
    if starts is not None:
        taken.take(arguments.instance, "starts", starts, StartGrid)
    ends = [taken.take(arguments.real, name, value) for name, value in
            (("low", low), ("high", high))]
    most = {"highest_period": MAX_PERIOD, "rattling_cycles": 10**15}
    numbers = {name: taken.take(arguments.whole, name, value, least, most.get(name, 1_000_000))
               for name, (value, least) in whole.items()}
    if progress is not None:
        taken.take(arguments.function, "progress", progress)
    if None not in ends and not ends[0] < ends[1]:
        taken.problems.append(f"low = {ends[0]:g} must be below high = {ends[1]:g}")
    if operation.get("degrees_of_freedom") == 2:
        taken.problems.append("degrees_of_freedom = 2, expected 1")
    taken.raise_if_any("branches")
    search = Search(
        pair, te, parameter, np.linspace(ends[0], ends[1], numbers["seeds"]), operation, starts,
        numbers["random_starts"], numbers["random_seed"], numbers["settle"],
        numbers["highest_period"], threads=threads, rattling_cycles=numbers["rattling_cycles"])
    return Request(search, numbers["doublings"], numbers["points"], numbers["unstable"])
