"""The compiled engine, loaded with short waits of its threads."""

from __future__ import annotations

from lapwing.base.threads import short_waits

with short_waits():
    from lapwing._engine import api

__all__ = ["api"]
