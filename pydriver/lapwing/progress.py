"""How far a run is: bars on a terminal, lines in the log of a batch.

A thread looks at the clock, so that a study which tells nothing for long is spoken of all the same.
"""

from __future__ import annotations

import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from typing import Any, TextIO

from lapwing.base import arguments

PATIENCE = 1.0
# Seconds between two lines of a log.
MINUTE = 60.0


@dataclass
class _Study:
    """A study under way: its total in units, when it began, the fraction done, its bar if any."""

    label: str
    total: int
    unit: str
    begun: float
    fraction: float = 0.0
    task: int | None = None


class _Teller:
    """What knows the study under way, and looks at it every `PATIENCE` seconds until closed."""

    def __init__(self, clock: Callable[[], float]) -> None:
        self._clock = clock
        self._study: _Study | None = None
        self._lock = threading.RLock()
        self._closed = threading.Event()
        self._watch: threading.Thread | None = None

    def study(self, label: str, total: int, unit: str) -> Callable[[float], None]:
        """Begin a study of `total` units, the one before being done.

        Returns
        -------
        callable(fraction done), which any thread may call
        """
        with self._lock:
            self._ended()
            study = self._study = _Study(label, total, unit, self._clock())
            if self._watch is None:
                self._watch = threading.Thread(target=self._keep_looking, daemon=True)
                with suppress(RuntimeError):  # no thread to be had: what is reported is told
                    self._watch.start()

        def report(fraction: float) -> None:
            with self._lock:
                study.fraction = fraction
                self.look()

        return report

    def close(self) -> None:
        """Tell nothing any more."""
        with self._lock:
            self._closed.set()

    def look(self) -> None:
        """Tell of the study under way, if it is time."""
        with self._lock:
            if self._study is not None and not self._closed.is_set():
                self._tell(self._study)

    def _keep_looking(self) -> None:
        # What the surroundings refuse (memory, a thread for the display) ends the telling alone.
        with suppress(OSError, MemoryError, RuntimeError):
            while not self._closed.wait(PATIENCE):
                self.look()

    def _ended(self) -> None:
        """The study under way is done."""

    def _tell(self, study: Any) -> None:
        raise NotImplementedError


class Lines(_Teller):
    """Lines in a log: one as soon as something begins, then one a minute.

    Parameters
    ----------
    title : str, the deck's name, which begins each line
    stream : text stream; each line is flushed
    clock : callable giving seconds
    """

    def __init__(self, title: str, stream: TextIO,
                 clock: Callable[[], float] = time.monotonic) -> None:
        super().__init__(clock)
        self._title, self._stream = title, stream
        self._last = clock()

    def say(self, text: str) -> None:
        """Write a line."""
        with self._lock:
            self._last = self._clock()
            self._stream.write(f"{self._title}: {text}\n")
            self._stream.flush()

    def _tell(self, study: _Study) -> None:
        if self._clock() - self._last >= MINUTE:
            self.say(f"{study.label}: {100 * study.fraction:.0f} %" + (
                f" of {study.total} {study.unit}" if study.unit != "%" else ""))


class Bars(_Teller):
    """Bars with rate and time left on standard error; a study shows after `PATIENCE` seconds."""

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        super().__init__(clock)
        self._display: Any = None

    def close(self) -> None:
        """Leave the display."""
        with self._lock:
            super().close()
            if self._display is not None:
                self._display.stop()
                self._display = None

    def _ended(self) -> None:
        if self._study is not None and self._study.task is not None:
            self._display.update(self._study.task, completed=self._study.total)

    def _tell(self, study: _Study) -> None:
        if study.task is None:
            if study.fraction >= 1 or self._clock() - study.begun < PATIENCE:
                return
            study.task = self._start().add_task(study.label, total=study.total, unit=study.unit)
        self._display.update(study.task, completed=study.fraction * study.total)

    def _start(self) -> Any:
        if self._display is None:
            self._display = _display()
            self._display.start()
        return self._display


def _display() -> Any:
    """Bars of rich on standard error, not yet shown."""
    from rich import progress
    from rich.console import Console
    from rich.text import Text

    class Rate(progress.ProgressColumn):
        """Units per second."""

        def render(self, task: Any) -> Any:
            speed = task.finished_speed or task.speed
            text = "" if speed is None else f"{speed:.3g} {task.fields['unit']}/s"
            return Text(text, style="dim")

    return progress.Progress(
        progress.TextColumn("{task.description}"), progress.BarColumn(),
        progress.TextColumn("{task.percentage:3.0f} %"), Rate(),
        progress.TimeElapsedColumn(), progress.TimeRemainingColumn(),
        console=Console(stderr=True))


class Together:
    """Decks side by side: a bar for each that is under way, or the lines of each."""

    def __init__(self) -> None:
        self._display = _display() if sys.stderr.isatty() else None
        if self._display is not None:
            self._display.start()

    def begun(self, title: str, what: str) -> Any:
        """What tells how far one of them is, until it is closed."""
        return begun(title, what) if self._display is None else DeckBar(title, self._display)

    @contextmanager
    def aside(self) -> Iterator[None]:
        """Let something be written where the bars are."""
        if self._display is None:
            yield
            return
        self._display.stop()
        try:
            yield
        finally:
            self._display.start()

    def close(self) -> None:
        """Leave the display."""
        if self._display is not None:
            self._display.stop()


class DeckBar:
    """The bar of one deck among others."""

    def __init__(self, title: str, display: Any) -> None:
        self._title, self._display = title, display
        self._task = display.add_task(title, total=1, unit="")

    def study(self, label: str, total: int, unit: str) -> Callable[[float], None]:
        """Begin a study; see `Bars.study`."""
        self._display.reset(self._task, total=total, unit=unit,
                            description=f"{self._title}: {label}")
        return lambda fraction: self._display.update(self._task, completed=fraction * total)

    def close(self) -> None:
        """Let the bar go."""
        self._display.remove_task(self._task)


def begun(title: object, what: str) -> Bars | Lines:
    """What tells how far a deck is: bars on a terminal, else a line at once and one a minute."""
    if sys.stderr.isatty():
        return Bars()
    progress = Lines(str(title), sys.stderr)
    progress.say(f"started; {what}")
    return progress


@contextmanager
@arguments.complete()
def progress_bar(label: str = "", total: int = 100, unit: str = "%") -> Iterator[
        Callable[[float], None]]:
    """A bar in a terminal or a notebook for what takes long in Python.

    ``with lapwing.progress_bar("torques") as done: lapwing.sweep(..., progress=done)``

    Parameters
    ----------
    label : str, before the bar
    total : int, units that are the whole
    unit : str

    Yields
    ------
    callable(fraction done), as `progress=` of sweeps and searches takes it
    """
    bars = Bars()
    try:
        yield bars.study(label, total, unit)
    finally:
        bars.close()
