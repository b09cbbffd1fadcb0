"""Processes that draw figures side by side, each from the result file."""

from __future__ import annotations

import contextlib
import ctypes
import multiprocessing
import os
import signal
import sys
import threading
from collections.abc import Iterator
from multiprocessing.connection import wait
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from lapwing.plots import Problem, Task

# More processes than this wait for each other at the disk, and take 100 MB each.
MOST = 8
# Seconds to let a figure that was begun be finished.
PATIENCE = 10.0
# prctl(2): the signal that a process gets when its parent ends.
PR_SET_PDEATHSIG = 1
# The slow part of a process's start, loaded once before they part.
PRELOAD = ("netCDF4", "xarray", "matplotlib.figure", "matplotlib.backends.backend_agg",
           "matplotlib.backends.backend_pdf", "PIL.PngImagePlugin", "lapwing.results")


class DrawingPool:
    """Drawing processes, begun as they are needed; what they need is loaded meanwhile.

    Each draws one figure at a time and waits for the next.  Ctrl-C is the caller's matter: they
    end when it closes the pool, or is gone.  Use it in a `with` statement.

    Parameters
    ----------
    size : int, processes, `MOST` at most; 1: none, the caller draws by itself
    """

    def __init__(self, size: int) -> None:
        self._size = min(size, MOST) if size > 1 else 0
        self._workers: dict[Any, Any] = {}  # pipe -> process
        methods = multiprocessing.get_all_start_methods()
        # Fork by itself would copy the threads' locks of the engine and the display.
        self._method = "forkserver" if "forkserver" in methods else "spawn"
        if self._size and self._method == "forkserver":
            from multiprocessing import forkserver

            forkserver.set_forkserver_preload(list(PRELOAD))
            with _interrupts_held(), _without_windows():
                forkserver.ensure_running()

    def __bool__(self) -> bool:
        return self._size > 0

    def __enter__(self) -> DrawingPool:
        return self

    def __exit__(self, kind: type | None, *_: Any) -> None:
        if kind is None:
            self.close()
        else:
            self.stop()

    def close(self) -> None:
        """Let the processes finish the figures they are at, and end them."""
        for pipe in self._workers:
            pipe.close()
        for process in self._workers.values():
            process.join(PATIENCE)
        self.stop()

    def stop(self) -> None:
        """End the processes at once; a figure under way is left half written."""
        for process in self._workers.values():
            process.kill()
        for process in self._workers.values():
            process.join()
        for pipe in self._workers:
            pipe.close()
        self._workers.clear()

    def draw(self, path: Path, tasks: list[Task],
             folder: Path) -> Iterator[tuple[Task, Problem | None]]:
        """Have tasks drawn from a result file.

        Yields
        ------
        (Task, Problem or None), as they are finished
        """
        from lapwing.plots import Problem

        with _interrupts_held(), _without_windows():
            while len(self._workers) < min(self._size, len(tasks)):
                self._hire()
        waiting = list(reversed(tasks))
        idle = list(self._workers)
        busy: dict[Any, Task] = {}
        while waiting or busy:
            while waiting and idle:
                pipe = idle.pop()
                task = waiting.pop()
                busy[pipe] = task
                # One that has died is found at the other end of the pipe.
                with contextlib.suppress(OSError):
                    pipe.send((path, task, folder))
            if not busy:
                yield from ((task, Problem("no process is left to draw it")) for task in waiting)
                return
            heard: list[Any] = wait(list(busy))
            for pipe in heard:
                try:
                    problem: Problem | None = pipe.recv()
                    idle.append(pipe)
                except (EOFError, OSError):
                    problem = Problem(f"the process that drew it {self._dismiss(pipe)}")
                yield busy.pop(pipe), problem

    def _hire(self) -> None:
        """Start one process."""
        context: Any = multiprocessing.get_context(self._method)
        ours, theirs = context.Pipe()
        process = context.Process(target=_draw_on_demand, args=(theirs,), daemon=True)
        with _main_hidden():
            process.start()
        theirs.close()
        self._workers[ours] = process

    def _dismiss(self, pipe: Any) -> str:
        """Forget a process that has died; returns how it ended."""
        process = self._workers.pop(pipe)
        pipe.close()
        process.join(PATIENCE)
        return f"ended with code {process.exitcode}"


@contextlib.contextmanager
def _without_windows() -> Iterator[None]:
    """Processes begun meanwhile draw without a window system, whatever a notebook wants."""
    before = os.environ.get("MPLBACKEND")
    os.environ["MPLBACKEND"] = "agg"
    try:
        yield
    finally:
        if before is None:
            del os.environ["MPLBACKEND"]
        else:
            os.environ["MPLBACKEND"] = before


def _end_with_parent() -> None:
    """End this process when the one that draws with it is gone, however that ended.

    The pipe that tells of the parent's end works everywhere, also in the middle of a figure; where
    Linux has it, a signal also comes at the end of the fork server, which ends with the parent.
    """
    with contextlib.suppress(OSError, AttributeError):
        ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGKILL)
    process: Any = multiprocessing.parent_process()
    parent = process.sentinel

    def watch() -> None:
        wait([parent])
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


@contextlib.contextmanager
def _main_hidden() -> Iterator[None]:
    """A process begun meanwhile does not run the caller's script, of which it needs nothing."""
    main = sys.modules["__main__"]
    sys.modules["__main__"] = ModuleType("__main__")
    try:
        yield
    finally:
        sys.modules["__main__"] = main


@contextlib.contextmanager
def _interrupts_held() -> Iterator[None]:
    """Signals wait, and what is started meanwhile never hears of Ctrl-C."""
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    from multiprocessing import resource_tracker

    resource_tracker.ensure_running()  # it would lift the mask
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _draw_on_demand(pipe: Any) -> None:
    """Draw what comes through the pipe until it is closed; a process's whole life."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    _end_with_parent()
    from lapwing.plots import attempt
    from lapwing.results import read_results

    opened = {}
    with contextlib.suppress(EOFError, OSError), contextlib.ExitStack() as stack:
        while True:
            path, task, folder = pipe.recv()
            if path not in opened:
                opened[path] = stack.enter_context(read_results(path, check=False))
            pipe.send(attempt(opened[path], task, folder))
