"""The runs of an ensemble: values of each run, drawn or listed, and the oscillators they make."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lapwing.model.draw import LEAST_SHARE, Draw
from lapwing.model.linear_response import critical_force
from lapwing.model.oscillator import Oscillator
from lapwing.studies.map.grid import Grid


@dataclass(frozen=True, eq=False)
class Cloud(Grid):
    """Oscillators of which each has its own values of some parameters.

    Its runs are cut into shards as those of a map's `Grid` are: `axes` holds the values of every
    run, parameter -> (n,) array, and `line`, along which nothing is carried, is 'run'.
    """

    kind = "ensemble"

    @cached_property
    def order(self) -> tuple[str, ...]:
        """The one dimension."""
        return (self.line,)

    @cached_property
    def shape(self) -> tuple[int, ...]:
        """How many runs there are."""
        return (len(next(iter(self.axes.values()))),)

    def values(self, first: int, stop: int) -> dict[str, NDArray[np.float64]]:
        """See `Grid`."""
        return {name: values[first:stop] for name, values in self.axes.items()}

    @property
    def besides(self) -> tuple[str, ...]:
        """See `Grid`: T_full, where the drive torque is in balance and the teeth have give."""
        operation = self.operation
        driven = "drive_torque" in self.axes or operation.get("drive_torque") is not None
        return () if driven or operation.get("contact_law") == "rigid" else ("full_engagement",)

    def known(self, first: int, stop: int,
              each: Callable[[], None]) -> dict[str, NDArray[np.float64]]:
        """See `Grid`: T_full (N·m) of each run, NaN where nothing keeps contact."""
        if not self.besides:
            return {}
        found = np.empty(stop - first)
        of: dict[tuple[Any, ...], float] = {}
        for run in range(first, stop):
            each()
            osc = self.oscillator(run)
            # The critical force follows from these alone; a drawn backlash moves none.
            key = osc.damping_ratio, osc.mesh_frequency_ratio, osc.te_scale, osc.te
            if key not in of:
                try:
                    of[key] = critical_force(osc).force
                except ValueError:  # no engaged motion: at an undamped resonance
                    of[key] = np.nan
            assert osc.scales is not None  # it comes from a pair
            found[run - first] = of[key] / osc.scales.force_per_torque
        return {"full_engagement": found}

    def oscillator(self, run: int) -> Oscillator:
        """The oscillator of a run."""
        return self.at({name: values[run] for name, values in self.axes.items()})


def drawn(draws: Mapping[str, Draw], shares: NDArray[np.float64],
          correlation: NDArray[np.float64] | None = None) -> dict[str, NDArray[np.float64]]:
    """Values of numbers between 0 and 1.

    Correlated ones by a Gaussian copula: the shares become normal variables, which are made to
    have the correlations given, and shares again. So these are the correlations of the normal
    variables behind; of two normal laws without limits they are those of the values themselves.

    Parameters
    ----------
    draws : parameter -> Draw
    shares : (n, d) array
    correlation : (d, d) array or None

    Returns
    -------
    dict of parameter -> (n,) array
    """
    if correlation is not None:
        from scipy.special import ndtr, ndtri

        normal = ndtri(np.clip(shares, LEAST_SHARE, 1 - LEAST_SHARE))
        lower = np.linalg.cholesky(correlation)
        # One sum after the other: no number depends on how many rows there are.
        shares = np.stack([ndtr(sum(normal[:, j] * lower[i, j] for j in range(i + 1)))
                           for i in range(len(lower))], axis=1)
    return {name: draw.at(shares[:, i]) for i, (name, draw) in enumerate(draws.items())}


def shares_of(sampling: str, runs: int, dimensions: int, scrambles: int,
              seed: int) -> NDArray[np.float64]:
    """Numbers between 0 and 1, (runs, dimensions): random ones, or scramble after scramble."""
    if sampling == "random":
        return np.random.default_rng(np.random.SeedSequence(seed)).random((runs, dimensions))
    return np.concatenate([_scrambled(sampling, runs // scrambles, dimensions, child)
                           for child in np.random.SeedSequence(seed).spawn(scrambles)])


def _scrambled(sampling: str, count: int, dimensions: int,
               seed: np.random.SeedSequence) -> NDArray[np.float64]:
    """One scramble, independent of those with other seeds."""
    from scipy.stats import qmc

    rng = np.random.default_rng(seed)
    if sampling == "latin_hypercube":
        return np.asarray(qmc.LatinHypercube(dimensions, seed=rng).random(count))
    return np.asarray(qmc.Sobol(dimensions, seed=rng, bits=64).random(count))


def sensitivity_shares(count: int, dimensions: int, scrambles: int,
                       seed: int) -> NDArray[np.float64]:
    """Saltelli's design, scramble after scramble: A, B, and A with each column of B in turn.

    (scrambles·(dimensions + 2)·count, dimensions); A and B are the two halves of one Sobol
    sequence, as `scipy.stats.sobol_indices` has them.
    """
    parts = []
    for child in np.random.SeedSequence([seed, 1]).spawn(scrambles):
        both = _scrambled("sobol", count, 2 * dimensions, child)
        a, b = both[:, :dimensions], both[:, dimensions:]
        parts += [a, b]
        for i in range(dimensions):
            mixed = a.copy()
            mixed[:, i] = b[:, i]
            parts.append(mixed)
    return np.concatenate(parts)


__all__ = ["Cloud", "drawn", "sensitivity_shares", "shares_of"]
