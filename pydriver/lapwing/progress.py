"""How far a run is: bars on a terminal, lines in the log of a batch."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import TextIO

PATIENCE = 1.0
# Seconds between two lines of a log.
MINUTE = 60.0


class Lines:
    """Lines in a log: one as soon as something begins, then one a minute.

    Parameters
    ----------
    title : str, the deck's name, which begins each line
    stream : text stream; each line is flushed
    clock : callable giving seconds
    """

    def __init__(self, title: str, stream: TextIO, clock: Callable[[], float] = time.monotonic):
        self._title, self._stream, self._clock = title, stream, clock
        self._last = clock()

    def say(self, text: str) -> None:
        """Write a line."""
        self._last = self._clock()
        print(f"{self._title}: {text}", file=self._stream, flush=True)

    def study(self, label: str, total: int, unit: str) -> Callable[[float], None]:
        """Begin a study of `total` units; returns what is told the fraction done."""
        def report(fraction: float) -> None:
            if self._clock() - self._last >= MINUTE:
                self.say(f"{label}: {100 * fraction:.0f} %" + (
                    f" of {total} {unit}" if unit != "%" else ""))

        return report

    def close(self) -> None:
        """Nothing is left to do."""


class Bars:
    """Bars with rate and time left on standard error; a study shows after `PATIENCE` seconds."""

    def __init__(self):
        self._display = None

    def study(self, label, total, unit):
        """Begin a study of `total` units.

        Returns
        -------
        callable(fraction done)
        """
        begun = time.monotonic()
        task = None

        def report(fraction):
            nonlocal task
            if task is None:
                if fraction >= 1 or time.monotonic() - begun < PATIENCE:
                    return
                task = self._start().add_task(label, total=total, unit=unit)
            self._display.update(task, completed=fraction * total)

        return report

    def close(self):
        """Leave the display."""
        if self._display is not None:
            self._display.stop()
            self._display = None

    def _start(self):
        if self._display is None:
            from rich.console import Console
            from rich.progress import BarColumn, ProgressColumn, TextColumn, TimeRemainingColumn
            from rich.progress import Progress as Display
            from rich.text import Text

            class Rate(ProgressColumn):
                """Units per second."""

                def render(self, task):
                    speed = task.finished_speed or task.speed
                    text = "" if speed is None else f"{speed:.3g} {task.fields['unit']}/s"
                    return Text(text, style="dim")

            self._display = Display(
                TextColumn("{task.description}"), BarColumn(),
                TextColumn("{task.percentage:3.0f} %"), Rate(), TimeRemainingColumn(),
                console=Console(stderr=True))
            self._display.start()
        return self._display
