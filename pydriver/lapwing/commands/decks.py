"""What the commands do with each deck, and what they say of it on the console."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from lapwing.base import estimates, exit_codes, signals
from lapwing.base.exit_codes import ExitCode
from lapwing.base.registry import STUDIES
from lapwing.console import complain

if TYPE_CHECKING:
    from concurrent.futures import Executor

    from lapwing.deck.deck import Deck
    from lapwing.progress import Bars, Lines

# Said of what shares work, where no study of a deck is cut into shards.
NONE_TO_SHARE = ("goes with &map, &ensemble and &basins, and with long &sweep and &response; "
                 "the deck has none")

OK, FAILED, BAD_INPUT, SURROUNDINGS = (
    ExitCode.GOOD, ExitCode.FAILED, ExitCode.BAD_INPUT, ExitCode.SURROUNDINGS)


def loaded_decks(paths: list[Path], settings: list[str],
                 whole: bool = True) -> tuple[list[Deck], ExitCode]:
    """Decks that are good, and the exit code of those that are not.

    Parameters
    ----------
    paths : list of Path
    settings : list of str, GROUP.KEY=VALUE
    whole : bool, whether what cannot fit into memory is refused; a part of it may fit
    """
    from lapwing.deck import DeckError, load_deck

    overrides, code = [], OK
    for setting in settings:
        key, equals, value = setting.partition("=")
        if not equals:
            complain(f"--set {setting}: expected GROUP.KEY=VALUE")
            raise typer.Exit(BAD_INPUT)
        overrides.append((key, value))
    loaded = []
    for path in paths:
        try:
            deck = load_deck(path, overrides)
        except DeckError as error:
            complain(str(error))
            code = BAD_INPUT
            continue
        for warning in deck.warnings:
            complain(str(warning))
        too_large = estimates.refusals(deck) if whole else []
        for text in too_large:
            complain(text)
        code = BAD_INPUT if too_large else code
        loaded += [] if too_large else [deck]
    return loaded, code


def studies_in_words(deck: Deck) -> str:
    """How much there is to do."""
    counts = ((len(deck.studies[study.kind]), study.words) for study in STUDIES.values())
    return ", ".join(f"{n} {word}{'s' if n != 1 else ''}" for n, word in counts if n)


def refused(error: Any, prefix: str = "", path: Path | None = None) -> ExitCode:
    """Say in one line what the surroundings refuse; the exit code. Other errors go on."""
    if not exit_codes.is_of_surroundings(error):
        raise error
    complain(prefix + exit_codes.words(error, path))
    return exit_codes.of_error(error)


def _attempt(deck: Deck, progress: Any, work: Callable[[], Any], stopped: str,
             out: Path | None = None, last: bool = True) -> tuple[Any, ExitCode]:
    """What a deck's work gives, or None; what stops it is said in one line, its exit code returned.

    Parameters
    ----------
    deck, progress : closed at the end, unless more follows
    work : callable()
    stopped : what to say where a signal stops it
    out : folder that the work writes into, or None
    last : whether nothing follows that is good
    """
    from lapwing.results.store import StoreError

    good = False
    try:
        result, good = work(), True
        return result, OK
    except StoreError as error:
        complain(str(error))
        return None, BAD_INPUT
    except (OSError, MemoryError, RuntimeError) as error:
        return None, refused(error, f"{deck.title}: ", out)
    except KeyboardInterrupt:
        complain(f"{deck.title}: stopped; {stopped}")
        return None, exit_codes.of_signal(signals.heard())
    finally:
        if last or not good:
            progress.close()


def part_of(deck: Deck, out: Path, part: int, parts: int, threads: int,
            progress: Bars | Lines) -> ExitCode:
    """Make a part of a deck's shards and report; returns its exit code."""
    from lapwing.part import run_part
    from lapwing.studies.of_deck import is_cut

    if not is_cut(deck):
        complain(f"{deck.path}: --shard {NONE_TO_SHARE}")
        return BAD_INPUT
    found, code = _attempt(
        deck, progress,
        lambda: run_part(deck, out, part, parts, threads=threads, progress=progress),
        "the shards that are finished stay", out)
    if found is None:
        return code
    for note in found.notes:
        complain(note)
    head = f"{deck.title}: part {part} of {parts}"
    if found.complete:
        print(f"{head}: complete results of the same values lie there, no shard is made")
    elif not found.made + found.there:
        print(f"{head}: nothing is left for it, there are fewer shards than parts")
    else:
        lay = f", {found.there} lay there" * bool(found.there)
        print(f"{head} is done: {found.made} shard{'s' * (found.made != 1)} made{lay}; lapwing run "
              "without --shard puts the parts together")
    return OK


def merge_of(deck: Deck, out: Path, threads: int, force: bool, progress: Bars | Lines,
             figures: str) -> ExitCode:
    """Run a deck whose shards are all there; else name those that are missing."""
    from lapwing.part import missing_shards

    missing, code = _attempt(deck, progress, lambda: missing_shards(deck, out),
                             "nothing was finished", out, last=False)
    if missing is None:
        return code
    for study, (indices, count) in missing.items():
        complain(f"{deck.title}: {study}: {len(indices)} of {count} shards are missing: "
                 f"{ranges(indices)}")
    if missing:
        progress.close()
        complain(f"{deck.title}: nothing is put together; the command that made the parts makes "
                 "what is missing, and so does lapwing run without --merge")
        return FAILED
    return run_of(deck, out, threads, force, progress, figures)


def ranges(numbers: Sequence[int]) -> str:
    """Rising whole numbers in words: `3, 5-8, 12`."""
    runs: list[list[int]] = []
    for number in numbers:
        if runs and number == runs[-1][1] + 1:
            runs[-1][1] = number
        else:
            runs.append([number, number])
    return ", ".join(f"{first}-{last}" if last > first else str(first) for first, last in runs)


def run_of(deck: Deck, out: Path, threads: int, force: bool, progress: Any,
         figures: str, executor: Executor | None = None) -> ExitCode:
    """Run one deck and report; returns its exit code."""
    from lapwing.run import run_deck

    outcome, code = _attempt(
        deck, progress,
        lambda: run_deck(deck, out, threads=threads, force=force, progress=progress,
                         figures=figures, executor=executor), "nothing was finished", out)
    if outcome is None:
        return code
    for note in outcome.notes:
        complain(note)
    if outcome.reused:
        print(f"{deck.title}: results of the same values are there already, reused: "
              f"{outcome.folder}")
        say_findings(outcome.findings)
        return OK
    what = "stopped; what is finished lies in" if outcome.interrupted else "done, results in"
    print(f"{deck.title}: {what} {outcome.folder}")
    say_findings(outcome.findings)
    for line in outcome.headlines:
        print(f"  {line}")
    for study in outcome.failed:
        complain(f"{deck.title}: {study}: failed numerically, see status")
    for stem, what in outcome.undrawn.items():
        complain(f"{deck.title}: figure {stem}: {what}")
    if outcome.interrupted:
        return exit_codes.of_signal(signals.heard())
    if outcome.refused:
        return SURROUNDINGS
    return FAILED if outcome.failed or outcome.undrawn else OK


def criticals_of(deck: Deck, threads: int, progress: Bars | Lines) -> ExitCode:
    """Search and print the critical values of one deck; returns its exit code."""
    from lapwing.report.answers.findings import findings
    from lapwing.report.critical import critical_table, critical_text
    from lapwing.studies.critical.study import critical_study

    if not deck.criticals:
        complain(f"{deck.path}: no &critical in this deck")
        return BAD_INPUT
    found, code = _attempt(deck, progress, lambda: [
        critical_study(deck, study, threads, progress.study(f"critical {study.name}", 100, "%"))
        .assign_attrs(name=study.name) for study in deck.criticals], "nothing was finished")
    if found is None:
        return code
    print(f"# {deck.title}\n")
    say_findings(findings((), found, ()))
    print("\n".join(["", *critical_table(found), "", *critical_text(found)]))
    failed = any("trial_failed" in one and int(one["trial_failed"].sum()) for one in found)
    return FAILED if failed else OK


def say_findings(found: Any) -> None:
    """The findings, ahead of everything else."""
    from lapwing.report.answers.findings import on_console

    if found:
        print(on_console(found))
