"""Figures, drawn from results alone: any of them can be redrawn from a stored file."""

from __future__ import annotations

from importlib import import_module
from pathlib import Path

import numpy as np

FORMATS = ("png", "pdf")
# Modules of this package with a `draw` each, by what they are drawn from.
SWEEP_FIGURES = ("orbit_diagram", "deepest_separation", "staircase", "exponents",
                 "impact_speed_density", "waterfall")
# Variables without which a figure of a sweep has nothing to show.
NEEDED = {"staircase": "motion_class", "exponents": "lyapunov_exponent",
          "impact_speed_density": "impact_speed_density", "waterfall": "order_spectrum"}
RESPONSE_FIGURES = ("history", "phase_portrait", "impact_section", "spectrum")
TE_FIGURE = "te_curve"


def draw_all(results, folder, *, formats=FORMATS, progress=None):
    """Draw every figure of a result file.

    Parameters
    ----------
    results : lapwing.results.Results, or an object with its `attrs`, `gear_pair`, `responses`,
        `sweeps`, `response(name)`, `sweep(name)` and `transmission_error`
    folder : str or Path, made if it is missing
    formats : of 'png' and 'pdf'
    progress : callable(fraction done) or None

    Returns
    -------
    list of Path
        What was written: `te_curve`, `<figure>_<sweep>`, `<figure>_<response>`, in each format.
    """
    from lapwing.plots.style import save

    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    written = []
    tasks = list(_tasks(results))
    for done, (stem, module, load, options) in enumerate(tasks):
        draw = import_module(f"lapwing.plots.{module}").draw
        figure = draw(load(), results.gear_pair, **options)
        for suffix in formats:
            written.append(folder / f"{stem}.{suffix}")
            save(figure, written[-1])
        if progress is not None:
            progress((done + 1) / len(tasks))
    return written


def _tasks(results):
    """(file stem, module, loader of the dataset, options) of every figure, in reading order."""
    deck = str(results.attrs.get("deck_name", ""))
    for name in results.sweeps:
        for module in SWEEP_FIGURES:
            if NEEDED.get(module, "status") not in results.sweep(name):
                continue
            yield (f"{module}_{name}", module, lambda name=name: results.sweep(name),
                   {"title": _sweep_title(deck, name, module), "claims": _claims(results, name)})
    for name in results.responses:
        for module in RESPONSE_FIGURES:
            yield f"{module}_{name}", module, lambda name=name: results.response(name), {}
    yield TE_FIGURE, TE_FIGURE, lambda: results.transmission_error, {}


def _sweep_title(deck, name, module):
    return f"{deck}, sweep '{name}': {module.replace('_', ' ')}"


def _claims(results, name):
    """What the source reports, from the responses: they know of impacts as well."""
    from lapwing.plots.sweep_parts import Claim, parameter_of

    parameter = parameter_of(results.sweep(name))
    claims = []
    for attrs in (results.response(response).attrs for response in results.responses):
        if parameter in attrs and any(key.startswith("claim_") for key in attrs):
            claims.append(Claim(float(attrs[parameter]),
                                float(attrs.get("claim_deepest_separation", np.nan)),
                                str(attrs.get("claim_text", "")),
                                float(attrs.get("claim_impacts_per_cycle", np.nan))))
    return claims
