"""The oscillators of a range of values of one parameter: their numbers at once, each when asked."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import fields, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from lapwing.base.arguments import LEAST, MOST
from lapwing.engine import Points
from lapwing.model.gear_pair import GearPair, force_at, frequency_at
from lapwing.model.oscillator import Oscillator

if TYPE_CHECKING:
    from lapwing.model.transmission_error.table import TransmissionError

TORQUES = ("brake_torque", "drive_torque")
SPEEDS = ("pinion_speed_rpm", "pinion_speed_rad_s", "mesh_frequency_hz")
# Numbers of the pair itself, teeth apart: they are counted.
OF_PAIR = tuple(field.name for field in fields(GearPair) if not field.name.endswith("_teeth"))


def parameters() -> tuple[str, ...]:
    """Names of the numbers that may be varied: of the pair, of its operating point."""
    return (*OF_PAIR, *TORQUES, *SPEEDS)


def oscillator_at(pair: GearPair, te: TransmissionError, parameter: str, value: float,
                  operation: Mapping[str, Any]) -> Oscillator:
    """Oscillator of one value of the parameter; `operation` holds the other arguments."""
    if parameter in OF_PAIR:
        changed: dict[str, Any] = {parameter: float(value)}
        return replace(pair, **changed).oscillator(te, **operation)
    return pair.oscillator(te, **{**operation, parameter: float(value)})


class Varied(Sequence[Oscillator]):
    """Oscillators of some values of a parameter; torques and speeds move one number of it alone.

    Attributes
    ----------
    points : Points (n,), the numbers of all

    Raises
    ------
    ParameterError
        (a ValueError) of the first oscillator that is refused.
    """

    def __init__(self, pair: GearPair, te: TransmissionError, parameter: str, values: Any,
                 operation: Mapping[str, Any]) -> None:
        self._made: dict[int, Oscillator] = {}
        self._make: Callable[[int], Oscillator] = lambda i: oscillator_at(
            pair, te, parameter, values[i], operation)
        self._count = len(values)
        first = self[0]
        if first.degrees_of_freedom == 1 and parameter not in OF_PAIR:
            name, numbers, good = _moved(pair, parameter, values, operation)
            for i in np.flatnonzero(~good):
                self[int(i)]
            self.points = Points.varied(first, name, numbers)
        else:
            self.points = Points.of(list(self))

    def __len__(self) -> int:
        return self._count

    def __getitem__(self, i: Any) -> Any:
        if isinstance(i, slice):
            return [self[k] for k in range(*i.indices(len(self)))]
        i = range(self._count)[i]
        if i not in self._made:
            self._made[i] = self._make(i)
        return self._made[i]


def _moved(pair: GearPair, parameter: str, values: Any,
           operation: Mapping[str, Any]) -> tuple[str, Any, Any]:
    """Number of an oscillator that a torque or a speed moves, its values, and which are allowed."""
    if parameter in SPEEDS:
        frequency = frequency_at(pair, **{parameter: values})
        numbers = frequency / pair.natural_frequency
        return "mesh_frequency_ratio", numbers, (
            (values >= LEAST) & (numbers >= LEAST) & (numbers <= MOST))
    torques = {key: operation.get(key) for key in TORQUES} | {parameter: values}
    numbers = force_at(pair, **torques)
    return "force", numbers, np.abs(numbers) <= MOST
