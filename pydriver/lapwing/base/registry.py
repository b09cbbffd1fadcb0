"""The studies there are, and where the parts of each lie: whoever wants a part asks here.

A study is a group of the deck, of the results, of the summary and of the figures. Its parts:

keys    its keys in a deck, their checks and what follows from them (`deck.declare.StudyKeys`)
study   how it is carried out: `carry_out(deck, study, order, threads, done)`, `extent(study)`,
        `failed(dataset)`, and how long it takes: `estimate(deck, study, seconds, clock, threads)`,
        the fields of `studies.cost.Stage` after its name; where `keeps_shards(study)` is true,
        `job(deck, study)` is its `studies.map.task.Task`, and `carry_out` takes a folder for the
        shards, a callable(text) for notes and an executor besides; with `TAKES_FOUND`, what
        the deck's studies before it gave, by kind and name; where its parts are not in `status`,
        `ended(stored)`, a `Status` for each that `extent` counts (one, where that is in %) of its
        group in a result file, variable -> values; `RECORDS`, what it keeps one by one without
        knowing how many there will be (`studies.records`)
report  `headline(dataset)` in one line, `section(datasets, results)`, lines of the summary, and
        where all are told together first, `table(datasets)`
figures modules of `lapwing.plots` with a `draw(dataset, gear_pair, ...)` and, where not every
        dataset has something to show, a `shows(dataset)`

Parts are named, not imported, so that a deck can be checked without the engine and a figure drawn
from a stored file without either.
"""

from __future__ import annotations

from dataclasses import dataclass
from importlib import import_module
from typing import Any


@dataclass(frozen=True)
class Study:
    """One kind of study.

    Attributes
    ----------
    kind : str, its group in a deck; a group of the result file is `<kind>_<name>`
    words : str, one of them as `check` counts it
    keys : str, module and class of its keys
    study, report : str, modules
    figures : tuple of str, modules below `lapwing.plots`, in reading order
    few : tuple of str, those of `figures` that are drawn where a deck names none; empty: all
    turn, place : int, its place when the studies of a deck are carried out, and in the summary
    side_by_side : bool, whether several are carried out at once, each by one thread
    """

    kind: str
    words: str
    keys: str
    study: str
    report: str
    figures: tuple[str, ...]
    turn: int
    place: int
    side_by_side: bool = False
    few: tuple[str, ...] = ()

    @property
    def figure_names(self) -> tuple[str, ...]:
        """Its figures as decks and files name them."""
        return tuple(module.rpartition(".")[2] for module in self.figures)

    def part(self, name: str) -> Any:
        """Module of a part, or class where one is named; loaded at the first use."""
        module, _, member = getattr(self, name).partition(":")
        module = import_module(f"lapwing.{module}")
        return getattr(module, member) if member else module


# In the order of the deck's reference.
STUDIES = {study.kind: study for study in (
    Study("response", "response", "deck.keys.response:ResponseKeys", "studies.response.study",
          "report.response",
          ("response.history", "response.phase_portrait", "response.impact_section",
           "response.spectrum", "response.shaft_motion"), turn=1, place=3, side_by_side=True,
          few=("response.history", "response.shaft_motion")),
    Study("sweep", "sweep", "deck.keys.sweep:SweepKeys", "studies.sweep.study", "report.sweep",
          ("sweep.deepest_separation", "sweep.amplitudes", "sweep.orbit_diagram",
           "sweep.staircase", "sweep.exponents", "sweep.impact_speed_density",
           "sweep.waterfall"), turn=3, place=2,
          # Those after the first two are of quantities that a deck must ask for.
          few=("sweep.deepest_separation", "sweep.orbit_diagram", "sweep.amplitudes",
               "sweep.exponents", "sweep.impact_speed_density", "sweep.waterfall")),
    Study("critical", "critical value", "deck.keys.critical:CriticalKeys",
          "studies.critical.study", "report.critical", ("critical_search", "fit_orders"), turn=2,
          place=1),
    Study("map", "map", "deck.keys.map:MapKeys", "studies.map.study", "report.map.text",
          ("map.map_classes", "map.map_depth", "map.map_arrivals", "map.map_exponent",
           "map.map_force", "map.map_rms"), turn=4, place=4,
          # Those after the first are of quantities that a deck must ask for.
          few=("map.map_classes", "map.map_exponent", "map.map_force", "map.map_rms")),
    Study("ensemble", "ensemble", "deck.keys.ensemble:EnsembleKeys", "studies.ensemble.study",
          "report.ensemble.text", ("ensemble.distributions", "ensemble.tornado"), turn=5,
          place=5),
    Study("branches", "bifurcation diagram", "deck.keys.branches:BranchesKeys",
          "studies.branch.study", "report.branches", ("bifurcation", "branch.curves"), turn=6,
          place=6),
    Study("basins", "basin plane", "deck.keys.basins:BasinsKeys",
          "studies.attractors.basins_study", "report.attractors.basins", ("attractors.basins",),
          turn=8, place=8),
    Study("attractors", "attractor line", "deck.keys.attractors:AttractorsKeys",
          "studies.attractors.study", "report.attractors.along", ("attractors.attractor_shares",),
          turn=7, place=7))}


def give_accessor() -> None:
    """Give xarray's Datasets the attribute `lapwing`; for whoever makes or opens one."""
    import_module("lapwing.accessor").register()


def carried_out() -> list[Study]:
    """The studies in the order they are carried out."""
    return sorted(STUDIES.values(), key=lambda study: study.turn)


def summarised() -> list[Study]:
    """The studies in the order of the summary."""
    return sorted(STUDIES.values(), key=lambda study: study.place)
