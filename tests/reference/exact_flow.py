"""High-precision reference integrator of the lapping oscillator (mpmath, event driven).

It shares no line with the `lapwing` package: a test that compares the two compares two routes.
The motion (docs: model.md, section 3) is followed piece by piece of the TE table:

* flight: theta is a parabola, phi = theta - g a polynomial of degree <= 5 in local time;
* engagement: damped oscillator with polynomial forcing, in closed form;
* rigid following: phi = 0, the contact force F - g'' is a polynomial.

No event can be missed, up to rounding at the working precision (60 digits):

* polynomials: the roots of p' (found by recursion on the degree) cut the piece into monotone
  intervals; a sign change over a monotone interval is exactly one root, anything else is none;
* release: `first_fall` marches with a bound M2 >= |y''| that holds from the current time to the
  end of the piece. It steps only where y + y' w - M2 w^2/2 > 0 (no zero inside) or where
  y' + M2 w < 0 (y falls monotonically: one zero if the sign changes, none if not).
  For the homogeneous part h'' + 2 xi h' + h = 0 the energy h^2 + h'^2 never grows, so
  N = sqrt(h^2 + h'^2) bounds h and h' from then on, and M2 = (1 + 2 xi) N + max|p''|.

Both flanks are treated by one code: y = sigma (phi - phi_flank) is the depth into the flank,
sigma = +1 at the drive flank and -1 at the coast flank; y < 0 is off the flank, and
q = y'' of a tooth that moves freely (sigma (F - g''), or -F at a standing flank) > 0 presses.
"""

from __future__ import annotations

from collections import namedtuple
from itertools import pairwise

from mpmath import mp, mpf

WORKING_DIGITS = 60
LISTED_CHATTER = "1e-9"  # bounces are listed while the rest of the chatter exceeds this times P
NEGLECTED_CHATTER = "1e-36"  # times P: neglected part of a closed chatter
RESOLUTION = "1e-45"  # times P: what counts as no time at all
MAX_EVENTS = 100_000
MAX_MARCH = 5_000

Event = namedtuple("Event", "tau phase kind flank phi velocity_before velocity_after")
CycleState = namedtuple("CycleState", "cycle tau motion phi velocity deepest_separation")
Trajectory = namedtuple("Trajectory", "events final cycle_states")
Piece = namedtuple("Piece", "phase length g slope_jump")
Model = namedtuple(
    "Model",
    "force period damping restitution gap contact_law impact_law coast_flank pieces",
)


# --- polynomials: lists of coefficients, lowest power first -------------------------------


def value(c, t):
    """p(t) by Horner's rule."""
    total = mpf(0)
    for coefficient in reversed(c):
        total = total * t + coefficient
    return total


def derivative(c):
    return [k * c[k] for k in range(1, len(c))]


def shifted(c, s):
    """Coefficients of p(s + t) in t (repeated synthetic division)."""
    c = list(c)
    for first in range(len(c) - 1):
        for k in range(len(c) - 2, first - 1, -1):
            c[k] += s * c[k + 1]
    return c


def without_leading_zeros(c):
    c = list(c)
    while c and c[-1] == 0:
        c.pop()
    return c


def refine(function, slope, low, high):
    """The root of a monotone function that changes sign over [low, high].

    Newton's steps, kept inside the bracket; where rounding keeps them from settling (the slope
    is small at a near-grazing root), bisection ends the search.
    """
    rising = function(high) > 0
    t = high
    for iteration in range(6 * mp.prec):
        f = function(t)
        if f == 0:
            return t
        if (f > 0) == rising:
            high = t
        else:
            low = t
        d = slope(t)
        new = t - f / d if d != 0 and iteration < mp.prec else (low + high) / 2
        if not low <= new <= high:
            new = (low + high) / 2
        if abs(new - t) <= 4 * mp.eps * abs(new) or high - low <= 4 * mp.eps * abs(high):
            return new
        t = new
    raise ArithmeticError("root not refined")


def roots(c, length):
    """All points of (0, length) where the polynomial changes sign or touches zero, ascending."""
    c = without_leading_zeros(c)
    if len(c) <= 1:
        return []
    if len(c) == 2:
        root = -c[0] / c[1]
        return [root] if 0 < root < length else []
    d = derivative(c)
    marks = [mpf(0), *roots(d, length), length]
    found = []
    for low, high in pairwise(marks):
        at_low, at_high = value(c, low), value(c, high)
        if at_low * at_high < 0:
            found.append(refine(lambda t: value(c, t), lambda t: value(d, t), low, high))
        if at_high == 0 and high < length:
            found.append(high)
    return found


def sign_after_zero(c):
    """Sign of p(0+): that of the first coefficient that is not zero."""
    for coefficient in c:
        if coefficient != 0:
            return 1 if coefficient > 0 else -1
    return 0


def first_sign_change(c, length):
    """Smallest t in (0, length] past which p has the other sign than at 0+, or None."""
    while c and c[0] == 0:  # zeros at t = 0 belong to the past
        c = c[1:]
    if not c:
        return None
    before = c[0] > 0
    marks = [*roots(c, length), length]
    for mark, after in pairwise(marks):
        between = value(c, (mark + after) / 2)
        if between != 0 and (between > 0) != before:
            return mark
    at_end = value(c, length)
    return length if at_end != 0 and len(marks) == 1 and (at_end > 0) != before else None


# --- damped oscillator with polynomial forcing -----------------------------------------------


class Engagement:
    """y'' + 2 xi y' + y = q(t) from (y0, v0), in closed form for any xi >= 0."""

    def __init__(self, xi, q, y0, v0):
        self.xi = xi
        self.omega2 = 1 - xi * xi
        p = [mpf(0)] * (len(q) + 2)
        for n in range(len(q) - 1, -1, -1):  # compare the powers of t, highest first
            p[n] = q[n] - 2 * xi * (n + 1) * p[n + 1] - (n + 2) * (n + 1) * p[n + 2]
        self.p = p[: len(q)]
        self.dp = derivative(self.p)
        self.ddp = derivative(self.dp)
        self.a = y0 - p[0]
        self.b = v0 - p[1] + xi * self.a

    def _circular(self, t):
        """cos(w t), sin(w t)/w with w^2 = 1 - xi^2 of either sign, times exp(-xi t)."""
        decay = mp.exp(-self.xi * t)
        w = mp.sqrt(abs(self.omega2))
        if self.omega2 > 0:
            return decay * mp.cos(w * t), decay * mp.sin(w * t) / w
        if self.omega2 < 0:
            return decay * mp.cosh(w * t), decay * mp.sinh(w * t) / w
        return decay, decay * t

    def homogeneous(self, t):
        c, s = self._circular(t)
        h = self.a * c + self.b * s
        return h, (self.b - self.xi * self.a) * c - (self.xi * self.b + self.omega2 * self.a) * s

    def state(self, t):
        h, dh = self.homogeneous(t)
        return h + value(self.p, t), dh + value(self.dp, t)

    def derivative_bound(self, t, end, order):
        """Bound of |d^order y| over [t, end] (order >= 1); see the head of this file."""
        h, dh = self.homogeneous(t)
        bounds = [mp.sqrt(h * h + dh * dh)] * 2
        for _ in range(order - 1):
            bounds.append(2 * self.xi * bounds[-1] + bounds[-2])
        c = self.p
        for _ in range(order):
            c = derivative(c)
        return bounds[order] + value([abs(x) for x in c], end)


def clear_start(motion, start_derivatives, end):
    """A time up to which y > 0 is certain although y(0) = 0; 0 if y falls; None if y stays 0."""
    for order, d in enumerate(start_derivatives, start=1):
        if d < 0:
            return mpf(0)
        if d > 0:  # the derivative of this order keeps its sign at least so long
            bound = motion.derivative_bound(mpf(0), end, order + 1)
            return min(end, mpf("0.9") * d / bound) if bound > 0 else end
    return None


def first_fall(motion, t, end):
    """First zero of y after t, where y(t) > 0; None if y > 0 up to the end."""
    for _ in range(MAX_MARCH):
        if t >= end:
            return None
        y, dy = motion.state(t)
        if y <= 0:
            raise ArithmeticError("engagement lost its flank between two steps")
        m2 = motion.derivative_bound(t, end, 2)
        if m2 == 0:
            m2 = mp.eps * mp.eps
        step = mpf("0.99") * (dy + mp.sqrt(dy * dy + 2 * m2 * y)) / m2
        if dy < 0:
            monotone = min(mpf("0.99") * -dy / m2, end - t)
            if motion.state(t + monotone)[0] <= 0:
                return refine(
                    lambda x: motion.state(x)[0], lambda x: motion.state(x)[1], t, t + monotone
                )
            step = max(step, monotone)
        t = min(t + step, end)
    raise ArithmeticError("release undecided: the tooth grazes the point of release")


# --- the scene, from decimal strings ------------------------------------------------------------


def hermite(rows, quintic):
    """Pieces (phase, coefficients in phase) of a periodic Hermite table.

    Rows: phase, value, slope[, curvature if quintic]; everything per mesh period.
    """
    pieces = []
    for this, following in zip(rows, [*rows[1:], [rows[0][0] + 1, *rows[0][1:]]], strict=True):
        h = following[0] - this[0]
        y0, d0, y1, d1 = this[1], this[2] * h, following[1], following[2] * h
        if quintic:
            e0, e1 = this[3] * h * h / 2, following[3] * h * h
            r0, r1, r2 = y1 - y0 - d0 - e0, d1 - d0 - 2 * e0, e1 - 2 * e0
            c = [y0, d0, e0, 10 * r0 - 4 * r1 + r2 / 2, -15 * r0 + 7 * r1 - r2]
            c.append(6 * r0 - 3 * r1 + r2 / 2)
        else:
            c = [y0, d0, 3 * (y1 - y0) - 2 * d0 - d1, 2 * (y0 - y1) + d0 + d1]
        pieces.append((this[0], [c[k] / h**k for k in range(len(c))]))
    return pieces


def te_pieces(te):
    if te["kind"] == "pieces":
        return [(mpf(p), [mpf(x) for x in c]) for p, c in te["pieces"]]
    rows = [[mpf(x) for x in row] for row in te["rows"]]
    return hermite(rows, te["kind"] == "quintic_hermite")


def flank_pieces(scene, gear_ratio, period):
    """g = +-i12 TE as polynomials of tau since each knot, with the slope jump at the knot."""
    sign = -1 if scene.get("te_sign", "printed") == "geometric" else 1
    table = te_pieces(scene["te"])
    if table[0][0] != 0:
        raise ValueError("the TE table must start at phase 0")
    ends = [p for p, _ in table[1:]] + [mpf(1)]
    raw = []
    for (phase, c), end in zip(table, ends, strict=True):
        length = (end - phase) * period
        g = [sign * gear_ratio * c[k] / period**k for k in range(len(c))]
        # what a Hermite formula leaves of a power that is absent is rounding: drop it
        rounding = mp.eps * mpf(10) ** 10
        scale = max(abs(g[k]) * length**k for k in range(len(g)))
        g = [x if abs(x) * length**k > rounding * scale else mpf(0) for k, x in enumerate(g)]
        raw.append((phase, length, without_leading_zeros(g) or [mpf(0)]))
    pieces = []
    for k, (phase, length, g) in enumerate(raw):
        _, before_length, before = raw[k - 1]
        jump = value(derivative(g), mpf(0)) - value(derivative(before), before_length)
        span = max(abs(value(derivative(g), x)) for x in (mpf(0), length)) + abs(jump)
        pieces.append(Piece(phase, length, g, jump if abs(jump) > rounding * span else mpf(0)))
    return pieces


def dimensionless(scene):
    """F, Omega, P, xi, i12 and omega' of a scene; a scene may also give force and ratio itself."""
    if "force" in scene:
        ratio, force = mpf(scene["mesh_frequency_ratio"]), mpf(scene["force"])
        gear_ratio, natural = mpf(scene.get("gear_ratio", 1)), mpf(1)
    else:
        j1, j2 = mpf(scene["pinion_inertia"]), mpf(scene["gear_inertia"])
        z1 = mpf(scene["pinion_teeth"])
        gear_ratio = mpf(scene["gear_teeth"]) / z1
        inertia = j1 * j2 / (gear_ratio**2 * j1 + j2)
        stiffness = mpf(scene["mesh_stiffness"]) * mpf(scene["pinion_base_lever"]) ** 2
        natural = mp.sqrt(stiffness / inertia)
        brake = mpf(scene["brake_torque"])
        drive = mpf(scene["drive_torque"]) if "drive_torque" in scene else brake / gear_ratio
        force = (gear_ratio * brake / j2 + drive / j1) / natural**2
        ratio = z1 * mpf(scene["pinion_speed_rpm"]) * 2 * mp.pi / 60 / natural
    return {
        "force": force,
        "mesh_frequency_ratio": ratio,
        "period": 2 * mp.pi / ratio,
        "damping_ratio": mpf(scene["damping_ratio"]),
        "gear_ratio": gear_ratio,
        "angular_frequency": natural,
    }


def build_model(scene):
    numbers = dimensionless(scene)
    law, impact = scene["contact_law"], scene.get("impact_law", "relative")
    if impact == "absolute" and law != "restitution":
        raise ValueError("the absolute impact law needs contact_law = restitution")
    gap = scene.get("gap", "one_sided")
    coast = "moving" if scene.get("back_flank_te", True) else "standing"
    return Model(
        force=numbers["force"],
        period=numbers["period"],
        damping=numbers["damping_ratio"],
        restitution=mpf(scene["restitution"]),
        gap=mpf(scene["backlash"]) * (2 if gap == "symmetric" else 1),
        contact_law=law,
        impact_law=impact,
        coast_flank=None if gap == "one_flank" else coast,
        pieces=flank_pieces(scene, numbers["gear_ratio"], numbers["period"]),
    )


# --- the hybrid motion ------------------------------------------------------------------------


class Motion:
    """State and event log. `motion` is separation, drive or coast; `touching` names the flank
    whose y is exactly 0 (so that rounding never decides on which side a tooth starts)."""

    def __init__(self, model):
        self.model = model
        self.events, self.cycle_states = [], []
        self.cycle, self.piece, self.s = 0, 0, mpf(0)
        self.motion, self.touching = "separation", None
        self.phi = self.velocity = self.start_phase = mpf(0)
        self.deepest = mpf(0)

    # where the tooth is

    def tau(self):
        m = self.model
        knot = self.cycle + m.pieces[self.piece].phase - self.start_phase
        return knot * m.period + self.s

    def local_g(self):
        """g from now on, as six coefficients of the time ahead."""
        c = shifted(self.model.pieces[self.piece].g, self.s)
        return c + [mpf(0)] * (6 - len(c))

    def remaining(self):
        return self.model.pieces[self.piece].length - self.s

    def standing(self, flank):
        return flank == "coast" and self.model.coast_flank == "standing"

    def free_flight(self, flank):
        """Coefficients of the depth y(t) into a flank while the tooth flies."""
        g, force = self.local_g(), self.model.force
        phi = [self.phi, self.velocity, force / 2 - g[2], -g[3], -g[4], -g[5]]
        if flank == "coast":
            if self.standing(flank):
                phi = [self.phi + g[0], self.velocity + g[1], force / 2]
            phi = [-(phi[0] + self.model.gap), *(-x for x in phi[1:])]
        if self.touching == flank:
            phi[0] = mpf(0)
        return phi

    def pressing(self, flank):
        """q(t) = y'' of the free tooth: positive where the load presses it onto the flank."""
        return derivative(derivative(self.free_flight(flank)))

    def set_depth(self, flank, y, dy):
        """phi, phi' from the depth into a flank and its rate, at the present time."""
        if flank == "drive":
            self.phi, self.velocity = y, dy
            return
        self.phi, self.velocity = -y - self.model.gap, -dy
        if self.standing(flank):
            g = self.local_g()
            self.phi, self.velocity = self.phi - g[0], self.velocity - g[1]

    # the log

    def log(self, kind, flank, before, after):
        """`before` and `after` are velocities relative to the flank in the sense of phi."""
        if len(self.events) >= MAX_EVENTS:
            raise RuntimeError("more events than MAX_EVENTS")
        phase = self.model.pieces[self.piece].phase + self.s / self.model.period
        self.events.append(Event(self.tau(), phase, kind, flank, self.phi, before, after))

    def log_contact(self, kind, flank, dy_before, dy_after):
        sign = 1 if flank == "drive" else -1
        self.log(kind, flank, sign * dy_before, sign * dy_after)

    # flight

    def step_flight(self):
        end = self.remaining()
        arrivals = []
        for flank in ("drive", "coast") if self.model.coast_flank else ("drive",):
            t = self.arrival(flank, end)
            if t is not None:
                arrivals.append((t, flank))
        if not arrivals:
            self.fly(end)
            self.touching = None
            return self.cross_knot()
        t, flank = min(arrivals, key=lambda item: item[0])  # a tie goes to the drive flank
        dy = value(derivative(self.free_flight(flank)), t)
        self.fly(t)
        self.touching = flank
        self.set_depth(flank, mpf(0), dy)
        return self.arrive(flank, dy)

    def arrival(self, flank, end):
        y = self.free_flight(flank)
        if y[0] > 0 or (y[0] == 0 and sign_after_zero(y) > 0):
            if y[0] > mpf(RESOLUTION) * self.model.gap:
                raise ValueError("separation inside a flank")
            return mpf(0)
        return first_sign_change(y, end)

    def fly(self, t):
        if t == 0:
            return
        y = self.free_flight("drive")
        turning = [x for x in roots(derivative(y), t)]
        self.deepest = max(self.deepest, *(-value(y, x) for x in [*turning, mpf(0), t]))
        self.phi, self.velocity = value(y, t), value(derivative(y), t)
        self.s += t

    # impacts

    def arrive(self, flank, dy):
        """The tooth reaches a flank with depth rate dy >= 0."""
        if self.model.contact_law == "compliant":
            self.log_contact("engage", flank, dy, dy)
            self.motion = flank
            return
        after = self.strike(flank, dy)
        if after > 0 or (after == 0 and self.stays(flank)):
            self.log_contact("engage", flank, after, after)
            self.motion = flank
        elif after < 0:
            self.close_chatter(flank, -after)

    def strike(self, flank, dy):
        """Apply and log the impact law; returns the depth rate after it."""
        eps = self.model.restitution
        after = -eps * dy
        if self.model.impact_law == "absolute" and not self.standing(flank):
            slope = self.local_g()[1]
            after -= (1 + eps) * (slope if flank == "drive" else -slope)
        self.log_contact("impact", flank, dy, after)
        self.set_depth(flank, mpf(0), after)
        return after

    def stays(self, flank):
        """Decision j: y = y' = 0 stays if the first load derivative that is not 0 presses."""
        return sign_after_zero(self.pressing(flank)) >= 0

    def close_chatter(self, flank, v):
        """Sum the rest of a complete chatter (decision i) once it is short and certain."""
        m = self.model
        q = self.pressing(flank) + [mpf(0)] * 3
        if q[0] <= 0:
            return
        if m.impact_law == "absolute" and not self.standing(flank):
            rest = 2 * v / q[0]
            if max(rest, abs(self.local_g()[1]) / q[0]) <= mpf(RESOLUTION) * m.period:
                self.end_chatter(flank, mpf(0))
            return
        if m.restitution == 1:
            return
        rest, first, neglected = chatter_rest(q, v, 1 - m.restitution)
        clear = 2 * first < self.remaining() and first_sign_change(q, 2 * first) is None
        short = first <= mpf(LISTED_CHATTER) * m.period
        if short and clear and neglected <= mpf(NEGLECTED_CHATTER) * m.period:
            self.end_chatter(flank, rest)
        elif first <= mpf(RESOLUTION) * m.period:
            self.end_chatter(flank, mpf(0))

    def end_chatter(self, flank, rest):
        self.s += rest
        self.set_depth(flank, mpf(0), mpf(0))
        self.motion, self.touching = flank, flank
        self.log_contact("chatter_end", flank, mpf(0), mpf(0))

    # contact

    def step_contact(self):
        flank, end = self.motion, self.remaining()
        if self.model.contact_law == "rigid":
            return self.step_rigid(flank, end)
        y, dy = self.depth(flank)
        q = self.pressing(flank)
        motion = Engagement(self.model.damping, q, y, dy)
        t = self.release_time(motion, y, dy, q, end)
        if t is None:
            self.s += end
            self.touching = None
            self.set_depth(flank, *motion.state(end))
            return self.cross_knot()
        self.s += t
        return self.release(flank, motion.state(t)[1] if t > 0 else dy)

    def depth(self, flank):
        y = self.free_flight(flank)
        return y[0], y[1]

    def release_time(self, motion, y, dy, q, end):
        if y > 0:
            return first_fall(motion, mpf(0), end)
        xi, ahead = self.model.damping, [dy]
        load, before = q, mpf(0)  # y^(n+2) = q^(n) - 2 xi y^(n+1) - y^(n)
        while len(ahead) < 8:
            ahead.append((load[0] if load else mpf(0)) - 2 * xi * ahead[-1] - before)
            before, load = ahead[-2], derivative(load)
        clear = clear_start(motion, ahead, end)
        if clear is None:
            return None
        return mpf(0) if clear == 0 else first_fall(motion, clear, end)

    def release(self, flank, dy):
        self.set_depth(flank, mpf(0), dy)
        self.motion, self.touching = "separation", flank
        self.log_contact("release", flank, dy, dy)

    def step_rigid(self, flank, end):
        q = self.pressing(flank)
        if sign_after_zero(q) < 0:
            return self.release(flank, mpf(0))
        t = first_sign_change(q, end)
        if t is not None:
            self.s += t
            return self.release(flank, mpf(0))
        self.s += end
        self.set_depth(flank, mpf(0), mpf(0))
        return self.cross_knot()

    # knots and cycles

    def cross_knot(self):
        self.piece, self.s = self.piece + 1, mpf(0)
        new_cycle = self.piece == len(self.model.pieces)
        if new_cycle:
            self.piece, self.cycle = 0, self.cycle + 1
        jump = self.model.pieces[self.piece].slope_jump
        if jump != 0:
            self.cross_kink(jump)
        if new_cycle:
            self.cycle_states.append(self.snapshot())
            self.deepest = mpf(0)

    def cross_kink(self, jump):
        """Decisions b and c: theta' is continuous; a rigid contact is struck or released."""
        before, flank = self.velocity, self.motion
        self.velocity = before - jump
        self.log("kink", "none", before, self.velocity)
        rigid = self.model.contact_law == "rigid" and flank != "separation"
        if not rigid or self.standing(flank):
            return
        dy = self.velocity if flank == "drive" else -self.velocity
        struck = dy > 0
        if struck:
            dy = self.strike(flank, dy)
        if dy < 0:
            self.release(flank, dy)
            if struck:
                self.close_chatter(flank, -dy)

    def snapshot(self):
        return CycleState(
            self.cycle, self.tau(), self.motion, self.phi, self.velocity, self.deepest
        )


def chatter_rest(q, v, loss):
    """Rest of a complete chatter after a rebound at speed v; its first term; what it neglects.

    q: load polynomial (a, j, snap/2, ...); loss = 1 - restitution. In a piece where a is
    constant the first term is exact. Far from the end the correction may exceed the first
    term, so only the first term may decide whether the chatter is short.
    """
    a, j, snap = q[0], q[1], 2 * abs(q[2])
    first = 2 * v / (a * loss)
    correction = 4 * j * v * v / (3 * a**3 * loss**2)
    ratio = 2 * abs(j) * v / (3 * a * a * loss)
    return first - correction, first, first * (ratio**2 + snap * v * v / (a**3 * loss**2))


def place_at_start(motion, start):
    """`start`: 'rest', or a dict with phase and, unless at rest, motion, phi and velocity."""
    model = motion.model
    start = {} if start == "rest" else start
    motion.start_phase = phase = mpf(start.get("phase", 0))
    motion.piece = max(k for k, p in enumerate(model.pieces) if p.phase <= phase)
    motion.s = (phase - model.pieces[motion.piece].phase) * model.period
    if "motion" in start:
        motion.motion = start["motion"]
        motion.phi, motion.velocity = mpf(start["phi"]), mpf(start["velocity"])
        check_start(motion)
        return
    flank = "coast" if model.force < 0 else "drive"
    if flank == "coast" and model.coast_flank is None:
        raise ValueError("no flank to rest on")
    depth = mpf(0) if model.contact_law == "rigid" else abs(model.force)
    motion.motion, motion.touching = flank, (flank if depth == 0 else None)
    motion.set_depth(flank, depth, mpf(0))


def check_start(motion):
    flanks = ("drive", "coast") if motion.model.coast_flank else ("drive",)
    for flank in flanks:
        y = motion.free_flight(flank)[0]
        if y == 0:
            motion.touching = flank
        if (motion.motion == "separation" and y > 0) or (motion.motion == flank and y < 0):
            raise ValueError("the start contradicts its motion state")


def simulate(scene, start, cycles, digits=WORKING_DIGITS):
    """Follow a scene to phase 0 of mesh cycle number `cycles`.

    Returns Trajectory(events, final, cycle_states): every Event; the CycleState at the end (the
    right limit at phase 0); and the same at each cycle end, with the deepest separation of the
    cycle. Numbers in `scene` and `start` are decimal strings (or doubles, taken exactly).
    """
    with mp.workdps(digits):
        motion = Motion(build_model(scene))
        place_at_start(motion, start)
        while motion.cycle < cycles:
            if motion.motion == "separation":
                motion.step_flight()
            else:
                motion.step_contact()
        return Trajectory(motion.events, motion.snapshot(), motion.cycle_states)
