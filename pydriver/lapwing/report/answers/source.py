"""What a source reports, against what was computed."""

from __future__ import annotations

import math
from typing import Any

from lapwing.report.words import parameter_unit
from lapwing.results.findings import START_NAMES

# Depths that differ by less, as a part of the one reported, are told together.
CLOSE = 0.05


def against_source(responses: Any, last_rattling: float | None, last_words: str) -> str:
    """Which of the source's numbers come out, and which do not.

    Parameters
    ----------
    responses : sequence of Dataset, at the deck's own operating point
    last_rattling : float or None, N·m; the highest torque at which anything was seen to rattle
    last_words : str, the same in words

    Returns
    -------
    str, a sentence in Markdown; empty where nothing is reported, or no response is known
    """
    known = sorted((one.attrs for one in responses if not one.attrs["status"]),
                   key=lambda one: one["brake_torque"])
    parts = [*_counts([one for one in known if "claim_impacts_per_cycle" in one]),
             *_depths([one for one in known if "claim_deepest_separation" in one], last_rattling,
                      last_words)]
    return f"**Against the source**: {'; '.join(parts)}." if parts else ""


def _at(some: list[dict[str, Any]]) -> str:
    """Torques in words."""
    torques = [f"{one['brake_torque']:g}" for one in some]
    return " and ".join([", ".join(torques[:-1]), torques[-1]][len(torques) == 1:]) \
        + f" {parameter_unit('brake_torque')}"


def _counts(claims: list[dict[str, Any]]) -> list[str]:
    """Impacts per mesh cycle."""
    same = [one for one in claims
            if one["impacts_per_cycle"] == one["claim_impacts_per_cycle"]]
    parts = [f"impacts per mesh cycle as reported at {_at(same)}"] if same else []
    return parts + [f"{one['impacts_per_cycle']:.3g} impacts per mesh cycle at {_at([one])} where "
                    f"{one['claim_impacts_per_cycle']:g} are reported"
                    for one in claims if one not in same]


def _depths(claims: list[dict[str, Any]], last_rattling: float | None,
            last_words: str) -> list[str]:
    """Deepest separations; one that is reported to be none may hold for this start alone."""
    parts, off = [], {}
    for one in claims:
        here, there = (1e6 * one[f"{key}deepest_separation"] for key in ("", "claim_"))
        unit = parameter_unit("brake_torque")
        if here == there == 0:
            begun = START_NAMES.get(one["start"], f"start {one['start']}").removeprefix("each ")
            alone = last_rattling is not None and last_rattling > one["brake_torque"]
            parts.append(f"no separation at {_at([one])} as reported"
                         + (f", but {begun} only: other motions rattle up to {last_words} {unit}"
                            if alone else f" ({begun})"))
        elif there == 0:
            parts.append(f"{here:.4g} µrad of separation at {_at([one])} where none is reported")
        elif abs(here / there - 1) <= CLOSE:
            off[one["brake_torque"]] = one, abs(here / there - 1)
        else:
            parts.append(f"{here:.4g} µrad at {_at([one])} where {there:.4g} are reported "
                         f"({100 * (here / there - 1):+.0f} %)")
    # A bound is rounded up, but for the rounding of the quotient.
    bound = math.ceil(1e3 * max((part for _, part in off.values()), default=0) - 1e-9) / 10
    close = [f"separation within {bound:g} % of the reported at "
             f"{_at([one for one, _ in off.values()])}"] if off else []
    return close + parts
