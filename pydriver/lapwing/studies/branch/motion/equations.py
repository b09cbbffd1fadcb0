"""A periodic motion as equations between its events: what continuation solves.

Unknowns are phase u and speed w into the flank of each event. The arc from one event to the next
is a formula, so each event gives two equations: the tooth is at the flank, and as fast as said.
Both stay smooth, and their matrix regular, where an approach or rebound speed passes zero: a graze
is a point on a curve like any other, which an iteration over the map from cycle to cycle, whose
matrix grows as 1/w there, can only come near.

With X the distance pressed into a flank, σ = 1 at the drive flank and -1 at the coast flank,
h = g or the fixed place of a standing flank, s the length of the arc in τ:

    flight    X = σ(h_i + (h'_i + σw₊)s + F s²/2 - h_j); along one flank over s, where the
              equation of a bounce keeps its digits however short it is
    contact   X = σ(F + q_j) + E(s)(-σ(F + q_i), w₊ - σq'_i), over s; E the free oscillation
    chatter   s = 2U/(a(1-ε)) - 4jU²/(3a³(1-ε)²), U = -w₊, a = σ(F - h''), j = -σh'''
    rest      σ(F - h'') = 0, or the phase of a kink

w₊ is the speed after the event: -εw, under `absolute` -εw - (1+ε)σh', w where no impact law acts.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lapwing.model.linear_steps import unit_motions
from lapwing.model.oscillator import Oscillator
from lapwing.studies.branch.motion.flank_motion import FlankMotion
from lapwing.studies.branch.motion.layout import Arc, Happening, Layout


@dataclass(frozen=True)
class Events:
    """Where a motion's events are.

    Attributes
    ----------
    phase : array (n,), mesh periods since the first cycle's beginning; may leave 0 to `cycles`
    speed : array (n,), rad per τ; into the flank, before the event
    """

    phase: NDArray[Any]
    speed: NDArray[Any]


@dataclass(frozen=True)
class AtEvents:
    """What is known at each event, arrays (n,)."""

    sign: NDArray[Any]
    g: NDArray[Any]
    h: NDArray[Any]
    response: NDArray[Any]
    after: NDArray[Any]
    by_speed: NDArray[Any]
    by_time: NDArray[Any]


def at_events(layout: Layout, events: Events, osc: Oscillator, motion: FlankMotion) -> AtEvents:
    """Flanks, their derivatives (6, n), response (2, n) and speeds after each event.

    `by_speed` and `by_time` are the derivatives of the speed after it.
    """
    sign, coast = layout.sign, layout.coast
    h = g = motion.derivatives(events.phase, layout.piece)
    if len(coast):
        h = g.copy()
        if osc.back_flank_te:
            h[0, coast] -= osc.gap_width
        else:
            h[:, coast] = 0.0
            h[0, coast] = -osc.gap_width
    response = np.zeros((2, layout.n))
    if Arc.CONTACT in layout.by_arc:
        response = motion.response(events.phase, layout.piece)
        if not osc.back_flank_te:
            response[:, coast] = 0.0
    after, by_speed, by_time = events.speed.copy(), np.ones(layout.n), np.zeros(layout.n)
    if osc.contact_law != "compliant":
        struck = layout.arrivals | ((layout.kind == Happening.AT_KINK) & (events.speed > 0))
        by_speed = np.where(struck, -osc.restitution, 1.0)
        after *= by_speed
        if osc.impact_law == "absolute":
            kick = np.where(struck, -(1 + osc.restitution) * sign, 0.0)
            after += kick * h[1]
            by_time = kick * h[2]
    if layout.chatters:
        ended = layout.kind == Happening.CHATTER_END
        after[ended], by_speed[ended] = 0.0, 0.0
    return AtEvents(sign, g, h, response, after, by_speed, by_time)


def pressing(known: AtEvents, osc: Oscillator) -> NDArray[Any]:
    """Acceleration into its flank at each event, without contact force: σ(F - h'')."""
    press: NDArray[Any] = known.sign * (osc.force - known.h[2])
    return press


def residual(layout: Layout, events: Events, osc: Oscillator, motion: FlankMotion,
             scale: float) -> NDArray[Any]:
    """By how much each event's two equations are off: array (2n,), parts of `scale` (rad)."""
    return _System(layout, events, osc, motion, scale).residual()


def blocks(layout: Layout, events: Events, osc: Oscillator, motion: FlankMotion,
           scale: float) -> tuple[NDArray[Any], NDArray[Any], NDArray[Any]]:
    """Residual, and its derivatives by the event before and by the event: (n, 2, 2) each.

    The unknowns are phases and speeds over scale/P.
    """
    system = _System(layout, events, osc, motion, scale)
    return system.residual(), *system.derivatives()


class _System:
    """One evaluation."""

    def __init__(self, layout: Layout, events: Events, osc: Oscillator, motion: FlankMotion,
                 scale: float) -> None:
        self.layout, self.events, self.osc, self.motion = layout, events, osc, motion
        self.scale, self.period = scale, osc.period
        self.known = at_events(layout, events, osc, motion)
        self.before, self.same = layout.before, layout.one_flank
        u = events.phase
        wrapped = u[self.before]
        wrapped[0] -= layout.cycles
        self.s = (u - wrapped) * self.period
        # An arc of no length stands for the limit; its equation is still regular.
        self.s[self.s == 0] = 1e-300

    def residual(self) -> NDArray[Any]:
        found = np.zeros((self.layout.n, 2))
        self.lean = np.zeros(self.layout.n)
        self.arrival = np.zeros(self.layout.n)
        fill = (self._flight, self._contact, self._chatter, self._rest)
        for arc, events in self.layout.by_arc.items():
            fill[arc](events, found)
        return found.ravel()

    def derivatives(self) -> tuple[NDArray[Any], NDArray[Any]]:
        one, two = np.zeros((2, self.layout.n, 2, 2))
        fill = (self._by_flight, self._by_contact, self._by_chatter, self._by_rest)
        for arc, events in self.layout.by_arc.items():
            fill[arc](events, one, two)
        # By phase and by scaled speed.
        for part in (one, two):
            part[:, :, 0] *= self.period
            part[:, :, 1] *= self.scale / self.period
        return one, two

    def _flight(self, j: NDArray[Any], found: NDArray[Any]) -> None:
        known, s, force = self.known, self.s[j], self.osc.force
        i, sign = self.before[j], known.sign[j]
        begun = known.sign[i] * known.after[i]
        same, h = self.same[j], known.h
        arrival = sign * (h[1, i] + begun + force * s - h[1, j])
        # Distance over s along one flank, distance over the period to the other.
        lean = sign * (h[0, i] + (h[1, i] + begun) * s + 0.5 * force * s * s - h[0, j])
        lean = lean / np.where(same, s, self.period)
        # The first event follows on the last one of the repetition before.
        piece = self.layout.piece[i] - np.where(j == 0, self.motion.pieces * self.layout.cycles, 0)
        close = np.flatnonzero(same & (piece == self.layout.piece[j]) & (s < 0.5 * self.period))
        if len(close):
            a, t = i[close], s[close]
            moves = self.osc.back_flank_te | (self.layout.flank[a] == 1)
            bend = np.where(moves, self.motion.bend(self.events.phase[a], known.g[:, a], t), 0.0)
            lean[close] = known.after[a] + sign[close] * (0.5 * force * t - bend)
        self.lean[j], self.arrival[j] = lean, arrival
        found[j, 0] = lean * (self.period / self.scale)
        found[j, 1] = (arrival - self.events.speed[j]) * (self.period / self.scale)

    def _by_flight(self, j: NDArray[Any], one: NDArray[Any], two: NDArray[Any]) -> None:
        known, s, force, h = self.known, self.s[j], self.osc.force, self.known.h
        i, sign, same = self.before[j], known.sign[j], self.same[j]
        over, factor = np.where(same, s, self.period), self.period / self.scale
        kick = known.sign[i] * known.by_time[i]
        by_start = sign * (h[2, i] + kick - force)
        carried = sign * known.sign[i] * known.by_speed[i]
        lean = np.where(same, self.lean[j], 0.0)
        two[j, 0, 0] = factor * (self.arrival[j] - lean) / over
        left = sign * known.sign[i] * known.after[i]
        one[j, 0, 0] = factor * (by_start * s + lean - left) / over
        one[j, 0, 1] = factor * carried * s / over
        two[j, 1, 0] = factor * sign * (force - h[2, j])
        one[j, 1, 0] = factor * by_start
        one[j, 1, 1] = factor * carried
        two[j, 1, 1] = -factor

    def _contact(self, j: NDArray[Any], found: NDArray[Any]) -> None:
        known, s, i = self.known, self.s[j], self.before[j]
        sign, factor = known.sign[j], self.period / self.scale
        free = unit_motions(self.osc.damping_ratio, s)
        start = np.array([-sign * (self.osc.force + known.response[0, i]),
                          known.after[i] - sign * known.response[1, i]])
        moved = np.einsum("xyn,yn->xn", free, start)
        depth = sign * (self.osc.force + known.response[0, j]) + moved[0]
        self.lean[j] = depth / s
        self.arrival[j] = sign * known.response[1, j] + moved[1]
        found[j, 0] = self.lean[j] * factor
        found[j, 1] = (self.arrival[j] - self.events.speed[j]) * factor

    def _by_contact(self, j: NDArray[Any], one: NDArray[Any], two: NDArray[Any]) -> None:
        known, s, i = self.known, self.s[j], self.before[j]
        xi, factor = self.osc.damping_ratio, self.period / self.scale
        free, press = unit_motions(xi, s), pressing(known, self.osc)
        late = np.array([-known.after[i],
                         known.by_time[i] - press[i] + 2 * xi * known.after[i]])
        late, fast = np.einsum("xyn,yn->xn", free, late), free[:, 1] * known.by_speed[i]
        two[j, 0, 0] = factor * (self.arrival[j] - self.lean[j]) / s
        one[j, 0, 0] = factor * (late[0] + self.lean[j]) / s
        one[j, 0, 1] = factor * fast[0] / s
        two[j, 1, 0] = factor * (press[j] - 2 * xi * self.arrival[j] - self.lean[j] * s)
        one[j, 1, 0] = factor * late[1]
        one[j, 1, 1] = factor * fast[1]
        two[j, 1, 1] = -factor

    def _chatter(self, j: NDArray[Any], found: NDArray[Any]) -> None:
        rest, _, _ = self._chatter_rest(self.before[j])
        found[j, 0] = (self.s[j] - rest) / self.period
        found[j, 1] = -self.events.speed[j] * (self.period / self.scale)

    def _chatter_rest(self, i: NDArray[Any]) -> tuple[NDArray[Any], NDArray[Any], NDArray[Any]]:
        known, loss = self.known, 1 - self.osc.restitution
        press, jerk = pressing(known, self.osc)[i], -known.sign[i] * known.h[3, i]
        speed = -known.after[i]
        rest = 2 * speed / (press * loss) - 4 * jerk * speed**2 / (3 * press**3 * loss**2)
        by_speed = 2 / (press * loss) - 8 * jerk * speed / (3 * press**3 * loss**2)
        return rest, by_speed, -2 * speed * jerk / (press**2 * loss)

    def _by_chatter(self, j: NDArray[Any], one: NDArray[Any], two: NDArray[Any]) -> None:
        i, known = self.before[j], self.known
        _, by_speed, by_time = self._chatter_rest(i)
        two[j, 0, 0] = 1 / self.period
        one[j, 0, 0] = (-1 - by_time + by_speed * known.by_time[i]) / self.period
        one[j, 0, 1] = by_speed * known.by_speed[i] / self.period
        two[j, 1, 1] = -self.period / self.scale

    def _rest(self, j: NDArray[Any], found: NDArray[Any]) -> None:
        known, kind = self.known, self.layout.kind[j]
        press = pressing(known, self.osc)[j] * self.period**2 / self.scale
        found[j, 0], thrown = press, np.zeros(len(j))
        for k in np.flatnonzero(kind == Happening.AT_KINK):
            piece = self.layout.piece[j[k]]
            found[j[k], 0] = self.events.phase[j[k]] - self.motion.begin(piece)
            thrown[k] = -known.sign[j[k]] * self.motion.slope_jump(piece)
        found[j, 1] = (thrown - self.events.speed[j]) * self.period / self.scale

    def _by_rest(self, j: NDArray[Any], one: NDArray[Any], two: NDArray[Any]) -> None:
        known = self.known
        two[j, 0, 0] = np.where(
            self.layout.kind[j] == Happening.AT_KINK, 1 / self.period,
            -known.sign[j] * known.h[3, j] * self.period**2 / self.scale)
        two[j, 1, 1] = -self.period / self.scale
