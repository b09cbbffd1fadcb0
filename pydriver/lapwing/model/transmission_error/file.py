"""Read the CSV table behind a transmission error: columns, units, and every fault at once."""

from __future__ import annotations

import csv
import difflib
import math
import os
import re
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lapwing.base.messages import bounded, cut
from lapwing.base.text_file import REAL, TextFileError, decimal_number, read_text

ANGLE_UNITS = {"rad": 1.0, "mrad": 1e-3, "urad": 1e-6, "deg": math.pi / 180,
               "arcmin": math.pi / 10_800, "arcsec": math.pi / 648_000}
_ANGLES = ("transmission_error", "slope", "slope_left", "slope_right", "pinion_angle",
           "gear_angle")
_COLUMNS = ("phase", *_ANGLES, "kink")
_LAYOUTS = ("phase,transmission_error", "phase,transmission_error,kink",
            "phase,transmission_error,slope", "phase,transmission_error,slope_left,slope_right",
            "pinion_angle,gear_angle")
# The micro sign and the Greek letter look alike; both are typed for u.
_MICRO = str.maketrans("\u00b5\u03bc", "uu")
MAX_BYTES, MAX_ROWS = 16_000_000, 100_000
_REASON = f"one mesh period needs no more, in {MAX_ROWS} rows"
_DECIMAL_COMMA = re.compile(r"[+-]?[0-9]+,[0-9]+(?:[ed][+-]?[0-9]+)?", re.IGNORECASE)

# Line and column (field) from 1, 0 where all of it is concerned; message.
Problem = tuple[int, int, str]


class TransmissionErrorFileError(ValueError):
    """Everything wrong with one transmission-error file.

    Attributes
    ----------
    problems : tuple of (line, column, message)
        1-based line and column (field) numbers, 0 where the whole file or line is concerned.
    """

    def __init__(self, path: str | os.PathLike[str], problems: list[Problem]) -> None:
        self.path, self.problems = Path(path), tuple(sorted(problems))
        super().__init__("\n".join(
            f"{path}, line {line}" * bool(line) + f"{path}" * (not line)
            + f", column {column}" * bool(column) + f": {message}"
            for line, column, message in self.problems))


def read_columns(path: str | os.PathLike[str], pinion_teeth: int | None,
                 gear_teeth: int | None) -> tuple[dict[str, NDArray[Any]], list[Problem]]:
    """Columns (name -> array in table units, canonical order) and problems of one file.

    Raises
    ------
    OSError, ValueError
        See `text_file.read_text`; a file that is no text is among the problems.
    """
    try:
        text = read_text(path, MAX_BYTES, _REASON)
    except TextFileError as error:
        return {}, [(error.line, error.column, error.text)]
    columns, problems = _columns(text, pinion_teeth, gear_teeth)
    return columns, bounded(sorted(problems), lambda problem: problem[2],
                            lambda problem, words: (*problem[:2], words))


def _columns(text: str, pinion_teeth: int | None,
             gear_teeth: int | None) -> tuple[dict[str, NDArray[Any]], list[Problem]]:
    problems: list[Problem] = []
    lines = rows_of(text, problems)
    if not lines and problems:
        return {}, problems
    if len(lines) < 2:
        return {}, [(0, 0, "no data; expected a header that names the columns, and rows of "
                           f"numbers, for example {_LAYOUTS[2]!r}")]
    (line, header), *rows = lines
    columns = _read_header(line, header, pinion_teeth, gear_teeth, problems)
    if columns is None:
        return {}, problems
    values = [_read_row(line, fields, columns, problems) for line, fields in rows]
    _check_decimal_commas(rows, problems)
    _check_widths(rows, len(columns), problems)
    _check_order([line for line, _ in rows], values, columns, problems)
    named = {name: [row[i] * factor for row in values]
             for i, (name, factor) in enumerate(columns) if not problems}
    return {name: np.array(named[name]) for name in _COLUMNS if name in named}, problems


def rows_of(text: str, problems: list[Problem],
            most: int = MAX_ROWS) -> list[tuple[int, list[str]]]:
    """(line, fields) of each row; empty rows at the end, as spreadsheets leave them, are none.

    What is wrong goes to `problems`; `most` is the number of rows below the header.
    """
    rows: list[tuple[int, list[str]]] = []
    for line, row in enumerate(text.split("\n"), 1):
        row = row.partition("#")[0]
        if not row.strip():
            continue
        if len(rows) > most:
            problems.append((line, 0, f"more rows than expected (at most {most})"))
            return []
        rows.append((line, _fields(line, row, problems)))
    while rows and rows[-1][1] and not any(rows[-1][1]):
        rows.pop()
    return rows


def _fields(line: int, row: str, problems: list[Problem]) -> list[str]:
    """Fields of one row without the blanks and quotes around them."""
    if '"' not in row:
        return [field.strip() for field in row.split(",")]
    if row.count('"') % 2:
        problems.append((line, 0, "the closing quote is missing on this line"))
    try:
        [fields] = csv.reader([row], skipinitialspace=True)
    except csv.Error:
        problems.append((line, 0, f"a field is longer than {csv.field_size_limit()} characters; "
                                  "expected a name or a number"))
        return []
    return [field.strip() for field in fields]


def _read_header(line: int, header: list[str], pinion_teeth: int | None, gear_teeth: int | None,
                 problems: list[Problem]) -> list[tuple[str, float]] | None:
    """(name, factor to table units) of each column, or None where there is no header at all."""
    wrong = _no_header(header)
    if wrong:
        problems.append((line, *wrong))
        return None
    columns, known = [], len(problems)
    for column, field in enumerate(header, 1):
        try:
            columns.append(_read_column(field, pinion_teeth))
        except ValueError as error:
            columns.append((field, 1.0))
            problems.append((line, column, str(error)))
    names = [name for name, _ in columns]
    if len(problems) == known and sorted(names) not in [sorted(x.split(",")) for x in _LAYOUTS]:
        hint = "for samples over the pinion's rotation name its column phase[deg] or phase[rad]" \
            if {"pinion_angle", "transmission_error"} <= set(names) else \
            "expected one of " + "; ".join(_LAYOUTS)
        problems.append((line, 0, f"the columns {cut(','.join(names), 200)} make no table; {hint}"))
    if "gear_angle" in names and not (pinion_teeth and gear_teeth):
        problems.append((line, 0, "angle pairs need pinion_teeth and gear_teeth"))
    return columns


def _no_header(header: list[str]) -> tuple[int, str] | None:
    """(column, what is wrong) of a row that cannot be a header, else None."""
    separator = next((name for mark, name in ((";", "';'"), ("\t", "a tab"))
                      if any(mark in field for field in header)), None)
    if header[0].lower().startswith("sep="):
        return 1, (f"{cut(','.join(header))!r} is no header; leave this row out, expected the "
                   f"names of the columns, for example {_LAYOUTS[2]!r}")
    if separator:
        return 0, (f"the separator is {separator}; expected a comma (and a point, not a comma, "
                   "in numbers)")
    if header and REAL.fullmatch(header[0]):
        return 1, ("numbers instead of the header; expected the names of the columns first, "
                   f"for example {_LAYOUTS[2]!r}")
    if len(header) > len(_COLUMNS):
        return 0, f"{len(header)} columns; expected one of {'; '.join(_LAYOUTS)}"
    return None


def _read_column(field: str, pinion_teeth: int | None) -> tuple[str, float]:
    """Name and factor to table units of one header field such as `slope[urad]`."""
    name, _, unit = (part.strip() for part in field.rstrip("] ").partition("["))
    if name not in _COLUMNS:
        guess = difflib.get_close_matches(cut(name), _COLUMNS, 1)
        expected = repr(guess[0]) if guess else "one of " + ", ".join(_COLUMNS)
        raise ValueError(f"unknown column {cut(name)!r}; expected {expected}")
    if not unit:
        return name, 1.0
    teeth = pinion_teeth or math.nan
    units = {"phase": {"periods": 1.0, "rad": teeth / (2 * math.pi), "deg": teeth / 360},
             "kink": {}}.get(name, ANGLE_UNITS)
    factor = units.get((unit.removesuffix("/period") if "slope" in name else unit)
                       .translate(_MICRO))
    if factor is None:
        raise ValueError(f"{name} has no unit {cut(unit)!r}; expected one of "
                         + (", ".join(units) or "0 and 1 without unit"))
    if math.isnan(factor):
        raise ValueError(f"{name}[{unit}], pinion rotation, needs pinion_teeth")
    return name, factor


def _read_row(line: int, fields: list[str], columns: list[tuple[str, float]],
              problems: list[Problem]) -> list[float]:
    """Numbers of one row (nan where there is none), in the file's units."""
    if len(fields) != len(columns):
        return [math.nan] * len(columns)
    if not any(fields):
        problems.append((line, 0, "an empty row between rows; expected numbers"))
        return [math.nan] * len(columns)
    values = []
    for column, (field, (name, _)) in enumerate(zip(fields, columns, strict=True), 1):
        value, remark = decimal_number(field)
        values.append(math.nan if value is None else value)
        if value is None and not _DECIMAL_COMMA.fullmatch(field):
            problems.append((line, column, f"{name} is {cut(field)!r}; expected a finite number"
                             + f": {remark}" * bool(remark)))
        elif name == "kink" and value not in (0, 1, None):
            problems.append((line, column, f"kink is {value:g}; expected 0 or 1"))
    return values


def _check_decimal_commas(rows: list[tuple[int, list[str]]],
                          problems: list[Problem]) -> None:
    """Report decimal commas in quoted fields once: who writes one writes them all so."""
    found = [(line, column, field) for line, fields in rows
             for column, field in enumerate(fields, 1) if _DECIMAL_COMMA.fullmatch(field)]
    if found:
        line, column, field = found[0]
        problems.append((line, column, f"decimal comma in {cut(field)!r}; expected a point"
                         + _and_more(len(found) - 1, "number")))


def _check_widths(rows: list[tuple[int, list[str]]], width: int,
                  problems: list[Problem]) -> None:
    """Report rows with too few or too many fields; those of one width once."""
    wrong: dict[int, list[tuple[int, list[str]]]] = {}
    for line, fields in rows:
        if len(fields) not in (width, 0):  # 0: refused already
            wrong.setdefault(len(fields), []).append((line, fields))
    for count, lines in wrong.items():
        line, fields = lines[0]
        text = f"{count} field{'s' * (count != 1)}; expected {width}, as the header names"
        text += "; decimal commas? A point is expected" * (count == 2 * width)
        text += "; the separator is ';', not a comma" * any(";" in field for field in fields)
        problems.append((line, 0, text + _and_more(len(lines) - 1, "row")))


def _check_order(lines: list[int], values: list[list[float]], columns: list[tuple[str, float]],
                 problems: list[Problem]) -> None:
    """Report rows whose phase or pinion angle is out of range or does not ascend."""
    for column, (name, factor) in enumerate(columns, 1):
        if name not in ("phase", "pinion_angle"):
            continue
        places = [(line, row[column - 1] * factor)
                  for line, row in zip(lines, values, strict=True)]
        if name == "phase":
            _check_range([place for place in places if math.isfinite(place[1])], column, problems)
        previous = -math.inf
        for line, at in places:
            if at <= previous:
                problems.append((line, column, f"{name} does not ascend; expected more than in "
                                               "the row before"))
            previous = at if math.isfinite(at) else previous


def _check_range(places: list[tuple[int, float]], column: int,
                 problems: list[Problem]) -> None:
    """Report phases outside the mesh period, once on either side of it."""
    below = [(line, at) for line, at in places if at < 0]
    above = [(line, at) for line, at in places if at >= 1 - 1e-9]
    for outside in filter(None, (below, above)):
        line, at = outside[0]
        if outside is above and len(above) == 1 and abs(at - 1) <= 1e-9:
            text = "this row repeats phase 0; leave it out"
        else:
            text = f"phase is {at:g} periods; expected 0 <= phase < 1, one mesh period"
            last = max(at for _, at in outside)
            text += f", where this table goes on to {last:.4g}" * (last >= 2)
        problems.append((line, column, text + _and_more(len(outside) - 1, "row")))


def _and_more(count: int, what: str) -> str:
    return f" (... and {count} more {what}{'s' * (count != 1)})" * (count > 0)
