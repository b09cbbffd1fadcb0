"""Read a deck: syntax, schema, cross checks; every problem is found before any is raised."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pydantic import ValidationError

from lapwing.base import arguments
from lapwing.base.messages import cut, nearest
from lapwing.deck import schema
from lapwing.deck.checks import assemble as checks
from lapwing.deck.checks import hints
from lapwing.deck.parser import Entry, Group, excess_of, lex_value, parse, read_deck
from lapwing.deck.problems import DeckError, Place, Report
from lapwing.deck.values import (
    Bare,
    Value,
    decimal_comma,
    number_and_rest,
    read_values,
    suspicious_pairs,
    thousands,
)

if TYPE_CHECKING:
    from lapwing.deck.deck import Deck
    from lapwing.deck.declare import KeyType

# Tokens that no value consists of.
_NO_VALUE = ("OPEN", "CLOSE", "KEY", "EQUALS", "HASH")


@arguments.complete()
def load_deck(path: Any, overrides: Any = ()) -> Deck:
    """Read and check a deck.

    Parameters
    ----------
    path : str or Path
    overrides : sequence of (key, value text), such as ("operation.brake_torque", "2"), or a single
        one; keys of &response and &sweep are named response.NAME.key and sweep.NAME.key

    Returns
    -------
    Deck

    Raises
    ------
    DeckError
        with every problem of the deck, of the overrides and of the file of the transmission error.
    TypeError
        where an argument is of another kind.
    """
    if not isinstance(path, str | os.PathLike):
        raise TypeError(arguments.wrong("path", path, "text or os.PathLike"))
    overrides = _pairs(overrides)
    report = Report()
    text = read_deck(path, report)
    if text is None:
        raise DeckError(report.errors)
    groups = _known_groups(parse(text, str(path), report), report)
    for name, value in overrides:
        _override(groups, name, value, report)
    read = [_GroupReader(group, report) for group in groups]
    deck = checks.assemble(Path(path), text, overrides, read, report)
    if report.refusals or deck is None:
        raise DeckError(report.errors)
    return deck


def _pairs(overrides: Any) -> tuple[tuple[str, str], ...]:
    """Overrides as pairs of text; a single pair is a list of one."""
    if isinstance(overrides, tuple | list) and _is_pair(overrides):
        overrides = [overrides]
    expected = "a sequence of (key, value text)"
    try:
        pairs = None if isinstance(overrides, str | bytes | dict) \
            else tuple(tuple(pair) for pair in overrides)
    except TypeError:
        pairs = None
    if pairs is None or not all(map(_is_pair, pairs)):
        raise TypeError(arguments.wrong("overrides", overrides, expected))
    return pairs


def _is_pair(pair: Sequence[Any]) -> bool:
    return len(pair) == 2 and all(isinstance(one, str) for one in pair)


def _known_groups(groups: list[Group], report: Report) -> list[Group]:
    """Groups the schema knows, a model group once."""
    known: list[Group] = []
    seen: dict[str, int] = {}
    for group in groups:
        if group.name not in schema.GROUPS:
            report.add(group.place,
                       f"unknown group &{group.name}; {nearest(group.name, schema.GROUPS)}")
        elif group.name in seen and group.name not in schema.REPEATED:
            report.add(group.place, f"&{group.name} is given twice (first on line "
                                    f"{seen[group.name]}); expected once")
        else:
            seen.setdefault(group.name, group.place.line)
            known.append(group)
    return known


def _override(groups: list[Group], name: str, value: str, report: Report) -> None:
    """Put one override into its group."""
    source = f"--set {name}={value}"
    source = source if source.isprintable() else ascii(source)
    place = Place(cut(source, 200))
    group_name, _, rest = name.strip().lower().partition(".")
    study, _, key = rest.rpartition(".")
    if group_name not in schema.GROUPS or not key:
        report.add(place, "expected group.key, or response.NAME.key; "
                          + nearest(group_name, schema.GROUPS))
        return
    group = _overridden(groups, group_name, study, place, report)
    if group is None:
        return
    if key in group.entries and group.entries[key].override is not None:
        report.add(place, f"{name} is given twice on the command line")
        return
    excess = excess_of(value)
    if excess:
        report.add(place, excess[1])
        return
    words = lex_value(value, place.file)
    if not value.isprintable() or any(word.kind in _NO_VALUE for word in words):
        report.add(place, f"{cut(value)!r} is no value")
        return
    group.entries[key] = Entry(key, place, words, override=value)


def _overridden(groups: list[Group], name: str, study: str, place: Place,
                report: Report) -> Group | None:
    """The group that an override means; a model group is made where the deck has none."""
    candidates = [group for group in groups if group.name == name]
    if name not in schema.REPEATED:
        if study:
            report.add(place, f"&{name} is no study; expected {name}.key")
            return None
        if not candidates:
            candidates = [Group(name, place)]
            groups.append(candidates[0])
        return candidates[0]
    named = {_name_of(group): group for group in candidates}
    if study in named or (not study and len(candidates) == 1):
        return named.get(study, candidates[0])
    report.add(place, f"which &{name}? expected {name}.NAME.key with one of "
                      + (", ".join(filter(None, named)) or "none in this deck"))
    return None


def _name_of(group: Group) -> str:
    entry = group.entries.get(schema.GROUPS[group.name].named_by)
    return entry.words[0].text[1:-1].lower() if entry and entry.words else ""


class _GroupReader:
    """One group against its schema.

    Attributes
    ----------
    name : str
    place : Place
    places : dict, key -> Place of its value
    item_places : dict, key -> Place of each of its values
    overridden : dict, key -> override text
    keys : model instance of the schema, or None where something is refused
    """

    def __init__(self, group: Group, report: Report) -> None:
        self.name, self.place = group.name, group.place
        self.places: dict[str, Place] = {}
        self.item_places: dict[str, list[Place]] = {}
        self.key_places: dict[str, Place] = {}
        self.overridden: dict[str, str] = {}
        self._report = report
        self._values: dict[str, list[Value]] = {}
        model = schema.GROUPS[group.name]
        self._fields = schema.fields(model)
        self._types = {key: schema.KeyType(field) for key, field in self._fields.items()}
        known = report.refusals
        raw = {key: value for entry in group.entries.values()
               for key, value in self._read(entry)}
        self._check_exclusive(model)
        self.keys = self._validate(model, raw)
        if report.refusals > known:
            self.keys = None

    def _read(self, entry: Entry) -> Iterator[tuple[str, Any]]:
        """At most one (key, raw value) for the schema."""
        self.key_places[entry.key] = self.places[entry.key] = entry.place
        if entry.override is not None:
            self.overridden[entry.key] = entry.override
        if entry.key not in self._fields:
            homes = [name for name, group in schema.GROUPS.items()
                     if entry.key in schema.fields(group)]
            hint = hints.of_key(entry.key, self._fields) or (
                f"it belongs to &{homes[0]}" if homes else nearest(entry.key, self._fields))
            self._report.add(entry.place, f"unknown key {cut(entry.key)} in &{self.name}; {hint}")
            return
        values = read_values(entry, self._report)
        if values is None:
            return
        kind = self._types[entry.key]
        if entry.override is not None:
            values = [_quoted(value, kind) for value in values]
        self.places[entry.key] = values[0].place
        self.item_places[entry.key] = [value.place for value in values]
        self._values[entry.key] = values
        if kind.is_list:
            self._warn_of_commas(entry.key, values, kind)
            yield entry.key, [value.value for value in values]
        elif len(values) == 1:
            yield entry.key, values[0].value
        else:
            self._refuse_several(entry.key, values, kind)

    def _refuse_several(self, key: str, values: list[Value], kind: KeyType) -> None:
        source = ", ".join(cut(value.text) for value in values[:4])
        numeric = kind.kind in (float, int)
        place, whole = values[0].place, thousands(values) if numeric else None
        comma = decimal_comma(values) if len(values) == 2 and kind.kind is float else None
        if comma:
            text = (f"{key} = {values[0].text},{values[1].text}: decimal comma; write {comma}"
                    + f", or {whole} if thousands are meant" * bool(whole))
        elif numeric and [isinstance(value.value, Bare) for value in values[:2]] == [False, True]:
            first, rest = values[0].text, " ".join(value.text for value in values[1:9])
            place = values[1].place
            text = f"{key} = {cut(first)} {cut(rest)}: {_after_number(first, rest, kind)}"
        else:
            text = (f"{key} = {source}: several values, expected {kind.expected}"
                    + f"; write {whole} if thousands are meant" * bool(whole)
                    + f"; {hints.of_parameters(',')}" * (key == "parameter"))
        self._report.add(place, text)

    def _warn_of_commas(self, key: str, values: list[Value], kind: KeyType) -> None:
        if kind.kind is not float:
            return
        for first, second in suspicious_pairs(values):
            whole = thousands([first, second])
            self._report.add(first.place, f"{key}: {first.text},{second.text} is read as the two "
                             f"numbers {first.text} and {second.text}; if a decimal comma was "
                             f"meant, write {first.text}.{second.text}"
                             + f", if thousands, {whole}" * bool(whole), warning=True)

    def _check_exclusive(self, model: Any) -> None:
        for names in model.exclusive:
            given = [key for key in names if key in self.places]
            if len(given) > 1:
                last = max(given, key=lambda key: (self.key_places[key].line == 0,
                                                   self.key_places[key].line,
                                                   self.key_places[key].column))
                both = "both" if len(given) == 2 else "all"
                self._report.add(self.key_places[last],
                                 f"{' and '.join(given)} are {both} given; "
                                 f"expected one of {', '.join(names)}")
            elif model.needed and not any(map(self.mentioned, names)):
                self._report.add(self.place, f"&{self.name} lacks one of {', '.join(names)}")

    def mentioned(self, key: str) -> bool:
        """Whether a key is given, or meant by something that is refused already."""
        unknown = [name for name in self.key_places if name not in self._fields]
        stray = [value.text.lower() for values in self._values.values() for value in values
                 if isinstance(value.value, Bare)]
        return key in self.places or key in stray or any(
            name.startswith(key) or nearest(name, self._fields) == f"did you mean {key!r}?"
            for name in unknown)

    def _validate(self, model: Any, raw: dict[str, Any]) -> Any:
        try:
            return model.model_validate(raw)
        except ValidationError as error:
            for item in error.errors(include_url=False, include_context=False,
                                     include_input=False):
                self._translate(item)
            return None

    def _translate(self, item: Any) -> None:
        """One refusal of the schema in the deck's words, at the value refused."""
        key = item["loc"][0]
        if item["type"] == "missing":
            if key not in self.places:
                kind = self._types[key]
                self._report.add(self.place, f"&{self.name} lacks {key}, {kind.expected} "
                                             f"({self._fields[key].description.split(';')[0]})")
            return
        values = self._values[key]
        kind = self._types[key]
        if item["type"] in ("too_long", "too_short"):
            self._report.add(values[0].place, f"{key} has {len(values)} values; "
                                              f"expected {self._number_of_values(key)}")
            return
        index = item["loc"][1] if len(item["loc"]) > 1 else 0
        value = values[index]
        remark = value.remark or _remark(value, kind)
        wrong = f"expected {kind.expected}" + f"; {remark}" * bool(remark)
        if kind.kind is str and not kind.choices and isinstance(value.value, str):
            wrong = _text_limits(value.value, self._fields[key])
        self._report.add(value.place, f"{key} = {cut(value.text, 60)}, {wrong}")

    def _number_of_values(self, key: Any) -> str:
        """How many values a list takes."""
        least, most = (next((getattr(one, name) for one in self._fields[key].metadata
                             if hasattr(one, name)), None) for name in ("min_length", "max_length"))
        return f"at most {most}" if least != most else f"{most}"


def _quoted(value: Value, kind: KeyType) -> Value:
    """An override may leave out the quotes, which a shell takes away."""
    if kind.kind is str and not isinstance(value.value, str) and value.remark.find("quote") < 0:
        return Value(value.text, repr(value.text), value.place, value.start, value.end)
    return value


def _remark(value: Value, kind: KeyType) -> str:
    """A guess at what was meant."""
    if hints.of_quotes(value.text):
        return hints.of_quotes(value.text)
    if kind.kind is str and isinstance(value.value, Bare | bool):
        return f"text goes in quotes: '{cut(value.text)}'"
    if kind.choices and isinstance(value.value, str):
        guess = nearest(value.value, kind.choices)
        return guess if guess.endswith("?") else ""
    if kind.kind in (int, float) and isinstance(value.value, str):
        return "a number stands without quotes"
    parts = number_and_rest(value.text)
    if kind.kind in (int, float) and isinstance(value.value, Bare) and parts:
        return _after_number(*parts, kind)
    return ""


def _after_number(number: str, rest: str, kind: KeyType) -> str:
    """What to write for `9 kN`: only where the text is the key's own unit does the number stand."""
    if kind.unit and rest.strip() == kind.unit:
        return f"text after a number; the unit is fixed ({kind.unit}), write {cut(number)} alone"
    if not kind.unit:
        return "text after a number; this key has no unit, expected a number alone"
    unit = f"the unit {kind.unit}" if kind.unit.startswith("of ") else kind.unit
    return f"text after a number; give the value in {unit}, without a unit"


def _text_limits(text: str, field: Any) -> str:
    """What is wrong with a text that the schema refuses."""
    limits = {name: getattr(item, name) for item in field.metadata
              for name in ("max_length", "pattern") if getattr(item, name, None)}
    if not text:
        return "empty text is not allowed"
    if len(text) > limits.get("max_length", len(text)):
        return f"expected at most {limits['max_length']} characters"
    blank = "a blank is not allowed; " * any(letter.isspace() for letter in text)
    return blank + "letters, digits, . _ - only" + ", a letter or digit first" * (not blank)
