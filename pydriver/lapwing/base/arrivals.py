"""What counts as an arrival of the tooth at a flank under each contact law, and what it is called.

Restitution makes each arrival an impact, told after flights deeper than a part of their cycle's
deepest separation. Without restitution nothing is an impact: every engagement of a free tooth is
told, whatever the depth of its flight. Periods, classes, reports and figures all count by this.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from lapwing.base.codes import EventKind, Status

if TYPE_CHECKING:
    import xarray as xr


class Arrivals(NamedTuple):
    """The arrivals of one contact law.

    Attributes
    ----------
    word : str, what one is called
    drive, coast : str, columns of the cycle table with the numbers told
    every_drive, every_coast : str, columns with the numbers whatever the flight
    kinds : tuple of EventKind, in the event log: at the drive and at the coast flank
    threshold : bool, whether a flight must be deep to be told
    """

    word: str
    drive: str
    coast: str
    every_drive: str
    every_coast: str
    kinds: tuple[EventKind, EventKind]
    threshold: bool

    def rule(self, count_depth: float) -> str:
        """Which arrivals are told, in words; `count_depth` is a part of the deepest separation."""
        if self.threshold:
            return f"after flights deeper than {100 * count_depth:g} % of their cycle's deepest"
        return "every one, for nothing bounces"


IMPACTS = Arrivals("impact", "counted_impacts", "counted_back_impacts", "impacts", "back_impacts",
                   (EventKind.IMPACT, EventKind.BACK_IMPACT), True)
ENGAGEMENTS = Arrivals("engagement", "engages", "back_engages", "engages", "back_engages",
                       (EventKind.ENGAGE, EventKind.BACK_ENGAGE), False)


def arrivals_of(contact_law: str) -> Arrivals:
    """Arrivals under a contact law, given by its name in lower case."""
    return ENGAGEMENTS if contact_law == "compliant" else IMPACTS


def arrivals_in(attrs: Mapping[Any, Any]) -> Arrivals:
    """Arrivals of a response or a sweep, from its attributes."""
    return arrivals_of(attrs.get("contact_law", "restitution"))


def per_cycle(sweep: xr.Dataset, side: str = "drive") -> NDArray[Any]:
    """Arrivals per mesh cycle at each point of a sweep.

    Means over the last whole period, or over all recorded cycles of a motion without one.

    Parameters
    ----------
    sweep : xarray.Dataset of `lapwing.sweep` with 'cycles' observed, or one start of it
    side : 'drive' or 'coast'

    Returns
    -------
    array of the shape of `status`; NaN where there is no result
    """
    law = arrivals_in(sweep.attrs)
    column = sweep[law.drive if side == "drive" else law.coast].transpose(..., "recorded_cycle")
    counts, period = column.values.astype(float), sweep["period"].values
    done = sweep["status"].values == Status.OK
    result = np.full(period.shape, np.nan)
    for length in np.unique(period[done]) if counts.shape[-1] else ():
        rows = done & (period == length)
        result[rows] = counts[rows][:, -int(length):].mean(axis=-1)  # -0: all of them
    return result


def listed_impacts(sweep: xr.Dataset) -> tuple[NDArray[Any], NDArray[Any]]:
    """Which impacts of a sweep's list belong to which of its points.

    Parameters
    ----------
    sweep : xarray.Dataset of `lapwing.sweep` with 'impacts' observed, or a selection of its points

    Returns
    -------
    place, point : (n,) arrays of int
        Places along `impact` and, of each, the point, counted in the order of `kept_impacts`
    """
    first, kept = (sweep[name].values.ravel().astype(int)
                   for name in ("first_impact", "kept_impacts"))
    point = np.repeat(np.arange(kept.size), kept)
    within = np.arange(point.size) - np.repeat(np.cumsum(kept) - kept, kept)
    return first[point] + within, point
