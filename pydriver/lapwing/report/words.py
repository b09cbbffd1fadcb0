"""What the parts of a summary share: units, tables, plurals."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from lapwing.base.quantities import are_labels, parameter, value_words
from lapwing.results.findings import endings

if TYPE_CHECKING:
    import xarray as xr

# Runs of values told one by one; of more the outermost.
MOST = 4
# Where no torque was searched; and what to add to a deck then, in its own words.
NOT_SAID = "**This run does not say which torque keeps contact**"
SEARCH = "a search for T_safe (&critical, find = 'safe')"
SEARCH_WOULD_SAY = f"{SEARCH[0].upper()}{SEARCH[1:]} would say."


def parameter_unit(name: Hashable) -> str:
    """Unit of a parameter as a person reads it; empty for a bare number."""
    return parameter(str(name)).shown


def parameter_words(name: Hashable) -> str:
    """A parameter in words, without its unit."""
    return parameter(str(name)).words


def markdown(rows: Sequence[Sequence[str]]) -> list[str]:
    """Lines of a table; the first row is its heading."""
    lines = ["| " + " | ".join(row) + " |" for row in rows]
    return [lines[0], "|---" * len(rows[0]) + "|", *lines[1:]]


def plural(number: float, word: str) -> str:
    """Number and word, the word with an s unless the number is one."""
    told = f"{number:.0f}" if float(number).is_integer() else f"{number:g}"
    return f"{told} {word}" + "s" * bool(number != 1)


def method_words(attrs: dict[str, Any]) -> str:
    """How the motion was followed: 'in closed form', or rk4 and its tolerance."""
    if attrs["method"] == "exact":
        return "in closed form"
    return f"rk4 at tolerance {attrs['rtol']:g}"


def span(values: NDArray[Any], unit: str) -> str:
    """From the first value to the last, or the only one, with its unit."""
    if values.size == 1 or are_labels(values):
        return f"{', '.join(map(value_words, values))} {unit}".rstrip()
    return f"{values[0]:g} to {values[-1]:g} {unit}".rstrip()


def runs_of(flags: NDArray[Any]) -> list[tuple[int, int]]:
    """First and last index of each run of flags."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], flags, [False]]).astype(int)))
    return [(int(first), int(end) - 1) for first, end in edges.reshape(-1, 2)]


def listed(found: Sequence[tuple[int, int]], values: NDArray[Any], most: int = MOST) -> str:
    """Runs of values in words: '1, 2 to 3'; of many the outermost. Labels one by one, all."""
    if are_labels(values):
        return ", ".join(value_words(values[i]) for a, b in found for i in range(a, b + 1))
    told = [f"{values[a]:g}" if a == b else f"{values[a]:g} to {values[b]:g}" for a, b in found]
    return ", ".join(told if len(told) <= most else
                     [*told[:most // 2], "…", *told[len(told) - most // 2:]])


def bands(values: NDArray[Any], flags: NDArray[Any]) -> str:
    """Runs of values at which something holds, in words."""
    return listed(runs_of(flags), values)


def sections(kind: str, datasets: Sequence[xr.Dataset],
             text: Callable[[xr.Dataset], list[str]]) -> list[str]:
    """The summary's part on studies of a kind, a heading and a text for each."""
    return [line for one in datasets
            for line in ("", f"## {kind} {one.attrs['name']}", "", *text(one))]


def with_result(data: xr.Dataset, each: str, where: str) -> str:
    """How many runs or points have a result, of what, and why others have none."""
    done, open_, failed = endings(data)
    return (f"{done} of {data['status'].size} {each} have a result, {where}"
            + f"; {open_} not reached" * bool(open_) + f"; {failed} failed" * bool(failed))
