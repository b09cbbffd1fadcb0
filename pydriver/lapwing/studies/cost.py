"""How long the studies of a deck take on this machine: an estimate from a few of their points.

`stated` begins a process that tries points for `SECONDS` and is ended soon after, whatever it does:
a single point may take hours, or all memory, and the engine is not loaded here. Its processor time
counts, which is the time that passes where nothing else runs.
"""

from __future__ import annotations

import json
import math
import pickle
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import TYPE_CHECKING, Any, NamedTuple

from numpy.typing import NDArray

from lapwing.base.registry import carried_out

if TYPE_CHECKING:
    from lapwing.deck.deck import Asked, Deck

# Processor time for trying points, all decks together; the process ends after so many times as
# much, and after `LIMIT` seconds on the clock, most of which a busy machine takes to begin it.
SECONDS, PATIENCE, LIMIT = 1.2, 2.0, 15.0
# A response is tried with this part of its cycles first, then with `FASTER` times as many.
FIRST_PART, FASTER = 64, 4
# Points of a sweep are taken so many at once that a batch takes this part of the time there is.
BATCH = 1 / 6
UNTRIED = "no trial of it ended in time"
# Units of time, s.
UNITS = ((1.0, "s"), (60.0, "min"), (3600.0, "h"), (86400.0, "days"), (31557600.0, "years"))


class Stage(NamedTuple):
    """One part of a deck's work.

    Attributes
    ----------
    name : str
    low, high : float, s, the ends of the estimate; NaN where nothing is known
    part : float, how much of it was tried
    why : str, why nothing is known
    """

    name: str
    low: float = math.nan
    high: float = math.nan
    part: float = 0.0
    why: str = ""


def stated(decks: list[Deck], threads: int, seconds: float = SECONDS,
           limit: float = LIMIT) -> list[str]:
    """What `check` says of the time that each deck takes.

    Parameters
    ----------
    decks : sequence of lapwing.deck.Deck
    threads : int, with which they are to be run
    seconds, limit : float, of processor time, and on the clock; all decks together

    Returns
    -------
    list of str
    """
    found = [{name: Stage(name, why=UNTRIED) for name in names_of(deck)} for deck in decks]
    for order, *stage in _answers((tuple(decks), threads, seconds, limit), limit) if decks else ():
        found[order][stage[0]] = Stage(*stage)
    return [words(list(stages.values()), threads) for stages in found]


def names_of(deck: Deck) -> list[str]:
    """Names of a deck's stages, in the order they are carried out."""
    names = []
    for study in carried_out():
        asked = deck.studies.get(study.kind, ())
        if study.side_by_side:
            names += [f"the {study.kind}{'s' * (len(asked) > 1)}"] * bool(asked)
        else:
            names += [f"{study.kind} {one.name!r}" for one in asked]
    return names


def changed(asked: Asked, **values: Any) -> Asked:
    """A study asked for, with other values."""
    return replace(asked, resolved=asked.resolved | values)


def words(stages: list[Stage], threads: int) -> str:
    """The estimate of one deck in words.

    Parameters
    ----------
    stages : list of Stage
    threads : int
    """
    known = [stage for stage in stages if not math.isnan(stage.low + stage.high)]
    unknown = ", ".join(f"{stage.name} ({stage.why})" for stage in stages if stage not in known)
    if not stages:
        return "computing time: none, there are no studies"
    if not known:
        return f"computing time: not known: {unknown}"
    low, high = (math.fsum(getattr(stage, end) for stage in known) for end in ("low", "high"))
    basis = ", ".join(f"{spell_part(stage.part)} of {stage.name}" for stage in known)
    return (f"computing time: about {spell((low + high) / 2)}"
            + f" (from {spell(low)} to {spell(high)})" * (spell(low) != spell(high))
            + f", estimated for this machine without other work and {threads} "
            f"thread{'s' * (threads != 1)}, by trying {basis}; start and figures come on top"
            + f"; not counted, for it is not known: {unknown}" * bool(unknown))


def spell(seconds: float) -> str:
    """A time in words, two digits: `0.042 s`, `3.5 min`; below a millisecond there is none."""
    if seconds < 0.001:
        return "0 s"
    size, unit = next((pair for pair in reversed(UNITS) if seconds >= 1.995 * pair[0]), UNITS[0])
    return f"{float(f'{seconds / size:.2g}'):.10g} {unit}"


def spell_part(part: float) -> str:
    """A part in words: `all`, `3.1 %`; less than all is at most `99 %`."""
    return "all" if part == 1 else f"{min(99.0, 100 * part):.2g} %"


def stages_of(deck: Deck, threads: int, seconds: float,
              clock: Any = time.process_time) -> Iterator[Any]:
    """Estimate the stages of a deck, one after the other, as they are carried out.

    1. Each study gets an equal part of the time that is left, and estimates itself
       (`registry`).
    2. Of a response a small part of its cycles, then more of them. Between the line through the
       last two times and what is in proportion to the last.
    3. Of a sweep or a search for back impacts values spread over all, in batches. Between the
       rates of the fastest and of the slowest batch.
    4. Of a search for rattling one value; how many it tries is known by the run alone.
    5. Threads share motions, but neither cut one nor what is carried from value to value.

    Parameters
    ----------
    deck : lapwing.deck.Deck
    threads : int, with which the deck is to be run; here there is one
    seconds : float
    clock : callable() giving seconds

    Yields
    ------
    Stage
    """
    end, names = clock() + seconds, names_of(deck)
    left = sum(map(len, deck.studies.values()))
    for study in carried_out():
        alone = []
        for one in deck.studies.get(study.kind, ()):
            name = names[0] if study.side_by_side else names.pop(0)
            alone.append(_guarded(study.part("study").estimate, name, deck, one,
                                  (end - clock()) / left, clock, threads))
            left -= 1
            if not study.side_by_side:
                yield alone.pop()
        if alone:
            yield _together(names.pop(0), alone, threads)


def _guarded(estimate: Callable[..., Any], name: str, deck: Deck, asked: Asked, seconds: float,
             clock: Any, threads: int) -> Any:
    """The stage that a study's `estimate` finds, or why there is none."""
    if seconds <= 0:
        return Stage(name, why=UNTRIED)
    try:
        return Stage(name, *estimate(deck, asked, seconds, clock, threads))
    except (ValueError, ArithmeticError, MemoryError, RuntimeError, OSError):
        # The run says what is wrong, with all there is to say of it.
        return Stage(name, why="a trial failed")


def _together(name: str, stages: list[Any], threads: int) -> Any:
    """Studies computed side by side."""
    lacking = next((stage.why for stage in stages if stage.why), "")
    if lacking:
        return Stage(name, why=lacking)
    low, high = (shared([getattr(stage, end) for stage in stages], threads)
                 for end in ("low", "high"))
    return Stage(name, low, high, min(stage.part for stage in stages))


def shared(times: list[float], threads: int) -> float:
    """Time that parts take side by side: none is cut."""
    return max(math.fsum(times) / threads, *times)


def growth(tried: Callable[..., Any], settle: int, record: int, seconds: float,
           clock: Any) -> tuple[float, float, float]:
    """Estimate of work that grows with its cycles, from a few of them.

    Parameters
    ----------
    tried : callable(settle, record), which does so much of it
    settle, record : int, mesh cycles of the whole
    seconds : float
    clock : callable() giving seconds

    Returns
    -------
    low, high : float, s
    part : float, how much of it was tried last
    """
    end = clock() + seconds
    tried(0, 1)  # loads what it needs
    whole, divisor = settle + record, FIRST_PART
    times: list[tuple[int, float]] = []
    while True:
        some, begun = (-(-settle // divisor), -(-record // divisor)), clock()
        tried(*some)
        times.append((sum(some), clock() - begun))
        if divisor == 1:
            return times[-1][1], times[-1][1], 1.0
        if clock() + FASTER * times[-1][1] > end:
            break
        divisor //= FASTER
    cycles, last = times[-1]
    high = low = last * whole / cycles
    if len(times) > 1:
        before, first = times[-2]
        low = last + max(0.0, last - first) * (whole - cycles) / max(1, cycles - before)
    return min(low, high), max(low, high), cycles / whole


def rates(tried: Callable[..., Any], values: NDArray[Any], seconds: float,
          clock: Any) -> tuple[float, float, int]:
    """Seconds per value of the fastest and of the slowest batch, and how many were tried.

    `tried` is a callable(values). Batches grow until one takes a sixth of the time; those much
    smaller than the last do not count, for they show what a call costs.
    """
    end, order, taken, size, batches = clock() + seconds, spread(len(values)), 0, 1, []
    tried(values[order[:1]])  # loads what it needs
    while taken < len(order):
        part = values[sorted(order[taken:taken + size])]
        begun = clock()
        tried(part)
        now = clock()
        taken += len(part)
        batches.append((len(part), (now - begun) / len(part)))
        if now - begun < BATCH * seconds:
            size *= 2
        if now + size * batches[-1][1] > end:
            break
    counted = [rate for many, rate in batches if 4 * many > batches[-1][0]]
    return min(counted), max(counted), taken


def spread(count: int) -> list[int]:
    """Places 0 … count - 1 in an order of which every beginning is spread evenly (bits turned)."""
    bits = max(1, (count - 1).bit_length())
    turned = (int(f"{place:0{bits}b}"[::-1], 2) for place in range(1 << bits))
    return [place for place in turned if place < count]


def _answers(task: tuple[Any, int, float, float], limit: float) -> list[list[Any]]:
    """What the process says: lists [deck, fields of a Stage …], as many as there was time for."""
    command = [sys.executable, "-P", "-m", __name__]
    try:
        said = subprocess.run(command, input=pickle.dumps(task), stdout=subprocess.PIPE,
                              stderr=subprocess.DEVNULL, timeout=limit + 1, check=False).stdout
    except subprocess.TimeoutExpired as late:
        said = late.stdout or b""
    except OSError:  # no process to be had
        return []
    return [json.loads(line) for line in said.split(b"\n")[:-1]]


def main() -> None:
    """Read a pickled task, print each stage as a line of JSON, and end in time."""
    decks, threads, seconds, limit = pickle.load(sys.stdin.buffer)
    if hasattr(signal, "setitimer"):
        # Its default is the end of the process, also within the engine.
        signal.signal(signal.SIGALRM, signal.SIG_DFL)
        signal.setitimer(signal.ITIMER_REAL, limit)
    _load()
    if hasattr(signal, "setitimer"):
        signal.setitimer(signal.ITIMER_PROF, PATIENCE * seconds)
    end = time.process_time() + seconds
    for order, deck in enumerate(decks):
        deck.te  # noqa: B018 - built at the first use
        share = (end - time.process_time()) / (len(decks) - order)
        for stage in stages_of(deck, threads, share):
            print(json.dumps([order, *stage]), flush=True)


def _load() -> None:
    """Load what studies load at their first use: it is no part of their time."""
    import scipy.interpolate  # noqa: F401
    import xarray  # noqa: F401

    for study in carried_out():
        study.part("study")


if __name__ == "__main__":
    main()
