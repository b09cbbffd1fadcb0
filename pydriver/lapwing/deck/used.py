"""What a run really used: the deck written out in full, its hash, and how two decks differ."""

from __future__ import annotations

import hashlib
import json
import os
import re
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

from lapwing.base.messages import cut, printable
from lapwing.deck import schema

if TYPE_CHECKING:
    from lapwing.deck.deck import Asked, Deck
    from lapwing.deck.declare import KeyType

# Keys that name a file, relative to the deck.
_FILES = (("transmission_error", "file"), ("ensemble", "table"), ("sweep", "files"),
          ("map", "x_files"), ("map", "y_files"))
_HASH = re.compile(r"^! hash ([0-9a-f]{64})$", re.MULTILINE)


def used_text(deck: Deck, folder: Path | None = None) -> str:
    """Every value a deck leads to, as a deck that reads back to the same values.

    Parameters
    ----------
    deck : Deck
    folder : str or Path or None
        where the text will be stored; the file of the transmission error is then named relative to
        it, else by its absolute path

    Returns
    -------
    str; defaults are marked `! default`, overrides `! --set`; version and hash stand at the top
    """
    from lapwing import __version__

    name = printable(deck.path.name)
    lines = [f"! Every value used by {name}; those it does not give are marked default.",
             f"! lapwing {__version__}", f"! hash {used_hash(deck)}",
             f"! transmission error {deck.te_table.digest}"]
    lines += [f"! --set {name}={value}" for name, value in deck.overrides]
    for group, keys, values in _groups(deck):
        lines += ["", f"&{group}"]
        for name, field in schema.fields(schema.GROUPS[group]).items():
            lines += _line(deck, group, keys, name, field, values.get(name), folder)
        lines.append("/")
    return "\n".join(lines) + "\n"


def used_hash(deck: Deck) -> str:
    """SHA-256 (hex) of the values used: order, comments and spelling do not enter.

    The transmission error enters by its numbers, not by the place of its file.
    """
    text = json.dumps(canonical(deck), sort_keys=True, ensure_ascii=True)
    return hashlib.sha256(text.encode()).hexdigest()


def stored_hash(text: str) -> str | None:
    """Hash that a `used_text` states, or None."""
    found = _HASH.search(text)
    return found[1] if found else None


def changed_keys(old: Deck, new: Deck) -> tuple[str, ...]:
    """How two decks differ, one line per key: `operation.brake_torque: 1.0 -> 2.0`."""
    was, now = canonical(old), canonical(new)
    lines = []
    for group in dict.fromkeys([*was, *now]):
        before, after = was.get(group, {}), now.get(group, {})
        if before == after:
            continue
        if not before or not after:
            lines.append(f"{group}: {'added' if after else 'removed'}")
            continue
        for key in dict.fromkeys([*before, *after]):
            values = [side.get(key, "not given") for side in (before, after)]
            if values[0] != values[1]:
                lines.append(f"{group}.{key}: {_brief(values[0])} -> {_brief(values[1])}")
    return tuple(lines)


def canonical(deck: Deck) -> dict[str, dict[str, Any]]:
    """Values used as plain numbers and texts, by group (studies: group.name) and key."""
    result = {}
    for group, keys, values in _groups(deck):
        values = {name: _plain(value, schema.KeyType(schema.fields(type(keys))[name]))
                  for name, value in values.items() if value is not None}
        if group == "numerics":  # each study has its own
            values.pop("rtol", None)
        elif group == "transmission_error":
            values = {"table": deck.te_table.digest, "te_sign": values["te_sign"],
                      **{key: value for key, value in deck.te_table.fit.items()
                         if value is not None}, **_smoothing(deck)}
        elif group in schema.STUDIES:
            asked = next(one for one in deck.studies[group] if one.name == keys.name)
            values.pop("figures", None)  # no result depends on what is drawn of it
            values = keys.canonical(values, asked)
        name = f"{group}.{keys.own_name}" if group in schema.REPEATED else group
        result[name] = values
    return dict(sorted(result.items()))


def _smoothing(deck: Deck) -> dict[str, bool]:
    """Whether a smoothing spline is fitted, where one is."""
    fit = deck.te_table.fit
    return {"smoothing": True} if fit and fit["harmonics"] is None else {}


def _groups(deck: Deck) -> Iterator[tuple[str, Any, dict[str, Any]]]:
    """(group, keys as given, value of each key as used) in the order of the schema."""
    for group in schema.GROUPS:
        given = deck.settings[group] if group in schema.REPEATED else [deck.settings[group]]
        built = deck.studies[group] if group in schema.STUDIES else [None] * len(given)
        for keys, study in zip(given, built, strict=True):
            yield group, keys, _used(deck, group, keys, study)


def _used(deck: Deck, group: str, keys: Any, study: Asked | None) -> dict[str, Any]:
    """Key -> value as used, None where a key has none."""
    if group in schema.STUDIES:
        used: dict[str, Any] = keys.used(study)
        return used
    values: dict[str, Any] = keys.model_dump(by_alias=True)
    if group == "transmission_error" and keys.harmonic_amplitude is not None:
        values |= {"harmonic_shift": deck.te_table.keys["harmonic_shift"],
                   "harmonic_order": [int(n) for n in deck.te_table.keys["harmonic_order"]]}
    return values


def _line(deck: Deck, group: str, keys: Any, name: str, field: Any, value: Any,
          folder: Path | None) -> list[str]:
    """The line of one key: commented out where it has no value."""
    if value is None:
        left_out = (field.description or "").partition("left out: ")[2]
        if not left_out or group in schema.REPEATED:
            return []
        return [f"  ! {name}: left out, {left_out}"]
    kind = schema.KeyType(field)
    if (group, name) in _FILES:
        value = _moved(deck, value, folder) if isinstance(value, str) else [
            _moved(deck, one, folder) for one in value]
    if _overridden(deck, group, keys, name):
        mark = "  ! --set"
    else:
        inner = "from_" if name == "from" else name
        mark = "" if inner in keys.model_fields_set else "  ! default"
    return [f"  {name} = {spell(value, kind)}{mark}"]


def _moved(deck: Deck, name: str, folder: Path | None) -> str:
    """A file that a deck names, as a deck in another folder names it; None: by its whole path."""
    path = Path(deck.path.parent, name).absolute()
    return os.path.relpath(path, Path(folder).absolute()) if folder else str(path)


def _overridden(deck: Deck, group: str, keys: Any, name: str) -> bool:
    named = [f"{group}.{name}"]
    if group in schema.REPEATED:
        named.append(f"{group}.{keys.own_name}.{name}".lower())
    return any(key.strip().lower() in named for key, _ in deck.overrides)


def spell(value: Any, kind: KeyType) -> str:
    """A value as a deck spells it; numbers read back to the same bits."""
    if isinstance(value, list | tuple):
        return ", ".join(spell(one, kind) for one in value)
    if kind.kind is bool:
        return ".true." if value else ".false."
    if kind.kind is str:
        return "'" + str(value).replace("'", "''") + "'"
    return repr(_plain(value, kind))


def _plain(value: Any, kind: KeyType) -> Any:
    """A number as the kind of its key, whatever way it was written; -0.0 is 0.0."""
    if isinstance(value, list | tuple):
        return [_plain(one, kind) for one in value]
    return float(value) + 0.0 if kind.kind is float else value


def _brief(value: Any) -> str:
    return cut(repr(value), 60)
