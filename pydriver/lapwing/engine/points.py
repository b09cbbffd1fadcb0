"""Many oscillators that share their transmission error and laws: their numbers as arrays."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lapwing.model.oscillator import TE_SIGNS, Oscillator


@dataclass(frozen=True, eq=False)
class Points:
    """The numbers of each point of a sweep, and what they share.

    Attributes
    ----------
    shared : Oscillator, any of them: transmission error, laws, gap and signs are those of all
    force, backlash, mean_acceleration : (n,) array, rad
    mesh_frequency_ratio, gear_ratio, te_scale, damping_ratio, restitution : (n,) array
    """

    shared: Oscillator
    force: NDArray[np.float64]
    mesh_frequency_ratio: NDArray[np.float64]
    gear_ratio: NDArray[np.float64]
    te_scale: NDArray[np.float64]
    damping_ratio: NDArray[np.float64]
    restitution: NDArray[np.float64]
    backlash: NDArray[np.float64]
    mean_acceleration: NDArray[np.float64]

    @classmethod
    def of(cls, oscillators: Sequence[Oscillator]) -> Points:
        """Points of oscillators that share their transmission error and laws."""
        numbers = {name: np.array([getattr(osc, name) for osc in oscillators], dtype=float)
                   for name in NUMBERS[:-1]}
        drift = np.array([osc.mean_rotation.acceleration if osc.mean_rotation else 0.0
                          for osc in oscillators])
        return cls(oscillators[0], **numbers, mean_acceleration=drift)

    @classmethod
    def varied(cls, osc: Oscillator, name: str, values: NDArray[np.float64]) -> Points:
        """One oscillator of one degree of freedom, another value of a number at each point."""
        numbers = {key: np.full(len(values), getattr(osc, key)) for key in NUMBERS[:-1]}
        numbers[name] = np.array(values, dtype=float)
        return cls(osc, **numbers, mean_acceleration=np.zeros(len(values)))

    def __len__(self) -> int:
        return len(self.force)

    @classmethod
    def joined(cls, parts: Sequence[Points]) -> Points:
        """Several one after the other; they share what the first does."""
        return cls(parts[0].shared, **{
            name: np.concatenate([getattr(part, name) for part in parts]) for name in NUMBERS})

    def take(self, which: NDArray[Any]) -> Points:
        """Some of them, by index or by a mask."""
        return Points(self.shared, **{name: getattr(self, name)[which] for name in NUMBERS})

    def repeated(self, times: int) -> Points:
        """All of them so many times over."""
        if times == 1:
            return self
        return Points(self.shared, **{name: np.tile(getattr(self, name), times)
                                      for name in NUMBERS})

    @property
    def peak_to_peak(self) -> NDArray[np.float64]:
        """Greatest less least g, rad; as of the oscillators one by one."""
        low, high = self.shared.te.extrema
        return np.abs(self.flank_scale * high - self.flank_scale * low)

    @property
    def flank_scale(self) -> NDArray[np.float64]:
        """`Oscillator.flank_scale` of each."""
        return TE_SIGNS[self.shared.te_sign] * self.gear_ratio * self.te_scale


NUMBERS = tuple(field.name for field in fields(Points) if field.name != "shared")
