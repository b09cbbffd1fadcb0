"""The deck that `lapwing new` writes: every key with its meaning, made from the schema."""

from __future__ import annotations

import textwrap
from typing import Any

from lapwing.deck import schema
from lapwing.deck.used import spell

_HEAD = """\
! A deck for Lapwing: a gear pair, how it runs, and what to compute. `lapwing check` reads it,
! `lapwing run` runs it. Keys after an exclamation mark are optional; what stands there is the
! default, or an example where there is none. Numbers are in the unit given, without naming it.
! At the end stand groups for other questions: take their first exclamation marks away.
"""
# Of the keys that exclude each other, the ones the template uses; and what makes it a useful deck.
_CHOSEN = {"gear_pair": {"restitution", "damping_ratio"},
           "transmission_error": {"parabola_amplitude"},
           "operation": {"brake_torque", "pinion_speed_rpm"}}
_EXAMPLES = {"count": [70]}
# Studies of the deck as it stands; of the others, groups are written that ask for nothing yet.
_ASKED = ("response", "sweep", "critical")
_COLUMN, _WIDTH = 36, 58


def template_text() -> str:
    """A commented deck that loads as it stands."""
    asked = [group for group in schema.GROUPS
             if group in _ASKED or group not in schema.REPEATED]
    others = [group for group in schema.GROUPS if group not in asked]
    return _HEAD + "".join(map(_group, asked)) + "".join(
        textwrap.indent(_group(group), "! ", lambda line: line.strip() != "" and line[0] != "!")
        for group in others)


def _group(group: str) -> str:
    """A group with all of its keys."""
    model = schema.GROUPS[group]
    parts = [f"\n! {model.title[0].upper()}{model.title[1:]}.\n&{group}\n"]
    own = {name: field for name, field in schema.fields(model).items()
           if group == "operation" or name not in schema.OPERATION}
    for names in model.exclusive:
        if set(names) <= own.keys():
            parts.append(f"  ! One of {', '.join(names)}:\n")
    parts += [_entry(group, name, field) for name, field in own.items()]
    if group != "operation" and set(schema.OPERATION) <= schema.fields(model).keys():
        parts.append("  ! Any key of &operation may stand here as well and counts for this "
                     "group only.\n")
    parts.append("/\n")
    return "".join(parts)


def _chosen(group: str) -> Any:
    model: Any = schema.GROUPS[group]
    return model.chosen if group in schema.REPEATED else _CHOSEN.get(group, ())


def _entry(group: str, name: str, field: Any) -> str:
    kind = schema.KeyType(field)
    example = _EXAMPLES.get(name, (field.json_schema_extra or {}).get("example"))
    value = example if field.is_required() or field.default is None else field.default
    chosen = field.is_required() or name in _chosen(group)
    line = f"  {'' if chosen else '! '}{name} = {spell(value, kind)}"
    words = field.description + (f" [{kind.unit}]" if kind.unit else "")
    comments = textwrap.wrap(words, _WIDTH)
    if len(line) > _COLUMN:
        comments = ["", *comments]
    rows = [f"{line:<{_COLUMN}} ! {comments[0]}" if comments[0] else line]
    rows += [f"{'':<{_COLUMN}} ! {more}" for more in comments[1:]]
    return "\n".join(rows) + "\n"
