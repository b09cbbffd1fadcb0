"""Words of an entry to numbers, logicals and text, with a remark on what looks mistaken."""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any, NamedTuple

from lapwing.base.messages import cut
from lapwing.base.text_file import REAL, decimal_number
from lapwing.deck.problems import Place

if TYPE_CHECKING:
    from lapwing.deck.parser import Entry, Word
    from lapwing.deck.problems import Report

# A list longer than this is a slip of the keyboard in a repeat count.
MAX_LIST = 100_000

_INTEGER = re.compile(r"[+-]?[0-9]+")
_REPEAT = re.compile(r"([0-9]+)\*(.*)", re.DOTALL)
_LOGICAL = re.compile(r"\.?(?:(t|true)|(f|false))\.?", re.IGNORECASE)
_DIGITS = re.compile(r"[0-9]+(?:[ed][+-]?[0-9]+)?", re.IGNORECASE)


class Bare:
    """A word that is no value; no key accepts it."""


class Value(NamedTuple):
    """One value with its source text, place and a remark that explains a refusal."""

    value: object
    text: str
    place: Place
    start: int
    end: int
    remark: str = ""
    glued: bool = False  # a comma and nothing else stands between this value and the one before


def read_values(entry: Entry, report: Report) -> list[Value] | None:
    """Values of an entry, repeat counts written out; None where the syntax is refused already."""
    values: list[Value] = []
    after_comma, comma_at = True, None
    words = iter(_joined(entry.words))
    for word in words:
        if word.kind == "COMMA":
            if after_comma:
                report.add(word.place, f"{entry.key}: a value is missing before the comma")
                return None
            after_comma, comma_at = True, word
            continue
        glued = comma_at is not None and values and values[-1].end == comma_at.start \
            and comma_at.end == word.start
        new = _read(word, bool(glued))
        if new is None or len(values) + new[0] > MAX_LIST:
            report.add(word.place, f"{entry.key}: {cut(word.text)}; expected a repeat count "
                                   f"from 1 to {MAX_LIST} and a value, no more values in all")
            return None
        values += new[0] * [new[1]]
        after_comma, comma_at = False, None
    if not values:
        report.add(entry.place, f"{entry.key} has no value")
        return None
    return values


def _joined(words: list[Word]) -> list[Word]:
    """Words, with `3*` and the quoted text that touches it made one."""
    result: list[Word] = []
    for word in words:
        last = result[-1] if result else None
        if last and word.kind == "STRING" and last.kind == "WORD" and last.end == word.start \
                and re.fullmatch(r"[0-9]+\*", last.text):
            result[-1] = type(word)("REPEATED", last.text + word.text, last.place, last.start,
                                    word.end)
        else:
            result.append(word)
    return result


def _read(word: Word, glued: bool) -> tuple[int, Value] | None:
    """(repeat count, Value) of a word, None where the count is not usable."""
    count, text = 1, word.text
    repeat = _REPEAT.fullmatch(text) if word.kind in ("WORD", "REPEATED") else None
    if repeat:
        digits, text = repeat.groups()
        count = int(digits) if len(digits) < 10 else 0
        if not 1 <= count <= MAX_LIST or not text:
            return None
    value, remark = _convert(text, word.kind)
    return count, Value(value, text, word.place, word.start, word.end, remark, glued)


def _convert(text: str, kind: str) -> tuple[Any, str]:
    """Python value and remark of one word."""
    if kind in ("STRING", "REPEATED"):
        quote = text[0]
        return text[1:-1].replace(2 * quote, quote), ""
    if kind == "UNCLOSED":
        return Bare(), "the closing quote is missing on this line"
    if kind != "WORD":
        return Bare(), f"{cut(text)} has no place here"
    if REAL.fullmatch(text):
        return _number(text)
    logical = _LOGICAL.fullmatch(text)
    if logical:
        return logical[1] is not None, ""
    return Bare(), decimal_number(text)[1]


def _number(text: str) -> tuple[float | Bare, str]:
    """Integer or real; what double precision cannot hold is refused, not rounded away."""
    if _INTEGER.fullmatch(text) and len(text) <= 18:
        return int(text), ""
    number, remark = decimal_number(text)
    return (Bare() if number is None else number), remark


def number_and_rest(text: str) -> tuple[str, str] | None:
    """A word such as `7.0Nm` in its two parts, None where no number begins it."""
    number = REAL.match(text)
    return (number[0], text[number.end():]) if number else None


def thousands(values: list[Value]) -> str | None:
    """`9000` where the values read like 9,000 (groups of three digits, no blank), else None."""
    first, *groups = values
    if groups and re.fullmatch(r"[+-]?[1-9][0-9]{0,2}", first.text) \
            and all(group.glued and re.fullmatch("[0-9]{3}", group.text) for group in groups):
        return "".join(value.text for value in values)
    return None


def decimal_comma(values: list[Value]) -> str | None:
    """`0.5` where two values read like 0,5 (whole number, comma, digits; no blank), else None."""
    first, second = values
    if second.glued and _INTEGER.fullmatch(first.text) and _DIGITS.fullmatch(second.text):
        return f"{first.text}.{second.text}"
    return None


def suspicious_pairs(values: list[Value]) -> Iterator[list[Value]]:
    """Pairs in a list that may be decimal commas: glued to each other, to no third value."""
    for i in range(1, len(values)):
        alone = not values[i - 1].glued and not (i + 1 < len(values) and values[i + 1].glued)
        pair = values[i - 1:i + 1]
        if alone and values[i].text[:1].isdigit() and decimal_comma(pair):
            yield pair
