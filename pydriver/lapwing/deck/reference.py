"""The reference page of the deck, docs/deck.md: `python -m lapwing.deck.reference > docs/deck.md`.

Rules and examples are in page.md beside this file; the tables come from the schema.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

from lapwing.deck import schema
from lapwing.deck.used import spell

_TYPES = {int: "whole number", float: "number", bool: "logical", str: "text"}


def reference_page() -> str:
    """The whole page, Markdown."""
    page = Path(__file__).with_name("page.md").read_text(encoding="utf-8")
    tables = "\n".join(_section(name, group) for name, group in schema.GROUPS.items())
    swept = ", ".join(f"`{name}`" for name in schema.parameter_words())
    return page.replace("<!-- tables -->\n", tables).replace("<!-- swept -->", swept)


def _section(name: str, group: Any) -> str:
    how = "any number of times" if group.repeatable else \
        "required" if name in schema.REQUIRED else "once or not at all"
    lines = [f"### &{name}", "", f"{group.title[0].upper()}{group.title[1:]}. ({how})", ""]
    for names in group.exclusive:
        keys = ", ".join(f"`{key}`" for key in names)
        lines += [f"{'Exactly' if group.needed else 'At most'} one of {keys}.", ""]
    lines += ["| key | type | unit | range | default | meaning |", "|---|---|---|---|---|---|"]
    lines += [_row(group, key, field) for key, field in schema.fields(group).items()]
    return "\n".join(lines) + "\n"


def _row(group: Any, key: str, field: Any) -> str:
    kind = schema.KeyType(field)
    allowed = ", ".join(f"`'{choice}'`" for choice in kind.choices) or kind.range
    if field.is_required():
        default = "**required**"
    elif any(key in names for names in group.exclusive):
        default = "one of the set"
    else:
        default = "–" if field.default is None else f"`{spell(field.default, kind)}`"
    text = field.description.replace("|", "\\|")
    type_name = "list of " * kind.is_list + _TYPES[kind.kind] + "s" * kind.is_list
    return f"| `{key}` | {type_name} | {kind.unit} | {allowed} | {default} | {text} |"


if __name__ == "__main__":
    sys.stdout.reconfigure(  # type: ignore[union-attr]
        encoding="utf-8", newline="\n")
    sys.stdout.write(reference_page())
