"""What was likely meant by something that a deck does not know."""

from __future__ import annotations

from typing import Any

from lapwing.base.messages import cut

# Quotes of word processors, by the quote that a deck knows.
QUOTES = {"‘": "'", "’": "'", "‚": "'", "‛": "'", "“": '"', "”": '"', "„": '"', "«": '"', "»": '"'}
# Keys that other programs have, and what a deck says instead.
OTHER_KEYS = {
    **dict.fromkeys(("step", "increment", "delta"),
                    "write count, the number of values with both ends, instead of a step"),
    "steps": "write count, the number of values with both ends",
    **dict.fromkeys(("start", "begin", "min", "stop", "end", "max"),
                    "a range has from, to and count")}


def of_key(key: str, fields: dict[str, Any]) -> str:
    """What to write for a key that a group with ranges does not know; empty text: no idea."""
    return OTHER_KEYS.get(key, "") if "count" in fields else ""


def of_quotes(text: str) -> str:
    """What to write for a text in typographic quotes; empty text where it has none."""
    if not any(mark in text for mark in QUOTES):
        return ""
    inside = "".join(one for one in text if one not in QUOTES).strip()
    return f"these are typographic quotes, write '{cut(inside)}'"


def of_parameters(name: str) -> str:
    """What to do about several parameters in one study; empty text where it is one."""
    return "one parameter in each group; write a group for each, or &map for every combination" \
        if any(mark in name for mark in ", ;+&") else ""
