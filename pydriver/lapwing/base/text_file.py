"""Text files that come from outside, and the numbers in them: read once, for decks and tables."""

from __future__ import annotations

import errno
import math
import os
import re
import stat
from typing import Any

_BYTE_ORDER_MARKS = ((b"\xff\xfe", "utf-16"), (b"\xfe\xff", "utf-16"))
_KINDS = ((stat.S_ISDIR, "a folder"), (stat.S_ISFIFO, "a named pipe"),
          (stat.S_ISSOCK, "a socket"), (stat.S_ISCHR, "a device"), (stat.S_ISBLK, "a device"))
_REASONS: dict[int, str | None] = {
    errno.ENOENT: "no such file", errno.ELOOP: "symbolic links that lead in a circle",
    errno.EACCES: "no permission to read it"}
# ASCII digits only: `float` would also take 1_0 and the digits of other scripts.  No two parts of
# it can take the same digits: a long word that is no number must not be tried in all ways.
REAL = re.compile(r"[+-]?(?:[0-9]+(?:\.[0-9]*)?|\.[0-9]+)(?:[ed][+-]?[0-9]+)?", re.IGNORECASE)
_NOT_FINITE = re.compile(r"[+-]?(?:nan(?:\(.*\))?|inf(?:inity)?)", re.IGNORECASE)


class TextFileError(ValueError):
    """A file that is no text, or too long.

    Attributes
    ----------
    line, column : int, from 1; 0 where the whole file is concerned
    text : str, what is wrong and what is expected
    """

    def __init__(self, line: int, column: int, text: str) -> None:
        self.line, self.column, self.text = line, column, text
        super().__init__(text)


def read_text(path: str | os.PathLike[str], limit: int, reason: str) -> str:
    """Text of a file in UTF-8, or in UTF-16 with its mark; lines end with a newline.

    Parameters
    ----------
    path : str or Path
    limit : int, bytes
    reason : str, why more than that is refused

    Raises
    ------
    TextFileError
        Too long, not in one of the encodings, or with a NUL.
    OSError
        No file (its strerror says what it is instead), or one that cannot be read.
    ValueError
        The path is none.
    """
    try:
        data = _read_bytes(path, limit, reason)
    except OSError as error:
        words = _REASONS.get(error.errno or 0, error.strerror)
        raise OSError(error.errno, words) from error
    encoding = next((name for mark, name in _BYTE_ORDER_MARKS if data.startswith(mark)), "utf-8")
    try:
        text = data.decode(encoding)
    except UnicodeDecodeError as error:
        before = data[:error.start].decode(encoding, "ignore")
        raise _at(before, f"not {encoding.upper()} text, byte 0x{data[error.start]:02x}; "
                          "expected a file saved as UTF-8") from None
    text = text.lstrip("\ufeff").replace("\r\n", "\n").replace("\r", "\n")
    before, found, _ = text.partition("\0")
    if found:
        raise _at(before, "not text, byte 0x00; expected a file saved as UTF-8")
    return text


def _read_bytes(path: str | os.PathLike[str], limit: int, reason: str) -> bytes:
    """All bytes of a regular file; nothing else is opened, and opening never waits."""
    _expect_file(os.stat(path))
    descriptor = os.open(path, os.O_RDONLY | getattr(os, "O_NONBLOCK", 0)
                         | getattr(os, "O_BINARY", 0))
    with os.fdopen(descriptor, "rb") as stream:
        facts = os.fstat(stream.fileno())
        _expect_file(facts)
        data = stream.read(limit + 1) if facts.st_size <= limit else b""
    size = max(facts.st_size, len(data))
    if size > limit:
        raise TextFileError(0, 0, f"{size} bytes; expected at most {limit}: {reason}")
    return data


def _expect_file(facts: Any) -> None:
    if not stat.S_ISREG(facts.st_mode):
        kind = next((name for test, name in _KINDS if test(facts.st_mode)), "no regular file")
        raise OSError(errno.EINVAL, f"{kind}; expected a file")


def _at(before: str, text: str) -> TextFileError:
    """The error behind the text `before`, whatever ends its lines."""
    before = before.lstrip("\ufeff").replace("\r\n", "\n").replace("\r", "\n")
    return TextFileError(before.count("\n") + 1, len(before) - before.rfind("\n"), text)


def decimal_number(text: str) -> tuple[float | None, str]:
    """Number of a text, or None and why it is none, as far as can be guessed.

    What double precision cannot hold is refused, not rounded away.
    """
    if not REAL.fullmatch(text):
        if _NOT_FINITE.fullmatch(text):
            return None, "NaN and infinity are refused"
        return None, "the minus sign is not the one of the keyboard" * ("\u2212" in text)
    number = float(text.lower().replace("d", "e"))
    if math.isinf(number):
        return None, "too large for double precision"
    if number == 0 and re.search("[1-9]", re.split("[ed]", text.lower())[0]):
        return None, "too small for double precision"
    return number, ""
