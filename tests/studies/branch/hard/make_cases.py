"""Write tests/studies/branch/hard/*.json: branches that are hard to follow, and what lies on them.

Command (from the repository root): python tests/studies/branch/hard/make_cases.py [name ...]

Needs mpmath and SciPy only, nothing of Lapwing: values are closed forms, or roots of the equations
of the bouncing ball (docs/model.md) in 40 digits.
"""

from __future__ import annotations

import json
import math
import sys
from pathlib import Path

from mpmath import mp, mpf
from scipy.optimize import brentq

HERE = Path(__file__).resolve().parent
COSINE = {"harmonic": [[1.0], [0.0], [1]]}
DIGITS = 20
CASES = {}
mp.dps = 40


def case(make):
    """Register a function that returns a case."""
    CASES[make.__name__] = make
    return make


def digits(value):
    return mp.nstr(value, DIGITS)


def special(kind, value, within, **more):
    """A special point that must be found: relative error at most `within`, and the one it tells."""
    return {"kind": kind, "value": digits(value), "within": within, **more}


def ball(eps, gamma, n=1, contact_law="restitution", **more):
    """The ball g = cos u, Ω = 1, Γ = 1/F, with one impact every n cycles, begun at its impact."""
    angle = mp.pi - mp.asin(n * mp.pi * (1 - mpf(eps)) / (1 + mpf(eps)) / gamma)
    return {"te": COSINE, "oscillator": {"period": 2 * math.pi, "restitution": eps,
                                         "contact_law": contact_law, "damping_ratio": 0.1},
            "gamma": [0.0, 1.0, 0.0], "value": float(gamma),
            "start": {"impact": float(angle / (2 * mp.pi)), "cycles": n}, **more}


def saddle_node(eps, n=1):
    return n * mp.pi * (1 - mpf(eps)) / (1 + mpf(eps))


def doubling(eps, n=1):
    return mp.sqrt(saddle_node(eps, n)**2 + (2 * (1 + mpf(eps)**2) / (1 + mpf(eps))**2)**2)


# --- the ball, impact by impact ------------------------------------------------------------------


def gap(gamma, u, speed, s):
    """Height over the flank, over s, at s after an impact at u that leaves with some speed."""
    bend = -2 * mp.cos(u) * mp.sin(s / 2)**2 - mp.sin(u) * (mp.sin(s) - s)
    return -speed + s / (2 * gamma) - bend / s


def next_impact(gamma, u, speed):
    """Time to the next impact and the speed into the flank there."""
    g, v, one = float(gamma), float(speed), float(u)

    def f(s):
        return -v + s / (2 * g) - (-2 * math.cos(one) * math.sin(s / 2)**2
                                   - math.sin(one) * (math.sin(s) - s)) / s

    s = brentq(f, *_bracket(f, v * g), xtol=1e-300, rtol=1e-15)
    s = mp.findroot(lambda x: gap(gamma, u, speed, x), (mpf(s), mpf(s) * (1 + mpf("1e-12"))),
                    tol=1e-60, verify=False)
    return s, -speed + s / gamma + mp.sin(u + s) - mp.sin(u)


def _bracket(f, least):
    """The first sign change of f, whose root is no shorter than some time."""
    step = min(0.01, 0.05 * least)
    a = step
    while f(a) > 0:
        a *= 0.5
    b = a + step
    while f(b) < 0:
        a, b = b, b + min(0.01, 0.05 * b)
    return a, b


def equations(eps, n, unknowns):
    """What is left of the flights of a motion with n impacts in n cycles, and 1 + trace + det."""
    gamma, phases, speeds = unknowns[0], unknowns[1:n + 1], unknowns[n + 1:]
    found, turn = [], mp.eye(2)
    for k in range(n):
        u, w = phases[k], speeds[k]
        end = phases[(k + 1) % n] + (2 * mp.pi * n if k == n - 1 else 0)
        s, arrival = end - u, speeds[(k + 1) % n]
        found += [gap(gamma, u, eps * w, s),
                  -eps * w + s / gamma + mp.sin(end) - mp.sin(u) - arrival]
        # Acceleration into the flank, 1/Γ - g'', at both ends; X(u, w, s) = 0 has the derivatives
        # arrival, arrival + εw - press s, -εs by s, u, w.
        press, there = 1 / gamma + mp.cos(u), 1 / gamma + mp.cos(end)
        later = mp.matrix([[(press * s - eps * w) / arrival, eps * s / arrival]])
        turn = mp.matrix([[later[0], later[1]],
                          [there * later[0] - press, there * later[1] - eps]]) * turn
    return [*found, 1 + turn[0, 0] + turn[1, 1] + mpf(eps)**(2 * n)]


def cascade(eps, low, high, count, ratios):
    """Doublings one after the other, each begun with the stable motion that is a little before."""
    found = [doubling(eps)]
    width = (mpf(high) - found[0]) * mpf("0.78")
    for k in range(1, count):
        n, before = 2**k, found[-1]
        # The next one is about as far on as they shrink; the motion is stable until then.
        step = width if k == 1 else (found[-1] - found[-2]) / mpf(ratios[k - 2])
        gamma = before + mpf("0.9") * step
        found.append(_doubling_by_shooting(eps, n, gamma))
    return found


def _doubling_by_shooting(eps, n, gamma):
    u = mp.pi - mp.asin(saddle_node(eps) / gamma) + mpf("1e-3")
    speed = 2 * mp.pi / gamma / (1 + eps)
    mp.dps = 18
    for _ in range(n * 200):
        s, speed = next_impact(gamma, u, eps * speed)
        u += s
    u -= 2 * mp.pi * mp.floor(u / (2 * mp.pi))
    phases, speeds = [u], [speed]
    for _ in range(n - 1):
        s, speed = next_impact(gamma, u, eps * speed)
        u += s
        phases.append(u)
        speeds.append(speed)
    mp.dps = 40
    root = mp.findroot(lambda *x: equations(mpf(eps), n, x), (gamma, *phases, *speeds), tol=1e-50,
                       maxsteps=40)
    return root[0]


def last_complete(eps, complete, escapes):
    """Γ up to which the bounces of a tooth that left where F = g'' die out before F = g'' again."""
    for _ in range(110):
        middle = (complete + escapes) / 2
        if _dies_out(eps, middle):
            complete = middle
        else:
            escapes = middle
    return (complete + escapes) / 2


def _dies_out(eps, gamma):
    u, speed = mp.acos(-1 / gamma), mpf(0)
    last = u + 2 * mp.pi
    while True:
        s, arrival = next_impact(gamma, u, speed) if speed else _thrown(gamma, u)
        u, speed = u + s, eps * arrival
        if u > last:
            return False
        press = 1 / gamma + mp.cos(u)
        if press > 0 and 2 * speed / (press * (1 - eps)) < mpf("1e-3") * (last - u):
            return True


def _thrown(gamma, u):
    """The first flight, which begins without speed and without acceleration."""
    def height(s):
        return gap(gamma, u, 0, s)

    s = mpf("0.2")
    while height(s) < 0:
        s += mpf("0.05")
    s = mp.findroot(height, (s - mpf("0.05"), s), solver="anderson", tol=1e-60, verify=False)
    return s, s / gamma + mp.sin(u + s) - mp.sin(u)


# --- the cases ------------------------------------------------------------------------------------


def _of_cascade(eps, low, high, count, ratios, **more):
    values = cascade(eps, low, high, count, ratios)
    gamma = (saddle_node(eps) + values[0]) / 2
    levels = [[special("PERIOD_DOUBLING", one, 1e-11, outcome="PERSISTS",
                       det=float(mpf(eps)**(2 * 2**k)))] for k, one in enumerate(values)]
    return ball(eps, gamma, low=low, high=high, levels=levels, ratios=ratios, what=(
        f"a cascade of {count} doublings, switched at each; ratios of steps as in Feigenbaum's"),
        source="2^k impacts in 2^k cycles, a multiplier of -1, in 40 digits", **more)


@case
def cascade_half():
    return _of_cascade(0.5, 1.2, 1.72, 4, [4.732, 4.633])


@case
def cascade_low_restitution():
    return _of_cascade(0.3, 1.9, 2.4, 5, [4.366, 4.599, 4.651], full=True)


@case
def end_of_a_chatter():
    value = last_complete(mpf(0.3), mpf("1.9"), mpf("2.0"))
    one = {"te": COSINE, "oscillator": {"period": 2 * math.pi, "restitution": 0.3,
                                        "contact_law": "rigid", "gap": "one_flank",
                                        "damping_ratio": 0.1},
           "gamma": [0.0, 1.0, 0.0], "value": 1.2, "start": {"settle": 50}, "low": 1.05,
           "high": 3.0, "levels": [[special("CHATTER", value, 1e-10)]], "chatters": True}
    return {**one, "what": "rigid: the rest after a complete chatter shrinks to nothing; there the "
            "tooth leaves without a rest, with ever more bounces",
            "source": "bounces followed one by one in 40 digits, Γ halved until they die out"}


@case
def isola():
    eps, height, half = 0.7, 0.3, 0.8
    low = saddle_node(eps)
    one = ball(eps, low + height, low=-1.0, high=1.0, levels=[[
        special("FOLD", mpf(-half), 1e-12), special("FOLD", mpf(half), 1e-12)]],
        only=["FOLD"], end="CLOSED", stable=[False, True],
        what="a closed curve of motions: Γ = Γ_SN + δ(1 - (p/h)²), met at p = ±h and nowhere else",
        source="closed form")
    return {**one, "gamma": [float(low + height), 0.0, float(-height / mpf(half)**2)], "value": 0.0}


@case
def two_folds_within_a_millionth():
    """-g' = (PF/2)(1-ε)/(1+ε) at the impact, folds where g'' = 0, a double root nearly."""
    eps, cusp = 0.5, 2.0
    second = complex(-math.cos(cusp) / 4, -math.sin(cusp) / 8)
    size, shift = abs(second) * (1 + 5e-5), math.atan2(second.imag, second.real) - 2 * cusp

    def slope(u):
        return -mp.sin(u) - 2 * size * mp.sin(2 * u + shift)

    def bend(u):
        return -mp.cos(u) - 4 * size * mp.cos(2 * u + shift)

    def force(u):
        return -slope(u) * (1 + eps) / (mp.pi * (1 - eps))

    folds = sorted(force(mp.findroot(bend, (a, b), solver="anderson", tol=1e-60))
                   for a, b in ((1.99, 2.0), (2.0, 2.01)))
    assert 1e-9 < (folds[1] - folds[0]) / folds[1] < 1e-6
    ends = sorted((float(force(cusp - 0.3)), float(force(cusp + 0.3))))
    return {"te": {"harmonic": [[1.0, size], [0.0, shift], [1, 2]]},
            "oscillator": {"period": 2 * math.pi, "restitution": eps, "contact_law": "rigid",
                           "gap": "one_flank", "damping_ratio": 0.1},
            "value": float(force(cusp + 0.3)), "start": {"impact": (cusp + 0.3) / (2 * math.pi)},
            "low": ends[0] - 0.2, "high": ends[1] + 0.2,
            "levels": [[special("FOLD", one, 1e-12) for one in folds]],
            "what": "two folds nearer to each other than a millionth, close to a cusp",
            "source": "closed form"}


@case
def period_of_24():
    eps, n = 0.9, 24
    low, flip = saddle_node(eps, n), doubling(eps, n)
    one = ball(eps, (low + flip) / 2, n, low=0.9 * float(low), high=1.05 * float(flip), levels=[[
        special("FOLD", low, 1e-11, outcome="TURNS_BACK"),
        special("PERIOD_DOUBLING", flip, 1e-11, outcome="PERSISTS")]],
        only=["FOLD", "PERIOD_DOUBLING"],
        what="a motion of 24 mesh cycles with one impact", source="closed form")
    one["oscillator"]["gap"] = "one_flank"
    return one


@case
def thousand_impacts():
    eps, gamma = mpf(0.99), mpf(1.005)
    u, speed, phases = mp.acos(-1 / gamma), mpf(0), {}
    for k in range(1, 1001):
        s, arrival = next_impact(gamma, u, speed) if speed else _thrown(gamma, u)
        u, speed = u + s, eps * arrival
        if k in (1, 2, 5, 10, 20, 50, 100, 200, 500, 1000):
            phases[k] = digits(u / (2 * mp.pi))
    return {"te": COSINE, "oscillator": {"period": 2 * math.pi, "restitution": 0.99,
                                         "contact_law": "rigid", "gap": "one_flank",
                                         "damping_ratio": 0.1},
            "gamma": [0.0, 1.0, 0.0], "value": 1.005, "start": {"settle": 50},
            "low": 1.0049, "high": 1.0051, "levels": [[]], "ends": ["LIMIT", "LIMIT"],
            "impacts_after_release": phases, "what": "thrown off where F = g'', then more than a "
            "thousand bounces to rest", "source": "bounces followed one by one in 40 digits"}


@case
def ends_where_contact_is_kept():
    """F = A Ω²/√((1-Ω²)² + (2ξΩ)²): the engaged motion touches zero."""
    size, force, xi = mpf(0.3), mpf(1.0), mpf(0.05)
    a, b = 1 - (size / force)**2, 4 * xi**2 - 2
    square = (-b - mp.sqrt(b**2 - 4 * a)) / (2 * a)
    return {"te": {"harmonic": [[0.3], [0.0], [1]]},
            "oscillator": {"force": 1.0, "restitution": 0.5, "contact_law": "compliant",
                           "gap": "one_flank", "damping_ratio": 0.05},
            "varied": "mesh_frequency_ratio", "value": 0.9, "start": {"settle": 400},
            "low": 0.7, "high": 0.95,
            "levels": [[special("ENGAGED", mp.sqrt(square), 1e-11, outcome="ENDS")]],
            "ends": ["ENGAGED", "LIMIT"], "stable": [False, True],
            "what": "the last separation vanishes where the engaged motion touches zero (T_full)",
            "source": "closed form"}


@case
def border_collision():
    eps = 0.7
    flip, kink = 4 * (1 + mpf(eps))**2 / (1 + mpf(eps)**2), 8 * (1 + mpf(eps)) / (1 - mpf(eps))
    force = float(1.2 * flip)
    return {"te": {"parabola": -1.0},
            "oscillator": {"period": 1.0, "restitution": eps, "damping_ratio": 0.1},
            "value": force, "start": {"impact": 0.5 - force / 16 * (1 - eps) / (1 + eps)},
            "low": 0.8 * float(flip), "high": 1.2 * float(kink),
            "levels": [[special("PERIOD_DOUBLING", flip, 1e-12),
                        special("KINK", kink, 1e-12, outcome="ENDS")]],
            "what": "an impact comes upon a kink of the cusp-up parabola", "source": "closed form"}


def write(name):
    found = CASES[name]()
    text = json.dumps({"what": found.pop("what"), "source": found.pop("source"), **found},
                      indent=1, ensure_ascii=False)
    (HERE / f"{name}.json").write_text(text + "\n", encoding="utf-8")


if __name__ == "__main__":
    for name in sys.argv[1:] or CASES:
        write(name)
        print(name)
