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


class Ending(IntEnum):
    """How sure it is where a motion ends."""

    UNKNOWN = 0
    CERTAIN = 1
    PRESUMED = 2


class SearchStage(IntEnum):
    """Why a value was tried in the search for a critical value; the engine knows nothing of it."""

    SCAN = 0
    BISECTION = 1
    CARRIED = 2
    CONFIRMATION = 3
    FURTHER = 4


class SpecialPoint(IntEnum):
    """What happens at a special point of a branch.

    FOLD, PERIOD_DOUBLING, TORUS, BRANCH_POINT: a multiplier, or a pair, has magnitude one.
    GRAZING: a flight touches a flank, or an impact comes to nothing.
    RELEASE: a contact touches its end from inside, or a flight behind a release comes to nothing.
    REBOUND: the speed after an impact passes zero.
    CHATTER: bounces no longer die out.
    KINK: an impact comes upon a kink of the transmission error.
    KNOT: an event passes a place where the curvature alone jumps; this is no bifurcation.
    LIMIT: the end of the range asked for. CLOSED: the branch comes back to where it began.
    POINTS: as many points as were asked for. UNRESOLVED: what ends it was not found out.
    ENGAGED: the last separation vanishes; from here on the motion is the engaged one.
    APERIODIC: motions without a period rattle on one side and come to rest on the other; this is no
    point of a branch, but a bracket. JOINS: the branch comes upon a special point that it has
    passed already; what follows is known.
    """

    NONE = 0
    FOLD = 1
    PERIOD_DOUBLING = 2
    TORUS = 3
    BRANCH_POINT = 4
    GRAZING = 5
    RELEASE = 6
    REBOUND = 7
    CHATTER = 8
    KINK = 9
    KNOT = 10
    LIMIT = 11
    CLOSED = 12
    POINTS = 13
    UNRESOLVED = 14
    APERIODIC = 15
    ENGAGED = 16
    JOINS = 17


class BranchOutcome(IntEnum):
    """What becomes of the branch there: it goes on the same way, turns back, or ends."""

    PERSISTS = 1
    TURNS_BACK = 2
    ENDS = 3


class BranchEvent(IntEnum):
    """What an event of a continued motion is.

    GO_ON is an arrival after which the tooth stays in the flank; AT_KINK a release from a rigid
    flank at a knot, or an impact there, as its slope or curvature jumps.
    """

    REBOUND = 0
    GO_ON = 1
    RELEASE = 2
    CHATTER_END = 3
    AT_KINK = 4


class FoundMotion(IntEnum):
    """What a motion is from which a branch may begin.

    Its motion repeats and has events; it is in contact throughout; it has no period that was looked
    for; its run failed numerically.
    """

    PERIODIC = 0
    ENGAGED = 1
    APERIODIC = 2
    FAILED = 3


class FoundFrom(IntEnum):
    """How a motion began: from rest, carried up or down, from a grid of starts, at random.

    END: where another one, followed along its branch, is no longer stable.
    """

    REST = 0
    UP = 1
    DOWN = 2
    GRID = 3
    RANDOM = 4
    END = 5
