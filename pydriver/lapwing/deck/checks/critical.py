"""Checks of &critical: which keys go with what is to be found, and the values searched."""

from __future__ import annotations

from lapwing.deck import schema
from lapwing.deck.checks.magnitudes import warn_of_order
from lapwing.deck.checks.ranges import range_values
from lapwing.deck.deck import Critical

_RANGE = ("values", "from", "to", "count", "spacing")
_ALWAYS = ("name", "find", "parameter", *schema.OPERATION)
_SEARCH = ("start_phases", "start_positions", "start_speeds", "settle_cycles", "record_cycles",
           "rtol", *_RANGE, "safe_end")
_OWN = {"safe": ("resolution", "further_values"), "back": ("confidence",)}


def allowed_keys(find, parameter):
    """Keys of &critical that mean something for what is to be found along a parameter."""
    if find in _OWN:
        return (*_ALWAYS, *_SEARCH, *_OWN[find])
    return _ALWAYS if parameter in schema.TORQUES else (*_ALWAYS, *_RANGE, "safe_end")


def build_critical(studies, reader, keys, report):
    """`Critical` of one group, or None; what is wrong goes to the report.

    Parameters
    ----------
    studies : lapwing.deck.checks.assemble.Studies, ready to build oscillators
    reader : group reader (`load`)
    keys : schema.CriticalKeys
    report : Report
    """
    name = keys.parameter.strip().lower()
    group = studies.parameter(reader, name)
    name = name.rpartition(".")[2]
    if group is None:
        return None
    allowed = allowed_keys(keys.find, name)
    for key in reader.key_places:
        if key not in allowed:
            report.add(reader.key_places[key], f"{key} does not go with find = '{keys.find}' along "
                                               f"{name}")
    if name in reader.places:
        report.add(reader.key_places[name], f"{name} is the parameter searched along, expected "
                                            "without a value of its own")
    values = None
    if "values" in allowed:
        values = _values(reader, keys, name, report)
        if values is None:
            return None
        studies.check_values(reader, name, group, values)
        warn_of_order(reader, report)
    operation = {k: v for k, v in studies.own_operation(keys).items() if k != name}
    _check_laws(reader, keys, operation, report)
    studies.check_ends(reader, name, group, [1.0] if values is None else values, operation)
    return _critical(studies, reader, keys, name, group, values, operation)


def _critical(studies, reader, keys, name, group, values, operation):
    defaults = schema.CRITICAL_DEFAULTS.get(keys.find, {})
    counts = {key: getattr(keys, key) or default for key, default in defaults.items()}
    grid = tuple(counts[key] for key in ("start_phases", "start_positions", "start_speeds")) \
        if counts else None
    return Critical(
        name=keys.name, find=keys.find, parameter=name, group=group, values=values,
        safe_end=keys.safe_end, operation=operation, starts=grid,
        own_operation=any(getattr(keys, key) is not None for key in schema.OPERATION),
        settle_cycles=keys.settle_cycles, record_cycles=counts.get("record_cycles"),
        resolution=keys.resolution, further_values=keys.further_values,
        confidence=keys.confidence, rtol=studies.rtol(reader))


def _values(reader, keys, name, report):
    """Values to search, ascending; None where there are none that make sense."""
    if keys.values is None and keys.from_ is None:
        report.add(reader.place, f"&critical lacks one of values, from: find = '{keys.find}' along "
                                 f"{name} searches a range")
        return None
    return range_values(reader, report)


def _check_laws(reader, keys, operation, report):
    """What is to be found must exist under the laws of &scene."""
    rigid = operation["contact_law"] == "rigid"
    other = {"on": "on" if rigid else "full", "full": "on" if rigid else "full"}.get(keys.find)
    if other is not None and other != keys.find:
        report.add(reader.places["find"], f"find = '{keys.find}' does not go with contact_law = "
                                          f"'{operation['contact_law']}'; expected '{other}'")
    if keys.find == "back" and operation["gap"] == "one_flank":
        report.add(reader.places["find"], "find = 'back' does not go with gap = 'one_flank': there "
                                          "is no coast flank to strike")


def used_values(keys, study):
    """Key -> value as used by a `Critical`; None where a key plays no part."""
    allowed = allowed_keys(study.find, study.parameter)
    values = keys.model_dump(by_alias=True)
    values = {key: value if key in allowed else None for key, value in values.items()}
    if study.starts is not None:
        values |= dict(zip(("start_phases", "start_positions", "start_speeds"), study.starts,
                           strict=True))
        values |= {"record_cycles": study.record_cycles, "rtol": study.rtol}
    if keys.values is not None:
        values["spacing"] = None
    return values


def canonical_values(values, study):
    """The values used with the range written out."""
    values = {k: v for k, v in values.items() if k not in ("from", "to", "count", "spacing")}
    searched = {} if study.values is None else {"values": study.values.tolist()}
    return values | searched | {"parameter": study.parameter}

