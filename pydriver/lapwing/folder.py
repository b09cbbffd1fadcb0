"""What lies in a results folder before a deck is run into it, and what of it is another's."""

from __future__ import annotations

import contextlib
import os
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from lapwing import __version__
from lapwing.base.messages import printable
from lapwing.deck import DeckError, changed_keys, load_deck, used_hash
from lapwing.deck.used import stored_hash
from lapwing.results.store import COMPLETE, Manifest, StoreError

if TYPE_CHECKING:
    from lapwing.deck.deck import Deck
    from lapwing.results.file import Results

RESULT_FILE = "result.nc"
USED_DECK = "used.nml"
SUMMARY = "summary.md"
# Of a folder in which large studies keep what is finished as long as there is no result.
SHARDS = ".shards"
# Of one in which an interrupted run keeps what it finished beside complete results.
INTERRUPTED = ".interrupted"
FILES = (RESULT_FILE, USED_DECK, SUMMARY)


class FolderError(StoreError):
    """Results of another deck, or something else, lie where this one's would go."""


@dataclass
class Present:
    """What lies in a deck's folder.

    Attributes
    ----------
    manifest : Manifest, or None where there is none that can be read
    inputs : str or None, hash of the values of the results there; None: no results, or not known
    known : tuple of names that are the program's own without a manifest that lists them
    """

    manifest: Manifest | None
    inputs: str | None
    known: tuple[Any, ...] = ()

    @property
    def complete(self) -> bool:
        """Whether there are results that lack nothing, as far as anybody knows."""
        return self.manifest.state == COMPLETE if self.manifest else bool(self.known)


def folder_of(stem: str, parent: str | os.PathLike[str]) -> Path:
    """Folder of a deck's results.

    Raises
    ------
    FolderError
        where the deck's name makes no folder of its own.
    """
    if stem.startswith(".") or stem in ("", ".."):
        raise FolderError(f"a deck named {stem!r} has no folder of its own; expected is a name "
                          "that does not begin with a dot")
    folder = Path(parent) / stem
    try:
        str(folder.absolute()).encode()
    except UnicodeEncodeError:
        raise FolderError("netCDF files have names in UTF-8, which "
                          f"{printable(str(folder))} is not; "
                          "rename the deck or take another --out") from None
    return folder.resolve() if folder.is_symlink() else folder


def present_in(folder: Path) -> Present:
    """What lies in the folder; files that no run wrote are refused."""
    if not folder.exists():
        return Present(None, None)
    if not folder.is_dir():
        raise FolderError(f"{folder} is no folder; expected is none, or one of results")
    manifest = Manifest.read(folder)
    if manifest is not None and RESULT_FILE in manifest.files:
        return Present(manifest, manifest.inputs)
    if not any(folder.iterdir()):
        return Present(None, None)
    # Of version 0.1, or with a damaged manifest.
    result = folder / RESULT_FILE
    inputs = stored_hash(read_text(folder / USED_DECK)) or _stored_inputs(result)
    if inputs is None:
        raise FolderError(f"{folder} holds files, but no results that could be told from files of "
                          "yours; expected is a new or empty folder, or one that a run made. Name "
                          "another with --out")
    return Present(None, inputs, FILES + _figure_names(result))


def _stored_inputs(result: Path) -> str | None:
    """Hash of the values in a result file that can be read, or None."""
    from lapwing.results import read_results

    with contextlib.suppress(OSError, ValueError, RuntimeError), read_results(result) as results:
        return str(results.attrs["used_hash"])
    return None


def _figure_names(result: Path) -> tuple[str, ...]:
    """Names of the figures that belong to a result file, as far as it can be read."""
    from lapwing.results import read_results

    with contextlib.suppress(OSError, ValueError, RuntimeError, KeyError), \
            read_results(result) as results:
        return figures_of(results)
    return ()


def figures_of(results: Results) -> tuple[str, ...]:
    """Names of the figures of an open result file."""
    from lapwing.plots import FORMATS, tasks_of

    return tuple(f"{task.stem}.{suffix}" for task in tasks_of(results) for suffix in FORMATS)


def refuse_others(deck: Deck, folder: Path, there: Present, force: bool) -> None:
    """Refuse to replace results of other values, or of another version, without `force`."""
    if force or there.inputs is None:
        return
    same_values = there.inputs == used_hash(deck)
    program = there.manifest.program if there.manifest else __version__
    if same_values and program == __version__:
        return
    try:
        changes = changed_keys(load_deck(folder / USED_DECK), deck) or (
            "the transmission error's numbers",)
    except DeckError:
        changes = (f"{folder / USED_DECK} cannot be read",)
    if same_values:
        changes = (f"the version of Lapwing: {program} -> {__version__}",)
    raise FolderError(f"{folder}: results of other values lie there; --force replaces them. "
                      "What differs:\n" + "\n".join(f"  {line}" for line in changes))


def drawn_in(manifest: Manifest | None) -> set[str]:
    """Which figures a manifest says were asked for (`plots.choice.asked`)."""
    if manifest is None:
        return set()
    if manifest.figures is not None:
        return set(manifest.figures)
    # Of builds that drew every figure: that of the curve, which all results have, tells in what.
    from lapwing.plots import FORMATS, TE_FIGURE

    return {f"{suffix} all" for suffix in FORMATS if f"{TE_FIGURE}.{suffix}" in manifest.files}


def note_deck(deck: Deck, shards: Path) -> None:
    """Say beside the shards of a deck what they are of; a deck without shards needs no note.

    Raises
    ------
    OSError
        where it cannot be written.
    """
    from lapwing.deck import used_text
    from lapwing.studies.of_deck import keeps_shards

    if not keeps_shards(deck):
        return
    text, path = used_text(deck, shards), shards / USED_DECK
    if read_text(path) == text:
        return
    shards.mkdir(parents=True, exist_ok=True)
    aside = shards / f".{USED_DECK}.{os.getpid()}.tmp"
    try:
        aside.write_text(text, encoding="utf-8")
        os.replace(aside, path)
    finally:
        aside.unlink(missing_ok=True)


def deck_of(results: Path) -> Deck:
    """The deck that results, finished or under way, are of: what a run noted last.

    Raises
    ------
    FolderError
        where no run noted one.
    lapwing.deck.DeckError
        where it cannot be read.
    """
    noted = [path for path in (results.with_name(results.name + SHARDS) / USED_DECK,
                               results.with_name(results.name + INTERRUPTED) / USED_DECK,
                               results / USED_DECK) if path.is_file()]
    if not noted:
        raise FolderError(f"{results}: no results, and no shards; expected is a folder that a run "
                          "made, results/DECK")
    deck: Deck = load_deck(noted[0])
    return deck


def read_text(path: Path) -> str:
    """A text file, as far as it can be read."""
    try:
        return path.read_text(encoding="utf-8", errors="replace")
    except OSError:
        return ""
