"""Reference events and states, stored as data: one file per scene, one group per variant.

A variant is named `<series|table>_<true|rule>`: the transmission error as the harmonic series
itself or as the table that stands for it; a chatter's end as it is, or by the sticking rule that
the other integrators follow. Bounces inside a complete chatter are not stored.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np

from lapwing_bench.scenes import LONG, SHORT

DATA = Path(__file__).parent / "data"
BY_EVENT = {"kind": np.int8, "cycle": np.int16, "phase": float, "velocity_before": float,
            "velocity_after": float, "growth": np.float32, "chatter_since": float}
MEANINGS = {
    "kind": "number of lapwing.EventKind", "phase": "mesh periods since the cycle's beginning",
    "velocity_before": "phi' before, rad per tau", "velocity_after": "phi' after, rad per tau",
    "growth": "|d tau / d ln(torque)|, mesh periods",
    "chatter_since": "mesh periods since the start: bounces after it and up to this event, a "
                     "chatter's end, are not listed",
    "calm": "1: followed for the long horizon, because errors do not grow", "force": "F, rad",
    "state": "motion state, phi (rad), phi' (rad per tau) at the end of the horizon",
    "state_growth": "|d state / d ln(torque)| in natural sizes of angle and velocity",
    "listed_events": "events of the horizon, bounces inside chatters included",
    "listed_until": "mesh periods: the horizon, or where a chatter begins that reaches beyond it",
}
HORIZONS = (SHORT, LONG)


@dataclass(frozen=True)
class Reference:
    """What is known of one torque.

    Attributes
    ----------
    events : dict of arrays over the events: kind, time (mesh periods from the start), cycle,
        phase, velocity_before, velocity_after (rad per τ), growth, chatter_since
    states : dict of cycles -> (motion state, phi, phi')
    state_growth : dict of cycles -> float
    listed_events : dict of cycles -> int
    listed_until : dict of cycles -> float, mesh periods; later bounces are not in `events`
    calm : bool, whether the long horizon is there
    """

    events: dict
    states: dict
    state_growth: dict
    listed_events: dict
    listed_until: dict
    calm: bool


def variant(scene, *, rule, table):
    """Name of the variant a method is to be judged against.

    Parameters
    ----------
    scene : BenchScene
    rule : bool, whether the method sticks by the rule
    table : bool, whether it sees a harmonic series through its table
    """
    forcing = "table" if table or not scene.is_series else "series"
    return f"{forcing}_{'rule' if rule and scene.contact_law != 'compliant' else 'true'}"


def write_reference(path, scene, records, provenance):
    """Write one scene's file.

    Parameters
    ----------
    path : Path
    scene : BenchScene
    records : dict of variant -> list, one dict for each torque: the names of `BY_EVENT` over all
        events of the long horizon; states and state_growth, listed_events by horizon; calm
    provenance : dict of attributes: the command, the digits carried
    """
    import xarray as xr

    path.parent.mkdir(exist_ok=True)
    root = xr.Dataset(attrs={"title": f"Reference of scene {scene.name}: {scene.title}",
                             **provenance})
    root.to_netcdf(path, mode="w", engine="netcdf4", format="NETCDF4")
    for name, rows in records.items():
        dataset = _group(scene, rows)
        encoding = {key: {"zlib": True, "complevel": 9, "shuffle": True} for key in dataset
                    if dataset[key].ndim}
        dataset.to_netcdf(path, mode="a", group=name, engine="netcdf4", encoding=encoding)


def _group(scene, rows):
    """Dataset of one variant, events of all torques in one row."""
    import xarray as xr

    kept = []
    for row in rows:
        cycles = LONG if row["calm"] else SHORT
        kept.append(np.asarray(row["cycle"], dtype=int) < cycles)
    data = {key: ("event", np.concatenate([np.asarray(row[key], dtype=float)[keep]
                                           for row, keep in zip(rows, kept, strict=True)]
                                          ).astype(kind))
            for key, kind in BY_EVENT.items()}
    data |= {
        "n_events": ("torque", np.array([keep.sum() for keep in kept], dtype=np.int32)),
        "calm": ("torque", np.array([row["calm"] for row in rows], dtype=np.int8)),
        "force": ("torque", [osc.force for osc in scene.oscillators]),
        "state": (("torque", "horizon", "part"), [row["states"] for row in rows]),
        "state_growth": (("torque", "horizon"), [row["state_growth"] for row in rows]),
        "listed_events": (("torque", "horizon"), [row["listed_events"] for row in rows]),
        "listed_until": (("torque", "horizon"), [_listed_until(row) for row in rows])}
    dataset = xr.Dataset(data, {"torque": list(scene.torques), "horizon": list(HORIZONS)})
    dataset["torque"].attrs["units"] = "N m"
    for key, meaning in MEANINGS.items():
        dataset[key].attrs["long_name"] = meaning
    return dataset


def _listed_until(row):
    """Where bounces that are not stored begin, for each horizon."""
    time = np.asarray(row["cycle"]) + np.asarray(row["phase"], dtype=float)
    since = np.asarray(row["chatter_since"], dtype=float)
    return [min([cycles, *since[(since < cycles) & (time >= cycles)]]) for cycles in HORIZONS]


@cache
def load(scene_name, variant_name):
    """References of one scene and variant.

    Returns
    -------
    dict of torque (N·m) -> Reference

    Raises
    ------
    OSError
        no such file or group.
    """
    import xarray as xr

    with xr.open_dataset(DATA / f"{scene_name}.nc", group=variant_name,
                         engine="netcdf4") as dataset:
        dataset = dataset.load()
    ends = np.cumsum(dataset["n_events"].values)
    found = {}
    for i, torque in enumerate(dataset["torque"].values):
        rows = slice(ends[i] - dataset["n_events"].values[i], ends[i])
        events = {key: dataset[key].values[rows] for key in BY_EVENT}
        events["time"] = events["cycle"] + events["phase"]
        by_horizon = [dict(zip(HORIZONS, dataset[key].values[i], strict=True)) for key in
                      ("state", "state_growth", "listed_events", "listed_until")]
        found[float(torque)] = Reference(events, *by_horizon, bool(dataset["calm"].values[i]))
    return found
