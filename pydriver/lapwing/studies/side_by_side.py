"""Calls side by side in threads, stopped together by a signal."""

from __future__ import annotations

import ctypes
import sys
import threading
import time
from collections.abc import Callable
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from typing import Any

from lapwing.base.signals import importing

# Seconds between two looks at the signals heard, and at whether a module is still being loaded.
LISTEN, LOADING = 0.1, 0.01


def side_by_side(function: Callable[..., Any], items: Any, threads: int,
                 done: Callable[..., Any]) -> tuple[dict[int, Any], bool]:
    """Call a function of each item, several at a time.

    The engine works without Python's lock and keeps nothing between calls, so that threads do.

    Parameters
    ----------
    function : callable(item)
    items : sequence
    threads : int
    done : callable(fraction done)

    Returns
    -------
    results : dict of place in `items` -> what the function returned
    complete : bool, False after Ctrl-C, which keeps what is finished

    Raises
    ------
    Exception
        the first that a call raised; the others are given up.
    """
    results: dict[int, Any] = {}
    running: set[int] = set()
    lock, begin, given_up = threading.Lock(), threading.Event(), threading.Event()

    def call(place: int) -> Any:
        # Not before all are handed out: an interruption amid that would leave a thread at work of
        # which nobody knows.
        begin.wait()
        with lock:
            if given_up.is_set():
                raise KeyboardInterrupt
            running.add(threading.get_ident())
        try:
            return function(items[place])
        finally:
            with lock:
                running.discard(threading.get_ident())

    complete = False
    with ThreadPoolExecutor(max(1, min(threads, len(items)))) as pool:
        places: dict[Future[Any], int] = {}
        try:
            for place in range(len(items)):
                places[pool.submit(call, place)] = place
            begin.set()
            waiting = set(places)
            while waiting:
                # Not for ever: a signal that another thread hears wakes no one.
                ended, waiting = wait(waiting, LISTEN, FIRST_COMPLETED)
                for future in ended:
                    results[places[future]] = future.result()
                    done(len(results) / len(items))
            complete = True
        except KeyboardInterrupt:
            pass
        finally:
            if not complete:
                pool.shutdown(wait=False, cancel_futures=True)
                with lock:
                    given_up.set()
                    for ident in running:
                        _interrupt(ident)
                begin.set()
    for future in places:
        if not future.cancelled() and future.exception() is None:
            results[places[future]] = future.result()
    return results, complete


def _interrupt(ident: int) -> None:
    """Hand Ctrl-C, which only the main thread hears, on to another thread."""
    # A module that is torn while it is loaded stays torn for the whole process.
    while importing(sys._current_frames().get(ident)):
        time.sleep(LOADING)
    ctypes.pythonapi.PyThreadState_SetAsyncExc(ctypes.c_ulong(ident),
                                               ctypes.py_object(KeyboardInterrupt))
