"""What is known of a measured transmission error and what follows from it, in words."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

from lapwing.report.words import plural
from lapwing.results.curve import SHARE_THAT_DECIDES
from lapwing.results.findings import SYMBOLS

if TYPE_CHECKING:
    import xarray as xr

    from lapwing.model.curve.fit import CurveFit

# Residuals less likely than this do not go with the noise level that was stated.
_UNLIKELY = 1e-3
_ARCSEC = math.pi / 648_000
# Of the table against the highest order; the figure shows the rest.
_ORDERS_TOLD = 8


def curve_source(name: str, curve: CurveFit | None, samples: int | None) -> str:
    """Source of a transmission error in a few words: its file, and what was made of it.

    Parameters
    ----------
    name : str
    curve : lapwing.model.curve.fit.CurveFit or None
    samples : int or None, rows of samples that are used raw
    """
    if curve is not None:
        how = f"harmonics to order {curve.order}" if curve.method == "harmonics" else \
            "a smoothing spline"
        return f"{name}, {curve.phase.size} samples fitted by {how}"
    return f"{name}, {samples} samples used raw" if samples else name


def curve_sentences(attrs: dict[str, Any]) -> list[str]:
    """What was done with samples, and what to beware of.

    Parameters
    ----------
    attrs : attributes of the group `transmission_error`

    Returns
    -------
    list of str, Markdown; empty where the transmission error is not given by samples
    """
    if "curve" not in attrs:
        return []
    return [_how(attrs), *warnings(attrs)]


def warnings(attrs: dict[str, Any]) -> list[str]:
    """What a reader must beware of; attributes as for `curve_sentences`, or of a critical value."""
    found = []
    share, above = attrs.get("high_order_share", math.nan), attrs.get("high_order_above", 0)
    if share > SHARE_THAT_DECIDES and attrs["curve"] == "samples":
        found.append(
            "**The noise may decide**: a smoothing spline of the same samples moves the force that "
            f"contact needs by {_percent(share)}; fit a curve (`harmonics`, `smoothing`).")
    elif share > SHARE_THAT_DECIDES:
        found.append(
            f"**The highest orders decide**: {_percent(share)} of the force that contact needs "
            f"rests on the orders above {above}; compare T_full against the order, and samples "
            "with less noise.")
    if attrs.get("residual_excess", 1.0) < _UNLIKELY:
        found.append(
            "**The residuals do not go with the noise level stated**: orders are missing, or the "
            "samples are noisier or better than it says; the intervals rest on it.")
    return found


def _percent(share: float) -> str:
    return f"{100 * share:.2g} %" if share < 10 else f"{share:.2g} times as much as all"


def _how(attrs: dict[str, Any]) -> str:
    count = f"{int(attrs['samples'])} samples"
    if attrs["curve"] == "samples":
        return (f"The {count} of the transmission error are used raw: the curve passes through "
                "every one, and what noise is in them is in its curvature many times over. Nothing "
                "below says what that does.")
    how = f"least squares with all orders up to {attrs['curve_order']}" \
        if attrs["curve"] == "harmonics" else \
        f"a smoothing spline ({attrs['curve_freedom']:.1f} degrees of freedom)"
    whence = "stated" if attrs["noise_stated"] else "estimated"
    return (f"A curve is fitted to {count} by {how}, kinks kept; noise of a sample "
            f"{1e6 * attrs['noise_level']:.3g} µrad ({attrs['noise_level'] / _ARCSEC:.2g} arcsec, "
            f"{whence}). The intervals below are those that this noise leaves, if the true curve "
            f"has no order above {attrs['curve_wide_order']}.")


def has_interval(attrs: dict[str, Any]) -> bool:
    """Whether a critical value has an interval from the noise of samples."""
    return "low" in attrs and attrs["outcome"] == "found"


def value_and_interval(attrs: dict[str, Any]) -> tuple[str, str]:
    """Such a value to the digits that its interval leaves, and the interval, both in words."""
    value, ends = attrs["estimate"], (attrs["low"], attrs["high"])
    known = [end for end in ends if math.isfinite(end)]
    width = max(abs(end - value) for end in known) if known else math.nan
    places = max(0, 1 - math.floor(math.log10(width))) if width > 0 else 6
    low, high = (f"{end:.{places}f}" if math.isfinite(end) else "beyond the values searched"
                 for end in ends)
    return f"{value:.{places}f}", f"{low} to {high} ({100 * attrs['confidence']:g} %, noise of " \
        "the samples)"


def critical_words(critical: xr.Dataset, unit: str) -> str:
    """What the noise of samples leaves of a critical value, one or more sentences; or nothing."""
    attrs = critical.attrs
    if attrs.get("curve") == "samples" and attrs["outcome"] == "found":
        return " The samples are used raw: rounding is not what this number is off by." \
            + "".join(f" {text}" for text in warnings(attrs))
    if not has_interval(attrs):
        return ""
    _, ends = value_and_interval(attrs)
    if "repeat_value" in critical:
        found = critical["repeat_value"].values
        lost = int((~(found == found)).sum())
        return (f" The same search on {plural(found.size, 'other curve')} that samples with the "
                f"same noise might give: {ends}, {unit}".rstrip(", ") + "."
                + f" On {lost} of them nothing was found in the range searched." * bool(lost))
    text = f" Interval: {ends}, {unit}".rstrip(", ") + "."
    if "fit_order" in critical.dims:
        rows = critical.isel(fit_order=slice(0, _ORDERS_TOLD))
        best = int(critical["fit_order"].values[critical["fit_gcv"].values.argmin()])
        text += " By the highest order of a fit without smoothing: " + "; ".join(
            f"{int(order)}: {_brief(value, low, high)}" for order, value, low, high in zip(
                *(rows[name].values for name in (
                    "fit_order", "fit_estimate", "fit_low", "fit_high")), strict=True)) \
            + f" (cross-validation is least at order {best})."
    return text + "".join(f" {text}" for text in warnings(attrs))


def _brief(value: float, low: float, high: float) -> str:
    """An estimate with its limits in brackets."""
    width = high - low
    places = max(0, 1 - math.floor(math.log10(width))) if 0 < width < math.inf else 3
    return f"{value:.{places}f} ({low:.{places}f} to {high:.{places}f})"


def torque_words(attrs: dict[str, Any], unit: str) -> str:
    """T_full of a sweep, with the interval where samples leave one."""
    low, high = (attrs.get(f"full_engagement_{end}", math.nan) for end in ("low", "high"))
    if math.isfinite(low) and math.isfinite(high):
        return f"{_brief(attrs['full_engagement'], low, high)} {unit}, 95 %"
    return f"{attrs['full_engagement']:.10g} {unit}"


def motion_words(attrs: dict[str, Any]) -> str:
    """To what motions other curves lead; empty where none were tried."""
    if "repeat_classes" not in attrs:
        return ""
    ranges = ", ".join(
        f"{words} {factor * attrs[key + '_low']:.3g} to {factor * attrs[key + '_high']:.3g}{unit}"
        for key, words, factor, unit in (
            ("deepest_separation", "deepest separation", 1e6, " µrad"),
            ("impacts_per_cycle", "impacts per cycle", 1, ""))
        if math.isfinite(attrs[f"{key}_low"]))
    return (f"On {plural(attrs['curve_repeats'], 'other curve')} that samples with the same noise "
            f"might give: {attrs['repeat_classes']}" + f"; {ranges} (95 %)" * bool(ranges) + ".")


def noise_findings(criticals: Any) -> list[str]:
    """What the noise of samples leaves of the torques found, for the findings.

    Parameters
    ----------
    criticals : sequence of Dataset

    Returns
    -------
    list of str, Markdown; empty where the transmission error is not measured
    """
    attrs = [one.attrs for one in criticals if one.attrs["parameter"] == "brake_torque"
             and one.attrs["outcome"] == "found" and not int(one.attrs.get("own_operation", 0))]
    found = [f"{SYMBOLS[one['find']]} {value_and_interval(one)[1]}" for one in attrs
             if has_interval(one)]
    if found:
        return ["**The noise of the measured transmission error leaves** "
                + ", ".join(found).replace(" (95 %, noise of the samples)", " N·m")
                + " (95 %)."]
    if any(one.get("curve") == "samples" for one in attrs):
        return ["**The samples of the transmission error are used raw**: how far their noise moves "
                "these torques is not known."]
    return []
