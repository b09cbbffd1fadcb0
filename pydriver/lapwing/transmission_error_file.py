"""Read the CSV table behind a transmission error: columns, units, and every fault at once."""

from __future__ import annotations

import difflib
import math
from pathlib import Path

import numpy as np

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
# Rows with the same wrong number of fields that are reported one by one.
_FEW_ROWS = 3


class TransmissionErrorFileError(ValueError):
    """Everything wrong with one transmission-error file.

    Attributes
    ----------
    problems : tuple of (line, column, message)
        1-based line and column (field) numbers, 0 where the whole file or line is meant.
    """

    def __init__(self, path, problems):
        self.path, self.problems = Path(path), tuple(sorted(problems))
        super().__init__("\n".join(
            f"{path}, line {line}" * bool(line) + f"{path}" * (not line)
            + f", column {column}" * bool(column) + f": {message}"
            for line, column, message in self.problems))


def read_columns(path, pinion_teeth, gear_teeth):
    """Columns (name -> array in table units, canonical order) and problems of one file."""
    with open(path, encoding="utf-8-sig", errors="replace") as stream:
        texts = [text.partition("#")[0] for text in stream]
    lines = [(number, [field.strip() for field in text.split(",")])
             for number, text in enumerate(texts, 1) if text.strip()]
    if len(lines) < 2:
        return {}, [(0, 0, "no data: a header that names the columns and rows of numbers are "
                           f"meant, for example {_LAYOUTS[2]!r}")]
    (line, header), *rows = lines
    separator = next((name for mark, name in ((";", "';'"), ("\t", "a tab"))
                      if any(mark in field for field in header)), None)
    if separator:
        return {}, [(line, 0, f"the separator is {separator}, a comma is meant (and a point, not a "
                              "comma, in numbers)")]
    problems = []
    columns = _read_header(line, header, pinion_teeth, gear_teeth, problems)
    if columns is None:
        return {}, problems
    values = [_read_row(line, fields, columns, problems) for line, fields in rows]
    _check_widths(rows, len(columns), problems)
    _check_order([line for line, _ in rows], values, columns, problems)
    named = {name: [row[i] * factor for row in values]
             for i, (name, factor) in enumerate(columns) if not problems}
    return {name: np.array(named[name]) for name in _COLUMNS if name in named}, problems


def _read_header(line, header, pinion_teeth, gear_teeth, problems):
    """(name, factor to table units) of each column, or None where there is no header at all."""
    if _number(header[0]) is not None:
        problems.append((line, 1, "numbers where the header is meant: name the columns first, "
                                  f"for example {_LAYOUTS[2]!r}"))
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
        problems.append((line, 0, f"the columns {','.join(names)} make no table; meant is one of "
                                  + "; ".join(_LAYOUTS)))
    if "gear_angle" in names and not (pinion_teeth and gear_teeth):
        problems.append((line, 0, "angle pairs need pinion_teeth and gear_teeth"))
    return columns


def _read_column(field, pinion_teeth):
    """Name and factor to table units of one header field such as `slope[urad]`."""
    name, _, unit = (part.strip() for part in field.rstrip("] ").partition("["))
    if name not in _COLUMNS:
        guess = difflib.get_close_matches(name, _COLUMNS, 1)
        meant = f"is {guess[0]!r} meant?" if guess else f"meant is one of {', '.join(_COLUMNS)}"
        raise ValueError(f"unknown column {name!r}; {meant}")
    if not unit:
        return name, 1.0
    teeth = pinion_teeth or math.nan
    units = {"phase": {"periods": 1.0, "rad": teeth / (2 * math.pi), "deg": teeth / 360},
             "kink": {}}.get(name, ANGLE_UNITS)
    factor = units.get((unit.removesuffix("/period") if "slope" in name else unit)
                       .translate(_MICRO))
    if factor is None:
        raise ValueError(f"{name} has no unit {unit!r}; meant is one of "
                         + (", ".join(units) or "0 and 1 without unit"))
    if math.isnan(factor):
        raise ValueError(f"{name}[{unit}], pinion rotation, needs pinion_teeth")
    return name, factor


def _read_row(line, fields, columns, problems):
    """Numbers of one row (nan where there is none), in the file's units."""
    if len(fields) != len(columns):
        return [math.nan] * len(columns)
    values = [_number(field) for field in fields]
    for column, (value, (name, _)) in enumerate(zip(values, columns, strict=True), 1):
        if value is None or not math.isfinite(value):
            problems.append((line, column, f"{name} is {fields[column - 1]!r}; a finite number "
                                           "is meant"))
        elif name == "kink" and value not in (0, 1):
            problems.append((line, column, f"kink is {value:g}; 0 or 1 is meant"))
    return [math.nan if value is None else value for value in values]


def _check_widths(rows, width, problems):
    """Report rows with too few or too many fields; many of one kind are counted, not listed."""
    wrong = {}
    for line, fields in rows:
        if len(fields) != width:
            wrong.setdefault(len(fields), []).append(line)
    for count, lines in wrong.items():
        text = f"{count} field{'s' * (count != 1)} where {width} are named"
        text += "; are there decimal commas? A point is meant" * (count == 2 * width)
        more = len(lines) - _FEW_ROWS
        for line in lines[:_FEW_ROWS]:
            problems.append((line, 0, text))
        if more > 0:
            problems[-1] = (problems[-1][0], 0,
                            f"{text} (... and {more} more row{'s' * (more != 1)})")


def _check_order(lines, values, columns, problems):
    """Report rows whose phase or pinion angle is out of range or does not ascend."""
    for index, (name, factor) in enumerate(columns):
        if name not in ("phase", "pinion_angle"):
            continue
        previous = -math.inf
        for line, row in zip(lines, values, strict=True):
            at = row[index] * factor
            if name == "phase" and abs(at - 1) <= 1e-9:
                problems.append((line, index + 1, "this row repeats phase 0; leave it out"))
            elif name == "phase" and not 0 <= at < 1 and math.isfinite(at):
                problems.append((line, index + 1, f"phase is {at:g} periods; 0 <= phase < 1 is "
                                                  "meant"))
            if at <= previous:
                problems.append((line, index + 1, f"{name} must ascend from row to row"))
            previous = at if math.isfinite(at) else previous


def _number(text):
    try:
        return float(text)
    except ValueError:
        return None
