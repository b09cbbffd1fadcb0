"""Numbers far outside of what gears have: most likely in another unit, which is named.

The bands are so wide that no gear known to the authors lies outside of one; they refuse nothing.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from lapwing.deck.checks.te_table import Table
    from lapwing.deck.deck import Deck
    from lapwing.deck.load import _GroupReader
    from lapwing.deck.problems import Report
    from lapwing.model.gear_pair import GearPair

MILLIMETRE, DEGREE = 1e-3, math.pi / 180


class Band(NamedTuple):
    """What a quantity may be without a word, and what it usually is, in its own unit.

    Attributes
    ----------
    low, high : float, outside of them there is a warning
    usual : (low, high), where a number read in another unit must lie for that unit to be named
    unit : str
    others : tuple of (unit, factor to the own unit), the likeliest first
    """

    low: float
    high: float
    usual: tuple[float, float]
    unit: str
    others: tuple[tuple[str, float], ...]


_INERTIA = Band(1e-7, 500.0, (1e-5, 10.0), "kg·m²",
                (("kg·mm²", 1e-6), ("g·cm²", 1e-7), ("kg·cm²", 1e-4), ("g·mm²", 1e-9)))
BANDS = {
    "pinion_inertia": _INERTIA, "gear_inertia": _INERTIA,
    "pinion_base_lever": Band(2e-3, 2.0, (5e-3, 0.5), "m",
                              (("mm", MILLIMETRE), ("cm", 0.01), ("inches", 0.0254))),
    "mesh_stiffness": Band(2e6, 1e12, (1e7, 1e10), "N/m",
                           (("N/mm", 1e3), ("N/µm", 1e6), ("kN/mm", 1e6))),
    "backlash": Band(1e-5, 0.05, (2e-4, 0.02), "rad",
                     (("degrees", DEGREE), ("mrad", 1e-3), ("arcmin", DEGREE / 60)))}
# Of the transmission error from peak to peak; nothing at all is a curve like any other.
CURVE = Band(1e-8, 5e-3, (2e-6, 1e-3), "rad",
             (("mrad", 1e-3), ("µrad", 1e-6), ("arcsec", DEGREE / 3600), ("arcmin", DEGREE / 60),
              ("degrees", DEGREE)))
# Units named at most.
GUESSES = 2


def warn_of_units(pair_reader: _GroupReader | None, curve_reader: _GroupReader | None,
                  table: Table | None, report: Report) -> None:
    """Warn of numbers of the gear pair and of the curve that look like another unit.

    Parameters
    ----------
    pair_reader, curve_reader : group readers (`load`) of &gear_pair and &transmission_error, with
        valid keys, or None
    table : lapwing.deck.checks.te_table.Table or None
    report : Report
    """
    said = False
    if pair_reader is not None and pair_reader.keys is not None:
        for key, band in BANDS.items():
            text = outside(getattr(pair_reader.keys, key), band)
            if text and key in pair_reader.places:
                said = True
                report.add(pair_reader.places[key], f"{key} = {text}", warning=True)
    if table is None or curve_reader is None or curve_reader.keys is None:
        return
    key = next(one for one in ("file", "parabola_amplitude", "harmonic_amplitude")
               if getattr(curve_reader.keys, one) is not None)
    text = outside(table.extent, CURVE)
    if text:
        report.add(curve_reader.places[key], "the transmission error from peak to peak is "
                   + text, warning=True)
    elif not said and pair_reader is not None and pair_reader.keys is not None:
        keys = pair_reader.keys
        share = keys.gear_teeth / keys.pinion_teeth * table.extent / keys.backlash
        if share > 1:
            report.add(curve_reader.places[key], "the transmission error, at the pinion, is "
                       f"{share:.3g} times as large as the backlash from peak to peak: is one of "
                       "them in another unit?", warning=True)


def outside(value: float, band: Band) -> str:
    """What is odd about a number, and in which unit it would not be; empty where nothing is."""
    if value == 0 or band.low <= value <= band.high:
        return ""
    guesses = [f"{unit} ({value * factor:.3g} {band.unit})" for unit, factor in band.others
               if band.usual[0] <= value * factor <= band.usual[1]][:GUESSES]
    text = f"{value:g} {band.unit}, outside of the usual {band.low:g} to {band.high:g} {band.unit}"
    return text + (f"; if it is in {' or '.join(guesses)}, convert it" if guesses
                   else ": is the unit right?")


def magnitudes(deck: Deck) -> str:
    """Numbers in which a slip of a unit shows, in words, for `check`.

    Parameters
    ----------
    deck : lapwing.deck.Deck

    Returns
    -------
    str
    """
    pair, extent = deck.gear_pair, deck.te.peak_to_peak
    share = pair.gear_ratio * extent / pair.backlash
    deflection = pair.force_per_torque
    parts = [f"transmission error {1e6 * extent:.4g} µrad ({extent / DEGREE * 3600:.4g} arcsec) "
             f"peak to peak, at the pinion {share:.3g} of the backlash",
             f"static deflection {1e6 * deflection:.4g} µrad "
             f"({1e6 * deflection * pair.pinion_base_lever:.3g} µm at the teeth) per N·m of "
             "braking torque"]
    full = _full_engagement(deck)
    return "; ".join(parts + ([full] if full else []))


def _full_engagement(deck: Deck) -> str:
    """T_full at the speed of the deck, in words; empty where there is none."""
    from lapwing.model.linear_response import critical_force

    operation = {key: value for key, value in deck.operation.items() if key != "brake_torque"}
    if operation["contact_law"] == "rigid":
        return ""
    try:
        rest, unit = (deck.gear_pair.oscillator(deck.te, brake_torque=torque, **operation)
                      for torque in (0.0, 1.0))
        needed = critical_force(rest).force
    except ValueError:  # no speed of its own, or an undamped resonance
        return ""
    torque = (needed - rest.force) / (unit.force - rest.force)
    return f"T_full = {torque:.4g} N·m" if np.isfinite(torque) else ""


def warn_of_torques(reader: _GroupReader, pair: GearPair, operation: dict[str, Any],
                    values: NDArray[Any] | None, report: Report) -> None:
    """Say what is done with torques that press on the coast flank.

    Parameters
    ----------
    reader : reader of &operation or of a study
    pair : GearPair
    operation : dict, with brake_torque or, where `values` are given, without
    values : array (n,) of braking torques, or None
    report : Report
    """
    torques = [operation.get("brake_torque")] if values is None else values
    negative = [torque for torque in torques if torque is not None
                and pair.force(float(torque), operation.get("drive_torque")) < 0]
    keys = ("brake_torque", "drive_torque") if values is None else ("values", "from")
    place = next((reader.places[key] for key in keys if key in reader.places), None)
    if not negative or place is None:
        return
    what = f"brake_torque = {negative[0]:g}" if values is None else \
        f"{len(negative)} of {len(torques)} braking torques (down to {negative[0]:g})"
    verb = "presses" if values is None or len(negative) == 1 else "press"
    report.add(place, f"{what} {verb} the teeth on the coast flank, where a start from rest "
                      "begins; T_full and T_safe are those of the drive flank", warning=True)


def warn_of_order(reader: _GroupReader, report: Report) -> None:
    """Say what is done with a range that runs downwards."""
    keys = reader.keys
    for low, high in zip(keys.from_ or (), keys.to or (), strict=False):
        if low > high:
            other = "safe_end says from which end the search begins" \
                if reader.name == "critical" else \
                "the start 'down' carries motions from the highest to the lowest"
            report.add(reader.places["from"], f"from {low:g} to {high:g} runs downwards; values "
                       f"are taken in rising order, and {other}", warning=True)
