"""The studies of a deck, one after the other, as far as signals and earlier runs let them."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from lapwing.base.registry import STUDIES, carried_out
from lapwing.base.threads import share_of

if TYPE_CHECKING:
    from pathlib import Path

    import xarray as xr

    from lapwing.base.registry import Study
    from lapwing.deck.deck import Asked, Deck


@dataclass
class Found:
    """What a deck's studies gave.

    Attributes
    ----------
    studies : dict of kind -> dict of name -> Dataset, each in deck order
    interrupted : bool, whether a signal stopped them: some are missing, or a sweep is unfinished
    """

    studies: dict[str, dict[str, xr.Dataset]] = field(
        default_factory=lambda: {kind: {} for kind in STUDIES})
    interrupted: bool = False

    def failed(self) -> tuple[str, ...]:
        """Names of the studies with a run that failed numerically."""
        words = [(study.part("study").failed(dataset), name) for study in carried_out()
                 for name, dataset in self.studies[study.kind].items()]
        return tuple(text.format(name) for text, name in words if text)


def is_finished(study: xr.Dataset) -> bool:
    """Whether a stored study lacks nothing: it may be taken over from an earlier run."""
    return not int(study.attrs.get("interrupted", 0))


def studies_of(deck: Deck) -> list[tuple[str, str]]:
    """(kind, name) of every study that a deck asks for, in the order they are carried out."""
    return [(study.kind, asked.name) for study in carried_out()
            for asked in deck.studies[study.kind]]


def compute(deck: Deck, threads: int, report: Callable[..., Any],
            known: dict[tuple[str, str], xr.Dataset] | None = None,
            **keeping: Any) -> Found:
    """Run the studies of a deck.

    1. Kind by kind (`registry.carried_out`), each in deck order: responses side by side, critical
       values and sweeps one after the other.
    2. A signal (KeyboardInterrupt) ends it: what is finished is kept, the finished points of the
       sweep under way as well.

    Parameters
    ----------
    deck : lapwing.deck.Deck
    threads : int
    report : callable(label, total, unit) giving a callable(fraction done)
    known : dict of (kind, name) -> Dataset, finished studies of an earlier run; not run again
    **keeping : for studies that keep shards: `folder`, where each has its own (`shards_of`);
        `notes`, a callable(text), told of what was found there and made again; `executor`, which
        carries them out, or None

    Returns
    -------
    Found
    """
    known, found = known or {}, Found()
    try:
        for study in carried_out():
            if not deck.studies[study.kind]:
                continue
            way = _side_by_side if study.side_by_side else _one_by_one
            if not way(study, deck, threads, report, known, found.studies, keeping):
                found.interrupted = True
                break
    except KeyboardInterrupt:
        found.interrupted = True
    return found


def shards_of(folder: Path, kind: str, name: str) -> Path:
    """Folder of the shards of one study."""
    return folder / f"{kind}_{name}"


def keeps_shards(deck: Deck) -> bool:
    """Whether some study of a deck keeps shards while it is under way."""
    return any(_keeps(study, asked)
               for study in carried_out() for asked in deck.studies[study.kind])


def is_cut(deck: Deck) -> bool:
    """Whether some study of a deck is cut into shards that several processes may share."""
    return any(True for _ in _cut(deck))


def jobs_of(deck: Deck) -> Iterator[tuple[str, str, Any]]:
    """(kind, name, `studies.map.task.Task`) of each study of a deck that is cut into shards."""
    for study, asked in _cut(deck):
        yield study.kind, asked.name, study.part("study").job(deck, asked)


def _cut(deck: Deck) -> Iterator[tuple[Study, Asked]]:
    """Studies that a deck asks for whose shards are known before they begin."""
    for study in carried_out():
        for asked in deck.studies[study.kind]:
            if _keeps(study, asked) and hasattr(study.part("study"), "job"):
                yield study, asked


def _keeps(study: Study, asked: Asked) -> bool:
    """Whether a study that a deck asks for keeps shards while it is under way."""
    keeps = getattr(study.part("study"), "keeps_shards", None)
    return keeps is not None and bool(keeps(asked))


def compute_part(deck: Deck, part: int, parts: int, threads: int, report: Callable[..., Any],
                 folder: Path, notes: Callable[[str], None]) -> tuple[int, int]:
    """Make each `parts`-th shard, from the `part`-th on, of each study that has shards.

    Returns
    -------
    int, int, how many shards were made, and how many lay there
    """
    from lapwing.studies.map.work import make_part

    counts = [make_part(job, shards_of(folder, kind, name), part, parts, threads,
                        report(f"{kind} {name}, part {part} of {parts}", 100, "%"), notes)
              for kind, name, job in jobs_of(deck)]
    return sum(made for made, _ in counts), sum(there for _, there in counts)


def _one_by_one(study: Study, deck: Deck, threads: int, report: Callable[..., Any],
                known: dict[tuple[str, str], xr.Dataset], found: dict[str, dict[str, Any]],
                keeping: dict[str, Any]) -> bool:
    """Add the studies of a kind; returns whether none was stopped."""
    for order, asked in enumerate(deck.studies[study.kind]):
        dataset = known.get((study.kind, asked.name))
        if dataset is None:
            part = study.part("study")
            done = report(f"{study.kind} {asked.name}", *part.extent(asked))
            kept = {**keeping, "folder": shards_of(keeping["folder"], study.kind, asked.name)} \
                if keeping and _keeps(study, asked) else {}
            if getattr(part, "TAKES_FOUND", False):
                kept["found"] = found
            dataset = part.carry_out(deck, asked, order, threads, done, **kept)
        found[study.kind][asked.name] = dataset
        if not is_finished(dataset):
            return False
    return True


def _side_by_side(study: Study, deck: Deck, threads: int, report: Callable[..., Any],
                  known: dict[tuple[str, str], xr.Dataset], found: dict[str, dict[str, Any]],
                  keeping: dict[str, Any]) -> bool:
    """The same, several at a time; of those that keep shards each has its share of the threads."""
    from lapwing.studies.side_by_side import side_by_side

    part = study.part("study")  # loaded by one thread, before there are several
    asked = deck.studies[study.kind]
    orders = [order for order, one in enumerate(asked) if (study.kind, one.name) not in known]
    done = report(f"{study.kind}s", len(orders), f"{study.kind}s")
    parts = dict.fromkeys(orders, 0.0)
    share = max(1, threads // max(1, len(orders)))

    def carried_out(order: int) -> xr.Dataset:
        def told(fraction: float) -> None:
            parts[order] = fraction
            done(sum(parts.values()) / len(parts))

        one = asked[order]
        if not (keeping and _keeps(study, one)):
            dataset: xr.Dataset = part.carry_out(deck, one, order, 1, None)
        else:
            dataset = part.carry_out(
                deck, one, order, share, told,
                **{**keeping, "folder": shards_of(keeping["folder"], study.kind, one.name)})
        told(1.0)
        return dataset

    new, complete = side_by_side(carried_out, orders, share_of(threads), lambda _: None)
    made = {orders[place]: dataset for place, dataset in new.items()}
    for order, one in enumerate(asked):
        dataset = known.get((study.kind, one.name), made.get(order))
        if dataset is not None:
            found[study.kind][one.name] = dataset
    return complete
