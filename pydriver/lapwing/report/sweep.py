"""What a sweep says in words: a table over its range, the last rattling values, hysteresis."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from lapwing.base.arrivals import arrivals_in, per_cycle
from lapwing.base.codes import Status
from lapwing.base.quantities import are_labels, value_words
from lapwing.report.amplitudes import amplitude_lines
from lapwing.report.hysteresis import hysteresis
from lapwing.report.measured import torque_words
from lapwing.report.stability import sweep_stability
from lapwing.report.words import (
    bands,
    markdown,
    method_words,
    parameter_unit,
    parameter_words,
    plural,
    sections,
    with_result,
)
from lapwing.results.findings import (
    START_NAMES,
    endings,
    known,
    names,
    rattles,
    span,
    words_beyond,
)

if TYPE_CHECKING:
    import xarray as xr

    from lapwing.results.file import Results

# A sweep is told in about so many lines, spread over its range.
TABLE_LINES = 12


def section(sweeps: list[xr.Dataset], results: Results) -> list[str]:
    """The summary's part on sweeps; see `registry`."""
    return sections("Sweep", sweeps, sweep_text)


def headline(sweep: xr.Dataset) -> str:
    """Points that have a result, and why others have none."""
    return with_result(sweep, "points", "along the " + parameter_words(sweep["status"].dims[1]))


def sweep_text(sweep: xr.Dataset) -> list[str]:
    """Findings of one sweep, as a list; each says on which values it was judged.

    Parameters
    ----------
    sweep : xarray.Dataset, group `sweep_<name>` of a result file

    Returns
    -------
    list of str, lines of Markdown
    """
    unit = parameter_unit(sweep.attrs["parameter"])
    lines = [_extent(sweep, unit)]
    if "deepest_separation" not in sweep:
        return lines
    if not known(sweep).any():
        return [*lines, "- no point has a result: nothing is known of its motions"]
    values = sweep[sweep.attrs["parameter"]].values
    law = arrivals_in(sweep.attrs)
    back = (sweep["back_impacts"] + sweep["back_engages"] > 0).any("recorded_cycle").values
    last, told = ("last ", _largest) if not are_labels(values) else ("", _labelled)
    lines += [f"- {last}back {law.word}{'s' * (not last)} seen: "
              + told(sweep, values, back, unit),
              f"- {last}separation seen (anything but engagement of the drive flanks): "
              + told(sweep, values, rattles(sweep), unit)]
    lines += _full_engagement(sweep, unit)
    coexisting = hysteresis(sweep, unit)
    lines.append("- hysteresis: " + coexisting[0])
    lines += amplitude_lines(sweep, unit)
    lines += sweep_stability(sweep, unit)
    lines.append(f"- {law.word}s are counted: {law.rule(sweep.attrs['count_depth'])}"
                 + " separation" * law.threshold)
    if not law.threshold and {"impact_velocity", "impact_speed_density"} & set(sweep):
        lines.append("- no impact speeds: the compliant law has no impacts")
    return [*lines, *coexisting[1:], "", *_table(sweep, values, unit)]


def _extent(sweep: xr.Dataset, unit: str) -> str:
    """What was swept, and how much of it there is."""
    attrs, status = sweep.attrs, sweep["status"].values
    values = sweep[attrs["parameter"]].values
    _, unfinished, failed = endings(sweep)
    ends = f"at {value_words(values[0])}" if values.size == 1 else \
        ", ".join(map(value_words, values)) if are_labels(values) else \
        f"from {values[0]:g} to {values[-1]:g}"
    return (f"- {parameter_words(attrs['parameter'])} {ends} {unit}".rstrip()
            + f": {plural(values.size, 'value')} × {plural(sweep.sizes['start'], 'start')}, "
            + f"contact law `{attrs['contact_law']}`, " * ("contact_law" in attrs)
            + f"{plural(attrs['settle'], 'mesh cycle')} to settle and "
            f"{attrs['record']} recorded, {method_words(attrs)}; "
            f"{failed or 'none'} of {status.size} failed"
            + f", **{unfinished} not reached**" * bool(unfinished))


def _full_engagement(sweep: xr.Dataset, unit: str) -> list[str]:
    """From where contact can be kept, and what was seen to rattle above."""
    value = sweep.attrs.get("full_engagement", np.nan)
    if not np.isfinite(value):
        return []
    return [f"- T_full = {torque_words(sweep.attrs, unit)}: contact *can* be kept from here, for "
            "the engaged motion never separates above it (contact is first lost at mesh phase "
            f"{sweep.attrs['full_engagement_phase']:.6f}). Other motions beside it: "
            f"{words_beyond(sweep, value, unit)}"]


def _table(sweep: xr.Dataset, values: NDArray[Any], unit: str) -> list[str]:
    """Some values of a sweep, spread evenly over it, of the motions from rest if there are any."""
    starts = [str(start) for start in sweep["start"].values]
    results = known(sweep).sum(axis=1)
    start = starts.index("rest") if "rest" in starts else 0
    if not results[start]:
        start = int(np.argmax(results))
    branch, law = sweep.isel(start=start), arrivals_in(sweep.attrs)
    impacts, back = (per_cycle(branch, side) for side in ("drive", "coast"))
    depth = 1e6 * branch["deepest_separation"].max("recorded_cycle").values
    name = parameter_words(sweep.attrs["parameter"])
    rows = [(name + f" ({unit})" * bool(unit), f"{law.word}s per cycle",
             f"back {law.word}s per cycle", "period (mesh cycles)", "deepest separation (µrad)")]
    lines = values.size if are_labels(values) else TABLE_LINES
    for i in np.unique(np.linspace(0, values.size - 1, lines).round().astype(int)):
        status = Status(int(branch["status"].values[i]))
        if status == Status.OK:
            cells = (f"{impacts[i]:.3g}", f"{back[i]:.3g}",
                     str(int(branch["period"].values[i]) or "none"), f"{depth[i]:.4g}")
        else:
            lost = "not reached" if status == Status.UNFINISHED else "failed"
            cells = (lost, *"–––")
        rows.append((value_words(values[i]), *cells))
    which = "The motions" if values.size <= lines else "Some of the motions"
    return [f"{which}, {START_NAMES.get(starts[start], starts[start])}:", "", *markdown(rows)]


def _labelled(sweep: xr.Dataset, values: NDArray[Any], seen: NDArray[Any], unit: str) -> str:
    """Of which labels something was seen, from any start, and of which nothing is known."""
    done = known(sweep)
    looked: Any = done.any(axis=0)
    hit: Any = (seen & done).any(axis=0)
    words = f"at {bands(values, hit)}" if hit.any() else "nowhere"
    others = looked & ~hit
    return (words + f", not at {bands(values, others)}" * bool(hit.any() and others.any())
            + f"; no result at {bands(values, np.logical_not(looked))}" * bool(not looked.all()))


def _largest(sweep: xr.Dataset, values: NDArray[Any], seen: NDArray[Any], unit: str) -> str:
    """Largest value at which something was seen and what is known above it, for each start."""
    found: dict[str, list[str]] = {}
    for start, done, hit in zip(sweep["start"].values, known(sweep), seen, strict=True):
        found.setdefault(_largest_of(values, done, hit & done, unit), []).append(str(start))
    return "; ".join(f"{words} ({names(starts)})" for words, starts in found.items())


def _largest_of(values: NDArray[Any], done: NDArray[Any], seen: NDArray[Any], unit: str) -> str:
    """The same for one start, in words."""
    if not done.any():
        return f"not known (no result at {plural(values.size, 'value')})"
    hits = np.flatnonzero(seen)
    if not hits.size:
        part = "" if done.all() else f"; no result at the other {values.size - done.sum()}"
        return f"none at {span(values[done], unit)}{part}"
    last = f"{values[hits[-1]]:g} {unit}".rstrip()
    if hits[-1] == values.size - 1:
        return f"{last} (the end of the range)"
    above = done[hits[-1] + 1:]
    if not above.any():
        return f"{last}, not known above it ({plural(above.size, 'value')} without a result)"
    if not above.all():
        return (f"{last}, none at the {above.sum()} of {above.size} values above it that have a "
                "result")
    return f"{last}, none at {values[hits[-1] + 1]:g} {unit}".rstrip()
