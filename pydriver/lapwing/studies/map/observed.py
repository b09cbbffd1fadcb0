"""What is kept of each run of a map: always, and what is asked for besides."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from lapwing.base.codes import Status
from lapwing.base.quantities import OBSERVED, SHARES
from lapwing.engine import Wanted
from lapwing.studies.stability import CycleMaps, exponents, growth

if TYPE_CHECKING:
    from lapwing.engine import Points, SweepResult

# Variables of every shard, as they are kept.
KEPT = {"status": np.int8, "period": np.int16, "arrivals": np.int32, "back_arrivals": np.int32,
        "chatter": np.int8, "states_visited": np.int8, "deepest_separation": float,
        "deepest_back_penetration": float, "fastest_arrival": float}
# ... and what follows from them.
RATES = {"impacts_per_cycle": "arrivals", "back_impacts_per_cycle": "back_arrivals"}


def kept(observe: Sequence[str]) -> dict[str, Any]:
    """Type of each variable of a shard."""
    return KEPT | {name: float for one in observe for name in OBSERVED[one]}


def wanted(observe: Sequence[str]) -> Wanted:
    """What the engine records for it. Exponents need every bounce."""
    exponent = "exponent" in observe
    return Wanted(cycles=True, bounces=exponent, tangent=exponent,
                  averages=bool(set(observe) - {"exponent"}))


def rate_of(name: str, numbers: Callable[[str], NDArray[Any]], record: int) -> NDArray[Any]:
    """Arrivals per mesh cycle, a variable of `RATES`; NaN where a run has no result.

    Parameters
    ----------
    name : str, of `RATES`
    numbers : callable(variable of `KEPT`) -> array
    record : int, mesh cycles recorded
    """
    period = numbers("period")
    rate = numbers(RATES[name]) / np.where(period > 0, period, record)
    rate[numbers("status") != Status.OK] = np.nan
    return rate


def observations(observe: Sequence[str], result: SweepResult, points: Points,
                 newtons: NDArray[np.float64]) -> dict[str, NDArray[np.float64]]:
    """What is asked for besides, over the last period, or over all cycles of a motion without one.

    Parameters
    ----------
    observe : names of `OBSERVED`
    result : SweepResult, of `wanted(observe)`
    points : Points (n,)
    newtons : (n,) array, force per unit of deflection, k'·lever (N)

    Returns
    -------
    dict of variable -> (n,) array, NaN where a run has no result; forces also under the rigid law,
    which has no spring, an exponent also where a periodic motion grazes
    """
    outcome = result.outcome
    found = {name: np.full(len(outcome), np.nan) for one in observe for name in OBSERVED[one]}
    good = outcome["status"] == Status.OK
    some = outcome[good]
    time = sum(some[name] for name in SHARES.values())
    for name in set(SHARES) & set(found):
        found[name][good] = some[SHARES[name]] / time
    if "rms" in observe:
        mean = some["phi_integral"] / time
        found["phi_rms"][good] = np.sqrt(np.maximum(
            some["phi_square_integral"] / time - mean**2, 0.0))
    if "forces" in observe and points.shared.contact_law != "rigid":
        found["mesh_force_mean"][good] = newtons[good] * some["force_integral"] / time
        found["mesh_force_peak"][good] = newtons[good] * some["force_peak"]
    if "exponent" in observe:
        found["lyapunov_exponent"] = _exponents(result, points, good)
    return found


def _exponents(result: SweepResult, points: Points,
               good: NDArray[np.bool_]) -> NDArray[np.float64]:
    """The largest Lyapunov exponent of each run, per τ."""
    outcome, rows = result.outcome, result.tangent
    found = np.full(len(outcome), np.nan)
    mesh_period = 2 * np.pi / points.mesh_frequency_ratio
    size = np.maximum(np.abs(points.force), outcome["deepest_separation"])
    size = np.where(size > 0, size, points.backlash)
    free = np.flatnonzero(good & (outcome["period"] == 0))
    grown = dict(zip(free, growth(CycleMaps.from_rows(rows[free], 1.0)), strict=True))
    for i in np.flatnonzero(good):
        maps = CycleMaps.from_rows(rows[i], float(mesh_period[i]))
        found[i] = exponents(maps, int(outcome["period"][i]), float(size[i]), grown.get(i)).largest
    return found
