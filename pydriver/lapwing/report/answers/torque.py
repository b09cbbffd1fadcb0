"""What is known along the braking torque at the deck's own speed, of all studies together."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from lapwing.base.arrivals import arrivals_in
from lapwing.base.messages import at_most
from lapwing.report.answers.conditions import UNKNOWN, Conditions
from lapwing.report.answers.evidence import looks, together
from lapwing.report.words import parameter_unit, plural
from lapwing.results.findings import START_NAMES, names

if TYPE_CHECKING:
    import xarray as xr


class Torque:
    """What is known along the braking torque at the deck's own speed.

    Attributes
    ----------
    responses, criticals, sweeps : lists of Dataset, those at this operating point
    diagrams : list of Dataset, bifurcation diagrams along it
    conditions : Conditions, what is the same for all of them
    looks, coast : lists of Look, where the torque presses on the drive and on the coast flanks
    rattling, back : Seen
    kept : (find, outcome, value) of T_full or T_on, or None
    laws : dict, what the studies ran under
    """

    unit = parameter_unit("brake_torque")

    def __init__(self, responses: Any, criticals: Any, sweeps: Any,
                 conditions: Conditions = UNKNOWN, diagrams: Any = ()) -> None:
        self.responses = [one for one in responses if not int(one.attrs.get("own_operation", 0))]
        self.criticals = [one for one in criticals if one.attrs["parameter"] == "brake_torque"
                          and not int(one.attrs.get("own_operation", 0))]
        self.sweeps = [one for one in sweeps if one["status"].dims[1] == "brake_torque"]
        self.diagrams = [one for one in diagrams if one.attrs["parameter"] == "brake_torque"]
        self.looks = looks(responses, criticals, sweeps)
        self.coast = looks(responses, criticals, sweeps, flank="coast")
        self.rattling, self.back = (together(self.looks, what) for what in ("rattling", "back"))
        self.kept = self._kept()
        studies = [*self.responses, *self.sweeps, *self.criticals]
        # Files of older versions have these attributes in some studies only.
        self.laws = {key: one.attrs[key] for one in reversed(studies) for key in
                     ("contact_law", "impact_law", "gap", "balanced") if key in one.attrs}
        self.law = arrivals_in(self.laws)
        own = any(int(one.attrs.get("own_operation", 0)) for one in self.sweeps)
        self.conditions = UNKNOWN if own else conditions

    def at(self, values: NDArray[Any], what: str = "looked at") -> str:
        """Such values in words: 'at 12 N·m', 'at the 5 torques looked at, 12 to 14 N·m'."""
        if len(values) == 1:
            return f"at {values[0]:g} {self.unit}, the only torque {what}"
        return f"at the {len(values)} torques {what}, {values[0]:g} to {values[-1]:g} {self.unit}"

    def search(self) -> xr.Dataset | None:
        """A search for T_safe, or None."""
        return next((one for one in self.criticals if one.attrs["find"] == "safe"
                     and one.attrs.get("safe_end") == "high"), None)

    def quiet(self) -> tuple[NDArray[Any], str]:
        """Values above the last rattling at which nothing rattles and nothing failed.

        Returns
        -------
        array of values, how they were looked at in words

        Those of a search for T_safe where there is one: it tries more starts.
        """
        above = self.rattling.above(self.rattling.last)
        quiet, search = above.values[~above.failed], self.search()
        if search is not None:
            tried = quiet[np.isin(quiet, search["trial_value"].values)]
            if tried.size:
                attrs = search.attrs
                return tried, (f"each from rest and {plural(attrs['n_starts'] - 1, 'other start')},"
                               f" followed for {attrs['settle'] + attrs['record']} mesh cycles")
        return quiet, self.how(quiet)

    def how(self, values: NDArray[Any]) -> str:
        """From which starts the motions at all of some values came, or that it is not the same."""
        from_ = {one.how: set(one.values[one.motions > 0]) for one in self.looks
                 if one.rattling is not None}
        every = [how for how in from_ if how in START_NAMES and set(values) <= from_[how]]
        if every:
            return names(every)
        return "by the responses alone" if set(from_) == {"response"} \
            else "not from the same starts at each"

    def last_rattling(self) -> str:
        """The greatest torque with rattling, to the digits that the step to a quiet one leaves."""
        quiet, last = self.quiet()[0], self.rattling.last
        assert last is not None  # asked for where something rattles
        return at_most(last, quiet[0] - last if quiet.size else 0.0)

    def _kept(self) -> tuple[str, str, float] | None:
        """(find, outcome, value) of T_full or T_on, or None."""
        for one in self.criticals:
            if one.attrs["find"] in ("full", "on"):
                attrs = one.attrs
                return attrs["find"], attrs["outcome"], float(attrs.get("estimate", math.nan))
        for one in (*self.sweeps, *self.responses):
            if math.isfinite(one.attrs.get("full_engagement", math.nan)):
                return "full", "found", float(one.attrs["full_engagement"])
        return None
