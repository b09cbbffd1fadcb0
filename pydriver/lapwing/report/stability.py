"""What multipliers and exponents say, in words, from stored attributes and variables alone."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from lapwing.base.codes import Status
from lapwing.base.quantities import value_words

if TYPE_CHECKING:
    import xarray as xr

# A check that a sum of some hundred roundings keeps; more is an error of the program.
BROKEN = 1e-10


def stability_sentence(attrs: dict[str, Any]) -> str:
    """How small deviations of one response fare; empty where nothing was recorded.

    Parameters
    ----------
    attrs : mapping, attributes of a response

    Returns
    -------
    str
    """
    if "lyapunov_exponent" not in attrs or attrs["status"]:
        return ""
    if attrs.get("stability_warning"):
        return f"**No multipliers: {attrs['stability_warning']}.**" + _checks(attrs)
    if attrs["tangent_rank"] == 0:
        return ("The tooth comes to rest on the rigid flank and forgets every deviation (largest "
                "Lyapunov exponent -∞)." + _checks(attrs))
    if attrs["lyapunov_exponent"] == -math.inf:
        return ("Every deviation dies out within the mesh period beyond what numbers hold: "
                "multipliers and exponents cannot be told." + _confirmed(attrs) + _checks(attrs))
    if "multiplier_real" in attrs:
        text = (f"Floquet multipliers over {_cycles(attrs['period'])}: {_multipliers(attrs)}; the "
                "largest Lyapunov exponent is ")
    else:
        text = "The largest Lyapunov exponent is "
    return f"{text}{_exponent(attrs)}." + _confirmed(attrs) + _checks(attrs)


def aperiodic_words(attrs: dict[str, Any]) -> str:
    """Reason why a response has no period, to follow the statement; empty if none is known."""
    reason = attrs.get("aperiodic_reason", "")
    return f" ({reason})" if reason else ""


def _confirmed(attrs: dict[str, Any]) -> str:
    """What Newton's method says of the period, where it does not agree."""
    found = attrs.get("orbit_period", attrs["period"])
    if found == attrs["period"]:
        return ""
    if found:
        return (f" **Not settled: Newton's method finds that the motion will repeat every "
                f"{_cycles(found)}.**")
    return " **Newton's method finds no orbit of this period beside it.**"


def _cycles(period: int) -> str:
    return "one mesh cycle" if period == 1 else f"{period} mesh cycles"


def _multipliers(attrs: dict[str, Any]) -> str:
    """Both multipliers, or the one that chatter leaves."""
    real, imag = (np.atleast_1d(attrs[f"multiplier_{part}"]) for part in ("real", "imag"))
    if attrs["tangent_rank"] == 1:
        return f"{real[0]:.4g}, the other lost in complete chatter (exponent -∞)"
    if imag[0]:
        return f"{real[0]:.4g} ± {abs(imag[0]):.4g}i"
    return f"{real[0]:.4g} and {real[1]:.4g}"


def _exponent(attrs: dict[str, Any]) -> str:
    """The largest exponent per mesh cycle and per τ, with its 95 % interval where there is one."""
    rate, error = attrs["lyapunov_exponent"], attrs["lyapunov_exponent_error"]
    cycle = attrs["lyapunov_exponent_per_cycle"]
    if "multiplier_real" in attrs or not rate:
        return f"{cycle:.4g} per mesh cycle ({rate:.4g} per τ)"
    if not math.isfinite(error):
        return f"{cycle:.2g} per mesh cycle ({rate:.2g} per τ), by how much it is off is not known"
    return (f"{cycle:.3g} ± {error * cycle / rate:.2g} per mesh cycle ({rate:.3g} ± {error:.2g} "
            "per τ; 95 %, by batch means)")


def _checks(attrs: dict[str, Any]) -> str:
    worst = max(attrs["determinant_defect"], attrs["sum_rule_defect"])
    return f" **The sum rule is broken by {worst:.1e}.**" if worst > BROKEN else ""


def sweep_stability(sweep: xr.Dataset, unit: str) -> list[str]:
    """Lines of a sweep: where it is chaotic, warnings, checks; none without exponents."""
    if "lyapunov_exponent" not in sweep:
        return []
    done = sweep["status"].values == Status.OK
    rate, error = (sweep[name].values for name in ("lyapunov_exponent", "lyapunov_exponent_error"))
    chaotic = done & (sweep["period"].values == 0) & (rate - error > 0)
    flagged = done & (sweep["near_grazes"].values > 0)
    without = flagged & np.isnan(rate)
    lost = done & (sweep["tangent_rank"].values < 2)
    open_ = done & (sweep["period"].values == 0) & ~np.isfinite(rate - error)
    lines = [f"- chaos (all of the 95 % interval of the largest Lyapunov exponent above zero): at "
             f"{_counted(chaotic, done & ~open_)}"
             + (f", the largest {_largest(sweep, chaotic, unit)}" if chaotic.any() else "")
             + f"; not known at {int(open_.sum())}" * bool(open_.any()),
             f"- a deviation loses one or both of its numbers in complete chatter or rest at "
             f"{_counted(lost, done)}; a second exponent is not given there",
             f"- near grazing: {_counted(flagged, done)}, of them {int(without.sum())} periodic, "
             "for which no multiplier is given"]
    worst = {}
    for name in ("determinant_defect", "sum_rule_defect"):
        found = sweep[name].values[done & np.isfinite(sweep[name].values)]
        if not found.size:
            return [*lines, "- checks of the exponents: none could be made"]
        worst[name] = float(found.max())
    verdict = "kept" if max(worst.values()) <= BROKEN else "**broken**"
    return [*lines, f"- checks of the exponents {verdict}: determinant within "
            f"{worst['determinant_defect']:.1e}, sum rule within {worst['sum_rule_defect']:.1e}"]


def _counted(flags: NDArray[Any], done: NDArray[Any]) -> str:
    return f"{int(flags.sum())} of {int(done.sum())} motions"


def _largest(sweep: xr.Dataset, chaotic: NDArray[Any], unit: str) -> str:
    cycle = np.where(chaotic, sweep["lyapunov_exponent_per_cycle"].values, -math.inf)
    start, at = np.unravel_index(np.argmax(cycle), cycle.shape)
    value = sweep[sweep["status"].dims[1]].values[at]
    return f"{cycle[start, at]:.3g} per mesh cycle at {value_words(value)} {unit}".rstrip()
