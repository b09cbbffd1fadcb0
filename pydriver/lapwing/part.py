"""A part of a deck's large studies, for several processes or machines to share the work."""

from __future__ import annotations

import contextlib
from typing import TYPE_CHECKING, Any, NamedTuple

from lapwing.base.threads import checked_threads
from lapwing.deck import used_hash
from lapwing.folder import SHARDS, folder_of, note_deck, present_in
from lapwing.results.lock import FolderLock, StoreError

if TYPE_CHECKING:
    import os

    from lapwing.deck.deck import Deck


class Part(NamedTuple):
    """What became of a part.

    Attributes
    ----------
    made, there : int, shards that were made, and that lay there already
    complete : bool, whether complete results of the same values lie there: then no shard is made
    notes : tuple of str, shards that were found damaged or of something else, and made again
    """

    made: int
    there: int
    complete: bool
    notes: tuple[str, ...]


def run_part(deck: Deck, parent: str | os.PathLike[str], part: int, parts: int, *,
             threads: int | None = None, progress: Any = None) -> Part:
    """Make each `parts`-th shard of a deck's large studies, from the `part`-th on; publish nothing.

    So many calls, in processes of their own, share the work; `run_deck` puts it together, and makes
    what is missing. No lock is taken: shards appear whole.

    Parameters
    ----------
    deck, parent, threads, progress : as for `run_deck`
    part, parts : int, 1 <= part <= parts

    Returns
    -------
    Part

    Raises
    ------
    lapwing.folder.FolderError
        where files lie in the folder that no run wrote.
    OSError
        where a shard cannot be written.
    """
    from lapwing.studies.of_deck import compute_part

    folder = folder_of(deck.stem, parent)
    folder.parent.mkdir(parents=True, exist_ok=True)
    there = present_in(folder)
    if there.complete and there.inputs == used_hash(deck):
        return Part(0, 0, True, ())
    notes: list[str] = []
    report = progress.study if progress else (lambda *_: (lambda _: None))
    shards = folder.with_name(folder.name + SHARDS)
    note_deck(deck, shards)
    with contextlib.ExitStack() as stack:
        # A mark that it is at work, no more: another one at the same part may be, too.
        with contextlib.suppress(StoreError, OSError):
            stack.enter_context(FolderLock(shards / f"part-{part}-of-{parts}"))
        made, lay = compute_part(deck, part, parts, checked_threads(threads), report, shards,
                                 notes.append)
    return Part(made, lay, False, tuple(notes))


def missing_shards(deck: Deck,
                   parent: str | os.PathLike[str]) -> dict[str, tuple[list[int], int]]:
    """Shards that a deck's large studies lack: study -> their numbers, and how many there are.

    Nothing is missing where complete results of the same values lie.

    Raises
    ------
    lapwing.folder.FolderError
        where files lie in the folder that no run wrote.
    """
    from lapwing.studies.map.work import missing_of
    from lapwing.studies.of_deck import jobs_of, shards_of

    folder = folder_of(deck.stem, parent)
    there = present_in(folder)
    if there.complete and there.inputs == used_hash(deck):
        return {}
    lacking = {}
    for kind, name, job in jobs_of(deck):
        shards = shards_of(folder.with_name(folder.name + SHARDS), kind, name)
        missing = missing_of(job, shards)
        if missing:
            lacking[f"{kind} {name}"] = missing, job.cut.shards
    return lacking
