"""Words and table rows that attractors and basins share."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from lapwing.base.arrivals import arrivals_in
from lapwing.base.messages import percent
from lapwing.report.ensemble.text import limits
from lapwing.report.words import NOT_SAID, SEARCH_WOULD_SAY, parameter_unit

if TYPE_CHECKING:
    import xarray as xr


def lossless(attrs: Mapping[str, Any]) -> str:
    """What motions that starts lead to are where an impact loses nothing, as a sentence."""
    if attrs["contact_law"] == "compliant" or attrs.get("restitution") != 1:
        return ""
    return " Impacts lose nothing: motions that only strike attract no other, each is one of many."


def choice(torques: Sequence[float]) -> list[str]:
    """That no torque was searched, and one that is not enough: where some start rattles.

    Parameters
    ----------
    torques : sequence of float, N·m

    Returns
    -------
    list of str, a sentence in Markdown; none without a torque
    """
    torques = [one for one in torques if one >= 0]  # Below it the coast flanks are pressed.
    if not torques:
        return []
    return [f"{NOT_SAID}; {max(torques):g} {parameter_unit('brake_torque')} on the gear surely "
            f"does not: there some starts lead to rattling. {SEARCH_WOULD_SAY}"]


def motion_words(one: xr.Dataset, data: xr.Dataset) -> str:
    """An attractor in a sentence: what it does."""
    if float(one["deepest_separation"]) == 0:
        return "lasting contact"
    rate, word = float(one["impacts_per_cycle"]), arrivals_in(data.attrs).word
    depth = float(f"{1e6 * float(one['deepest_separation']):.3g}")
    period = f"rattling of period {int(one['period'])}" if int(one["period"]) \
        else "rattling without a period"
    struck = f", back {word}s" * (float(one["back_impacts_per_cycle"]) > 0)
    return (f"{period} with {rate:.3g} {word}{'s' * (rate != 1)} a cycle, {depth:g} µrad "
            f"deep{struck}")


def attractor_rows(data: xr.Dataset) -> list[tuple[str, ...]]:
    """A table of attractors: a row each, its shares and what is known of its stability."""
    word = arrivals_in(data.attrs).word
    sure = bool((data["share_low"].notnull() | data["share_high"].notnull()).any())
    rows = [("attractor", "class", f"{word}s a cycle", "deepest separation (µrad)",
             "larger multiplier", "Lyapunov exponent per τ", "share",
             *["95 % limits"] * sure)]
    for i in range(data.sizes["attractor"]):
        one = data.isel(attractor=i)
        multiplier = math.hypot(float(one["multiplier_real"][0]), float(one["multiplier_imag"][0]))
        error = float(one["lyapunov_exponent_error"])
        exponent = float(one["lyapunov_exponent"])
        rows.append((
            str(int(one["attractor"])), str(one["motion_class"].item()),
            f"{float(one['impacts_per_cycle']):.4g}",
            f"{1e6 * float(one['deepest_separation']):.4g}",
            f"{multiplier:.4g}" if math.isfinite(multiplier) else "–",
            "–" if math.isnan(exponent) else f"{exponent:.4g}"
            + f" ± {error:.1g}" * math.isfinite(error),
            percent(float(one["share"])),
            *[limits(float(one["share_low"]), float(one["share_high"]), percent) or "–"] * sure))
    return rows
