"""What carries out the shards of a large study where a user names it: MPI, Dask."""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import Executor
from contextlib import contextmanager

EXPECTED = "expected mpi, or dask=ADDRESS of a scheduler"


class NotTheRoot(Exception):
    """Told to a worker whose work is done: it has nothing to say."""


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
        with MPICommExecutor() as executor:
            if executor is not None:
                yield executor
                return
        raise NotTheRoot
    if kind != "dask" or not address:
        raise ValueError(f"--executor {name}: {EXPECTED}")
    with _needed("dask"):
        from distributed import Client
    with Client(address) as client, client.get_executor(pure=False, retries=3) as executor:
        yield executor


@contextmanager
def _needed(extra: str) -> Iterator[None]:
    try:
        yield
    except ImportError as error:
        raise ValueError(f"--executor {extra}: {error}; pip install 'lapwing[{extra}]'") from None
