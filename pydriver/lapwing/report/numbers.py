"""Numbers of a response with what is known of their error, and what to call that."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from lapwing.base.messages import DIGITS

# Numbers that are the greatest of the recorded cycles: without a period they grow with the record.
GREATEST = ("deepest_separation", "deepest_back_penetration", "mesh_force_peak", "impact_speed_max")


def with_error(value: float, error: float, word: str = "error") -> str:
    """`value (error 0.1)`, the value to the digits its error leaves, at most `DIGITS`.

    An error of a number, not of zero, that is too small to touch the digits shown is left out.

    Parameters
    ----------
    value, error : float; an error that is not finite, or zero, is left out
    word : 'error', an estimate; 'change', a difference of two runs or of the halves of one; '±',
        half of an interval

    Returns
    -------
    str
    """
    if not math.isfinite(value):
        return "–"
    if not math.isfinite(error):
        return f"{value:.4g}"
    if error == 0:
        return _plain(value, DIGITS)
    digits = DIGITS
    if value != 0:
        digits = math.floor(math.log10(abs(value))) - math.floor(math.log10(error)) + 1
    if digits > DIGITS and word == "error":
        return _plain(value, DIGITS)
    text = f"{_plain(value, min(digits, DIGITS))} {word} {_plain(_up(error), 1)}"
    return text if word == "±" else text.replace(" ", " (", 1) + ")"


def _plain(value: float, digits: int) -> str:
    """A number to so many digits, one at least, without an exponent where it can be avoided."""
    text = f"{value:.{max(digits, 1)}g}"
    return f"{float(text):g}" if "e" in text else text


def _up(error: float) -> float:
    """An error rounded up to one digit: it is never told too small."""
    step = 10.0 ** math.floor(math.log10(error))
    return step * math.ceil(error / step * (1 - 1e-12))


def value_words(attrs: dict[str, Any], key: str, factor: float = 1.0, brief: bool = False) -> str:
    """One number with what is known of its error, by name; a greatest value seen as such."""
    word, error = uncertainty(attrs, key)
    text = with_error(factor * attrs[key], abs(factor) * error, word)
    if attrs[key] == 0 or text == "–":
        return text
    return {"change": "≈ ", "seen": "≥ " if brief else ""}.get(word, "") + text


def uncertainty(attrs: dict[str, Any], key: str) -> tuple[str, float]:
    """What is known of a number: 'error', '±', 'change' or (the greatest one) 'seen', and how much.

    An estimate of the error where the motion repeats and both runs agree on that; a 95 % interval
    of an average without a period; else no more than a change. NaN: nothing.
    """
    error, change = attrs[f"{key}_error"], attrs.get(f"{key}_change")
    if repeats(attrs) and not doubtful(attrs) and change is not None:
        return "error", error
    if not repeats(attrs) and key in GREATEST:
        return "seen", math.nan
    # Files of version 0.1 have the change between the runs as the error.
    if change is not None and not repeats(attrs) and math.isfinite(error):
        return "±", error
    change = error if change is None else change
    return "change", float(np.fmax(change, abs(attrs.get(f"{key}_transient", math.nan))))


def repeats(attrs: dict[str, Any]) -> bool:
    """Whether the motion has a period."""
    return bool(attrs["period"])


def count_words(attrs: dict[str, Any], side: str) -> str:
    """Arrivals per cycle at a flank, `side` being '' (drive) or 'back_', likewise."""
    key = f"{side}impacts_per_cycle"
    word, error = uncertainty(attrs, key)
    if error == 0:
        return f"{attrs[key]:g}"
    rough = word == "change" and math.isfinite(error)
    return "≈ " * rough + with_error(attrs[key], error, word)


def doubtful(attrs: dict[str, Any]) -> bool:
    """Whether the second run ends in a motion of another class."""
    return bool(not attrs["status"] and not attrs["status_reference"]
                and attrs["motion_class_reference"] != attrs["motion_class"])
