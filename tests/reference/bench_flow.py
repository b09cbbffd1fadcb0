"""Reference integrator of the benchmark's scenes: harmonic series and tables, multi-precision.

It shares no line with the engine and none with the methods it is measured against. Between events
the motion is known in closed form (a parabola in θ; steady response plus decay in φ), for a
harmonic series in one stretch per mesh cycle, for a table piece by piece. Numbers are gmpy2 reals
of `DIGITS` decimal digits.

No event can be missed: with y > 0 the distance from the event and M2 >= |y''| up to the end of the
stretch, a step w is taken only where y + y' w - M2 w²/2 > 0 (no zero inside), or where
y' + M2 w < 0 (y falls monotonically: one zero if the sign changes, none if not). Where y = 0 at
the beginning the first derivative that is not zero and a bound of the next one clear a first step.

Two ends of a chatter are known:

* true: bounces are followed until the neglected part of the closing sum (docs/model.md, item i) is
  below `NEGLECTED` mesh periods, then the sum is taken;
* rule: a pressed tooth sticks at the first rebound slower than `STICKING`·(peak-to-peak g)·Ω.
"""

from __future__ import annotations

from dataclasses import dataclass

import gmpy2
from gmpy2 import mpfr

DIGITS = 60
BITS = 200
STICKING = "1e-6"
NEGLECTED = "1e-36"      # mesh periods, of a closed chatter
SHORT_CHATTER = "1e-9"   # mesh periods: only then the closing sum is tried
RESOLUTION = "1e-40"     # mesh periods: what counts as no time at all
MAX_MARCH = 20_000
MAX_EVENTS = 200_000
DRIVE, COAST = 1, -1     # also the sign of the depth into the flank
IMPACT, RELEASE, ENGAGE, CHATTER_END = 1, 3, 5, 7  # numbers of the drive flank's events


def working_precision():
    """Context in which everything here is to be called."""
    return gmpy2.context(gmpy2.get_context(), precision=BITS)


# --- first zero of a positive function --------------------------------------------------------


def first_zero(curve, begin, end):
    """First s in (begin, end] where y falls through zero; None if y > 0 all the way.

    `curve(s)` gives y, y'; `curve.bound(k, s)` bounds |y^(k)| from s to the end, k = 2, 3;
    `curve.start` holds y, y', y'' at `begin`, where y >= 0 (a zero there lies in the past).
    """
    s, (y, dy, ddy) = begin, curve.start
    if y == 0:
        if dy < 0 or (dy == 0 and ddy <= 0):
            raise ArithmeticError("a stretch begins on its own event, going the wrong way")
        if dy > 0:
            s = s + dy / curve.bound(2, s)
        else:
            s = s + ddy / curve.bound(3, s)
    for _ in range(MAX_MARCH):
        if s >= end:
            return None
        y, dy = curve(s)
        if y <= 0:
            raise ArithmeticError("a zero was stepped over")
        m2 = curve.bound(2, s)
        step = (dy + gmpy2.sqrt(dy * dy + 2 * m2 * y)) / m2 * mpfr("0.99")
        if dy < 0:
            monotone = min(-dy / m2 * mpfr("0.99"), end - s)
            if curve(s + monotone)[0] <= 0:
                return _refined(curve, s, s + monotone)
            step = max(step, monotone)
        s = s + step
    raise ArithmeticError("event undecided: a graze to all digits")


def _refined(curve, low, high):
    """Zero of a falling function between low (y > 0) and high (y <= 0): Newton in its bracket."""
    s = high
    for iteration in range(4 * BITS):
        y, dy = curve(s)
        if y == 0:
            return s
        if y > 0:
            low = s
        else:
            high = s
        new = s - y / dy if dy < 0 and iteration < BITS else (low + high) / 2
        if not low <= new <= high:
            new = (low + high) / 2
        if abs(new - s) <= mpfr(2) ** (8 - BITS) * max(abs(new), mpfr(1)):
            return new
        s = new
    raise ArithmeticError("root not refined")


class Flight:
    """Distance y > 0 from a flank in separation; θ is a parabola from s0."""

    def __init__(self, stretch, flank, gap, force, s0, phi, velocity, touching):
        self.stretch, self.flank, self.force, self.s0 = stretch, flank, force, s0
        g, dg, ddg = stretch.derivatives(s0, range(3))
        self.theta, self.rate = phi + g, velocity + dg
        self.offset = mpfr(0) if flank == DRIVE else gap
        y = mpfr(0) if touching else -flank * phi + (0 if flank == DRIVE else gap)
        self.start = (y, -flank * velocity, -flank * (force - ddg))

    def state(self, s):
        """φ, φ'."""
        h = s - self.s0
        g, dg = self.stretch.derivatives(s, range(2))
        return (self.theta + h * (self.rate + self.force * h / 2) - g,
                self.rate + self.force * h - dg)

    def __call__(self, s):
        phi, velocity = self.state(s)
        return -self.flank * phi + self.offset, -self.flank * velocity

    def bound(self, k, s):
        return self.stretch.bound(k, s) + (abs(self.force) if k == 2 else 0)


class Contact:
    """Depth y > 0 in a flank: y'' + 2ξy' + y = flank·(F - g''), in closed form (0 <= ξ < 1)."""

    def __init__(self, stretch, flank, xi, force, s0, y, dy):
        if not 0 <= xi < 1:
            raise ValueError("this reference is written for a damping ratio below one")
        self.xi, self.s0, self.omega = xi, s0, gmpy2.sqrt(1 - xi * xi)
        self.steady, self.steady_bound = stretch.steady(flank, force, xi, s0)
        p, dp = self.steady(s0)
        self.a, self.b = y - p, dy - dp + xi * (y - p)
        ddg = stretch.derivatives(s0, (2,))[0]
        self.start = (y, dy, flank * (force - ddg) - 2 * xi * dy - y)

    def homogeneous(self, s):
        h = s - self.s0
        sine, cosine = gmpy2.sin_cos(self.omega * h)
        decay = gmpy2.exp(-self.xi * h)
        cosine, sine = decay * cosine, decay * sine / self.omega
        return (self.a * cosine + self.b * sine,
                (self.b - self.xi * self.a) * cosine
                - (self.xi * self.b + self.omega**2 * self.a) * sine)

    def __call__(self, s):
        (h, dh), (p, dp) = self.homogeneous(s), self.steady(s)
        return h + p, dh + dp

    def bound(self, k, s):
        """The energy h² + h'² never grows, so its root bounds both from s on."""
        size = gmpy2.hypot(*self.homogeneous(s))
        bounds = [size, size]
        for _ in range(k - 1):
            bounds.append(2 * self.xi * bounds[-1] + bounds[-2])
        return bounds[k] + self.steady_bound(k, s)


# --- the hybrid motion ----------------------------------------------------------------------


@dataclass
class Setup:
    """What is followed: doubles as the engine takes them, and the flank's motion.

    `stretches`: Series or pieces of a table; `peak_to_peak`: of g, rad; `rule`: whether a
    chatter ends by the sticking rule; `change`: relative change of the force.
    """

    force: float
    omega: float
    damping_ratio: float
    restitution: float
    backlash: float
    compliant: bool
    absolute: bool
    stretches: list
    peak_to_peak: float
    rule: bool
    change: str = "0"


class Follower:
    """State and log; events are (kind, cycle, s in the cycle, velocity before, after)."""

    def __init__(self, setup):
        self.setup = setup
        self.force = mpfr(setup.force) * (1 + mpfr(setup.change))
        self.xi, self.restitution = mpfr(setup.damping_ratio), mpfr(setup.restitution)
        self.gap = mpfr(setup.backlash)
        self.period = 2 * gmpy2.const_pi() / mpfr(setup.omega)
        self.sticking = mpfr(STICKING) * mpfr(setup.peak_to_peak) * mpfr(setup.omega)
        self.cycle, self.index, self.s = 0, 0, mpfr(0)
        self.flank, self.touching = DRIVE, None  # from rest: φ = F, φ' = 0 in engagement
        self.phi, self.velocity = self.force, mpfr(0)
        self.events, self.cycle_ends = [], []

    def run(self, cycles):
        """Follow to phase 0 of mesh cycle number `cycles`."""
        while self.cycle < cycles:
            if self.flank is None:
                self.fly()
            else:
                self.stay()
        return self

    @property
    def stretch(self):
        return self.setup.stretches[self.index]

    def log(self, kind, flank, before, after):
        if len(self.events) > MAX_EVENTS:
            raise ArithmeticError("too many events")
        number = kind + (flank == COAST)
        self.events.append((number, self.cycle, self.stretch.begin + self.s, before, after))

    def fly(self):
        end, first = self.stretch.length, None
        for flank in (DRIVE, COAST):
            flight = Flight(self.stretch, flank, self.gap, self.force, self.s, self.phi,
                            self.velocity, self.touching == flank)
            at = first_zero(flight, self.s, end if first is None else first[0])
            if at is not None:
                first = (at, flank)
        if first is None:
            self.phi, self.velocity = flight.state(end)
            return self.next_stretch()
        velocity = flight.state(first[0])[1]
        self.s, self.touching = first
        self.put(self.touching, mpfr(0), velocity)
        return self.arrive(self.touching, velocity)

    def put(self, flank, depth, velocity):
        """φ from the depth into a flank; φ' as given."""
        self.phi = depth if flank == DRIVE else -depth - self.gap
        self.velocity = velocity

    def arrive(self, flank, before):
        if self.setup.compliant:
            self.flank = flank
            return self.log(ENGAGE, flank, before, before)
        after = -self.restitution * before
        if self.setup.absolute:
            after -= (1 + self.restitution) * self.stretch.derivatives(self.s, (1,))[0]
        self.log(IMPACT, flank, before, after)
        self.velocity = after
        load = self.load(flank)
        if self.setup.rule and abs(after) < self.sticking and load[0] > 0:
            return self.stick(flank)
        if flank * after > 0:
            self.flank = flank
            return self.log(ENGAGE, flank, after, after)
        return None if self.setup.rule else self.close(flank, abs(after), load)

    def load(self, flank):
        """Pressing acceleration and its rate."""
        ddg, jerk = self.stretch.derivatives(self.s, range(2, 4))
        return flank * (self.force - ddg), -flank * jerk

    def stick(self, flank):
        self.flank = flank
        self.put(flank, mpfr(0), mpfr(0))
        self.log(CHATTER_END, flank, mpfr(0), mpfr(0))

    def close(self, flank, v, load):
        """Sum the rest of a complete chatter once it is short and certain."""
        a, j = load
        if a <= 0:
            return
        loss, bound = 1 - self.restitution, self.stretch.bound(4, self.s)
        first = 2 * v / (a * loss)
        if self.setup.absolute:
            slope = abs(self.stretch.derivatives(self.s, (1,))[0])
            if max(2 * v / a, slope / a) <= mpfr(RESOLUTION) * self.period:
                self.stick(flank)
            return
        if first > mpfr(SHORT_CHATTER) * self.period:
            return
        ratio = 2 * abs(j) * v / (3 * a * a * loss)
        neglected = first * (ratio**2 + bound * v * v / (a**3 * loss**2))
        clear = self.s + 2 * first < self.stretch.length and (
            a > 2 * first * (abs(j) + first * bound))
        if clear and neglected <= mpfr(NEGLECTED) * self.period:
            self.s += first - 4 * j * v * v / (3 * a**3 * loss**2)
            self.stick(flank)
        elif first <= mpfr(RESOLUTION) * self.period:
            self.stick(flank)

    def stay(self):
        flank, end = self.flank, self.stretch.length
        depth = flank * self.phi - (0 if flank == DRIVE else self.gap)
        contact = Contact(self.stretch, flank, self.xi, self.force, self.s,
                          mpfr(0) if self.touching == flank else depth, flank * self.velocity)
        at = first_zero(contact, self.s, end)
        self.touching = None
        if at is None:
            depth, rate = contact(end)
            self.put(flank, depth, flank * rate)
            return self.next_stretch()
        velocity = flank * contact(at)[1]
        self.s, self.flank, self.touching = at, None, flank
        self.put(flank, mpfr(0), velocity)
        return self.log(RELEASE, flank, velocity, velocity)

    def next_stretch(self):
        self.touching, self.s = None, mpfr(0)
        self.index += 1
        if self.index == len(self.setup.stretches):
            self.index, self.cycle = 0, self.cycle + 1
        self.velocity -= self.stretch.jump
        if self.index == 0:
            self.cycle_ends.append((self.flank, self.phi, self.velocity))
