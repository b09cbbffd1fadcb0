"""Processes that draw figures side by side, each from the result file."""

from __future__ import annotations

import contextlib
import ctypes
import gc
import os
import signal
import stat
import subprocess
import sys
import threading
from collections.abc import Iterator
from importlib import import_module
from multiprocessing import Pipe, reduction
from multiprocessing.connection import Connection, wait
from pathlib import Path
from typing import TYPE_CHECKING, Any

from lapwing.base.registry import STUDIES
from lapwing.base.signals import SIGNALS
from lapwing.plots import style

if TYPE_CHECKING:
    from lapwing.plots import Problem, Task

# More processes than this wait for each other at the disk, and take 100 MB each.
MOST = 8
# Seconds to let a figure that was begun be finished.
PATIENCE = 10.0
# prctl(2): the signal that a process gets when its parent ends.
PR_SET_PDEATHSIG = 1
# What the caller needs as well is loaded before a nursery parts from it.
SHARED = ("netCDF4", "xarray", "lapwing.results")
PRELOAD = ("matplotlib.figure", "matplotlib.backends.backend_agg", "PIL.PngImagePlugin")
PDF = "matplotlib.backends.backend_pdf"
# A fork takes over what these hold of a machine.
NEVER_FORKED = ("mpi4py",)


class DrawingPool:
    """Drawing processes, begun as they are needed; what they need is loaded meanwhile.

    They are born of one process, the nursery, which loads matplotlib once for all of them.  Each
    draws one figure at a time and waits for the next.  Ctrl-C is the caller's matter: they end when
    it closes the pool, or is gone.  Use it in a `with` statement.  Where the system knows no fork,
    the caller draws by itself.

    Parameters
    ----------
    size : int, processes, `MOST` at most; 1: none, the caller draws by itself
    pdf : bool, whether PDFs are drawn
    """

    def __init__(self, size: int, pdf: bool = True) -> None:
        self._size = min(size, MOST) if size > 1 and hasattr(os, "fork") else 0
        self._workers: dict[Connection, _Worker] = {}
        self._busy: dict[Any, Task] = {}
        self._waiting: list[Task] = []
        self._nursery = _Nursery(pdf) if self._size else None

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
        for pipe, worker in self._workers.items():
            pipe.close()
            worker.join(PATIENCE)
        self.stop()

    def stop(self) -> None:
        """End the processes at once; a figure under way is left half written."""
        for pipe, worker in self._workers.items():
            pipe.close()
            worker.kill()
        for worker in self._workers.values():
            worker.join(PATIENCE)
        self._workers.clear()
        if self._nursery is not None:
            self._nursery.close()

    def draw(self, path: Path, tasks: list[Task],
             folder: Path) -> Iterator[tuple[Task, Problem | None]]:
        """Have tasks drawn from a result file: `begin` and `finish`."""
        self.begin(path, tasks, folder)
        yield from self.finish(path, folder)

    def begin(self, path: Path, tasks: list[Task], folder: Path) -> None:
        """Give each process its first task, and wait for none."""
        with contextlib.suppress(OSError):  # without a nursery there are no more
            while self._nursery and len(self._workers) < min(self._size, len(tasks)):
                pipe, worker = self._nursery.worker()
                self._workers[pipe] = worker
        self._busy, self._waiting = {}, list(reversed(tasks))
        for pipe in self._workers:
            self._hand_out(pipe, path, folder)

    def finish(self, path: Path, folder: Path) -> Iterator[tuple[Task, Problem | None]]:
        """Have the rest drawn.

        Yields
        ------
        (Task, Problem or None), as they are finished
        """
        from lapwing.plots import Problem

        while self._busy:
            heard: list[Any] = wait(list(self._busy))
            for pipe in heard:
                task = self._busy.pop(pipe)
                try:
                    problem: Problem | None = pipe.recv()
                    self._hand_out(pipe, path, folder)
                except (EOFError, OSError):
                    problem = Problem(f"the process that drew it {self._dismiss(pipe)}")
                yield task, problem
        yield from ((task, Problem("no process is left to draw it"))
                    for task in reversed(self._waiting))

    def _hand_out(self, pipe: Connection, path: Path, folder: Path) -> None:
        """Give a process the next task, if there is one."""
        if self._waiting:
            self._busy[pipe] = task = self._waiting.pop()
            # One that has died is found at the other end of the pipe.
            with contextlib.suppress(OSError):
                pipe.send((path, task, folder))

    def _dismiss(self, pipe: Connection) -> str:
        """Forget a process that has died; returns how it ended."""
        worker = self._workers.pop(pipe)
        pipe.close()
        code = worker.join(PATIENCE)
        return "ended" if code is None else f"ended with code {code}"


class _Worker:
    """A drawing process, child of the nursery, which keeps its number until it is asked for."""

    def __init__(self, nursery: _Nursery) -> None:
        self._nursery = nursery
        self.number: int | None = None

    @property
    def pid(self) -> int:
        """Its number; 0: there is none, or none any more."""
        if self.number is None:
            self._nursery.call_roll()
        return self.number or 0

    def kill(self) -> None:
        """End it at once."""
        if self.pid:
            with contextlib.suppress(ProcessLookupError):
                os.kill(self.pid, signal.SIGKILL)

    def join(self, patience: float) -> int | None:
        """Wait for its end; its exit code, or None where that does not come in time."""
        code = self._nursery.code_of(self.pid, patience) if self.pid else None
        self.number = self.number if code is None else 0
        return code


class _Nursery:
    """The process of which the drawing ones are born.

    It is forked where this process has one thread only: else locks would be copied that nobody
    opens again, and it is a Python of its own.
    """

    def __init__(self, pdf: bool) -> None:
        self._control, theirs = Pipe()
        self._unborn: list[_Worker] = []
        # Its other end closes with this process, however that ends.
        life, self._alive = os.pipe()
        self._process: subprocess.Popen[bytes] | int
        forks = _may_fork()
        if forks:
            _load(SHARED)
        with _signals_held():
            if forks:
                for stream in sys.stdout, sys.stderr:
                    with contextlib.suppress(OSError, ValueError, AttributeError):
                        stream.flush()
                self._process = os.fork()
                if self._process == 0:
                    try:
                        gc.freeze()  # nothing that the caller holds is ended here
                        _close_all_but(theirs.fileno(), life)
                        _end_with_parent()
                        _bear(theirs, life, pdf)
                    finally:
                        os._exit(1)
            else:
                numbers = theirs.fileno(), life
                self._process = subprocess.Popen(
                    [sys.executable, "-P", "-c", "from lapwing.plots.pool import born; born()",
                     *map(str, numbers), str(int(pdf))], pass_fds=numbers,
                    env={**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path)),
                         "OPENBLAS_NUM_THREADS": "1"})
        theirs.close()
        os.close(life)

    def worker(self) -> tuple[Connection, _Worker]:
        """A drawing process that will be, and the pipe to it.

        Raises
        ------
        OSError
            where there is none to be had.
        """
        with _signals_held():
            ours, theirs = Pipe()
            try:
                self._control.send(None)
                reduction.send_handle(self._control, theirs.fileno(), None)
            finally:
                theirs.close()
            self._unborn.append(_Worker(self))
            return ours, self._unborn[-1]

    def call_roll(self) -> None:
        """Hear the numbers of all processes that were asked for."""
        with _signals_held():
            for worker in self._unborn:
                worker.number = 0
                with contextlib.suppress(OSError, EOFError):
                    worker.number = self._control.recv()
            self._unborn.clear()

    def code_of(self, pid: int, patience: float) -> int | None:
        """Exit code of a process, or None where it does not come in time."""
        with _signals_held(), contextlib.suppress(OSError, EOFError):
            self._control.send(pid)
            if self._control.poll(patience):
                code: int = self._control.recv()
                return code
        return None

    def close(self) -> None:
        """Let it end, and its children with it."""
        if self._control.closed:
            return
        self._control.close()
        os.close(self._alive)
        if isinstance(self._process, int):
            with contextlib.suppress(ChildProcessError):
                os.waitpid(self._process, 0)
        else:
            self._process.wait()


def _may_fork() -> bool:
    """Whether this process has one thread, of Python or not, and nothing else that forbids it."""
    try:
        threads = len(os.listdir("/proc/self/task"))
    except OSError:  # not known
        return False
    return threads == 1 and not any(name in sys.modules for name in NEVER_FORKED)


def _load(names: tuple[str, ...]) -> None:
    """Import modules; no garbage is looked for meanwhile, for there is none."""
    enabled = gc.isenabled()
    gc.disable()
    try:
        for name in names:
            import_module(name)
    finally:
        if enabled:
            gc.enable()


def _close_all_but(*numbers: int) -> None:
    """Close what was inherited: locks of folders, and pipes whose end somebody waits for.

    Not what is only read: of a result file that the caller has open, HDF5 opens no second one.
    """
    import fcntl

    for number in map(int, os.listdir("/proc/self/fd")):
        if number > 2 and number not in numbers:
            with contextlib.suppress(OSError):
                writes = fcntl.fcntl(number, fcntl.F_GETFL) & (os.O_WRONLY | os.O_RDWR)
                if writes or not stat.S_ISREG(os.fstat(number).st_mode):
                    os.close(number)


def _end_with_parent() -> None:
    """End this process with the one it was born of, where Linux can."""
    with contextlib.suppress(OSError, AttributeError):
        ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGKILL)


@contextlib.contextmanager
def _signals_held() -> Iterator[None]:
    """Signals wait; what is begun meanwhile hears of them when it is ready to."""
    before = signal.pthread_sigmask(signal.SIG_BLOCK, SIGNALS)
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def load_drawing(pdf: bool) -> None:
    """Load what drawing takes into a process of Lapwing alone: matplotlib without its help texts.

    Parameters
    ----------
    pdf : bool, whether PDFs are drawn
    """
    # Nothing is shown in a window, whatever a notebook wants.
    os.environ["MPLBACKEND"] = "agg"
    _load((*SHARED, "matplotlib.artist"))
    # The text on every property of every class, a third of the time that matplotlib takes to load.
    vars(sys.modules["matplotlib.artist"])["kwdoc"] = lambda _: ""
    _load((*PRELOAD, *[PDF] * pdf))


def born() -> None:
    """The life of a nursery that is a Python of its own; its numbers are arguments."""
    control, life, pdf = map(int, sys.argv[1:])
    _bear(Connection(control), life, bool(pdf))


def _bear(control: Connection, life: int, pdf: bool) -> None:
    """Load what drawing takes, then fork on demand until the pipe is closed."""
    for signum in SIGNALS:
        signal.signal(signum, signal.SIG_DFL)
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is the caller's matter
    signal.pthread_sigmask(signal.SIG_UNBLOCK, SIGNALS)
    load_drawing(pdf)
    _load(tuple(f"lapwing.plots.{figure}" for study in STUDIES.values()
                for figure in study.few or study.figures))
    style.rehearse()
    gc.collect()
    gc.freeze()
    with contextlib.suppress(EOFError, OSError):
        while True:
            pid = control.recv()
            if pid is None:
                handle = reduction.recv_handle(control)
                pid = os.fork()
                if pid == 0:
                    try:
                        control.close()
                        _draw_on_demand(Connection(handle), life)
                    finally:
                        os._exit(1)
                os.close(handle)
                control.send(pid)
            else:
                control.send(os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1]))
    os._exit(0)


def _draw_on_demand(pipe: Connection, life: int) -> None:
    """Draw what comes through the pipe until it is closed; a process's whole life."""
    _end_with_parent()

    def watch() -> None:  # where Linux does not, and in the middle of a figure
        os.read(life, 1)
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()
    from lapwing.plots import attempt
    from lapwing.results import read_results

    gc.disable()  # between figures, not in the middle of them
    opened = {}
    with contextlib.suppress(EOFError, OSError), contextlib.ExitStack() as stack:
        while True:
            path, task, folder = pipe.recv()
            if path not in opened:
                opened[path] = stack.enter_context(read_results(path, check=False))
            pipe.send(attempt(opened[path], task, folder))
            gc.collect()
    os._exit(0)
