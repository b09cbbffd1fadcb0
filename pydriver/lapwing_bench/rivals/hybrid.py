"""The hybrid loop that integrators with terminal events share.

A rival that stops at each event gives one function, `advance(motion state, arc, τ, end, φ, φ',
bounce)`: it integrates up to the first event or the end and returns τ, φ, φ' and the flank
touched (0: none).
"""

from __future__ import annotations

from typing import NamedTuple

from lapwing.base.codes import EventKind
from lapwing_bench.outcome import Record

SEPARATION, DRIVE, COAST = 0, 1, 2
MAX_EVENTS = 50_000


def back(kind, flank):
    """Number of an event at a flank."""
    return int(kind) + (flank == COAST)


def resolve(problem, arc, flank, tau, before):
    """What an arrival at a flank does.

    Returns
    -------
    kinds : list of the events logged
    motion_state : int
    after : float, φ', rad per τ
    """
    if problem.compliant:
        return [EventKind.ENGAGE], flank, before
    after = -problem.restitution * before
    if problem.absolute:
        after -= (1 + problem.restitution) * problem.slope(arc, tau)
    side = 1 if flank == DRIVE else -1
    pressed = side * (problem.force - problem.curvature(arc, tau)) > 0
    if abs(after) < problem.sticking and pressed:
        return [EventKind.IMPACT, EventKind.CHATTER_END], flank, 0.0
    if side * after > 0:
        return [EventKind.IMPACT, EventKind.ENGAGE], flank, after
    return [EventKind.IMPACT], SEPARATION, after


class Bounce(NamedTuple):
    """The flight of a tooth thrown off a flank, as far as it is known before.

    A first step must not leap over it all, and the smallest bounce needs tolerances of its size.
    """

    half: float   #: τ; half its duration
    angle: float  #: rad; its height, or the natural size of angles
    speed: float  #: rad per τ; its own, or the natural size of velocities


def bounce_from(problem, arc, tau, phi_dot):
    """The flight that begins at φ' (None: nothing is known of it)."""
    pull = abs(problem.force - problem.curvature(arc, tau))
    if pull == 0 or phi_dot == 0:
        return None
    return Bounce(abs(phi_dot) / pull, min(problem.angle, phi_dot**2 / (2 * pull)),
                  min(problem.speed, abs(phi_dot)))


def follow(problem, cycles, advance):
    """Run from rest at phase 0; a Record."""
    state, phi, phi_dot, tau = DRIVE, problem.force, 0.0, 0.0
    rows, bounce, first = [], None, True
    for end, arc in problem.arc_list(cycles):
        if not first:
            phi_dot -= arc.jump
        first, bounce = False, None
        while tau < end:
            try:
                tau, phi, phi_dot, flank = advance(state, arc, tau, end, phi, phi_dot, bounce)
            except (RuntimeError, ValueError) as error:
                return Record(rows, problem.period, (state, phi, phi_dot), str(error))
            bounce = None
            if not flank:
                break
            phi = 0.0 if flank == DRIVE else -problem.backlash
            if state == SEPARATION:
                kinds, state, phi_dot = resolve(problem, arc, flank, tau, phi_dot)
            else:
                kinds, state = [EventKind.RELEASE], SEPARATION
            rows += [(back(kind, flank), tau, phi_dot) for kind in kinds]
            if state == SEPARATION:
                bounce = bounce_from(problem, arc, tau, phi_dot)
            if len(rows) > MAX_EVENTS:
                return Record(rows, problem.period, (state, phi, phi_dot), "too many events")
        tau = end
    return Record(rows, problem.period, (state, phi, phi_dot))
