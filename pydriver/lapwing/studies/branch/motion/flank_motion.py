"""A flank and the engaged response to it at given phases, each on a piece that is named.

A periodic motion is continued by equations that are smooth: a phase that comes to the end of its
piece of the table is followed a little beyond, on the same polynomial, and the crossing is located.
"""

from __future__ import annotations

import math
from collections import OrderedDict
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lapwing.engine.flanks import series_is_taken
from lapwing.model.linear_response import engaged_response, flank_harmonics
from lapwing.model.oscillator import Oscillator

ORDERS = 6
MOST_KEPT = 8
_FACTORIAL = np.array([math.factorial(k) for k in range(ORDERS)], dtype=float)


class FlankMotion:
    """g and its derivatives by τ, and q: the response q'' + 2ξq' + q = -g''.

    Parameters
    ----------
    osc : Oscillator
    """

    def __init__(self, osc: Oscillator) -> None:
        self.osc, self.period = osc, osc.period
        self.is_series = series_is_taken(osc.te)
        if self.is_series:
            order, self._amplitude = flank_harmonics(osc)
            self._rate = order * osc.mesh_frequency_ratio
            self._turn = 2j * math.pi * order
        else:
            self._coefficients = _derived(osc.flank_scale * osc.te.coefficients, self.period)
        self._response: Any = None

    @property
    def pieces(self) -> int:
        """Pieces in a mesh period; a series is one piece without end."""
        return 0 if self.is_series else len(self.osc.te.knots) - 1

    def piece(self, phase: NDArray[Any]) -> NDArray[Any]:
        """Pieces on which phases lie (right limits), counted from that which begins at phase 0."""
        if self.is_series:
            return np.zeros(np.shape(phase), dtype=int)
        turn = np.floor(phase)
        own = np.searchsorted(self.osc.te.knots, phase - turn, side="right") - 1
        found: NDArray[Any] = np.minimum(own, self.pieces - 1) + turn * self.pieces
        return found.astype(int)

    def begin(self, piece: Any) -> Any:
        """Phases at which pieces begin, mesh periods; that of the next one is where they end."""
        turn, own = np.divmod(piece, self.pieces)
        return self.osc.te.knots[own] + turn

    def slope_jump(self, piece: Any) -> Any:
        """By how much g' jumps where pieces begin; 0 but for rounding where there is no kink."""
        at = self.osc.te.knots[np.mod(piece, self.pieces)]
        te = self.osc.te
        jump = te.slope(at) - te.slope(at, "left")
        return self.osc.flank_scale / self.period * jump

    def has_kink(self, piece: int) -> bool:
        """Whether a piece begins at a kink."""
        return bool(self.osc.te.kinks[piece % self.pieces])

    def _offset(self, phase: NDArray[Any], piece: NDArray[Any]) -> NDArray[Any]:
        """Phase from the beginning of the piece; may lie a little outside of it."""
        found: NDArray[Any] = phase - self.begin(piece)
        return found

    def derivatives(self, phase: NDArray[Any], piece: NDArray[Any]) -> NDArray[Any]:
        """g, g', ... to the fifth, by τ: array (6, n)."""
        if self.is_series:
            turned = np.exp(np.multiply.outer(np.mod(phase, 1.0), self._turn)) * self._amplitude
            powers = (1j * self._rate[:, None]) ** np.arange(ORDERS)
            return np.ascontiguousarray((turned @ powers).real.T)
        own, x = self._coefficients[:, :, piece % self.pieces], self._offset(phase, piece)
        found: NDArray[Any] = own[-1].copy()
        for k in range(ORDERS - 2, -1, -1):
            found *= x
            found += own[k]
        return found

    def bend(self, phase: NDArray[Any], known: NDArray[Any], s: NDArray[Any]) -> NDArray[Any]:
        """(g(t + s) - g(t) - g'(t) s)/s on one piece, without cancellation.

        Parameters
        ----------
        phase : array (n,), at t
        known : array (6, n), `derivatives` at t
        s : array (n,), τ, not 0
        """
        if not self.is_series:
            value = np.zeros(len(s))
            for k in range(ORDERS - 1, 1, -1):
                value = (value + known[k] / _FACTORIAL[k]) * s
            return value
        start = np.exp(np.multiply.outer(np.mod(phase, 1.0), self._turn)) * self._amplitude
        x = np.multiply.outer(s, self._rate)
        # e^ix - 1 - ix: real part -2 sin²(x/2), imaginary part sin x - x.
        rest = -2 * np.sin(0.5 * x) ** 2 + 1j * _sine_less_angle(x)
        found: NDArray[Any] = np.sum((start * rest).real, axis=-1) / s
        return found

    def response(self, phase: NDArray[Any], piece: NDArray[Any]) -> NDArray[Any]:
        """q and q' at phases: array (2, n)."""
        if self._response is None:
            self._response = self._made_response()
        if self.is_series:
            turned = np.exp(np.multiply.outer(np.mod(phase, 1.0), self._turn)) * self._response
            return np.array([turned.real.sum(axis=-1),
                             (turned * (1j * self._rate)).real.sum(axis=-1)])
        edges, coefficients, first = self._response
        if first is None:
            x = np.mod(phase, 1.0)
            begin, last = 0, len(edges) - 2
        else:
            own = piece % self.pieces
            begin, last = first[own], first[own + 1] - 1
            x = self._offset(phase, piece) + self.osc.te.knots[own]
        step = np.clip(np.searchsorted(edges, x, side="right") - 1, begin, last)
        width = edges[step + 1] - edges[step]
        t, own = (x - edges[step]) / width, coefficients[:, :, step]
        found: NDArray[Any] = own[-1].copy()
        for k in range(len(own) - 2, -1, -1):
            found *= t
            found += own[k]
        found[1] /= width * self.period
        return found

    def _made_response(self) -> Any:
        osc = self.osc
        if self.is_series:
            square = self._rate**2
            return square / (1 - square + 2j * osc.damping_ratio * self._rate) * self._amplitude
        response = engaged_response(osc.with_force(0.0))
        if response.free.any():
            raise ValueError("branch: the mesh is too slow against the spring for contact to be "
                             "continued")
        edges, coefficients = response.edges, _derived(response.coefficients, 1.0, orders=2)
        if len(osc.te.harmonics):
            return edges, coefficients, None
        return edges, coefficients, np.searchsorted(edges, osc.te.knots)


def _derived(coefficients: NDArray[Any], unit: float, orders: int = ORDERS) -> NDArray[Any]:
    """Coefficients of polynomials (pieces, powers) and of their derivatives over a unit.

    Returns
    -------
    array (powers, orders, pieces), so that all orders are evaluated at once
    """
    pieces, powers = coefficients.shape
    found = np.zeros((powers, orders, pieces))
    for order in range(orders):
        for k in range(order, powers):
            factor = math.factorial(k) / math.factorial(k - order) / unit**order
            found[k - order, order] = coefficients[:, k] * factor
    return found


def _sine_less_angle(x: NDArray[Any]) -> NDArray[Any]:
    """sin x - x, also for small x."""
    square, term, total = x * x, x, np.zeros_like(x)
    for k in range(1, 9):
        term = -term * square / (2 * k * (2 * k + 1))
        total = total + term
    return np.where(np.abs(x) < 1, total, np.sin(x) - x)


class Motions:
    """Flank motions of oscillators that differ in force alone are the same one."""

    def __init__(self) -> None:
        self._kept: OrderedDict[tuple[Any, ...], FlankMotion] = OrderedDict()

    def of(self, osc: Oscillator) -> FlankMotion:
        """The flank motion of an oscillator."""
        key = (osc.te, osc.mesh_frequency_ratio, osc.damping_ratio, osc.flank_scale)
        if key not in self._kept:
            if len(self._kept) >= MOST_KEPT:
                self._kept.popitem(last=False)
            self._kept[key] = FlankMotion(osc)
        return self._kept[key]
