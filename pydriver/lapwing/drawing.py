"""The figures of a result file drawn again, from the file alone."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Any

from lapwing.folder import figures_of
from lapwing.plots.choice import asked
from lapwing.results.store import FolderLock, add_files


def plot_file(path: Path, folder: Path | None = None, threads: int = 1,
              progress: Any = None) -> list[Path]:
    """Draw every figure of a result file, into its own folder unless another is named.

    Files that are not the program's own are left as they are (docs/results.md).

    Parameters
    ----------
    path : str or Path
    folder : str or Path, or None
    threads : int, processes that draw
    progress : as for `run_deck`

    Returns
    -------
    list of Path

    Raises
    ------
    lapwing.results.DamagedFile
        where the file's content is not what was written.
    lapwing.plots.FigureError
        where some figures could not be drawn; the others are there.
    lapwing.results.store.StoreError
        while a run writes into the folder.
    """
    from lapwing.plots import FigureError, draw_all
    from lapwing.plots.pool import DrawingPool
    from lapwing.results import read_results

    path = Path(path)
    folder = Path(folder) if folder else path.parent
    folder.mkdir(parents=True, exist_ok=True)
    done = progress.study("figures", 100, "%") if progress else None
    with read_results(path) as results, FolderLock(folder.resolve()):
        aside = folder.resolve().parent / f".{folder.resolve().name}.drawing"
        shutil.rmtree(aside, ignore_errors=True)
        aside.mkdir()
        failures, of_surroundings = {}, False
        try:
            with DrawingPool(threads) as pool:
                try:
                    draw_all(results, aside, progress=done, pool=pool)
                except FigureError as error:
                    failures, of_surroundings = error.failures, error.of_surroundings
            names = sorted(one.name for one in aside.iterdir())
            own = figures_of(results) if folder.resolve() == path.parent.resolve() else ()
            taken = add_files(folder, aside, own, figures=asked("all", {}))
        finally:
            shutil.rmtree(aside, ignore_errors=True)
    written = [folder / name for name in names if name not in taken]
    failures |= {Path(name).stem: f"another file is named {name}; it is left as it is"
                 for name in taken}
    if failures:
        raise FigureError(written, failures, of_surroundings)
    return written
