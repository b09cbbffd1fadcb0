"""Write tests/hard_cases/orbits.json: stable periodic motions, to be followed for very many cycles.

Command (from the repository root): python tests/hard_cases/make_orbits.py

Bouncing on a kinked parabola and on a harmonic flank: closed forms. The published gear: a run of
the 60-digit integrator that has settled, the last two of its cycles being equal to 28 digits.
`condition` is what a relative change of a parameter does to phases and velocities, at most.
"""

from __future__ import annotations

from hard_case_list import PUBLISHED
from make_hard_cases import COLUMNS, DEFAULTS, HERE, NAMES, file_text, follow, parabola, size, text
from mpmath import mp, mpf

COMMAND = "python tests/hard_cases/make_orbits.py"
SETTLED = mpf("1e-28")


def row(kind, phase, before, after):
    return {"kind": kind, "phase": text(mpf(phase)), "velocity_before": text(mpf(before)),
            "velocity_after": text(mpf(after))}


def on_a_parabola():
    """g'' = 1, F = 3/2, P = 8, ε = 1/2: one impact a cycle at w = ½ - (P²F/2b)(1-ε)/(1+ε) = ¼.

    It arrives with PF/(1+ε) = 8. θ' before the kink: g'(¼) - 4 + 6 F = -2 - 4 + 9 = 3, the flank's
    slope goes from 4 to -4 there. trace = 1 + ε² - (1+ε)² g''/F = -¼, det = ¼: both |λ| = ½.
    """
    return {"what": "one impact a cycle on the kinked parabola, |λ| = 1/2", "source": "closed form",
            "scene": {**DEFAULTS, "te": parabola(64.0), "force": 1.5},
            "start": ["separation", -0.25, -3.5], "phase": 0.25, "settle": 120, "condition": 50.0,
            "events": [row("KINK", 0, -1, 7), row("IMPACT", 0.25, 8, -4)]}


def on_a_harmonic(what, excess, critical):
    """One impact a cycle on g = cos u, started on the orbit of Γ = critical·(1 + excess)."""
    eps, period = mpf(0.5), mpf(8)
    omega = 2 * mp.pi / period
    force = float(omega**2 / (critical * (1 + mpf(excess))))
    gamma = omega**2 / mpf(force)
    u = mp.pi - mp.asin(mp.pi * (1 - eps) / (gamma * (1 + eps)))
    arrival = period * mpf(force) / (1 + eps)
    trace = 1 + eps**2 - (1 + eps) ** 2 * gamma * abs(mp.cos(u))
    slower = max(abs(x) for x in mp.polyroots([1, -trace, eps**2]))
    # du/dlnΓ = tan u; an error of each bounce is magnified by 1/(1 - |λ|) at most.
    condition = 20 * (abs(mp.tan(u)) + 1 / (1 - slower))
    return {"what": f"{what}: |λ| = {mp.nstr(slower, 8)}", "source": "closed form",
            "scene": {**DEFAULTS, "force": force, "te": {"harmonic": [[1, 1.0, 0.0]]}},
            "start": ["separation", 0.0, float(-eps * arrival)], "phase": float(u / (2 * mp.pi)),
            "settle": 0, "condition": size(condition),
            "events": [row("IMPACT", u / (2 * mp.pi), arrival, -eps * arrival)]}


def published_gear():
    """Scene of the published gear at 3.3 N·m, absolute impact law: five impacts a cycle."""
    scene = {**DEFAULTS, **PUBLISHED, "impact_law": "absolute"}
    cycles = 80
    run = follow(scene, "rest", 0.0, cycles)
    by_cycle = {}
    for event in run.events:
        by_cycle.setdefault(int(mp.floor(event.tau / mpf(scene["period"]))), []).append(event)
    last, before = by_cycle[cycles - 1], by_cycle[cycles - 2]
    for one, other in zip(last, before, strict=True):
        gaps = [abs(one.phase - other.phase),
                *(abs(getattr(one, c) / getattr(other, c) - 1) for c in COLUMNS[2:]
                  if getattr(other, c))]
        if max(gaps) > SETTLED or (one.kind, one.flank) != (other.kind, other.flank):
            raise ArithmeticError("not settled")
    return {"what": "the published gear at 3.3 N·m: five impacts, contact and release a cycle",
            "source": f"60-digit integrator, cycle {cycles}, equal to the one before",
            "scene": scene, "start": "rest", "phase": 0.0, "settle": 60, "condition": 30.0,
            "events": [row(NAMES[e.kind, e.flank], e.phase, e.velocity_before, e.velocity_after)
                       for e in last]}


def main():
    with mp.workdps(60):
        eps = mpf(0.5)
        node = mp.pi * (1 - eps) / (1 + eps)
        flip = mp.sqrt(node**2 + (2 * (1 + eps**2) / (1 + eps) ** 2) ** 2)
        orbits = {
            "parabola": on_a_parabola(),
            "near_saddle_node": on_a_harmonic(
                "one impact a cycle, Γ 1e-6 above the least with this orbit", "1e-6", node),
            "near_period_doubling": on_a_harmonic(
                "one impact a cycle, Γ 1e-6 below period doubling", "-1e-6", flip),
            "published_gear": published_gear(),
        }
    parts = [f'"{name}": {file_text(orbit).rstrip()}' for name, orbit in orbits.items()]
    head = f'"command": "{COMMAND}",\n'
    (HERE / "orbits.json").write_text("{\n" + head + ",\n".join(parts) + "\n}\n", encoding="utf-8")


if __name__ == "__main__":
    main()
