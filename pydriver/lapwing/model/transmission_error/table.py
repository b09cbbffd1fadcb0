"""Transmission error of one mesh period as a periodic table of polynomial pieces.

Phase is counted in mesh periods; the table covers [0, 1) and repeats.  A *kink* is a slope jump
that belongs to the data (the transfer point between two tooth pairs); it is marked by whoever
builds the table and never inferred from rounding.
"""

from __future__ import annotations

import os
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from numbers import Real
from typing import Any

import numpy as np
from numpy.polynomial import polynomial as power
from numpy.typing import ArrayLike, NDArray

from lapwing.base import arguments
from lapwing.base.arguments import LEAST, MOST
from lapwing.base.messages import facts_html
from lapwing.model.harmonic_series import FINE_TOLERANCE, harmonic_derivative, harmonic_table
from lapwing.model.transmission_error import algebra
from lapwing.model.transmission_error.extrema import extrema_of
from lapwing.model.transmission_error.file import TransmissionErrorFileError, read_columns
from lapwing.model.transmission_error.samples import (
    flags,
    hermite_table,
    samples_of_pairs,
    spline_table,
)

# A joint of two pieces may be off by rounding (about 1e-14 of the largest value); a gap or an
# unmarked slope jump in the data is far larger.
_JOINT_TOLERANCE = 1e-9
# Of a harmonic series; a table has none but zeros beyond the fifth.
MOST_DERIVATIVES = 20
# The pieces of a table grow with the highest order.
MOST_ORDER = 1000


@arguments.complete()
@dataclass(frozen=True, eq=False, repr=False)
class TransmissionError:
    """Periodic piecewise-polynomial transmission error (degree at most 5).

    Parameters
    ----------
    knots : (n+1,) array, mesh periods; from 0 to 1, strictly ascending.
    coefficients : (n, 6) array, rad per period^k; ascending powers of (phase - knots[i]).
    kinks : (n,) bool array; True where the slope jump at knots[i] is part of the data.
    harmonics : (m, 3) array of order, amplitude (rad), shift (rad); the series behind the table.
    te_sign_hint : 'printed', or 'geometric' for a table made from (pinion, gear) angle pairs.

    Raises
    ------
    ValueError
        Wrong shapes, knots out of order, pieces that do not join (value, or slope off a kink).
    """

    knots: NDArray[Any]
    coefficients: NDArray[Any]
    kinks: NDArray[Any]
    harmonics: NDArray[Any] = field(default_factory=lambda: np.zeros((0, 3)))
    te_sign_hint: str = "printed"

    def __post_init__(self) -> None:
        # Coefficients of narrow pieces are large beyond any value of the table.
        for name, ndim, largest in (("knots", 1, 1.0), ("coefficients", 2, 1e300)):
            self._store(name, arguments.reals(name, getattr(self, name), ndim=ndim,
                                              largest=largest))
        self._store("kinks", flags("kinks", self.kinks))
        harmonics = arguments.reals("harmonics", self.harmonics, empty=True)
        if harmonics.size % 3:
            raise ValueError("harmonics: expected is an (m, 3) array")
        self._store("harmonics", harmonics.reshape(-1, 3))
        arguments.choice("te_sign_hint", self.te_sign_hint, ("printed", "geometric"))
        n = self.knots.size - 1
        if self.coefficients.shape != (n, 6) or self.kinks.shape != (n,):
            raise ValueError("shapes must be knots (n+1,), coefficients (n, 6), kinks (n,)")
        if self.knots[0] != 0 or self.knots[-1] != 1 or not np.all(np.diff(self.knots) > 0):
            raise ValueError("knots must ascend strictly from 0 to 1")
        if not self.magnitude <= MOST:
            raise ValueError(f"coefficients give values beyond {MOST:g} rad")
        self._check_joint(0, np.zeros(n, dtype=bool), "value")
        self._check_joint(1, self.kinks, "slope (and the knot is not marked as a kink)")

    def __repr__(self) -> str:
        said = ", ".join(f"{name}: {fact}" for name, fact in self._facts().items())
        return f"<TransmissionError {said}>"

    def _repr_html_(self) -> str:
        return facts_html("TransmissionError", self._facts())

    def _facts(self) -> dict[str, object]:
        """What tells one from another, in words."""
        made = {"harmonics": len(self.harmonics)} if len(self.harmonics) else {}
        return {"peak to peak": f"{self.peak_to_peak:.6g} rad", **made,
                "pieces": len(self.kinks), "kinks": int(self.kinks.sum())}

    def __reduce__(self) -> tuple[Any, ...]:
        # A copy from another process is checked and read-only as well.
        return type(self), tuple(getattr(self, one.name) for one in fields(self))

    def _store(self, name: str, array: NDArray[Any]) -> None:
        array.flags.writeable = False
        object.__setattr__(self, name, array)

    def _check_joint(self, order: int, excused: NDArray[Any], what: str) -> None:
        right = self.derivative(order, self.knots[:-1], "right")
        jump = right - self.derivative(order, self.knots[:-1], "left")
        terms = np.abs(self.coefficients) * np.diff(self.knots)[:, None] ** np.arange(6)
        scale = terms.max() if order == 0 else (terms / np.diff(self.knots)[:, None]).max()
        wrong = (np.abs(jump) > _JOINT_TOLERANCE * scale) & ~excused
        if wrong.any():
            raise ValueError(f"the {what} jumps at phase {self.knots[:-1][wrong].tolist()}")

    def _locate(self, phase: NDArray[Any], side: str) -> tuple[NDArray[Any], NDArray[Any]]:
        arguments.choice("side", side, ("left", "right"))
        seam, same = (0.0, 1.0) if side == "left" else (1.0, 0.0)
        phase = np.mod(phase, 1.0)
        phase = np.where(phase == seam, same, phase)
        piece = np.asarray(np.searchsorted(
            self.knots, phase, side="left" if side == "left" else "right") - 1)
        return piece, phase - self.knots[piece]

    def derivative(self, order: int, phase: ArrayLike,
                   side: str = "right") -> NDArray[Any]:
        """Derivative of any order (0: the value) with respect to phase, rad per period^order.

        Parameters
        ----------
        order : int, 0 to 20
        phase : float or array, mesh periods; any finite number, taken modulo 1
        side : 'right' or 'left', which limit to take at a knot

        Returns
        -------
        ndarray, shape of `phase`

        Raises
        ------
        ValueError
            Order out of range, unknown side, phase not finite (TypeError where one is no number).
        """
        order = arguments.whole("order", order, 0, MOST_DERIVATIVES)
        phase = arguments.reals("phase", phase, empty=True)
        if len(self.harmonics):
            arguments.choice("side", side, ("left", "right"))
            return harmonic_derivative(self.harmonics, order, np.mod(phase, 1.0))
        return self.table_derivative(order, phase, side)

    def table_derivative(self, order: int, phase: ArrayLike,
                         side: str = "right") -> NDArray[Any]:
        """As `derivative`, from the table also where there is a harmonic series behind it."""
        order = arguments.whole("order", order, 0, MOST_DERIVATIVES)
        piece, offset = self._locate(arguments.reals("phase", phase, empty=True), side)
        if order > 5:
            return np.zeros(piece.shape)
        local = power.polyder(self.coefficients[piece], order, axis=-1)
        value: NDArray[Any] = power.polyval(offset, np.moveaxis(local, -1, 0), tensor=False)
        return value

    def value(self, phase: ArrayLike) -> NDArray[Any]:
        """Transmission error (rad) at `phase` (mesh periods, any shape)."""
        return self.derivative(0, phase)

    def slope(self, phase: ArrayLike, side: str = "right") -> NDArray[Any]:
        """First derivative (rad per period) at `phase`; `side` chooses the limit at a knot."""
        return self.derivative(1, phase, side)

    def curvature(self, phase: ArrayLike, side: str = "right") -> NDArray[Any]:
        """Second derivative (rad per period²) at `phase`; `side` chooses the limit at a knot."""
        return self.derivative(2, phase, side)

    def slope_jumps(self) -> NDArray[Any]:
        """Slope right minus left of knots[i], (n,) rad per period; exactly 0 off the kinks."""
        at = self.knots[:-1]
        return np.where(self.kinks, self.slope(at, "right") - self.slope(at, "left"), 0.0)

    @cached_property
    def fine_table(self) -> tuple[NDArray[Any], NDArray[Any]]:
        """Knots (n + 1,) and coefficients (n, 6) that follow a harmonic series to rounding.

        Value to 1e-16, slope to 2e-14 and curvature to 3e-12 of their maxima: what RK4 steps over,
        whose errors otherwise stay at the table's, whatever the tolerance.
        """
        return harmonic_table(self.harmonics, FINE_TOLERANCE)

    @cached_property
    def magnitude(self) -> float:
        """Largest single term of the table's polynomials on their pieces, rad."""
        terms = np.abs(self.coefficients) * np.diff(self.knots)[:, None] ** np.arange(6)
        return float(terms.max())

    @cached_property
    def extrema(self) -> tuple[float, float]:
        """Least and greatest value (rad), from the roots of derivatives."""
        return extrema_of(self.knots, self.coefficients)

    @cached_property
    def peak_to_peak(self) -> float:
        """Greatest minus least value, rad."""
        return self.extrema[1] - self.extrema[0]

    def __mul__(self, factor: float) -> TransmissionError:
        """Every value times a number."""
        if not isinstance(factor, Real) or isinstance(factor, bool | np.bool_):
            return NotImplemented
        return self._of(algebra.multiple(algebra.parts_of(self), arguments.real("factor", factor)))

    __rmul__ = __mul__

    def __neg__(self) -> TransmissionError:
        return -1.0 * self

    def __add__(self, other: TransmissionError) -> TransmissionError:
        """The sum of two transmission errors: a profile deviation on top of a misalignment."""
        if not isinstance(other, TransmissionError):
            return NotImplemented
        return self._of(algebra.total(algebra.parts_of(self), algebra.parts_of(other)))

    def shifted(self, phase: float) -> TransmissionError:
        """The same transmission error so much later in the mesh cycle.

        Parameters
        ----------
        phase : float, mesh periods; `te.shifted(0.25).value(p)` is `te.value(p - 0.25)`

        Returns
        -------
        TransmissionError

        Raises
        ------
        TypeError, ValueError
            for a phase that is no finite number.
        """
        return self._of(algebra.shifted(algebra.parts_of(self), arguments.real("phase", phase)))

    def _of(self, parts: algebra.Parts) -> TransmissionError:
        return type(self)(*parts, self.te_sign_hint)

    @classmethod
    @arguments.complete()
    def from_hermite(cls, phase: ArrayLike, value: ArrayLike, slope_left: ArrayLike,
                     slope_right: ArrayLike | None = None) -> TransmissionError:
        """Cubic Hermite pieces between rows of value and slope.

        Parameters
        ----------
        phase, value : (n,) arrays; mesh periods, strictly ascending in [0, 1), and rad
        slope_left, slope_right : (n,) arrays, rad per period
            Slopes on the two sides of each row; one array serves for both sides.  A row is a
            kink exactly where the two numbers differ.

        Raises
        ------
        ValueError
            Rows out of order or range, lengths that differ, numbers not finite.
        """
        return cls(*hermite_table(phase, value, slope_left, slope_right))

    @classmethod
    @arguments.complete()
    def from_samples(cls, phase: ArrayLike, value: ArrayLike,
                     kinks: ArrayLike = ()) -> TransmissionError:
        """Periodic C2 cubic spline through samples, broken at marked kinks.

        Between two kinks the spline is 'not-a-knot'; an arc of three points is a parabola, of
        two a straight line.  A single kink leaves one arc of a whole period.

        Parameters
        ----------
        phase, value : (n,) arrays; mesh periods, strictly ascending in [0, 1), and rad
        kinks : (n,) array of 0/1, or empty for none

        Raises
        ------
        ValueError
            As `from_hermite`; fewer than three rows without a kink.
        """
        return cls(*spline_table(phase, value, kinks))

    @classmethod
    @arguments.complete()
    def harmonic(cls, amplitudes: ArrayLike, shifts: ArrayLike | None = None,
                 orders: ArrayLike | None = None) -> TransmissionError:
        """Sum of amplitude·cos(2π·order·phase + shift), tabulated by quintic Hermite pieces.

        The number of pieces is the smallest for which the remainder bound promises 1e-12 in
        value, 1e-10 in slope and 1e-8 in curvature, each relative to its own maximum.

        Parameters
        ----------
        amplitudes, shifts : (m,) arrays, rad; shifts default to 0
        orders : (m,) array of integers >= 0; default 1, 2, … m

        Raises
        ------
        ValueError
            Lengths that differ, orders that are not whole and >= 0, numbers not finite.
        """
        amplitudes = arguments.reals("amplitudes", amplitudes, ndim=1)
        shifts = np.zeros(amplitudes.size) if shifts is None else \
            arguments.reals("shifts", shifts, ndim=1)
        orders = np.arange(1.0, amplitudes.size + 1) if orders is None else \
            arguments.reals("orders", orders, ndim=1)
        if not amplitudes.shape == shifts.shape == orders.shape or amplitudes.ndim != 1:
            raise ValueError("amplitudes, shifts and orders must have the same length")
        if np.any((amplitudes != 0) & (np.abs(amplitudes) < LEAST)):
            raise ValueError(f"amplitudes must be 0 or at least {LEAST:g} rad in magnitude")
        series = np.column_stack([orders, amplitudes, shifts]).astype(float)
        if np.any((orders < 0) | (orders > MOST_ORDER) | (orders % 1 != 0)):
            raise ValueError(f"orders must be whole numbers from 0 to {MOST_ORDER}")
        knots, coefficients = harmonic_table(series)
        return cls(knots, coefficients, np.zeros(knots.size - 1, dtype=bool), series)

    @classmethod
    @arguments.complete()
    def parabola(cls, amplitude: float) -> TransmissionError:
        """Δφ = -4·amplitude·(phase - ½)², kinked at phase 0; amplitude (rad) > 0: cusp down."""
        amplitude = arguments.real("amplitude", amplitude)
        return cls.from_hermite([0.0], [-amplitude], [-4 * amplitude], [4 * amplitude])

    @classmethod
    @arguments.complete()
    def from_tca(cls, pinion_angle: ArrayLike, gear_angle: ArrayLike, pinion_teeth: int,
                 gear_teeth: int, reference: ArrayLike = (0.0, 0.0)) -> TransmissionError:
        """Table from angle pairs: Δφ = (φ2 - φ2*) - (Z1/Z2)(φ1 - φ1*), phase = Z1(φ1 - φ1*)/2π.

        The rows are one tooth pair's curve over one mesh period, from the transfer point (first
        row) on.  The next pair takes over one period later at the same Δφ, so the first row is
        a kink; a last row that repeats it is dropped.  Elsewhere the curve is a cubic spline.

        Parameters
        ----------
        pinion_angle, gear_angle : (n,) arrays, rad; pinion_angle strictly ascending
        pinion_teeth, gear_teeth : int
        reference : (φ1*, φ2*), rad; angles at the mid-point of the tooth surface (phase 0)

        Raises
        ------
        ValueError
            Rows out of order, more than one period, or ends of the period that do not meet.
        """
        phase, error, kinks = samples_of_pairs(pinion_angle, gear_angle, pinion_teeth, gear_teeth,
                                               reference)
        table = cls.from_samples(phase, error, kinks)
        return replace(table, te_sign_hint="geometric")

    @classmethod
    @arguments.complete()
    def from_file(cls, path: str | os.PathLike[str], *, pinion_teeth: int | None = None,
                  gear_teeth: int | None = None,
                  reference: ArrayLike = (0.0, 0.0)) -> TransmissionError:
        """Read a CSV table: `#` comments, a header naming columns and units, one row per point.

        Columns are one of: phase, transmission_error; the same with kink (0/1); with slope;
        with slope_left, slope_right; or pinion_angle, gear_angle.  Units go in brackets, for
        example `phase[deg]`, `slope[urad]`; without: periods, rad, rad per period.

        Parameters
        ----------
        path : str or Path
        pinion_teeth, gear_teeth : int; needed for phase[rad], phase[deg] and for angle pairs
        reference : see `from_tca`

        Raises
        ------
        TransmissionErrorFileError
            All that is wrong with the file, with line and column.
        OSError
            The file cannot be opened.
        """
        arguments.path("path", path)
        for name, teeth in (("pinion_teeth", pinion_teeth), ("gear_teeth", gear_teeth)):
            if teeth is not None:
                arguments.whole(name, teeth, 1)
        if arguments.reals("reference", reference, ndim=1).size != 2:
            raise ValueError("reference: expected are two angles")
        columns, problems = read_columns(path, pinion_teeth, gear_teeth)
        if problems:
            raise TransmissionErrorFileError(path, problems)
        try:
            if "gear_angle" in columns:
                assert pinion_teeth is not None and gear_teeth is not None  # or it is a problem
                return cls.from_tca(columns["pinion_angle"], columns["gear_angle"], pinion_teeth,
                                    gear_teeth, reference)
            phase, value = columns.pop("phase"), columns.pop("transmission_error")
            if not columns or "kink" in columns:
                return cls.from_samples(phase, value, **{f"{k}s": v for k, v in columns.items()})
            return cls.from_hermite(phase, value, *columns.values())
        except ValueError as error:
            raise TransmissionErrorFileError(path, [(0, 0, str(error))]) from error
