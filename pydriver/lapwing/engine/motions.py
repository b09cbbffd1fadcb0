"""Equations of a periodic motion between its events, and what follows from them; in the engine."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from lapwing.engine.calls import api

if TYPE_CHECKING:
    from lapwing.model.oscillator import Oscillator

# Bounces that one list has room for: 0.99^2000 is 2e-9.
MOST_BOUNCES = 4000


@dataclass(frozen=True, eq=False)
class Curve:
    """A flank and its engaged response as fortran/branch/curve.f90 takes them.

    Attributes
    ----------
    knots : array (pieces + 1,), phases; of a series one number
    g : array (6, powers, pieces), g and its derivatives by τ in powers of the phase
    edges : array (steps + 1,), phases of the steps of the response
    q : array (2, powers, steps), the response in powers of the part of its step
    first : array (pieces + 1,), first step of each piece; one number: steps cross pieces
    terms : array (5, terms), of a series: order, g and the response as real and imaginary parts
    """

    knots: NDArray[Any]
    g: NDArray[Any]
    edges: NDArray[Any]
    q: NDArray[Any]
    first: NDArray[Any]
    terms: NDArray[Any]


class Blocks(NamedTuple):
    """Derivatives of the equations by the event before and by the event: (2, 2, n) each."""

    one: NDArray[Any]
    two: NDArray[Any]


def numbers_of(osc: Oscillator, scale: float, cycles: int) -> tuple[NDArray[Any], NDArray[Any]]:
    """Real and integer parameters of the equations, in the order of fortran/api/branches.f90."""
    return (np.array([osc.period, osc.force, osc.restitution, osc.gap_width, osc.damping_ratio,
                      scale]),
            np.array([osc.back_flank_te, osc.impact_law == "absolute",
                      osc.contact_law != "compliant", cycles], dtype=np.intc))


def event_equations(curve: Curve, numbers: tuple[NDArray[Any], NDArray[Any]],
                    layout: NDArray[Any], jumps: NDArray[Any],
                    z: NDArray[Any]) -> tuple[NDArray[Any], Blocks]:
    """By how much each event's two equations are off, and their derivatives.

    Parameters
    ----------
    curve : Curve
    numbers : of `numbers_of`
    layout : int array (4, n), kind, flank, piece and arc of each event
    jumps : array (n,), slope jumps where the pieces of events at kinks begin
    z : array (2n + 1,), phase and scaled speed of each event, and the parameter

    Returns
    -------
    residual, array (2n,), parts of the scale; Blocks
    """
    n = layout.shape[1]
    residual = np.empty((2, n), order="F")
    blocks = np.empty((2, 2, n, 2), order="F")
    reals, choices = numbers
    api.event_equations(curve.knots, curve.g, curve.edges, curve.q, curve.first, curve.terms,
                        np.concatenate([reals, jumps]), choices, layout, z, residual, blocks)
    return residual.T.ravel(), Blocks(blocks[..., 0], blocks[..., 1])


def bordered_solution(blocks: Blocks, column: NDArray[Any], row: NDArray[Any],
                      right: NDArray[Any]) -> NDArray[Any]:
    """Solution of the equations with a column and a row more; not finite where there is none.

    Parameters
    ----------
    blocks : Blocks
    column : array (2n,); row, right : arrays (2n + 1,)
    """
    n = blocks.one.shape[2]
    solution = np.empty(2 * n + 1)
    api.bordered_solution(blocks.one, blocks.two, column, row, right,
                          np.empty((2, 8, n), order="F"), solution)
    return solution


def round_trip(blocks: Blocks) -> tuple[float, float, int]:
    """Trace, determinant and rank of the map of a deviation once round; NaN: it has none."""
    trace, det, rank = api.round_trip(*blocks)
    return float(trace), float(det), int(rank)


def chatter_bounces(curve: Curve, numbers: tuple[NDArray[Any], NDArray[Any]], flank: int,
                    piece: int, phase: float, speed: float) -> tuple[NDArray[Any], NDArray[Any]]:
    """Phases of the bounces after one that leaves with a speed, and their speeds into the flank."""
    phases, speeds = np.empty((2, MOST_BOUNCES))
    count = api.chatter_bounces(curve.knots, curve.g, curve.terms, *numbers, flank, piece,
                                np.array([phase, speed]), phases, speeds)
    return phases[:count].copy(), speeds[:count].copy()
