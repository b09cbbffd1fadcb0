"""Seeded random scenes over every law, and two methods compared on them.

    python tests/random_scenes.py FIRST LAST [method method]     (default: 0 1000 exact rk4)

follows the scenes of these seeds with both methods and prints every disagreement in full.
"""

from __future__ import annotations

import sys
from collections import Counter
from dataclasses import replace

import numpy as np

from event_comparison import changed_data, compare
from lapwing import Oscillator, TransmissionError, simulate

TOLERANCE = 1e-12
# Of the slope of the table that stands for a series (harmonic_series.py).
SERIES_TOLERANCE = 1e-10
# Scenes from this seed on have tables of up to 300 knots, earlier ones of up to 40.
MANY_KNOTS = 10_000
GAPS = ["one_sided", "one_sided", "symmetric", "one_flank"]


def transmission_error(rng, most_knots):
    """A curve of unit size: a series of one to three terms, a cubic table, or the parabola."""
    kind = rng.integers(4)
    if kind == 0:
        n = rng.integers(1, 4)
        return TransmissionError.harmonic(rng.uniform(0.1, 1, n) / np.arange(1, n + 1)**2,
                                          rng.uniform(0, 2 * np.pi, n))
    if kind == 1:
        return TransmissionError.parabola(rng.choice([-1, 1]) * rng.uniform(0.2, 1))
    n = int(np.exp(rng.uniform(np.log(3), np.log(most_knots))))
    width = rng.dirichlet(np.full(n, 4.0))
    phase = np.append(0.0, np.cumsum(width)[:-1])
    if rng.random() < 0.5:
        phase = phase + rng.uniform(0, width[-1])
    value = sum(a * np.cos(2 * np.pi * k * phase + s) for k, (a, s) in enumerate(
        zip(rng.uniform(-1, 1, 3) / np.arange(1, 4), rng.uniform(0, 6, 3), strict=True), start=1))
    if kind == 2:
        return TransmissionError.from_samples(phase, value)
    return TransmissionError.from_samples(phase, value, rng.random(n) < min(0.5, 2 / n))


def scene(seed):
    """Oscillator, start, start phase and number of cycles of one seed."""
    rng = np.random.default_rng(seed)
    te = transmission_error(rng, 41 if seed < MANY_KNOTS else 301)
    law = rng.choice(["restitution", "restitution", "compliant", "rigid"])
    impact = "absolute" if law == "restitution" and rng.random() < 0.4 else "relative"
    ratio = np.exp(rng.uniform(np.log(0.1), np.log(3.0)))
    # The load against the inertia of the flank's motion decides how the tooth moves.
    load = np.exp(rng.uniform(np.log(0.05), np.log(20.0)))
    force = load * te.peak_to_peak * ratio**2 * rng.choice([1, 1, 1, 1, -1])
    width = np.exp(rng.uniform(np.log(0.05), np.log(30.0))) * te.peak_to_peak
    options = {
        "force": force, "mesh_frequency_ratio": ratio, "contact_law": str(law),
        "impact_law": impact, "backlash": width, "gap": str(rng.choice(GAPS)),
        "damping_ratio": rng.choice([0.0, rng.uniform(0, 0.3), rng.uniform(0.3, 0.99), 1.0,
                                     rng.uniform(1.0, 2.0)]),
        "restitution": rng.choice([0.0, rng.uniform(0, 0.5), rng.uniform(0.5, 1),
                                   rng.uniform(0.5, 1), 1.0]),
        "back_flank_te": bool(rng.random() < 0.8),
        "te_sign": str(rng.choice(["printed", "geometric"])),
    }
    if not options["back_flank_te"] and options["gap"] != "one_flank":
        options["backlash"] = width + te.peak_to_peak + max(0.0, *np.abs(te.extrema))
    if force < 0 and options["gap"] == "one_flank":
        options["force"] = -force
    osc = Oscillator(te, **options)
    phase = 0.0 if rng.random() < 0.5 else rng.uniform(0, 1)
    return osc, start(rng, osc, phase), phase, int(rng.integers(3, 7))


def start(rng, osc, phase):
    """At rest, in flight, or in either flank."""
    kind = rng.choice(["rest", "separation", "engagement", "back_engagement"])
    size = osc.angle_scale
    speed = rng.normal() * size * osc.mesh_frequency_ratio
    depth = rng.choice([1.0, 1.0, 10.0]) * rng.random() * size
    if osc.contact_law == "rigid":
        depth = 0.0
    bottom = -osc.gap_width
    if not osc.back_flank_te:
        bottom -= osc.flank_scale * float(osc.te.value(phase))
    if kind == "separation":
        bottom = max(bottom, -20 * size)
        return "separation", bottom * rng.random(), speed
    if kind == "engagement":
        return "engagement", depth, speed
    if kind == "back_engagement" and osc.gap != "one_flank":
        # A little deeper than nothing, so that rounding never puts it before the flank.
        return "back_engagement", bottom - depth - 1e-12 * abs(bottom), speed
    return "rest"


def describe(seed):
    """A scene in one paragraph, with what is needed to repeat it."""
    osc, begin, phase, cycles = scene(seed)
    shown = {name: getattr(osc, name) for name in (
        "force", "mesh_frequency_ratio", "damping_ratio", "restitution", "backlash",
        "contact_law", "impact_law", "gap", "back_flank_te", "te_sign")}
    return (f"seed {seed}: random_scenes.scene({seed}), {len(osc.te.kinks)} pieces, "
            f"{int(osc.te.kinks.sum())} kinks, {shown}, start {begin}, phase {phase!r}, "
            f"{cycles} cycles")


def follow(seed, methods=(("exact", TOLERANCE), ("rk4", TOLERANCE))):
    """Verdict of two methods, each with its rtol, on the scene of a seed.

    A table stands for a harmonic series to 1e-12 of its value and 1e-10 of its slope, which is more
    than the methods differ: they are compared on the table alone, and the closed form on the series
    with the closed form on the table then, to the table's promise.
    """
    osc, begin, phase, cycles = scene(seed)
    series, osc = osc, replace(osc, te=without_series(osc.te))
    verdict = compare_runs(osc, osc, begin, phase, cycles, methods)
    if verdict.agrees and len(series.te.harmonics) and methods[0][0] == "exact":
        # Slopes against the natural size of velocities in flight.
        fastest = osc.gear_ratio * np.abs(osc.te.slope(osc.te.knots[:-1])).max() / osc.period
        size = fastest / (osc.angle_scale * min(1.0, osc.mesh_frequency_ratio))
        again = compare_runs(series, osc, begin, phase, cycles, [methods[0]] * 2,
                             SERIES_TOLERANCE * max(1.0, size))
        return again if not again.agrees else verdict
    return verdict


def without_series(te):
    return TransmissionError(te.knots, te.coefficients, te.kinks)


def compare_runs(osc, other_osc, begin, phase, cycles, methods, tolerance=None):
    """Verdict of two methods, each on its own oscillator; the first runs from changed data too.

    `tolerance`: what they may differ by, if that is not the larger rtol. 'exact' is meant where the
    scene allows it.
    """
    changed_osc, changed_begin = changed_data(osc, begin)

    def run(osc, begin, method, rtol):
        method = "auto" if method == "exact" else method
        return simulate(osc, begin, phase, cycles, method=method, rtol=rtol, observe=("events",),
                        max_events_per_cycle=20_000)
    one, other = run(osc, begin, *methods[0]), run(other_osc, begin, *methods[1])
    changed = run(changed_osc, changed_begin, *methods[0])
    return compare(one, other, changed, tolerance or max(rtol for _, rtol in methods))


def survey(seeds, methods):
    """Follow many; what ended the comparisons, events compared, disagreements."""
    ends, compared, disagreements = Counter(), 0, []
    for seed in seeds:
        verdict = follow(seed, methods)
        compared += verdict.compared
        ends[verdict.why.split(" (")[0] if verdict.agrees else "DISAGREES"] += 1
        if not verdict.agrees:
            disagreements.append(f"{describe(seed)}\n{verdict.why}")
    return ends, compared, disagreements


def main(arguments):
    first, last = (int(a) for a in arguments[:2]) if len(arguments) > 1 else (0, 1000)
    methods = [(m, TOLERANCE) for m in arguments[2:4]] or [("exact", TOLERANCE), ("rk4", TOLERANCE)]
    if methods[0] == methods[1]:
        methods[1] = (methods[1][0], 10 * TOLERANCE)
    ends, compared, disagreements = survey(range(first, last), methods)
    for text in disagreements:
        print(text, end="\n\n")
    print(f"{last - first} scenes, {compared} events alike, {len(disagreements)} disagreements")
    for why, count in ends.most_common():
        print(f"{count:7} {why}")
    return bool(disagreements)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
