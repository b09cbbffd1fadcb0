"""What the noise of a measured transmission error leaves unknown of a critical value."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from lapwing.base.registry import STUDIES
from lapwing.deck.declare import SPEEDS
from lapwing.model.curve.fit import fit_curve
from lapwing.model.curve.interval import (
    CONFIDENCE,
    force_bounds,
    forces_by_order,
    needed_force,
    on_curve,
    repeat_interval,
    share_of_high_orders,
)
from lapwing.model.linear_response import CriticalForce
from lapwing.model.oscillator import ParameterError
from lapwing.studies.critical.force import of_force
from lapwing.studies.sweep.varied import TORQUES, oscillator_at

if TYPE_CHECKING:
    import xarray as xr

    from lapwing.deck.deck import Asked, Deck
    from lapwing.model.oscillator import Oscillator

# Draws where each of many values needs its own bounds.
_FEWER_DRAWS = 199

DESCRIPTIONS = {
    "fit_order": ("1", "highest order of the curve fitted to the samples"),
    "fit_estimate": (None, "critical value by highest order of the curve"),
    "fit_low": (None, "lower end of its 95 % interval"),
    "fit_high": (None, "upper end of its 95 % interval"),
    "fit_noise": ("rad", "standard deviation of a sample by the residuals of that fit"),
    "fit_gcv": ("rad2", "generalised cross-validation of that fit"),
    "repeat_value": (None, "critical value of other curves that such samples might give")}


def with_interval(found: xr.Dataset, deck: Deck, study: Asked) -> xr.Dataset:
    """A force-balance search with the interval of a fitted curve, and against its orders.

    Parameters
    ----------
    found : xarray.Dataset of `critical_full` or `critical_on`
    deck : lapwing.deck.Deck
    study : lapwing.deck.Critical

    Returns
    -------
    xarray.Dataset with the attributes low and high (of the parameter; NaN beyond the values
    searched), confidence, curve ('harmonics', 'smoothing' or, raw, 'samples'), high_order_share
    and high_order_above; along a torque over `fit_order` the same against the highest order
    """
    if study.parameter in TORQUES:
        osc = oscillator_at(deck.gear_pair, deck.te, study.parameter, 0.0, study.operation)
    else:
        osc = oscillator_at(deck.gear_pair, deck.te, study.parameter, float(study.values[0]),
                            study.operation)
    found = found.assign_attrs(high_orders(deck, osc))
    if deck.curve is None:
        return found
    low, high = interval(deck, study.find, study.parameter, study.operation, study.values,
                         study.safe_end)
    found = found.assign_attrs(low=low, high=high, confidence=CONFIDENCE)
    if study.parameter not in TORQUES or found.attrs["outcome"] != "found":
        return found
    return _against_order(found, deck, study, osc)


def high_orders(deck: Deck, osc: Oscillator) -> dict[str, Any]:
    """What of a measured curve's critical force rests on its highest orders.

    Returns
    -------
    dict of curve ('harmonics', 'smoothing', 'samples'), high_order_share (NaN: not known) and, of a
    fit, high_order_above; empty where the table is none of samples
    """
    curve, table = deck.curve, deck.te_table
    if curve is not None:
        share, above = share_of_high_orders(osc, curve)
        return {"curve": curve.method, "high_order_share": share, "high_order_above": above}
    if not table.sampled:
        return {}
    return {"curve": "samples", "high_order_share": raw_share(osc, *table.samples())}


def high_orders_of(deck: Deck) -> dict[str, Any]:
    """The same at the deck's operating point; what it leaves to its studies is the first one's."""
    if deck.curve is None and not deck.te_table.sampled:
        return {}
    operation = dict(deck.operation)
    if not operation.keys() & set(SPEEDS):
        first = next(asked for kind in STUDIES for asked in deck.studies[kind])
        operation |= first.operation
        if getattr(first, "group", None) == "operation":
            operation[first.parameter] = 1.0 if first.values is None else float(first.values[0])
    operation.setdefault("brake_torque", 1.0)
    return high_orders(deck, deck.gear_pair.oscillator(deck.te, **operation))


def raw_share(osc: Oscillator, phase: NDArray[Any], value: NDArray[Any],
              kinks: NDArray[Any]) -> float:
    """How much of the force that raw samples lead to a smoothing spline takes away; NaN: unknown.

    Of exact samples next to nothing.
    """
    force = needed_force(osc)[0]
    try:
        smooth = fit_curve(phase, value, kinks).te
    except ValueError:  # too few samples, or too uneven
        return math.nan
    without = needed_force(on_curve(osc, smooth))[0]
    known = math.isfinite(force) and math.isfinite(without) and force != 0
    return abs(force - without) / abs(force) if known else math.nan


def interval(deck: Deck, find: str, parameter: str, operation: dict[str, Any],
             values: NDArray[Any] | None = None, safe_end: str = "high") -> tuple[float, float]:
    """Ends of the 95 % interval of a critical value; NaN where one is beyond the values searched.

    The critical value of the lower and of the upper limit of the force that contact needs.
    """
    known, draws = {}, {} if parameter in TORQUES else {"draws": _FEWER_DRAWS}

    def bound(name: str) -> Callable[..., Any]:
        def criterion(osc: Oscillator) -> CriticalForce:
            key = (osc.mesh_frequency_ratio, osc.damping_ratio, osc.flank_scale, osc.restitution)
            if key not in known:
                assert deck.curve is not None  # asked for with a curve alone
                known[key] = force_bounds(osc, deck.curve, **draws)
            return CriticalForce(getattr(known[key], name), known[key].phase)
        return criterion

    ends = [of_force(find, bound(name), deck.gear_pair, deck.te, parameter, values, safe_end,
                     operation).attrs["estimate"] for name in ("low", "high")]
    low, high = ends if safe_end == "high" else ends[::-1]
    return low, high


def _against_order(found: xr.Dataset, deck: Deck, study: Asked, osc: Oscillator) -> xr.Dataset:
    """The critical value and its interval by the highest order of an unsmoothed fit."""
    assert deck.curve is not None  # asked for with a curve alone
    table = forces_by_order(osc, deck.curve)
    unit = oscillator_at(deck.gear_pair, deck.te, study.parameter, 1.0, study.operation)
    columns = {name: (table[force] - osc.force) / (unit.force - osc.force) for name, force in (
        ("fit_low", "low"), ("fit_estimate", "force"), ("fit_high", "high"))}
    columns |= {"fit_noise": table["noise"], "fit_gcv": table["gcv"]}
    found = found.assign({name: ("fit_order", column) for name, column in columns.items()})
    return _described(found.assign_coords(fit_order=table["order"].astype(np.int32)))


def first_of(deck: Deck, study: Asked, done: Callable[..., Any]) -> Callable[..., Any]:
    """Progress of the search itself where repeats follow it."""
    many = 1 + _repeats(deck, study)
    return lambda fraction: done(fraction / many)


def _repeats(deck: Deck, study: Asked) -> int:
    curve = deck.te_table.fit
    return curve.get("curve_repeats", 0) if study.find == "safe" else 0


def with_repeats(found: xr.Dataset, deck: Deck, study: Asked, search: Callable[..., Any],
                 done: Callable[..., Any] | None = None) -> xr.Dataset:
    """A search with the same search on other curves that samples with this noise might give.

    Parameters
    ----------
    found : xarray.Dataset of `critical_safe`
    deck, study : as for `with_interval`
    search : callable(te, progress), giving such a Dataset
    done : callable(fraction) or None

    Returns
    -------
    xarray.Dataset with repeat_value over `repeat` (NaN: none found in the range, or no
    motion on this curve) and the
    attributes low and high, `interval.repeat_interval` and half a bracket on either side; as it was
    where there are no repeats
    """
    many = _repeats(deck, study)
    if not many or deck.curve is None:
        return found
    values = np.full(many, np.nan)
    for i, te in enumerate(deck.curve.repeats(many)):
        part = done and (lambda fraction, i=i: done((1 + i + fraction) / (1 + many)))
        with contextlib.suppress(ParameterError):  # a curve beyond a coast flank that stands still
            values[i] = search(te, part).attrs["estimate"]
    low, high = repeat_interval(found.attrs["estimate"], values)
    bar = found.attrs["bar"]  # what lies within a bracket is not told apart
    return _described(found.assign(repeat_value=("repeat", values)).assign_attrs(
        low=low - bar, high=high + bar, confidence=CONFIDENCE, curve=deck.curve.method))


def _described(dataset: xr.Dataset) -> xr.Dataset:
    for name in set(DESCRIPTIONS) & set(map(str, dataset.variables)):
        units, long_name = DESCRIPTIONS[name]
        dataset[name].attrs = {"long_name": long_name,
                               "units": dataset.attrs["units"] if units is None else units}
    return dataset
