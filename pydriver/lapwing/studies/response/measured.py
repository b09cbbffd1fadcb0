"""What the noise of a measured transmission error leaves unknown of a motion."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING

import numpy as np

from lapwing.base.codes import Status
from lapwing.engine import Numerics
from lapwing.model.curve.interval import repeat_interval
from lapwing.model.oscillator import ParameterError
from lapwing.studies.response.evaluation import Evaluation, Motion
from lapwing.studies.response.mesh_force import sample_phases
from lapwing.studies.response.recording import Pass, Recording
from lapwing.studies.trajectory import checked_start, engine_start

if TYPE_CHECKING:
    import xarray as xr

    from lapwing.deck.deck import Asked, Deck
    from lapwing.model.transmission_error.table import TransmissionError

# Numbers of a response that are found again on other curves.
NUMBERS = ("impacts_per_cycle", "deepest_separation")


def passes_on_repeats(deck: Deck, study: Asked) -> list[Pass | None]:
    """The motion of a response on each other curve that samples with the same noise might give.

    None where a curve reaches beyond a coast flank that stands still; no passes where there are no
    repeats.
    """
    many = deck.te_table.fit.get("curve_repeats", 0)
    if not many or deck.curve is None:
        return []
    return [_pass_on(te, deck, study) for te in deck.curve.repeats(many)]


def with_repeats(found: xr.Dataset, deck: Deck, passes: Sequence[Pass | None],
                 recordings: Iterable[Recording]) -> xr.Dataset:
    """A response with its motion on other curves that samples with the same noise might give.

    Parameters
    ----------
    found : xarray.Dataset of `response`
    deck : lapwing.deck.Deck
    passes : `passes_on_repeats`
    recordings : of the passes there are, one after the other; asked for where `found` is good

    Returns
    -------
    xarray.Dataset with repeat_class ('failed' where a run failed, or
    a curve reaches beyond a coast flank that stands still), repeat_impacts_per_cycle and
    repeat_deepest_separation (rad) over `repeat`, and the attributes curve_repeats, repeat_classes
    (how many lead to which class, in words) and X_low and X_high of both numbers
    (`repeat_interval`); as it was where there are no repeats
    """
    if not passes or found.attrs["status"] != Status.OK:
        return found
    each = iter(recordings)
    motions = [Motion(None, "failed", math.nan, math.nan) if one is None else Evaluation.of(
        one.osc, deck.gear_pair, next(each), deck.numerics["max_period"]).in_short
        for one in passes]
    classes = Counter(one.motion_class for one in motions)
    words = ", ".join(f"{name} on {count}" for name, count in sorted(
        classes.items(), key=lambda item: (-item[1], item[0])))
    found = found.assign_attrs(curve_repeats=len(passes), repeat_classes=words).assign(
        repeat_class=("repeat", np.array([one.motion_class for one in motions], dtype=object)))
    found = found.assign({f"repeat_{name}": ("repeat", np.array(
        [getattr(one, name) for one in motions])) for name in NUMBERS})
    for name in NUMBERS:
        low, high = repeat_interval(found.attrs[name], found[f"repeat_{name}"].values)
        found = found.assign_attrs({f"{name}_low": max(low, 0.0), f"{name}_high": high})
    return found


def _pass_on(te: TransmissionError, deck: Deck, study: Asked) -> Pass | None:
    """The motion on another curve: one run, few samples."""
    try:
        osc = deck.gear_pair.oscillator(te, **study.operation)
    except ParameterError:  # beyond a coast flank that stands still
        return None
    phase = deck.numerics["start_phase"]
    start = engine_start(osc, checked_start(osc, study.start, phase))
    return Pass(osc, (*start, phase), (study.settle_cycles + (phase > 0), study.record_cycles),
                sample_phases(osc, 8)[0], Numerics(**deck.numerics_of(study)))
