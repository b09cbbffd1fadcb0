"""The oscillators of a range of values of one parameter: their numbers at once, each when asked."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import fields, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from lapwing.base.arguments import LEAST, MOST, wrong
from lapwing.base.quantities import CURVE
from lapwing.engine import Points
from lapwing.model.gear_pair import SPEEDS, GearPair, Pairs, force_at, frequency_at
from lapwing.model.oscillator import Oscillator
from lapwing.studies.sweep.curves import Curves, curves_of, varies_curve

if TYPE_CHECKING:
    from lapwing.model.transmission_error.table import TransmissionError

TORQUES = ("brake_torque", "drive_torque")
# Factors of the transmission error, one of them in the words of a parabola.
OF_CURVE = ("te_scale", "parabola_amplitude")
# Numbers of the pair itself, teeth apart: they are counted.
OF_PAIR = tuple(field.name for field in fields(GearPair) if not field.name.endswith("_teeth"))


def parameters(te: object = None, curves: bool = False) -> tuple[str, ...]:
    """Names of the numbers that may be varied: of the pair, its operating point, the curve.

    Parameters
    ----------
    te : TransmissionError or None, of whose series each amplitude may be; None: none
    curves : bool, whether `te` itself may, whose values are no numbers
    """
    terms = len(getattr(te, "harmonics", ()))
    return (*OF_PAIR, *TORQUES, *SPEEDS, *OF_CURVE,
            *(f"harmonic_amplitude_{i + 1}" for i in range(terms)), *(CURVE,) * curves)


def oscillator_at(pair: GearPair, te: TransmissionError | Curves, parameter: str, value: Any,
                  operation: Mapping[str, Any]) -> Oscillator:
    """Oscillator of one value of the parameter; `operation` holds the other arguments."""
    pair, curve, operation = moved_to(pair, te, {parameter: value}, operation)
    return pair.oscillator(curve, **operation)


def moved_to(pair: GearPair, te: TransmissionError | Curves, values: Mapping[str, Any],
             operation: Mapping[str, Any]) -> tuple[GearPair, TransmissionError, dict[str, Any]]:
    """Pair, transmission error and operation with other values of some parameters.

    Raises
    ------
    ValueError
        where the operation has a value of its own.
    """
    curves, own, at = curves_of(te), dict[str, Any](), dict(operation)
    for name, value in values.items():
        if at.get(name) is not None:
            raise ValueError(wrong(name, at[name], "none beside the values of it"))
        if name in OF_PAIR:
            own[name] = float(value)
        elif not varies_curve(name):
            key, factor = _in_operation(curves.given, name, at)
            at[key] = factor * float(value)
    return replace(pair, **own), curves.at(values), at


def _in_operation(te: TransmissionError, parameter: str,
                  operation: Mapping[str, Any]) -> tuple[str, float]:
    """What a parameter that is none of the pair's is called in its operation, and its unit there.

    Raises
    ------
    ValueError
        for parabola_amplitude where the transmission error is no parabola.
    """
    if parameter != "parabola_amplitude":
        return parameter, 1.0
    amplitude = float(-te.coefficients[0, 0])
    parabola = type(te).parabola(amplitude)
    if not amplitude or not all(np.array_equal(getattr(te, name), getattr(parabola, name))
                                for name in ("knots", "coefficients", "kinks", "harmonics")):
        raise ValueError("parabola_amplitude goes with TransmissionError.parabola(amplitude), "
                         "amplitude not 0, alone")
    return "te_scale", float(operation.get("te_scale", 1.0)) / amplitude


def points_at(pair: GearPair, te: TransmissionError | Curves,
              values: Mapping[str, NDArray[Any]], operation: Mapping[str, Any]) -> Points:
    """Numbers of many oscillators that differ in several parameters.

    Parameters
    ----------
    pair, te, operation : what they share
    values : parameter -> array (n,), n > 0; of each, least and greatest together are known to be
        accepted by `oscillator_at`, of labels each
    """
    curves, curve = curves_of(te).each(values)
    own = {name: array for name, array in values.items() if name in OF_PAIR}
    at: dict[str, Any] = dict(operation)
    for name, array in values.items():
        if name not in OF_PAIR and not varies_curve(name):
            key, factor = _in_operation(curves_of(te).given, name, at)
            at[key] = factor * array if factor != 1.0 else array
    first: dict[str, Any] = {name: float(array[0]) for name, array in own.items()}
    one: dict[str, Any] = {name: float(value[0]) if isinstance(value, np.ndarray) else value
                           for name, value in at.items()}
    shared = replace(pair, **first).oscillator(curves[0], **one)
    pairs: Any = Pairs(pair, own) if own else pair
    torques = {name: at.get(name) for name in TORQUES}
    speed = {name: at[name] for name in SPEEDS if at.get(name) is not None}
    drift: Any = 0.0
    if shared.degrees_of_freedom == 2 and torques["drive_torque"] is not None:
        unbalanced = pairs.gear_ratio * torques["drive_torque"] - torques["brake_torque"]
        drift = unbalanced / pairs.total_inertia / pairs.natural_frequency**2
    numbers = {"force": force_at(pairs, **torques),
               "mesh_frequency_ratio": frequency_at(pairs, **speed) / pairs.natural_frequency,
               "gear_ratio": pairs.gear_ratio, "te_scale": at.get("te_scale", 1.0),
               "damping_ratio": pairs.xi, "restitution": pairs.restitution,
               "backlash": pairs.backlash, "mean_acceleration": drift}
    count = len(next(iter(values.values())))
    every: dict[str, Any] = {
        name: np.array(np.broadcast_to(np.asarray(number, dtype=float), count))
        for name, number in numbers.items()}
    return Points(shared, **every, curves=curves, curve=curve)


def force_per_deflection(pair: GearPair, values: Mapping[str, Any]) -> Any:
    """k'·lever (N) of a pair, some of whose numbers have other values, float or array each."""
    return values.get("mesh_stiffness", pair.mesh_stiffness) \
        * values.get("pinion_base_lever", pair.pinion_base_lever)


class Varied(Sequence[Oscillator]):
    """Oscillators of some values of a parameter.

    Torques, speeds and scales move one number of it alone. Then none is made before it is asked
    for, and what they share is made once for all sweeps of a pair in such an operation.

    Attributes
    ----------
    points : Points (n,), the numbers of all
    shared : Oscillator, one whose laws are those of all, and all numbers but what is varied

    Raises
    ------
    ParameterError
        (a ValueError) of the first oscillator that is refused.
    """

    def __init__(self, pair: GearPair, te: TransmissionError | Curves, parameter: str, values: Any,
                 operation: Mapping[str, Any]) -> None:
        self._made: dict[int, Oscillator] = {}
        self._make: Callable[[int], Oscillator] = lambda i: oscillator_at(
            pair, te, parameter, values[i], operation)
        self._count = len(values)
        given = curves_of(te).given
        alone = parameter not in OF_PAIR and not varies_curve(parameter)
        key = _key(pair, given, parameter, operation) if alone else None
        shared = _SHARED.get(key)
        self.shared = self[0] if shared is None else shared[-1]
        if alone and self.shared.degrees_of_freedom == 1:
            name, numbers, good = _moved(pair, given, parameter, values, operation)
            for i in np.flatnonzero(~good):
                self[int(i)]
            self.points = Points.varied(self.shared, name, numbers)
            if key is not None and shared is None:
                _keep(key, pair, given, self.shared)
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


# What sweeps of late had in common: key -> pair and transmission error, whose places in memory are
# not taken by others as long as they are here, and an oscillator.
_SHARED: dict[Any, tuple[GearPair, TransmissionError, Oscillator]] = {}
MOST_KEPT, MOST_KNOTS = 16, 5000
# Kinds of arguments whose text tells all of them.
_PLAIN = {float, int, bool, str, type(None), np.float64}


def _key(pair: GearPair, te: TransmissionError, parameter: str,
         operation: Mapping[str, Any]) -> Any:
    """What tells one common oscillator from another; None: it is not known, or too much to keep."""
    if te.knots.size > MOST_KNOTS or not _PLAIN.issuperset(map(type, operation.values())):
        return None
    return id(pair), id(te), parameter, repr(operation)


def _keep(key: Any, pair: GearPair, te: TransmissionError, shared: Oscillator) -> None:
    if len(_SHARED) >= MOST_KEPT:
        _SHARED.clear()
    _SHARED[key] = pair, te, shared


def _moved(pair: GearPair, te: TransmissionError, parameter: str, values: Any,
           operation: Mapping[str, Any]) -> tuple[str, Any, Any]:
    """Number of an oscillator that such a parameter moves, its values, and which are allowed.

    A scale of the transmission error is allowed between two that are.
    """
    if parameter in OF_CURVE:
        name, factor = _in_operation(te, parameter, operation)
        good = np.ones(len(values), dtype=bool)
        good[[np.argmin(values), np.argmax(values)]] = False
        return name, factor * values if factor != 1.0 else values, good
    if parameter in SPEEDS:
        frequency = frequency_at(pair, **{parameter: values})
        numbers = frequency / pair.natural_frequency
        return "mesh_frequency_ratio", numbers, (
            (values >= LEAST) & (numbers >= LEAST) & (numbers <= MOST))
    torques = {key: operation.get(key) for key in TORQUES} | {parameter: values}
    numbers = force_at(pair, **torques)
    return "force", numbers, np.abs(numbers) <= MOST
