"""Keys of &branches: what is continued, and the motions it begins with."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from lapwing.base import estimates
from lapwing.base.quantities import term
from lapwing.deck.checks.drawn import expected, out_of_range
from lapwing.deck.checks.ranges import range_values
from lapwing.deck.deck import Asked
from lapwing.deck.declare import (
    NAME_PATTERN,
    AlongKeys,
    figures_key,
    figures_of,
    key,
    parameter_name,
)

if TYPE_CHECKING:
    from lapwing.deck.checks.assemble import Studies
    from lapwing.deck.load import _GroupReader


class BranchesKeys(AlongKeys):
    """Periodic motions followed along one parameter, stable or not."""

    title = "periodic motions followed along one parameter; any number of them"
    default_rtol: ClassVar[float] = 1e-8

    name: str = key(text="names its figure and its part of the summary; letters, digits, . _ -",
                    example="torque", pattern=NAME_PATTERN, max_length=64)
    parameter: str = key("brake_torque", "a real number of &gear_pair or &operation; between the "
                         "least and the greatest value branches are followed, at the values "
                         "motions are looked for: from rest, carried both ways, from random "
                         "starts; those of the deck's sweeps along it are taken as well")
    random_starts: int = key(8, "starts drawn at each value", ge=0, le=10_000)
    random_seed: int = key(0, "decides them", ge=0, le=2**31 - 2)
    settle_cycles: int = key(400, "mesh cycles before a motion is looked at", ge=1, le=10_000_000)
    highest_period: int = key(24, "mesh cycles after which a motion must repeat to begin a branch",
                              ge=1, le=24)
    doublings: int = key(2, "how many times over the branch that leaves at a period doubling is "
                         "followed", ge=0, le=10)
    most_points: int = key(2000, "points of a branch either way, at most", ge=10, le=1_000_000)
    unstable_points: int = key(200, "points in a row that are not stable, at most: through such "
                               "motions a branch may come to further stable ones",
                               ge=1, le=1_000_000)
    beyond_ends: int = key(5, "how many times over it is looked what becomes of motions a little "
                           "beyond the ends of their stable ranges; what is found the last time "
                           "begins no branch", ge=0, le=100)
    rattling_cycles: int = key(50_000_000, "mesh cycles, at most, for which motions are followed "
                               "in all to find where rattling ends that is on no branch; what is "
                               "not found by then is said", ge=1, le=10**15)
    second_parameter: str | None = key(None, "another real number of &gear_pair or &operation: "
                                       "what ends stable ranges is followed in it as well, as "
                                       "curves over both", example="pinion_speed_rpm")
    second_from: float | None = key(None, "where its range begins", "of the parameter", 200.0)
    second_to: float | None = key(None, "where its range ends; its own value lies between",
                                  "of the parameter", 300.0)
    second_curves: int = key(12, "curves at most; those that end the widest ranges first", ge=1,
                             le=1000)
    rtol: float | None = key(None, "relative tolerance with which motions are looked for; left "
                             "out: that of &numerics, else 1e-8; branches have none",
                             example=1e-8, ge=1e-13, le=1e-2)
    figures: figures_of("branches") | None = figures_key()  # type: ignore[valid-type]

    def build(self, builder: Studies, reader: _GroupReader) -> Asked | None:
        """See `StudyKeys`: two values at least, oscillators at both ends of them."""
        report, name = builder.report, parameter_name(self.parameter)
        group = builder.parameter(reader, name)
        if self.values is None and self.from_ is None:
            report.add(reader.place, "&branches lacks one of values, from")
            return None
        values = range_values(reader, report)
        if group is None or values is None:
            return None
        name = name.rpartition(".")[2]
        place = reader.places.get("values") or reader.places["from"]
        if len(values) < 2:
            report.add(place, "one value, expected two or more: branches are followed between them")
            return None
        builder.check_values(reader, name, group, values)
        if not builder.ready:
            return None
        second = self._second(builder, reader, name)
        operation = {k: v for k, v in builder.operation.items() if k != name}
        if operation.get("degrees_of_freedom") == 2:
            report.add(place, "&branches goes with degrees_of_freedom = 1")
        builder.check_ends(reader, {name: (group, values)}, operation)
        return Asked("branches", self, operation, builder.rtol(reader),
                     {"parameter": name, "group": group, "values": values, "second": second})

    def used(self, asked: Asked) -> dict[str, Any]:
        """See `StudyKeys`: no number of curves where none are asked for."""
        return super().used(asked) | ({} if self.second_parameter else {"second_curves": None})

    def _second(self, builder: Studies, reader: _GroupReader, first: str) -> dict[str, Any] | None:
        """The second parameter, its own value and range; None without one."""
        report, places = builder.report, reader.places
        low, high = self.second_from, self.second_to
        if self.second_parameter is None:
            for key_name in ("second_from", "second_to", "second_curves"):
                if key_name in places:
                    report.add(reader.key_places[key_name],
                               f"{key_name} goes with second_parameter")
            return None
        place = places["second_parameter"]
        name = parameter_name(self.second_parameter)
        group = builder.parameter(reader, name, place, "second_parameter")
        name = name.rpartition(".")[2]
        if group is None:
            return None
        if name == first:
            report.add(place, f"second_parameter = {name!r} is parameter as well, expected another")
            return None
        if low is None or high is None:
            report.add(place, "second_parameter needs second_from and second_to")
            return None
        number = term(name)
        given = {"parabola_amplitude": builder.curve.parabola_amplitude, "te_scale": 1.0,
                 **builder.operation}
        own = given.get(name, getattr(builder.pair, name, None)) if number is None \
            else builder.curve.harmonic_amplitude[number - 1]
        for end in (low, high):
            if out_of_range(name, group, np.array([end])) is not None:
                report.add(places["second_from"], f"second_parameter: {name} = {end:g}, expected "
                                                  f"{expected(name, group)}")
                return None
        if own is None or not low < high or not low <= own <= high:
            report.add(places["second_from"],
                       f"second_from = {low:g}, second_to = {high:g}: expected a range that holds "
                       + (f"{name} = {own:g}, where the branches are" if own is not None
                          else f"{name}, which is not given"))
            return None
        return {"parameter": name, "value": own, "low": low, "high": high,
                "most": self.second_curves}

    def memory(self, asked: Asked) -> tuple[int, str]:
        """See `StudyKeys`: of the sweep that motions are looked for with."""
        return (estimates.sweep_bytes(3 * asked.values.size, 48),
                "the number of values")
