"""Make docs/gallery.md and its images from results/ of the shipped decks.

Run from the checkout after `lapwing run inputs/*.nml`: python docs/make_gallery.py
"""

import re
from pathlib import Path

from PIL import Image

DOCS = Path(__file__).parent
RESULTS = Path("results")
WIDTH = 860
COLOURS = 96

DECKS = {
    "lapping_25x32": "The published 25 × 32 pair at 240 rpm, transmission error reconstructed, "
                     "impact law `absolute` as the source prints it.",
    "lapping_25x32_relative": "The same gear with the physical impact law: chatter where the "
                              "source counts 3, 5 and 7 impacts.",
    "critical_25x32": "Critical torques of the 25 × 32 pair under the source's law.",
    "critical_rigid": "Critical torques of rigid teeth on a smooth transmission error.",
    "smooth_1500rpm": "A smooth transmission error of three harmonics at 1500 rpm: coexisting "
                      "motions.",
    "kinked_480rpm": "The textbook parabola with one kink at 480 rpm.",
    "drifting_25x32": "Both wheels as bodies, driven harder than the brake holds: the mean speed "
                      "rises while the teeth rattle.",
    "speed_compliant": "The same smooth transmission error without restitution, over the speed: "
                       "the classical resonance of gear rattle.",
    "plane_25x32": "Every combination of speed and braking torque for the smooth transmission "
                   "error.",
    "tolerances_25x32": "Pairs with manufacturing tolerances: which torque keeps 99 % of "
                        "them together?",
    "minimal": "The shortest deck.",
}
FIGURES = {
    "orbit_diagram": "Orbit diagram: strobed displacement, impact speeds, impacts per cycle and "
                     "period against the braking torque, from rest, upwards and downwards.",
    "deepest_separation": "Deepest separation against the braking torque.",
    "amplitudes": "Rms and peak to peak of dynamic transmission error and displacement, mean and "
                  "peak mesh force.",
    "staircase": "Impacts per cycle as a staircase, with a strip of classes.",
    "exponents": "Largest Lyapunov exponent and larger Floquet multiplier under the orbit diagram.",
    "impact_speed_density": "How often impacts of which speed happen.",
    "waterfall": "Order spectra of the displacement.",
    "map_classes": "Kinds of motion over speed and braking torque, a cell for each run; dashed: "
                   "the torque above which contact can be kept.",
    "map_depth": "Deepest separation over speed and braking torque.",
    "map_arrivals": "Impacts per mesh cycle over speed and braking torque; outlined: back impacts.",
    "distributions": "How each answer is distributed among pairs, with the limits of its "
                     "quantiles.",
    "tornado": "Which parameter matters most for each answer.",
    "critical_search": "Searches for critical values: what was tried, what was seen, the bracket "
                       "that is left.",
    "te_curve": "Transmission error with its knots, slopes and kinks.",
    "history": "Time history of displacement, mesh force and impacts.",
    "shaft_motion": "Mean speed of both wheels, and each shaft's speed about it.",
    "phase_portrait": "Phase portrait, with the engaged part magnified.",
    "impact_section": "Phase and speed of each impact.",
    "spectrum": "Order spectrum of displacement, mesh force and dynamic transmission error.",
}


def shrunk(source, target):
    """A copy small enough for a page: fewer pixels, fewer colours."""
    with Image.open(source) as image:
        height = round(image.height * WIDTH / image.width)
        small = image.convert("RGB").resize((WIDTH, height), Image.LANCZOS)
        target.parent.mkdir(parents=True, exist_ok=True)
        small.quantize(COLOURS, dither=Image.Dither.NONE).save(target, optimize=True)


def number(path):
    """Torque in a figure's name, to sort by."""
    found = re.search(r"_(\d+(?:\.\d+)?)$", path.stem)
    return float(found[1]) if found else 0.0


def main():
    lines = ["# Gallery", "", "Every figure of the shipped decks, made by the command above it "
             "(reduced copies; `lapwing run` writes PNG and PDF).", ""]
    for deck, words in DECKS.items():
        lines += [f"## {deck}", "", words, "", f"    lapwing run inputs/{deck}.nml", ""]
        for kind, caption in FIGURES.items():
            paths = sorted((RESULTS / deck).glob(f"{kind}*.png"), key=number)
            if not paths:
                continue
            lines += [f"### {caption}", ""]
            for path in paths:
                image = Path("images") / "gallery" / deck / path.name
                shrunk(path, DOCS / image)
                lines += [f"![{deck}: {path.stem.replace('_', ' ')}]({image.as_posix()})", ""]
    (DOCS / "gallery.md").write_text("\n".join(lines), encoding="utf-8")


if __name__ == "__main__":
    main()
