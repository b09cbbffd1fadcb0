"""Keys of &critical: which go with what is to be found, and the values searched."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, ClassVar, Literal

from numpy.typing import NDArray

from lapwing.deck.checks.magnitudes import warn_of_order
from lapwing.deck.checks.ranges import range_values
from lapwing.deck.deck import Asked
from lapwing.deck.declare import (
    NAME_PATTERN,
    OPERATION,
    RANGES,
    TORQUES,
    OperationKeys,
    StudyKeys,
    ValueKeys,
    figures_key,
    figures_of,
    key,
    parameter_name,
)

if TYPE_CHECKING:
    from lapwing.deck.checks.assemble import Studies
    from lapwing.deck.load import _GroupReader
    from lapwing.deck.problems import Report

_GRID = ("start_phases", "start_positions", "start_speeds")
# What a search takes where its group says nothing, by what it finds.
DEFAULTS = {
    "safe": {"start_phases": 6, "start_positions": 3, "start_speeds": 3, "record_cycles": 50},
    "back": {"start_phases": 2, "start_positions": 2, "start_speeds": 2, "record_cycles": 1200}}
_RANGE = ("values", *RANGES)
_ALWAYS = ("name", "find", "parameter", "figures", *OPERATION)
_SEARCH = (*_GRID, "settle_cycles", "record_cycles",
           "rtol", *_RANGE, "safe_end")
_OWN = {"safe": ("resolution", "further_values"), "back": ("confidence",)}


def allowed_keys(find: str, parameter: str) -> tuple[str, ...]:
    """Keys of &critical that mean something for what is to be found along a parameter."""
    if find in _OWN:
        return (*_ALWAYS, *_SEARCH, *_OWN[find])
    return _ALWAYS if parameter in TORQUES else (*_ALWAYS, *_RANGE, "safe_end")


class CriticalKeys(OperationKeys, ValueKeys, StudyKeys):
    """One critical value of a parameter."""

    title = "one critical value of a parameter, the braking torque first of all; any number of them"
    exclusive: ClassVar[tuple[Any, ...]] = (*OperationKeys.exclusive, ("values", "from"))

    name: str = key(text="names its figure and its part of the summary; letters, digits, . _ -",
                    example="T_full", pattern=NAME_PATTERN, max_length=64)
    find: Literal["full", "safe", "back", "on"] = key(
        text="'full': the engaged motion keeps contact; 'safe': no rattling survives from the "
        "starts stated; 'back': the last back impact; 'on': a rigid tooth stays on the flank "
        "(contact_law 'rigid' only)", example="full")
    parameter: str = key("brake_torque", "a real number of &gear_pair or &operation, as for "
                         "&sweep; 'full' and 'on' along a torque are closed forms and take no "
                         "values")
    safe_end: Literal["high", "low"] = key(
        "high", "the end of the values at which the teeth are taken to be safe; the search begins "
        "there")
    resolution: float | None = key(
        None, "'safe': half of the widest bracket allowed; left out: a fifth of the least step of "
        "the values", "of the parameter", 0.01, gt=0, le=1e15)
    start_phases: int | None = key(None, "mesh phases at which motions begin; left out: 6 for "
                                   "'safe', 2 for 'back'", "", 6, ge=1, le=1000)
    start_positions: int | None = key(
        None, "positions at each phase, in separation and in engagement; left out: 3 for 'safe', "
        "2 for 'back'", "", 3, ge=1, le=1000)
    start_speeds: int | None = key(None, "speeds at each position; left out: 3 for 'safe', 2 for "
                                   "'back'", "", 3, ge=1, le=1000)
    settle_cycles: int = key(200, "mesh cycles before a motion is looked at", ge=0, le=10_000_000)
    record_cycles: int | None = key(
        None, "mesh cycles looked at, of each motion; left out: 50 for 'safe', 1200 for 'back'", "",
        50, ge=1, le=1_000_000)
    further_values: int = key(0, "'safe': values tried beyond the first that rattles; motions "
                              "found there are carried back to it", ge=0, le=100_000)
    confidence: float = key(0.95, "'back': of the upper limit of the rate of back impacts", ge=0.5,
                            lt=1)
    rtol: float | None = key(None, "relative tolerance; left out: that of &numerics, else 1e-6",
                             example=1e-6, ge=1e-13, le=1e-2)
    figures: figures_of("critical") | None = figures_key()  # type: ignore[valid-type]

    def build(self, builder: Studies, reader: _GroupReader) -> Asked | None:
        """See `StudyKeys`: the keys that go together, the values, oscillators at both ends."""
        if not builder.ready:
            return None
        report, name = builder.report, parameter_name(self.parameter)
        group = builder.parameter(reader, name)
        name = name.rpartition(".")[2]
        if group is None:
            return None
        allowed = allowed_keys(self.find, name)
        for given, place in reader.key_places.items():
            if given not in allowed:
                report.add(place, f"{given} does not go with find = '{self.find}' along {name}")
        if name in reader.places:
            report.add(reader.key_places[name], f"{name} is the parameter searched along, expected "
                                                "without a value of its own")
        values = None
        if "values" in allowed:
            values = _values(reader, self, name, report)
            if values is None:
                return None
            builder.check_values(reader, name, group, values)
            warn_of_order(reader, report)
        operation = {k: v for k, v in builder.own_operation(self).items() if k != name}
        _check_laws(reader, self, operation, report)
        builder.check_ends(reader, {name: (group, [1.0] if values is None else values)}, operation)
        return Asked("critical", self, operation, builder.rtol(reader),
                     {"parameter": name, "group": group, "values": values, **self._search()})

    def _search(self) -> dict[str, Any]:
        """What a search takes, its own or by default."""
        counts = {name: getattr(self, name) or default
                  for name, default in DEFAULTS.get(self.find, {}).items()}
        return {"starts": tuple(counts[name] for name in _GRID) if counts else None,
                "record_cycles": counts.get("record_cycles"),
                "own_operation": any(getattr(self, name) is not None for name in OPERATION)}

    def used(self, asked: Asked) -> dict[str, Any]:
        """See `StudyKeys`: keys that play no part have no value."""
        allowed = allowed_keys(self.find, asked.parameter)
        values = {name: value if name in allowed else None
                  for name, value in self.model_dump(by_alias=True).items()}
        if asked.starts is not None:
            values |= dict(zip(_GRID, asked.starts, strict=True))
            values |= {"record_cycles": asked.record_cycles, "rtol": asked.rtol}
        if self.values is not None:
            values["spacing"] = None
        return values

    def canonical(self, values: dict[str, Any], asked: Asked) -> dict[str, Any]:
        """See `StudyKeys`: the range written out."""
        values = {name: value for name, value in values.items() if name not in RANGES}
        searched = {} if asked.values is None else {"values": asked.values.tolist()}
        return values | searched | {"parameter": asked.parameter}


def _values(reader: _GroupReader, keys: CriticalKeys, name: str,
            report: Report) -> NDArray[Any] | None:
    """Values to search, ascending; None where there are none that make sense."""
    if keys.values is None and keys.from_ is None:
        report.add(reader.place, f"&critical lacks one of values, from: find = '{keys.find}' along "
                                 f"{name} searches a range")
        return None
    return range_values(reader, report)


def _check_laws(reader: _GroupReader, keys: CriticalKeys, operation: dict[str, Any],
                report: Report) -> None:
    """What is to be found must exist under the laws of &scene."""
    rigid = operation["contact_law"] == "rigid"
    other = {"on": "on" if rigid else "full", "full": "on" if rigid else "full"}.get(keys.find)
    if other is not None and other != keys.find:
        report.add(reader.places["find"], f"find = '{keys.find}' does not go with contact_law = "
                                          f"'{operation['contact_law']}'; expected '{other}'")
    if keys.find == "back" and operation["gap"] == "one_flank":
        report.add(reader.places["find"], "find = 'back' does not go with gap = 'one_flank': there "
                                          "is no coast flank to strike")
