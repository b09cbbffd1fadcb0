"""The result file: everything a run found, in one netCDF-4 file with one group per thing.

Groups `gear_pair`, `transmission_error`, `response_<name>`, `sweep_<name>`, `critical_<name>`;
provenance and the deck at the root.  Figures and summary are made from the file alone: nothing
here needs the engine.
"""

from __future__ import annotations

import os
import re
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from lapwing.base import arguments
from lapwing.base.messages import Shown
from lapwing.base.registry import STUDIES, give_accessor
from lapwing.base.signals import held
from lapwing.model.oscillator import TE_SIGNS
from lapwing.results.checksums import DamagedFile, small_cache, store_checksums, verify_file
from lapwing.results.curve import source_of
from lapwing.results.provenance import engine_digest, provenance
from lapwing.results.schema import SCHEMA_VERSION, as_of_today
from lapwing.results.store import Manifest, flush, os_errors
from lapwing.results.variables import write_groups

if TYPE_CHECKING:
    import xarray as xr

    from lapwing.model.gear_pair import GearPair
    from lapwing.model.transmission_error.table import TransmissionError

CONVENTIONS = "CF-1.11"
DERIVED = ("gear_ratio", "equivalent_inertia", "natural_frequency", "torsional_stiffness",
           "force_per_torque")


def write_results(path: Path, *, deck_name: str, deck_text: str, used_text: str, used_hash: Any,
                  pair: GearPair, te: TransmissionError, te_sign: str,
                  found: dict[str, dict[str, xr.Dataset]], te_source: str | None = None,
                  measured: tuple[dict[str, Any], dict[str, Any]] = ({}, {}),
                  interrupted: bool = False, studies: Any = ()) -> dict[str, str]:
    """Write the result file under a temporary name, flush it to the disk, and rename it.

    A reader sees the old file or the new one, never a part.  The same arguments give the same
    variables and attributes, so no time of day is among them.  A signal waits until the file is
    whole.

    Parameters
    ----------
    path : str or Path; its folder exists
    deck_name, deck_text : str, the deck as it was read
    used_text, used_hash : str, the deck with every value really used, and its hash
    pair : GearPair
    te : TransmissionError
    te_sign : 'printed' or 'geometric', how the table becomes the flank's motion
    found : dict of kind -> dict of name -> Dataset in deck order, for kinds of `registry.STUDIES`
    te_source : str or None, the table's file name or formula; default: what the table tells
    measured : variables and attributes of measured samples, from `curve.curve_variables`
    interrupted : bool, whether studies of the deck are missing or unfinished
    studies : sequence of (kind, name), all that the deck asks for, in the order of the summary

    Returns
    -------
    dict of "/group/variable" -> SHA-256 of its numbers, as `checksums.checksums` reads them back

    Raises
    ------
    OSError
        where the file cannot be written; nothing is left behind.
    """
    path = Path(path)
    root = {"Conventions": CONVENTIONS, "schema_version": SCHEMA_VERSION,
            "title": f"Lapwing results of {deck_name}",
            "history": f"computed by Lapwing from deck {deck_name}",
            **provenance(), "deck_name": deck_name, "deck_text": deck_text,
            "used_deck": used_text, "used_hash": used_hash, "interrupted": int(interrupted),
            "studies": "\n".join(f"{kind} {name}" for kind, name in studies)}
    groups = {None: _dataset({}, root), "gear_pair": _dataset({}, pair_attributes(pair)),
              "transmission_error": _transmission_error(te, te_sign, pair.gear_ratio,
                                                        te_source or source_of(te), measured)}
    claims = _claims(found.get("response", {}).values())
    for kind in STUDIES:
        for order, (name, dataset) in enumerate(found.get(kind, {}).items()):
            dataset = dataset.assign_attrs(name=name, order=order, kind=kind)
            groups[f"{kind}_{name}"] = _claimed(dataset, claims) if kind == "sweep" else dataset
    aside = path.with_name(f".{path.name}.{os.getpid()}.tmp")
    with held(), small_cache(), os_errors(path.parent):
        try:
            write_groups(aside, groups)
            stored = store_checksums(aside)
            flush(aside)
            os.replace(aside, path)
            flush(path.parent)
        finally:
            aside.unlink(missing_ok=True)
    return stored


def _dataset(variables: dict[str, Any], attributes: dict[str, Any]) -> xr.Dataset:
    import xarray as xr

    return xr.Dataset(variables, attrs=attributes)


def pair_attributes(pair: GearPair) -> dict[str, Any]:
    """The numbers of a gear pair, given and derived, as group `gear_pair` has them."""
    given = {key: value for key, value in asdict(pair).items() if value is not None}
    return {**given, **{name: getattr(pair, name) for name in DERIVED}, "damping_ratio": pair.xi}


def _transmission_error(te: TransmissionError, te_sign: str, gear_ratio: float, source: str,
                        measured: tuple[dict[str, Any], dict[str, Any]]) -> xr.Dataset:
    variables, known = measured
    attributes = {"te_sign": te_sign, "flank_scale": TE_SIGNS[te_sign] * gear_ratio,
                  "peak_to_peak": te.peak_to_peak, "source": source, **known}
    return _dataset({**variables, "knots": ("knot", te.knots),
                     "coefficients": (("piece", "power"), te.coefficients),
                     "kinks": ("piece", te.kinks.astype(np.int8))}, attributes)


def _claims(responses: Any) -> list[dict[str, Any]]:
    """Attributes of the responses for which the deck says what somebody else reports."""
    return [one.attrs for one in responses if any(key.startswith("claim_") for key in one.attrs)]


def _claimed(sweep: xr.Dataset, claims: list[dict[str, Any]]) -> xr.Dataset:
    """A sweep with the claims at values of its parameter."""
    parameter = sweep["status"].dims[1]
    rows = [(attrs[parameter], attrs.get("claim_deepest_separation", np.nan),
             attrs.get("claim_text", "")) for attrs in claims if parameter in attrs]
    variables = {}
    if rows:
        value, depth, text = zip(*rows, strict=True)
        variables = {"claim_value": ("claim", np.array(value, dtype=float)),
                     "claim_deepest_separation": ("claim", np.array(depth, dtype=float)),
                     # A text of no length would have a dimension without an end.
                     **({"claim_text": ("claim", np.array(text))} if any(text) else {})}
    return sweep.assign(variables).assign_attrs(parameter=parameter)


@dataclass(repr=False)
class Results(Shown):
    """A result file, open for reading; groups are read when they are asked for.

    Attributes
    ----------
    path : Path
    attrs : dict, the root's attributes: deck and provenance
    gear_pair : dict
    studies : dict of kind -> tuple of str, names in deck order
    verified : bool, whether the content is known to be what was written; False for files of
        version 0.1, which carry no checksums

    Close it, or use it in a `with` statement.
    """

    path: Path
    attrs: dict[str, Any]
    gear_pair: dict[str, Any]
    studies: dict[str, tuple[str, ...]]
    verified: bool = False
    _open: dict[str, xr.Dataset] = field(default_factory=dict, repr=False)
    _file: Any = field(default=None, repr=False)

    def _facts(self) -> dict[str, object]:
        """Where they are and what is in them, in words."""
        held = {kind: ", ".join(names) for kind, names in self.studies.items() if names}
        return {"file": self.path, "deck": self.attrs.get("deck_name", ""), **held,
                **({"interrupted": "yes"} if self.interrupted else {})}

    @property
    def responses(self) -> tuple[str, ...]:
        """Names of the responses."""
        return self.studies.get("response", ())

    @property
    def sweeps(self) -> tuple[str, ...]:
        """Names of the sweeps."""
        return self.studies.get("sweep", ())

    @property
    def criticals(self) -> tuple[str, ...]:
        """Names of the searches for a critical value."""
        return self.studies.get("critical", ())

    @property
    def maps(self) -> tuple[str, ...]:
        """Names of the maps."""
        return self.studies.get("map", ())

    @property
    def transmission_error(self) -> xr.Dataset:
        """Dataset: knots, coefficients, kinks."""
        return self._group("transmission_error")

    @property
    def interrupted(self) -> bool:
        """Whether studies of the deck are missing or unfinished."""
        return bool(self.attrs.get("interrupted", 0))

    @property
    def missing(self) -> tuple[tuple[str, str], ...]:
        """(kind, name) of the studies that the deck asked for and that have no result."""
        asked = [tuple(line.split(" ", 1))
                 for line in str(self.attrs.get("studies", "")).splitlines()]
        return tuple((kind, name) for kind, name in asked if name not in self.studies[kind])

    @property
    def operation(self) -> dict[str, float]:
        """What the deck gives to all its studies: torques in N·m, speed as it was given.

        Empty where the file does not tell; keys as in the deck's &operation.
        """
        used = str(self.attrs.get("used_deck", ""))
        group = re.search(r"^&operation$(.*?)^/$", used, re.M | re.S)
        return {key: float(value) for key, value in re.findall(
            r"^\s*(\w+) = ([-+.\deE]+)\b", group[1] if group else "", re.M)}

    def study(self, kind: str, name: str) -> xr.Dataset:
        """Dataset of one study, read on demand."""
        return self._group(f"{kind}_{name}")

    def response(self, name: str) -> xr.Dataset:
        """Dataset of one response, read on demand."""
        return self.study("response", name)

    def sweep(self, name: str) -> xr.Dataset:
        """Dataset of one sweep, read on demand."""
        return self.study("sweep", name)

    def critical(self, name: str) -> xr.Dataset:
        """Dataset of one search for a critical value, read on demand."""
        return self.study("critical", name)

    def _group(self, group: str) -> xr.Dataset:
        import netCDF4
        import xarray as xr
        from xarray import backends

        make_store: Any = backends.NetCDF4DataStore
        if group not in self._open:
            give_accessor()
            with small_cache():
                if self._file is None:  # opened once for all groups
                    self._file = backends.CachingFileManager(netCDF4.Dataset, self.path, mode="r")
                opened = xr.open_dataset(make_store(self._file, group=group), decode_times=False)
            self._open[group] = as_of_today(opened, int(self.attrs.get("schema_version", 0)))
        return self._open[group]

    def close(self) -> None:
        """Close every group that was read."""
        while self._open:
            self._open.popitem()[1].close()
        self._file = None

    def __enter__(self) -> Results:
        return self

    def __exit__(self, *_: Any) -> None:
        self.close()


def verify(path: Any) -> bool:
    """Whether a result file is known to hold what was written.

    Where a manifest beside it lists the file, its content is compared with that, else each variable
    and the attributes with the checksums in the file.

    Returns
    -------
    bool
        False for a file of version 0.1, which carries no checksums.

    Raises
    ------
    lapwing.results.DamagedFile
        (a ValueError) naming what differs.
    OSError
        where there is no such file or it is no netCDF file.
    """
    path = Path(path)
    manifest = Manifest.read(path.parent)
    if manifest is not None and path.name in manifest.files and path.exists():
        wrong = manifest.wrong_with(path)
        if wrong:
            raise DamagedFile(f"{path} is damaged: {wrong}")
        return True
    return verify_file(path)


@arguments.complete()
def open_results(path: Any, check: bool = True) -> Results:
    """Open a result file, once it is known to be whole.

    Parameters
    ----------
    path : str or Path
    check : bool, False where the caller has verified it already

    Returns
    -------
    Results

    Raises
    ------
    lapwing.results.DamagedFile
        (a ValueError) where its content is not what was written (`verify`).
    OSError
        where there is no such file or it is no netCDF file.
    ValueError
        where it is a netCDF file, but none of ours.
    TypeError
        where an argument is of another kind.
    """
    import netCDF4

    arguments.path("path", path)
    verified = verify(path) if arguments.flag("check", check) else True
    with netCDF4.Dataset(path) as file:
        if "lapwing_version" not in file.ncattrs() or "gear_pair" not in file.groups:
            raise ValueError(f"{path} is no result file of Lapwing")
        names = {}
        for kind in STUDIES:
            groups = [group for name, group in file.groups.items() if name.startswith(kind + "_")]
            groups.sort(key=lambda group: int(group.order))
            names[kind] = tuple(str(group.getncattr("name")) for group in groups)
        pair = file["gear_pair"]
        return Results(Path(path), {key: file.getncattr(key) for key in file.ncattrs()},
                       {key: pair.getncattr(key) for key in pair.ncattrs()},
                       names, verified)


def stored_studies(results: Results) -> dict[tuple[str, str], xr.Dataset]:
    """The studies of an open result file as they were given to `write_results`.

    To be written again: unlike what `Results` hands out, whole numbers stay whole.

    Returns
    -------
    dict of (kind, name) -> Dataset, in memory
    """
    import xarray as xr

    studies = {}
    for kind, names in results.studies.items():
        for name in names:
            with xr.open_dataset(results.path, group=f"{kind}_{name}", engine="netcdf4",
                                 decode_times=False, mask_and_scale=False) as data:
                data = data.load()
            for variable in data.variables.values():
                variable.attrs.pop("_FillValue", None)
                variable.encoding.clear()
            data.encoding.clear()
            studies[kind, name] = data
    return studies


read_results = open_results

__all__ = ["DamagedFile", "Results", "engine_digest", "open_results", "provenance",
           "read_results", "stored_studies", "verify", "write_results"]
