"""What a map answers: which torque to choose at which value of the other axis, how sure it is."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from lapwing.base.arrivals import arrivals_in
from lapwing.base.codes import Status
from lapwing.base.quantities import are_labels, value_words
from lapwing.report.words import bands, parameter_unit, parameter_words, plural, runs_of, span
from lapwing.results.findings import START_NAMES, map_rattles, map_separates

if TYPE_CHECKING:
    import xarray as xr

# About so many ranges of the other axis of which the torque to choose is told in a sentence.
COLUMNS_TOLD = 6


def findings(data: xr.Dataset, chosen: bool = False) -> list[str]:
    """What a map answers, as a sentence or two in Markdown; none where it has no result.

    Parameters
    ----------
    data : Dataset of a map
    chosen : bool, whether torques were looked at singly besides, from more starts, and what
        follows from that is told already
    """
    known = data["status"].values == Status.OK
    if not known.any():
        return []
    x, y = (str(data.attrs[f"{side}_parameter"]) for side in "xy")
    law, seen = arrivals_in(data.attrs), map_separates(data).values
    lost = int((~known).sum())
    begun = START_NAMES[data.attrs["start"]].removeprefix("each ")
    said = [f"**Over {span_words(data, x)} and {span_words(data, y)}** ("
            + f"{int(known.sum())} of " * bool(lost)
            + f"{plural(known.size, 'run')} {begun}, map `{data.attrs['name']}`)"]
    back = (data["back_arrivals"].values > 0) & known
    for what, where in (("separation", seen), (f"back {law.word}s", back)):
        said.append(f"{what} seen up to {last_seen(data, where)}" if where.any()
                    else f"no {what} seen")
    return [*_choice(data, chosen), f"{said[0]} {'; '.join(said[1:])}."
            + f" {plural(lost, 'run')} without a result may hold others." * bool(lost),
            *_above_full(data, begun)]


def _choice(data: xr.Dataset, chosen: bool) -> list[str]:
    """The least torques beyond which no run rattles, where one axis is the braking torque.

    They are no choice where another is told already: one start may miss what more have found.
    """
    found = choices(data)
    if found is None:
        return []
    other, torques, quiet = found
    unit, words = parameter_unit("brake_torque"), parameter_words(other)
    known = np.isfinite(quiet)
    if chosen and not known.any():
        return []
    if not known.any():
        return [f"**Which torque to choose map `{data.attrs['name']}` does not answer**: look at "
                f"higher ones than {torques[-1]:g} {unit}."]
    values, of = data[other].values, parameter_unit(other)
    alone = " One start alone was tried: another motion may live beside it."
    if chosen:
        alone = " Where torques were looked at singly, as told above, that holds: it rests on " \
            "more starts."
    if known.all() and np.ptp(quiet) == 0:
        head = f"At every {words} of map `{data.attrs['name']}` {quiet[0]:g} {unit} on the gear " \
            "were enough" if chosen else f"Choose at least {quiet[0]:g} {unit} on the gear"
        return [f"**{head}**: nothing that was run rattles from there on.{alone}"]
    # A torque at some speeds alone would be taken for those between, too: peaks are narrow.
    parts = [(int(i), int(i)) for i in np.flatnonzero(known)] if are_labels(values) \
        else _parts(known)
    told = "; ".join(f"{_most(quiet[first:end + 1], torques)} {_range(values, first, end)} "
                     f"{of}".rstrip() for first, end in parts)
    beyond = "" if known.all() else (
        f"; at {bands(values, ~known)} {of}".rstrip() + f" more than the {torques[-1]:g} {unit} "
        "looked at, or not known")
    head = f"By the {words}, from one start each" if chosen else f"Choose by the {words}"
    if are_labels(values):
        return [f"**{head}** (on the gear; from which on nothing that was run rattles): "
                f"{told}{beyond}.{alone}"]
    return [f"**{head}** (on the gear; the most that is needed over each range, "
            f"from which on nothing that was run rattles): {told}{beyond}; beyond "
            f"{values[0]:g} and {values[-1]:g} {of}".rstrip() + f" nothing was looked at.{alone}"]


def _parts(known: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """First and last index of the ranges that are told, each known throughout."""
    size = max(-(-int(known.sum()) // COLUMNS_TOLD), 1)
    return [(int(part[0]), int(part[-1])) for first, end in runs_of(known)
            for part in np.array_split(np.arange(first, end + 1), -(-(end + 1 - first) // size))]


def _most(needed: NDArray[Any], torques: NDArray[Any]) -> str:
    """The greatest torque needed; one at the edge is said to be there."""
    most = needed.max()
    edge = {torques[-1]: " (the highest looked at)", torques[0]: " (the lowest looked at)"}
    return f"{most:g} {parameter_unit('brake_torque')}{edge.get(most, '')}"


def _range(values: NDArray[Any], first: int, end: int) -> str:
    if first == end:
        return f"at {value_words(values[first])}"
    return f"from {values[first]:g} to {values[end]:g}"


def choices(data: xr.Dataset) -> tuple[str, NDArray[Any], NDArray[Any]] | None:
    """Of a map along the braking torque: the other axis, torques, the least for each of its values.

    From that torque on every run is known and keeps contact, and it is T_full at least; NaN: none.
    """
    axes = [str(data.attrs[f"{side}_parameter"]) for side in "xy"]
    if "brake_torque" not in axes or data["brake_torque"].values[0] < 0:
        return None
    other = axes[1 - axes.index("brake_torque")]
    torques, order = data["brake_torque"].values, ("brake_torque", other)
    calm = ((data["status"] == Status.OK) & ~map_rattles(data)).transpose(*order).values
    if torques.size > 1 and torques[0] > torques[-1]:
        torques, calm = torques[::-1], calm[::-1]
    if (full := full_along(data, other)) is not None:
        calm &= torques[:, None] >= full
    rows = np.logical_and.accumulate(calm[::-1])[::-1]
    least = np.where(rows.any(axis=0), torques[np.argmax(rows, axis=0)], np.nan)
    return other, torques, least


def _above_full(data: xr.Dataset, begun: str) -> list[str]:
    """What was seen to rattle above T_full."""
    found = choices(data)
    full = None if found is None else full_along(data, found[0])
    if found is None or full is None:
        return []
    other = found[0]
    order = ("brake_torque", other)
    above = data["brake_torque"].values[:, None] > full
    known = above & (data["status"] == Status.OK).transpose(*order).values
    seen = known & map_rattles(data).transpose(*order).values
    if not known.any():
        return []
    head = "**Above T_full, from which on the engaged motion keeps contact,** "
    if not seen.any():
        return [f"{head}none of {plural(int(known.sum()), 'run')} {begun} rattles."]
    at, flags = data[other].values, seen.any(axis=0)
    return [f"{head}{int(seen.sum())} of {plural(int(known.sum()), 'run')} {begun} rattle all the "
            f"same, at {parameter_words(other)} {span(at[flags], parameter_unit(other))}: the "
            "start decides there."]


def full_along(data: xr.Dataset, other: str) -> NDArray[Any] | None:
    """T_full along an axis, where it is known and depends on that alone."""
    if "full_engagement" not in data or data["full_engagement"].dims != (other,):
        return None
    full: NDArray[Any] = data["full_engagement"].values
    return full


def span_words(data: xr.Dataset, name: str) -> str:
    """An axis and its ends: 'pinion speed 200 to 3000 rpm'."""
    return f"{parameter_words(name)} {span(data[name].values, parameter_unit(name))}"


def last_seen(data: xr.Dataset, where: NDArray[Any]) -> str:
    """The last value along y at which something was seen, and where along x; see `sides_of`."""
    x, y = sides_of(data)
    seen = data["status"].copy(data=where).transpose(y, x).values
    values, columns = data[y].values, data[x].values
    last = np.nonzero(seen.any(axis=1))[0][-1]
    at = columns[seen[last]]
    return (f"{parameter_words(y)} {values[last]:g} {parameter_unit(y)}".rstrip()
            + " (the last one looked at)" * bool(last == values.size - 1)
            + f", there at {parameter_words(x)} {span(at, parameter_unit(x))}")


def sides_of(data: xr.Dataset) -> tuple[str, str]:
    """The parameters drawn to the right and upwards; the other way where upwards are labels.

    What is last along the second is worth telling of numbers alone.
    """
    x, y = (str(data.attrs[f"{side}_parameter"]) for side in "xy")
    return (y, x) if are_labels(data[y].values) else (x, y)
