"""How small deviations grow: Floquet multipliers and Lyapunov exponents through impacts.

Both are made from the tangent maps of single mesh cycles that the engine records beside a motion
(fortran/observers/tangent.f90): matrices M of (φ, φ') from the beginning of a cycle to its end.

A complete chatter leaves one number of the two (the matrix has rank 1), a tooth at rest on a rigid
flank none (rank 0).  What is lost has exponent -∞ and multiplier 0; no other number is given.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, fields
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from lapwing.base.messages import Shown
from lapwing.studies.intervals import mean_interval

if TYPE_CHECKING:
    from lapwing.model.oscillator import Oscillator

# A matrix is wrong by η/(2d), relatively, when the state is known to η only and some impact of the
# cycle was a graze that went d deep.  Periodic states repeat to η = 1e-8 of the motion's size
# (`period.REPEAT_TOLERANCE`): below this d, of the same size, the multiplier is wrong by 1 %.
GRAZE_LIMIT = 5e-7
# Cycles before such an average, for the deviation to turn into the direction that grows most: a
# fifth of the record, at most so many.
MOST_ALIGNING = 100
EPS = float(np.finfo(float).eps)


@dataclass(frozen=True)
class CycleMaps:
    """Tangent maps of consecutive mesh cycles, of one motion or of many (leading dimensions).

    Those of the relative motion: of a deviation of the mean rotation it takes no notice, nor the
    mean rotation of one of it (docs/model.md, section 11).

    Attributes
    ----------
    matrix : array (..., n, 2, 2); the map of a cycle is matrix·2**exponent
    exponent : array (..., n)
    log_det : array (..., n), ln|det| as the product of its factors; -inf where the rank is below 2
    det_sign : array (..., n), -1, 1, or 0 where the rank is below 2
    rank : array (..., n)
    contact_time : array (..., n), τ in contact with either flank
    impacts : array (..., n), impacts, all of them
    log_rebound : array (..., n), sum over the impacts of ln|φ'₊/φ'₋|
    graze_depth : array (..., n), rad; how far the shallowest impact on a flank that draws away
        would have gone on, v²/(2|a|); huge where there is none
    period : float, mesh period P in τ
    """

    matrix: np.ndarray
    exponent: np.ndarray
    log_det: np.ndarray
    det_sign: np.ndarray
    rank: np.ndarray
    contact_time: np.ndarray
    impacts: np.ndarray
    log_rebound: np.ndarray
    graze_depth: np.ndarray
    period: float

    @classmethod
    def from_rows(cls, rows: NDArray[Any], period: float) -> CycleMaps:
        """Maps from the engine's table (..., n), `engine.records.tangent_table`."""
        states = rows["matrix"].shape[-1]
        return cls(rows["matrix"][..., :2, :2], rows["exponent"], rows["log_det"],
                   rows["det_sign"], rows["rank"] - (states - 2),
                   rows["drive_time"] + rows["coast_time"], rows["impacts"],
                   rows["log_rebound"], rows["graze_depth"], period)

    def __getitem__(self, index: Any) -> CycleMaps:
        """The same of some motions or, of a single one, of some cycles."""
        some = {one.name: getattr(self, one.name)[index] for one in fields(self)[:-1]}
        return CycleMaps(**some, period=self.period)


@dataclass(frozen=True, repr=False)
class Multipliers(Shown):
    """Floquet multipliers of a motion that repeats.

    Attributes
    ----------
    values : complex array (2,), the larger magnitude first; 0 for what is lost by chatter or
        rest, NaN where `warning` says why
    exponents : array (2,), ln|multiplier| per τ; -inf for what is lost
    trace, log_det, det_sign : of the matrix over one repetition
    rank : int, 2, 1 or 0
    cycles : int, mesh cycles of one repetition
    warning : str, empty where the numbers can be relied on
    """

    values: np.ndarray
    exponents: np.ndarray
    trace: float
    log_det: float
    det_sign: float
    rank: int
    cycles: int
    warning: str = ""

    @property
    def stable(self) -> bool:
        """Whether both magnitudes are below one."""
        return bool(np.all(np.abs(self.values) < 1))

    def _facts(self) -> dict[str, object]:
        return {"values": ", ".join(f"{one:.6g}" for one in self.values),
                "exponents": ", ".join(f"{one:.6g}" for one in self.exponents) + " per tau",
                "stable": "not known" if self.warning else self.stable, "rank": self.rank,
                "mesh cycles": self.cycles, **({"warning": self.warning} if self.warning else {})}


@dataclass(frozen=True, repr=False)
class Exponents(Shown):
    """Lyapunov exponents of one motion, per τ.

    Attributes
    ----------
    largest, second : float; -inf for what is lost, NaN where `warning` says why
    error : float, of the largest: half of the 95 % interval (`intervals.mean_interval`), NaN where
        the record is too short for it; or, of a periodic motion, the change from one repetition
        to the next
    running : array (n,), the largest as averaged up to each cycle after the aligning ones; empty
        for a periodic motion
    rank : int, least rank of a cycle's matrix
    grazes : int, cycles with an impact too near to grazing for a linear map
    period : float, mesh period in τ
    warning : str
    effective : float, independent cycles that would tell as much; NaN where that is not known, and
        of a periodic motion
    """

    largest: float
    second: float
    error: float
    running: np.ndarray
    rank: int
    grazes: int
    period: float
    warning: str = ""
    effective: float = math.nan

    @property
    def per_cycle(self) -> tuple[float, float]:
        """The largest exponent and its error per mesh cycle."""
        return self.largest * self.period, self.error * self.period

    def _facts(self) -> dict[str, object]:
        error = "of unknown error" if math.isnan(self.error) else f"± {self.error:.2g}"
        return {"largest": f"{self.largest:.6g} {error} per tau",
                "second": f"{self.second:.6g} per tau", "rank": self.rank,
                "grazing cycles": self.grazes, "averaged over": f"{len(self.running)} mesh cycles",
                **({"warning": self.warning} if self.warning else {})}


def multiplied(maps: CycleMaps) -> tuple[NDArray[Any], float, float, float, int]:
    """Product of the maps of a single motion, the last cycle leftmost.

    Returns
    -------
    matrix (2, 2), exponent, log_det, det_sign, rank : as in `CycleMaps`
    """
    total, exponent = np.eye(2), 0.0
    for matrix, shift in zip(maps.matrix, maps.exponent, strict=True):
        total = matrix @ total
        size = np.abs(total).max()
        scale = int(np.frexp(size)[1]) if np.isfinite(size) and size > 0 else 0
        total = np.ldexp(total, -scale)
        exponent += shift + scale
    return (total, exponent, float(np.sum(maps.log_det)), float(np.prod(maps.det_sign)),
            int(np.min(maps.rank)))


def multipliers(maps: CycleMaps, scale: float = math.inf) -> Multipliers:
    """Floquet multipliers over all the cycles of `maps`.

    The larger one follows from trace and determinant, the smaller one from the determinant alone,
    which is kept as a logarithm: it is right to the last digits however small it is.

    Parameters
    ----------
    maps : CycleMaps of a single motion, the cycles of one repetition
    scale : float, rad; size of the motion, to tell a graze (default: none is told)

    Returns
    -------
    Multipliers
    """
    matrix, exponent, log_det, det_sign, rank = multiplied(maps)
    cycles, lost = len(maps.rank), -math.inf
    duration = cycles * maps.period
    half = 0.5 * np.trace(matrix)
    det = det_sign * math.exp(log_det - 2 * exponent * math.log(2)) if rank == 2 else 0.0
    root = np.emath.sqrt(half * half - det)
    if np.iscomplexobj(root):
        values = np.array([half + root, half - root])
        logs = np.full(2, 0.5 * log_det)
    else:
        first = half + math.copysign(root, half)
        values = np.array([first, det / first if first else 0.0], dtype=complex)
        size = math.log(abs(first)) + exponent * math.log(2) if first else lost
        logs = np.array([size, log_det - size if rank == 2 else lost])
    near = int(np.sum(near_grazes(maps, scale)))
    warning = f"{near} of {cycles} cycles graze: no linear map" if near else ""
    with np.errstate(over="ignore"):
        values = values * 2.0**exponent
    return Multipliers(values * np.nan if near else values,
                       logs * np.nan if near else logs / duration,
                       2 * half * 2.0**exponent, log_det, det_sign, rank, cycles, warning)


def near_grazes(maps: CycleMaps, scale: float) -> NDArray[Any]:
    """Which cycles have an impact too near to grazing, for a motion of this size (rad)."""
    if not math.isfinite(scale):
        return np.zeros(maps.rank.shape, dtype=bool)
    return maps.graze_depth < GRAZE_LIMIT * scale


def growth(maps: CycleMaps) -> NDArray[Any]:
    """ln of the growth of one deviation in each cycle, renormalised after each.

    Returns
    -------
    array (..., n); -inf from the cycle on in which nothing of it is left
    """
    shape = maps.rank.shape
    deviation = np.broadcast_to([0.6, 0.8], (*shape[:-1], 2)).copy()
    result = np.empty(shape)
    with np.errstate(divide="ignore", invalid="ignore"):
        for k in range(shape[-1]):
            deviation = (maps.matrix[..., k, :, :] @ deviation[..., None])[..., 0]
            size = np.hypot(deviation[..., 0], deviation[..., 1])
            result[..., k] = np.log(size) + maps.exponent[..., k] * math.log(2)
            deviation = np.where(size[..., None] > 0, deviation / size[..., None], 0.0)
    return result


def exponents(maps: CycleMaps, period: int = 0, scale: float = math.inf,
              grown: NDArray[Any] | None = None) -> Exponents:
    """Both Lyapunov exponents of a motion from its recorded cycles.

    1. A motion that repeats: ln|Floquet multiplier| over its last repetition; a warning instead
       of a number where one of its impacts grazes.
    2. Any other: the mean growth of one deviation, after a fifth of the record (at most 100
       cycles) in which it aligns; a graze is one bad cycle of many there, and is only counted.
    3. The second one is the mean of ln|det| less the first.

    Parameters
    ----------
    maps : CycleMaps of a single motion
    period : int, cycles after which it repeats; 0: none
    scale : float, rad; size of the motion, to tell a graze
    grown : array (n,) or None, `growth(maps)` where it is known already

    Returns
    -------
    Exponents
    """
    near, rank = int(np.sum(near_grazes(maps, scale))), int(np.min(maps.rank))
    if period:
        last = multipliers(maps[-period:], scale)
        largest, second = last.exponents
        error = math.nan
        # Multipliers below the least number leave no exponent, and no error of it.
        if len(maps.rank) >= 2 * period and rank and math.isfinite(largest):
            error = abs(largest - multipliers(maps[-2 * period:-period], scale).exponents[0])
        return Exponents(float(largest), float(second), float(error), np.empty(0), last.rank,
                         near, maps.period, last.warning)
    grown = growth(maps) if grown is None else grown
    start = min(len(grown) // 5, MOST_ALIGNING)
    kept = grown[start:] / maps.period
    running = np.cumsum(kept) / np.arange(1, len(kept) + 1)
    largest = float(running[-1])
    second = float(np.mean(maps.log_det[start:]) / maps.period) - largest \
        if rank == 2 else -math.inf
    known = mean_interval(kept)
    return Exponents(largest, second, known.half_width, running, rank, near, maps.period,
                     effective=known.effective)


def sum_rule(maps: CycleMaps, osc: Oscillator) -> NDArray[Any]:
    """What ln|det| of each cycle must be: impacts and time in contact alone decide.

    2·impacts·ln ε - 2ξ·(time in contact) under the `relative` law; under `absolute`
    Σ ln(ε|φ'₊/φ'₋|) - 2ξ·(time in contact).

    Returns
    -------
    array (..., n); NaN where a cycle has no determinant (complete chatter, ε = 0)
    """
    log_restitution = math.log(osc.restitution) if osc.restitution > 0 else 0.0
    rebounds = maps.log_rebound if osc.impact_law == "absolute" else maps.impacts * log_restitution
    expected = maps.impacts * log_restitution + rebounds - 2 * osc.damping_ratio * \
        maps.contact_time
    return np.where(maps.rank == 2, expected, np.nan)


def defects(maps: CycleMaps, osc: Oscillator) -> tuple[NDArray[Any], NDArray[Any]]:
    """The built-in checks: by how much each cycle breaks the two rules.

    Returns
    -------
    determinant : array (..., n), |det M - exp(log_det)| over |M|², what rounding may cost a
        determinant that is taken from four numbers; 0 where there is none
    sum_rule : array (..., n), |log_det - `sum_rule`| over max(1, |log_det|); NaN where there is
        none
    """
    m = maps.matrix
    with np.errstate(under="ignore"):
        det = maps.det_sign * np.exp(np.where(maps.rank == 2, maps.log_det, -math.inf)
                                     - 2 * maps.exponent * math.log(2))
    size = np.abs(m).max(axis=(-2, -1)) ** 2
    determinant = np.abs(m[..., 0, 0] * m[..., 1, 1] - m[..., 0, 1] * m[..., 1, 0] - det) \
        / np.where(size > 0, size, 1)
    with np.errstate(invalid="ignore"):
        rule = np.abs(maps.log_det - sum_rule(maps, osc)) / np.maximum(1, np.abs(maps.log_det))
    return determinant, rule


def findings(maps: CycleMaps, osc: Oscillator, period: int, scale: float,
             grown: NDArray[Any] | None = None) -> tuple[dict[str, Any], Exponents]:
    """Stability of one motion, as numbers to store.

    Parameters
    ----------
    maps : CycleMaps of a single motion
    osc : Oscillator
    period : int, cycles after which it repeats; 0: none
    scale : float, rad; size of the motion
    grown : array (n,) or None, `growth(maps)` where it is known already

    Returns
    -------
    (dict, Exponents)
        The dict has every name of NUMBERS and `multipliers`, complex (2,), NaN without a period.
    """
    found = exponents(maps, period, scale, grown)
    determinant, rule = defects(maps, osc)
    values = multipliers(maps[-period:], scale).values if period else np.full(2, complex(np.nan))
    return {"lyapunov_exponent": found.largest, "lyapunov_exponent_error": found.error,
            "lyapunov_exponent_effective": found.effective,
            "lyapunov_exponent_per_cycle": found.per_cycle[0],
            "second_lyapunov_exponent": found.second, "tangent_rank": found.rank,
            "near_grazes": found.grazes, "determinant_defect": float(determinant.max()),
            "sum_rule_defect": float(np.max(rule, initial=0.0, where=np.isfinite(rule))),
            "multipliers": values}, found
