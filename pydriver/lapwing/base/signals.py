"""Signals that stop a run: one exception, raised once, at a place where nothing is torn apart.

SIGINT (Ctrl-C), SIGTERM and SIGUSR1, by which schedulers end jobs, mean the same here: stop soon
and keep what is finished.
"""

from __future__ import annotations

import _thread
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import partial
from signal import SIG_IGN, Signals, getsignal, raise_signal, signal
from typing import Any

try:
    from signal import pthread_kill as _kill

    pthread_kill: Callable[[int, int], None] | None = _kill
except ImportError:  # pragma: no cover - Windows
    pthread_kill = None

NAMES = ("SIGINT", "SIGTERM", "SIGUSR1")
SIGNALS = tuple(Signals[name] for name in NAMES if name in Signals.__members__)
# Seconds after which a signal that was raised where nothing can be raised comes again.
AGAIN = 0.05


class Stopped(KeyboardInterrupt):
    """A signal asks the run to stop.

    Attributes
    ----------
    signum : int, the signal
    """

    def __init__(self, signum: int) -> None:
        super().__init__(f"stopped by {Signals(signum).name}")
        self.signum = signum


class _Ear:
    """What was heard since the outermost `listen` began; only the main thread changes it."""

    def __init__(self) -> None:
        self.listening = False
        self.holds = 0
        self.signum: int | None = None
        self.raised = False
        self.before: dict[int, Any] = {}

    def hear(self, signum: int, frame: Any = None) -> None:
        """Signal handler: a signal after the first changes nothing."""
        if self.signum is None:
            self.signum = signum
        if importing(frame):
            _later(self.signum)
        else:
            self.raise_if_due()

    def raise_if_due(self) -> None:
        """Raise what was heard, once, unless it is held."""
        if self.signum is not None and not self.holds and not self.raised:
            self.raised = True
            raise Stopped(self.signum)


_ear = _Ear()


@contextmanager
def listen() -> Iterator[None]:
    """Have SIGINT, SIGTERM and SIGUSR1 raise `Stopped` in the main thread, the first one only.

    Once it is raised, further signals are ignored until the block ends: what is written while
    stopping is not stopped again.  A signal that was ignored on entry (a background job, nohup)
    stays ignored; so does one whose handler is not Python's.  Handlers are restored at the end.
    In other threads, and inside of another `listen`, nothing happens.
    """
    if not _in_main_thread() or _ear.listening:
        yield
        return
    _ear.__init__()  # type: ignore[misc]  # the one object that handlers know
    _ear.listening = True
    _ear.holds = 1  # a handler must not raise while only some are in place
    hook = sys.unraisablehook
    try:
        for signum in SIGNALS:
            if getsignal(signum) not in (SIG_IGN, None):
                _ear.before[signum] = signal(signum, _ear.hear)
        sys.unraisablehook = lambda lost: _once_more(lost, hook)
        _ear.holds = 0
        _ear.raise_if_due()
        yield
    finally:
        _ear.holds += 1
        for number, handler in _ear.before.items():
            signal(number, handler)
        sys.unraisablehook = hook
        _ear.listening = False
        if _ear.signum is not None and not _ear.raised:
            raise_signal(_ear.signum)  # heard at the very end: the handlers before may have it


@contextmanager
def held() -> Iterator[None]:
    """Defer signals to the end of the block, where `Stopped` is raised.

    While a run is stopping already, and in other threads, nothing is raised at the end.  Where the
    block itself raises, its exception goes on, and `check` raises what was heard.  Outside of
    `listen` it listens for as long as the block lasts.
    """
    if not _in_main_thread():
        yield
        return
    with listen():
        _ear.holds += 1
        try:
            yield
        except BaseException:
            _ear.holds -= 1
            raise
        _ear.holds -= 1
        _ear.raise_if_due()


def ignore() -> None:
    """From here on no signal stops this process, also after `listen`; for its very end."""
    if _in_main_thread():
        for signum in SIGNALS:
            signal(signum, SIG_IGN)
        _ear.before.clear()


def heard() -> int | None:
    """The signal that was heard since the outermost `listen` began; None outside of any."""
    return _ear.signum if _ear.listening else None


def check() -> None:
    """Raise `Stopped` if a signal was heard, even if it was raised before and got lost."""
    if _ear.listening and _ear.signum is not None and not _ear.holds and _in_main_thread():
        _ear.raised = True
        raise Stopped(_ear.signum)


def _in_main_thread() -> bool:
    return threading.current_thread() is threading.main_thread()


def importing(frame: Any) -> bool:
    """Whether a module is being loaded: an exception would leave it torn for good."""
    while frame is not None:
        if frame.f_code.co_filename.startswith("<frozen importlib"):
            return True
        frame = frame.f_back
    return False


def _later(signum: int) -> None:
    """Let a signal come again."""
    # A real signal where there is one: it also wakes what waits for a lock.
    ident = threading.main_thread().ident
    send: Callable[..., None] = _thread.interrupt_main
    if pthread_kill and ident is not None:
        send = partial(pthread_kill, ident)
    timer = threading.Timer(AGAIN, send, [signum])
    timer.daemon = True
    with suppress(RuntimeError):  # no thread to be had: `check` finds it
        timer.start()


def _once_more(lost: sys.UnraisableHookArgs, hook: Callable[[Any], Any]) -> None:
    """What a destructor or a callback raises goes nowhere: raise it again a little later."""
    if not isinstance(lost.exc_value, Stopped):
        hook(lost)
        return
    _ear.raised = False
    _later(lost.exc_value.signum)
