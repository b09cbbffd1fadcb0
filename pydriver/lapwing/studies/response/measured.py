"""What the noise of a measured transmission error leaves unknown of a motion."""

from __future__ import annotations

import math
from collections import Counter
from typing import TYPE_CHECKING

import numpy as np

from lapwing.base.codes import Status
from lapwing.engine import Numerics
from lapwing.model.curve.interval import repeat_interval
from lapwing.model.oscillator import ParameterError
from lapwing.studies.response.run import Motion, motion_of

if TYPE_CHECKING:
    import xarray as xr

    from lapwing.deck.deck import Asked, Deck
    from lapwing.model.transmission_error.table import TransmissionError

# Numbers of a response that are found again on other curves.
NUMBERS = ("impacts_per_cycle", "deepest_separation")


def with_repeats(found: xr.Dataset, deck: Deck, study: Asked) -> xr.Dataset:
    """A response with its motion on other curves that samples with the same noise might give.

    Parameters
    ----------
    found : xarray.Dataset of `response`
    deck : lapwing.deck.Deck
    study : lapwing.deck.Response

    Returns
    -------
    xarray.Dataset with repeat_class ('failed' where a run failed, or
    a curve reaches beyond a coast flank that stands still), repeat_impacts_per_cycle and
    repeat_deepest_separation (rad) over `repeat`, and the attributes curve_repeats, repeat_classes
    (how many lead to which class, in words) and X_low and X_high of both numbers
    (`repeat_interval`); as it was where there are no repeats
    """
    many = deck.te_table.fit.get("curve_repeats", 0)
    if not many or deck.curve is None or found.attrs["status"] != Status.OK:
        return found
    motions = [_motion_on(te, deck, study) for te in deck.curve.repeats(many)]
    classes = Counter(one.motion_class for one in motions)
    words = ", ".join(f"{name} on {count}" for name, count in sorted(
        classes.items(), key=lambda item: (-item[1], item[0])))
    found = found.assign_attrs(curve_repeats=many, repeat_classes=words).assign(
        repeat_class=("repeat", np.array([one.motion_class for one in motions], dtype=object)))
    found = found.assign({f"repeat_{name}": ("repeat", np.array(
        [getattr(one, name) for one in motions])) for name in NUMBERS})
    for name in NUMBERS:
        low, high = repeat_interval(found.attrs[name], found[f"repeat_{name}"].values)
        found = found.assign_attrs({f"{name}_low": max(low, 0.0), f"{name}_high": high})
    return found


def _motion_on(te: TransmissionError, deck: Deck, study: Asked) -> Motion:
    """The motion on another curve."""
    try:
        osc = deck.gear_pair.oscillator(te, **study.operation)
    except ParameterError:  # beyond a coast flank that stands still
        return Motion(None, "failed", math.nan, math.nan)
    return motion_of(
        osc, deck.gear_pair, start=study.start, phase=deck.numerics["start_phase"],
        settle_cycles=study.settle_cycles, record_cycles=study.record_cycles,
        max_period=deck.numerics["max_period"], numerics=Numerics(**deck.numerics_of(study)))
