"""Calls side by side in threads, stopped together by a signal."""

from __future__ import annotations

import ctypes
import threading
from collections.abc import Callable
from queue import Empty, SimpleQueue
from typing import Any


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
    waiting: SimpleQueue[Any] = SimpleQueue()
    results: dict[int, Any] = {}
    errors: list[BaseException] = []
    stop, lock = threading.Event(), threading.Lock()
    for place in range(len(items)):
        waiting.put(place)

    def work() -> None:
        while not stop.is_set():
            try:
                place = waiting.get_nowait()
            except Empty:
                return
            result = function(items[place])
            with lock:
                results[place] = result
                done(len(results) / len(items))

    def help_out() -> None:
        try:
            work()
        except KeyboardInterrupt:
            pass  # handed on
        except Exception as error:
            errors.append(error)
            stop.set()

    helpers = [threading.Thread(target=help_out) for _ in range(min(threads, len(items)) - 1)]
    try:
        for helper in helpers:
            helper.start()
        work()
        for helper in helpers:
            helper.join()
    except BaseException as error:
        stop.set()
        for helper in helpers:
            _interrupt(helper)
        if not isinstance(error, KeyboardInterrupt):
            raise
        return results, False
    if errors:
        raise errors[0]
    return results, True


def _interrupt(thread: Any) -> None:
    """Hand Ctrl-C, which only the main thread hears, on to another, and wait for its end."""
    if thread.is_alive():
        ctypes.pythonapi.PyThreadState_SetAsyncExc(ctypes.c_ulong(thread.ident),
                                                   ctypes.py_object(KeyboardInterrupt))
        thread.join()
