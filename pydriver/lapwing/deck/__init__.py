"""The deck: namelist text in, checked values and ready objects out."""

from __future__ import annotations

from importlib import import_module
from typing import Any

_HOMES = {
    "Asked": "deck", "Deck": "deck",
    "DeckError": "problems", "Problem": "problems",
    "changed_keys": "used", "stored_hash": "used", "used_hash": "used", "used_text": "used",
    "load_deck": "load",
    "reference_page": "reference",
    "template_text": "template",
}
__all__ = [*_HOMES]


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module 'lapwing.deck' has no attribute {name!r}")
    return getattr(import_module(f"lapwing.deck.{_HOMES[name]}"), name)


def __dir__() -> list[str]:
    return sorted(__all__)
