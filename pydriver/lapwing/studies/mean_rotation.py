"""What a second degree of freedom tells: both shafts' motion and the mean speed.

Nothing here without one.  Speeds are those of the shafts in rad/s, the mean speed that of the
pinion; angles are counted from the nominal rotation, which the transmission error follows.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from lapwing.model.oscillator import Oscillator


def shafts(osc: Oscillator, theta: NDArray[Any], theta_dot: NDArray[Any],
           means: NDArray[Any] | None) -> dict[str, NDArray[Any]]:
    """Angles ahead of the nominal rotation (rad) and speeds (rad/s) of both shafts.

    Parameters
    ----------
    osc : Oscillator
    theta, theta_dot : arrays (n,), rad and rad per τ, relative angle
    means : table (n,), `engine.records.MEAN_TABLE`

    Returns
    -------
    dict of pinion_angle, gear_angle, pinion_speed, gear_speed -> array (n,)
    """
    mean = osc.mean_rotation
    if mean is None or means is None or osc.scales is None:
        return {}
    pinion, gear = mean.shafts(osc.gear_ratio, theta, means["mean_angle"])
    rates = mean.shafts(osc.gear_ratio, theta_dot, means["mean_rate"])
    nominal = mean.pinion_rate * np.array([1.0, 1 / osc.gear_ratio])
    speeds = (np.array(rates) + nominal[:, None]) * osc.scales.natural_frequency
    return {"pinion_angle": pinion, "gear_angle": gear,
            "pinion_speed": speeds[0], "gear_speed": speeds[1]}


def by_cycle(osc: Oscillator, means: NDArray[Any] | None) -> dict[str, NDArray[Any]]:
    """cycle_mean_speed, rad/s, array (record,): at the beginning of each cycle."""
    if osc.mean_rotation is None or means is None:
        return {}
    return {"cycle_mean_speed": osc.mean_rotation.mean_speed(osc, means["mean_rate"])}


def by_point(oscillators: Sequence[Oscillator], means: NDArray[Any] | None, shape: tuple[int, int],
             dims: tuple[str, str]) -> dict[str, tuple[tuple[str, str, str], NDArray[Any]]]:
    """mean_speed of a sweep, rad/s, (starts, values, record): at the beginning of each cycle."""
    if means is None:
        return {}
    rates = means["mean_rate"].reshape(*shape, -1)
    speeds = np.stack([osc.mean_rotation.mean_speed(osc, rates[:, j])
                       for j, osc in enumerate(oscillators) if osc.mean_rotation], axis=1)
    return {"mean_speed": ((*dims, "recorded_cycle"), speeds)}


def attributes(osc: Oscillator, means: NDArray[Any] | None) -> dict[str, float]:
    """Nominal speed, mean speeds at both ends of a record (rad/s), drift (rad/s²), of the pinion.

    `means`, a table (n,), are the record's samples, its end the last.
    """
    mean = osc.mean_rotation
    if mean is None or means is None or osc.scales is None:
        return {}
    first, last = mean.mean_speed(osc, means["mean_rate"][[0, -1]])
    frequency = osc.scales.natural_frequency
    return {"degrees_of_freedom": 2, "nominal_speed": mean.pinion_rate * frequency,
            "mean_speed_first": float(first), "mean_speed_last": float(last),
            "mean_acceleration": osc.gear_ratio * mean.acceleration * frequency**2}
