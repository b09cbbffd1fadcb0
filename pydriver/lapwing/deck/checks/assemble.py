"""Checks across keys and groups, and the objects of the driver made from checked keys."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import replace
from itertools import product
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

from numpy.typing import NDArray

from lapwing.base.quantities import CURVE, term
from lapwing.deck import schema
from lapwing.deck.checks.axes import parameter_group
from lapwing.deck.checks.curve import curve_options
from lapwing.deck.checks.drawn import check_drawn, check_use, expected, out_of_range
from lapwing.deck.checks.magnitudes import warn_of_torques, warn_of_units
from lapwing.deck.checks.te_table import file_table, flat, formula_table
from lapwing.deck.deck import Deck
from lapwing.deck.declare import parameter_name, parameter_text
from lapwing.deck.problems import Place
from lapwing.model.gear_pair import GearPair
from lapwing.model.oscillator import ParameterError
from lapwing.model.transmission_error.algebra import with_amplitudes

if TYPE_CHECKING:
    from lapwing.deck.checks.te_table import Table
    from lapwing.deck.deck import Asked
    from lapwing.deck.declare import OperationKeys
    from lapwing.deck.keys.basins import BasinsKeys
    from lapwing.deck.keys.critical import CriticalKeys
    from lapwing.deck.keys.ensemble import EnsembleKeys
    from lapwing.deck.keys.response import ResponseKeys
    from lapwing.deck.load import _GroupReader
    from lapwing.deck.problems import Report
    from lapwing.deck.schema import GearPairKeys, SceneKeys
    from lapwing.model.draw import Draw
    from lapwing.model.oscillator import Oscillator
    from lapwing.model.transmission_error.table import TransmissionError

EMPTY: Mapping[str, Any] = MappingProxyType({})


def assemble(path: Path, text: str, overrides: tuple[tuple[str, str], ...],
             readers: list[_GroupReader], report: Report) -> Deck | None:
    """The deck, or None; what is wrong goes to `report`.

    Parameters
    ----------
    path : Path
    text : str
    overrides : tuple of (key, value text)
    readers : sequence of group readers (`load`), in the order of the deck
    report : Report
    """
    models = {reader.name: reader for reader in readers if reader.name not in schema.REPEATED}
    studies = [reader for reader in readers if reader.name in schema.STUDIES]
    if readers:
        _check_presence(models, studies, Place(str(path)), report)
    settings: dict[str, Any] = {
                name: models[name].keys if name in models else group()
                for name, group in schema.GROUPS.items()
                if name not in (*schema.REPEATED, *schema.REQUIRED)}
    settings |= {name: models[name].keys if name in models else None for name in schema.REQUIRED}
    _check_restitution(models.get("gear_pair"), settings["scene"], report)
    pair: Any = _gear_pair(models.get("gear_pair"), report)  # None: refused below
    table = _table(models.get("transmission_error"), settings["gear_pair"], path, report)
    warn_of_units(models.get("gear_pair"), models.get("transmission_error"), table, report)
    builder = Studies(settings, models, pair, table, report, path.parent)
    if builder.operation and pair is not None and "operation" in models:
        warn_of_torques(models["operation"], pair, builder.operation, None, report)
    drawn = [reader for reader in readers if reader.name == schema.DRAW]
    builder.draw(drawn)
    built: dict[str, tuple[Any, ...]] = {
        name: tuple(builder.build(reader) for reader in studies if reader.name == name)
             for name in schema.STUDIES}
    _check_names([*studies, *drawn], report)
    check_use(drawn, studies, report)
    if report.refusals:
        return None
    settings |= {name: [reader.keys for reader in (*studies, *drawn) if reader.name == name]
                 for name in schema.REPEATED}
    return Deck(path=path, text=text, overrides=overrides, warnings=report.warnings,
                settings=settings, te_table=table, gear_pair=pair, operation=builder.operation,
                numerics=settings["numerics"].model_dump(), studies=built)


def _check_presence(models: dict[str, _GroupReader], studies: list[_GroupReader], origin: Place,
                    report: Report) -> None:
    for name in schema.REQUIRED:
        if name not in models:
            report.add(origin, f"&{name} is missing")
    if not studies:
        report.add(origin, "neither " + " nor ".join(f"&{name}" for name in schema.STUDIES)
                   + ": nothing to compute")


def _check_names(studies: list[_GroupReader], report: Report) -> None:
    """Names are parts of file names; not every file system knows lower from upper case."""
    seen: dict[tuple[str, str], int] = {}
    for reader in studies:
        if reader.keys is None:
            continue
        name, place = reader.keys.own_name, reader.places[reader.keys.named_by]
        bare = parameter_name(name).rpartition(".")[2] if reader.name == schema.DRAW \
            else name.lower()
        if (reader.name, bare) in seen:
            words = "are of" if reader.name == schema.DRAW else "are named"
            report.add(place, f"two groups &{reader.name} {words} {name!r} (the other on line "
                              f"{seen[reader.name, bare]})")
        seen.setdefault((reader.name, bare), place.line)


def _relay(error: Any, readers: list[_GroupReader], report: Report) -> None:
    """Report each sentence of an error at the key it names, else at the last group."""
    problems = error.problems if isinstance(error, ParameterError) else [str(error)]
    for problem in problems:
        words = re.findall(r"\w+", problem)
        places = (reader.places[word] for word in words for reader in reversed(readers)
                  if word in reader.places)
        report.add(next(places, readers[-1].place), problem)


def _check_restitution(reader: _GroupReader | None, scene: SceneKeys | None,
                       report: Report) -> None:
    """Restitution is asked for where a contact law uses it."""
    if reader is None or scene is None or scene.contact_law == "compliant" \
            or reader.mentioned("restitution"):
        return
    kind = schema.KeyType(schema.GearPairKeys.model_fields["restitution"])
    report.add(reader.place, f"&gear_pair lacks restitution, {kind.expected} (ε, coefficient of "
                             "restitution)")


def _gear_pair(reader: _GroupReader | None, report: Report) -> GearPair | None:
    if reader is None or reader.keys is None:
        return None
    try:
        given = reader.keys.model_dump()
        # Not given where the contact law has no use for it: any number does.
        pair = GearPair(**{**given, "restitution": given["restitution"] or 0.0})
        # Derived numbers overflow where the given ones are absurd together.
        pair.force(1.0, 1.0)
        return pair
    except ArithmeticError:
        report.add(reader.place, "the numbers of &gear_pair overflow together")
    except ValueError as error:
        _relay(error, [reader], report)
    return None


def _table(reader: _GroupReader | None, gear: GearPairKeys | None, path: Path,
           report: Report) -> Table | None:
    """The transmission error; a file is read even if the gear is refused, to report it as well."""
    if reader is None or reader.keys is None:
        return None
    keys = reader.keys
    fit = curve_options(reader, report)
    if keys.file is not None:
        _refuse_without(reader, "harmonic_amplitude", ("harmonic_shift", "harmonic_order"), report)
        teeth = {name: getattr(gear, name) if gear else 1
                 for name in ("pinion_teeth", "gear_teeth")}
        table = file_table(keys.file, path.parent, teeth, fit, reader.places["file"],
                           report)
        if table is not None:
            _warn_of_sign(table, reader, report)
        return table
    if keys.parabola_amplitude is not None:
        _refuse_without(reader, "harmonic_amplitude", ("harmonic_shift", "harmonic_order"), report)
        return formula_table({"parabola_amplitude": keys.parabola_amplitude},
                             reader.places["parabola_amplitude"], report)
    return _harmonics(reader, report)


def _refuse_without(reader: _GroupReader, owner: str, names: tuple[str, str],
                    report: Report) -> None:
    for name in names:
        if name in reader.places and owner not in reader.places:
            report.add(reader.key_places[name], f"{name} goes with {owner} only")


def _harmonics(reader: _GroupReader, report: Report) -> Table | None:
    keys = reader.keys
    n = len(keys.harmonic_amplitude)
    orders = list(range(1, n + 1)) if keys.harmonic_order is None else keys.harmonic_order
    shifts = [0.0] * n if keys.harmonic_shift is None else keys.harmonic_shift
    good = True
    for name, values in (("harmonic_shift", shifts), ("harmonic_order", orders)):
        if len(values) != n:
            good = False
            report.add(reader.places[name], f"{name} has {len(values)} values, harmonic_amplitude "
                                            f"has {n}; expected as many")
    if len(set(orders)) != len(orders):
        good = False
        report.add(reader.places["harmonic_order"], "harmonic_order: expected each order once")
    if not good:
        return None
    return formula_table({"harmonic_amplitude": [float(a) for a in keys.harmonic_amplitude],
                          "harmonic_shift": [float(s) for s in shifts],
                          "harmonic_order": [float(o) for o in orders]},
                         reader.places["harmonic_amplitude"], report)


def _warn_of_sign(table: Table, reader: _GroupReader, report: Report) -> None:
    if table.from_pairs and reader.keys.te_sign != "geometric":
        given = "te_sign" in reader.places
        place = reader.places["te_sign" if given else "file"]
        how = "is 'printed'" if given else "is not given and taken as 'printed'"
        report.add(place, f"{table.keys['file'].name} holds angle pairs, for which geometry says "
                          f"te_sign = 'geometric'; te_sign {how}", warning=True)


class Studies:
    """Turns groups into studies, each checked as the driver would check it.

    Attributes
    ----------
    operation : dict, what &operation, &scene and te_sign give
    report : Report
    pair : GearPair or None
    ready : bool, whether oscillators can be built: nothing they need was refused
    folder : Path, of the deck
    models : dict of name -> group reader, of groups that are no studies
    curve : TransmissionErrorKeys or None
    teeth, fit : dict, what reading a file of the transmission error needs, and how it is fitted
    draws : dict of parameter -> (its group, Draw)
    draws_refused : bool, whether there are others that were refused
    """

    def __init__(self, settings: dict[str, Any], models: dict[str, _GroupReader],
                 pair: GearPair | None, table: Table | None, report: Report,
                 folder: Path) -> None:
        self.folder = folder
        self.draws: dict[str, tuple[str, Draw]] = {}
        self.draws_refused = False
        self._settings, self.models, self.report = settings, models, report
        self.pair: Any = pair  # a GearPair wherever oscillators can be built
        self._refused = any(keys is None for keys in settings.values())
        self.operation = {} if self._refused else {
            **_given(settings["operation"], schema.OPERATION),
            **settings["scene"].model_dump(),
            "te_sign": settings["transmission_error"].te_sign}
        curve = settings["transmission_error"]
        self.curve = curve
        gear = settings["gear_pair"]
        self.teeth = {name: getattr(gear, name) if gear else 1
                      for name in ("pinion_teeth", "gear_teeth")}
        self.fit = table.fit if table is not None else {}
        self.ready = not self._refused and pair is not None and table is not None
        self._te: Any = self._table(table) if self.ready and table is not None else None

    def _table(self, table: Table) -> TransmissionError:
        """The table where its shape is checked, else a stand-in."""
        scene = self._settings["scene"]
        return flat() if scene.back_flank_te or scene.gap == "one_flank" else table.build()

    @property
    def start_phase(self) -> float:
        """Mesh phase at which runs start."""
        numerics = self._settings["numerics"]
        return float(numerics.start_phase) if numerics else 0.0

    def build(self, reader: _GroupReader) -> Asked | None:
        """The study of one group as `Asked`, or None."""
        asked: Asked | None = reader.keys and reader.keys.build(self, reader)
        return asked

    def rtol(self, reader: _GroupReader) -> float:
        """Tolerance of a study: its own, that of &numerics, or the default."""
        numerics = self._settings["numerics"]
        given = getattr(reader.keys, "rtol", None) or (numerics.rtol if numerics else None)
        return float(given or reader.keys.default_rtol)

    def own_operation(self, keys: BasinsKeys | CriticalKeys | EnsembleKeys
                      | ResponseKeys) -> dict[str, Any]:
        """The operation with what a study sets itself; its speed, however given, replaces all."""
        own = _given(keys, schema.OPERATION)
        operation = self.operation
        if own.keys() & set(schema.SPEEDS):
            operation = {k: v for k, v in operation.items() if k not in schema.SPEEDS}
        return {**operation, **own}

    def oscillator(self, reader: _GroupReader, pair: GearPair, operation: dict[str, Any],
                   te: TransmissionError | None = None) -> Oscillator | None:
        """The oscillator, or None: what is missing is said here, the rest by the driver."""
        complete = self._complete(reader, operation)
        if not complete:
            return None
        try:
            oscillator = pair.oscillator(te or self._te, **operation)
            self._check_method(oscillator)
            return oscillator
        except (ValueError, ArithmeticError) as error:
            readers = [*(self.models[name] for name in self.models), reader]
            _relay(error, readers, self.report)
        return None

    def _check_method(self, oscillator: Oscillator) -> None:
        numerics = self._settings["numerics"]
        if numerics and numerics.method == "exact" and oscillator.degrees_of_freedom == 2:
            raise ValueError("method = 'exact' goes with degrees_of_freedom = 1, expected 'rk4' or "
                             "'auto'")

    def _complete(self, reader: _GroupReader, operation: dict[str, Any]) -> bool:
        where = self.models["operation"].place if "operation" in self.models else reader.place
        lacking = [] if operation.get("brake_torque") is not None else ["brake_torque"]
        speeds = [name for name in schema.SPEEDS if operation.get(name) is not None]
        if not speeds:
            lacking.append("one of " + ", ".join(schema.SPEEDS))
        for what in lacking:
            self.report.add(where, f"&operation lacks {what}, which &{reader.name} "
                                    f"'{reader.keys.name}' needs")
        return not lacking

    def draw(self, readers: list[_GroupReader]) -> None:
        """Take the &draw groups."""
        for reader in readers:
            found = reader.keys and reader.keys.draw(self, reader)
            if found:
                self.draws[found[0]] = found[1:]
            else:
                self.draws_refused = True

    def parameter(self, reader: _GroupReader, name: str, place: Place | None = None,
                  word: str = "parameter") -> str | None:
        """Group of a number that is varied, or None; `word` is what `place` holds."""
        return parameter_group(self, reader, name, place, word)

    def check_values(self, reader: _GroupReader, name: str, group: str,
                     values: NDArray[Any]) -> None:
        """Every value against the range of the parameter's own key."""
        wrong = out_of_range(name, group, values)
        if wrong is not None:
            place = reader.places.get("values") or reader.places["from"]
            self.report.add(place, f"{parameter_text(name)} = {wrong:g} among the values, expected "
                                   f"{expected(name, group)}")

    def check_drawn(self, reader: _GroupReader, name: str, group: str, draw: Draw) -> None:
        """What can be drawn against the range of the parameter's own key, and the other draws."""
        check_drawn(self, reader, name, group, draw)

    def check_ends(self, reader: _GroupReader, varied: dict[str, tuple[str, Any]],
                   operation: dict[str, Any], tables: Mapping[str, Table] = EMPTY) -> None:
        """Force is monotonic in each parameter: what holds at the ends holds between them.

        `varied` are (group, values) by parameter; of several every combination of ends is tried, of
        curves each (`tables`, by label).
        """
        for ends in product(*(values if name == CURVE else {values[0], values[-1]}
                              for name, (_, values) in varied.items())):
            pair, at, te, amplitudes = self.pair, operation, self._te, {}
            for (name, (group, _)), value in zip(varied.items(), ends, strict=True):
                number = term(name)
                if group == "operation":
                    at = {**at, name: float(value)}
                elif name == "parabola_amplitude":
                    at = {**at, "te_scale": at.get("te_scale", 1.0) * float(value)
                          / self.curve.parabola_amplitude}
                elif self.report.refusals:
                    return
                elif name == CURVE:
                    te = self._table(tables[str(value)])
                elif number is not None:
                    amplitudes[number] = float(value)
                else:
                    pair = replace(pair, **{name: float(value)})
            if len(te.harmonics):  # else a stand-in
                te = with_amplitudes(te, amplitudes)
            oscillator = self.oscillator(reader, pair, at, te)
            if oscillator is None:
                return
            if oscillator.force < 0 and oscillator.gap == "one_flank" \
                    and reader.name in ("sweep", "map", "ensemble", "branches"):
                self.report.add(reader.place, "starts from rest with a negative force need a "
                                               "coast flank to rest on")


def _given(keys: BasinsKeys | CriticalKeys | EnsembleKeys | OperationKeys | ResponseKeys,
           names: tuple[str, ...]) -> dict[str, float]:
    """Those of the named keys that are not None."""
    return {name: getattr(keys, name) for name in names if getattr(keys, name) is not None}
