"""A measured transmission error in the result file: samples, fit, and how well both are known."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from lapwing.model.curve.fit import CurveFit
    from lapwing.model.transmission_error.table import TransmissionError

# A part of the critical force larger than this decides it.
SHARE_THAT_DECIDES = 0.1
# Places at which curvature and its band are stored.
PLACES = 721
# Harmonics of a transmission error that are named one by one.
HARMONICS = 4
DESCRIPTIONS = {
    "sample_phase": ("1", "mesh phase of the samples, in mesh periods"),
    "sample_value": ("rad", "transmission error as measured"),
    "sample_residual": ("rad", "transmission error as measured less the curve"),
    "curve_phase": ("1", "mesh phase, in mesh periods"),
    "curve_value_error": ("rad", "standard error of the curve without smoothing"),
    "curve_curvature_low": ("rad", "lower limit of the curvature, per mesh period squared, 95 %"),
    "curve_curvature_high": ("rad", "upper limit of the curvature, per mesh period squared, 95 %")}


def curve_variables(
        curve: CurveFit | None,
        samples: tuple[NDArray[Any], NDArray[Any], NDArray[Any]] | None = None) -> tuple[
            dict[str, Any], dict[str, Any]]:
    """Variables and attributes of the group `transmission_error` for measured samples.

    Parameters
    ----------
    curve : lapwing.model.curve.fit.CurveFit or None
    samples : (phase, value, kinks) used raw, or None

    Returns
    -------
    variables, attributes : dict
    """
    if curve is None and samples is None:
        return {}, {}
    if curve is None:
        assert samples is not None
        phase, value, _ = samples
        return _described({"sample_phase": ("sample", phase), "sample_value": ("sample", value)}), \
            {"curve": "samples", "samples": phase.size}
    phase = np.arange(PLACES) / PLACES
    low, high, error = _bands(curve, phase)
    variables = {"sample_phase": ("sample", curve.phase), "sample_value": ("sample", curve.value),
                 "sample_residual": ("sample", curve.residual), "curve_phase": ("place", phase),
                 "curve_value_error": ("place", error), "curve_curvature_low": ("place", low),
                 "curve_curvature_high": ("place", high)}
    return _described(variables), {
        "curve": curve.method, "samples": curve.phase.size, "curve_order": curve.order,
        "curve_wide_order": curve.wide.order, "noise_level": curve.noise,
        "noise_stated": int(curve.noise_stated), "curve_freedom": curve.effective,
        "residual_rms": float(np.sqrt(np.mean(curve.residual**2))),
        "residual_excess": curve.residual_excess()}


def _described(variables: dict[str, tuple[str, NDArray[Any]]]) -> dict[
        str, tuple[str, NDArray[Any], Any]]:
    return {name: (*content, dict(zip(("units", "long_name"), DESCRIPTIONS[name], strict=True)))
            for name, content in variables.items()}


def _bands(curve: CurveFit, phase: NDArray[Any]) -> tuple[NDArray[Any], NDArray[Any], NDArray[Any]]:
    """Pointwise 95 % limits of the curvature, and the standard error of the value, without bias."""
    from scipy.stats import norm, t

    from lapwing.model.curve.basis import design

    value = design(phase, curve.kinks, curve.wide.order)
    bend = np.column_stack([np.zeros((phase.size, 1)), -np.ones((phase.size, curve.kinks.size)),
                            value[:, 1 + curve.kinks.size:]])
    order = np.repeat(np.arange(1, curve.wide.order + 1), 2)
    bend[:, 1 + curve.kinks.size:] *= -(2 * np.pi * order) ** 2
    point = norm.ppf(0.975) if curve.noise_stated else t.ppf(0.975, curve.wide.freedom)
    middle = bend @ curve.wide.coefficients
    half = point * curve.noise * np.linalg.norm(bend @ curve.wide.root, axis=1)
    return middle - half, middle + half, \
        curve.noise * np.linalg.norm(value @ curve.wide.root, axis=1)


def source_of(te: TransmissionError) -> str:
    """In words, what the table was made from."""
    if len(te.harmonics):
        orders, sizes = te.harmonics[:, 0], te.harmonics[:, 1]
        shown = ", ".join(f"{1e6 * size:.4g} µrad of order {order:g}"
                          for order, size in zip(orders[:HARMONICS], sizes, strict=False))
        return (f"{len(orders)} harmonic{'s' * (len(orders) != 1)}: {shown}"
                + f" and {len(orders) - HARMONICS} more" * (len(orders) > HARMONICS))
    pieces, kinks = len(te.kinks), int(te.kinks.sum())
    kinked = f"{kinks or 'no'} kink{'s' * (kinks != 1)}"
    if pieces == 1:
        degree = int(np.flatnonzero(te.coefficients[0]).max(initial=0))
        return f"{('constant', 'line', 'parabola')[degree]} with {kinked}" if degree <= 2 \
            else f"one polynomial of degree {degree} with {kinked}"
    return f"table of {pieces} pieces with {kinked}"
