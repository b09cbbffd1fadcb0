"""A corner of a branch: bounces of a chatter that are summed pass a jump of the curvature.

No event that is listed tells of it; the equations change their derivatives from one point to the
next. Where the tangent beyond leads back before the corner the parameter may turn there, and no
step along the tangent finds the branch again.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lapwing.studies.branch.motion.borders import moved_on
from lapwing.studies.branch.motion.curve import NotCorrected, Place, corrected
from lapwing.studies.branch.motion.witness import agrees, seen
from lapwing.studies.branch.trace.follower import Follower

# How far from a place behind which no step was found a corner is looked for, in the measure of
# length; by how much tangents before and behind it differ at least, and what part of that a
# tangent behind may differ from what the equations say there.
TRIED = (1e-8, 1e-7, 1e-6, 1e-5)
OTHER, OF_IT = 1e-3, 0.1
# Corners so many in a row, with ratios of their distances so alike, that lie closer together than
# this part of the range, pile up.
PILED, ALIKE, CLOSE = 6, 0.05, 1e-4


def around(follower: Follower, place: Place) -> tuple[Place, float] | None:
    """The branch behind a corner just ahead, going on, and by how much the corner's value is off.

    Beyond the corner the equations have the derivatives of what follows. A step along either way of
    the tangent that they give is corrected: on the wrong one there is none of the branch.

    Returns
    -------
    Place, float (of the parameter); None where there is no corner
    """
    problem = follower.problem
    if not place.layout.chatters or not problem.at(place.z)[2].pieces:
        return None
    for far in TRIED:
        ahead = place.z + far * place.tangent
        try:
            layout = moved_on(problem, place.layout, ahead)
            along = follower.place(layout, ahead, place.tangent).tangent
        except (NotCorrected, ValueError, OverflowError):
            continue
        apart = _length(follower, place, along - place.tangent)
        if apart < OTHER:
            continue
        for way in (1.0, -1.0):
            found = _behind(follower, place, far, way * along)
            if found is not None and _length(
                    follower, place, found.tangent - way * along) < OF_IT * apart:
                return found, abs(float(found.z[-1] - place.z[-1])) * problem.unit
    return None


def piled_up(follower: Follower, value: float) -> tuple[float, float] | None:
    """Where corners pile up, and by how much that may be off; None where they do not.

    Bounce after bounce passes the jump, with distances as those of a geometric series, until the
    end of the chatter does.
    """
    corners = follower.corners
    corners.append(value)
    if len(corners) < PILED:
        return None
    gaps = np.diff(corners[-PILED:])
    last, ratios = float(gaps[-1]), gaps[1:] / np.where(gaps[:-1], gaps[:-1], np.inf)
    ratio = float(ratios[-1])
    alike = bool(np.all(np.abs(ratios - ratio) < ALIKE))
    if not (alike and 0 < ratio < 1 and abs(last) < CLOSE * follower.problem.unit):
        return None
    rest = last * ratio / (1 - ratio)
    return value + rest, abs(rest)


def _behind(follower: Follower, place: Place, far: float, along: NDArray[Any]) -> Place | None:
    """A place of the branch so far along a tangent, or None."""
    problem, guess = follower.problem, place.z + far * along
    try:
        layout = moved_on(problem, place.layout, guess)
        z, _ = corrected(problem, layout, guess, problem.weights(layout) * along)
        found = follower.place(layout, z, along)
        near = _length(follower, place, z - guess) < far and moved_on(problem, layout, z) is layout
        if near and agrees(layout, z, seen(problem, layout, z, follower.distance)):
            return found
    except (NotCorrected, ValueError, OverflowError):
        pass
    return None


def _length(follower: Follower, place: Place, z: NDArray[Any]) -> float:
    return math.sqrt(float(follower.problem.weights(place.layout) @ z**2))
