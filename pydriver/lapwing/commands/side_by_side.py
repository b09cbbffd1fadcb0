"""Decks side by side, each in a process: none waits for another's drawing.

As many are under way as there are threads; they share the threads evenly, and what one leaves goes
to those that are still at work. The numbers are those of one deck after the other.
"""

from __future__ import annotations

import contextlib
import pickle
import queue
import signal
import subprocess
import sys
import threading
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any

from lapwing.base import estimates, exit_codes, signals
from lapwing.base.exit_codes import ExitCode
from lapwing.commands.decks import run_of, studies_in_words
from lapwing.console import complain

if TYPE_CHECKING:
    from lapwing.deck.deck import Deck

# What a deck takes beside the tables that are counted; together no more than there is is begun.
TIMES, BESIDES = 4, 300_000_000
# Seconds between two looks at the signals heard.
LISTEN = 0.1


class Worker:
    """A process that runs decks, one at a time."""

    def __init__(self, answers: queue.SimpleQueue[Any]) -> None:
        with _signals_blocked():
            self.process = subprocess.Popen(
                [sys.executable, "-m", "lapwing.commands.worker"], stdin=subprocess.PIPE,
                stdout=subprocess.PIPE)
        self.deck: Deck | None = None
        self.progress: Any = None
        self._report: Any = None
        threading.Thread(target=self._listen, args=(answers,), daemon=True).start()

    def _listen(self, answers: queue.SimpleQueue[Any]) -> None:
        assert self.process.stdout is not None
        with contextlib.suppress(EOFError, OSError, pickle.UnpicklingError):
            while True:
                answers.put((self, pickle.load(self.process.stdout)))
        answers.put((self, ("gone",)))

    def order(self, *order: Any) -> None:
        """Send an order; a process that has gone is found at the other end."""
        assert self.process.stdin is not None
        with contextlib.suppress(OSError):
            pickle.dump(order, self.process.stdin)
            self.process.stdin.flush()

    def begin(self, deck: Deck, options: dict[str, Any], progress: Any) -> None:
        """Hand over a deck."""
        self.deck, self.progress = deck, progress
        self.order("run", deck, options)

    def tell(self, what: str, *facts: Any) -> None:
        """Pass on how far its deck is."""
        if what == "study":
            self._report = self.progress.study(*facts)
        elif self._report is not None:
            self._report(*facts)

    def end(self) -> None:
        """Let go of the deck."""
        if self.progress is not None:
            self.progress.close()
        self.deck = self.progress = self._report = None

    def close(self) -> None:
        """Let the process end, which has nothing to do."""
        assert self.process.stdin is not None
        with contextlib.suppress(OSError):
            self.process.stdin.close()
        self.process.wait()


@contextlib.contextmanager
def _signals_blocked() -> Iterator[None]:
    """A process that begins meanwhile hears signals when it is ready to."""
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, signals.SIGNALS)
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def run_side_by_side(decks: Sequence[Deck], threads: int, options: dict[str, Any]) -> ExitCode:
    """Run decks, several at a time, and report on each as it ends; the worst exit code.

    Parameters
    ----------
    decks : sequence of Deck
    threads : int, for all of them together
    options : what `commands.decks.run_of` takes besides a deck and its progress
    """
    if len(decks) == 1:  # the others were refused
        from lapwing.progress import begun

        deck = decks[0]
        return run_of(deck, progress=begun(deck.title, studies_in_words(deck)), **options)
    return _Batch(decks, threads, options).carry_out()


class _Batch:
    """Decks that wait, those under way, and what became of the others."""

    def __init__(self, decks: Sequence[Deck], threads: int, options: dict[str, Any]) -> None:
        from lapwing.progress import Together

        self.waiting, self.threads, self.options = list(decks), threads, options
        self.workers: list[Worker] = []
        self.answers: queue.SimpleQueue[Any] = queue.SimpleQueue()
        self.code = ExitCode.GOOD
        self.together = Together()

    def carry_out(self) -> ExitCode:
        """Everything; the worst exit code."""
        try:
            self._hand_out()
            while self._busy():
                self._take()
                self._hand_out()
        except KeyboardInterrupt:
            self._stop()
        finally:
            self.together.close()
            for worker in self.workers:
                worker.close()
        return self.code

    def _busy(self) -> list[Worker]:
        return [worker for worker in self.workers if worker.deck is not None]

    def _hand_out(self) -> None:
        """Begin decks as long as there are threads and memory for more."""
        while self.waiting and len(self._busy()) < self.threads and self._fits(self.waiting[0]):
            idle = [worker for worker in self.workers if worker.deck is None]
            if not idle:
                idle = [Worker(self.answers)]
                self.workers += idle
            deck = self.waiting.pop(0)
            most = min(self.threads, len(self._busy()) + 1 + len(self.waiting))
            idle[0].order("share", max(1, self.threads // most))
            idle[0].begin(deck, self.options,
                          self.together.begun(deck.title, studies_in_words(deck)))
        if not self.waiting:
            busy = self._busy()
            for place, worker in enumerate(busy):
                share, more = divmod(self.threads, len(busy))
                worker.order("share", share + (place < more))

    def _fits(self, deck: Deck) -> bool:
        """Whether there is memory for a deck beside those under way; alone it may try."""
        busy = self._busy()
        available = estimates.available_bytes() if busy else None
        return available is None or _bytes(deck) <= available

    def _take(self) -> None:
        """Take an answer, if there is one soon."""
        try:
            worker, (what, *facts) = self.answers.get(timeout=LISTEN)
        except queue.Empty:
            return
        if what == "ended":
            self._report(worker, *facts)
        elif what != "gone":
            worker.tell(what, *facts)
        else:
            self.workers.remove(worker)
            ended = worker.process.wait()
            if worker.deck is not None:
                complain(f"{worker.deck.title}: its process ended "
                         + (f"by signal {-ended}" if ended < 0 else f"with code {ended}"))
                self.code = max(self.code, ExitCode.SURROUNDINGS)
            worker.end()

    def _report(self, worker: Worker, code: int, said: list[tuple[str, str]]) -> None:
        """Say what a deck's process said of it, as one piece."""
        worker.end()
        with self.together.aside():
            for stream, text in said:
                getattr(sys, stream).write(text)
            sys.stderr.flush()
            sys.stdout.flush()
        self.code = max(self.code, ExitCode(code))

    def _stop(self) -> None:
        """Hand a signal on, and wait for what is being kept."""
        signum = signals.heard() or signal.SIGINT
        self.waiting.clear()
        for worker in self.workers:
            worker.process.send_signal(signum)
        while self._busy():
            self._take()
        self.code = max(self.code, exit_codes.of_signal(signum))


def _bytes(deck: Deck) -> int:
    """Memory that a deck takes, about."""
    most: int = max((needed for _, needed, _ in estimates.deck_bytes(deck)), default=0)
    return TIMES * most + BESIDES
