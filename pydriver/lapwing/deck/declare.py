"""How a deck key is declared, once: type, unit, range, default and meaning.

Validation, the template, the reference page and `used.nml` are all made from these classes.
"""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal, get_args, get_origin

from pydantic import BaseModel, ConfigDict, Field

from lapwing.base.quantities import CURVE, term
from lapwing.base.registry import STUDIES

if TYPE_CHECKING:
    from lapwing.deck.deck import Asked

BIG = 2**31 - 2


def key(default: Any = ..., text: str = "", unit: str = "", example: Any = None,
        **limits: Any) -> Any:
    """A deck key: its default (`...`: required), meaning, unit, example value and limits."""
    extra = {"unit": unit, "example": example}
    return Field(default, description=text, json_schema_extra=extra, **limits)


def figures_of(kind: str) -> Any:
    """Type of the names of figures of a kind of study."""
    return list[Literal[(*STUDIES[kind].figure_names, "all", "none")]]  # type: ignore[misc]


def figures_key() -> Any:
    """The key that names them."""
    return key(None, "figures to draw; left out: the fewest that answer what is asked; "
               "`lapwing run --figures all` and `lapwing plot` draw all", "", ["all"],
               min_length=1)


class Group(BaseModel):
    """One namelist group.

    `exclusive` lists sets of keys of which at most one is given; `needed`: one must be given.
    """

    model_config = ConfigDict(strict=True, extra="forbid", frozen=True,
                              defer_build=True)  # of groups that a deck has not: never
    title: ClassVar[str] = ""
    exclusive: ClassVar[tuple[Any, ...]] = ()
    needed: ClassVar[bool] = True
    repeatable: ClassVar[bool] = False
    # Of a group that a deck has several of: the key whose value tells it from the others, and
    # optional keys that the template gives a value.
    named_by: ClassVar[str] = "name"
    chosen: ClassVar[tuple[str, ...]] = ()

    @property
    def own_name(self) -> str:
        """What tells it from others of its kind."""
        return str(getattr(self, self.named_by))


class OperationKeys(Group):
    """Torques and speed."""

    title = "torques and speed, for every study that does not set its own"
    exclusive = (("pinion_speed_rpm", "pinion_speed_rad_s", "mesh_frequency_hz"),)
    needed = False

    brake_torque: float | None = key(None, "T_l, mean torque braking the gear; may be left out "
                                     "where every study gives its own", "N·m", 1.8, ge=-1e9,
                                     le=1e9)
    drive_torque: float | None = key(None, "T_m, mean torque driving the pinion; left out: the "
                                     "balance T_l/i12", "N·m", 1.40625, ge=-1e9, le=1e9)
    pinion_speed_rpm: float | None = key(None, "n1, speed of the pinion", "rpm", 240.0,
                                         ge=1e-3, le=1e7)
    pinion_speed_rad_s: float | None = key(None, "n1, speed of the pinion", "rad/s", 25.13,
                                           ge=1e-4, le=1e6)
    mesh_frequency_hz: float | None = key(None, "Z1·n1, tooth passages per second", "Hz", 100.0,
                                          ge=1e-3, le=1e9)
    te_scale: float | None = key(None, "factor of the transmission error; left out: 1", "", 1.1,
                                 ge=-1e6, le=1e6)


class ValueKeys(Group):
    """Values of a parameter: a list, or ranges."""

    values: list[Annotated[float, Field(ge=-1e15, le=1e15)]] | None = key(
        None, "the values themselves", "of the parameter", [0.8, 1.8, 3.3, 5.5, 12.0],
        min_length=1)
    from_: list[Annotated[float, Field(ge=-1e15, le=1e15)]] | None = key(
        None, "where each range begins", "of the parameter", [0.2], alias="from", min_length=1,
        max_length=100)
    to: list[Annotated[float, Field(ge=-1e15, le=1e15)]] | None = key(
        None, "where each range ends, included", "of the parameter", [14.0], min_length=1,
        max_length=100)
    count: list[Annotated[int, Field(ge=2, le=100_000)]] | None = key(
        None, "how many values each range has", "", [691], min_length=1, max_length=100)
    spacing: Literal["linear", "log"] = key(
        "linear", "equal steps, or equal ratios; for all ranges")


NAME_PATTERN = r"^[A-Za-z0-9][A-Za-z0-9_.-]*$"
TORQUES = ("brake_torque", "drive_torque")
SPEEDS = OperationKeys.exclusive[0]
OPERATION = tuple(OperationKeys.model_fields)
# What a parameter may be called besides.
_OTHER_NAMES = {"transmission_error.scale": "te_scale", "transmission_error.file": CURVE,
                "file": CURVE}
_ELEMENT = re.compile(r"harmonic_amplitude\s*\(\s*(\d+)\s*\)$")
RANGES = ("from", "to", "count", "spacing")
# Of curves in place of numbers.
FILES = ("files", "labels")


def files_key() -> Any:
    """Files of an axis along the transmission error."""
    return key(None, "in place of numbers, with parameter = 'transmission_error.file': files as of "
               "&transmission_error, relative to the deck, each in place of its curve", "",
               ["te_25x32.csv", "te_other.csv"], min_length=1, max_length=1000)


def labels_key() -> Any:
    """What results call the curves of such an axis."""
    return key(None, "what results and figures call each of the files; left out: its name without "
               "folder and ending", "", ["ground", "lapped"], min_length=1, max_length=1000)


def parameter_name(text: str) -> str:
    """A parameter as a deck names it, in lower case, perhaps with its group before it."""
    name = _ELEMENT.sub(lambda found: f"harmonic_amplitude_{int(found[1])}", text.strip().lower())
    return _OTHER_NAMES.get(name, name)


def parameter_text(name: str) -> str:
    """A parameter's name as a deck writes it."""
    if name == CURVE:
        return "transmission_error.file"
    group, dot, bare = name.rpartition(".")
    number = term(bare)
    return name if number is None else f"{group}{dot}harmonic_amplitude({number})"


def without_files(values: dict[str, Any], asked: Asked) -> dict[str, Any]:
    """Values used that decide results: of curves from files their labels and numbers."""
    left = {name: value for name, value in values.items()
            if name.rpartition("_")[2] not in FILES}
    digests = {label: table.digest for label, table in asked.tables.items()}
    return left | ({"curves": digests} if digests else {})


class StudyKeys(Group):
    """The keys of a study, and all that follows from them."""

    repeatable: ClassVar[bool] = True
    # Tolerance where neither the study nor &numerics names one.
    default_rtol: ClassVar[float] = 1e-6

    def build(self, builder: Any, reader: Any) -> Asked | None:
        """The study as `deck.Asked`, or None; what is wrong goes to `builder.report`.

        Parameters
        ----------
        builder : deck.checks.assemble.Studies
        reader : group reader (`load`)
        """
        raise NotImplementedError

    def used(self, asked: Asked) -> dict[str, Any]:
        """Key -> value as used, None where a key has none."""
        own = {"rtol": asked.rtol} if "rtol" in type(self).model_fields else {}
        return self.model_dump(by_alias=True) | own

    def canonical(self, values: dict[str, Any], asked: Asked) -> dict[str, Any]:
        """Values used, spelled the same however the deck gave them."""
        return values

    def memory(self, asked: Asked) -> tuple[int, str] | None:
        """Bytes it takes at least, and the keys to lower where there are fewer; None: few."""
        return None

    def disk(self, asked: Asked) -> tuple[int, int]:
        """Bytes of its tables in the result file, and how many figures it has at least."""
        return 0, 0


class AlongKeys(ValueKeys, StudyKeys):
    """The keys of a study along the values of one parameter."""

    exclusive: ClassVar[tuple[Any, ...]] = (("values", "from"),)
    chosen = ("from", "to", "count")

    def used(self, asked: Asked) -> dict[str, Any]:
        """See `StudyKeys`: of listed values no spacing."""
        return super().used(asked) | ({"spacing": None} if self.values is not None else {})

    def canonical(self, values: dict[str, Any], asked: Asked) -> dict[str, Any]:
        """See `StudyKeys`: the ranges written out."""
        values = {name: value for name, value in values.items() if name not in RANGES}
        return values | {"values": asked.values.tolist(), "parameter": asked.parameter}


def fields(group: Any) -> dict[str, Any]:
    """Key -> field of a group by the deck's spelling; what names a study stands first."""
    first = (name for name in ("name", "find", "parameter") if name in group.model_fields)
    order = [*first, *group.model_fields]
    return {(group.model_fields[name].alias or name): group.model_fields[name]
            for name in dict.fromkeys(order)}


class KeyType:
    """What a field's annotation and limits say, in a form to print and to test.

    Attributes
    ----------
    kind : type, one of int, float, bool, str
    is_list : bool
    choices : tuple of str, the allowed texts, or empty
    limits : dict of 'gt', 'ge', 'lt', 'le'
    unit : str
    """

    def __init__(self, field: Any) -> None:
        annotation, metadata = field.annotation, list(field.metadata)
        parts = [part for part in get_args(annotation) if part is not type(None)]
        if type(None) in get_args(annotation):
            annotation = parts[0]
        self.is_list = get_origin(annotation) is list
        if self.is_list:
            annotation = get_args(annotation)[0]
            if get_origin(annotation) is Annotated:
                annotation, *inner = get_args(annotation)
                metadata += [limit for item in inner for limit in item.metadata]
        self.choices = get_args(annotation) if get_origin(annotation) is Literal else ()
        self.kind = str if self.choices else annotation
        self.limits = _limits(metadata)
        self.unit = (field.json_schema_extra or {}).get("unit", "")

    @property
    def range(self) -> str:
        """Limits in words, such as `> 0` or `from 0 to 1`."""
        (low, above), (high, below) = (
            next(((self._spell(self.limits[name]), name == strict) for name in (strict, other)
                  if name in self.limits), ("", False))
            for strict, other in (("gt", "ge"), ("lt", "le")))
        if not high:
            return (f"> {low}" if above else f">= {low}") if low else ""
        return (f"above {low}" if above else f"from {low}") + (
            f" and below {high}" if below else f" to {high}")

    def _spell(self, limit: float) -> str:
        return str(limit) if self.kind is int else f"{limit:g}"

    @property
    def expected(self) -> str:
        """What a value of this key must be, to follow `key = value, expected `."""
        each = "each " if self.is_list else ""
        if self.choices:
            return each + "one of " + ", ".join(f"'{choice}'" for choice in self.choices)
        if self.kind is bool:
            return each + ".true. or .false."
        if self.kind is str:
            return each + "text in quotes"
        what = "a whole number" if self.kind is int else "a number"
        unit = f" ({self.unit})" if self.unit else ""
        return f"{each}{what} {self.range}".rstrip() + unit


def _limits(metadata: list[Any]) -> dict[str, float]:
    """Limits among the metadata of a field; pydantic may pack several into one object."""
    limits = {}
    for item in metadata:
        for name in ("gt", "ge", "lt", "le"):
            value = getattr(item, name, None)
            if value is not None:
                limits[name] = value
    return limits
