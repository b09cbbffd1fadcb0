"""A script for Slurm: the parts of a deck's large studies as a job array, and their merge."""

from __future__ import annotations

import os
import re
import shlex
import sys
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from lapwing.base.exit_codes import ExitCode
from lapwing.commands.decks import NONE_TO_SHARE, loaded_decks
from lapwing.console import complain

if TYPE_CHECKING:
    from lapwing.deck.deck import Deck

# Seconds before the end of its time at which a part is asked to stop.
NOTICE = 120
# A part is handed in again so often: each time it goes on from its shards.
RESTARTS = 100
# Forms of what Slurm takes: time limits, and sizes of memory.
_TIME = re.compile(r"(?:(?P<days>\d+)-)?(?P<numbers>\d+(?::\d+){0,2})", re.ASCII)
_MEMORY = re.compile(r"[1-9]\d*[KMGT]?", re.ASCII)
_WORD = re.compile(r"[\w.,+-]+", re.ASCII)

SCRIPT = """\
#!/bin/sh
# {title} in {parts} parts, and a job that puts them together; every node has to see {out}.
#     sh FILE        hands in both; the same again makes what is missing
#     sbatch FILE    hands in the parts alone
#SBATCH --job-name={name}
#SBATCH --array=1-{parts}
#SBATCH --time={time}
#SBATCH --mem={memory}
#SBATCH --cpus-per-task={cpus}
{partition}#SBATCH --signal=B:USR1@{notice}
#SBATCH --requeue
#SBATCH --open-mode=append

cd {folder} || exit 3
logs={logs}

if [ "${{1-}}" != merge ] && [ -z "${{SLURM_ARRAY_TASK_ID-}}" ]; then
    [ -f "$0" ] || {{ echo "write this script to a file, and run that" >&2; exit 2; }}
    mkdir -p "$logs" || exit 3
    pattern=$(printf %s "$logs" | sed 's/%/%%/g')
    parts=$(sbatch --parsable --output="$pattern/part-%A_%a.log" "$0") || exit 3
    # afterany: with afterok one cancelled part would leave the merge waiting for ever.
    merge=$(sbatch --parsable --output="$pattern/merge-%A.log" --array=0 \\
        --dependency="afterany:${{parts%%;*}}" "$0" merge) || exit 3
    echo "parts: job ${{parts%%;*}}, merge: job ${{merge%%;*}}, logs: $logs"
    exit 0
fi

# Slurm tells this shell alone that the time is up (USR1) or that it is cancelled (TERM): that is
# handed on, and what is being written is waited for.
again=yes heard= run=
hand_on() {{ [ -z "$run" ] || kill -s "$heard" "$run" 2>/dev/null; }}
trap 'heard=USR1; hand_on' USR1
trap 'heard=TERM again=no; hand_on' TERM
if [ "${{1-}}" = merge ]; then
    {command} --merge &
else
    {command} --shard "$SLURM_ARRAY_TASK_ID/{parts}" &
fi
run=$!
[ -z "$heard" ] || hand_on
wait "$run"
code=$?
while [ -n "$heard" ]; do
    heard=
    wait "$run"
    ended=$?
    [ "$ended" -eq 127 ] || code=$ended    # 127: it had ended already
done

# 75: run it again to continue.
before=${{SLURM_RESTART_COUNT:-0}}
if [ "$code" -eq 75 ] && [ "$again" = yes ] && [ "$before" -lt {restarts} ]; then
    scontrol requeue "$SLURM_JOB_ID"
fi
exit "$code"
"""


def slurm(deck: Annotated[Path, typer.Argument(metavar="DECK", help="namelist deck with &map")],
          out: Annotated[Path, typer.Option(
              metavar="DIR", help="where results/<deck> go; all nodes see it")] = Path("results"),
          tasks: Annotated[int, typer.Option(
              min=0, help="parts; 0: one for each shard and processor, as many as fit")] = 0,
          cpus: Annotated[int, typer.Option(min=1, help="processors of a part")] = 1,
          time: Annotated[str, typer.Option(
              metavar="TIME", help="time of a part; one that is not done then goes on later")]
          = "01:00:00",
          memory: Annotated[str, typer.Option(
              metavar="SIZE", help="memory of a part, and of the merge")] = "2G",
          partition: Annotated[str | None, typer.Option(
              metavar="NAME", help="partition; default: the cluster's")] = None,
          max_array_size: Annotated[int, typer.Option(
              min=2, help="MaxArraySize of the cluster (scontrol show config)")] = 1001,
          setting: Annotated[list[str], typer.Option(
              "--set", metavar="GROUP.KEY=VALUE", help="override a key of the deck; may be "
              "repeated")] = []) -> None:  # noqa: B006 - typer copies it
    """Print a script for Slurm: parts of maps and ensembles as a job array, then their merge.

    \b
    Example:
      lapwing slurm my_map.nml --tasks 200 --time 2:00:00 > my_map.sh
      sh my_map.sh
    """  # noqa: D301
    problems = [text for text in (
        _wrong("--time", time, lambda: (seconds(time) or 0) > 2 * NOTICE,
               f"a time limit of Slurm above {2 * NOTICE // 60} minutes, as 90 or 1:30:00"),
        _wrong("--memory", memory, lambda: _MEMORY.fullmatch(memory), "a size, as 500M or 2G"),
        partition and _wrong("--partition", partition, lambda: _WORD.fullmatch(partition),
                             "names of partitions"),
        _wrong("--tasks", str(tasks), lambda: tasks < max_array_size,
               f"fewer than the {max_array_size} of --max-array-size")) if text]
    for text in problems:
        complain(text)
    loaded, code = loaded_decks([deck], setting, whole=False)
    if problems or not loaded:
        raise typer.Exit(ExitCode.BAD_INPUT)
    parts = _parts(loaded[0], tasks, cpus, max_array_size)
    if not parts:
        complain(f"{deck}: lapwing slurm {NONE_TO_SHARE}")
        raise typer.Exit(ExitCode.BAD_INPUT)
    command = [sys.executable, "-m", "lapwing", "run", str(deck), "--out", str(out),
               "--threads", str(cpus), *(word for one in setting for word in ("--set", one))]
    print(SCRIPT.format(
        title=loaded[0].title, name=re.sub(r"[^\w.-]", "_", loaded[0].title, flags=re.ASCII),
        parts=parts, time=time, memory=memory, cpus=cpus, notice=NOTICE, restarts=RESTARTS,
        partition=f"#SBATCH --partition={partition}\n" if partition else "",
        folder=shlex.quote(os.getcwd()), out=" ".join(str(out).split()),
        logs=shlex.quote(str(out / f"{loaded[0].stem}.logs")),
        command=shlex.join(command)), end="")
    raise typer.Exit(code)


def seconds(text: str) -> int | None:
    """A time limit as Slurm reads it: minutes, m:s, h:m:s, d-h, d-h:m, d-h:m:s; None: none."""
    found = _TIME.fullmatch(text)
    if not found:
        return None
    numbers = [int(number) for number in found["numbers"].split(":")]
    units = (3600, 60, 1)
    if not found["days"]:
        units = {1: (60, 1, 0), 2: (60, 1, 0), 3: units}[len(numbers)]
    given = sum(number * unit for number, unit in zip(numbers, units, strict=False))
    return int(found["days"] or 0) * 86400 + given


def _wrong(option: str, given: str, good: Callable[[], object], expected: str) -> str:
    """What is wrong with the value of an option, or empty text."""
    return "" if good() else f"{option} {given}: expected {expected}"


def _parts(deck: Deck, wanted: int, cpus: int, max_array_size: int) -> int:
    """How many parts: as wanted, else one for each shard and processor, as many as fit; 0: none."""
    from lapwing.studies.of_deck import jobs_of

    shards = max((job.cut.shards for _, _, job in jobs_of(deck)), default=0)
    return min(wanted or -(-shards // cpus), shards, max_array_size - 1)
