"""What all studies of a run saw along the braking torque, brought together value by value."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from lapwing.base.codes import MotionState, SearchStage, Status
from lapwing.base.quantities import are_labels
from lapwing.results.findings import known, rattles

if TYPE_CHECKING:
    import xarray as xr


class Look(NamedTuple):
    """What one study saw at the values at which it looked; a value may stand there twice.

    Attributes
    ----------
    values : array (n,), of the parameter
    motions : array (n,), motions followed to their end
    failed : array (n,), motions that failed numerically
    rattling : array (n,) of bool, whether a motion was anything but engaged; None: not looked at
    back : array (n,) of bool, whether a motion met the coast flank; None: not looked at
    cycles : array (n,), mesh cycles examined, of all motions together
    how : str, 'search', 'response' or the start of a sweep
    """

    values: np.ndarray
    motions: np.ndarray
    failed: np.ndarray
    rattling: np.ndarray | None
    back: np.ndarray | None
    cycles: np.ndarray
    how: str


class Seen(NamedTuple):
    """Where something was seen, of all values at which anything is known; all of them ascending.

    Attributes
    ----------
    values : array (n,), with a result
    seen : array (n,) of bool
    cycles : array (n,), mesh cycles examined
    failed : array (n,) of bool, whether some motion failed there
    """

    values: np.ndarray
    seen: np.ndarray
    cycles: np.ndarray
    failed: np.ndarray

    @property
    def last(self) -> float | None:
        """The greatest value at which it was seen, or None."""
        return float(self.values[self.seen].max()) if self.seen.any() else None

    def above(self, value: float | None) -> Seen:
        """The part above a value; all of it for None."""
        return self if value is None else self.where(self.values > value)

    def where(self, rows: NDArray[Any]) -> Seen:
        """Some of the values."""
        return Seen(*(column[rows] for column in self))


def looks(responses: Any, criticals: Any, sweeps: Any, parameter: str = "brake_torque",
          flank: str = "drive") -> list[Look]:
    """What the studies saw along a parameter at the deck's own operating point.

    Parameters
    ----------
    responses, criticals, sweeps : sequences of Dataset
    parameter : str
    flank : 'drive' or 'coast', the flank that the torques press on: where they press on the coast
        flank, being engaged there is no rattling, and the drive flank takes the other's place

    Returns
    -------
    list of Look; studies with torques or a speed of their own are left out, and searches from the
    low end
    """
    found = [_of_branch(sweep.isel(start=i), flank) for sweep in sweeps
             if sweep["status"].dims[1] == parameter and "states_visited" in sweep
             for i in range(sweep.sizes["start"])]
    if flank == "drive":
        found += [_of_search(one) for one in criticals if one.attrs["parameter"] == parameter
                  and "trial_failed" in one and not int(one.attrs.get("own_operation", 0))
                  and one.attrs.get("safe_end") == "high"]
    if parameter == "brake_torque":
        found += [_of_response(one.attrs, flank) for one in responses
                  if not int(one.attrs.get("own_operation", 0))
                  and (one.attrs["force"] < 0) == (flank == "coast")]
    return found


def together(found: list[Look], what: str) -> Seen:
    """Where something was seen by any study, value by value.

    Parameters
    ----------
    found : sequence of Look
    what : 'rattling' or 'back'

    Returns
    -------
    Seen
    """
    some = [one for one in found if getattr(one, what) is not None]
    if not some:
        return Seen(*(np.zeros(0, kind) for kind in (float, bool, int, bool)))
    columns = [np.concatenate([np.asarray(column) for column in part]) for part in zip(
        *((one.values, getattr(one, what), one.cycles, one.failed, one.motions) for one in some),
        strict=True)]
    values, first, where = np.unique(columns[0], return_index=True, return_inverse=True)
    if are_labels(values):  # they stay in their order
        order = np.argsort(first)
        values, where = values[order], np.argsort(order)[where]
    seen, cycles, failed, motions = (np.bincount(where, column.astype(float), values.size)
                                     for column in columns[1:])
    every = Seen(values, seen > 0, cycles.round().astype(int), failed > 0)
    return every.where(motions > 0)


def failures(found: list[Look]) -> int:
    """Motions that failed numerically, over all studies."""
    return int(sum(one.failed.sum() for one in found))


def _of_search(critical: xr.Dataset) -> Look:
    """Trials of a search, without those that follow rattling longer."""
    rows = np.ones(critical.sizes["trial"], bool)
    if "trial_stage" in critical:
        rows = critical["trial_stage"].values != SearchStage.CONFIRMATION
    value, starts, failed = (critical[f"trial_{key}"].values[rows]
                             for key in ("value", "starts", "failed"))
    motions = starts - failed
    if "trial_rattling" in critical:
        return Look(value, motions, failed, critical["trial_rattling"].values[rows] > 0, None,
                    motions * int(critical.attrs["record"]), "search")
    return Look(value, motions, failed, None, critical["trial_back_cycles"].values[rows] > 0,
                critical["trial_cycles"].values[rows], "search")


def _of_branch(branch: xr.Dataset, flank: str) -> Look:
    """One start of a sweep; points that were never reached are no failures."""
    some = (branch["force"].values < 0) == (flank == "coast")
    branch = branch.isel({branch["status"].dims[0]: some})
    done, status = known(branch), branch["status"].values
    lost = ~done & (status != Status.UNFINISHED)
    if flank == "drive":
        rattling, others = rattles(branch), ("back_impacts", "back_engages")
    else:
        alone = (branch["states_visited"] == 1 << MotionState.BACK_ENGAGEMENT) \
            & ~(branch["back_impacts"] > 0)
        rattling = done & ~alone.all("recorded_cycle").values
        others = ("impacts", "engages")
    met = done & (branch[others[0]] + branch[others[1]] > 0).any("recorded_cycle").values
    return Look(branch[branch["status"].dims[0]].values, done.astype(int), lost.astype(int),
                rattling, met, done * branch.sizes["recorded_cycle"], str(branch["start"].values))


def _of_response(attrs: dict[str, Any], flank: str) -> Look:
    """One response; what it met at the other flank counts whatever the flight before."""
    done = not attrs["status"]
    own, other = MotionState.ENGAGEMENT, MotionState.BACK_ENGAGEMENT
    sides = ("", "back_")
    if flank == "coast":
        own, other, sides = other, own, sides[::-1]
    hits, met = (attrs[f"resolved_{side}impacts_per_cycle"] > 0 for side in sides)
    engaged = attrs["states_visited"] == 1 << own and not hits
    met = met or bool(int(attrs["states_visited"]) >> other & 1)
    values, known, failed, rattling, seen, cycles = (np.array([column]) for column in (
        float(attrs["brake_torque"]), int(done), int(not done), done and not engaged,
        done and met, done * int(attrs["record_cycles"])))
    return Look(values, known, failed, rattling, seen, cycles, "response")
