"""Figures, drawn from results alone: any of them can be redrawn from a stored file."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from importlib import import_module
from inspect import signature
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from lapwing.base.exit_codes import is_of_surroundings
from lapwing.base.registry import STUDIES, carried_out
from lapwing.plots.choice import formats_of

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.figure import Figure

    from lapwing.plots.critical_marks import Mark
    from lapwing.plots.pool import DrawingPool
    from lapwing.plots.sweep.parts import Claim
    from lapwing.results.file import Results

FORMATS = ("png", "pdf")
# Modules with a `draw` each, by the kind of study they show.
FIGURES = {kind: study.figures for kind, study in STUDIES.items()}
TE_FIGURE = "te_curve"
FIT_FIGURE = "te_fit"  # of measured samples


class FigureError(Exception):
    """Some figures could not be drawn; all others are.

    Attributes
    ----------
    written : list of Path
    failures : dict of file stem -> str, what went wrong
    of_surroundings : bool, whether disk or memory is to blame for one of them
    """

    def __init__(self, written: list[Path], failures: dict[str, str],
                 of_surroundings: bool = False) -> None:
        super().__init__("; ".join(f"figure {stem}: {what}" for stem, what in failures.items()))
        self.written, self.failures = written, failures
        self.of_surroundings = of_surroundings


class Problem(NamedTuple):
    """Why a figure could not be drawn, and whether disk or memory is to blame."""

    what: str
    of_surroundings: bool = False


class Task(NamedTuple):
    """One figure.

    Attributes
    ----------
    stem : str, of its files
    module : str, of this package, with the `draw` that makes it
    kind : str, of the study that holds its data, or 'transmission_error'
    name : str or None, of the response, critical value or sweep
    formats : tuple of str, of `FORMATS`
    """

    stem: str
    module: str
    kind: str
    name: str | None = None
    formats: tuple[str, ...] = FORMATS


def tasks_of(results: Any) -> list[Task]:
    """Every figure of a result file, in reading order.

    Returns
    -------
    list of Task
    """
    return [*(Task(f"{module.rpartition('.')[2]}_{name}", module, kind, name)
              for kind in _reading_order()
              for name in results.studies.get(kind, ()) for module in FIGURES[kind]
              if shows(module, results.study(kind, name))),
            *[Task(FIT_FIGURE, FIT_FIGURE, "transmission_error")]
            * ("sample_residual" in results.transmission_error),
            Task(TE_FIGURE, TE_FIGURE, "transmission_error")]


def names_of(results: Any, words: Iterable[str]) -> list[str]:
    """File names of the figures that are asked for, as PNG, the first to look at first.

    It is of the kind of study that gives the widest view; of these figures the one whose module
    says by `leads(dataset)` that it answers most. All others are in reading order.
    """
    tasks = [task for task in tasks_of(results) if "png" in formats_of(task, results, words)]
    first = max((task for task in tasks if task.kind == tasks[0].kind), default=None,
                key=lambda task: _leads(task, results))
    return [f"{task.stem}.png" for task in sorted(tasks, key=lambda task: task is not first)]


def _leads(task: Task, results: Any) -> float:
    leads = getattr(figure_module(task.module), "leads", lambda _: 0.0)
    # NaN of a run that failed would win and lose against everything.
    return float(np.nan_to_num(leads(results.study(task.kind, task.name)))) if task.name else 0.0


def _reading_order() -> list[str]:
    """Kinds of study, what is carried out last first: it gives the widest view."""
    return [study.kind for study in reversed(carried_out())]


def shows(module: str, dataset: xr.Dataset) -> bool:
    """Whether a dataset holds what a figure shows."""
    return bool(getattr(figure_module(module), "shows", lambda _: True)(dataset))


def draw_all(results: Any, folder: Any, *, formats: tuple[str, ...] = FORMATS,
             progress: Callable[..., Any] | None = None,
             pool: DrawingPool | None = None, words: Iterable[str] | None = None) -> list[Path]:
    """Draw the figures of a result file.

    Parameters
    ----------
    results : lapwing.results.Results, or an object with its `attrs`, `gear_pair`, `studies`,
        `study(kind, name)` and `transmission_error`
    folder : str or Path, made if it is missing
    formats : of 'png' and 'pdf'
    progress : callable(fraction done) or None
    pool : lapwing.plots.pool.DrawingPool or None, processes to share the work, which read the file
        `results.path` themselves; the figures are the same, bit by bit
    words : iterable of str, which figures are asked for and in which formats (`choice.asked`);
        default: every figure, in `formats`

    Returns
    -------
    list of Path
        What was written: `te_curve`, `<figure>_<sweep>`, `<figure>_<response>`,
        `critical_search_<critical>`, in each format.

    Raises
    ------
    FigureError
        where some figures could not be drawn; the others are there.
    """
    return Drawing(results, folder, formats=formats, pool=pool, words=words).finish(progress)


class Drawing:
    """Figures of a result file that are begun: what draws them works while the caller does more.

    Parameters
    ----------
    results, folder, formats, pool, words : as `draw_all`

    Attributes
    ----------
    folder : Path, where they go
    """

    def __init__(self, results: Any, folder: Any, *, formats: tuple[str, ...] = FORMATS,
                 pool: DrawingPool | None = None, words: Iterable[str] | None = None) -> None:
        self._results, self.folder, self._pool = results, Path(folder), pool
        self.folder.mkdir(parents=True, exist_ok=True)
        tasks = [task._replace(formats=formats if words is None else
                               formats_of(task, results, words)) for task in tasks_of(results)]
        self._tasks = [task for task in tasks if task.formats]
        if pool:
            pool.begin(results.path, self._tasks, self.folder)

    def finish(self, progress: Callable[..., Any] | None = None) -> list[Path]:
        """Draw what is left, and wait for the rest; returns and raises as `draw_all`."""
        outcomes: dict[Task, Problem | None] = {}
        for task, problem in self._outcomes():
            outcomes[task] = problem
            if progress is not None:
                progress(len(outcomes) / len(self._tasks))
        written = [self.folder / f"{task.stem}.{suffix}" for task in self._tasks
                   if outcomes[task] is None for suffix in task.formats]
        problems = {task.stem: problem for task in self._tasks
                    if (problem := outcomes[task]) is not None}
        if problems:
            raise FigureError(written, {stem: one.what for stem, one in problems.items()},
                              any(one.of_surroundings for one in problems.values()))
        return written

    def _outcomes(self) -> Iterator[tuple[Task, Problem | None]]:
        if self._pool:
            yield from self._pool.finish(self._results.path, self.folder)
        else:
            for task in self._tasks:
                yield task, attempt(self._results, task, self.folder)


def attempt(results: Any, task: Task, folder: Path) -> Problem | None:
    """Draw one figure into its files, all or none; returns the `Problem`, or None."""
    try:
        data = results.transmission_error if task.name is None \
            else results.study(task.kind, task.name)
        figure = figure_of(task.module, data, gear_pair=results.gear_pair,
                           **_options(results, task))
        _save(figure, [folder / f"{task.stem}.{suffix}" for suffix in task.formats])
    except Exception as error:
        return Problem(f"{type(error).__name__}: {error}", is_of_surroundings(error))
    return None


# What figures may be told besides their data; each takes what it needs of it.
OPTIONS = ("gear_pair", "title", "full_engagement", "claims", "marks", "sweeps", "curves")


def figure_of(figure: str, dataset: xr.Dataset, **options: Any) -> Figure:
    """A figure of a dataset.

    Parameters
    ----------
    figure : str, as `figure_module`
    dataset : xarray.Dataset, a study or the group `transmission_error`
    **options : of `OPTIONS`; what the figure has no use for is left out

    Returns
    -------
    matplotlib.figure.Figure

    Raises
    ------
    TypeError
        for any other option.
    """
    for name in options.keys() - set(OPTIONS):
        raise TypeError(f"figure {figure}: no option {name!r}, expected some of "
                        f"{', '.join(OPTIONS)}")
    draw = figure_module(figure).draw
    taken = signature(draw).parameters
    drawn: Figure = draw(dataset, **{name: value for name, value in options.items()
                                     if name in taken})
    return drawn


def figure_module(figure: str) -> ModuleType:
    """Module with the `draw` of a figure, named as in `FIGURES` or by its last part."""
    known = (name for study in STUDIES.values() for name in study.figures)
    full = next((name for name in known if name.rpartition(".")[2] == figure), figure)
    return import_module(f"lapwing.plots.{full}")


def _save(figure: Figure, paths: list[Path]) -> None:
    from lapwing.plots.style import save

    try:
        save(figure, *paths)
    except BaseException:
        for path in paths:
            with suppress(OSError):
                path.unlink(missing_ok=True)
        raise


def _options(results: Any, task: Task) -> dict[str, Any]:
    """What `draw` of a figure is told besides its data."""
    if task.kind == "sweep":
        from lapwing.plots.sweep.parts import parameter_of

        deck = str(results.attrs.get("deck_name", ""))
        shown = task.module.rpartition(".")[2].replace("_", " ")
        return {"title": f"{deck}, sweep '{task.name}': {shown}",
                "claims": _claims(results, str(task.name)),
                "marks": _marks(results, parameter_of(results.sweep(task.name)))}
    if task.kind == "map":
        return {"title": f"{results.attrs.get('deck_name', '')}, {task.kind} '{task.name}'",
                "curves": _curves(results, results.study(task.kind, task.name))}
    if task.kind in ("ensemble", "attractors", "basins"):
        return {"title": f"{results.attrs.get('deck_name', '')}, {task.kind} '{task.name}'"}
    if task.kind == "branches":
        parameter = results.study(task.kind, task.name).attrs["parameter"]
        swept = [results.sweep(name) for name in results.sweeps]
        return {"title": f"{results.attrs.get('deck_name', '')}, branches '{task.name}'",
                "sweeps": [one for one in swept if one["status"].dims[1] == parameter]}
    if task.kind == "critical":
        parameter = results.critical(task.name).attrs["parameter"]
        return {"marks": _marks(results, parameter, besides=task.name)}
    return {}


def _curves(results: Any, plane: xr.Dataset) -> list[xr.Dataset]:
    """Diagrams whose curves lie in the plane of a map."""
    axes = {str(plane.attrs[f"{side}_parameter"]) for side in "xy"}
    found = (results.study("branches", name) for name in results.studies.get("branches", ()))
    return [one for one in found if one.sizes.get("curve_point", 0)
            and {one.attrs["parameter"], one.attrs["second_parameter"]} == axes]


def _marks(results: Results, parameter: str, besides: str | None = None) -> list[Mark]:
    """Critical values along a parameter, one of them left out if it is named."""
    from lapwing.plots.critical_marks import marks_of

    return marks_of([results.critical(name) for name in results.criticals if name != besides],
                    parameter)


def _claims(results: Results, name: str) -> list[Claim]:
    """What the source reports, from the responses: they know of impacts as well."""
    from lapwing.plots.sweep.parts import Claim, parameter_of

    parameter = parameter_of(results.sweep(name))
    claims = []
    for attrs in (results.response(response).attrs for response in results.responses):
        if parameter in attrs and any(key.startswith("claim_") for key in attrs):
            claims.append(Claim(float(attrs[parameter]),
                                float(attrs.get("claim_deepest_separation", np.nan)),
                                str(attrs.get("claim_text", "")),
                                float(attrs.get("claim_impacts_per_cycle", np.nan))))
    return claims
