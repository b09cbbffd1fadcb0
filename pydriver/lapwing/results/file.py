"""The result file: everything a run found, in one netCDF-4 file with one group per thing.

Groups `gear_pair`, `transmission_error`, `response_<name>`, `sweep_<name>`, `critical_<name>`;
provenance and the deck at the root.  Figures and summary are made from the file alone: nothing
here needs the engine.
"""

from __future__ import annotations

import os
import platform
from dataclasses import asdict, dataclass, field
from pathlib import Path

import numpy as np

from lapwing.result_variables import CODES, DESCRIPTIONS, FAILED, VELOCITY, WHOLE, described

__all__ = ["CODES", "DESCRIPTIONS", "FAILED", "VELOCITY", "WHOLE", "Results", "described",
           "read_results", "write_results"]

CONVENTIONS = "CF-1.11"
# Variables larger than this are compressed; the rest is small beside the file's own overhead.
COMPRESS_ABOVE = 1000
DERIVED = ("gear_ratio", "equivalent_inertia", "natural_frequency", "torsional_stiffness",
           "force_per_torque")


def write_results(path, *, deck_name, deck_text, used_text, used_hash, pair, te, osc, responses,
                  sweeps, criticals=None, te_source=None):
    """Write the result file under a temporary name, flush it to the disk, and rename it.

    A reader sees the old file or the new one, never a part; the same arguments give the same
    variables and attributes, so no time of day is among them.

    Parameters
    ----------
    path : str or Path; its folder exists
    deck_name, deck_text : str, the deck as it was read
    used_text, used_hash : str, the deck with every value really used, and its hash
    pair : GearPair
    te : TransmissionError
    osc : Oscillator, at the deck's operating point; says how the table becomes the flank's motion
    responses : sequence of Dataset, from `lapwing.studies.response.response`, in deck order
    sweeps : dict of name -> Dataset, from `lapwing.sweep`, in deck order
    criticals : dict of name -> Dataset, from `lapwing.critical_full` and the like, or None
    te_source : str or None, the table's file name or formula; default: what the table tells

    Raises
    ------
    ValueError
        two responses of one name.
    OSError
        where the file cannot be written; nothing is left behind.
    """
    path = Path(path)
    names = [response.attrs["name"] for response in responses]
    if len(set(names)) != len(names):
        raise ValueError(f"two responses of one name: {', '.join(names)}")
    root = {"Conventions": CONVENTIONS, "title": f"Lapwing results of {deck_name}",
            "history": f"computed by Lapwing from deck {deck_name}",
            **_provenance(), "deck_name": deck_name, "deck_text": deck_text,
            "used_deck": used_text, "used_hash": used_hash}
    groups = {None: _dataset({}, root), "gear_pair": _dataset({}, _pair_attributes(pair)),
              "transmission_error": _transmission_error(te, osc, te_source or _te_source(te))}
    for order, response in enumerate(responses):
        groups[f"response_{response.attrs['name']}"] = response.assign_attrs(order=order)
    for order, (name, sweep) in enumerate(sweeps.items()):
        groups[f"sweep_{name}"] = _labelled(sweep, name, order, osc, responses)
    for order, (name, critical) in enumerate((criticals or {}).items()):
        groups[f"critical_{name}"] = critical.assign_attrs(name=name, order=order)
    temporary = path.with_name(f".{path.name}.{os.getpid()}.tmp")
    try:
        for mode, (name, dataset) in zip("w" + "a" * len(groups), groups.items(), strict=False):
            dataset = described(dataset)
            dataset.to_netcdf(temporary, mode=mode, group=name, engine="netcdf4",
                              format="NETCDF4", encoding=_encoding(dataset))
        _flush(temporary)
        os.replace(temporary, path)
        _flush(path.parent)
    finally:
        temporary.unlink(missing_ok=True)


def _encoding(dataset):
    """Compress what is large; whole numbers of failed runs are missing and read as NaN."""
    encoding = {}
    for name, variable in dataset.variables.items():
        small = variable.size <= COMPRESS_ABOVE or variable.dtype.kind not in "fiu"
        packed = {} if small else {"zlib": True, "complevel": 4, "shuffle": True}
        missing = variable.dtype.kind == "i" and np.any(variable.values == FAILED)
        encoding[name] = {"_FillValue": FAILED if missing else None, **packed}
    return encoding


def _flush(path):
    """Have a file or folder written to the disk."""
    handle = os.open(path, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


def _dataset(variables, attributes):
    import xarray as xr

    return xr.Dataset(variables, attrs=attributes)


def _pair_attributes(pair):
    given = {key: value for key, value in asdict(pair).items() if value is not None}
    return {**given, **{name: getattr(pair, name) for name in DERIVED}, "damping_ratio": pair.xi}


def _transmission_error(te, osc, source):
    attributes = {"te_sign": osc.te_sign, "flank_scale": osc.flank_scale,
                  "peak_to_peak": te.peak_to_peak, "source": source}
    return _dataset({"knots": ("knot", te.knots),
                     "coefficients": (("piece", "power"), te.coefficients),
                     "kinks": ("piece", te.kinks.astype(np.int8))}, attributes)


def _te_source(te):
    """In words, what the table was made from."""
    if len(te.harmonics):
        return " + ".join(f"{amplitude:g} rad cos(2 pi {order:g} phase + {shift:g})"
                          for order, amplitude, shift in te.harmonics)
    return f"table of {len(te.kinks)} polynomial pieces, {int(te.kinks.sum()) or 'no'} kinks"


def _labelled(sweep, name, order, osc, responses):
    """A sweep with its name, its critical value and the deck's claims."""
    parameter = sweep["status"].dims[1]
    labels = {"name": name, "order": order, "parameter": parameter}
    if parameter == "brake_torque" and "full_engagement" not in sweep.attrs:
        labels |= _full_engagement(osc)
    claims = [(attrs[parameter], attrs.get("claim_deepest_separation", np.nan),
               attrs.get("claim_text", "")) for attrs in (one.attrs for one in responses)
              if parameter in attrs and any(key.startswith("claim_") for key in attrs)]
    columns = zip(*claims, strict=True) if claims else ((), (), ())
    variables = {key: ("claim", np.array(column, dtype=kind)) for key, column, kind in zip(
        ("claim_value", "claim_deepest_separation", "claim_text"), columns,
        (float, float, object), strict=True)}
    return sweep.assign(variables).assign_attrs(labels)


def _full_engagement(osc):
    """Brake torque (N m) above which the engaged response never separates, and its phase."""
    from lapwing.linear_response import critical_torque

    if osc.contact_law == "rigid" or osc.scales is None:
        return {}
    try:
        torque, phase = critical_torque(osc)
    except ValueError:  # no periodic engaged response: an undamped resonance
        return {}
    return {"full_engagement": torque, "full_engagement_phase": phase}


def _provenance():
    """What made the file: program, compiler, processor, libraries."""
    import netCDF4
    import xarray

    from lapwing import _build_info as build

    return {"lapwing_version": build.VERSION, "compiler": build.COMPILER,
            "build_flags": build.FLAGS, "build_type": build.BUILDTYPE, "cpu": _cpu(),
            "python_version": platform.python_version(), "numpy_version": np.__version__,
            "xarray_version": xarray.__version__, "netcdf4_version": netCDF4.__version__}


def _cpu():
    """Model of the processor, as far as the system tells."""
    try:
        with open("/proc/cpuinfo", encoding="utf-8", errors="replace") as file:
            for line in file:
                if line.lower().startswith("model name"):
                    return line.partition(":")[2].strip()
    except OSError:
        pass
    return platform.processor() or platform.machine()


@dataclass
class Results:
    """A result file, open for reading; groups are read when they are asked for.

    Attributes
    ----------
    path : Path
    attrs : dict, the root's attributes: deck and provenance
    gear_pair : dict
    responses, sweeps, criticals : tuple of str, names in deck order

    Close it, or use it in a `with` statement.
    """

    path: Path
    attrs: dict
    gear_pair: dict
    responses: tuple
    sweeps: tuple
    criticals: tuple = ()
    _open: dict = field(default_factory=dict, repr=False)

    @property
    def transmission_error(self):
        """Dataset: knots, coefficients, kinks."""
        return self._group("transmission_error")

    def response(self, name):
        """Dataset of one response, read on demand."""
        return self._group(f"response_{name}")

    def sweep(self, name):
        """Dataset of one sweep, read on demand."""
        return self._group(f"sweep_{name}")

    def critical(self, name):
        """Dataset of one search for a critical value, read on demand."""
        return self._group(f"critical_{name}")

    def _group(self, group):
        import xarray as xr

        if group not in self._open:
            self._open[group] = xr.open_dataset(self.path, group=group, engine="netcdf4",
                                                decode_times=False)
        return self._open[group]

    def close(self):
        """Close every group that was read."""
        while self._open:
            self._open.popitem()[1].close()

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.close()


def read_results(path):
    """Open a result file.

    Parameters
    ----------
    path : str or Path

    Returns
    -------
    Results

    Raises
    ------
    OSError
        where there is no such file or it is no netCDF file.
    ValueError
        where it is a netCDF file, but none of ours.
    """
    import netCDF4

    with netCDF4.Dataset(path) as file:
        if "lapwing_version" not in file.ncattrs() or "gear_pair" not in file.groups:
            raise ValueError(f"{path} is no result file of Lapwing")
        names = {}
        for kind in ("response_", "sweep_", "critical_"):
            groups = [group for name, group in file.groups.items() if name.startswith(kind)]
            groups.sort(key=lambda group: int(group.order))
            names[kind] = tuple(str(group.getncattr("name")) for group in groups)
        pair = file["gear_pair"]
        return Results(Path(path), {key: file.getncattr(key) for key in file.ncattrs()},
                       {key: pair.getncattr(key) for key in pair.ncattrs()},
                       names["response_"], names["sweep_"], names["critical_"])
