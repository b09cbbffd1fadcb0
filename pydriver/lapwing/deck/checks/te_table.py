"""The transmission error as a deck gives it: checked at once, built when it is wanted.

Building needs SciPy, whose import takes longer than everything else that checking a deck does.
So a table is built early only where building could still fail or its shape enters a check.
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from lapwing.base.messages import cut
from lapwing.deck.checks.curve import curve_problem, samples_of
from lapwing.deck.problems import Place
from lapwing.model.transmission_error import TransmissionError
from lapwing.model.transmission_error.file import TransmissionErrorFileError, read_columns

if TYPE_CHECKING:
    from lapwing.deck.problems import Report
    from lapwing.model.curve.fit import CurveFit

# Within these bounds every constructor of TransmissionError is known to succeed.
_PLAIN_VALUES = (1e-12, 1e3)
_PLAIN_SPACING = 1e-6


@dataclass(frozen=True)
class Table:
    """What &transmission_error says.

    Attributes
    ----------
    keys : dict, the data: `file` and what reading it needs, or the parameters of a formula
    digest : str, SHA-256 of the data themselves: spelling, comments and place of a file do not
        enter
    from_pairs : bool, whether the table comes from angle pairs
    extent : float, rad; greatest less least of the data themselves, not of a curve through them
    sampled : bool, whether it comes from samples without slopes
    fit : dict, how a curve is fitted to samples (`curve.curve_options`); empty: not at all
    """

    keys: dict[str, Any]
    digest: str
    from_pairs: bool = False
    extent: float = 0.0
    sampled: bool = False
    fit: dict[str, Any] = field(default_factory=dict)

    def build(self) -> TransmissionError:
        """The `TransmissionError`; ValueError where it cannot be made."""
        keys = self.keys
        if self.fit:
            return self.curve().te
        if "file" in keys:
            return TransmissionError.from_file(**{"path": keys["file"], **keys["teeth"]})
        if "parabola_amplitude" in keys:
            return TransmissionError.parabola(keys["parabola_amplitude"])
        return TransmissionError.harmonic(
            keys["harmonic_amplitude"], keys["harmonic_shift"], keys["harmonic_order"])

    def samples(self) -> tuple[NDArray[Any], NDArray[Any], NDArray[Any]] | None:
        """(phase, value, kinks 0/1) of the file; None where there are no samples."""
        if not self.sampled:
            return None
        columns, _ = read_columns(self.keys["file"], **self.keys["teeth"])
        return samples_of(columns, self.keys["teeth"])

    def curve(self) -> CurveFit:
        """The `CurveFit` asked for."""
        from lapwing.model.curve.fit import fit_curve

        samples = self.samples()
        assert samples is not None  # what cannot be fitted is refused where it is read
        return fit_curve(*samples, harmonics=self.fit["harmonics"],
                         noise_level=self.fit["noise_level"],
                         te_sign_hint="geometric" if self.from_pairs else "printed")


def flat() -> TransmissionError:
    """A stand-in for checks that do not depend on the table."""
    return TransmissionError(np.array([0.0, 1.0]), np.zeros((1, 6)), np.zeros(1, dtype=bool))


def file_table(name: str, folder: Path, teeth: dict[str, int], fit: dict[str, float | None] | None,
               place: Place, report: Report, key: str = "file") -> Table | None:
    """Table of a CSV file relative to `folder`, or None; its problems go to `report`.

    `fit` is how its samples are fitted, or None; `key` the key that names it.
    """
    path = Path(folder, name)
    try:
        columns, problems = read_columns(path, **teeth)
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or error
        report.add(place, f"{key} = {cut(name, 100)!r} cannot be read: {reason}")
        return None
    if problems:
        _report(path, problems, report)
        return None
    pairs = "gear_angle" in columns
    curve = columns["gear_angle"] - teeth["pinion_teeth"] / teeth["gear_teeth"] \
        * columns["pinion_angle"] if pairs else columns["transmission_error"]
    sampled = not any(name.startswith("slope") for name in columns)
    table = Table({"file": path, "teeth": teeth}, _digest(columns), pairs, float(np.ptp(curve)),
                  sampled, fit or {})
    if fit and not pairs:
        problem = curve_problem(samples_of(columns, teeth), fit)
        if problem:
            report.add(place, f"{path.name} cannot be fitted: {problem}")
            return None
    if _plain(columns) or _builds(table, Place(str(path)), report):
        return table
    return None


def formula_table(keys: dict[str, Any], place: Place, report: Report) -> Table | None:
    """Table of a parabola or of harmonics, or None; its problems go to `report`."""
    given: Any = keys.get("harmonic_amplitude", keys.get("parabola_amplitude"))
    amplitudes = np.abs(np.atleast_1d(given)).astype(float)
    table = Table(keys, _digest(keys), extent=_extent(keys))
    if np.all((amplitudes == 0) | (amplitudes > _PLAIN_VALUES[0])) \
            or _builds(table, place, report):
        return table
    return None


def _extent(keys: dict[str, Any]) -> float:
    """From peak to peak: of the parabola, or of the series at even phases."""
    if "parabola_amplitude" in keys:
        return abs(float(keys["parabola_amplitude"]))
    phase = 2 * np.pi * np.arange(1024) / 1024
    return float(np.ptp(sum(amplitude * np.cos(order * phase + shift) for amplitude, shift, order
                            in zip(keys["harmonic_amplitude"], keys["harmonic_shift"],
                                   keys["harmonic_order"], strict=True))))


def _plain(columns: dict[str, NDArray[Any]]) -> bool:
    """Whether building a table of these columns is known to succeed."""
    if "gear_angle" in columns:
        return False
    values = np.abs(np.concatenate([column for name, column in columns.items()
                                    if name not in ("phase", "kink")]))
    phase = columns["phase"]
    spacing = np.diff(phase, append=phase[0] + 1).min()
    enough = phase.size >= 3 or any(name.startswith("slope") for name in columns)
    return enough and values.max() < _PLAIN_VALUES[1] and spacing > _PLAIN_SPACING


def _builds(table: Table, place: Place, report: Report) -> bool:
    try:
        with np.errstate(all="ignore"):
            table.build()
    except TransmissionErrorFileError as error:
        _report(error.path, error.problems, report)
    except (ValueError, ArithmeticError, np.linalg.LinAlgError) as error:
        report.add(place, f"the transmission error cannot be made: {error}")
    else:
        return True
    return False


def _report(path: Path, problems: Any, report: Report) -> None:
    for line, column, text in problems:
        report.add(Place(str(path), line, column), text)


def _digest(numbers: dict[str, NDArray[Any]]) -> str:
    """Of numbers or arrays by name; -0.0 is 0.0."""
    total = hashlib.sha256()
    for name, value in numbers.items():
        data = (np.asarray(value, dtype="<f8") + 0.0).astype("<f8").tobytes()
        total.update(f"{name}:{len(data)}:".encode() + data)
    return total.hexdigest()
