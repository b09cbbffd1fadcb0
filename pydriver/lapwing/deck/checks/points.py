"""The table of an ensemble: a row a run, columns named after deck keys."""

from __future__ import annotations

import hashlib
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from lapwing.base.messages import cut
from lapwing.base.text_file import TextFileError, decimal_number, read_text
from lapwing.deck.checks.drawn import clash, expected, out_of_range
from lapwing.deck.declare import parameter_name
from lapwing.deck.problems import Place
from lapwing.model.transmission_error.file import rows_of

if TYPE_CHECKING:
    from lapwing.deck.checks.assemble import Studies
    from lapwing.deck.load import _GroupReader

MAX_BYTES, MAX_ROWS = 64_000_000, 1_000_000


def table_points(name: str, builder: Studies, reader: _GroupReader,
                 ) -> tuple[dict[str, tuple[str, NDArray[np.float64]]], str] | None:
    """Values of each column, and their digest, or None; what is wrong goes to the report.

    Parameters
    ----------
    name : str, of the file, relative to the deck
    builder : Studies
    reader : _GroupReader, of the &ensemble that names it

    Returns
    -------
    parameter -> (its group, (n,) array); str, SHA-256 of the numbers
    """
    report, path, known = builder.report, Path(builder.folder, name), builder.report.refusals
    try:
        text = read_text(path, MAX_BYTES, f"at most {MAX_ROWS} rows are run")
    except TextFileError as error:
        report.add(Place(str(path), error.line, error.column), error.text)
        return None
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or error
        report.add(reader.places["table"], f"table = {cut(name, 100)!r} cannot be read: {reason}")
        return None
    problems: list[Any] = []
    rows = rows_of(text, problems, MAX_ROWS)
    for line, column, problem in problems:
        report.add(Place(str(path), line, column), problem)
    if report.refusals > known:
        return None
    if len(rows) < 2:
        report.add(Place(str(path)), "no data; expected a header that names keys of the deck, for "
                                     "example 'backlash,brake_torque', and rows of numbers")
        return None
    columns = _columns(path, *rows[0], builder, reader)
    values = _values(path, rows, builder)
    if report.refusals > known:
        return None
    points = {one: (group, values[:, i]) for i, (one, group) in enumerate(columns)}
    for i, (one, (group, column)) in enumerate(points.items(), 1):
        wrong = out_of_range(one, group, column)
        if wrong is not None:
            row = int(np.flatnonzero(column == wrong)[0]) + 1
            report.add(Place(str(path), rows[row][0], i), f"{one} = {wrong:g}, expected "
                                                          f"{expected(one, group)}")
    total = hashlib.sha256()
    for one, (_, column) in sorted(points.items()):
        total.update(f"{one}\0".encode() + (column + 0.0).astype("<f8").tobytes())
    return (points, total.hexdigest()) if report.refusals == known else None


def _columns(path: Path, line: int, header: list[str], builder: Studies,
             reader: _GroupReader) -> list[tuple[str, str]]:
    """(key, its group) of each column."""
    columns: list[tuple[str, str]] = []
    for i, field in enumerate(header, 1):
        name = parameter_name(field)
        place = Place(str(path), line, i)
        if decimal_number(name)[0] is not None:
            builder.report.add(place, f"{cut(field)} is a number; expected a header that names "
                                      "keys of the deck first")
            continue
        group = builder.parameter(reader, name, place, "column")
        bare = name.rpartition(".")[2]
        if group is None:
            continue
        problem = clash(bare, [one for one, _ in columns])
        if bare in [one for one, _ in columns]:
            builder.report.add(place, f"two columns of {bare}; expected one")
        elif problem:
            builder.report.add(place, problem)
        columns.append((bare, group))
    return columns


def _values(path: Path, rows: list[tuple[int, list[str]]],
            builder: Studies) -> NDArray[np.float64]:
    """Numbers of all rows, (n, columns)."""
    width = len(rows[0][1])
    values = np.zeros((len(rows) - 1, width))
    for i, (line, fields) in enumerate(rows[1:]):
        if len(fields) != width:
            builder.report.add(Place(str(path), line), f"{len(fields)} "
                               f"field{'s' * (len(fields) != 1)}; expected {width}, as the header "
                               "names")
            continue
        for j, field in enumerate(fields):
            number, remark = decimal_number(field)
            if number is None:
                builder.report.add(Place(str(path), line, j + 1),
                                   f"{cut(field)!r}; expected a finite number"
                                   + f": {remark}" * bool(remark))
            else:
                values[i, j] = number
    return values


__all__ = ["table_points"]
