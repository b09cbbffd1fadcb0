"""The engine asked whether a motion between events is one: no flank may be passed on the way."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lapwing.base.codes import EventKind, MotionState, Status
from lapwing.engine import Numerics, TrajectoryCall, Wanted
from lapwing.engine.motions import chatter_bounces, numbers_of
from lapwing.model.linear_steps import unit_motions
from lapwing.model.start import put_on_flank, start_problem
from lapwing.studies.branch.motion.curve import Problem
from lapwing.studies.branch.motion.equations import Events, at_events
from lapwing.studies.branch.motion.layout import Arc, Happening, Layout, of_log, of_parts

NUMERICS = Numerics(rtol=1e-13, chatter_tol=1e-13, copy_repeats=False)
# By how much phases may differ: the motion is known far better, grazes magnify what is left of it.
SAME_PHASE = 1e-6
# Bounces so near to the end of their chatter may be summed by one and listed by the other.
SUMMED = 1e-6


@dataclass(frozen=True)
class Turn:
    """A place where the distance to a flank turns: a flight's closest approach, a contact's least.

    Attributes
    ----------
    arc : int, number of the event that ends the arc
    flank : int
    phase : float, mesh periods, as the events' own
    """

    arc: int
    flank: int
    phase: float


@dataclass(frozen=True)
class Seen:
    """What the engine makes of a motion.

    Attributes
    ----------
    layout, phase, speed : as of `layout.of_log`; layout None where a run failed
    turns : list of (phase, flank)
    """

    layout: Layout | None
    phase: NDArray[Any]
    speed: NDArray[Any]
    turns: list[tuple[float, int]]


def in_full(problem: Problem, layout: Layout, z: NDArray[Any]) -> tuple[Layout, Events]:
    """A motion with every bounce until the sum of a chatter's last ones."""
    events, osc, motion = problem.at(z)
    if not layout.chatters:
        return layout, events
    after = at_events(layout, events, osc, motion).after
    curve, numbers = motion.curve(False), numbers_of(osc, problem.scale, layout.cycles)
    columns = [layout.kind, layout.flank, layout.piece, events.phase, events.speed]
    for end in np.flatnonzero(layout.kind == Happening.CHATTER_END)[::-1]:
        k = int(layout.before[end])
        phase, speed = chatter_bounces(curve, numbers, int(layout.flank[k]), int(layout.piece[k]),
                                       float(events.phase[k]), -float(after[k]))
        rows = [np.full(len(phase), Happening.REBOUND), np.full(len(phase), layout.flank[k]),
                motion.piece(phase), phase, speed]
        # What leads to the first event lies behind the last one, whatever was inserted before.
        where = int(end) or len(columns[0])
        columns = [np.insert(one, where, new) for one, new in zip(columns, rows, strict=True)]
    kind, flank, piece, phases, speeds = columns
    return (of_parts(kind, flank, piece, layout.cycles, osc.contact_law == "rigid"),
            Events(phases, speeds))


def states_at(problem: Problem, layout: Layout, z: NDArray[Any],
              phases: NDArray[Any]) -> tuple[NDArray[Any], NDArray[Any], NDArray[Any]]:
    """Motion state, φ and φ' at phases (mesh periods, 0 to cycles) of a motion; arrays."""
    return Course(problem, layout, z).at(np.asarray(phases, dtype=float))


def strobed(problem: Problem, layout: Layout, z: NDArray[Any]) -> NDArray[np.float64]:
    """φ and φ' at phase 0 of each mesh cycle of a motion: array (2, cycles)."""
    return np.array(states_at(problem, layout, z, np.arange(layout.cycles, dtype=float))[1:])


class Course:
    """A motion between its events."""

    def __init__(self, problem: Problem, layout: Layout, z: NDArray[Any]) -> None:
        _, self.osc, self.motion = problem.at(z)
        self.layout, self.events = in_full(problem, layout, z)
        self.known = at_events(self.layout, self.events, self.osc, self.motion)

    def at(self, phases: NDArray[Any]) -> tuple[NDArray[Any], NDArray[Any], NDArray[Any]]:
        """As `states_at`.

        In what is left of a chatter when its bounces can no longer be told apart the tooth is taken
        to be on its flank.
        """
        osc, motion, known, layout = self.osc, self.motion, self.known, self.layout
        begin = self.events.phase
        turn = np.floor((phases - begin[0]) / layout.cycles)
        inside = phases - turn * layout.cycles
        j = np.searchsorted(begin, inside, side="right") % layout.n
        i = (j - 1) % layout.n
        s = np.mod(inside - begin[i], layout.cycles) * osc.period
        piece = motion.piece(phases)
        g = motion.derivatives(phases, piece)
        after, sign = known.after[i], known.sign[i]
        rate = known.h[1, i] + sign * after
        theta = known.h[0, i] + rate * s + 0.5 * osc.force * s * s
        rate = rate + osc.force * s
        state = np.zeros(len(phases), dtype=int)
        arc = layout.arc[j]
        touching = arc != Arc.FLIGHT
        if touching.any():
            standing = (layout.flank[i] == 2) & (not osc.back_flank_te)
            h = np.where(layout.flank[i] == 2, -osc.gap_width, 0.0) + np.where(standing, 0.0, g[0])
            h_dot = np.where(standing, 0.0, g[1])
            theta, rate = np.where(touching, h, theta), np.where(touching, h_dot, rate)
            pressed = arc == Arc.CONTACT
            if pressed.any():
                q = np.where(standing, 0.0, motion.response(phases, piece))
                start = np.array([-sign * (osc.force + known.response[0, i]),
                                  after - sign * known.response[1, i]])
                moved = np.einsum("xyn,yn->xn", unit_motions(osc.damping_ratio, s), start)
                theta = np.where(pressed, h + osc.force + q[0] + sign * moved[0], theta)
                rate = np.where(pressed, h_dot + q[1] + sign * moved[1], rate)
            state = np.where(pressed | (arc == Arc.REST), layout.flank[i], 0)
        return state, theta - g[0], rate - g[1]


def section_of(phases: NDArray[Any]) -> float:
    """A mesh phase far from all events: the middle of the widest gap between them."""
    phase = np.sort(np.mod(phases, 1.0))
    gaps = np.diff(np.append(phase, phase[0] + 1.0))
    # No run can begin in a chatter's summed rest.
    widest = int(np.argmax(gaps))
    return float(np.mod(phase[widest] + 0.5 * gaps[widest], 1.0))


def seen(problem: Problem, layout: Layout, z: NDArray[Any], distance: float) -> Seen:
    """A motion followed by the engine, each cycle from where the motion begins it.

    So it does not matter how much an unstable motion makes of a rounding in the long run.
    """
    osc = problem.oscillator(problem.value(z))
    course = Course(problem, layout, z)
    section = section_of(course.events.phase)
    phases = section + np.arange(layout.cycles)
    wanted = Wanted(events=True, grazes=True, graze_distance=distance)
    lines, failed = [], Seen(None, np.empty(0), np.empty(0), [])
    for cycle, state, phi, phi_dot in zip(phases, *course.at(phases), strict=True):
        name = MotionState(int(state)).name.lower()
        if start_problem(osc, name, float(phi), section):
            return failed
        phi = put_on_flank(osc, name, float(phi), section)
        call = TrajectoryCall(osc, (float(state), phi, float(phi_dot), section),
                              numerics=NUMERICS, wanted=wanted)
        call.run((1, section * osc.period), [(1, section * osc.period)])
        if call.status != Status.OK:
            return failed
        call.events["cycle"] += round(cycle - section)
        lines.append(call.events)
    log = np.concatenate(lines)
    grazes = log[log["kind"] >= EventKind.NEAR_GRAZE]
    turns = [(float(one["cycle"] + one["t"] / osc.period),
              1 + int(one["kind"] - EventKind.NEAR_GRAZE)) for one in grazes]
    found, phase, speed = of_log(log, osc, course.motion, layout.cycles)
    return Seen(found, phase, speed, turns)


def agrees(layout: Layout, z: NDArray[Any], found: Seen) -> bool:
    """Whether the engine sees the same events, bounces at the end of a chatter aside."""
    if found.layout is None:
        return False
    phase = z[:-1:2]
    one = _told(layout, phase, unlisted(layout, phase, found.layout, found.phase))
    two = _told(found.layout, found.phase, unlisted(found.layout, found.phase, layout, phase))
    if len(one) != len(two) or not len(one):
        return len(one) == len(two)
    one, two = (rows[np.argsort(np.mod(rows[:, 0], layout.cycles))] for rows in (one, two))
    for shift in (0, 1, -1):
        rolled = np.roll(two, shift, axis=0)
        away = one[:, 0] - rolled[:, 0]
        away -= layout.cycles * np.round(away / layout.cycles)
        if np.max(np.abs(away)) < SAME_PHASE and np.array_equal(one[:, 1:], rolled[:, 1:]):
            return True
    return False


def _told(layout: Layout, phase: NDArray[Any], last: NDArray[Any]) -> NDArray[Any]:
    """Rows (phase, kind, flank) of the events that both must name."""
    told = np.ones(layout.n, dtype=bool)
    for end in np.flatnonzero(layout.kind == Happening.CHATTER_END):
        near = np.mod(phase[end] - phase, layout.cycles) < SUMMED
        told &= ~(near & layout.bounces)
    told[last] = False
    return np.column_stack([phase, layout.kind, layout.flank])[told]


def unlisted(layout: Layout, phase: NDArray[Any], other: Layout,
             theirs: NDArray[Any]) -> NDArray[Any]:
    """Numbers of the last bounces of chatters that another list of the same events has summed.

    Parameters
    ----------
    layout, other : Layout
    phase, theirs : phases of their events; chatters that end together are one

    Returns
    -------
    int array; empty where the other has other chatters
    """
    ends, others = (np.flatnonzero(one.kind == Happening.CHATTER_END) for one in (layout, other))
    if len(ends) != len(others):
        return np.empty(0, dtype=int)
    found: list[int] = []
    for end in map(int, ends):
        away = (theirs[others] - phase[end]) / layout.cycles
        their = int(others[np.argmin(np.abs(away - np.round(away)))])
        summed = max(0, _bounces_before(layout, end) - _bounces_before(other, their))
        found += [k % layout.n for k in range(end - summed, end)]
    return np.array(found, dtype=int)


def _bounces_before(layout: Layout, end: int) -> int:
    """How many bounces lead to the end of a chatter without another event between."""
    before = layout.bounces[np.arange(end - 1, end - 1 - layout.n, -1)]
    other = np.flatnonzero(~before)
    return int(other[0]) if len(other) else layout.n - 1


def turns_of(layout: Layout, z: NDArray[Any], found: Seen) -> list[Turn]:
    """Turns by the arc they lie on."""
    phase, turns = z[:-1:2], []
    for at, flank in found.turns:
        at += layout.cycles * np.ceil((phase[0] - at) / layout.cycles)
        arc = int(np.searchsorted(phase, at, side="right")) % layout.n
        turns.append(Turn(arc, flank, float(at)))
    return turns


def distance_at_turn(problem: Problem, layout: Layout, z: NDArray[Any], turn: Turn,
                     course: Course | None = None) -> tuple[float, float]:
    """Distance pressed into the flank (negative: off it) where it turns, over the scale; its phase.

    NaN where it turns nowhere near. The course is that of the motion, if it is known.
    """
    osc = problem.oscillator(problem.value(z))
    motion = problem.motions.of(osc)
    phase = turn.phase
    sign = 1.0 if turn.flank == 1 else -1.0
    moves = turn.flank == 1 or osc.back_flank_te
    contact = layout.arc[turn.arc] == Arc.CONTACT
    begin = z[2 * ((turn.arc - 1) % layout.n)]
    length = layout.cycles - np.mod(begin - z[2 * turn.arc], layout.cycles)
    last, course = np.inf, course or Course(problem, layout, z)
    for _ in range(50):
        _, phi, rate = (float(one[0]) for one in course.at(np.array([phase])))
        g = motion.derivatives(np.array([phase]), motion.piece(np.array([phase])))[:, 0]
        if not moves:
            phi, rate, g = phi + g[0], rate + g[1], np.zeros(6)
        x = sign * (phi + (osc.gap_width if turn.flank == 2 else 0.0))
        x_dot, bend = sign * rate, sign * (osc.force - g[2])
        if contact:
            bend -= 2 * osc.damping_ratio * x_dot + x
        step = -x_dot / bend / osc.period if bend else np.nan
        if not np.isfinite(step):
            break
        step = float(np.clip(step, -0.05, 0.05))
        if abs(step) < 1e-15 or (abs(step) >= last and last < 1e-10):
            return x / problem.scale, phase
        last, phase = abs(step), phase + step
        if not 0 <= np.mod(phase - begin, layout.cycles) <= length:
            break
    return np.nan, turn.phase
