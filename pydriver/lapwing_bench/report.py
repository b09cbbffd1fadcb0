"""The report: tables on the terminal and as a page, the figure."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from lapwing_bench import summary
from lapwing_bench.ours import RECORDED, SETTLED
from lapwing_bench.scenes import LONG, SHORT
from lapwing_bench.whole_calls import CALL_ERROR

FIGURE = "work_precision"
# Characters the widest table needs; a narrower terminal breaks its lines.
WIDTH = 114


@dataclass(frozen=True)
class Table:
    """A table for the terminal or a page: heading, what it shows, header, rows of str."""

    heading: str
    words: str
    header: tuple
    rows: list


def tables(datasets):
    """Every table of the report.

    Parameters
    ----------
    datasets : dict of scene name -> Dataset of `measure`

    Returns
    -------
    list of Table
    """
    return [_ratios(datasets), *_calls(datasets), _equal_errors(datasets), _studies(datasets),
            *(_scene(name, dataset) for name, dataset in datasets.items())]


def panels(datasets):
    """What `plots.work_precision.draw` takes."""
    found = []
    for name, dataset in datasets.items():
        horizon, curves = summary.deciding_horizon(dataset), {}
        for line in summary.lines(dataset):
            errors, costs, wrong = curves.setdefault(line.method, ([], [], []))
            errors.append(line.errors[horizon][0])
            costs.append(line.cost)
            wrong.append(line.missed + line.doubled)
        label = f"median error after {(SHORT, LONG)[horizon]} cycles (mesh periods)"
        found.append((f"{name}: {dataset.attrs['title']}", curves, label))
    return found


def _ratios(datasets):
    rows, parts = [], {}
    for name, dataset in datasets.items():
        few = summary.few_calm(dataset)
        parts |= {name: dataset} | ({f"{name}, calm": few} if few is not None else {})
    for name, dataset in parts.items():
        horizon, all_lines = summary.deciding_horizon(dataset), summary.lines(dataset)
        own = {method: summary.chosen(dataset, method) for method in summary.OURS}
        for method in dict.fromkeys(line.method for line in all_lines):
            k = summary.chosen(dataset, method)
            if k is None:
                continue
            line = all_lines[k]
            times = [_times(summary.ratio(dataset, k, base)) if base is not None else "–"
                     for base in own.values()]
            rows.append((name, method, _tolerance(line), _error(line.errors[horizon][0]),
                         _error(line.errors[horizon][1]), _cost(line.cost), *times))
    return Table(
        "Ratios", f"Each method at its cheapest setting with a median error of at most "
        f"{summary.WANTED_ERROR:g} that misses and doubles nothing (its most accurate one if there "
        "is none). Cost in µs per mesh cycle, median over the torques that count, and over the "
        "calm ones where those are too few to decide for the scene; the last columns are the "
        "median, over torques, of its cost over that of `exact` and of `rk4`, chosen the same way.",
        ("scene", "method", "tolerance", "median error", "largest", "µs", "over exact",
         "over rk4"), rows)


def _calls(datasets):
    """Whole calls, and what of `lapwing.sweep` is outside the engine."""
    whole, outside = [], []
    for name, dataset in datasets.items():
        all_lines, horizon = summary.lines(dataset), summary.deciding_horizon(dataset)
        calls = dataset["call"].values
        base = next((k for k, line in enumerate(all_lines) if line.method == "exact"), None)
        for c, case in enumerate(dataset["case"].values):
            for k, line in enumerate(all_lines):
                if np.all(np.isnan(calls[k, c])):
                    continue
                ratios = calls[k, c] / calls[base, c] if base is not None else [np.nan] * 2
                whole.append((name, str(case), line.method, _tolerance(line),
                              _error(line.errors[horizon][0]), *map(_cost, calls[k, c]),
                              *map(_times, ratios)))
                if line.method == "exact":
                    torques, cycles = map(int, str(case).split(" × "))
                    inside = dataset["call_engine"].values[k, c]
                    rest = calls[k, c] - inside
                    outside.append((name, str(case), *map(_cost, inside), *map(_cost, calls[k, c]),
                                    *(f"{100 * part:.1f} %" for part in rest / calls[k, c]),
                                    *(f"{1e-3 * t * torques * cycles:.2f}" for t in rest),
                                    f"{calls[k, c, 0] / calls[k, c, 1]:.2f}"))
    return [Table(
        "Whole calls", "What a user waits for: a sweep of so many torques × mesh cycles from rest, "
        f"each method at its cheapest setting with a median error of at most {CALL_ERROR:g} that "
        "misses and doubles nothing. µs per mesh cycle by the clock, the quickest of several "
        "calls, with one thread and with two. Of `exact` and `rk4` it is `lapwing.sweep` with the "
        "statistics of each recorded cycle, period and class of every motion; a rival gets the "
        "scene ready and compiled, runs all torques (heyoka one by one or in batches, whichever "
        "is faster here) and hands back its events. SciPy and CVODE are left out: the table above "
        "says how far they are.",
        ("scene", "sweep", "method", "tolerance", "median error", "one thread", "two",
         "over exact", "two"), whole), Table(
        "Outside the engine", "`lapwing.sweep` by `exact`, the same calls: µs per mesh cycle "
        "inside the compiled engine and of the whole call, each with one thread and with two; "
        "what is outside in percent and in ms; how much sooner two threads are done.",
        ("scene", "sweep", "engine", "two", "whole", "two", "outside", "two", "ms", "two",
         "sooner"), outside)]


def _equal_errors(datasets):
    rows = []
    for name, dataset in datasets.items():
        methods = dict.fromkeys(str(method) for method in dataset["method"].values)
        rows += [(name, method, *(_cost(summary.cost_at(dataset, method, level))
                                  for level in summary.LEVELS)) for method in methods]
    return Table(
        "Cost at equal error", "µs per mesh cycle for a median error, between the settings of a "
        "method on logarithmic scales; a dash where none of its settings is so accurate.",
        ("scene", "method", *(f"{level:.0e}" for level in summary.LEVELS)), rows)


def _studies(datasets):
    rows = []
    for name, dataset in datasets.items():
        for line in summary.lines(dataset):
            if not math.isnan(line.scaling):
                same = "yes" if line.identical_bytes else "NO"
                rows.append((name, line.method, _tolerance(line), _cost(line.study_computed),
                             _cost(line.study_copied), f"{line.scaling:.2f}", same))
    return Table(
        "A study", f"A sweep of all torques, chaotic ones too: {SETTLED} cycles to settle, "
        f"{RECORDED} with statistics, no events listed. µs per mesh cycle by the clock with every "
        "cycle computed, and with those copied that repeat to the last bit; throughput of two "
        "threads over one, every cycle computed (an idle machine is needed); whether all these "
        "results are the same bytes.",
        ("scene", "method", "tolerance", "computed", "copied", "two threads",
         "identical bytes"), rows)


def _scene(name, dataset):
    calm, n = int(dataset["calm"].sum()), dataset.sizes["torque"]
    rows = []
    for line in summary.lines(dataset):
        rows.append((
            line.method, _tolerance(line),
            *(_error(value) for errors in line.errors for value in errors),
            f"{line.counts[0]}, {line.counts[1]}", f"{line.missed}", f"{line.doubled}",
            f"{line.events_per_cycle:.3g}", _cost(line.cost)))
    which = "calm torques" if summary.deciding_horizon(dataset) else "all torques"
    return Table(
        f"{name}: {dataset.attrs['title']}",
        f"{n} torques from {float(dataset['torque'][0]):g} to {float(dataset['torque'][-1]):g} "
        f"N·m, {calm} of them calm. Median and largest error after {SHORT} cycles (all torques) "
        f"and {LONG} cycles (calm ones), over as many torques as said; events missed and doubled; "
        f"events per cycle; µs per mesh cycle, median over {which}.",
        ("method", "tolerance", f"median {SHORT}", f"largest {SHORT}", f"median {LONG}",
         f"largest {LONG}", "torques", "missed", "doubled", "events", "µs"), rows)


def show(datasets, attributes):
    """Print the tables on the terminal."""
    console = show_tables(tables(datasets))
    for one in attributes["versions"].split(", "):
        name, found, _ = one.partition(" not installed")
        if found:
            console.print(f"{name}: not installed")
    console.print(f"{attributes['machine']}; {attributes['date']}")

def show_tables(tables):
    """Print some tables on the terminal; the console that they were printed on."""
    from rich import box
    from rich.console import Console
    from rich.table import Table as RichTable

    console = Console()
    console = Console(width=max(console.width, WIDTH))
    for table in tables:
        rich = RichTable(title=table.heading, title_justify="left", box=box.SIMPLE_HEAD,
                         padding=(0, 1, 0, 0), caption=table.words, caption_justify="left")
        texts = {"scene", "method", "sweep", "call"}
        for column in table.header:
            rich.add_column(column, justify="left" if column in texts else "right", no_wrap=True)
        for row in table.rows:
            rich.add_row(*row)
        console.print(rich)
    return console


def _tolerance(line):
    return "–" if line.method == "exact" else f"{line.tolerance:.0e}"


def _error(value):
    if math.isnan(value):
        return "–"
    return "missed" if math.isinf(value) else f"{value:.1e}"


def _cost(value):
    return "–" if math.isnan(value) else f"{value:.3g}" if value < 1000 else f"{value:.0f}"


def _times(value):
    return "–" if math.isnan(value) else f"{value:.3g}×" if value < 1000 else f"{value:.0f}×"
