"""How far results are: what is done, at work, failed and missing, and how to look at a failure."""

from __future__ import annotations

import contextlib
import json
import os
import re
import shlex
import socket
from collections.abc import Iterator
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
import typer

from lapwing.base.codes import Status
from lapwing.base.exit_codes import ExitCode
from lapwing.console import complain
from lapwing.folder import INTERRUPTED, RESULT_FILE, SHARDS, FolderError, deck_of

if TYPE_CHECKING:
    from numpy.typing import NDArray

# Failed runs that are listed one by one, and shards by which a rate is judged.
LISTED, RECENT = 100, 64
_HOLDER = re.compile(r"process (\d+) on (.+)")


@dataclass
class StudyState:
    """How far one study is.

    Attributes
    ----------
    study : str, its group in the result file
    runs, unit : int, str, what there is of it: runs, points, cells, values, ...
    done, failed, missing : int, of these; done are those that have a result, failed those that have
        none, or of which some run failed. done and missing are None where it is not known: somebody
        is at work, and stores nothing of it before it ends
    shards, shards_done : int, the parts that are kept, 0 where there are none
    runs_per_second, seconds_left : float or None, by the shards that came last; None: not known
    records, record_unit : int or None, str, what is kept one by one of a study that has no result
        yet: trials, branches. How many are left is not known
    seconds_per_record : float or None, of the records that came last
    failed_runs : list of int, the first of those that failed, counted as `status` is; empty where
        parts of one run are counted
    begins_anew : bool, whether what is done is of a run that was interrupted, from which the next
        one does not go on
    """

    study: str
    runs: int
    unit: str
    done: int | None = 0
    failed: int = 0
    missing: int | None = 0
    shards: int = 0
    shards_done: int = 0
    runs_per_second: float | None = None
    seconds_left: float | None = None
    records: int | None = None
    record_unit: str = ""
    seconds_per_record: float | None = None
    failed_runs: list[int] = field(default_factory=list)
    begins_anew: bool = False


@dataclass
class State:
    """How far the results of a deck are.

    Attributes
    ----------
    results : str, their folder
    state : 'complete', 'running' or 'incomplete' (nobody is at work)
    at_work : list of str, processes at work, as far as is known
    studies : list of StudyState; empty where the first run is at work and keeps no shards
    rerun : str or None, the command that repeats the first failed run with all its events
    """

    results: str
    state: str
    at_work: list[str]
    studies: list[StudyState]
    rerun: str | None = None


def status(results: Annotated[list[Path], typer.Argument(
               metavar="RESULTS...", help="folders of results, results/DECK")],
           as_json: Annotated[bool, typer.Option(
               "--json", help="as JSON, a list")] = False) -> None:
    """Say how far results are: runs done, failed and missing, who is at work, the time left.

    \b
    Example:
      lapwing status results/my_map
    """  # noqa: D301
    from lapwing.deck import DeckError
    from lapwing.results.store import StoreError

    found, code = [], ExitCode.GOOD
    for folder in results:
        try:
            found.append(state_of(base_of(folder)))
        except (DeckError, StoreError) as error:
            complain(str(error))
            code = ExitCode.BAD_INPUT
    if as_json:
        print(json.dumps([asdict(one) for one in found], indent=1))
    else:
        for one in found:
            print("\n".join(_lines(one)))
    raise typer.Exit(code)


def base_of(folder: Path) -> Path:
    """The folder of results that is meant, which need not be there yet."""
    for suffix in (SHARDS, INTERRUPTED):
        if folder.name.endswith(suffix):
            return folder.with_name(folder.name.removesuffix(suffix))
    return folder


def state_of(results: Path) -> State:
    """How far the results of a deck are.

    Raises
    ------
    lapwing.folder.FolderError
        where there is nothing that a run made.
    lapwing.deck.DeckError
        where the deck of which they are cannot be read.
    """
    from lapwing.base.registry import STUDIES
    from lapwing.deck import used_hash
    from lapwing.results.store import COMPLETE, Manifest
    from lapwing.studies.of_deck import jobs_of, shards_of, studies_of

    at_work = [*_at_work(results)]
    try:
        deck = deck_of(results)
    except FolderError:
        if not at_work:
            raise
        # Without shards nothing is written, the deck neither, before there are results.
        return State(str(results), "running", at_work, [])
    stored: dict[str, NDArray[Any]] = {}
    complete = False
    for folder in (results.with_name(results.name + INTERRUPTED), results):
        manifest = Manifest.read(folder)
        if manifest is not None and manifest.inputs == used_hash(deck) \
                and RESULT_FILE in manifest.files:
            stored |= _stored(folder / RESULT_FILE)
            complete = manifest.state == COMPLETE
    jobs = {f"{kind}_{name}": job for kind, name, job in jobs_of(deck)}
    studies = []
    for kind, name in studies_of(deck):
        group, part = f"{kind}_{name}", STUDIES[kind].part("study")
        asked = next(one for one in deck.studies[kind] if one.name == name)
        runs, unit = part.extent(asked)
        if unit == "%":  # of one search
            runs, unit = 1, STUDIES[kind].words
        counted = _counted(StudyState(group, int(runs), unit), stored.get(group))
        if counted.missing:
            folder = shards_of(results.with_name(results.name + SHARDS), kind, name)
            if group in jobs:
                _of_shards(counted, jobs[group], folder, bool(at_work))
            elif hasattr(part, "RECORDS") and part.keeps_shards(asked):
                _of_records(counted, part.RECORDS, folder, used_hash(deck))
            counted.begins_anew = not counted.shards and counted.missing < counted.runs
            if at_work and group not in jobs and group not in stored:
                counted.done = counted.missing = None
        studies.append(counted)
    state = "running" if at_work else "complete" if complete else "incomplete"
    return State(str(results), state, at_work, studies, _rerun(results, studies))


def _rerun(results: Path, studies: list[StudyState]) -> str | None:
    from lapwing.base.registry import STUDIES

    for one in studies:
        part = STUDIES[one.study.partition("_")[0]].part("study")
        if one.failed and hasattr(part, "again"):
            return shlex.join(["lapwing", "rerun", str(results), one.study,
                               str((one.failed_runs or [0])[0])])
    return None


def _stored(path: Path) -> dict[str, NDArray[Any]]:
    """How the parts of studies in a result file ended: group -> array of `Status`, in its order."""
    import netCDF4

    from lapwing.base.registry import STUDIES

    found = {}
    with contextlib.suppress(OSError, RuntimeError), netCDF4.Dataset(path) as file:
        file.set_auto_maskandscale(False)
        for name, group in file.groups.items():
            study = STUDIES.get(name.partition("_")[0])
            if study is not None:
                ended = getattr(study.part("study"), "ended", None)
                found[name] = np.array(
                    ended(group.variables) if ended else
                    group["status"][...] if "status" in group.variables else
                    [group.getncattr("status")]).ravel()
    return found


def _counted(state: StudyState, ended: NDArray[Any] | None) -> StudyState:
    """A state that is given what is done; nothing is known of what did not end (None)."""
    if ended is None:
        ended = np.full(state.runs, Status.UNFINISHED)
    good, open_ = ended == Status.OK, ended == Status.UNFINISHED
    failed = np.flatnonzero(~good & ~open_)
    state.runs, state.done, state.missing = ended.size, int(good.sum()), int(open_.sum())
    state.failed, state.failed_runs = failed.size, failed[:LISTED].tolist()
    return state


def _of_shards(state: StudyState, job: Any, folder: Path, running: bool) -> None:
    """Count a study by its shards."""
    from lapwing.results.shards import read_status, shard_path

    ended = np.full(job.grid.runs, Status.UNFINISHED, dtype=np.int8)
    came = []
    for index in range(job.cut.shards):
        found = read_status(folder, index, job.told(index))
        if found is not None:
            first, stop = job.cut.place(index)
            ended[first:stop] = found
            with contextlib.suppress(OSError):
                came.append((shard_path(folder, index).stat().st_mtime, stop - first))
    grid = job.grid
    if len(grid.order) > 1:  # runs of a map are counted line by line, its results by its axes
        ended = ended.reshape(grid.shape).transpose(
            [grid.order.index(name) for name in grid.axes]).ravel()
    _counted(state, ended)
    if job.unit:  # parts of one run, which is repeated whole
        state.unit, state.failed_runs = job.unit, []
    state.shards, state.shards_done = job.cut.shards, len(came)
    state.runs_per_second = _rate(sorted(came)[-RECENT:])
    if running and state.runs_per_second and state.missing:
        state.seconds_left = state.missing / state.runs_per_second


def _of_records(state: StudyState, unit: str, folder: Path, owner: str) -> None:
    """Count what a study keeps one by one."""
    from lapwing.studies.records import seconds_of

    took = seconds_of(folder, owner)
    state.records, state.record_unit = len(took), unit
    if took:
        state.seconds_per_record = sum(took[-RECENT:]) / len(took[-RECENT:])


def _rate(came: list[tuple[float, int]]) -> float | None:
    """Runs per second between the first and the last of some shards; None: not known."""
    if len(came) < 2 or came[-1][0] <= came[0][0]:
        return None
    return sum(runs for _, runs in came[1:]) / (came[-1][0] - came[0][0])


def _at_work(results: Path) -> Iterator[str]:
    """Processes that write results or shards; of other machines it is not known whether still."""
    shards = results.with_name(results.name + SHARDS)
    marks = [results.parent / f".{results.name}.lock", *sorted(shards.glob(".part-*.lock"))]
    for mark in marks:
        try:
            held = _HOLDER.match(mark.read_text(encoding="utf-8"))
        except (OSError, ValueError):
            continue
        here = held is not None and held[2].strip() == socket.gethostname()
        if held is None or (here and not _lives(int(held[1]))):
            continue
        part = re.match(r"\.part-(\d+)-of-(\d+)\.lock", mark.name)
        yield held[0].strip() + (f", part {part[1]} of {part[2]}" if part else "")


def _lives(process: int) -> bool:
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    except OSError:
        return True
    return True


def _lines(state: State) -> list[str]:
    lines = [f"{state.results}: {state.state}"
             + f"; at work: {'; '.join(state.at_work)}" * bool(state.at_work)
             + "; how far it is is not known before it ends" * (not state.studies)]
    for one in state.studies:
        lines.append(f"  {one.study}: {_told(one)}")
        if one.failed_runs and one.runs > 1:
            lines.append(f"    failed: {', '.join(map(str, one.failed_runs[:10]))}"
                         + ", …" * (one.failed > 10))
    if state.rerun:
        lines.append(f"  to see one fail: {state.rerun}")
    return lines


def _told(one: StudyState) -> str:
    """How far a study is, in words."""
    if one.done is None:
        text = "no result stored yet"
        text += "; how far it is is not known before it ends" * (one.records is None)
    else:
        text = f"{one.done} of {one.runs} {one.unit if one.runs > 1 else ''}".rstrip() + " done"
        text += f", {one.failed} failed" * bool(one.failed)
        text += f", {one.missing} missing" * bool(one.missing)
    if one.begins_anew:
        text += "; the run was interrupted, another one begins it anew"
    if one.shards:
        text += f"; {one.shards_done} of {one.shards} shards"
    if one.runs_per_second:
        text += f"; {one.runs_per_second:.3g} {one.unit}/s of late"
    if one.seconds_left is not None:
        text += f", about {_duration(one.seconds_left)} left"
    if one.records is not None:
        text += f"; {one.record_unit} so far: {one.records or 'none'}"
        if one.seconds_per_record is not None:
            text += f", {_duration(one.seconds_per_record)} each of late"
        text += "; how many are left is not known"
    return text


def _duration(seconds: float) -> str:
    for unit, length in (("days", 86400), ("h", 3600), ("min", 60)):
        if seconds >= 2 * length:
            return f"{seconds / length:.3g} {unit}"
    return f"{seconds:.2g} s"
