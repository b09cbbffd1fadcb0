"""Error against work of fourth-order Runge-Kutta formulas on a forced, damped contact.

Prints, for equal numbers of derivative evaluations, the error after ten units of tau of the
formulas that were considered for the engine (docs/method.md). Run: python docs/compare_formulas.py
"""

from fractions import Fraction as Q

import numpy as np
from scipy.integrate import solve_ivp


def tableau(rows, weights, nodes):
    a = np.zeros((len(nodes), len(nodes)))
    for i, row in enumerate(rows):
        a[i, :len(row)] = [float(x) for x in row]
    return a, np.array([float(x) for x in weights]), np.array([float(x) for x in nodes])


OWREN_ZENNARO = tableau(
    [[], [Q(1, 6)], [Q(44, 1369), Q(363, 1369)],
     [Q(3388, 4913), Q(-8349, 4913), Q(8140, 4913)],
     [Q(-36764, 408375), Q(767, 1125), Q(-32708, 136125), Q(210392, 408375)]],
    [Q(1697, 18876), 0, Q(50653, 116160), Q(299693, 1626240), Q(3375, 11648)],
    [0, Q(1, 6), Q(11, 37), Q(11, 17), Q(13, 15)])
CLASSICAL = tableau([[], [0.5], [0, 0.5], [0, 0, 1]], [1 / 6, 1 / 3, 1 / 3, 1 / 6],
                    [0, 0.5, 0.5, 1])


def step(formula, rate, t, y, h):
    a, b, c = formula
    k = []
    for i in range(len(b)):
        k.append(rate(t + c[i] * h, y + h * sum((a[i, j] * k[j] for j in range(i)), 0 * y)))
    return y + h * sum(b[i] * k[i] for i in range(len(b)))


def fixed(formula, rate, y, steps, end):
    h = end / steps
    for i in range(steps):
        y = step(formula, rate, i * h, y, h)
    return y


def doubled(rate, y, pairs, end, extrapolate):
    """Two classical steps beside one of twice the length: 12 evaluations with dense output."""
    h = end / pairs
    for i in range(pairs):
        half = step(CLASSICAL, rate, i * h, y, h / 2)
        fine = step(CLASSICAL, rate, (i + 0.5) * h, half, h / 2)
        coarse = step(CLASSICAL, rate, i * h, y, h)
        y = fine + (fine - coarse) / 15 if extrapolate else fine
    return y


def main():
    end, xi = 10.0, 0.1
    print("evaluations   Owren-Zennaro   classical, no estimate   doubled   doubled, extrapolated")
    for ratio, amplitude in ((0.08, 20.0), (0.23, 5.0), (0.6, 1.0)):
        def rate(t, y, w=ratio, a=amplitude):
            g, slope = a * np.cos(w * t), -a * w * np.sin(w * t)
            return np.array([y[1], 1 - 2 * xi * (y[1] - slope) - (y[0] - g)])

        start = np.array([amplitude, -1.0])
        exact = solve_ivp(rate, (0, end), start, method="DOP853", rtol=1e-13, atol=1e-14).y[:, -1]
        print(f"mesh frequency ratio {ratio:g}, amplitude {amplitude:g}")
        for work in (200, 400, 800, 1600):
            # One stage of Owren-Zennaro's six only serves dense output and estimate.
            ends = (fixed(OWREN_ZENNARO, rate, start, work // 6, end),
                    fixed(CLASSICAL, rate, start, work // 4, end),
                    doubled(rate, start, work // 12, end, False),
                    doubled(rate, start, work // 12, end, True))
            print(f"{work:11d}" + "".join(f"{np.abs(y - exact).max():16.1e}" for y in ends))


if __name__ == "__main__":
    main()
