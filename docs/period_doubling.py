"""Period doublings of the bouncing ball, g = cos u, found by following a Floquet multiplier to -1.

Prints the table of docs/method.md: python docs/period_doubling.py
"""

import math

import numpy as np

import lapwing
from lapwing.engine import Numerics

COSINE = lapwing.TransmissionError.harmonic([1.0])


def ball(gamma, restitution):
    """Γ = 1/F at Ω = 1; the coast flank is out of reach."""
    return lapwing.Oscillator(COSINE, force=1 / gamma, mesh_frequency_ratio=1.0, backlash=1e3,
                              restitution=restitution, damping_ratio=0.1)


def start(gamma, restitution):
    """The motion with one impact a cycle, at phase 0."""
    angle = math.pi - math.asin(math.pi * (1 - restitution) / (1 + restitution) / gamma)
    speed = 2 * math.pi / gamma / (1 + restitution)
    time = 2 * math.pi - angle
    theta_dot = -math.sin(angle) - restitution * speed
    theta = math.cos(angle) + time * (theta_dot + 0.5 * time / gamma)
    return "separation", theta - 1.0, theta_dot + time / gamma


def main():
    """Both methods: the closed form knows the cosine itself, rk4 its table."""
    print("| ε | first doubling Γ | less the exact one | by rk4 | ratios of successive intervals |")
    print("|---|---|---|---|---|")
    for restitution in (0.3, 0.5, 0.8):
        exact = math.hypot(math.pi * (1 - restitution) / (1 + restitution),
                           2 * (1 + restitution**2) / (1 + restitution) ** 2)
        found = {method: lapwing.cascade(
            lambda gamma, e=restitution: ball(gamma, e), 0.98 * exact, 1.1 * exact,
            start(0.98 * exact, restitution), 6,
            numerics=Numerics(method=method, rtol=1e-13, chatter_tol=1e-13))
            for method in ("exact", "rk4")}
        values = np.array([value for value, _ in found["exact"]])
        steps = np.diff(values)
        ratios = ", ".join(f"{ratio:.3f}" for ratio in steps[:-1] / steps[1:])
        print(f"| {restitution} | {values[0]:.10f} | {values[0] - exact:+.0e} "
              f"| {found['rk4'][0][0] - exact:+.0e} | {ratios} |")


if __name__ == "__main__":
    main()
