"""Named integer codes; all but `SearchStage` are the same numbers as in the Fortran engine.

Input choices (`contact_law`, `impact_law`, `gap`) are spelled in lower case in decks and keywords:
``ContactLaw[name.upper()]`` is the engine's number.
"""

from enum import IntEnum


class MotionState(IntEnum):
    """Which equation of motion holds."""

    SEPARATION = 0
    ENGAGEMENT = 1
    BACK_ENGAGEMENT = 2


class Flank(IntEnum):
    """The flank touched, if any."""

    NONE = 0
    DRIVE = 1
    COAST = 2


class EventKind(IntEnum):
    """What an entry of the event log records; `BACK_` marks the coast flank."""

    IMPACT = 1
    BACK_IMPACT = 2
    RELEASE = 3
    BACK_RELEASE = 4
    ENGAGE = 5
    BACK_ENGAGE = 6
    CHATTER_END = 7
    BACK_CHATTER_END = 8
    KINK = 9
    NEAR_GRAZE = 10
    BACK_NEAR_GRAZE = 11


class ContactLaw(IntEnum):
    """What happens between arrival and departure of a tooth."""

    RESTITUTION = 1
    COMPLIANT = 2
    RIGID = 3


class ImpactLaw(IntEnum):
    """Whether restitution acts on the velocity relative to the flank or on the absolute one."""

    RELATIVE = 1
    ABSOLUTE = 2


class Gap(IntEnum):
    """Where the flanks are: 0 and -backlash, 0 and -2·backlash, or the drive flank alone."""

    ONE_SIDED = 1
    SYMMETRIC = 2
    ONE_FLANK = 3


class Method(IntEnum):
    """How smooth pieces are moved along: adaptive Runge-Kutta, or in closed form."""

    RK4 = 1
    EXACT = 2


class Status(IntEnum):
    """How a run of the engine ended."""

    OK = 0
    TOO_MANY_EVENTS = 1
    TOO_MANY_STEPS = 2
    STEP_TOO_SMALL = 3
    NOT_FINITE = 4
    UNFINISHED = 5
    OUT_OF_MEMORY = 6


class SearchStage(IntEnum):
    """Why a value was tried in the search for a critical value; the engine knows nothing of it."""

    SCAN = 0
    BISECTION = 1
    CARRIED = 2
    CONFIRMATION = 3
    FURTHER = 4
