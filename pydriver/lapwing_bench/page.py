"""The page docs/speed-and-error.md, written by the command it names."""

from __future__ import annotations

import os

from lapwing_bench.problem import STICKING
from lapwing_bench.report import FIGURE, tables
from lapwing_bench.scenes import LONG, SHORT

HEAD = f"""# Speed and error

What a motion costs and how right it is, for this engine and for what a user would pick instead.
Every number below comes from one run of one command on one machine:

    {{command}}

{{machine}}; {{date}}.
{{engine}}.
{{versions}}.

## What is measured

The source's gear from rest at phase 0, {LONG} mesh cycles, torques from 0.5 to 14 N·m (S1: 12 N·m).

- **Error** of a run: the larger one of the error of an event's time, in mesh periods, and of the
  state at the end, in parts of the natural sizes of angle and velocity. Median and largest are
  taken over torques. A run that misses or doubles an event, or fails, counts as infinitely wrong.
- **Reference**: 60 digits, closed form between events (`tests/reference/bench_flow.py`), for the
  very doubles the methods are given, of a harmonic series itself.
- **Horizons**: {SHORT} cycles at every torque; {LONG} cycles at the *calm* ones, where a relative
  change of 1e-25 of the torque grows by less than 1e4. Elsewhere the motion is chaotic, and no
  method gives the right events for long. Comparison stops once an initial 1e-15 has grown to the
  method's tolerance (or to 1e-11, where that is tighter).
- **Missed or doubled**: an event of the reference absent, or one more, although the closest
  approach to the other outcome exceeds ten times the method's own state error there. At most one
  is counted for each run and horizon: from there on two motions differ. Inside a complete chatter
  only its end counts.
- **Chatter**: this engine sums a complete chatter. The others stick at the first rebound slower
  than {STICKING:g}·(peak-to-peak of g)·Ω when pressed, and are judged against the reference that
  does the same.
- **Cost**: processor time per mesh cycle on one core over {LONG} cycles, median of repeats and of
  torques: the calm ones where at least four are calm, else all. Methods here run all torques of a
  scene in one call, whose time inside the engine is divided among torques in proportion to calls
  of one torque each; a rival's time is that of its call for one torque, without compilation. Both
  record the time and kind of every event, and compute every cycle, also one that repeats an
  earlier one to the last bit; what copying those saves is told under "A study". Rivals with a
  Python right-hand side run only a few torques over the long horizon.
- **Events per cycle** are those each method lists, bounces inside a chatter included.
"""


def page_text(datasets, attributes, image):
    """The page.

    Parameters
    ----------
    datasets : dict of scene name -> Dataset
    attributes : dict, of the result file
    image : str, path of the figure relative to the page

    Returns
    -------
    str, Markdown
    """
    parts = [HEAD.format(**{key: attributes[key] for key in (
        "command", "machine", "date", "engine", "versions")}),
        f"![Cost per mesh cycle against error, one panel for each scene]({image})\n"]
    for table in tables(datasets):
        parts.append(f"## {table.heading}\n\n{table.words}\n\n{_markdown(table)}\n")
    return "\n".join(parts)


def _markdown(table):
    right = {"scene", "method", "sweep"}
    rule = ["---" if column in right else "---:" for column in table.header]
    return "\n".join("| " + " | ".join(row) + " |" for row in (table.header, rule, *table.rows))


def write_page(path, datasets, attributes):
    """Write the page and, in `images` beside it, its figure; returns the paths."""
    from lapwing.plots import style
    from lapwing_bench import work_precision
    from lapwing_bench.report import panels

    image = path.parent / "images" / f"{FIGURE}.png"
    image.parent.mkdir(parents=True, exist_ok=True)
    style.save(work_precision.draw(panels(datasets)), image)
    path.write_text(page_text(datasets, attributes, os.path.relpath(image, path.parent)),
                    encoding="utf-8")
    return [path, image]
