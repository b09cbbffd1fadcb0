"""Which figures of a result file a run draws: the fewest that answer, or those a deck names.

What is asked for is a set of words, so that a manifest can keep it: "png all", "pdf all" for every
figure; "png few"; "png response torque_1.8 few", "png sweep torque staircase" for some of a study.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, Any

from lapwing.base.registry import STUDIES

if TYPE_CHECKING:
    from lapwing.plots import Task

ALL, FEW, NONE = "all", "few", "none"
# Formats of figures, and whether all are drawn, by what is asked for.
FORMATS_OF = {"none": (), "png": ("png",), "all": ("png", "pdf")}
# Of each kind of study, the figures that are drawn where a deck names none; all where it has none.
FEW_OF = {kind: tuple(module.rpartition(".")[2] for module in study.few)
          for kind, study in STUDIES.items()}


def asked(figures: str, named: Mapping[tuple[str, str], Iterable[str] | None]) -> set[str]:
    """What is asked for.

    Parameters
    ----------
    figures : 'none', 'png' or 'all'
    named : mapping of (kind, name of a study) -> names of its figures, 'all' or 'none' among them;
        None: the fewest

    Returns
    -------
    set of str
    """
    formats = FORMATS_OF[figures]
    if figures == ALL:
        return {f"{one} {ALL}" for one in formats}
    words = [FEW, *(f"{kind} {name} {figure}" for (kind, name), some in named.items()
                    for figure in ((FEW,) if some is None else some) if figure != NONE)]
    return {f"{one} {word}" for one in formats for word in words}


def covers(drawn: Iterable[str], wanted: Iterable[str]) -> bool:
    """Whether all that is wanted was asked for, and drawn, before."""
    drawn = set(drawn)
    return all(word in drawn or f"{word.partition(' ')[0]} {ALL}" in drawn for word in wanted)


def formats_of(task: Task, results: Any, words: Iterable[str]) -> tuple[str, ...]:
    """Formats in which a figure is asked for; none where it is not.

    Parameters
    ----------
    task : Task
    results : as for `draw_all`
    words : what is asked for, as `asked` gives it
    """
    figure = task.module.rpartition(".")[2]
    fits = {ALL, f"{task.kind} {task.name} {figure}", f"{task.kind} {task.name} {ALL}"}
    few = FEW if task.name is None else f"{task.kind} {task.name} {FEW}"
    words = set(words)
    return tuple(one for one in FORMATS_OF[ALL]
                 if any(f"{one} {fit}" in words for fit in fits)
                 or (f"{one} {few}" in words and _is_of_few(task, results)))


def _is_of_few(task: Task, results: Any) -> bool:
    """Whether a figure is one of the fewest that answer."""
    if task.name is None:
        # A curve by a formula holds no surprise.
        return task.module != "te_curve" or results.transmission_error.attrs.get("curve") == \
            "samples"
    few, figure = FEW_OF[task.kind], task.module.rpartition(".")[2]
    return (not few or figure in few) \
        and not (figure == "critical_search" and _in_a_sweep(results, task.name))


def _in_a_sweep(results: Any, name: str) -> bool:
    """Whether the figures of some sweep show a critical value."""
    from lapwing.plots.critical_marks import marks_of

    critical = results.critical(name)
    along = [one["status"].dims[1] for one in map(results.sweep, results.sweeps)]
    return critical.attrs["parameter"] in along \
        and bool(marks_of([critical], critical.attrs["parameter"]))
