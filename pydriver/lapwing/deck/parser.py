"""Namelist text to groups of keys and words, each with its line and column."""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

from lapwing.base.messages import cut
from lapwing.base.text_file import TextFileError, read_text
from lapwing.deck.problems import Place, Report
from lapwing.deck.values import MAX_LIST

MAX_BYTES = 4_000_000
MAX_COUNTS = {"groups": 1000, "keys": 10_000, "words": 200_000}
# Inside a token of many numbers: one of them, or a comma.
_NUMBER = re.compile(r"[^\s,]+|,")
# The tokens of the grammar as far as counting them needs.
_ROUGH = re.compile(r"""![^\n]*|(?P<groups>[&$](?!end\b))|(?P<keys>=)|(?P<words>'(?:[^'\n]|'')*'|
    "(?:[^"\n]|"")*"|[^\s,!=&$]+)""", re.IGNORECASE | re.VERBOSE)


class Word(NamedTuple):
    """One token: its kind in the grammar, its text, its place and extent in the text."""

    kind: str
    text: str
    place: Place
    start: int
    end: int


@dataclass
class Entry:
    """`key = words`."""

    key: str
    place: Place
    words: list[Word]
    override: str | None = None


@dataclass
class Group:
    """`&name … /` with its entries by lower-case key."""

    name: str
    place: Place
    entries: dict[str, Entry] = field(default_factory=dict)


@cache
def _parser() -> Any:
    from lark import Lark

    grammar = Path(__file__).with_name("grammar.lark").read_text(encoding="utf-8")
    return Lark(grammar, parser="lalr", lexer="basic", maybe_placeholders=False)


def read_deck(path: Any, report: Report) -> str | None:
    """Text of a deck file; None where it has none, or one too large to be parsed."""
    try:
        text = read_text(path, MAX_BYTES, "no deck needs more")
    except TextFileError as error:
        report.add(Place(str(path), error.line, error.column), error.text)
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or error
        report.add(Place(str(path)), f"cannot be read: {reason}")
    else:
        excess = excess_of(text)
        if excess is None:
            return text
        at, words = excess
        report.add(Place(str(path), text.count("\n", 0, at) + 1, at - text.rfind("\n", 0, at)),
                   words)
    return None


def excess_of(text: str) -> tuple[int, str] | None:
    """(position, what is wrong) where a text passes a limit, else None; parsing costs more."""
    counts = dict.fromkeys(MAX_COUNTS, 0)
    in_list = 0
    for found in _ROUGH.finditer(text):
        kind = found.lastgroup
        if kind is None:
            continue
        in_list = in_list + 1 if kind == "words" else 0
        counts[kind] += 1
        if in_list > MAX_LIST + 1:  # the next key may stand last
            return found.start(), f"more values in a list than expected (at most {MAX_LIST})"
        if counts[kind] > MAX_COUNTS[kind]:
            return found.start(), f"expected at most {MAX_COUNTS[kind]} {kind} in a deck"
    return None


def parse(text: str, file: str, report: Report) -> list[Group]:
    """Groups of a deck in order; syntax problems go to `report`."""
    groups, origin = [], Place(file)
    tree = _parser().parse(text)
    for child in tree.children:
        if child.data == "group":
            groups.append(_group(child, file, report))
    _outside(tree, file, report, bool(groups))
    for group, following in zip(groups, [*groups, None][1:], strict=True):
        if not group[1]:
            where = f"before &{following[0].name} on line {following[0].place.line}" \
                if following else "at the end"
            report.add(group[0].place, f"&{group[0].name} is not closed; expected a / {where}")
    if not groups:
        report.add(origin, "holds no group; expected &gear_pair first")
    return [group for group, _ in groups]


def lex_value(text: str, file: str) -> list[Word]:
    """Words of a value given outside a file, all at the place of the override itself."""
    return [Word(word.kind, word.text, Place(file), word.start, word.end)
            for token in _parser().lex(text.replace("\r", "\n")) for word in _words(token, file)]


def _word(token: Any, file: str) -> Word:
    place = Place(file, token.line, token.column)
    return Word(token.type, str(token), place, token.start_pos, token.end_pos)


def _words(token: Any, file: str) -> list[Word]:
    """The words of a token: itself, or the numbers and commas it is made of."""
    if token.type != "NUMBERS":
        return [_word(token, file)]
    words: list[Word] = []
    line, before, seen = token.line, -token.column, 0
    for found in _NUMBER.finditer(token):
        at, text = found.start(), found[0]
        breaks = token.count("\n", seen, at)
        if breaks:
            line, before = line + breaks, token.rfind("\n", seen, at)
        seen = at
        words.append(Word("COMMA" if text == "," else "WORD", text, Place(file, line, at - before),
                          token.start_pos + at, token.start_pos + found.end()))
    return words


def _group(tree: Any, file: str, report: Report) -> tuple[Group, bool]:
    """A group and whether it was closed."""
    head = _word(tree.children[0], file)
    name = _lower(head.text[1:].strip())
    if not re.fullmatch(r"&\w+", head.text):
        report.add(head.place, f"{cut(head.text.strip())}: a group begins with & and its name, "
                               "as in &gear_pair")
    group, closed = Group(name, head.place), False
    for child in tree.children[1:]:
        if not hasattr(child, "data"):
            closed = True
        elif child.data == "entry":
            _entry(child, group, file, report)
        elif child.data == "stray":
            for word in _words(child.children[0], file):
                if not _refuse_hash(word, report):
                    report.add(word.place, f"{cut(word.text)} is no `key = value`")
    _outside(tree, file, report, True)
    return group, closed


def _entry(tree: Any, group: Group, file: str, report: Report) -> None:
    key = _word(tree.children[0], file)
    words = [word for item in tree.children[2:] for word in _words(item.children[0], file)]
    name = _lower(key.text)
    words = [word for word in words if not _refuse_hash(word, report)]
    if name in group.entries:
        first = group.entries[name].place.line
        report.add(key.place, f"{name} is given twice in &{group.name} (first on line {first})")
        return
    group.entries[name] = Entry(name, key.place, words)


def _outside(tree: Any, file: str, report: Report, after_group: bool) -> None:
    """Report each run of text between groups once."""
    words = [word for child in tree.children if getattr(child, "data", "") == "outside"
             for word in _words(child.children[0], file)]
    words = [word for word in words if not _refuse_hash(word, report)]
    if words:
        hint = "; the / before it has closed the group" if after_group and tree.data == "group" \
            else "; expected a group such as &gear_pair first"
        report.add(words[0].place, f"{cut(words[0].text)} stands outside any group{hint}")


def _refuse_hash(word: Word, report: Report) -> bool:
    """Whether a word is a `#` comment; reports it."""
    if word.kind == "HASH":
        report.add(word.place, "# begins no comment in a deck; ! does")
    return word.kind == "HASH"


def _lower(name: str) -> str:
    """Lower case of a name; letters beyond ASCII stay, as some have an ASCII letter below."""
    return name.lower() if name.isascii() else name
