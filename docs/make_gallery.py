"""Make docs/gallery.md and its images from results/ of the shipped decks.

Run from the checkout after `lapwing run --figures none inputs/*.nml`: python docs/make_gallery.py
With names of decks behind it, after runs of these alone, it makes their parts anew.

The README's map of a million runs is drawn anew where these lie, half an hour of two cores:

    lapwing run --figures none --out results/million --set map.x_count=1000 --set map.y_count=1000 \
        inputs/plane_25x32.nml
"""

import re
import sys
import tempfile
from pathlib import Path

from lapwing.plots import attempt, style, tasks_of
from lapwing.plots.choice import asked, formats_of
from lapwing.results import read_results

DOCS = Path(__file__).parent
RESULTS = Path("results")
# Dots an inch: the figures are drawn for a page, so that letters and colours stay what they are.
DPI = 90
# Of a thousand cells side by side each is to have a pixel.
FINE_DPI = 135
MILLION = RESULTS / "million" / "plane_25x32" / "result.nc"
# Figures beside those that a run draws by itself, at least one of each kind.
MORE = {"lapping_25x32": {"staircase_torque", "phase_portrait_torque_3.3",
                          "impact_section_torque_3.3", "spectrum_torque_3.3", "te_curve"},
        "critical_25x32": {"critical_search_T_safe", "critical_search_T_back"},
        "kinked_480rpm": {"phase_portrait_torque_0.8", "te_curve"},
        "plane_25x32": {"map_depth", "map_arrivals"}}

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
    "basins_25x32": "Which start leads to rattling? Where the source sees separation vanish, at "
                    "12 N·m, nearly half of the states shown do, at 12.4 N·m nearly a quarter: a "
                    "run that stayed quiet proves nothing there, and a single knock can begin a "
                    "rattling that does not end.",
    "attractors_25x32": "How much rattling is left near the torque at which separation is said to "
                        "vanish? From 11.92 N·m on contact can last, but up to 12.17 N·m half of "
                        "the starts rattle on, at 12.4 N·m still a quarter, in one motion after "
                        "the other, each over a range of torque of its own.",
    "branches_25x32": "Why rattling ends where it ends: every periodic motion that was found, "
                      "followed in the torque, stable or not. The last stable rattling meets an "
                      "unstable one in a fold at 12.42754 N·m; what is raised slowly dies before, "
                      "at 12.404 N·m.",
    "branches_25x32_relative": "The same under the physical impact law: rattling shrinks away and "
                               "ends in a fold 0.00001 N·m above the torque from which contact "
                               "can be kept.",
    "diagram_25x32": "The whole range of torques: branches stop where a rebound has no speed, "
                     "overlap, and leave gaps in which no motion repeats. The last island of "
                     "rattling, up to 12.4275 N·m, is one that this sweep's starts do not meet, "
                     "the random ones of branches_25x32 do.",
    "diagram_25x32_relative": "The same under the physical impact law: from 4.5 N·m up to where "
                              "contact can be kept one motion of period one that ends in complete "
                              "chatter, but between 10.7 and 11.3 N·m, where its bounces pass "
                              "a jump of the curvature one by one.",
    "diagram_1500rpm": "The smooth transmission error at 1500 rpm: rattling that repeats lives on, "
                       "on a branch of its own, up to 12.496 N·m, where the sweep sees none from "
                       "11.98 N·m on.",
    "diagram_480rpm": "The parabola with a kink at 480 rpm: nothing rattles above the torque from "
                      "which contact can be kept but for a last 0.00002 N·m.",
    "curves_25x32": "What ends the stable motions of a smooth transmission error at 1500 rpm, "
                    "followed in the speed: folds and doublings run along the borders of the map's "
                    "regions, and between them where no run from rest tells of a change.",
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
    "attractor_shares": "Attractors along the braking torque, each followed from value to value, "
                        "and the share of random starts that end in each.",
    "basins": "Basins: each start in the colour of the motion it leads to, these motions drawn in.",
    "bifurcation": "Bifurcation diagram: branches of periodic motions, stable solid, unstable "
                   "dashed, over what the sweep saw; marked: where a branch ends or turns.",
    "curves": "Special points of branches followed in a second parameter; dotted: where the "
              "branches are.",
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


def drawn(results, tasks, folder, dpi=DPI):
    """Draw some figures of a result file for a page."""
    before, style.DPI = style.DPI, dpi
    folder.mkdir(parents=True, exist_ok=True)
    try:
        for task in tasks:
            problem = attempt(results, task._replace(formats=("png",)), folder)
            if problem:
                raise RuntimeError(f"{task.stem}: {problem.what}")
    finally:
        style.DPI = before


def shrunk(stem, result, target, dpi=DPI):
    """One figure of a result file, drawn for a page."""
    with read_results(result) as results, tempfile.TemporaryDirectory() as folder:
        drawn(results, [task for task in tasks_of(results) if task.stem == stem], Path(folder),
              dpi)
        target.parent.mkdir(parents=True, exist_ok=True)
        target.write_bytes((Path(folder) / f"{stem}.png").read_bytes())


def shown(results, deck):
    """Figures of a deck for the gallery: the few of a run, and some more."""
    words = asked("png", {(kind, name): None for kind, names in results.studies.items()
                          for name in names})
    kinds = [task for task in tasks_of(results) if formats_of(task, results, words)]
    return kinds + [task for task in tasks_of(results) if task not in kinds and (
        task.stem in MORE.get(deck, ()) or task.module.rpartition(".")[2] in MORE.get(deck, ()))]


def number(task):
    """Torque in a figure's name, to sort by."""
    found = re.search(r"_(\d+(?:\.\d+)?)$", task.stem)
    return float(found[1]) if found else 0.0


def part(deck, words):
    """A deck's part of the page, its figures drawn anew."""
    if not (RESULTS / deck / "result.nc").exists():
        raise SystemExit(f"{RESULTS / deck}: no results; run the deck first")
    lines = [f"## {deck}", "", words, "", f"    lapwing run inputs/{deck}.nml", ""]
    folder = DOCS / "images" / "gallery" / deck
    for old in folder.glob("*.png"):
        old.unlink()
    with read_results(RESULTS / deck / "result.nc") as results:
        tasks = shown(results, deck)
        drawn(results, tasks, folder)
    for kind, caption in FIGURES.items():
        of_kind = sorted((task for task in tasks
                          if task.module.rpartition(".")[2] == kind), key=number)
        lines += [f"### {caption}", ""] * bool(of_kind)
        for task in of_kind:
            image = Path("images") / "gallery" / deck / f"{task.stem}.png"
            lines += [f"![{deck}: {task.stem.replace('_', ' ')}]({image.as_posix()})", ""]
    return "\n".join(lines)


def main(names):
    """Make the parts of some decks, and keep the others; without names make all."""
    page = DOCS / "gallery.md"
    there = re.split(r"(?m)^(?=## )", page.read_text(encoding="utf-8"))
    kept = {one.split()[1]: one.rstrip() + "\n" for one in there[1:]}
    head = ("# Gallery\n\nFigures of the shipped decks: what the command above them draws, and "
            "some that are drawn where they are asked for ([deck.md](deck.md), "
            "section \"Figures\").\n")
    parts = [kept[deck] if names and deck not in names else part(deck, words)
             for deck, words in DECKS.items()]
    page.write_text("\n".join([head, *parts]), encoding="utf-8")
    if names and "lapping_25x32" not in names:
        return
    # Of the README.
    shrunk("orbit_diagram_torque", RESULTS / "lapping_25x32" / "result.nc",
           DOCS / "images" / "orbit_diagram.png")
    if MILLION.exists():
        shrunk("map_classes_plane", MILLION, DOCS / "images" / "map_classes.png", FINE_DPI)


if __name__ == "__main__":
    main(sys.argv[1:])
