"""The conditions that hold for all studies of a deck, as far as a sentence needs them."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, NamedTuple

from lapwing.base.quantities import PARAMETERS
from lapwing.model.gear_pair import SPEEDS


class Conditions(NamedTuple):
    """Speed of a deck.

    Attributes
    ----------
    speed : str, in words; empty: not known
    mesh_frequency : float, Hz; NaN: not known
    """

    speed: str = ""
    mesh_frequency: float = math.nan

    @classmethod
    def of(cls, operation: Mapping[str, float], pinion_teeth: float) -> Conditions:
        """From what a deck gives to all its studies.

        Parameters
        ----------
        operation : mapping, `Results.operation`
        pinion_teeth : float, NaN: not known
        """
        for name in SPEEDS:
            if name in operation:
                value, known = float(operation[name]), PARAMETERS[name]
                turns = {"pinion_speed_rpm": 1 / 60, "pinion_speed_rad_s": 0.5 / math.pi}
                per_second = value * (turns[name] * pinion_teeth if name in turns else 1)
                return cls(f"at a {known.words} of {value:g} {known.shown}", per_second)
        return cls()

    def words(self, laws: Mapping[str, Any]) -> str:
        """Speed and impact law, as they stand in a bracket; empty where neither is known."""
        impact = laws.get("contact_law") == "restitution" and "impact_law" in laws
        told = [*filter(None, [self.speed]),
                *([f"impact law `{laws['impact_law']}`"] if impact else [])]
        return ", ".join(told)

    def time(self, cycles: float) -> str:
        """So many mesh cycles as a time: ' (68 s)'; empty where the speed is not known."""
        return f" ({cycles / self.mesh_frequency:.2g} s)" if math.isfinite(self.mesh_frequency) \
            else ""


UNKNOWN = Conditions()
