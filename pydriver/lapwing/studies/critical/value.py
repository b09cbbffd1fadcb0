"""A critical value with its interval, and the search it came from."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from lapwing.base.messages import facts_html, nearest
from lapwing.base.quantities import parameter as spoken
from lapwing.base.quantities import worded

if TYPE_CHECKING:
    import xarray as xr

DESCRIPTIONS = {
    "trial_value": (None, "value tried in the search for a critical value"),
    "trial_stage": ("", "why the value was tried"),
    "trial_starts": ("1", "motions followed"),
    "trial_rattling": ("1", "motions that rattle"),
    "trial_failed": ("1", "motions that failed numerically"),
    "trial_cycles": ("1", "mesh cycles examined"),
    "trial_back_cycles": ("1", "mesh cycles with a back impact"),
    "trial_bursts": ("1", "bursts of mesh cycles with a back impact"),
    "trial_rate_bound": ("1", "upper limit of the rate of bursts of back impacts per mesh cycle"),
    "trial_margin": ("rad", "force F above the one needed for contact")}


@dataclass(frozen=True, eq=False, repr=False)
class CriticalValue:
    """What a search for a critical value found.

    It stands for its number (`float(found)`) and, where an attribute or an item is asked for that
    it has not, for the dataset of the search: `found.attrs`, `found["trial_value"]`.

    Attributes
    ----------
    value : float, of the parameter; NaN where none was found
    low, high : float, the interval that holds it as far as the search can tell: of a closed form
        the value itself, else the bracket left; NaN where there is none
    outcome : str, 'found' or why not; in words: `why`
    parameter, units : str
    data : xarray.Dataset, what was tried
    """

    value: float
    low: float
    high: float
    outcome: str
    parameter: str
    units: str
    data: xr.Dataset

    @classmethod
    def of(cls, data: xr.Dataset) -> CriticalValue:
        """From the dataset of a search."""
        attrs = data.attrs
        value, bar = float(attrs["estimate"]), float(attrs["bar"])
        ends = (attrs["last_seen"], attrs["first_clean"]) if attrs["find"] == "back" \
            else (value - bar, value + bar)
        low, high = (math.nan, math.nan) if any(map(math.isnan, ends)) else sorted(ends)
        return cls(value, low, high, attrs["outcome"], attrs["parameter"], attrs["units"], data)

    def __float__(self) -> float:
        return self.value

    def __format__(self, form: str) -> str:
        return format(self.value, form) if form else str(self)

    @property
    def why(self) -> str:
        """Why there is no value, or none with an interval, in words; empty where it was found."""
        if self.outcome == "found":
            return ""
        if self.outcome in _OF_FORCE:
            return _OF_FORCE[self.outcome].format(phase=self.data.attrs["phase"])
        first, last, many = (self.data.attrs[name] for name in (
            "scan_from", "scan_to", "scan_values"))
        kept, lost = _SEEN[self.data.attrs["find"]]
        if self.outcome != "unsafe_throughout":
            if "trial_cycles" in self.data and not self.data["trial_cycles"].any():
                return "every motion failed numerically"
            return f"{kept} at any of {many} values from {first:.6g} to {last:.6g} {self.units}"
        if "trial_rattling" in self.data:
            at_end = self.data["trial_value"] == first
            if not self.data["trial_rattling"].where(at_end, 0).any():
                lost = "motions fail numerically"
        return f"{lost} at {first:.6g} {self.units} already, the safe end of the values"

    def __repr__(self) -> str:
        return f"<CriticalValue {self.data.attrs['find']} along {self.parameter}: " \
               f"{', '.join(self._facts().values())}>"

    def _repr_html_(self) -> str:
        return facts_html("CriticalValue", {
            "find": self.data.attrs["find"], "parameter": self.parameter, **self._facts()})

    def _facts(self) -> dict[str, str]:
        """Value and interval, or why there is none."""
        facts = {"value": f"{self.value:.12g} {self.units}"}
        if math.isfinite(self.low):
            facts["interval"] = f"from {self.low:.12g} to {self.high:.12g}"
        return facts | ({"outcome": f"{self.outcome}: {self.why}"} if self.why else {})

    def __getattr__(self, name: str) -> Any:
        if name.startswith("__") or name == "data":
            raise AttributeError(name)
        if hasattr(self.data, name):
            return getattr(self.data, name)
        known = [*(one.name for one in fields(self)), "why", "attrs", *map(str, self.data)]
        raise AttributeError(f"a critical value has no {name!r}, {nearest(name, known, 3)}")

    def __getitem__(self, name: Any) -> Any:
        return self.data[name]

    def __contains__(self, name: object) -> bool:
        return name in self.data


# What is seen of none of the values, and what at the first one already.
_SEEN = {"full": ("contact is not lost", "contact is lost"),
         "on": ("contact is not lost", "contact is lost"),
         "safe": ("nothing rattles", "motions rattle"),
         "back": ("no back impact is seen", "back impacts are seen")}
_OF_FORCE = {"resonance": "at an undamped resonance there is no engaged motion",
             "thrown_off": "at no value: a kink at mesh phase {phase:.6g} throws the tooth off",
             "struck": "at no value: a kink at mesh phase {phase:.6g} strikes the tooth"}


def found(about: dict[str, Any], find: str, parameter: str, outcome: str, estimate: float,
          bar: float, variables: dict[str, NDArray[Any]] | None = None,
          **attrs: Any) -> CriticalValue:
    """The answer of a search.

    Parameters
    ----------
    about : attributes that say what was run, `labels.settings`
    find, parameter, outcome, estimate, bar : attributes
    variables : name -> array (trials,)
    **attrs : further attributes
    """
    import xarray as xr

    unit = spoken(parameter).units
    dataset = xr.Dataset(
        {name: ("trial", np.asarray(column)) for name, column in (variables or {}).items()},
        attrs={**about, "find": find, "parameter": parameter, "units": unit, "outcome": outcome,
               "estimate": estimate, "bar": bar, **attrs})
    for name in dataset.data_vars:
        units, long_name = DESCRIPTIONS[str(name)]
        dataset[name].attrs = {"long_name": long_name, "units": unit if units is None else units}
    return CriticalValue.of(worded(dataset))
