"""What a map says in words: shares of the kinds of motion, and how far rattling reaches."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from lapwing.base.arrivals import arrivals_in
from lapwing.base.codes import Status
from lapwing.base.quantities import SHARES, are_labels, value_words
from lapwing.report.map.findings import choices, full_along, last_seen, sides_of, span_words
from lapwing.report.words import (
    markdown,
    parameter_unit,
    parameter_words,
    plural,
    sections,
    with_result,
)
from lapwing.results.findings import (
    START_NAMES,
    endings,
    map_kinds,
    map_rattles,
    map_separates,
)

if TYPE_CHECKING:
    import xarray as xr

    from lapwing.results import Results

# Columns of the plane that the table shows.
TABLE_LINES = 12


def section(maps: list[xr.Dataset], results: Results) -> list[str]:
    """The summary's part on maps; see `registry`."""
    return sections("Map", maps, map_text)


def headline(data: xr.Dataset) -> str:
    """Runs that have a result, and why others have none."""
    x, y = (parameter_words(str(data.attrs[f"{side}_parameter"])) for side in "xy")
    return with_result(data, "runs", f"over {x} and {y}")


def map_text(data: xr.Dataset) -> list[str]:
    """Findings of one map, as a list; each says on how many runs it was judged.

    Parameters
    ----------
    data : xarray.Dataset, group `map_<name>` of a result file

    Returns
    -------
    list of str, lines of Markdown
    """
    lines = [_extent(data)]
    known = data["status"].values == Status.OK
    if not known.any():
        return [*lines, "- no run has a result: nothing is known of the motions"]
    names, found = map_kinds(data)
    shares = np.bincount(found.values[known], minlength=len(names)) / known.sum()
    lines.append("- kinds of motion, shares of the runs that have a result: " + ", ".join(
        f"{name} {100 * share:.3g} %" for name, share in zip(names, shares, strict=True) if share))
    law = arrivals_in(data.attrs)
    for what, where in ((f"back {law.word}s", (data["back_arrivals"].values > 0) & known),
                        ("anything but engagement of the drive flanks", map_rattles(data).values)):
        lines.append(f"- {what}: {_reach(data, where)}")
    lines += _observed(data, known)
    lines.append(f"- {law.word}s are counted: {law.rule(data.attrs['count_depth'])}"
                 + " separation" * law.threshold)
    return [*lines, "", *_table(data)]


def _observed(data: xr.Dataset, known: NDArray[np.bool_]) -> list[str]:
    """What was asked for besides: extremes, and where they are."""
    lines = []
    for name, words, unit, factor in (
            ("phi_rms", "rms of φ about its mean", "µrad", 1e6),
            ("mesh_force_peak", "peak mesh force, impacts apart", "N", 1)):
        if name not in data:
            continue
        values = np.where(known, factor * data[name].values, np.nan)
        lines.append(f"- {words}: " + (
            f"{np.nanmin(values):.3g} to {np.nanmax(values):.4g} {unit}, the largest at "
            + _place(data, int(np.nanargmax(values))) if np.isfinite(values).any()
            else "not known, the rigid contact law has no spring"))
    if "lyapunov_exponent" in data:
        rate = data["lyapunov_exponent"].values[known]
        open_ = int(np.isnan(rate).sum())
        rate = rate[~np.isnan(rate)]
        lines.append("- largest Lyapunov exponent: " + (
            f"above 0 in {100 * (rate > 0).mean():.3g} % of {plural(rate.size, 'run')}, at most "
            f"{rate.max():.3g} per τ; an estimate from {data.attrs['record']} mesh cycles, no "
            "proof of chaos" if rate.size else "known in no run")
            + f"; not known in {plural(open_, 'run')} that graze a flank" * bool(open_))
    if all(name in data for name in SHARES):
        lines.append("- time of all runs together: " + ", ".join(
            f"{100 * data[name].values[known].mean():.3g} % in "
            f"{name.removesuffix('_share').replace('_', ' ')}" for name in SHARES))
    return lines


def _place(data: xr.Dataset, at: int) -> str:
    """Values of both parameters in a run."""
    index = dict(zip(data["status"].dims, np.unravel_index(at, data["status"].shape), strict=True))
    names = (str(data.attrs[f"{side}_parameter"]) for side in "xy")
    return " and ".join(f"{parameter_words(name)} {value_words(data[name].values[index[name]])} "
                        f"{parameter_unit(name)}".rstrip() for name in names)


def _extent(data: xr.Dataset) -> str:
    attrs, (_, open_, failed) = data.attrs, endings(data)
    axes = " × ".join(
        span_words(data, name) + f" ({plural(values.size, 'value')})"
        for name in (str(attrs["x_parameter"]), str(attrs["y_parameter"]))
        for values in (data[name].values,))
    begun = START_NAMES[attrs["start"]].replace("each", "each run")
    return (f"- {axes}; {begun}, contact law `{attrs['contact_law']}`, "
            f"{plural(attrs['settle'], 'mesh cycle')} to settle and {attrs['record']} recorded; "
            f"{failed or 'none'} of {data['status'].size} failed"
            + f", **{open_} not reached**" * bool(open_))


def _reach(data: xr.Dataset, where: NDArray[Any]) -> str:
    """Ends of the values at which something was seen."""
    if not where.any():
        return "seen in no run that has a result"
    share = where.sum() / (data["status"].values == Status.OK).sum()
    return (f"seen in {100 * share:.3g} % of the runs that have a result, up to "
            f"{last_seen(data, where)}")


def _table(data: xr.Dataset) -> list[str]:
    """Some columns of the plane: how far up rattling was seen, T_full, the torque to choose."""
    x, y = sides_of(data)
    values, columns = data[y].values, data[x].values
    order = (y, x)
    seen = map_separates(data).transpose(*order).values
    back = (data["back_arrivals"] > 0).transpose(*order).values
    known = (data["status"] == Status.OK).transpose(*order).values
    full = [f"{value:.4g}" for value in data["full_engagement"].values] \
        if full_along(data, x) is not None else []
    found = choices(data) if y == "brake_torque" else None
    least = [f"{one:g}" if np.isfinite(one) else "not answered" for one in found[2]] \
        if found is not None else []
    unit_x, unit_y = (f" ({parameter_unit(name)})" * bool(parameter_unit(name)) for name in (x, y))
    rows = [(parameter_words(x) + unit_x, f"last back arrival seen{unit_y}",
             f"last separation seen{unit_y}", *[f"T_full{unit_y}"] * bool(full),
             *[f"choose at least{unit_y}"] * bool(least),
             "values with a result")]
    lines = columns.size if are_labels(columns) else TABLE_LINES
    for i in np.unique(np.linspace(0, columns.size - 1, lines).round().astype(int)):
        last = [_last(values, one[:, i] & known[:, i], known[:, i]) for one in (back, seen)]
        rows.append((value_words(columns[i]), *last, *full[i:i + 1], *least[i:i + 1],
                     f"{int(known[:, i].sum())} of {values.size}"))
    return markdown(rows)


def _last(values: NDArray[Any], where: NDArray[Any], known: NDArray[Any]) -> str:
    if not known.any():
        return "not known"
    return f"{values[where][-1]:g}" if where.any() else "none"
