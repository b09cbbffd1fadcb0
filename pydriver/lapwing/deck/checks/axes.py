"""What is varied, and its values: numbers, an amplitude of a series, or curves from files."""

from __future__ import annotations

from pathlib import PurePath
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from lapwing.base.messages import cut, nearest
from lapwing.base.quantities import CURVE, base_name, term
from lapwing.deck import schema
from lapwing.deck.checks.hints import of_parameters
from lapwing.deck.checks.ranges import range_values
from lapwing.deck.checks.te_table import file_table
from lapwing.deck.declare import FILES, parameter_name, parameter_text

if TYPE_CHECKING:
    from lapwing.deck.checks.assemble import Studies
    from lapwing.deck.checks.te_table import Table
    from lapwing.deck.load import _GroupReader
    from lapwing.deck.problems import Place, Report


class Axis(NamedTuple):
    """What a study varies.

    Attributes
    ----------
    name, group : str, the parameter, and where the deck has it
    values : array (n,), numbers that rise, or labels
    tables : dict of label -> Table; empty of numbers
    """

    name: str
    group: str
    values: NDArray[Any]
    tables: dict[str, Table]


def axis_of(builder: Studies, reader: Any, report: Report) -> Axis | None:
    """What a study varies and its values, checked, or None.

    Parameters
    ----------
    builder : Studies
    reader : of a group, or of one side of it, whose keys are those of a sweep
    report : Report
    """
    name = parameter_name(reader.keys.parameter)
    group = parameter_group(builder, reader, name, curves=True)
    name = name.rpartition(".")[2]
    if name == CURVE:
        if reader.keys.files is None:
            report.add(reader.places["parameter"], f"parameter = {parameter_text(name)!r} takes "
                       "files in place of numbers")
            return None
        tables = _tables(builder, reader, report)
        return None if tables is None else Axis(name, str(group), np.array(list(tables)), tables)
    for key in FILES:
        if key in reader.places:
            report.add(reader.key_places[key],
                       f"{key} goes with parameter = {parameter_text(CURVE)!r} only")
    if reader.keys.files is not None:
        return None
    values = range_values(reader, report)
    if group is None or values is None:
        return None
    builder.check_values(reader, name, group, values)
    return Axis(name, group, values, {})


def parameter_group(builder: Studies, reader: _GroupReader, name: str, place: Place | None = None,
                    word: str = "parameter", curves: bool = False) -> str | None:
    """Group of the parameter varied, or None.

    Parameters
    ----------
    builder : Studies
    reader : of the group that names it
    name : str, as `declare.parameter_name` has it
    place : Place or None, of the name; default: of the key `parameter`
    word : str, what `place` holds
    curves : bool, whether the transmission error itself may be varied
    """
    known = schema.numeric_parameters()
    group, _, bare = name.rpartition(".")
    key, report = base_name(bare), builder.report
    place = place or reader.places.get("parameter", reader.place)
    said = f"{word} = {parameter_text(name)!r}"
    if name == CURVE:
        if not curves:
            report.add(place, f"{said} is no number: &sweep and &map go along files, nothing else")
        return "transmission_error" if curves else None
    if key not in known or group not in ("", known[key]):
        names = schema.parameter_words()
        full = [*names, *(f"{home}.{one}" for one, home in names.items())]
        hint = of_parameters(name) or nearest(name, full if group else names)
        report.add(place, f"{said} is no real number of &gear_pair or &operation; {hint}")
        return None
    for reader_name, model in {**builder.models, reader.name: reader}.items():
        for names in schema.GROUPS[reader_name].exclusive:
            others = [one for one in names if one != key and one in model.places]
            if key in names and others:
                report.add(place, f"{said}, but &{reader_name} gives {others[0]}; vary that, or "
                                  f"give {key} instead")
                return None
    problem = _curve_problem(builder, bare)
    if problem:
        report.add(place, f"{said} {problem}")
        return None
    return known[key]


def _curve_problem(builder: Studies, name: str) -> str:
    """Why the transmission error of a deck has no such number; empty text where it has."""
    keys = builder.curve
    if keys is None:  # refused already
        return ""
    if name == "parabola_amplitude" and not keys.parabola_amplitude:
        return "goes with a parabola_amplitude in &transmission_error that is not 0"
    if base_name(name) != "harmonic_amplitude":
        return ""
    count = len(keys.harmonic_amplitude or ())
    if not count:
        return "goes with harmonic_amplitude in &transmission_error"
    if not 1 <= (term(name) or 0) <= count:
        ends = " to ".join(parameter_text(f"harmonic_amplitude_{one}") for one in {1: 0, count: 0})
        return f"is no amplitude of &transmission_error, which gives {count}; expected {ends}"
    return ""


def _tables(builder: Studies, reader: Any, report: Report) -> dict[str, Table] | None:
    """Curves by label, in their order, or None."""
    files, labels, known = reader.keys.files, reader.keys.labels, builder.report.refusals
    names = labels or [PurePath(file).stem for file in files]
    if len(names) != len(files):
        report.add(reader.places["labels"], f"labels has {len(names)} values, files has "
                                            f"{len(files)}; expected as many")
        return None
    places = reader.item_places["labels" if labels else "files"]
    for i, name in enumerate(names):
        if not name.strip() or not name.isprintable():
            report.add(places[i], f"{cut(name)!r} is no label; expected text that can be read")
        elif name in names[:i]:
            report.add(places[i], f"two curves are labelled {cut(name)!r}, expected each label "
                                  "once" + "; give labels" * (not labels))
    tables = [file_table(file, builder.folder, builder.teeth, builder.fit, place, report, "files")
              for file, place in zip(files, reader.item_places["files"], strict=True)]
    if builder.report.refusals > known:
        return None
    return {name: table for name, table in zip(names, tables, strict=True) if table is not None}


__all__ = ["Axis", "axis_of", "parameter_group"]
