"""Keys of &map: two axes, and what is done at each of their crossing points."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any, Literal, cast

from pydantic import Field

from lapwing.base import estimates
from lapwing.base.quantities import CURVE, curve_clash
from lapwing.deck.checks.axes import axis_of
from lapwing.deck.deck import Asked
from lapwing.deck.declare import (
    FILES,
    NAME_PATTERN,
    StudyKeys,
    figures_key,
    figures_of,
    files_key,
    key,
    labels_key,
    parameter_text,
    without_files,
)

if TYPE_CHECKING:
    from lapwing.deck.checks.assemble import Studies
    from lapwing.deck.load import _GroupReader
    from lapwing.deck.problems import Place, Report

_Reals = list[Annotated[float, Field(ge=-1e15, le=1e15)]] | None
_Counts = list[Annotated[int, Field(ge=2, le=100_000)]] | None
_AXIS = ("parameter", "values", "from", "to", "count", "spacing", *FILES)


def _values(example: list[float]) -> Any:
    return key(None, "the values themselves", "of the parameter", example, min_length=1)


def _end(text: str, example: list[float]) -> Any:
    return key(None, text, "of the parameter", example, min_length=1, max_length=100)


def _count(example: list[int]) -> Any:
    return key(None, "how many values each range has", "", example, min_length=1, max_length=100)


def _spacing() -> Any:
    return key("linear", "equal steps, or equal ratios; for all ranges of the axis")


class MapKeys(StudyKeys):
    """Two parameters over ranges of values, every combination of them."""

    title = "two parameters, every combination of their values; any number of them"
    chosen = ("x_from", "x_to", "x_count", "y_from", "y_to", "y_count")
    exclusive = (("x_values", "x_from", "x_files"), ("y_values", "y_from", "y_files"))

    name: str = key(text="names its figures and its part of the summary; letters, digits, . _ -",
                    example="plane", pattern=NAME_PATTERN, max_length=64)
    x_parameter: str = key(text="what is varied, as in &sweep, drawn from left to right",
                           example="pinion_speed_rpm")
    x_values: _Reals = _values([240.0, 480.0, 1500.0])
    x_from: _Reals = _end("where each range begins", [200.0])
    x_to: _Reals = _end("where each range ends, included", [3000.0])
    x_count: _Counts = _count([281])
    x_spacing: Literal["linear", "log"] = _spacing()
    x_files: list[str] | None = files_key()
    x_labels: list[str] | None = labels_key()
    y_parameter: str = key("brake_torque", "another one, drawn upwards")
    y_values: _Reals = _values([0.8, 1.8, 3.3, 5.5, 12.0])
    y_from: _Reals = _end("where each range begins", [0.2])
    y_to: _Reals = _end("where each range ends, included", [14.0])
    y_count: _Counts = _count([139])
    y_spacing: Literal["linear", "log"] = _spacing()
    y_files: list[str] | None = files_key()
    y_labels: list[str] | None = labels_key()
    start: Literal["rest", "up", "down"] = key(
        "rest", "each run from rest; or carried upwards or downwards along y, the first one of "
        "each x from rest")
    settle_cycles: int = key(400, "mesh cycles before recording, in every run", ge=0,
                             le=10_000_000)
    record_cycles: int = key(100, "mesh cycles recorded in every run", ge=1, le=100_000)
    shard_runs: int | None = key(
        None, "runs of a shard, the part of the work that is kept at once; left out: some 20 s of "
        "work, and at least 64 shards; of carried columns whole ones, or a part of one; no result "
        "depends on it", example=10_000, ge=1,
        le=10_000_000)
    observe: list[Literal["rms", "forces", "exponent", "shares"]] | None = key(
        None, "what is kept of each run besides: rms of φ; mean and peak mesh force; largest "
        "Lyapunov exponent; share of time in each motion state", example=["forces", "exponent"],
        min_length=1)
    rtol: float | None = key(None, "relative tolerance; left out: that of &numerics, else 1e-6",
                             example=1e-6, ge=1e-13, le=1e-2)
    figures: figures_of("map") | None = figures_key()  # type: ignore[valid-type]

    def build(self, builder: Studies, reader: _GroupReader) -> Asked | None:
        """See `StudyKeys`: the values of both axes, and oscillators at their corners."""
        report = builder.report
        axes, tables = {}, dict[str, Any]()
        if len(set(self.observe or ())) != len(self.observe or ()):
            report.add(reader.places["observe"], "observe: expected each once")
        for side in "xy":
            side_of: Any = _Axis(reader, side)
            axis = axis_of(builder, side_of, cast("Report", _Said(report, side)))
            if axis is None:
                continue
            if axis.name in axes:
                report.add(side_of.places["parameter"], f"y_parameter = "
                           f"{parameter_text(axis.name)!r} is x_parameter as well, expected "
                           "another")
            axes[axis.name] = (axis.group, axis.values)
            tables |= axis.tables
            if axis.name == CURVE and side == "y" and self.start != "rest":
                report.add(reader.places["start"], f"start = {self.start!r} carries motions along "
                           "y, but files have no order; expected 'rest', or the files along x")
        problem = curve_clash(axes, parameter_text)
        if problem:
            report.add(reader.places.get("y_parameter", reader.place), problem)
        if len(axes) < 2 or not builder.ready:
            return None
        operation = {k: v for k, v in builder.operation.items() if k not in axes}
        builder.check_ends(reader, axes, operation, tables)
        names = tuple(axes)
        return Asked("map", self, operation, builder.rtol(reader), {
            "axes": {name: values for name, (_, values) in axes.items()},
            "x_parameter": names[0], "y_parameter": names[1], "tables": tables})

    def used(self, asked: Asked) -> dict[str, Any]:
        """See `StudyKeys`."""
        given: dict[str, Any] = {f"{side}_spacing": None for side in "xy"
                                 if not getattr(self, f"{side}_from")}
        given |= {f"{side}_labels": list(asked.tables) for side in "xy"
                  if getattr(self, f"{side}_files")}
        return super().used(asked) | given

    def canonical(self, values: dict[str, Any], asked: Asked) -> dict[str, Any]:
        """See `StudyKeys`: the ranges written out; how the work is cut decides nothing."""
        left_out = {"shard_runs", *(f"{side}_{name}" for side in "xy" for name in _AXIS)}
        return without_files({
            name: value for name, value in values.items() if name not in left_out} | {
            "axes": {name: axis.tolist() for name, axis in asked.axes.items()}}, asked)

    def memory(self, asked: Asked) -> tuple[int, str]:
        """See `StudyKeys`: what its summary reads; the rest is put together part by part."""
        return estimates.map_read(self.observe) * _runs(asked), "the numbers of values"

    def disk(self, asked: Asked) -> tuple[int, int]:
        """See `StudyKeys`."""
        return estimates.map_run(self.observe) * _runs(asked), 1


def _runs(asked: Asked) -> int:
    return len(asked.axes[asked.x_parameter]) * len(asked.axes[asked.y_parameter])


class _Axis:
    """The keys of one axis under the names that those of a sweep have."""

    def __init__(self, reader: _GroupReader, side: str) -> None:
        self.name, self.place = reader.name, reader.place
        self.keys = _Named({name.rstrip("_"): getattr(reader.keys, f"{side}_{name}")
                            for name in _AXIS})
        ours = {f"{side}_{name}": name for name in _AXIS}
        self.places, self.key_places, self.item_places = (
            {ours[name]: place for name, place in places.items() if name in ours}
            for places in (reader.places, reader.key_places, reader.item_places))
        for name in ("parameter", "from"):  # where a key is left out, the group is to blame
            self.places.setdefault(name, reader.place)


class _Named:
    """Values by attribute; `from` as pydantic spells it."""

    def __init__(self, values: dict[str, Any]) -> None:
        self.__dict__.update(values, from_=values["from"])


class _Said:
    """A report that says which axis is meant."""

    def __init__(self, report: Report, side: str) -> None:
        self._report, self._side = report, side

    def add(self, place: Place, text: str, warning: bool = False) -> None:
        """See `Report`."""
        self._report.add(place, f"axis {self._side}: {text}", warning)
