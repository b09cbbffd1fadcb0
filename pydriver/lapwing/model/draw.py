"""A number that is not the same in every pair: how it is distributed, by tolerance or measured.

Values come from numbers between 0 and 1 by the inverse of the distribution function, so that any
kind of draws serves, also those that are spread more evenly than chance does.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lapwing.base import arguments
from lapwing.base.arguments import Refusals

# What a law takes, and what it needs of that.
LAWS = {"normal": (("mean", "deviation", "low", "high"), ("mean", "deviation")),
        "lognormal": (("mean", "deviation", "low", "high"), ("mean", "deviation")),
        "uniform": (("low", "high"), ("low", "high")),
        "triangular": (("low", "mode", "high"), ("low", "mode", "high"))}
NUMBERS = ("mean", "deviation", "mode", "low", "high")
# No draw lies nearer to 0 or 1, and none of a normal law farther from its mean, in deviations; none
# of one that a limit cuts.
LEAST_SHARE = 2.0**-53
FARTHEST, FARTHEST_OF_CUT = 8.3, 9.8
SAMPLINGS = ("sobol", "latin_hypercube", "random")
# Independent scrambles, fewer of which make no steady interval.
FEWEST = 16
# Limits that leave less of a distribution than this are a slip.
LEAST_LEFT = 1e-6
# Of a matrix of correlations: less is not told from a matrix that is none.
LEAST_EIGENVALUE = 1e-10


@arguments.complete()
@dataclass(frozen=True)
class Draw:
    """Distribution of one number.

    Parameters
    ----------
    law : 'normal', 'lognormal', 'uniform' or 'triangular'
    mean, deviation : float, mean and standard deviation of the value itself (of a lognormal one,
        too), before limits cut it; for 'normal' and 'lognormal'
    mode : float, the likeliest value; for 'triangular'
    low, high : float, limits: 'normal' and 'lognormal' may have either, what lies beyond is drawn
        again, so to speak (a truncated distribution); 'uniform' and 'triangular' have both

    Raises
    ------
    ValueError
        with everything refused.
    """

    law: str
    mean: float | None = None
    deviation: float | None = None
    mode: float | None = None
    low: float | None = None
    high: float | None = None

    def __post_init__(self) -> None:
        taken = Refusals()
        law = taken.take(arguments.choice, "law", self.law, tuple(LAWS))
        for name in NUMBERS:
            if getattr(self, name) is not None:
                object.__setattr__(self, name, taken.take(arguments.real, name,
                                                          getattr(self, name)))
        if law is not None and not taken.problems:
            taken.problems += self._problems()
        taken.raise_if_any("draw")

    def _problems(self) -> list[str]:
        """What is wrong with numbers that are numbers."""
        known, needed = LAWS[self.law]
        problems = [f"{name} does not go with law {self.law!r}, which takes {', '.join(known)}"
                    for name in NUMBERS if getattr(self, name) is not None and name not in known]
        problems += [f"law {self.law!r} needs {name}" for name in needed
                     if getattr(self, name) is None]
        if problems:
            return problems
        low, high = self.low, self.high
        if low is not None and high is not None and not low < high:
            return [f"low = {low:g} is not below high = {high:g}"]
        if self.mode is not None and not _of(low) <= self.mode <= _of(high):
            return [f"mode = {self.mode:g} does not lie between low = {low:g} and high = {high:g}"]
        if self.deviation is not None and self.deviation <= 0:
            return [f"deviation = {self.deviation:g}, expected above 0"]
        if self.law == "lognormal" and _of(self.mean) <= 0:
            return [f"mean = {self.mean:g}, expected above 0 with law 'lognormal'"]
        if self.law == "lognormal" and low is not None and low < 0:
            return [f"low = {low:g}, expected 0 or more with law 'lognormal'"]
        if self.law == "lognormal" and high is not None and high <= 0:
            return [f"high = {high:g}, expected above 0 with law 'lognormal'"]
        if self.law in ("normal", "lognormal") and self._left() < LEAST_LEFT:
            return [f"low and high leave {self._left():.2g} of the distribution with mean = "
                    f"{self.mean:g} and deviation = {self.deviation:g}, expected at least "
                    f"{LEAST_LEFT:g}"]
        return []

    def _scaled(self) -> tuple[float, float, float, float]:
        """Mean and deviation of the normal variable behind, and the limits in deviations."""
        mean, spread = _of(self.mean), _of(self.deviation)
        limits = (self.low, self.high)
        if self.law == "lognormal":
            spread = math.sqrt(math.log1p((spread / mean)**2))
            mean = math.log(mean) - spread**2 / 2
            limits = tuple(  # type: ignore[assignment]
                one if one is None else math.log(one) if one > 0 else -math.inf for one in limits)
        low, high = ((one - mean) / spread if one is not None else edge
                     for one, edge in zip(limits, (-math.inf, math.inf), strict=True))
        return mean, spread, low, high

    def _left(self) -> float:
        """Part of the distribution between the limits."""
        _, _, low, high = self._scaled()
        if low > 0:
            low, high = -high, -low
        return 0.5 * (math.erfc(-high / math.sqrt(2)) - math.erfc(-low / math.sqrt(2)))

    @property
    def ends(self) -> tuple[float, float]:
        """Least and greatest value that can be drawn."""
        if self.law in ("uniform", "triangular"):
            return _of(self.low), _of(self.high)
        mean, spread, low, high = self._scaled()
        far = FARTHEST if self.low is None and self.high is None else FARTHEST_OF_CUT
        ends = (mean + spread * max(low, -far), mean + spread * min(high, far))
        if self.law == "lognormal":
            ends = (math.exp(ends[0]), math.exp(ends[1]))
        return (ends[0] if self.low is None else max(ends[0], self.low),
                ends[1] if self.high is None else min(ends[1], self.high))

    def at(self, share: ArrayLike) -> NDArray[np.float64]:
        """Values below which such shares of all lie.

        Parameters
        ----------
        share : array (n,) of numbers from 0 to 1; kept `LEAST_SHARE` away from either

        Returns
        -------
        (n,) array
        """
        u = np.clip(np.asarray(share, dtype=float), LEAST_SHARE, 1 - LEAST_SHARE)
        low, high = self.ends
        if self.law == "uniform":
            found = low + u * (high - low)
        elif self.law == "triangular":
            left = (_of(self.mode) - low) / (high - low)
            with np.errstate(invalid="ignore"):
                found = np.where(u < left, low + (high - low) * np.sqrt(u * left),
                                 high - (high - low) * np.sqrt((1 - u) * (1 - left)))
        else:
            found = self._normal_at(u)
        values: NDArray[np.float64] = np.clip(found, low, high)
        return values

    def _normal_at(self, u: NDArray[np.float64]) -> NDArray[np.float64]:
        """Of the normal variable behind; limits above its mean are mirrored to keep digits."""
        from scipy.special import ndtr, ndtri

        mean, spread, low, high = self._scaled()
        sign = 1.0
        if low > 0:
            low, high, u, sign = -high, -low, 1 - u, -1.0
        below = ndtr(low)
        found = mean + sign * spread * ndtri(below + u * (ndtr(high) - below))
        return np.exp(found) if self.law == "lognormal" else np.asarray(found)

    def told(self) -> dict[str, Any]:
        """Law and numbers, those that are given."""
        return {"law": self.law} | {name: getattr(self, name) for name in NUMBERS
                                    if getattr(self, name) is not None}


def _of(number: float | None) -> float:
    assert number is not None  # checked at the beginning
    return number


def sampling_problems(sampling: str, runs: int, scrambles: int,
                      sensitivity_draws: int | None) -> list[str]:
    """What does not go together in how draws are made, one sentence each."""
    problems = []
    each, rest = divmod(runs, scrambles)
    if sampling != "random":
        power = sampling == "sobol"
        if rest or each < 2 or (power and each & (each - 1)):
            down = 2**max(1, int(math.log2(max(each, 1)))) if power else max(each, 2)
            near = [scrambles * down, scrambles * (2 * down if power else down + 1)]
            problems.append(
                f"runs = {runs}, expected {'a power of two' if power else 'as many'} in each of "
                f"{scrambles} scrambles, such as {near[0]} or {near[1]}")
    if sensitivity_draws is not None and sensitivity_draws & (sensitivity_draws - 1):
        down = 2**int(math.log2(sensitivity_draws))
        problems.append(f"sensitivity_draws = {sensitivity_draws}, expected a power of two, such "
                        f"as {down} or {2 * down}")
    return problems


def correlation_problem(matrix: NDArray[np.float64], count: int) -> str:
    """What is wrong with a matrix of correlations of so many draws; empty text: nothing."""
    if matrix.shape != (count, count):
        return f"{' × '.join(map(str, matrix.shape))} numbers, expected {count} × {count}"
    if np.any(np.diag(matrix) != 1):
        return "expected 1 on the diagonal"
    if np.any(matrix != matrix.T):
        i, j = np.argwhere(matrix != matrix.T)[0]
        return (f"not symmetric: {matrix[i, j]:g} in row {i + 1}, column {j + 1}, "
                f"{matrix[j, i]:g} in row {j + 1}, column {i + 1}")
    if np.linalg.eigvalsh(matrix)[0] < LEAST_EIGENVALUE:
        return "no variables have these correlations: the matrix is not positive definite"
    return ""


__all__ = ["FEWEST", "LAWS", "SAMPLINGS", "Draw", "correlation_problem", "sampling_problems"]
