"""A critical value with its interval, and the search it came from."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from lapwing.base.messages import facts_html

if TYPE_CHECKING:
    import xarray as xr


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
    outcome : str, 'found' or why not
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

    def __repr__(self) -> str:
        what = f"{self.data.attrs['find']} along {self.parameter}"
        if self.outcome != "found":
            return f"<CriticalValue {what}: {self.outcome}>"
        return f"<CriticalValue {what}: {self.value:.12g} {self.units}, from {self.low:.12g} to " \
               f"{self.high:.12g}>"

    def _repr_html_(self) -> str:
        found = self.outcome == "found"
        return facts_html("CriticalValue", {
            "find": self.data.attrs["find"], "parameter": f"{self.parameter} ({self.units})",
            "outcome": self.outcome, **({
                "value": f"{self.value:.12g}", "low": f"{self.low:.12g}",
                "high": f"{self.high:.12g}"} if found else {})})

    def __getattr__(self, name: str) -> Any:
        if name.startswith("__") or name == "data":
            raise AttributeError(name)
        return getattr(self.data, name)

    def __getitem__(self, name: Any) -> Any:
        return self.data[name]

    def __contains__(self, name: object) -> bool:
        return name in self.data
