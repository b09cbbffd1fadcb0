"""Keys of &draw: a number that is not the same in every pair."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Literal

from lapwing.deck.declare import Group, key, parameter_name
from lapwing.model.draw import LAWS, NUMBERS, Draw

if TYPE_CHECKING:
    from lapwing.deck.checks.assemble import Studies
    from lapwing.deck.load import _GroupReader

_UNIT = "of the parameter"


def _number(text: str, example: float) -> Any:
    return key(None, text, _UNIT, example, ge=-1e15, le=1e15)


class DrawKeys(Group):
    """One number that is not the same in every pair, for all ensembles."""

    title = "a number that is not the same in every pair, for all &ensemble; a group for each"
    repeatable = True
    named_by = "parameter"
    chosen = ("mean", "deviation")

    parameter: str = key(text="a real number of &gear_pair or &operation, as 'backlash' or "
                         "'gear_pair.backlash'", example="te_scale")
    law: Literal["normal", "lognormal", "uniform", "triangular"] = key(
        "normal", "how it is distributed")
    mean: float | None = _number("mean of the value, before limits cut it; for 'normal' and "
                                 "'lognormal'", 1.0)
    deviation: float | None = _number("standard deviation of the value itself, before limits cut "
                                      "it; for 'normal' and 'lognormal'", 0.05)
    mode: float | None = _number("likeliest value; for 'triangular'", 1.0)
    low: float | None = _number("least value; left out with 'normal' and 'lognormal': no limit",
                                0.9)
    high: float | None = _number("greatest value; left out with 'normal' and 'lognormal': no "
                                 "limit", 1.1)

    def draw(self, builder: Studies, reader: _GroupReader) -> tuple[str, str, Draw] | None:
        """(parameter, its group, Draw), or None; what is wrong goes to the builder's report."""
        report = builder.report
        name = parameter_name(self.parameter)
        group = builder.parameter(reader, name)
        wrong = self._misplaced(reader)
        for text in wrong:
            report.add(*text)
        if group is None or wrong:
            return None
        try:
            draw = Draw(self.law, **{one: getattr(self, one) for one in NUMBERS})
        except ValueError as error:
            for problem in str(error).removeprefix("draw: ").split("; "):
                report.add(reader.places.get(problem.split(" ")[0], reader.place), problem)
            return None
        bare = name.rpartition(".")[2]
        known = report.refusals
        builder.check_drawn(reader, bare, group, draw)
        return (bare, group, draw) if report.refusals == known else None

    def _misplaced(self, reader: _GroupReader) -> list[tuple[Any, str]]:
        """Numbers that do not go with the law, and those that it lacks."""
        takes, needs = LAWS[self.law]
        wrong: list[tuple[Any, str]] = [
            (reader.key_places[one], f"{one} does not go with law = {self.law!r}, which takes "
                                     f"{', '.join(takes)}")
            for one in NUMBERS if one in reader.places and one not in takes]
        lacking = [one for one in needs if getattr(self, one) is None]
        if lacking:
            wrong.append((reader.place, f"&draw of {self.parameter!r} lacks {', '.join(lacking)}, "
                                        f"which law = {self.law!r} needs"))
        return wrong
