"""The command `lapwing`; how it ends: `exit_codes.ExitCode`."""

from __future__ import annotations

import math
import os
import re
import sys
from enum import StrEnum
from importlib.util import find_spec
from pathlib import Path
from typing import Annotated

# Before the imports that look at them: plugins and a thread pool cost more than `check` itself.
os.environ.setdefault("PYDANTIC_DISABLE_PLUGINS", "__all__")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import typer

from lapwing.base import estimates, exit_codes, signals
from lapwing.base.exit_codes import MEANINGS, ExitCode
from lapwing.commands.decks import (
    criticals_of,
    loaded_decks,
    merge_of,
    part_of,
    refused,
    run_of,
    studies_in_words,
)
from lapwing.commands.rerun import rerun
from lapwing.commands.slurm import slurm
from lapwing.commands.status import status
from lapwing.console import complain, version_line

if TYPE_CHECKING:

    from lapwing.deck.deck import Deck

OK, FAILED, BAD_INPUT, SURROUNDINGS, INTERRUPTED = (
    ExitCode.GOOD, ExitCode.FAILED, ExitCode.BAD_INPUT, ExitCode.SURROUNDINGS,
    ExitCode.INTERRUPTED)

app = typer.Typer(
    name="lapwing", no_args_is_help=True, add_completion=False, rich_markup_mode=None,
    pretty_exceptions_enable=False, context_settings={"help_option_names": ["-h", "--help"]},
    help="""Nonlinear dynamics of lapping gear pairs under a braking torque.

\b
Examples:
  lapwing new my_pair.nml                   write a commented deck to start from
  lapwing check my_pair.nml                 say everything that is wrong with it
  lapwing run my_pair.nml                   compute it into results/my_pair/
  lapwing run decks/*.nml --threads 8       side by side; a bad one stops no other
  lapwing run my_pair.nml --set operation.brake_torque=2 --out trial
  lapwing critical my_pair.nml              its critical values alone, printed
  lapwing plot results/my_pair/result.nc    draw its figures again
  lapwing status results/my_map             how far it is, and what failed
  lapwing slurm my_map.nml > my_map.sh      its parts as a job array of Slurm

\b
Exit codes, the worst of several decks:
""" + "\n".join(f"  {code:3} {text}" for code, text in MEANINGS.items()))

Decks = Annotated[list[Path], typer.Argument(metavar="DECK...", help="namelist decks")]


class Figures(StrEnum):
    """Which figures of a run, and in which formats."""

    NONE, PNG, ALL = "none", "png", "all"


Settings = Annotated[list[str], typer.Option(
    "--set", metavar="GROUP.KEY=VALUE", help="override a key of the deck; may be repeated")]


@app.callback(invoke_without_command=True)
def main_options(version: Annotated[bool, typer.Option(
        "--version", help="print the version and how the engine was built")] = False) -> None:
    """Options without a command."""
    if version:
        print(version_line())
        raise typer.Exit(OK)


@app.command()
def run(decks: Decks,
        out: Annotated[Path, typer.Option(metavar="DIR", help="where results/<deck> go")]
        = Path("results"),
        threads: Annotated[int, typer.Option(
            min=0, help="threads; 0: OMP_NUM_THREADS, SLURM_CPUS_PER_TASK or all processors")] = 0,
        setting: Settings = [],  # noqa: B006 - typer copies it
        force: Annotated[bool, typer.Option(
            "--force", help="replace results of other values")] = False,
        figures: Annotated[Figures, typer.Option(
            help="png: those that the deck asks for, or the fewest that answer it; all: every "
            "one, PNG and PDF")] = Figures.PNG,
        shard: Annotated[str | None, typer.Option(
            metavar="K/N", help="of maps, make part K of N alone and publish nothing; a run "
            "without it puts the parts together")] = None,
        executor: Annotated[str | None, typer.Option(
            metavar="NAME", help="what carries out the shards of maps: mpi (under mpiexec), "
            "dask=ADDRESS")] = None,
        merge: Annotated[bool, typer.Option(
            "--merge", help="put together what parts made; where some is missing, name it and make "
            "nothing")] = False) -> None:
    """Run decks: DIR/<deck>/ gets result.nc, figures, summary.md and used.nml.

    \b
    Examples:
      lapwing run inputs/lapping_25x32.nml
      lapwing run a.nml b.nml --out study --threads 4
      lapwing run a.nml --set operation.pinion_speed_rpm=300 --set sweep.to=20 --out fast
    """  # noqa: D301 - \b keeps click from wrapping the lines
    from lapwing import executors
    from lapwing.base.threads import default_threads

    _refuse_equal_stems(decks)
    threads = threads or default_threads()
    ways = [name for name, given in (("--shard", shard), ("--executor", executor),
                                     ("--merge", merge or None)) if given is not None]
    if len(ways) > 1:
        complain(f"{' and '.join(ways)}: each shares the work in its own way, expected one")
        raise typer.Exit(BAD_INPUT)
    if merge:
        raise typer.Exit(_each(decks, setting, lambda deck, progress: merge_of(
            deck, out, threads, force, progress, figures.value), whole=False))
    if shard is not None:
        part, parts = _part(shard)
        raise typer.Exit(_each(decks, setting, lambda deck, progress: part_of(
            deck, out, part, parts, threads, progress), whole=False))
    if len(decks) > 1 and threads > 1 and executor is None:
        from lapwing.commands.side_by_side import run_side_by_side

        loaded, code = loaded_decks(decks, setting)
        raise typer.Exit(max(code, run_side_by_side(loaded, threads, {
            "out": out, "threads": threads, "force": force, "figures": figures.value})))
    try:
        with executors.opened(executor) as pool:
            code = _each(decks, setting, lambda deck, progress: run_of(
                deck, out, threads, force, progress, figures.value, pool))
    except executors.NotTheRoot:
        code = OK
    except ValueError as error:
        complain(str(error))
        code = BAD_INPUT
    except OSError as error:
        code = refused(error, f"--executor {executor}: ")
    raise typer.Exit(code)


@app.command()
def critical(decks: Decks,
             threads: Annotated[int, typer.Option(
                 min=0, help="threads; 0: OMP_NUM_THREADS, SLURM_CPUS_PER_TASK or all processors")
             ] = 0,
             setting: Settings = []) -> None:  # noqa: B006
    """Find the critical values of decks (&critical) alone and print them; nothing is written.

    \b
    Example:
      lapwing critical inputs/critical_25x32.nml
    """  # noqa: D301
    from lapwing.base.threads import default_threads

    raise typer.Exit(_each(decks, setting, lambda deck, progress: criticals_of(
        deck, threads or default_threads(), progress)))


@app.command()
def check(decks: Decks, setting: Settings = [],  # noqa: B006
          threads: Annotated[int, typer.Option(
              min=0, help="threads that the time is estimated for; 0: as run takes them")] = 0,
          timing: Annotated[bool, typer.Option(
              "--time/--no-time",
              help="estimate the time, computing for a second or two")] = True) -> None:
    """Check decks without running them: every problem, with file, line and column.

    \b
    Example:
      lapwing check decks/*.nml
    """  # noqa: D301
    from lapwing.base.threads import default_threads
    from lapwing.deck.checks.magnitudes import magnitudes
    from lapwing.studies import cost

    loaded, code = loaded_decks(decks, setting)
    for deck in loaded:
        print(f"{deck.path}: good; {studies_in_words(deck)}; {_derived(deck)}"
              + estimates.stated(deck) + f"\n  {magnitudes(deck)}")
    if timing:
        times = cost.stated(loaded, threads or default_threads())
        for deck, text in zip(loaded, times, strict=True):
            print(f"{deck.path}: {text}")
    raise typer.Exit(code)


@app.command()
def new(file: Annotated[Path | None, typer.Argument(
        metavar="[FILE]", help="deck to write; without it the deck is printed")] = None) -> None:
    """Write a commented deck to start from.

    \b
    Examples:
      lapwing new my_pair.nml
      lapwing new > my_pair.nml
    """  # noqa: D301
    from lapwing.deck import template_text

    if file is None:
        if sys.stdout.isatty():
            print(template_text(), end="")
        else:  # a file or pipe gets what the named file would get
            sys.stdout.flush()
            sys.stdout.buffer.write(template_text().encode())
        raise typer.Exit(OK)
    try:
        with file.open("x", encoding="utf-8") as stream:
            stream.write(template_text())
    except FileExistsError:
        complain(f"{file}: exists already; it is left as it is")
        raise typer.Exit(BAD_INPUT) from None
    except OSError as error:
        complain(exit_codes.words(error, file))
        raise typer.Exit(exit_codes.of_error(error)) from None
    print(f"{file}: written; now: lapwing check {file}")


@app.command()
def plot(
        files: Annotated[list[Path], typer.Argument(
            metavar="RESULT.nc...", help="result files")],
        out: Annotated[Path | None, typer.Option(
            metavar="DIR", help="folder for the figures; default: beside the file")] = None,
) -> None:
    """Draw every figure of result files again, from the files alone.

    \b
    Example:
      lapwing plot results/lapping_25x32/result.nc --out figures
    """  # noqa: D301
    from lapwing.base.threads import default_threads
    from lapwing.drawing import plot_file
    from lapwing.plots import FigureError
    from lapwing.progress import begun
    from lapwing.results.store import StoreError

    code = OK
    for file in files:
        if file.is_dir():
            complain(f"{file}: a folder, expected a result file, {file / 'result.nc'}")
            code = max(code, BAD_INPUT)
            continue
        progress = begun(file, "figures")
        try:
            written, failures = plot_file(file, out, default_threads(), progress), {}
        except FigureError as error:
            written, failures = error.written, error.failures
            code = max(code, SURROUNDINGS if error.of_surroundings else FAILED)
        except (ValueError, StoreError) as error:
            complain(f"{file}: {error}")
            code = max(code, BAD_INPUT)
            continue
        except (OSError, MemoryError, RuntimeError) as error:
            code = max(code, refused(error, path=file))
            continue
        finally:
            progress.close()
        for path in written:
            print(path)
        for stem, what in failures.items():
            complain(f"{file}: figure {stem}: {what}")
    raise typer.Exit(code)


def _derived(deck: Deck) -> str:
    """Numbers in which a slip of a unit shows."""
    pair = deck.gear_pair
    hertz = pair.natural_frequency / (2 * math.pi)
    text = f"natural frequency {hertz:.4g} Hz, damping ratio {pair.xi:.4g}"
    operation = {key: deck.operation.get(key) for key in
                 ("pinion_speed_rpm", "pinion_speed_rad_s", "mesh_frequency_hz")}
    if any(value is not None for value in operation.values()):
        text += f", mesh frequency {pair.mesh_frequency(**operation) / (2 * math.pi):.4g} Hz"
    if deck.te_table.sampled and not deck.te_table.fit:
        text += "; samples of the transmission error used raw, their noise as well (harmonics or " \
                "smoothing fits a curve)"
    return text


def _part(text: str) -> tuple[int, int]:
    """Part and parts of `--shard`."""
    found = re.fullmatch(r"(\d{1,9})/(\d{1,9})", text, re.ASCII)
    if found and 1 <= int(found[1]) <= int(found[2]):
        return int(found[1]), int(found[2])
    complain(f"--shard {text}: expected K/N with 1 <= K <= N, as 3/16")
    raise typer.Exit(BAD_INPUT)


def _refuse_equal_stems(decks: list[Path]) -> None:
    """Two decks of one stem would write into one folder."""
    seen: dict[str, Path] = {}
    for deck in decks:
        if deck.stem in seen:
            complain(f"{seen[deck.stem]} and {deck} would both write results/{deck.stem}; "
                      "rename one")
            raise typer.Exit(BAD_INPUT)
        seen[deck.stem] = deck


def _each(decks: list[Path], settings: list[str], carry_out: Callable[..., Any],
          whole: bool = True) -> ExitCode:
    """Carry out one deck after the other until a signal; the worst exit code."""
    from lapwing.progress import begun

    loaded, code = loaded_decks(decks, settings, whole)
    for deck in loaded:
        ended: ExitCode = carry_out(deck, begun(deck.title, studies_in_words(deck)))
        code = max(code, ended)
        if signals.heard() is not None or ended >= ExitCode.STOPPED:
            return max(code, exit_codes.of_signal(signals.heard()))
    return code


for command in (slurm, status, rerun):
    app.command()(command)
# The benchmark lies beside the package: an installation has it or has it not.
if find_spec("lapwing_bench"):
    from lapwing_bench.command_line import bench

    app.command()(bench)


def called() -> Any:
    """Carry out the command line; the exit code."""
    try:
        code = int(app(standalone_mode=False) or 0)
        return exit_codes.of_signal(signals.heard()) if code == INTERRUPTED else code
    except typer.Abort:
        return exit_codes.of_signal(signals.heard())
    except Exception as error:
        # A usage error: typer may bring a click of its own, so that its class has no fixed home.
        if not (hasattr(error, "show") and hasattr(error, "exit_code")):
            raise
        error.show()
        return error.exit_code
