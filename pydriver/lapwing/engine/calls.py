"""Calls of the compiled engine: packs arguments, repeats bounded calls, unpacks.

One call into the engine does at most `CALL_SECONDS` of work, so that Ctrl-C is felt at once; the
run between two calls is one array (`blob`), and where a run is cut changes no bit of it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import lru_cache
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from lapwing.base.codes import ContactLaw, Gap, ImpactLaw, Method, Status
from lapwing.engine.compiled import api as api
from lapwing.engine.flanks import flank_argument
from lapwing.engine.methods import method_of
from lapwing.engine.points import Points
from lapwing.engine.records import (
    CYCLE_TABLE,
    EVENT_TABLE,
    SAMPLE_TABLE,
    named,
    tangent_table,
    with_means,
    work_counts,
)

if TYPE_CHECKING:
    from lapwing.engine.numerics import Numerics, Wanted
    from lapwing.model.oscillator import Oscillator

CALL_SECONDS = 0.4
# Lines of the log and of the table of cycles that one call has room for. Most runs are short.
FIRST_LOG_ROOM, LOG_ROOM, CYCLE_ROOM = 1 << 10, 1 << 16, 1 << 12
MOST_CHECKPOINTS = 64

(BLOB_SIZE, WORK_SIZE, LOG_COLUMNS, CYCLE_COLUMNS, SAMPLE_COLUMNS, N_REALS, N_CHOICES,
 TANGENT_COLUMNS, OUTCOME_COLUMNS, MOST_LOOKED_FOR, GOAL_COLUMNS, END_COLUMNS,
 SUSPENDED_SIZE, AVERAGE_COLUMNS) = (int(n) for n in api.sizes())

# How `trajectory` is told to begin, besides the number of a motion state.
GO_ON, REST = -2.0, -1.0
# f2py takes no empty array; this one stands for no samples.
NO_SAMPLE = np.array([[-1.0], [0.0]])
EXACT_CHATTER_TOL = 1e-13
# Ways to run an oscillator for which its arguments are kept.
MOST_KEPT = 16


def real_parameters(points: Any, numerics: Numerics, method: str, wanted: Wanted) -> NDArray[Any]:
    """Real parameters of each point, (n_reals, n), in the order of api/marshal.f90."""
    n = len(points)
    chatter_tol = numerics.chatter_tol
    if chatter_tol is None:
        chatter_tol = EXACT_CHATTER_TOL if method == "exact" else min(numerics.rtol, 1e-10)
    slowest, fastest = (wanted.speed_edges[0], wanted.speed_edges[-1]) \
        if wanted.speed_edges else (1.0, 2.0)
    rows = (points.force, points.mesh_frequency_ratio, points.flank_scale,
            points.peak_to_peak, points.damping_ratio, points.restitution, points.backlash,
            numerics.rtol, chatter_tol, numerics.count_depth, wanted.graze_distance, slowest,
            fastest, points.mean_acceleration, points.curve + 1)
    reals = np.empty((len(rows), n), order="F")
    for row, values in zip(reals, rows, strict=True):
        row[:] = values
    return reals


def choices(osc: Oscillator, numerics: Numerics, method: str, wanted: Wanted, settle: int = 0,
            record: int = 0) -> NDArray[Any]:
    """Integer parameters, (n_choices,), in the order of api/marshal.f90; not to be written to."""
    return _choices(osc.contact_law, osc.impact_law, osc.gap, osc.back_flank_te,
                    osc.degrees_of_freedom, numerics, method, wanted, settle, record)


@lru_cache(maxsize=64)
def _choices(contact_law: str, impact_law: str, gap: str, back_flank_te: bool, degrees: int,
             numerics: Numerics, method: str, wanted: Wanted, settle: int,
             record: int) -> NDArray[Any]:
    codes = (ContactLaw[contact_law.upper()], ImpactLaw[impact_law.upper()],
             Gap[gap.upper()], back_flank_te, numerics.max_events_per_cycle,
             numerics.max_steps_per_cycle, wanted.events, wanted.impacts, wanted.grazes,
             wanted.strobe or wanted.tangent, wanted.cycles, settle, record,
             Method[method.upper()], wanted.tangent, numerics.copy_repeats, degrees,
             wanted.depths, not wanted.bounces, wanted.averages)
    made = np.array([int(code) for code in codes], dtype=np.intc)
    made.flags.writeable = False
    return made


def _prepared(osc: Oscillator, numerics: Numerics, wanted: Wanted) -> tuple[Any, ...]:
    """Method and arguments of one oscillator, made once for it."""
    made = osc.kept
    if (numerics, wanted) not in made:
        if len(made) >= MOST_KEPT:
            made.clear()
        method = method_of(osc, numerics)
        made[numerics, wanted] = (
            method, flank_argument(osc.te, osc.back_flank_te, method),
            real_parameters(Points.of([osc]), numerics, method, wanted)[:, 0],
            choices(osc, numerics, method, wanted))
    prepared: tuple[Any, ...] = made[numerics, wanted]
    return prepared


def find_period(phi: Any, phi_dot: Any, labels: Any, scale: Any, most: Any) -> Any:
    """Period of a motion in mesh cycles by the rules of fortran/observers/period.f90; 0: none.

    Parameters
    ----------
    phi, phi_dot : array (n,), strobed states of consecutive cycles, rad and rad per τ
    labels : array (n, m), what must match besides
    scale : float, rad, > 0; size of the motion
    most : int, longest period looked for, up to `MOST_LOOKED_FOR`
    """
    rows = np.asfortranarray(np.column_stack([phi, phi_dot, labels]).T, dtype=float)
    return int(api.find_period(rows, scale, most))


def flank_motion(osc: Oscillator, t: Any) -> Any:
    """g, g' and g'' of an oscillator as the engine evaluates them.

    Parameters
    ----------
    t : array (n,), τ in the mesh period, 0 <= t < P

    Returns
    -------
    array (3, n), rad, rad, rad (per τ and τ²)
    """
    t = np.ascontiguousarray(t, dtype=float)
    return api.evaluate_table(flank_argument(osc.te, False), osc.flank_scale, osc.period, t)


def _one(parts: list[NDArray[Any]]) -> NDArray[Any]:
    return parts[0] if len(parts) == 1 else np.vstack(parts)


def thinned(checkpoints: Any) -> Any:
    """Every other of too many checkpoints, the last one always."""
    return checkpoints if len(checkpoints) <= MOST_CHECKPOINTS else checkpoints[::-2][::-1]


class TrajectoryCall:
    """One trajectory under way: repeated bounded calls from a start, or from a blob, to a target.

    After `run`, `events`, `cycles`, `samples` and, where it is wanted, `tangent` are tables of
    `records`: structured arrays (n,); `unfinished` is the line, or none, of the cycle in which the
    run ended. With two degrees of freedom `cycle_means`, `unfinished_means` and `sample_means` are
    beside them, else None. `checkpoints` are (cycle, time in it, blob) between its calls.
    """

    def __init__(self, osc: Oscillator, start: tuple[float, float, float, float],
                 blob: NDArray[Any] | None = None, cycle: int = 0, *, numerics: Numerics,
                 wanted: Wanted) -> None:
        self.method, *self._fixed = _prepared(osc, numerics, wanted)
        self._start = np.array(start, dtype=float)
        self.blob = np.zeros(BLOB_SIZE) if blob is None else blob.copy()
        self._wanted = wanted
        self._more = 2 * osc.degrees_of_freedom - 2
        self.cycle = self.begun = cycle

    @property
    def watches_cycles(self) -> bool:
        """Whether there are statistics of cycles."""
        return self._wanted.cycles

    def run(self, target: tuple[int, float],
            sample_times: Sequence[tuple[float, float]] | NDArray[Any],
            between: Callable[[int], object] | None = None) -> TrajectoryCall:
        """Go on until the target (cycle, t); `sample_times` is (n, 2), cycle and t, rising.

        `between` is told the cycle reached between two calls of the engine; it may raise.
        """
        wants_log = self._wanted.events or self._wanted.grazes
        by_cycle = self._wanted.cycles or self._wanted.strobe or self._wanted.tangent
        room = min(CYCLE_ROOM, target[0] - self.cycle + 1) if by_cycle else 1
        log_room = min(FIRST_LOG_ROOM, LOG_ROOM) if wants_log else 1
        samples = np.full((SAMPLE_COLUMNS + self._more, len(sample_times)), np.nan, order="F")
        times = np.asfortranarray(np.asarray(sample_times, dtype=float).reshape(-1, 2).T)
        width = tangent_table(2 + self._more).itemsize // 8
        logs, cycles, tangents, sampled, cycle = [], [], [], 0, self.cycle
        self.checkpoints = ()
        while True:
            # The engine drops what has no room, so the target of a call stays within the table.
            step_target = target
            if by_cycle and target[0] - cycle > room:
                step_target = (cycle + room, 0.0)
            log = np.empty((LOG_COLUMNS, log_room), order="F")
            # One more for a cycle that is not complete.
            table = np.empty((CYCLE_COLUMNS + self._more, room + 1), order="F")
            tangent = np.empty((width, room if self._wanted.tangent else 1), order="F")
            rest = np.full((len(samples), max(1, samples.shape[1] - sampled)), np.nan, order="F")
            rest_times = np.asfortranarray(times[:, sampled:] if sampled < times.shape[1]
                                           else NO_SAMPLE)
            done = api.trajectory(
                *self._fixed, self._start, np.array([*step_target, CALL_SECONDS], dtype=float),
                self.blob, rest_times, rest, log, table, tangent)
            self._start[0] = GO_ON
            if sampled < times.shape[1]:
                taken = int(np.count_nonzero(~np.isnan(rest[0])))
                samples[:, sampled:sampled + taken] = rest[:, :taken]
                sampled += taken
            logs.append(log[:, :int(done[1])].T.copy())
            cycles.append(table[:, :int(done[2])].T.copy())
            tangents.append(tangent[:, :int(done[2])].T.copy())
            cycle = int(done[3])
            log_room = min(8 * log_room, LOG_ROOM) if wants_log else 1
            status = Status(int(done[0]))
            if status != Status.UNFINISHED and (status != Status.OK or step_target == target):
                break
            if between is not None:
                between(cycle)
            self.checkpoints = thinned((*self.checkpoints, (cycle, done[4], self.blob.copy())))
        self.status = status
        self.cycle, self.t, self.motion_state, self.phi, self.phi_dot = (
            cycle, done[4], int(done[5]), done[6], done[7])
        self.events = named(_one(logs), EVENT_TABLE)
        self.cycles, self.cycle_means = with_means(_one(cycles), CYCLE_TABLE)
        last = int(done[2]) + np.arange(int(done[8]))
        self.unfinished, self.unfinished_means = with_means(table[:, last].T, CYCLE_TABLE)
        self.samples, self.sample_means = with_means(samples.T, SAMPLE_TABLE)
        self.tangent = named(_one(tangents), tangent_table(2 + self._more)) \
            if self._wanted.tangent else None
        return self

    @property
    def work(self) -> dict[str, int]:
        """Counts of what was done since the trajectory began."""
        return work_counts(self.blob[:WORK_SIZE])


def position(phase: float, cycles: float, period: float) -> tuple[int, float]:
    """Cycle and time in it of a position given as start phase + cycles since the start."""
    total = phase + cycles
    cycle = math.floor(total)
    return int(cycle), (total - cycle) * period
