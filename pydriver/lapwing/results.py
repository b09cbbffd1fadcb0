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

from lapwing.codes import EventKind, Flank, MotionState, SearchStage, Status
from lapwing.stability_names import STABILITY

CONVENTIONS = "CF-1.11"
# Variables larger than this are compressed; the rest is small beside the file's own overhead.
COMPRESS_ABOVE = 1000
CODES = {"status": Status, "motion_state": MotionState, "event_kind": EventKind,
         "impact_flank": Flank, "trial_stage": SearchStage}
VELOCITY = "per unit of dimensionless time tau = natural_frequency * t"
# Units (UDUNITS) and long names by variable; a cycle_X is described as X.
DESCRIPTIONS = {
    "time": ("s", "time from the first recorded mesh cycle"),
    "phase": ("1", "mesh phase, in mesh periods"),
    "cycle": ("1", "mesh cycle, from the first recorded one"),
    "motion_state": (None, "motion state"),
    "phi": ("rad", "relative angle from the drive flank, positive in contact"),
    "phi_dot": ("rad", f"rate of phi, {VELOCITY}"),
    "mesh_force": ("N", "normal mesh force of spring and damper, coast flank negative"),
    "dynamic_te": ("rad", "dynamic transmission error, theta = phi + g"),
    "event_time": ("s", "time of the event from the first recorded mesh cycle"),
    "event_phase": ("1", "mesh phase of the event, in mesh periods"),
    "event_cycle": ("1", "mesh cycle of the event, from the first recorded one"),
    "event_kind": (None, "kind of event; back: at the coast flank"),
    "event_phi": ("rad", "relative angle at the event"),
    "velocity_before": ("rad", f"velocity relative to the flank before, {VELOCITY}"),
    "velocity_after": ("rad", f"velocity relative to the flank after, {VELOCITY}"),
    "impact_energy": ("J", "kinetic energy lost in impacts, in the flank's frame"),
    "mesh_force_mean": ("N", "mean normal force of spring and damper"),
    "mesh_force_peak": ("N", "largest magnitude of the force of spring and damper"),
    "impact_force_mean": ("N", "impulse of the impacts per time"),
    "impacts": ("1", "impacts at the drive flank, all"),
    "back_impacts": ("1", "impacts at the coast flank, all"),
    "counted_impacts": ("1", "impacts at the drive flank after flights deeper than count_depth"),
    "counted_back_impacts": ("1", "impacts at the coast flank after flights deeper than "
                             "count_depth"),
    "releases": ("1", "releases from the drive flank"),
    "back_releases": ("1", "releases from the coast flank"),
    "engages": ("1", "engagements of the drive flank"),
    "back_engages": ("1", "engagements of the coast flank"),
    "chatter_ends": ("1", "complete chatters at the drive flank"),
    "back_chatter_ends": ("1", "complete chatters at the coast flank"),
    "deepest_separation": ("rad", "deepest separation of the drive flank"),
    "deepest_back_penetration": ("rad", "deepest penetration of the coast flank"),
    "states_visited": (None, "motion states visited"),
    "status": (None, "how the run ended"),
    "force": ("rad", "mean force F of the dimensionless oscillator"),
    "motion_class": (None, "p:(i,j), i drive and j coast impacts in p mesh cycles; c: complete "
                     "chatter"),
    "period": ("1", "period in mesh cycles, 0: none found"),
    **STABILITY,
    "speed_edge": ("rad", f"edges of the bins of impact speed, {VELOCITY}"),
    "impact_speed_density": ("1", "impacts per mesh cycle in a bin of speed, either flank"),
    "order": ("1", "mesh order, multiples of the mesh frequency"),
    "order_spectrum": ("rad", "amplitude of phi by mesh order, Hann window"),
    "slow_impacts": ("1", "impacts per mesh cycle slower than the first bin"),
    "start": (None, "how each value was begun"),
    "recorded_cycle": ("1", "recorded mesh cycle"),
    "impact_phase": ("1", "mesh phase of the impact, in mesh periods"),
    "impact_velocity": ("rad", f"velocity relative to the flank before the impact, {VELOCITY}"),
    "impact_flank": (None, "flank of the impact"),
    "n_impacts": ("1", "impacts met, also those there was no room for"),
    "knots": ("1", "ends of the pieces, in mesh periods"),
    "coefficients": ("rad", "coefficients of ascending powers of (phase - knot), phase in mesh "
                     "periods"),
    "kinks": (None, "whether the slope jump at the beginning of the piece belongs to the data"),
    "claim_value": (None, "parameter value a source reports on"),
    "claim_deepest_separation": ("rad", "deepest separation a source reports"),
    "claim_text": (None, "what a source reports, in words"),
    "brake_torque": ("N m", "brake torque on the gear"),
    "drive_torque": ("N m", "drive torque on the pinion"),
    "pinion_speed_rpm": ("rpm", "pinion speed"),
    "pinion_speed_rad_s": ("rad/s", "pinion speed"),
    "mesh_frequency_hz": ("Hz", "mesh frequency"),
    "pinion_base_lever": ("m", "lever of the normal mesh force about the pinion axis"),
    "mesh_stiffness": ("N/m", "normal mesh stiffness"),
    "mesh_damping": ("N s/m", "normal mesh damping"),
    "backlash": ("rad", "angular backlash"),
    "pinion_inertia": ("kg m2", "polar inertia of the pinion"),
    "gear_inertia": ("kg m2", "polar inertia of the gear"),
    "restitution": ("1", "coefficient of restitution"),
    "damping_ratio": ("1", "damping ratio"),
}
# Whole numbers that the engine's tables hold as reals.
WHOLE = ("motion_state", "impacts", "back_impacts", "counted_impacts", "counted_back_impacts",
         "releases", "back_releases", "engages", "back_engages", "chatter_ends",
         "back_chatter_ends", "states_visited")
FAILED = -1
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


def described(dataset):
    """The dataset with CF attributes, whole numbers as such, attributes as netCDF can hold them.

    Parameters
    ----------
    dataset : xarray.Dataset, a response, a sweep or a part of the file

    Returns
    -------
    xarray.Dataset
        A shallow copy; each known variable has `units` and `long_name`, coded ones `flag_values`
        (or `flag_masks`) and `flag_meanings`.
    """
    dataset = dataset.assign({name: variable.fillna(FAILED).astype(np.int32)
                              for name, variable in dataset.data_vars.items()
                              if name in WHOLE and variable.dtype.kind == "f"})
    dataset.attrs = {key: _plain(value) for key, value in dataset.attrs.items()
                     if value is not None}
    for name, variable in dataset.variables.items():
        key = str(name)
        bare = key if key in DESCRIPTIONS else key.removeprefix("cycle_")
        own = (variable.attrs.get("units", "1"),
               variable.attrs.get("long_name", key.replace("_", " ")))
        units, long_name = DESCRIPTIONS.get(bare, own)
        variable.attrs = {"long_name": long_name, **({"units": units} if units else {}),
                          **_flags(bare, variable.dtype)}
    return dataset


def _flags(name, dtype):
    """CF flags of a coded variable."""
    if name == "states_visited":
        return {"flag_masks": np.array([1 << state for state in MotionState], dtype=dtype),
                "flag_meanings": _meanings(MotionState)}
    if name == "kinks":
        return {"flag_values": np.array([0, 1], np.int8), "flag_meanings": "smooth kink"}
    if name not in CODES:
        return {}
    values = [int(code) for code in CODES[name]]
    return {"flag_values": np.array(values).astype(dtype), "flag_meanings": _meanings(CODES[name])}


def _meanings(codes):
    return " ".join(code.name.lower() for code in codes)


def _plain(value):
    """An attribute netCDF can hold: no bool, and nothing of Python's own."""
    if isinstance(value, bool | np.bool_):
        return np.int32(value)
    return np.int64(value) if isinstance(value, int) else value


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
