"""What people read of things: bounded messages about bad input, facts as a table of a notebook."""

from __future__ import annotations

import difflib
import html
import math
import re
from collections.abc import Callable, Iterable, Mapping
from typing import TypeVar

MAX_OF_A_KIND, MAX_MESSAGES, MAX_CHARACTERS, MAX_LENGTH = 20, 200, 20_000, 800
_LONGEST_WORD = 200
# Digits told at most: the model is not known better. The result file has all of them.
DIGITS = 4
_WORD = re.compile(r"'[^']*'|= \S+|\S+")
Problem = TypeVar("Problem")
_VARIABLE = re.compile("['=]|.*[0-9]")


def cut(text: str, length: int = 40) -> str:
    """A text of at most `length` characters, with dots where something is left out."""
    return text if len(text) <= length else text[:length - 3] + "..."


def at_least(value: float, step: float = 0.0) -> str:
    """A lower limit in words, rounded up: to `DIGITS` digits, or to what a bracket leaves."""
    return _rounded(value, math.ceil, step)


def at_most(value: float, step: float = 0.0) -> str:
    """An upper limit in words, rounded down likewise."""
    return _rounded(value, math.floor, step)


def percent(share: float) -> str:
    """A share or probability in per cent, to three digits; one short of all is not told as all."""
    if not math.isfinite(share):
        return "not known"
    # A sum of parts that are all may be short of it by rounding.
    return f"{100 * share:.3g} %" if share <= 0.99 or share > 1 - 1e-12 else \
        f"{math.floor(1e4 * share) / 100:g} %"


def _rounded(value: float, towards: Callable[[float], int], step: float) -> str:
    if value == 0 or not math.isfinite(value):
        return f"{value:g}"
    places = DIGITS - 1 - math.floor(math.log10(abs(value)))
    if step > 0:
        places = math.ceil(-math.log10(step) - 1e-9)
    unit = 10.0 ** -places
    # What is a multiple of the unit but for rounding stays.
    whole = round(value / unit) if abs(value / unit - round(value / unit)) < 1e-6 \
        else towards(value / unit)
    return f"{whole * unit:.10g}"


def decimals(value: float, bar: float) -> tuple[str, str]:
    """`value` to the digits that its bar leaves, and the bar to two digits."""
    places = max(0, 1 - math.floor(math.log10(bar))) if bar > 0 else 6
    return f"{value:.{places}f}", f"{bar:.2g}"


def likely(name: str, known: Iterable[str], most: int = 1) -> list[str]:
    """Known names that are most similar to another, or hold it as a word; at most `most`."""
    word, known = cut(name, 100).lower(), list(known)
    near = difflib.get_close_matches(word, known, most, cutoff=0.6)
    parts = [one for one in known if one not in near and (
        word in one.split("_") or set(one.split("_")) <= set(word.split("_")))]
    return (near + parts)[:most]


def nearest(name: str, known: Iterable[str], most: int = 1) -> str:
    """`did you mean 'x'?` for the most similar known names, else all of them."""
    known = list(known)
    near = likely(name, known, most)
    if near:
        return f"did you mean {' or '.join(map(repr, near))}?"
    return "known are " + ", ".join(known)


def facts_html(title: str, facts: Mapping[str, object]) -> str:
    """A heading and a table of two columns, as a notebook shows an object."""
    rows = "".join(f"<tr><th style='text-align:left'>{html.escape(name)}</th>"
                   f"<td style='text-align:left'>{html.escape(str(value))}</td></tr>"
                   for name, value in facts.items())
    return f"<b>{html.escape(title)}</b><table>{rows}</table>"


class Shown:
    """What shows itself by `_facts`: in a line of a console, in a table of a notebook."""

    def _facts(self) -> dict[str, object]:
        raise NotImplementedError

    def __repr__(self) -> str:
        facts = ", ".join(f"{name}: {fact}" for name, fact in self._facts().items())
        return f"<{type(self).__name__} {facts}>"

    def _repr_html_(self) -> str:
        return facts_html(type(self).__name__, self._facts())


def printable(text: str) -> str:
    """A file name as text: what is no UTF-8 in it is written as an escape."""
    return text.encode("utf-8", "backslashreplace").decode()


def cut_words(text: str) -> str:
    """A message whose long words, and itself, are cut."""
    text = re.sub(rf"\S{{{_LONGEST_WORD + 1},}}", lambda m: cut(m[0], _LONGEST_WORD), text)
    return cut(text, MAX_LENGTH)


def bounded(problems: Iterable[Problem], text_of: Callable[[Problem], str],
            with_text: Callable[[Problem, str], Problem]) -> list[Problem]:
    """The first problems of each kind, and of all; the last one of them counts the others.

    Parameters
    ----------
    problems : iterable, in the order to be shown
    text_of : function, problem -> its message
    with_text : function, (problem, message) -> the same problem with another message
    """
    kept: list[Problem] = []
    number: dict[str, int] = {}
    left_out: dict[str, int] = {}
    last: dict[str, int] = {}
    characters = beyond = 0
    for problem in problems:
        text = text_of(problem)
        kind = _kind(text)
        number[kind] = number.get(kind, 0) + 1
        if number[kind] > MAX_OF_A_KIND:
            left_out[kind] = left_out.get(kind, 0) + 1
        elif len(kept) == MAX_MESSAGES or characters + len(text) > MAX_CHARACTERS:
            beyond += 1
        else:
            last[kind] = len(kept)
            kept.append(problem)
            characters += len(text)
    for kind, more in left_out.items():
        if kind in last:
            at = kept[last[kind]]
            kept[last[kind]] = with_text(at, f"{text_of(at)} (... and {more} more of this kind)")
        else:
            beyond += more
    if beyond:
        kept[-1] = with_text(kept[-1], f"{text_of(kept[-1])} (... and {beyond} more problems)")
    return kept


def _kind(text: str) -> str:
    """A message without what differs in its kind: quoted texts, values, words with digits."""
    return _WORD.sub(lambda word: "#" if _VARIABLE.match(word[0]) else word[0], text)
