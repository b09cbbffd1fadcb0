"""Which oscillators have a closed form that keeps its digits, and which are stepped."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from lapwing.engine.flanks import series_is_taken
from lapwing.engine.points import Points
from lapwing.model.linear_response import response_amplification

if TYPE_CHECKING:
    from lapwing.engine.numerics import Numerics
    from lapwing.model.oscillator import Oscillator
    from lapwing.model.transmission_error.table import TransmissionError

# Three of sixteen digits may be lost between response and free oscillation.
MOST_AMPLIFIED = 1e3
# From about here on the closed form is graded (most_panels times panel_span of
# fortran/flow/exact/panels.f90): its parts are pieces of the table each by itself, and no
# periodic response is among them.
GRADED_SPAN = 1.31e5
# Amplifications kept of each transmission error, for the next call mostly asks for the same.
MOST_KEPT = 16
_AMPLIFIED: WeakKeyDictionary[
    TransmissionError, dict[tuple[float, float, str], NDArray[Any]]] = WeakKeyDictionary()


def method_of(osc: Oscillator, numerics: Numerics) -> str:
    """'exact' or 'rk4': how an oscillator is moved under `numerics`.

    The closed form of contact is a periodic response plus a free oscillation. Near an undamped
    resonance both grow without bound and leave no digits in their sum; RK4 has no such trouble.
    Two degrees of freedom have no closed form here.

    Raises
    ------
    ValueError
        where 'exact' is asked for and there is none, or the response is more than `MOST_AMPLIFIED`
        times its cause.
    """
    stepped = _steps(osc, osc.mesh_frequency_ratio, osc.damping_ratio, numerics)
    return "rk4" if stepped else "exact"


def common_method(points: Any, numerics: Numerics) -> str:
    """`method_of` many oscillators moved together: 'rk4' where one of them needs it.

    Parameters
    ----------
    points : Points, or sequence of Oscillator
    numerics : Numerics
    """
    points = points if isinstance(points, Points) else Points.of(points)
    for osc, which in points.by_curve():
        ratio, damping = points.mesh_frequency_ratio[which], points.damping_ratio[which]
        # Neither forces nor anything else but these matter here.
        if ratio.size and ratio.min() == ratio.max() and damping.min() == damping.max():
            ratio, damping = float(ratio[0]), float(damping[0])
        if np.any(_steps(osc, ratio, damping, numerics)):
            return "rk4"
    return "exact"


def steps(points: Points, numerics: Numerics) -> NDArray[np.bool_]:
    """Which of the points `method_of` moves by 'rk4', array (n,) of bool."""
    found = np.zeros(len(points), dtype=bool)
    for osc, which in points.by_curve():
        found[which] = _steps(osc, points.mesh_frequency_ratio[which], points.damping_ratio[which],
                              numerics)
    return found


def _steps(osc: Oscillator, ratio: Any, damping: Any, numerics: Numerics) -> Any:
    """Whether mesh frequency ratios and damping ratios (numbers or arrays) want 'rk4'."""
    if numerics.method == "exact" and osc.degrees_of_freedom == 2:
        raise ValueError("method = 'exact' goes with degrees_of_freedom = 1, expected 'rk4' or "
                         "'auto'")
    if numerics.method == "rk4" or osc.degrees_of_freedom == 2:
        return np.True_
    amplified = _amplified(osc, ratio, damping)
    lost = amplified > MOST_AMPLIFIED
    if not np.any(lost):
        return lost
    span = 2 * np.pi / ratio * np.maximum(1.0, 2 * damping)
    lost = lost & ~((span > GRADED_SPAN) & (not series_is_taken(osc.te)))
    if numerics.method == "auto" or not np.any(lost):
        return lost
    raise ValueError(f"method = 'exact': so near to an undamped resonance (amplification "
                     f"{np.max(amplified[lost]):.3g}) the closed form loses its digits; take "
                     "'rk4'")


def _amplified(osc: Oscillator, ratio: Any, damping: Any) -> Any:
    """`response_amplification`; of single numbers it is kept."""
    if np.ndim(ratio) or np.ndim(damping):
        return response_amplification(osc, ratio, damping)
    made = _AMPLIFIED.setdefault(osc.te, {})
    key = (float(ratio), float(damping), osc.contact_law)
    if key not in made:
        if len(made) >= MOST_KEPT:
            made.clear()
        made[key] = response_amplification(osc, ratio, damping)
    return made[key]
