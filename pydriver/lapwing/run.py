"""A deck carried out: its studies run, its results written, drawn, summarised and published.

What is in a results folder, and what is promised of it: docs/results.md.
"""

from __future__ import annotations

import contextlib
import errno
import os
import shutil
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from lapwing import __version__
from lapwing.base import arguments, estimates
from lapwing.base.signals import held
from lapwing.base.threads import checked_threads, share_of
from lapwing.deck import Deck, used_hash, used_text
from lapwing.folder import (
    INTERRUPTED,
    RESULT_FILE,
    SHARDS,
    SUMMARY,
    USED_DECK,
    Present,
    drawn_in,
    folder_of,
    note_deck,
    present_in,
    read_text,
    refuse_others,
)
from lapwing.plots.choice import FORMATS_OF, asked, covers
from lapwing.results.shards import discard_studies
from lapwing.results.store import (
    COMPLETE,
    INCOMPLETE,
    MANIFEST,
    FolderLock,
    Manifest,
    Staging,
    discard,
    probe,
    recover,
)

if TYPE_CHECKING:
    from concurrent.futures import Executor

    import xarray as xr

    from lapwing.plots import Drawing
    from lapwing.plots.pool import DrawingPool
    from lapwing.results import Results
    from lapwing.studies.of_deck import Found


@dataclass
class Outcome:
    """How a deck went.

    Attributes
    ----------
    folder : Path, where its results lie
    reused : bool, whether results of the same values were there already
    interrupted : bool, whether a signal stopped it; what was finished is kept
    failed : tuple of str, studies in which some run failed numerically
    undrawn : dict of name -> str, figures that could not be drawn, and why
    refused : bool, whether disk or memory is to blame for one of them
    findings : tuple of str, what the run found, as the summary begins
    headlines : tuple of str, the main result of each study
    notes : tuple of str, what was found damaged and done again, and what was taken over
    """

    folder: Path
    reused: bool = False
    interrupted: bool = False
    failed: tuple[Any, ...] = ()
    undrawn: dict[str, Any] = field(default_factory=dict)
    refused: bool = False
    findings: tuple[Any, ...] = ()
    headlines: tuple[Any, ...] = ()
    notes: tuple[Any, ...] = ()


@arguments.complete()
def run_deck(deck: Deck, parent: str | os.PathLike[str], *, threads: int | None = None,
             force: bool = False, progress: Any = None, figures: str = "all",
             executor: Executor | None = None) -> Outcome:
    """Run a deck into `parent`/<deck>.

    1. Take the folder's lock; clear what a run that was killed left beside it.
    2. Results of the same values are verified and used again; of files that are damaged or missing
       the figures and texts are made again, the result file is computed again.  Results of other
       values are refused unless `force`.
    3. Studies that an interrupted run of the same values finished are taken over; the others run.
    4. Result file, summary and figures are made beside the folder and published at once.  After a
       signal no figures are drawn, and unfinished results do not replace complete ones: they go
       to `parent`/<deck>.interrupted.

    Parameters
    ----------
    deck : lapwing.deck.Deck
    parent : str or Path, created where missing
    threads : int or None; threads that compute, and processes that draw; no result depends on it;
        default `threads.default_threads`
    force : bool, whether results of the same values are computed anew, and others are replaced
    progress : object with `study(label, total, unit)` giving a callable(fraction), or None
    figures : 'none', 'png' (those that the deck asks for) or 'all' (every one, PNG and PDF); those
        drawn already are kept up
    executor : concurrent.futures.Executor or None, which carries out the shards of large studies;
        its workers see `parent`

    Returns
    -------
    Outcome

    Raises
    ------
    TypeError, ValueError
        for refused arguments.
    lapwing.results.store.StoreError
        where the folder is another's: `FolderError` for results of other values without `force`
        or files that no run wrote, `LockedError` while another run writes there.
    OSError
        where something cannot be written; what lay there is still there.
    """
    arguments.instance("deck", deck, Deck)
    threads, force = checked_threads(threads), arguments.flag("force", force)
    words = asked(arguments.choice("figures", figures, FORMATS_OF), {
        (kind, one.name): one.figures for kind, some in deck.studies.items() for one in some})
    if progress is not None:
        arguments.function("progress.study", getattr(progress, "study", None))
    folder = folder_of(deck.stem, arguments.path("parent", parent))
    folder.parent.mkdir(parents=True, exist_ok=True)
    with FolderLock(folder):
        recover(folder)
        there = present_in(folder)
        refuse_others(deck, folder, there, force)
        return _Run(deck, folder, there, threads, progress, words, executor).carry_out(force)


class _Run:
    """One deck under way, its folder locked."""

    def __init__(self, deck: Deck, folder: Path, there: Present, threads: int, progress: Any,
                 words: set[str], executor: Executor | None) -> None:
        self.executor = executor
        self.deck, self.folder, self.there, self.threads = deck, folder, there, threads
        self.report = progress.study if progress else (lambda *_: (lambda _: None))
        self.inputs = used_hash(deck)
        self.notes: list[str] = []
        drawn = drawn_in(there.manifest)
        self.drawn_already = covers(drawn, words)
        self.words = sorted(words | drawn)  # what was drawn once is drawn again with the rest
        self.aside = folder.with_name(folder.name + INTERRUPTED)
        self.shards = folder.with_name(folder.name + SHARDS)
        # A verified result file that lacks nothing, and its checksums.
        self.whole: tuple[Path, dict[str, str]] | None = None

    def carry_out(self, force: bool) -> Outcome:
        """Reuse, draw again, or compute; the `Outcome`."""
        from lapwing.plots.pool import DrawingPool
        from lapwing.report.answers.findings import findings_in
        from lapwing.studies.of_deck import compute

        known = {} if force else self._known()
        if known is None:
            findings = findings_in(read_text(self.folder / SUMMARY))
            return Outcome(self.folder, reused=True, findings=findings)
        estimates.require_disk(self.deck, self.folder)
        with DrawingPool(share_of(self.threads) if self.words else 1,
                         pdf=any(word.startswith("pdf ") for word in self.words)) as pool:
            if force and self.there.inputs == self.inputs:  # else these are parts of what is new
                discard_studies(self.shards)
            note_deck(self.deck, self.shards)
            found = compute(self.deck, self.threads, self.report, known, folder=self.shards,
                            notes=self.notes.append, executor=self.executor)
            return self._publish(found, pool)

    def _known(self) -> dict[tuple[str, str], xr.Dataset] | None:
        """Finished studies that lie there already; None where nothing is left to do."""
        manifest = self.there.manifest
        if manifest is None:
            if self.there.known:
                self.notes.append(f"{self.folder}: without a readable {MANIFEST} nothing there can "
                                  "be verified: computed again")
        else:
            damaged = manifest.damaged(self.folder)
            if not damaged and manifest.state == COMPLETE and self.drawn_already:
                return None
            for name, wrong in damaged.items():
                again = "computed" if name == RESULT_FILE else "made"
                self.notes.append(f"{self.folder / name} is damaged ({wrong}): {again} again")
            if RESULT_FILE not in damaged:
                return self._taken_over(self.folder)
        return self._taken_over(self.aside) if self.aside.exists() else {}

    def _taken_over(self, folder: Path) -> dict[tuple[str, str], xr.Dataset]:
        """Studies of a verified result file of the same values, version and engine."""
        from lapwing.results import SCHEMA_VERSION, engine_digest, read_results, stored_studies
        from lapwing.studies.of_deck import is_finished

        manifest, path = Manifest.read(folder), folder / RESULT_FILE
        if manifest is None or RESULT_FILE not in manifest.files \
                or manifest.inputs != self.inputs or manifest.wrong_with(path):
            return {}
        if (manifest.program, manifest.engine) != (__version__, engine_digest()):
            self.notes.append(f"{folder}: of another build of the engine: computed again")
            return {}
        with read_results(path, check=False) as results:
            if results.attrs.get("schema_version") != SCHEMA_VERSION:
                self.notes.append(f"{folder}: of an earlier form of the result file: computed "
                                  "again")
                return {}
            known = {key: study for key, study in stored_studies(results).items()
                     if is_finished(study)}
            if not results.interrupted:
                self.whole = path, manifest.variables
                return known
        self.notes.append(f"{folder}: {len(known)} finished "
                          f"{'study' if len(known) == 1 else 'studies'} taken over")
        return known

    def _publish(self, found: Found, pool: DrawingPool) -> Outcome:
        """Write everything aside and publish it."""
        from lapwing.plots import FORMATS, Drawing
        from lapwing.report.answers.findings import findings_in
        from lapwing.report.summary import headlines
        from lapwing.results import engine_digest, read_results
        from lapwing.studies.of_deck import studies_of

        folder = self.aside if found.interrupted and self.there.complete else self.folder
        undrawn: dict[str, str] = {}
        refused = drawn = False
        with contextlib.ExitStack() as stack:
            known = self.there.known
            if folder == self.aside:
                stack.enter_context(FolderLock(folder))
                known = ()
            staging = stack.enter_context(Staging(folder))
            stack.push(pool)  # what is drawn there ends before it goes
            try:
                with held():
                    variables = self._write(found, staging.path)
                    results = stack.enter_context(
                        read_results(staging.path / RESULT_FILE, check=False))
                    # Others draw while the summary is written.
                    drawing = None if found.interrupted or not self.words else \
                        Drawing(results, staging.path, words=self.words, pool=pool)
                    self._tell(results, staging.path)
                    findings = findings_in(read_text(staging.path / SUMMARY))
                # Raised at the end of the block: the files are whole.
                if not found.interrupted:
                    undrawn, refused = self._drawn(drawing)
                    drawn = True
            except KeyboardInterrupt:
                pool.stop()
                for path in staging.path.iterdir():
                    if path.suffix[1:] in FORMATS:
                        path.unlink()
            if undrawn or not drawn:
                self._forget_lost_figures(results, staging.path)
            results.close()
            manifest = Manifest.of(
                staging.path, state=COMPLETE if drawn and not undrawn else INCOMPLETE,
                inputs=self.inputs, program=__version__, engine=engine_digest(),
                variables=variables, figures=self.words)
            taken: Sequence[str] = ()
            with contextlib.suppress(KeyboardInterrupt), held():
                taken = staging.publish(manifest, known)
            for name in taken:
                undrawn[Path(name).stem] = f"a file of yours is named {name}; it is left as it is"
        if drawn:
            discard(self.aside)
            discard_studies(self.shards)
        missing = [(kind, name) for kind, name in studies_of(self.deck)
                   if name not in found.studies[kind]]
        return Outcome(folder, interrupted=not drawn, failed=found.failed(), undrawn=undrawn,
                       refused=refused, findings=findings, notes=tuple(self.notes),
                       headlines=headlines(found.studies, missing))

    def _write(self, found: Found, folder: Path) -> dict[str, str]:
        """Result file and the deck as used; returns the checksums of the variables."""
        from lapwing.results import write_results
        from lapwing.studies.of_deck import studies_of

        done = self.report("results", 100, "%")
        text = used_text(self.deck, self.folder)
        if self.whole is not None:
            path, variables = self.whole
            shutil.copyfile(path, folder / RESULT_FILE)
        else:
            variables = write_results(
                folder / RESULT_FILE, deck_name=self.deck.title, deck_text=self.deck.text,
                used_text=text, used_hash=self.inputs, pair=self.deck.gear_pair, te=self.deck.te,
                te_sign=self.deck.operation["te_sign"], found=found.studies,
                te_source=_te_source(self.deck), measured=_measured(self.deck),
                interrupted=found.interrupted, studies=studies_of(self.deck))
        (folder / USED_DECK).write_text(text, encoding="utf-8")
        done(1.0)
        return variables

    def _tell(self, results: Results, folder: Path) -> None:
        """Write the summary; say of measured samples what it warns of."""
        from lapwing.report.measured import warnings

        self.notes += [f"{self.deck.title}: {text.replace('**', '')}"
                       for text in warnings(results.transmission_error.attrs)]
        self._summarise(results, folder)

    def _summarise(self, results: Results, folder: Path, name: str = SUMMARY,
                   drawn: bool = False) -> None:
        """Write the summary; it names the figures asked for, or of these the ones drawn."""
        from lapwing.plots import names_of
        from lapwing.report.summary import summary_text

        figures = [one for one in names_of(results, self.words)
                   if not drawn or (folder / one).exists()]
        (folder / name).write_text(summary_text(results, figures), encoding="utf-8")

    def _forget_lost_figures(self, results: Results, folder: Path) -> None:
        """Name no figure in the summary that is not there; on a full disk it stays as it is."""
        part = folder / f"{SUMMARY}.part"
        with contextlib.suppress(KeyboardInterrupt), held():
            try:
                self._summarise(results, folder, part.name, drawn=True)
                part.replace(folder / SUMMARY)
            except OSError:
                part.unlink(missing_ok=True)

    def _drawn(self, drawing: Drawing | None) -> tuple[dict[str, str], bool]:
        """Wait for the figures; those not drawn, and whether disk or memory is why."""
        from lapwing.plots import FigureError

        if drawing is None:
            return {}, False
        try:
            drawing.finish(self.report("figures", 100, "%"))
        except FigureError as error:
            if error.of_surroundings and self.there.complete:  # which lack nothing: they stay
                probe(drawing.folder)
                raise OSError(errno.EIO, str(error), str(drawing.folder)) from error
            return error.failures, error.of_surroundings
        return {}, False


def _te_source(deck: Deck) -> str | None:
    """Name of the table's file and what was made of it, or None where a formula makes it."""
    from lapwing.report.measured import curve_source

    name = deck.settings["transmission_error"].file
    samples = deck.te_table.samples()
    return curve_source(Path(name).name, deck.curve, samples and samples[0].size) if name else None


def _measured(deck: Deck) -> tuple[dict[str, Any], dict[str, Any]]:
    """What is stored of measured samples: they, their fit, and how much its high orders decide."""
    from lapwing.results.curve import curve_variables
    from lapwing.studies.critical.measured import high_orders_of

    variables, attributes = curve_variables(deck.curve, deck.te_table.samples())
    return variables, {**attributes, **high_orders_of(deck)}
