"""The command `lapwing bench`, which `lapwing` offers where this package is installed."""

from __future__ import annotations

import shlex
import sys
from pathlib import Path
from typing import Annotated

import typer


def bench(scene: Annotated[list[str], typer.Option(
              metavar="NAME", help="scene to run; may be repeated; default: all")] = [],  # noqa: B006
          method: Annotated[list[str], typer.Option(
              metavar="NAME", help="method to run; may be repeated; default: all")] = [],  # noqa: B006
          full: Annotated[bool, typer.Option(
              "--full/--quick", help="every torque and tolerance (some 30 minutes), or fewer "
              "(six minutes)")] = False,
          repeats: Annotated[int, typer.Option(
              min=0, help="repeats of each timing; 0: as --full or --quick say")] = 0,
          out: Annotated[Path, typer.Option(metavar="DIR", help="where bench.nc and figure go")]
          = Path("results/bench"),
          page: Annotated[Path | None, typer.Option(
              metavar="FILE.md", help="write the report as a page, its figure beside it")] = None,
          calls: Annotated[bool, typer.Option(
              "--calls", help="only what a user's own calls take and what of it is outside the "
              "engine; half a minute")] = False,
          source: Annotated[Path | None, typer.Option(
              "--from", metavar="BENCH.nc", help="report on stored numbers, measure nothing")]
          = None):
    """Measure speed against error, beside what a user would pick instead.

    Scenes: S1, S2, S3, S3b, S4, A. Methods: exact, rk4, heyoka, "numba DOPRI5", CVODE,
    "SciPy RK45", "SciPy DOP853", "SciPy LSODA"; those not installed are named and left out
    (pip install numba heyoka scikit-sundae).

    \b
    Examples:
      lapwing bench
      lapwing bench --scene S2 --scene A --method rk4 --method "numba DOPRI5"
      lapwing bench --full --page docs/speed-and-error.md
      lapwing bench --calls
      lapwing bench --from results/bench/bench.nc
    """  # noqa: D301
    from lapwing_bench.command import BenchError, report_on, run_bench, show_calls

    if calls:
        show_calls()
        return
    command = "lapwing bench " + " ".join(shlex.quote(word) for word in sys.argv[2:])
    try:
        if source is None:
            source = run_bench(scene, method, full=full, repeats=repeats, out=out,
                               command=command.strip())
        for path in report_on(source, out, page):
            print(path)
    except BenchError as error:
        print(error, file=sys.stderr)
        raise typer.Exit(2) from None
    except OSError as error:
        print(f"{error.filename or out}: {error.strerror or error}", file=sys.stderr)
        raise typer.Exit(2) from None
