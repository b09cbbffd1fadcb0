"""Whether two runs of one scene tell the same story: events missed, doubled, or a matter of error.

* An event of one run that is absent or extra in the other is a disagreement, unless the closest
  approach to the other outcome is within ten times the runs' own state error there.
* So is an event at another time, or with other velocities, than errors allow.
* Inside a complete chatter only its end counts: how many of its last bounces are listed is a
  matter of cut-off.
* The comparison stops once an initial error of 1e-15 has grown to the tolerance. A third run, with
  force and start changed by `CHANGE` of their size, tells how errors grow.

The error of an event time is taken as tolerance·(P + growth) + ROUNDING·(growth + τ), growth being
|Δτ| over the relative change; the error of a place as the speed there times that, the error of a
speed as the acceleration times that. Where two motions may part within their errors nothing that
follows can be compared; the verdict says how far it came and why it ended.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from lapwing import EventKind, MotionState

CHANGE = 1e-10
ALLOWANCE = 10.0
# A few roundings of parameters and of time in the mesh period.
ROUNDING = 8 * np.finfo(float).eps
INITIAL_ERROR = 1e-15
# Bounces this near, in mesh periods, to the end of their chatter are its listed tail.
CHATTER_TAIL = 1e-6
# A speed, over the angle scale, that is none: a few roundings of g'.
PILED_UP = 1e-13
# Points at which the closest approach of a stretch is looked for, then finer about the closest.
SAMPLES = 400
REFINEMENTS, REFINED = 6, 21
COLUMNS = ("tau", "kind", "phi", "velocity_before", "velocity_after")
SPEEDS = ("velocity_before", "velocity_after")
ENDS = (EventKind.CHATTER_END, EventKind.BACK_CHATTER_END)


@dataclass(frozen=True)
class Verdict:
    """Outcome of a comparison.

    Attributes
    ----------
    agrees : bool
    compared : int, events found alike
    why : str: 'all', 'growth', 'ambiguous: …', or the disagreement in full
    """

    agrees: bool
    compared: int
    why: str


def events_of(run):
    """Events that count, as a dict of arrays: all but the listed tails of complete chatters."""
    table = {name: run.events[name].values for name in COLUMNS}
    table["kind"] = with_pile_ups_ended(table, run.oscillator)
    keep = np.ones(len(table["tau"]), dtype=bool)
    for i in np.flatnonzero(np.isin(table["kind"], ENDS)):
        impact = EventKind.IMPACT + (table["kind"][i] - EventKind.CHATTER_END)
        keep &= ~((table["kind"] == impact) & (table["tau"] <= table["tau"][i])
                  & (table["tau"] >= table["tau"][i] - CHATTER_TAIL * run.oscillator.period))
    return {name: column[keep] for name, column in table.items()}


def with_pile_ups_ended(table, osc):
    """Kinds, with one name for the end of a pile-up.

    Bounces of the absolute law that die out where g' passes zero end by resolution (CHATTER_END) or
    because a last speed happens to round to zero or beyond (ENGAGE): the same to any error.
    """
    kind = table["kind"].copy()
    for i in np.flatnonzero(np.isin(kind, (EventKind.ENGAGE, EventKind.BACK_ENGAGE))):
        impact = kind[i] - EventKind.ENGAGE + EventKind.IMPACT
        before = np.flatnonzero(kind[:i] == impact)[-2:]
        if len(before) == 2 and abs(table["velocity_after"][i]) <= PILED_UP * osc.angle_scale \
                and table["tau"][i] - table["tau"][before[0]] <= CHATTER_TAIL * osc.period:
            kind[i] += EventKind.CHATTER_END - EventKind.ENGAGE
    return kind


def changed_data(osc, start, change=CHANGE):
    """Oscillator and start whose force, curve, place and speed are changed by a part of their size.

    Not all the same way: a force and a curve that grow alike leave every time as it is. Where the
    coast flank stands still the curve is left alone: a start may lie on that flank.
    """
    osc = replace(osc, force=osc.force + math.copysign(change * osc.angle_scale, osc.force),
                  gear_ratio=osc.gear_ratio * (1 - change * osc.back_flank_te))
    if isinstance(start, str):
        return osc, start
    state, phi, phi_dot = start
    # A start in contact stays on its side of the flank, one on the flank stays there.
    if state == "separation":
        phi *= 1 - change
    elif osc.contact_law != "rigid" and phi not in (0, -osc.gap_width):
        phi += (change if state == "engagement" else -change) * osc.angle_scale
    return osc, (state, phi, phi_dot * (1 + change))


def growth_of(one, changed, column="tau", change=CHANGE):
    """|Δ| of a column over the relative change for each event; infinite where the lists part.

    An event's own value can vanish by accident, and that of a kink always does: the largest of
    the last four events and the next is taken.
    """
    n = min(len(one["tau"]), len(changed["tau"]))
    same = one["kind"][:n] == changed["kind"][:n]
    alike = n if np.all(same) else int(np.argmin(same))
    growth = np.full(len(one["tau"]), np.inf)
    growth[:alike] = np.abs(one[column][:alike] - changed[column][:alike]) / change
    return np.array([growth[max(0, i - 3):i + 2].max() for i in range(len(growth))])


def time_error(growth, tau, tolerance, period):
    """State error as an error of time."""
    return tolerance * (period + growth) + ROUNDING * (growth + tau)


def compare(one, other, changed, tolerance):
    """Compare the events of two runs.

    Parameters
    ----------
    one, other : Run
    changed : Run, of the same method as `one`, from `changed_data`
    tolerance : float, relative tolerance of the coarser run

    Returns
    -------
    Verdict
    """
    period = one.oscillator.period
    lists = events_of(one), events_of(other)
    growth = growth_of(lists[0], events_of(changed))
    speeds = {name: growth_of(lists[0], events_of(changed), name) for name in SPEEDS}
    n, m = (len(table["tau"]) for table in lists)
    for i in range(max(n, m)):
        known = growth[min(i, n - 1)] if n else 0.0
        if INITIAL_ERROR * known > tolerance * period:
            return Verdict(True, i, "growth")
        tau = max(table["tau"][:i + 1].max() for table in lists if len(table["tau"]))
        near = ALLOWANCE * time_error(known, tau, tolerance, period)
        if i < n and i < m and lists[0]["kind"][i] == lists[1]["kind"][i] \
                and abs(lists[0]["tau"][i] - lists[1]["tau"][i]) <= near \
                and same_speeds(one, lists, speeds, i, near, ALLOWANCE * tolerance):
            continue
        parting = Parting((one, other), lists, i, near, ALLOWANCE * tolerance)
        reason = parting.excuse()
        if reason:
            return Verdict(True, i, f"ambiguous: {reason}")
        return Verdict(False, i, parting.describe())
    if one.status != other.status:
        return Verdict(False, n, f"the runs ended as {one.status.name} and {other.status.name}")
    return Verdict(True, n, "all")


def same_speeds(one, lists, growth, i, near, tolerance):
    """Whether velocities before and after agree to their errors."""
    osc, row = one.oscillator, {name: lists[0][name][i] for name in COLUMNS}
    speed = max(abs(row[name]) for name in SPEEDS)
    load = bend(osc, row["tau"], one.final) + abs(row["phi"]) + 2 * osc.damping_ratio * speed
    size = osc.angle_scale + speed + load * osc.period
    return all(abs(row[name] - lists[1][name][i])
               <= load * near + (tolerance + ALLOWANCE * ROUNDING) * (size + growth[name][i])
               for name in SPEEDS)


@dataclass(frozen=True)
class Parting:
    """Where two event lists part: row `i`; times uncertain by `near`, relative by `tolerance`."""

    runs: tuple
    lists: tuple
    i: int
    near: float
    tolerance: float

    def describe(self):
        lines = [f"event {self.i} (times uncertain by {self.near / ALLOWANCE:.2g}):"]
        for name, table in zip(("one", "other"), self.lists, strict=True):
            for k in range(max(0, self.i - 2), min(len(table["tau"]), self.i + 3)):
                lines.append(f"  {name:5} {k:4} {EventKind(table['kind'][k]).name:16} "
                             f"tau={table['tau'][k]:.16g} phi={table['phi'][k]:.10g} "
                             f"before={table['velocity_before'][k]:.10g} "
                             f"after={table['velocity_after'][k]:.10g}")
        return "\n".join(lines)

    def excuse(self):
        """What makes the parting a matter of error; None where nothing does."""
        return self.end_of_run() or self.order() or self.touch() or self.decision()

    def earlier(self):
        """The list whose event comes first, and the other."""
        def tau(k):
            table = self.lists[k]["tau"]
            return table[self.i] if self.i < len(table) else np.inf
        return (0, 1) if tau(0) <= tau(1) else (1, 0)

    def end_of_run(self):
        """The event lies on the end of the run."""
        first, _ = self.earlier()
        if self.runs[0].final.tau - self.lists[first]["tau"][self.i] <= self.near:
            return "an event at the end of the run"
        return None

    def order(self):
        """Different events at one time that both lists have, or a kink both have beside another.

        A kink that comes first can make the other event undone; it is itself never undone.
        """
        i = self.i
        if i >= min(len(table["tau"]) for table in self.lists):
            return None
        kinds = [table["kind"][i] for table in self.lists]
        apart = abs(self.lists[0]["tau"][i] - self.lists[1]["tau"][i])
        if kinds[0] == kinds[1] or apart > self.near:
            return None
        seen = [self.has(table, kind) for table, kind in zip(self.lists, kinds[::-1], strict=True)]
        kink = [kind == EventKind.KINK and there for kind, there in zip(kinds[::-1], seen,
                                                                       strict=True)]
        return "two events at one time" if all(seen) or any(kink) else None

    def has(self, table, kind):
        """Whether a list has an event of a kind from here on, at the time of the parting."""
        tau = max(t["tau"][self.i] for t in self.lists)
        rows = slice(self.i, self.i + 4)
        close = np.abs(table["tau"][rows] - tau) <= self.near
        return bool(np.any(close & (table["kind"][rows] == kind)))

    def touch(self):
        """The closest approach to the outcome without the event is within the error of a place."""
        first, second = self.earlier()
        table = self.lists[first]
        kind, tau = EventKind(table["kind"][self.i]), table["tau"][self.i]
        before = table["tau"][self.i - 1] if self.i else 0.0
        if kind == EventKind.KINK or (self.i and tau - before <= self.near):
            return None  # what follows an event at once is no arrival
        flank = 1 + (int(kind) - 1) % 2
        after = self.lists[second]["tau"][self.i:self.i + 1]
        end = after[0] if len(after) else self.runs[second].final.tau
        passing, speed = closest(self.runs[second], flank, 0.5 * (before + tau), end)
        going = turning_depth(self.runs[first].oscillator, self.runs[first].final, table, self.i)
        error = speed * self.near + self.tolerance * self.runs[0].oscillator.angle_scale
        if min(passing, going) > error:
            return None
        return f"a touch ({kind.name}, {min(passing, going):.2g} of {error:.2g})"

    def decision(self):
        """What follows an event is decided by a speed, or by a load, that is zero within errors."""
        if not self.i:
            return None
        first, _ = self.earlier()
        table, osc = self.lists[first], self.runs[0].oscillator
        if table["tau"][self.i] - table["tau"][self.i - 1] > self.near:
            return None
        slack = self.tolerance * osc.angle_scale
        load = bend(osc, table["tau"][self.i], self.runs[0].final)
        if abs(table["velocity_after"][self.i - 1]) <= load * self.near + slack:
            return "a speed of zero after an event"
        return None


def loads(osc, tau, final):
    """F - g'' of the drive flank on either side of a time."""
    phase = final._origin[1] + tau / osc.period
    return [osc.force - osc.flank_scale * float(osc.te.curvature(phase + nudge)) / osc.period**2
            for nudge in (-1e-9, 1e-9)]


def bend(osc, tau, final):
    """Bound of |φ''| of a free tooth at a time, on either side of a knot there."""
    return max(abs(load) for load in loads(osc, tau, final))


def turning_depth(osc, final, table, i):
    """How far beyond a flank an arrival, or beyond release a departure, would turn back: v²/2a.

    Infinite where the load does not turn it back.
    """
    kind = EventKind(table["kind"][i])
    back = (int(kind) - 1) % 2
    pressing = loads(osc, table["tau"][i], final)
    if back:
        standing = [osc.force] * 2
        pressing = [-x for x in (pressing if osc.back_flank_te else standing)]
    leaves = kind in (EventKind.RELEASE, EventKind.BACK_RELEASE)
    against = min(pressing) if leaves else -max(pressing)
    if not against > 0:
        return np.inf
    return table["velocity_before"][i] ** 2 / (2 * against)


def closest(run, flank, begin, end):
    """Least distance to a flank at which a stretch without events turns back, and its top speed.

    The ends of the stretch, where the tooth leaves a flank or arrives at one, are no turns, nor
    is a bounce that is not in the list; without any turn the distance is infinite.
    """
    tau = np.linspace(begin, min(end, run.final.tau), SAMPLES)
    distance, rate = distances(run, flank, tau)
    speed = float(np.abs(rate).max())
    turns = 1 + np.flatnonzero((distance[1:-1] <= distance[:-2]) & (distance[1:-1] <= distance[2:]))
    if not len(turns):
        return np.inf, speed
    k = turns[np.argmin(np.abs(distance[turns]))]
    for _ in range(REFINEMENTS):
        tau = np.linspace(tau[k - 1], tau[k + 1], REFINED)
        distance, rate = distances(run, flank, tau)
        k = min(max(int(np.argmin(distance)), 1), REFINED - 2)
    if not smooth(run, tau, distance, rate):
        return np.inf, speed
    return abs(float(distance.min())), speed


def smooth(run, tau, distance, rate):
    """Whether φ' changes over a short stretch as its equation says, or by a listed kink."""
    osc, table = run.oscillator, run.events
    kinks = table["tau"].values[table["kind"].values == EventKind.KINK]
    width = tau[-1] - tau[0]
    if np.any(np.abs(kinks - tau.mean()) <= width + ROUNDING * tau[-1]):
        return True
    load = (bend(osc, tau[0], run.final) + np.abs(distance).max()
            + 2 * osc.damping_ratio * np.abs(rate).max())
    return abs(rate[-1] - rate[0]) <= ALLOWANCE * load * width + 1e-9 * osc.angle_scale


def distances(run, flank, tau):
    """Distance to a flank, negative beyond it (a contact: short of release), and φ'."""
    osc, history = run.oscillator, run.history(tau)
    depth = -history["phi"].values
    if flank == 2:
        depth = osc.gap_width - depth
        if not osc.back_flank_te:
            depth = depth + osc.flank_scale * osc.te.value(history["phase"].values)
    in_contact = history["motion_state"].values[0] != MotionState.SEPARATION
    return (-depth if in_contact else depth), history["phi_dot"].values
