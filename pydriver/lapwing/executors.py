"""What carries out the shards of a large study where a user names it: MPI, Dask."""

from __future__ import annotations

import math
import sys
import time
from collections import Counter
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, Future
from contextlib import contextmanager
from typing import Any

from lapwing.base.threads import asked_threads, fair_share, processors, take_share

# Seconds for which the number of Dask's workers is taken to be what it was.
STALE = 5.0
EXPECTED = "expected mpi, or dask=ADDRESS of a scheduler"


class NotTheRoot(Exception):
    """Told to a worker whose work is done: it has nothing to say."""


def hide_dask() -> None:
    """Have this process not find Dask, which xarray loads wherever it is: half a second."""
    modules: Any = sys.modules
    modules.setdefault("dask", None)


def show_dask() -> None:
    """Have it found again."""
    if sys.modules.get("dask", sys) is None:
        del sys.modules["dask"]


@contextmanager
def opened(name: str | None) -> Iterator[Executor | None]:
    """The executor of a name; None where there is none.

    Parameters
    ----------
    name : 'mpi', in each of the processes of `mpiexec`; 'dask=tcp://host:port'; or None

    Raises
    ------
    ValueError
        for another name, or where the package is not installed.
    NotTheRoot
        in all processes of `mpiexec` but one, when the work of that one is done.
    OSError
        where there is no such scheduler.
    """
    if name is None:
        yield None
        return
    kind, _, address = name.partition("=")
    if name == "mpi":
        with _needed("mpi"):
            from mpi4py.futures import MPICommExecutor
        _share_node()
        with MPICommExecutor() as executor:
            if executor is not None:
                yield executor
                return
        raise NotTheRoot
    if kind != "dask" or not address:
        raise ValueError(f"--executor {name}: {EXPECTED}")
    with _needed("dask"):
        show_dask()
        from distributed import Client
    with Client(address) as client, client.get_executor(pure=False, retries=3) as executor:
        yield _Shared(client, executor)


def _share_node() -> None:
    """Let each rank of MPI take its share of the node it is on; the first one only hands out."""
    from mpi4py import MPI

    rank, ranks = MPI.COMM_WORLD.Get_rank(), MPI.COMM_WORLD.Get_size()
    works = rank > 0 or ranks == 1
    node = MPI.COMM_WORLD.Split_type(MPI.COMM_TYPE_SHARED)
    of_all = node.allgather(sorted(processors()) if works else [])
    node.Free()
    if works and ranks > 1:
        take_share(asked_threads() or fair_share(processors(), of_all))


class _Shared(Executor):
    """An executor of Dask whose workers know how many work on their node.

    Parameters
    ----------
    client : distributed.Client
    executor : its `get_executor`
    """

    def __init__(self, client: Any, executor: Executor) -> None:
        self._client, self._executor = client, executor
        self._slots: dict[str, int] = {}
        self._asked = -math.inf

    def submit(self, function: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        """Hand out a call; see `concurrent.futures.Executor`."""
        if time.monotonic() - self._asked > STALE:
            slots: Counter[str] = Counter()
            for address, threads in self._client.nthreads().items():
                slots[_host(address)] += threads
            self._slots, self._asked = dict(slots), time.monotonic()
        return self._executor.submit(_on_node, self._slots, function, *args, **kwargs)


def _on_node(slots: dict[str, int], function: Callable[..., Any], *args: Any,
             **kwargs: Any) -> Any:
    """A call in a worker of Dask, which shares its node with others.

    Parameters
    ----------
    slots : host -> calls that its workers carry out at a time
    function, *args, **kwargs : the call
    """
    from distributed import get_worker

    here = slots.get(_host(get_worker().address), 0)
    take_share(asked_threads() or max(1, len(processors()) // max(1, here)))
    return function(*args, **kwargs)


def _host(address: str) -> str:
    """The host in an address such as tcp://host:port."""
    return address.rpartition("://")[2].rpartition(":")[0]


@contextmanager
def _needed(extra: str) -> Iterator[None]:
    try:
        yield
    except ImportError as error:
        raise ValueError(f"--executor {extra}: {error}; pip install 'lapwing[{extra}]'") from None
