"""Many oscillators that share their laws: their numbers as arrays, and their curves."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, fields, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from lapwing.model.oscillator import TE_SIGNS, Oscillator

if TYPE_CHECKING:
    from lapwing.model.transmission_error.table import TransmissionError


@dataclass(frozen=True, eq=False)
class Points:
    """The numbers of each point of a sweep, and what they share.

    Attributes
    ----------
    shared : Oscillator, any of them: laws, gap and signs are those of all
    force, backlash, mean_acceleration : (n,) array, rad
    mesh_frequency_ratio, gear_ratio, te_scale, damping_ratio, restitution : (n,) array
    curves : tuple of TransmissionError; left out: that of `shared`, of all
    curve : (n,) array of int, which of them each has
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
    curves: tuple[TransmissionError, ...] = ()
    curve: NDArray[np.intp] = field(default_factory=lambda: np.empty(0, np.intp))

    def __post_init__(self) -> None:
        if not self.curves:
            object.__setattr__(self, "curves", (self.shared.te,))
            object.__setattr__(self, "curve", np.zeros(len(self.force), np.intp))

    @classmethod
    def of(cls, oscillators: Sequence[Oscillator]) -> Points:
        """Points of oscillators that share their laws."""
        numbers: dict[str, Any] = {
            name: np.array([getattr(osc, name) for osc in oscillators], dtype=float)
            for name in NUMBERS[:-1]}
        curves = tuple({id(osc.te): osc.te for osc in oscillators}.values())
        if len(curves) > 1:
            places = {id(te): i for i, te in enumerate(curves)}
            numbers |= {"curves": curves, "curve": np.array(
                [places[id(osc.te)] for osc in oscillators], np.intp)}
        drift = np.array([osc.mean_rotation.acceleration if osc.mean_rotation else 0.0
                          for osc in oscillators])
        return cls(oscillators[0], **numbers, mean_acceleration=drift)

    @classmethod
    def varied(cls, osc: Oscillator, name: str, values: NDArray[np.float64]) -> Points:
        """One oscillator of one degree of freedom, another value of a number at each point."""
        numbers: dict[str, Any] = {key: np.full(len(values), getattr(osc, key))
                                   for key in NUMBERS[:-1]}
        numbers[name] = np.array(values, dtype=float)
        return cls(osc, **numbers, mean_acceleration=np.zeros(len(values)))

    def __len__(self) -> int:
        return len(self.force)

    def take(self, which: NDArray[Any]) -> Points:
        """Some of them, by index or by a mask."""
        return self._each(lambda values: values[which])

    def repeated(self, times: int) -> Points:
        """All of them so many times over."""
        if times == 1:
            return self
        return self._each(lambda values: np.tile(values, times))

    def _each(self, change: Callable[[NDArray[Any]], NDArray[Any]]) -> Points:
        numbers: dict[str, Any] = {name: change(getattr(self, name)) for name in NUMBERS}
        return Points(self.shared, **numbers, curves=self.curves, curve=change(self.curve))

    def by_curve(self) -> Iterator[tuple[Oscillator, NDArray[np.bool_] | slice]]:
        """For each transmission error an oscillator that has it, and which points have."""
        if len(self.curves) == 1:
            yield self.shared, slice(None)
            return
        for i, te in enumerate(self.curves):
            which = self.curve == i
            if which.any():
                yield replace(self.shared, te=te), which

    @property
    def peak_to_peak(self) -> NDArray[np.float64]:
        """Greatest less least g, rad; as of the oscillators one by one."""
        scale = self.flank_scale
        low, high = self.curves[0].extrema if len(self.curves) == 1 else \
            np.array([te.extrema for te in self.curves], dtype=float)[self.curve].T
        found: NDArray[np.float64] = np.abs(scale * high - scale * low)
        return found

    @property
    def flank_scale(self) -> NDArray[np.float64]:
        """`Oscillator.flank_scale` of each."""
        return TE_SIGNS[self.shared.te_sign] * self.gear_ratio * self.te_scale


NUMBERS = tuple(one.name for one in fields(Points)
                if one.name not in ("shared", "curves", "curve"))
