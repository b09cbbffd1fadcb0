"""A process that runs one deck after another for `side_by_side`.

It is begun as `python -m lapwing.commands.worker`. Orders come through standard
input, answers go through what was standard output, as pickles. When standard input ends, so does
the process: the one that gave the orders has gone.
"""

from __future__ import annotations

import io
import os
import pickle
import queue
import signal
import sys
import threading
import time
from collections.abc import Callable
from typing import Any

from lapwing.base import signals

# Seconds between two reports of how far a study is.
PAUSE = 0.2


class Heard(io.TextIOBase):
    """A stream that keeps what is written, in order with another's."""

    def __init__(self, name: str, said: list[tuple[str, str]]) -> None:
        self._name, self._said = name, said

    def write(self, text: str) -> int:
        """Keep a piece of text."""
        self._said.append((self._name, text))
        return len(text)


class Reports:
    """Progress of a deck as `lapwing.progress` has it, told to another process."""

    def __init__(self, send: Callable[..., None]) -> None:
        self._send = send

    def study(self, label: str, total: int, unit: str) -> Callable[[float], None]:
        """Begin a study; see `progress.Bars.study`."""
        self._send("study", label, total, unit)
        last = [time.monotonic()]

        def report(fraction: float) -> None:
            if time.monotonic() - last[0] >= PAUSE or fraction >= 1:
                last[0] = time.monotonic()
                self._send("fraction", fraction)

        return report

    def close(self) -> None:
        """Nothing: the other process sees the end."""


def main() -> None:
    """Carry out orders until there are none, or a signal comes."""
    answers = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # what a library prints there is no answer
    lock = threading.Lock()

    def send(*answer: Any) -> None:
        with lock:
            pickle.dump(answer, answers)
            answers.flush()

    with signals.listen():
        if hasattr(signal, "pthread_sigmask"):
            signal.pthread_sigmask(signal.SIG_UNBLOCK, signals.SIGNALS)  # blocked until now
        try:
            _carry_out(send)
        except (KeyboardInterrupt, BrokenPipeError):
            pass
        signals.ignore()


def _carry_out(send: Callable[..., None]) -> None:
    from lapwing import executors
    from lapwing.base.threads import share_of, take_share
    from lapwing.commands.decks import run_of
    from lapwing.plots.pool import load_drawing

    executors.hide_dask()

    os.environ["MPLBACKEND"] = "agg"
    orders: queue.SimpleQueue[Any] = queue.SimpleQueue()
    working = threading.Event()

    def listen() -> None:
        while True:
            try:
                order = pickle.load(sys.stdin.buffer)
            except (EOFError, OSError, pickle.UnpicklingError):
                break
            if order[0] == "share":
                take_share(order[1])
            else:
                orders.put(order[1:])
        if working.is_set():
            os.kill(os.getpid(), signal.SIGTERM)
        orders.put(None)

    threading.Thread(target=listen, daemon=True).start()
    while (order := orders.get()) is not None:
        working.set()
        deck, options = order
        if options["figures"] != "none" and share_of(options["threads"]) == 1:  # it draws itself
            load_drawing(options["figures"] == "all")
        said: list[tuple[str, str]] = []
        streams = sys.stdout, sys.stderr
        sys.stdout, sys.stderr = Heard("stdout", said), Heard("stderr", said)
        try:
            code = run_of(deck, progress=Reports(send), **options)
        finally:
            sys.stdout, sys.stderr = streams
        working.clear()
        send("ended", int(code), said)
        if signals.heard() is not None:
            return


if __name__ == "__main__":
    main()
