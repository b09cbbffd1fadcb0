"""Periodic motions: found by Newton's method, continued in a parameter."""

from lapwing.studies.orbit.continuation import (
    Followed,
    cascade,
    flip_distance,
    follow,
    period_doubling,
)
from lapwing.studies.orbit.newton import (
    NUMERICS,
    NoOrbit,
    Orbit,
    find_orbit,
    follow_cycles,
    settled_state,
)

__all__ = ["NUMERICS", "Followed", "NoOrbit", "Orbit", "cascade", "find_orbit", "flip_distance",
           "follow", "follow_cycles", "period_doubling", "settled_state"]
