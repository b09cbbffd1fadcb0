"""Values that are varied or drawn against the ranges of their keys, and against each other."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from lapwing.base.quantities import base_name
from lapwing.deck import schema
from lapwing.deck.declare import parameter_text

if TYPE_CHECKING:
    from lapwing.deck.checks.assemble import Studies
    from lapwing.deck.load import _GroupReader
    from lapwing.deck.problems import Report
    from lapwing.model.draw import Draw


def out_of_range(name: str, group: str, values: NDArray[Any]) -> float | None:
    """The least or the greatest value where the key of that name refuses it."""
    limits = schema.KeyType(schema.GROUPS[group].model_fields[base_name(name)]).limits
    return next((float(value) for value in (values.min(), values.max())
                 if value < limits.get("ge", value) or value > limits.get("le", value)
                 or value <= limits.get("gt", value - 1)
                 or value >= limits.get("lt", value + 1)), None)


def expected(name: str, group: str) -> str:
    """What a value of a key must be."""
    return schema.KeyType(schema.GROUPS[group].model_fields[base_name(name)]).expected.removeprefix(
        "each ")


def clash(name: str, others: Iterable[str]) -> str:
    """What is wrong where one of a set of which a deck gives one is varied beside another."""
    sets = [names for model in schema.GROUPS.values() for names in model.exclusive]
    for names in (*sets, ("te_scale", "parabola_amplitude")):
        both = [other for other in others if {other, name} <= set(names) and other != name]
        if both:
            return f"{name} and {both[0]} say the same; expected one of them"
    return ""


def check_drawn(builder: Studies, reader: _GroupReader, name: str, group: str,
                draw: Draw) -> None:
    """What can be drawn against the range of the parameter's own key, and the other draws."""
    wrong = out_of_range(name, group, np.array(draw.ends))
    if wrong is not None:
        end = "low" if wrong == draw.ends[0] else "high"
        given = end in reader.places
        builder.report.add(
            reader.places[end] if given else reader.place,
            f"&draw of {parameter_text(name)}: values {'down' if end == 'low' else 'up'} to "
            f"{wrong:.3g} can be drawn, expected {expected(name, group)}"
            + f"; give {end}" * (not given))
    problem = clash(name, builder.draws)
    if problem:
        builder.report.add(reader.places["parameter"], problem)


def check_use(drawn: list[_GroupReader], studies: list[_GroupReader], report: Report) -> None:
    """Draws that nothing asks for are a slip."""
    if drawn and not any(reader.name == "ensemble" and "table" not in reader.places
                         for reader in studies):
        report.add(drawn[0].place, "&draw is used by no study: expected an &ensemble without table")
