"""Checks of the keys that fit a curve to measured samples, and the fit they lead to."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from lapwing.model.curve.basis import fit_problem
from lapwing.model.transmission_error.samples import samples_of_pairs

if TYPE_CHECKING:
    from lapwing.deck.load import _GroupReader
    from lapwing.deck.problems import Report

KEYS = ("harmonics", "smoothing", "noise_level", "curve_repeats")
# Other curves on which searches are repeated where the deck says nothing: the least and the
# greatest of so many results span 95 %.
REPEATS = 39


def curve_options(reader: _GroupReader, report: Report) -> dict[str, float | None] | None:
    """How the deck wants its samples fitted.

    Parameters
    ----------
    reader : group reader (`load`) of &transmission_error
    report : Report

    Returns
    -------
    dict of harmonics (None: smoothing), noise_level and curve_repeats; None where no fit is asked
    for, or a wrong one
    """
    keys = reader.keys
    wanted = keys.smoothing or keys.harmonics is not None
    good = True
    for name in KEYS:
        if name not in reader.places or (name == "smoothing" and not keys.smoothing):
            continue
        if keys.file is None:
            good = False
            report.add(reader.key_places[name], f"{name} fits the samples of a file; expected file")
        elif not wanted:
            good = False
            report.add(reader.key_places[name],
                       f"{name} goes with harmonics or smoothing = .true. only")
    if keys.smoothing and keys.harmonics is not None:
        good = False
        report.add(reader.key_places["smoothing"], "harmonics and smoothing are both given; "
                                                   "expected one of them")
    if keys.curve_repeats is not None and 0 < keys.curve_repeats < REPEATS:
        good = False
        report.add(reader.places["curve_repeats"],
                   f"curve_repeats = {keys.curve_repeats}, expected 0 or at least {REPEATS}: fewer "
                   "span no 95 %")
    if not wanted or not good:
        return None
    repeats = REPEATS if keys.curve_repeats is None else keys.curve_repeats
    return {"harmonics": keys.harmonics, "noise_level": keys.noise_level, "curve_repeats": repeats}


def samples_of(columns: dict[str, NDArray[Any]],
               teeth: dict[str, int]) -> tuple[NDArray[Any], NDArray[Any], NDArray[Any]] | None:
    """(phase, value, kinks 0/1) of a file's columns, or None where they hold slopes.

    Raises
    ------
    ValueError
        where angle pairs are no mesh period.
    """
    if "gear_angle" in columns:
        return samples_of_pairs(columns["pinion_angle"], columns["gear_angle"],
                                teeth["pinion_teeth"], teeth["gear_teeth"])
    if any(name.startswith("slope") for name in columns):
        return None
    kinks = columns.get("kink")
    return (columns["phase"], columns["transmission_error"],
            np.zeros(columns["phase"].size) if kinks is None else kinks)


def curve_problem(samples: tuple[NDArray[Any], NDArray[Any], NDArray[Any]] | None,
                  options: dict[str, Any]) -> str | None:
    """Why the samples cannot be fitted as asked, or None."""
    if samples is None:
        return "the file gives slopes, which only an exact curve has; expected samples alone"
    phase, _, kinks = samples
    order = options["harmonics"]
    problem = fit_problem(phase, phase[kinks == 1], 1 if order is None else order)
    return problem and problem + "; expected fewer" * (order is not None)
