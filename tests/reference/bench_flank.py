"""The flank's motion for the benchmark's reference: a stretch is what one formula covers.

Both kinds of stretch give derivatives of g, bounds of them up to the stretch's end, and the steady
part of a contact's motion. Numbers are gmpy2 reals in the precision of `bench_flow`.
"""

from __future__ import annotations

import gmpy2
from gmpy2 import mpfr


class Series:
    """g = Σ A cos(nΩs + δ) over the whole mesh cycle, s in τ."""

    def __init__(self, rows, scale, omega):
        """`rows`: order, amplitude (rad), shift; `scale`: ±i12; `omega`: Ω, all double."""
        self.omega = mpfr(omega)
        self.length = 2 * gmpy2.const_pi() / self.omega
        self.begin, self.jump = mpfr(0), mpfr(0)
        self.terms = [(mpfr(n) * self.omega, mpfr(a) * mpfr(scale), mpfr(d)) for n, a, d in rows]

    def derivatives(self, s, orders):
        """g^(k) at s for k in orders (a rising range)."""
        total = [mpfr(0)] * len(orders)
        for rate, amplitude, shift in self.terms:
            sine, cosine = gmpy2.sin_cos(rate * s + shift)
            cycle = (cosine, -sine, -cosine, sine)
            for i, k in enumerate(orders):
                total[i] += amplitude * rate**k * cycle[k % 4]
        return total

    def bound(self, k, s):
        """Bound of |g^(k)| from s to the end of the stretch."""
        return sum(abs(amplitude) * rate**k for rate, amplitude, _ in self.terms)

    def steady(self, sign, force, xi, s0):
        """Particular solution of y'' + 2ξy' + y = sign·(F - g''): y, y' and a bound function."""
        parts = []
        for rate, amplitude, shift in self.terms:
            real, imaginary = 1 - rate * rate, 2 * xi * rate
            norm = real * real + imaginary * imaginary
            gain = sign * amplitude * rate * rate / norm  # -g'' has amplitude A n²Ω²
            parts.append((rate, shift, gain * real, gain * imaginary))

        def state(s):
            y, dy = sign * force, mpfr(0)
            for rate, shift, along, across in parts:
                sine, cosine = gmpy2.sin_cos(rate * s + shift)
                y += along * cosine + across * sine
                dy += rate * (across * cosine - along * sine)
            return y, dy

        def bound(k, s):
            return sum(gmpy2.hypot(along, across) * rate**k for rate, _, along, across in parts)

        return state, bound


class Piece:
    """One polynomial piece of a table; its own s runs from 0, `begin` is where it lies."""

    def __init__(self, begin, length, coefficients, jump):
        self.begin, self.length, self.c, self.jump = begin, length, coefficients, jump

    def derivatives(self, s, orders):
        return [_value(_derivative(self.c, k), s) for k in orders]

    def bound(self, k, s):
        return _value([abs(x) for x in _derivative(self.c, k)], self.length)

    def steady(self, sign, force, xi, s0):
        q = [-sign * x for x in _derivative(self.c, 2)]
        q[0] += sign * force
        p = [mpfr(0)] * (len(q) + 2)
        for n in range(len(q) - 1, -1, -1):  # compare the powers of s, highest first
            p[n] = q[n] - 2 * xi * (n + 1) * p[n + 1] - (n + 2) * (n + 1) * p[n + 2]
        p = p[:len(q)]

        def state(s):
            return _value(p, s), _value(_derivative(p, 1), s)

        def bound(k, s):
            return _value([abs(x) for x in _derivative(p, k)], self.length)

        return state, bound


def table_pieces(knots, coefficients, kinks, scale, omega):
    """Pieces in τ of a table in mesh phase; every number is the engine's double, taken exactly."""
    period = 2 * gmpy2.const_pi() / mpfr(omega)
    pieces = []
    for k in range(len(kinks)):
        begin, end = mpfr(knots[k]) * period, mpfr(knots[k + 1]) * period
        c = [mpfr(scale) * mpfr(x) / period**n for n, x in enumerate(coefficients[k])]
        pieces.append(Piece(begin, end - begin, c, mpfr(0)))
    for k, kink in enumerate(kinks):
        if kink:
            before = pieces[k - 1]
            left = before.derivatives(before.length, (1,))[0]
            pieces[k].jump = pieces[k].derivatives(mpfr(0), (1,))[0] - left
    return pieces


def _value(c, s):
    total = mpfr(0)
    for x in reversed(c):
        total = total * s + x
    return total


def _derivative(c, times):
    for _ in range(times):
        c = [k * c[k] for k in range(1, len(c))] or [mpfr(0)]
    return list(c)
