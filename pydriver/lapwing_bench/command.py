"""What `lapwing bench` does: measure, store, report."""

from __future__ import annotations

import sys
from dataclasses import replace

from lapwing_bench.scenes import SCENES


class BenchError(ValueError):
    """Names that are not known, all at once."""


def run_bench(scenes, methods, *, full, repeats, out, command):
    """Measure and store.

    Parameters
    ----------
    scenes, methods : sequences of names; empty: all
    full : bool, every torque and tolerance
    repeats : int, of each timing; 0: the plan's own number
    out : Path, folder
    command : str, as typed

    Returns
    -------
    Path of the result file

    Raises
    ------
    BenchError
        names of scenes or methods that are not known.
    """
    from lapwing_bench import store
    from lapwing_bench.measure import FULL, METHODS, QUICK, measure

    _check(scenes, methods, METHODS)
    plan = FULL if full else QUICK
    if repeats:
        plan = replace(plan, repeats=repeats)
    out.mkdir(parents=True, exist_ok=True)
    path, say, datasets = out / "bench.nc", _Teller(), {}
    for name in scenes or SCENES:
        datasets[name] = measure(SCENES[name], plan, methods or METHODS, say)
        # After each scene, so that Ctrl-C leaves what is finished: `--from` reports on it.
        store.write(path, datasets, store.provenance(command))
    say.close()
    return path


def show_calls():
    """Measure what a user calls, and print it."""
    from lapwing_bench import public_calls, report

    say, costs = _Teller(), []
    for line in public_calls.lines():
        say(line.name)
        costs.append(public_calls.measured(line))
    say.close()
    report.show_tables([public_calls.table(costs)])


def report_on(source, out, page):
    """Print the tables of a result file, draw its figure, write the page if wanted.

    Parameters
    ----------
    source : Path of the result file
    out : Path, folder of the figure
    page : Path or None

    Returns
    -------
    list of Path, what there is to look at
    """
    from lapwing.plots import style
    from lapwing_bench import report, store, work_precision
    from lapwing_bench.page import write_page

    datasets, attributes = store.read(source)
    report.show(datasets, attributes)
    out.mkdir(parents=True, exist_ok=True)
    written = [source]
    figure = work_precision.draw(report.panels(datasets))
    for suffix in ("png", "pdf"):
        written.append(out / f"{report.FIGURE}.{suffix}")
        style.save(figure, written[-1])
    if page is not None:
        written += write_page(page, datasets, attributes)
    return written


def _check(scenes, methods, known_methods):
    problems = [f"{what} {name!r}: expected one of {', '.join(known)}"
                for what, names, known in (("scene", scenes, SCENES),
                                           ("method", methods, known_methods))
                for name in names if name not in known]
    if problems:
        raise BenchError("; ".join(problems))


class _Teller:
    """Says on a terminal's standard error what is under way."""

    def __init__(self):
        self._wanted = sys.stderr.isatty()

    def __call__(self, text):
        if self._wanted:
            print(f"\r\x1b[K{text}", end="", file=sys.stderr, flush=True)

    def close(self):
        if self._wanted:
            print("\r\x1b[K", end="", file=sys.stderr)
