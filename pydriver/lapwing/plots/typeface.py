"""The typeface of all figures: DejaVu Sans, less what no figure needs.

The font that comes with matplotlib has 6000 glyphs and tables for many scripts; cutting a subset
out of it for every PDF took a third of the drawing time.  So it is cut down once, kept beside
matplotlib's own caches, and taken from there.  Letters outside of it come from the whole font.
"""

from __future__ import annotations

import functools
import os
from pathlib import Path
from typing import Any

NAME = "Lapwing DejaVu Sans"
# Latin, Greek, punctuation, raised and lowered figures, arrows, mathematics, shapes.
RANGES = ((0x20, 0x7F), (0xA0, 0x180), (0x2C6, 0x2DE), (0x384, 0x3D7), (0x2010, 0x2028),
          (0x2030, 0x203B), (0x2070, 0x2095), (0x2190, 0x219A), (0x2200, 0x2266),
          (0x25A0, 0x25D0))
DROPPED = ["GSUB", "GPOS", "GDEF", "MATH", "FFTM"]


@functools.cache
def families() -> list[str]:
    """Names for `font.family`: the typeface, then the whole font; the first is made known."""
    from matplotlib import font_manager

    try:
        font_manager.fontManager.addfont(_file())
    except OSError:  # no place to keep it: the whole font serves as well, only more slowly
        return ["DejaVu Sans"]
    return [NAME, "DejaVu Sans"]


def readable(text: str) -> str:
    """A text whose letters the whole font has; others, as of other scripts, as escapes.

    Fonts of the system would draw them, but not the same everywhere.
    """
    if text.isascii():
        return text
    known = _letters()
    return "".join(one if one.isspace() or ord(one) in known else
                   one.encode("unicode_escape").decode() for one in text)


@functools.cache
def _letters() -> frozenset[int]:
    from matplotlib import font_manager
    from matplotlib.ft2font import FT2Font

    whole = font_manager.findfont("DejaVu Sans", fallback_to_default=False)
    return frozenset(FT2Font(str(whole)).get_charmap())


def _file() -> Path:
    """Path of the reduced font; made where it is missing."""
    import matplotlib

    path = (Path(matplotlib.get_cachedir())
            / f"lapwing-dejavu-sans-{matplotlib.__version__}-{_edition()}.ttf")
    if not path.exists():
        temporary = path.with_suffix(f".{os.getpid()}.tmp")
        try:
            _reduced().save(temporary)
            os.replace(temporary, path)
        finally:
            temporary.unlink(missing_ok=True)
    return path


def _edition() -> str:
    """A short name for the choice of glyphs and tables, so that another choice is another file."""
    from hashlib import sha256

    return sha256(repr((NAME, RANGES, DROPPED)).encode()).hexdigest()[:8]


def _reduced() -> Any:
    """The font with the glyphs of `RANGES` alone, under its own name; kerning is kept."""
    from fontTools import subset
    from matplotlib import font_manager

    options = subset.Options(legacy_kern=True, layout_features=[], glyph_names=True,
                             notdef_outline=True)
    options.drop_tables += DROPPED
    whole = font_manager.findfont("DejaVu Sans", fallback_to_default=False)
    font = subset.load_font(str(whole), options)
    subsetter = subset.Subsetter(options)
    subsetter.populate(unicodes=[code for low, high in RANGES for code in range(low, high)])
    subsetter.subset(font)
    for record in font["name"].names:
        if record.nameID in (1, 4, 6):
            record.string = NAME.replace(" ", "") if record.nameID == 6 else NAME
    return font
