"""The shards of a map or an ensemble as one Dataset that reads them when asked for numbers."""

from __future__ import annotations

import math
import os
from collections import OrderedDict
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from lapwing.base import arguments
from lapwing.base.codes import Status
from lapwing.base.quantities import worded
from lapwing.results.checksums import DamagedFile
from lapwing.results.shards import (
    Shard,
    read_column,
    read_shard,
    read_study,
    shard_path,
    shards_in,
)
from lapwing.results.variables import IN_PARTS
from lapwing.studies.map.cut import Cut
from lapwing.studies.map.observed import RATES, kept, rate_of

if TYPE_CHECKING:
    import xarray as xr

# Shards whose numbers stay in memory, and runs that are looked up at once.
HELD, AT_ONCE = 8, 2**18


@arguments.complete()
def open_study(folder: str | os.PathLike[str]) -> xr.Dataset:
    """Open the shards of a map or an ensemble, finished or not, as a Dataset read when it is used.

    Nothing is put together and no file stays open: a million runs or a thousand million are opened
    in the same time. What is asked for is read from the shards it lies in, each checked by its
    content first; `load()` reads all, `chunk()` hands it to Dask.

    Parameters
    ----------
    folder : str or path, `results/<deck>.shards/map_<name>` or `ensemble_<name>`, or the `folder`
        of `parameter_map` or `ensemble`

    Returns
    -------
    xarray.Dataset
        as of `parameter_map`; of an ensemble, over `run`, what is known of each run: values drawn,
        numbers of a map, full_engagement; runs for sensitivities are the last ones. Runs of shards
        that are not there have status UNFINISHED. Attribute `missing_shards` is how many were not
        there when it was opened

    Raises
    ------
    TypeError
        where `folder` is no path.
    OSError
        where it holds no study.
    lapwing.results.DamagedFile
        (a ValueError) where a file is damaged or of something else, of a shard when it is read:
        the command that made it makes it again.
    """
    import xarray as xr

    place = Path(arguments.path("folder", folder))
    axes, attrs = read_study(place)
    kind, dims = attrs.get("kind"), tuple(axes)
    if kind not in ("map", "ensemble"):
        raise DamagedFile(f"{place} holds no shards of a map or an ensemble")
    if kind == "ensemble":  # values of each run, not of axes that cross
        dims = ("run",)
        coordinates: dict[str, Any] = {name: (dims, values) for name, values in axes.items()}
        axes = {"run": next(iter(axes.values()))}
    else:
        coordinates = dict(axes)
    store = _Store(place, attrs, axes)
    variables = {name: store.variable(name, dims) for name in (*store.kept, *RATES)}
    missing = store.shards - len([i for i in shards_in(place) if i < store.shards])
    said = {name: value for name, value in attrs.items() if name not in _OF_THE_FILE}
    if kind == "map" and len(axes) == 2:  # what it can be drawn over
        said |= dict(zip(("x_parameter", "y_parameter"), axes, strict=True))
    return worded(xr.Dataset(variables, coordinates, {
        **said, "shards": store.shards, "missing_shards": missing,
        "interrupted": int(missing > 0)}))


_OF_THE_FILE = ("Conventions", "title", "shard_format", "checksums", "order", "kind", "inputs",
                "besides")


def left_in(folder: Path, status: NDArray[Any],
            least: dict[str, float]) -> dict[str, xr.Variable]:
    """Variables of a map whose shards lie in a folder, read from there when they are used.

    Parameters
    ----------
    folder : Path, of shards that were found good; they are not checked again
    status : array (runs,) of `Status`, in the order of the runs; UNFINISHED: there is no shard
    least : variable of a shard -> its least number

    Returns
    -------
    dict of name -> Variable over the axes, marked to be written in parts
    """
    axes, attrs = read_study(folder)
    store = _Checked(folder, attrs, axes, status)
    found = {name: store.variable(name, tuple(axes)) for name in (*store.kept, *RATES)}
    for name, one in found.items():
        one.encoding[IN_PARTS] = least.get(name, 0)
    return found


class _Store:
    """Numbers by run, from whatever shards they lie in."""

    def __init__(self, folder: Path, attrs: dict[str, Any], axes: dict[str, NDArray[Any]]) -> None:
        self.folder = folder
        self.shape = tuple(map(len, axes.values()))
        self._inputs, self._engine = attrs["inputs"], attrs["engine_sha256"]
        self.record = int(attrs["record"])
        self.kept = kept(str(attrs.get("observe", "")).split()) | dict.fromkeys(
            str(attrs.get("besides", "")).split(), float)
        self._cut = Cut(math.prod(map(len, axes.values())), int(attrs["shard_runs"]),
                        len(axes[attrs["line"]]), attrs["start"])
        self.shards = self._cut.shards
        self._held: OrderedDict[int, Shard] = OrderedDict()
        # How far apart neighbours along each axis are, in runs.
        steps, step = {}, 1
        for name in reversed(str(attrs["order"]).split()):
            steps[name] = step
            step *= len(axes[name])
        self.steps = tuple(steps[name] for name in axes)

    def variable(self, name: str, dims: tuple[str, ...]) -> xr.Variable:
        """One that is read when it is used."""
        import xarray as xr

        return xr.Variable(dims, _lazy(_Numbers(self, name, self.shape)))

    def numbers(self, name: str, runs: NDArray[np.int64]) -> NDArray[Any]:
        """A variable of some runs, an array of their shape."""
        if name in RATES:
            return rate_of(name, lambda one: self.numbers(one, runs), self.record)
        found = np.full(runs.shape, np.nan if self.kept[name] is float else 0,
                        dtype=self.kept[name])
        if name == "status":
            found[...] = Status.UNFINISHED
        of_shard = self._cut.shard_of(runs)
        for index in np.unique(of_shard):
            column = self._column(int(index), name)
            if column is not None:
                here = of_shard == index
                found[here] = column[runs[here] - self._cut.place(int(index))[0]]
        return found

    def _column(self, index: int, name: str) -> NDArray[Any] | None:
        """A variable of a shard; None where there is no such shard."""
        shard = self._shard(index)
        return None if shard is None else shard.data[name]

    def _shard(self, index: int) -> Shard | None:
        if index in self._held:
            self._held.move_to_end(index)
            return self._held[index]
        first, stop = self._cut.place(index)
        shard, why = read_shard(self.folder, index, {"inputs": self._inputs, "first": first,
                                                     "stop": stop}, self._engine)
        if why:
            raise DamagedFile(f"{shard_path(self.folder, index)} {why}")
        if shard is not None:
            self._held[index] = shard
            if len(self._held) > HELD:
                self._held.popitem(last=False)
        return shard


class _Checked(_Store):
    """The same of shards that were checked already; what is read of them is not kept."""

    def __init__(self, folder: Path, attrs: dict[str, Any], axes: dict[str, NDArray[Any]],
                 status: NDArray[Any]) -> None:
        super().__init__(folder, attrs, axes)
        self._status = status

    def _column(self, index: int, name: str) -> NDArray[Any] | None:
        first, stop = self._cut.place(index)
        if self._status[first] == Status.UNFINISHED:
            return None
        return self._status[first:stop] if name == "status" \
            else read_column(self.folder, index, name)


class _Numbers:
    """A variable of a map that is read when it is indexed."""

    def __init__(self, store: _Store, name: str, shape: tuple[int, ...]) -> None:
        self._store, self._name, self.shape = store, name, shape
        self.dtype = np.dtype(store.kept.get(name, float))

    def read(self, key: tuple[Any, ...]) -> NDArray[Any]:
        """The part at integers, slices and arrays, one for each axis."""
        at = [np.atleast_1d(np.arange(size)[one])
              for one, size in zip(key, self.shape, strict=True)]
        found = np.empty(tuple(map(len, at)), dtype=self.dtype)
        rest = max(1, math.prod(found.shape[1:]))
        block = max(1, AT_ONCE // rest)
        offsets = np.zeros((1,) * len(at), dtype=np.int64)
        for axis, (places, step) in enumerate(zip(at, self._store.steps, strict=True)):
            if axis:
                offsets = offsets + step * places.reshape([-1 if i == axis else 1
                                                           for i in range(len(at))])
        for begin in range(0, len(at[0]), block):
            first = at[0][begin:begin + block].reshape([-1] + [1] * (len(at) - 1))
            found[begin:begin + block] = self._store.numbers(
                self._name, first * self._store.steps[0] + offsets)
        return found[tuple(0 if np.ndim(one) == 0 and not isinstance(one, slice) else slice(None)
                           for one in key)]


def _lazy(numbers: _Numbers) -> Any:
    """The same as xarray wants it, which is loaded here."""
    from xarray.backends import BackendArray
    from xarray.core import indexing

    class Lazy(BackendArray):
        shape, dtype = numbers.shape, numbers.dtype

        def __getitem__(self, key: Any) -> Any:
            return indexing.explicit_indexing_adapter(
                key, self.shape, indexing.IndexingSupport.OUTER, numbers.read)

        def __reduce__(self) -> tuple[Any, ...]:
            return _backend, (numbers,)

    return indexing.LazilyIndexedArray(Lazy())


def _backend(numbers: _Numbers) -> Any:
    """What a lazy array holds, from its pickle."""
    return _lazy(numbers).array


__all__ = ["open_study"]
