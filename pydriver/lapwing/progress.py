"""A progress display for studies that take longer than a second."""

from __future__ import annotations

import time

PATIENCE = 1.0


class Progress:
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
