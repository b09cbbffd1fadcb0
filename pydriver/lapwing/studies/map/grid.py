"""The runs of a map: crossing points of its axes, counted line by line."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import product
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from lapwing.base.quantities import CURVE
from lapwing.engine import Points, series_is_taken
from lapwing.engine.points import NUMBERS
from lapwing.model.gear_pair import GearPair
from lapwing.model.oscillator import Oscillator
from lapwing.model.transmission_error import TransmissionError
from lapwing.studies.sweep.curves import Curves, curves_of, varies_curve
from lapwing.studies.sweep.varied import (
    OF_PAIR,
    TORQUES,
    force_per_deflection,
    moved_to,
    points_at,
)


class Crossings:
    """Crossing points of axes, counted line by line: along the last of `order` first."""

    axes: Mapping[str, NDArray[Any]]

    @cached_property
    def order(self) -> tuple[str, ...]:
        """Axes in the order in which runs are counted, the fastest last."""
        raise NotImplementedError

    @cached_property
    def shape(self) -> tuple[int, ...]:
        """Numbers of values in `order`."""
        return tuple(len(self.axes[name]) for name in self.order)

    @property
    def runs(self) -> int:
        """How many there are."""
        return int(np.prod(self.shape, dtype=object))

    @property
    def length(self) -> int:
        """Runs of a line."""
        return self.shape[-1]


@dataclass(frozen=True, eq=False)
class Grid(Crossings):
    """Oscillators at the crossing points of axes.

    Runs are counted line by line: along `line`, an axis, first, along the others in their order.

    Attributes
    ----------
    pair : GearPair
    te : TransmissionError, or Curves
    axes : dict of parameter -> array of its values, rising; of `te` labels of `Curves`
    line : str, the axis along which runs follow each other
    operation : dict, the other arguments of `GearPair.oscillator`
    kind : str, of the study
    """

    pair: GearPair
    te: TransmissionError | Curves
    axes: Mapping[str, NDArray[Any]]
    line: str
    operation: Mapping[str, Any]
    kind: ClassVar[str] = "map"

    @cached_property
    def order(self) -> tuple[str, ...]:
        """Axes in the order in which runs are counted, the fastest last."""
        return (*(name for name in self.axes if name != self.line), self.line)

    @cached_property
    def pieces(self) -> int:
        """Pieces of the longest table that is moved along; 0 where all are short series."""
        curves = curves_of(self.te)
        return max(0 if series_is_taken(te) else te.knots.size - 1
                   for te in (curves.given, *curves.named.values()))

    def values(self, first: int, stop: int) -> dict[str, NDArray[Any]]:
        """Values of each parameter in the runs from `first` up to `stop`."""
        at = np.unravel_index(np.arange(first, stop), self.shape)
        return {name: self.axes[name][places] for name, places in zip(self.order, at, strict=True)}

    def points(self, first: int, stop: int) -> Points:
        """Oscillators' numbers of the runs from `first` up to `stop`, all at once."""
        return points_at(self.pair, self.te, self.values(first, stop), self.operation)

    def newtons(self, first: int, stop: int) -> NDArray[np.float64]:
        """Force per unit of deflection, k'·lever (N), in these runs."""
        return np.full(stop - first, force_per_deflection(self.pair, self.values(first, stop)))

    @property
    def besides(self) -> tuple[str, ...]:
        """Names of real numbers of a run that are known without moving it (`known`); none."""
        return ()

    def known(self, first: int, stop: int,
              each: Callable[[], None]) -> dict[str, NDArray[np.float64]]:
        """These numbers of the runs from `first` up to `stop`; `each` is called before each run."""
        return {}

    def check_corners(self, who: str) -> None:
        """Refuse what is refused at a corner, where parameters are extreme together.

        Raises
        ------
        ValueError
            of the first such oscillator; `who` is the call that is told to be wrong.
        """
        ends = [values if name == CURVE else sorted({float(values.min()), float(values.max())})
                for name, values in self.axes.items()]
        for corner in product(*ends):
            oscillator = self.at(dict(zip(self.axes, corner, strict=True)))
            if oscillator.gap == "one_flank" and oscillator.force < 0:
                raise ValueError(f"{who}: rest with a negative force needs a coast flank to rest "
                                 "on")

    def at(self, values: Mapping[str, Any]) -> Oscillator:
        """The oscillator at such values of the parameters."""
        pair, te, operation = moved_to(self.pair, self.te, values, self.operation)
        return pair.oscillator(te, **operation)

    def oscillator(self, run: int) -> Oscillator:
        """The oscillator of one run, to the last bit of its `points`."""
        places = np.unravel_index(run, self.shape)
        oscillator = self.at({name: self.axes[name][place]
                              for name, place in zip(self.order, places, strict=True)})
        points = self.points(run, run + 1)
        exact: dict[str, Any] = {name: float(getattr(points, name)[0]) for name in NUMBERS[:-1]}
        return replace(oscillator, **exact)


def fastest_axis(axes: Mapping[str, Any]) -> str:
    """The last torque, since one closed form serves all torques; else the last that is cheap."""
    torques = [name for name in axes if name in TORQUES]
    # Those that move one number of an oscillator alone.
    cheap = [name for name in axes if name not in OF_PAIR and not varies_curve(name)]
    return (torques or cheap or list(axes))[-1]
