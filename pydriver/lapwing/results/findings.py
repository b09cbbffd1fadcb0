"""What the points of a sweep, a map or an ensemble show, and which have a result to judge by."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from lapwing.base.arrivals import arrivals_in
from lapwing.base.codes import MotionState, Status

if TYPE_CHECKING:
    import xarray as xr

START_NAMES = {"rest": "each from rest", "up": "carried upwards", "down": "carried downwards"}
# Critical torques by what is found.
SYMBOLS = {"full": "T_full", "safe": "T_safe", "back": "T_back", "on": "T_on"}
ENGAGED = 1 << MotionState.ENGAGEMENT


class Evidence(NamedTuple):
    """What one start shows beyond a value of the parameter.

    Attributes
    ----------
    start : str
    looked : array (n,), values beyond it that have a result
    rattling : array (m,), those of them at which the motion rattles
    wanted : int, number of values of the sweep beyond it
    """

    start: str
    looked: np.ndarray
    rattling: np.ndarray
    wanted: int


def endings(dataset: xr.Dataset) -> tuple[int, int, int]:
    """How many runs of a sweep or a map have a result, were never reached, failed."""
    status = dataset["status"].values
    done, open_ = (int((status == one).sum()) for one in (Status.OK, Status.UNFINISHED))
    return done, open_, status.size - done - open_


def known(sweep: xr.Dataset) -> NDArray[Any]:
    """Whether each point has a result: neither failed nor never reached."""
    done: NDArray[Any] = sweep["status"].values == Status.OK
    return done


def rattles(sweep: xr.Dataset) -> NDArray[Any]:
    """Whether some recorded cycle of each point saw anything but drive flank engagement.

    As in the search for T_safe: another motion state, or an impact. False where nothing is known.
    """
    visited, impacts = (sweep[name].transpose(..., "recorded_cycle").values
                        for name in ("states_visited", "impacts"))
    seen: NDArray[Any] = known(sweep) & np.any((visited != ENGAGED) | (impacts > 0), axis=-1)
    return seen


def search_known(critical: Any) -> bool:
    """Whether what a search found rests on motions that were followed, not on failed ones alone."""
    attrs = critical.attrs
    if attrs["outcome"] == "found" or "trial_failed" not in critical:
        return True
    if attrs["find"] == "back":
        return bool(critical["trial_cycles"].values.any())
    at = critical["trial_value"].values == attrs["scan_from"]
    return attrs["outcome"] != "unsafe_throughout" \
        or bool(critical["trial_rattling"].values[at].any())


def search_bounded(critical: Any) -> bool:
    """Whether motions were seen to rattle at the unsafe end of a bracket, not to fail alone."""
    if critical.attrs["find"] != "safe" or critical.attrs["outcome"] != "found":
        return True
    at = critical["trial_value"].values == critical.attrs["rattling"]
    return bool(critical["trial_rattling"].values[at].any())


def evidence_beyond(sweep: xr.Dataset, value: float) -> list[Evidence]:
    """What each start shows at the values above one, T_full for instance.

    Parameters
    ----------
    sweep : xarray.Dataset of `lapwing.sweep` with 'cycles' observed
    value : float, of the parameter

    Returns
    -------
    list of Evidence
    """
    values = sweep[sweep["status"].dims[1]].values
    above = values > value
    return [Evidence(str(start), values[above & done], values[above & seen], int(above.sum()))
            for start, done, seen in zip(sweep["start"].values, known(sweep), rattles(sweep),
                                         strict=True)]


def words_beyond(sweep: xr.Dataset, value: float, unit: str = "") -> str:
    """Whether rattling was seen above a value, up to where, from which starts and values.

    Parameters
    ----------
    sweep, value : as for `evidence_beyond`
    unit : str, of the parameter

    Returns
    -------
    str
    """
    evidence = evidence_beyond(sweep, value)
    if not evidence[0].wanted:
        return "whether anything rattles above was not looked at"
    seen = [one for one in evidence if one.rattling.size]
    quiet = [one for one in evidence if one.looked.size and not one.rattling.size]
    blind = [one for one in evidence if not one.looked.size]
    parts: list[str] = []
    for last in sorted({one.rattling[-1] for one in seen}, reverse=True):
        starts = [one.start for one in seen if one.rattling[-1] == last]
        parts.append(f"{'' if parts else 'rattling seen up to '}{last:g} {unit}".rstrip()
                     + f" ({names(starts)})")
    for looked in sorted({tuple(one.looked) for one in quiet}):
        starts = [one.start for one in quiet if tuple(one.looked) == looked]
        values = span(np.array(looked), unit)
        parts.append(f"{'none' if seen else 'no rattling seen'} at {values} above it "
                     f"({names(starts)})")
    if blind:
        head = "" if parts else "what rattles above: "
        parts.append(f"{head}not known ({names([one.start for one in blind])})")
    return "; ".join(parts)


def span(values: NDArray[Any], unit: str = "") -> str:
    """So many values, and from where to where: '3 values from 12 to 14 N·m'."""
    if len(values) == 1:
        return f"1 value, {values[0]:g} {unit}".rstrip()
    return f"{len(values)} values from {values[0]:g} to {values[-1]:g} {unit}".rstrip()


def names(starts: list[str]) -> str:
    """Starts in words."""
    return ", ".join(START_NAMES.get(start, start) for start in starts)


# Kinds of motion in words, by what arrives at the flanks and after how many mesh cycles it repeats.
KINDS = ("engaged throughout", "no impacts at the end, not engaged throughout", "period 1",
         "period 2", "periods 3 and 4", "longer periods", "period 1, back impacts",
         "longer periods, back impacts", "no period found", "no period found, back impacts")


def map_kinds(data: xr.Dataset) -> tuple[tuple[str, ...], xr.DataArray]:
    """Kind of motion of each run.

    Parameters
    ----------
    data : xarray.Dataset of `lapwing.parameter_map`

    Returns
    -------
    KINDS, in the words of the contact law; DataArray of int8, an index into them, -1 where there is
    no result
    """
    period, known = data["period"], data["status"] == Status.OK
    back = data["back_arrivals"] > 0
    moves = (data["arrivals"] > 0) | back
    engaged = ~moves & (data["states_visited"] == ENGAGED)
    cases = [~known, engaged, ~moves, (period == 0) & back, period == 0, (period == 1) & back, back,
             period == 1, period == 2, period <= 4]
    kinds = np.array([-1, 0, 1, 9, 8, 6, 7, 2, 3, 4, 5], dtype=np.int8)
    found = np.select([case.values for case in cases], list(kinds[:-1]), kinds[-1])
    words = data.attrs.get("arrival", "impact")
    names = tuple(name.replace("impacts", f"{words}s") for name in KINDS)
    return names, period.copy(data=found)


def map_rattles(data: xr.Dataset) -> xr.DataArray:
    """Whether each run saw anything but drive flank engagement; False where nothing is known."""
    return (data["status"] == Status.OK) & (
        (data["states_visited"] != ENGAGED) | (data["arrivals"] + data["back_arrivals"] > 0))


def map_separates(data: xr.Dataset) -> xr.DataArray:
    """Whether the drive flanks of each run parted for a while; False where nothing is known.

    Less than `map_rattles`: a wheel that rests on the coast flank does not part from the other.
    """
    return (data["status"] == Status.OK) & (
        (data["deepest_separation"] > 0) | (data["arrivals"] + data["back_arrivals"] > 0))


class Answer(NamedTuple):
    """A number of a run whose distribution is told.

    Attributes
    ----------
    name : str, variable of the dataset
    words : str
    unit : str, as a person reads it; empty: a bare number
    factor : float, from the unit of the variable to this one
    """

    name: str
    words: str
    unit: str = ""
    factor: float = 1.0


def answers(data: xr.Dataset) -> list[Answer]:
    """The answers of an ensemble, those that it has."""
    word = arrivals_in(data.attrs).word
    every = (Answer("full_engagement", "T_full", "N·m"),
             Answer("deepest_separation", "deepest separation", "µrad", 1e6),
             Answer("impacts_per_cycle", f"{word}s per mesh cycle"),
             Answer("back_impacts_per_cycle", f"back {word}s per mesh cycle"),
             Answer("fastest_arrival", "fastest arrival", "µrad per τ", 1e6))
    return [one for one in every if one.name in data]


def influenced(data: xr.Dataset) -> dict[str, str]:
    """What parameters move, name -> words: the answers, and whether a pair rattles."""
    return {one.name: one.words for one in answers(data)} | {"rattles": "whether it rattles"}


def parameters_of(data: xr.Dataset) -> list[str]:
    """Names of what is drawn or listed."""
    return [str(name) for name in data["parameter"].values]


def events_of(data: xr.Dataset) -> dict[str, str]:
    """What is seen in a run or not, name -> words, those that are known of."""
    words = {"contact_can_be_kept": "contact can be kept (the torque is T_full or more)",
             "rattles": "rattling, from rest", "back_arrivals":
             f"back {arrivals_in(data.attrs).word}s, from rest"}
    return {str(name): words[str(name)] for name in data["event"].values}
