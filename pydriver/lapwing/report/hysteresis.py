"""Where the branches of a sweep end in different motions, and where each of them jumps."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from lapwing.base.arrivals import arrivals_in, per_cycle
from lapwing.base.codes import MotionState, Status
from lapwing.report.words import listed, markdown, plural, runs_of
from lapwing.results.findings import known, rattles, span

if TYPE_CHECKING:
    import xarray as xr

# Branches differ in depth when they do so by more than this part of it.
DEPTH_DIFFERS = 0.02
# So many intervals are told one by one; of more, the widest.
TABLE_LINES = 12


def hysteresis(sweep: xr.Dataset, unit: str) -> list[str]:
    """Intervals in which the branches carried up and down end in different motions.

    Two motions differ when their periods do, or, both settled, their counted arrivals or by more
    than 2 % their depths. Counts beside a complete chatter hang on their threshold and are not
    compared. Values without a result of both, and those at which neither motion has a period, are
    not judged.

    Parameters
    ----------
    sweep : Dataset with the cycles' statistics
    unit : str

    Returns
    -------
    list of str, a sentence, then lines of Markdown
    """
    starts = [str(start) for start in sweep["start"].values]
    if not {"up", "down"} <= set(starts):
        return ["not looked for (needs the starts up and down)"]
    branches = {start: Branch(sweep.sel(start=start)) for start in starts}
    up, down = branches["up"], branches["down"]
    values = sweep[sweep.attrs["parameter"]].values
    judged, neither = up.judged(down), up.ok & down.ok & ~up.judged(down)
    if not judged.any():
        why = plural(int(neither.sum()), "value") + " in common" \
            + ", all of motions without a period" * bool(neither.any())
        return [f"not known ({why})"]
    runs = runs_of(up.differs(down))
    words = f"period, {up.law.word}s or depth"
    if runs:
        line = f"up and down differ in {words} at " + _places(runs, branches, values, unit)
    else:
        line = f"none seen: up and down agree in {words.replace(' or', ' and')}"
    if "rest" in branches:
        alone = branches["rest"].differs(up) & branches["rest"].differs(down) \
            & judged & ~up.differs(down)
        alone_at = runs_of(alone)
        if alone_at:
            line += "; from rest a motion unlike both, which agree, at " \
                + listed(alone_at, values, len(alone_at)) + f" {unit}"
    wide = [run for run in runs if run[1] > run[0]]
    return [line + _judged_on(judged, neither, values, unit),
            *(_table(wide, branches, values, unit) if wide else [])]


def _judged_on(judged: NDArray[Any], neither: NDArray[Any], values: NDArray[Any], unit: str) -> str:
    """How many values a statement rests on, and why not on the others."""
    if judged.all():
        return f" (judged at all {span(values, unit)})" if judged.size > 1 else \
            f" (judged at {span(values, unit)})"
    lost = int((~judged & ~neither).sum())
    reasons = [f"{neither.sum()} without a period in either"] * bool(neither.any()) \
        + [f"{lost} without a result of both"] * bool(lost)
    return f" (judged at {judged.sum()} of {judged.size} values; {', '.join(reasons)})"


class Branch:
    """What is compared of one branch, over the parameter."""

    def __init__(self, branch: xr.Dataset) -> None:
        self.law = arrivals_in(branch.attrs)
        self.status = branch["status"].values
        self.ok = known(branch)
        self.period = branch["period"].values
        self.depth = branch["deepest_separation"].max("recorded_cycle").values
        self.impacts, self.back = (per_cycle(branch, side) for side in ("drive", "coast"))
        self.chatter = branch["chatter_ends"].sum("recorded_cycle").values > 0
        self.rattles = rattles(branch)
        self.coast = self.ok & np.all(
            branch["states_visited"].values == 1 << MotionState.BACK_ENGAGEMENT, axis=-1)

    def judged(self, other: Branch) -> NDArray[Any]:
        """Where two branches can be compared: both have a result, and one of them a period."""
        both: NDArray[Any] = self.ok & other.ok & ((self.period > 0) | (other.period > 0))
        return both

    def differs(self, other: Branch) -> NDArray[Any]:
        """Where two branches end in different motions."""
        settled = (self.period > 0) & (other.period > 0)
        greatest = np.fmax(self.depth, other.depth)
        differ: NDArray[Any] = settled & (
            np.abs(self.depth - other.depth) > DEPTH_DIFFERS * greatest)
        differ |= self.period != other.period
        counted = settled & ~(self.chatter | other.chatter)
        differ |= counted & ((self.impacts != other.impacts) | (self.back != other.back))
        seen: NDArray[Any] = differ & self.judged(other)
        return seen

    def describe(self, i: int) -> str:
        """Motion at one value: engaged, or class and depth."""
        if not self.ok[i]:
            return "not reached" if self.status[i] == Status.UNFINISHED else "failed"
        if self.coast[i]:
            return "on the coast flank"
        if not self.rattles[i]:
            return "engaged"
        p = int(self.period[i])
        name = f"{p}:({self.impacts[i] * p:.4g},{self.back[i] * p:.4g})" + "c" * bool(
            self.chatter[i]) if p else (
            f"no period, {self.impacts[i]:.3g} {self.law.word}s per cycle")
        return f"{name}, {1e6 * self.depth[i]:.4g} µrad"

    def alike(self, i: int, j: int) -> bool:
        """Whether class, and being apart at all, are the same at two values."""
        return self.period[i] == self.period[j] and (
            not self.period[i] or self.chatter[i] or self.chatter[j]
            or (self.impacts[i], self.back[i]) == (self.impacts[j], self.back[j])) and (
            self.rattles[i] == self.rattles[j])


def _places(runs: list[tuple[int, int]], branches: dict[str, Branch], values: NDArray[Any],
            unit: str) -> str:
    """Where the branches differ, in words."""
    wide = [run for run in runs if run[1] > run[0]]
    single = [first for first, last in runs if last == first]
    wild = np.any([(branches[name].period == 0) & branches[name].ok for name in ("up", "down")],
                  axis=0)
    beside = sum(bool(wild[max(i - 1, 0):i + 2].any()) for i in single)
    parts = [listed(wide, values, len(wide)) + f" {unit}"] if wide else []
    if single:
        parts.append(plural(len(single), "single value")
                     + f" ({beside} in or beside bands without a period)" * bool(beside))
    return " and ".join(parts)


def _table(runs: list[tuple[int, int]], branches: dict[str, Branch], values: NDArray[Any],
           unit: str) -> list[str]:
    """Each interval with the motions at its middle, and the jumps at its ends."""
    left_out = len(runs) - TABLE_LINES
    shown = sorted(sorted(runs, key=lambda run: values[run[0]] - values[run[1]])[:TABLE_LINES])
    rows = [(f"interval ({unit})" if unit else "interval", "upwards", "downwards", "from rest",
             "jump at its lower end", "jump at its upper end")]
    for first, last in shown:
        middle = (first + last) // 2
        rows.append((f"{values[first]:g}–{values[last]:g}",
                     branches["up"].describe(middle), branches["down"].describe(middle),
                     _rest(branches, middle), _jump(branches, values, first, first - 1),
                     _jump(branches, values, last, last + 1)))
    text = f" (the widest of {len(runs)})" if left_out > 0 else ""
    return ["", f"Two motions beside each other{text}, as found at the middle of each interval; a "
            "jump lies between the two values given. p:(a,b) repeats every p mesh cycles with a "
            f"drive and b coast {branches['up'].law.word}s in that time, c: with complete "
            "chatter:", "", *markdown(rows)]


def _rest(branches: dict[str, Branch], i: int) -> str:
    """Which of the two the motion from rest is."""
    if "rest" not in branches:
        return "–"
    names = [name for name, start in (("as upwards", "up"), ("as downwards", "down"))
             if branches["rest"].judged(branches[start])[i]
             and not branches["rest"].differs(branches[start])[i]]
    return names[0] if names else branches["rest"].describe(i)


def _jump(branches: dict[str, Branch], values: NDArray[Any], inside: int, outside: int) -> str:
    """Which branches change their motion between the end of an interval and the value next to it.

    A branch jumps where its class changes, or its depth by more than half of what parts the two
    branches inside: outside they agree, so one of them at least must.
    """
    if not 0 <= outside < values.size:
        return "the range ends"
    one, two = branches["up"], branches["down"]
    if not (one.ok[outside] and two.ok[outside]):
        return f"not known (no result of both at {values[outside]:g})"
    parted = abs(one.depth[inside] - two.depth[inside])
    first, last = sorted((inside, outside))
    jumps = [f"{name} {branch.describe(first)} → {branch.describe(last)}"
             for name, branch in (("upwards", one), ("downwards", two))
             if not branch.alike(first, last)
             or abs(branch.depth[inside] - branch.depth[outside]) > 0.5 * parted > 0]
    return f"{values[first]:g} to {values[last]:g}: " + ("; ".join(jumps) or "gradual")
