"""Which torque to choose, or that the run does not say."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from lapwing.base.messages import at_least
from lapwing.report.branches import end_of_rattling
from lapwing.report.measured import has_interval
from lapwing.report.words import NOT_SAID, SEARCH, SEARCH_WOULD_SAY
from lapwing.results.findings import SYMBOLS

if TYPE_CHECKING:
    import xarray as xr

    from lapwing.report.answers.torque import Torque

# What the symbols mean, told where they are used.
TERMS = {"full": "only above it the engaged motion keeps contact; others may rattle there",
         "on": "only above it a rigid tooth that rests stays; others may bounce there"}


def choice(torque: Torque) -> str:
    """The least torque to choose, under which conditions, and what would change it.

    Parameters
    ----------
    torque : Torque

    Returns
    -------
    str, a sentence or two in Markdown; empty where nothing is known
    """
    seen = torque.rattling
    value = torque.kept[2] if torque.kept and torque.kept[1] == "found" else math.nan
    quiet = torque.quiet()[0] if seen.values.size else np.zeros(0)
    quiet = quiet[~(quiet < value)]
    if not quiet.size:
        return _unanswered(torque, value)
    step = quiet[0] - seen.last if seen.last is not None else 0.0
    least = max(quiet[0], value) if math.isfinite(value) else quiet[0]
    search = torque.search()
    terms = [] if search is None else \
        ["T_safe: from there on none of the motions tried rattles"] if seen.last is not None \
        else ["the lowest torque searched"]
    branch, ends = max(filter(None, map(end_of_rattling, torque.diagrams)),
                       default=(-math.inf, True))
    if branch >= least:
        if not ends:
            return (f"**Choose more than {at_least(branch)} {torque.unit} on the gear; how much "
                    f"more is not known**{_bracket(torque, [])}: a branch of rattling goes on to "
                    "there, where it was followed no further.")
        least, step = branch, 0.0
        terms = ["T_safe: where the last branch of rattling that was found ends"]
    noise = _noise(torque, search)
    if noise > least:
        least, step = noise, 0.0
        terms.append("raised to allow for the noise of the samples")
    doubts = ["a start that was not tried", "a longer look"]
    if torque.laws.get("contact_law") == "restitution" and "impact_law" in torque.laws:
        doubts.append("another impact law")
    doubt = ", ".join(doubts[:-1]) + f" or {doubts[-1]}"
    few = "" if search is not None or torque.diagrams else \
        f" Few starts were tried: {SEARCH} tries more."
    return (f"**Choose at least {at_least(least, step)} {torque.unit} on the gear**"
            f"{_bracket(torque, terms)}{_margin(torque, least, step)}. {doubt.capitalize()} may "
            f"move it, by how much is not known.{few}")


def unanswered(torque: Torque) -> bool:
    """Whether no study of a run looked for the torque: there are responses alone."""
    return not torque.sweeps and torque.search() is None \
        and not any("trial" in one.dims for one in torque.criticals)


def _unanswered(torque: Torque, value: float) -> str:
    """What can be said where no torque is known to keep the teeth together."""
    seen, unit = torque.rattling, torque.unit
    known = math.isfinite(value)
    term, at = [], ""
    if torque.kept is not None and known:
        symbol = SYMBOLS[torque.kept[0]]
        term, at = [f"{symbol}: {TERMS[torque.kept[0]]}"], f"{symbol} = {at_least(value)} {unit}"
    if unanswered(torque) and (seen.values.size or known):
        below = f"; a torque below {at} on the gear surely does not{_bracket(torque, term)}" * known
        return f"{NOT_SAID}{below}. {SEARCH_WOULD_SAY}"
    if not known:
        return "**Which torque to choose is not answered**: look at higher ones." \
            if seen.values.size else ""
    least = value if seen.last is None else max(value, seen.last)
    return (f"**Choose more than {at_least(least)} {unit} on the gear; how much more is not known**"
            f"{_bracket(torque, term)}: {SEARCH} that begins above it would say.")


def _bracket(torque: Torque, terms: list[str]) -> str:
    """Under which conditions, and what the number is."""
    told = [*filter(None, [torque.conditions.words(torque.laws)]), *terms]
    return f" ({'; '.join(told)})" if told else ""


def _noise(torque: Torque, search: xr.Dataset | None) -> float:
    """Upper end of what the noise of samples leaves of T_safe, else of T_full; NaN: none."""
    some = [one.attrs for one in torque.criticals if one.attrs["find"] in ("full", "on")] \
        if search is None else [search.attrs]
    return max((one["high"] for one in some if has_interval(one)), default=math.nan)


def _margin(torque: Torque, least: float, step: float) -> str:
    """What more transmission error asks for.

    Where torques balance and no motion comes to the coast flank, nothing but the transmission
    error has a scale: all motions, and the torque, grow in proportion to it.
    """
    last, back = torque.rattling.last, torque.back
    if not torque.laws.get("balanced", 0) or least <= 0 or last is None:
        return ""
    if back.values.size and (back.last is None or back.last < last):
        return ("; with 10 % more transmission error it is "
                f"{at_least(1.1 * least, step)} {torque.unit}")
    return ("; it grows in proportion to the transmission error, as long as no motion comes to "
            "the coast flanks")
