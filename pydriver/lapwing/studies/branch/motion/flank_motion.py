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
from lapwing.engine.motions import Curve
from lapwing.model.linear_response import engaged_response, flank_harmonics
from lapwing.model.oscillator import Oscillator

ORDERS = 6
MOST_KEPT = 8


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
        self._curves: dict[bool, Curve] = {}

    def curve(self, response: bool) -> Curve:
        """As the engine takes it, with the engaged response or without."""
        if response not in self._curves:
            self._curves[response] = self._series_curve() if self.is_series else \
                self._table_curve(response)
        return self._curves[response]

    def _series_curve(self) -> Curve:
        response = self._kept_response()
        parts = [self._rate / self.osc.mesh_frequency_ratio]
        for one in (self._amplitude, response):
            parts += [one.real, one.imag]
        none = np.zeros(1)
        return Curve(none, np.zeros((6, 1, 1), order="F"), none, np.zeros((2, 1, 1), order="F"),
                     none, np.asfortranarray(parts))

    def _table_curve(self, with_response: bool) -> Curve:
        edges, q, first = np.zeros(1), np.zeros((2, 1, 1), order="F"), np.zeros(1)
        if with_response:
            edges, coefficients, steps = self._kept_response()
            q = np.asfortranarray(coefficients.transpose(1, 0, 2))
            first = first if steps is None else np.asarray(steps, dtype=float)
        return Curve(np.ascontiguousarray(self.osc.te.knots, dtype=float),
                     np.asfortranarray(self._coefficients.transpose(1, 0, 2)),
                     np.ascontiguousarray(edges, dtype=float), q, first,
                     np.zeros((5, 1), order="F"))

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

    def response(self, phase: NDArray[Any], piece: NDArray[Any]) -> NDArray[Any]:
        """q and q' at phases: array (2, n)."""
        response = self._kept_response()
        if self.is_series:
            turned = np.exp(np.multiply.outer(np.mod(phase, 1.0), self._turn)) * response
            return np.array([turned.real.sum(axis=-1),
                             (turned * (1j * self._rate)).real.sum(axis=-1)])
        edges, coefficients, first = response
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

    def _kept_response(self) -> Any:
        if self._response is None:
            self._response = self._made_response()
        return self._response

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
