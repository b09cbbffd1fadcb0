"""How a run is computed and what it records."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Any

from lapwing.base import arguments
from lapwing.base.arguments import Refusals

METHODS = ("auto", "exact", "rk4")


@arguments.complete()
@dataclass(frozen=True, kw_only=True)
class Numerics:
    """Tolerances and bounds of a run.

    Parameters
    ----------
    method : 'auto', 'exact' or 'rk4'
        closed form between events, or adaptive Runge-Kutta; 'auto': the first where it can be
    rtol : float, 1e-13 to 1e-2
        local error per step over the natural size of angles and velocities (docs/model.md)
    chatter_tol : float or None
        error of the end of a complete chatter, in mesh periods; default 1e-13, with rk4
        min(rtol, 1e-10)
    count_depth : float, 0 to 1
        a counted impact ends a flight deeper than this part of its cycle's deepest separation
    max_events_per_cycle, max_steps_per_cycle : int
        bounds after which a run ends with a status
    copy_repeats : bool
        whether rounds of cycles that begin with the same bits are computed once and then copied:
        the same results, sooner
    """

    method: str = "auto"
    rtol: float = 1e-10
    chatter_tol: float | None = None
    count_depth: float = 0.01
    max_events_per_cycle: int = 1_000_000
    max_steps_per_cycle: int = 10_000_000
    copy_repeats: bool = True

    def __post_init__(self) -> None:
        taken = Refusals()
        checked = {
            "method": taken.take(arguments.choice, "method", self.method, METHODS),
            "rtol": taken.take(arguments.real, "rtol", self.rtol, low=1e-13, high=1e-2),
            "count_depth": taken.take(arguments.real, "count_depth", self.count_depth, low=0.0,
                                      high=1.0),
            "copy_repeats": taken.take(arguments.flag, "copy_repeats", self.copy_repeats)}
        if self.chatter_tol is not None:
            checked["chatter_tol"] = taken.take(
                arguments.real, "chatter_tol", self.chatter_tol, above=0.0, high=1e-2)
        for key in ("max_events_per_cycle", "max_steps_per_cycle"):
            checked[key] = taken.take(arguments.whole, key, getattr(self, key), 1)
        taken.raise_if_any("numerics")
        for key, value in checked.items():
            object.__setattr__(self, key, value)


@dataclass(frozen=True, kw_only=True)
class Wanted:
    """What a run records; what is not named is neither computed nor stored.

    Without `bounces` those of a complete chatter that do not count are summed as soon as the sum is
    right to `chatter_tol`, not followed one by one; then no impacts, events or tangents are wanted.
    `depths` are those of the flights that end with an event; `speed_edges` (rad per τ, of equal
    ratio; sweeps only) are the bins of impact speeds; `averages` (sweeps only; want cycles) are
    `records.AVERAGES` in the outcome.
    """

    bounces: bool = True
    events: bool = False
    depths: bool = False
    impacts: bool = False
    grazes: bool = False
    strobe: bool = False
    cycles: bool = False
    tangent: bool = False
    averages: bool = False
    graze_distance: float = 0.0
    speed_edges: tuple[float, ...] = ()


def chosen(numerics: Numerics | None, **settings: tuple[Any, Any]) -> Numerics:
    """`Numerics` from one of a function's two ways of saying them.

    Parameters
    ----------
    numerics : Numerics or None
    **settings : name -> (value given, default)

    Raises
    ------
    TypeError, ValueError
        where it is no `Numerics`, or a setting is given beside it.
    """
    if numerics is None:
        given = {name: value for name, (value, _) in settings.items()}
        try:
            return _made(**given)
        except TypeError:  # what cannot be hashed is no number
            return Numerics(**given)
    arguments.instance("numerics", numerics, Numerics)
    for name, (value, default) in settings.items():
        if value is not default and value != default:
            raise ValueError(f"numerics and {name} are both given, expected one of them: "
                             f"Numerics({name}=...)")
    return numerics


@lru_cache(maxsize=64, typed=True)
def _made(**given: Any) -> Numerics:
    """The same settings are checked once."""
    return Numerics(**given)
