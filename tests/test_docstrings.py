"""What docstrings say of the variables of a result, against a result."""

import re

import numpy as np
import pytest

import lapwing
from helpers import PAIR, SHIPPED, scene_a
from lapwing.base import codes, quantities

FEW = {"settle": 1, "record": 2}
GRID = {"starts": lapwing.StartGrid(1, 1, 1), "pinion_speed_rpm": 240, **FEW}
TWO = {"degrees_of_freedom": 2}
SWEPT = {"values": [2.0, 3.0], "starts": "rest", "pinion_speed_rpm": 240, **FEW}
# Of each docstring: the results that together have every variable, and what is said otherwise.
DIMENSIONS = {"brake_torque": "parameter", "backlash": "x", "damping_ratio": "y"}
# Not in every docstring where they are coordinates: they are named as dimensions.
COORDINATES = {"te", "start", "brake_torque", "backlash", "damping_ratio"}
CURVES = {"shipped": SHIPPED}


def of_curves(data):
    """What a result says of the curves that were varied."""
    return data[[name for name in data.data_vars if name.startswith("curve_")]]


CASES = {
    "sweep": lambda: (
        lapwing.sweep, [lapwing.sweep(PAIR, SHIPPED, **SWEPT, **how) for how in (
            {"observe": ("cycles", "impacts", "exponents", "speeds", "spectra", "amplitudes")},
            {"observe": (), **TWO})] + [of_curves(lapwing.sweep(
                PAIR, SHIPPED, parameter="te", **SWEPT | {"values": CURVES}, brake_torque=2.0))]),
    "events": lambda: (lapwing.Run, [lapwing.simulate(scene_a(1.8), cycles=2).events]),
    "cycles": lambda: (lapwing.Run, [lapwing.simulate(scene_a(1.8, "relative", **TWO),
                                                      cycles=2).cycles]),
    "history": lambda: (lapwing.Run.history, [
        lapwing.simulate(scene_a(1.8, "relative", **TWO), cycles=2).history(np.array([0.0]))]),
    "response": lambda: (lapwing.response, [
        lapwing.response(scene_a(1.8, "relative", **TWO), PAIR, samples_per_cycle=4, **FEW)]),
    "parameter_map": lambda: (lapwing.parameter_map, [lapwing.parameter_map(
        PAIR, SHIPPED, {"backlash": [1e-3, 2e-3], "damping_ratio": [0.1, 0.2]}, brake_torque=3.0,
        observe=("rms", "forces", "exponent", "shares"), pinion_speed_rpm=240, **FEW),
        of_curves(lapwing.parameter_map(PAIR, SHIPPED, {"te": CURVES, "brake_torque": [2.0]},
                                        pinion_speed_rpm=240, **FEW))]),
    "ensemble": lambda: (lapwing.ensemble, [lapwing.ensemble(
        PAIR, SHIPPED, {"backlash": lapwing.Draw("uniform", low=1e-3, high=2e-3)}, runs=32,
        sensitivity_draws=16, brake_torque=3.0, pinion_speed_rpm=240, **FEW)]),
    "critical_safe": lambda: (lapwing.critical_safe, [
        lapwing.critical_safe(PAIR, SHIPPED, values=[13.0, 14.0], **GRID).data]),
    "critical_back": lambda: (lapwing.critical_back, [
        lapwing.critical_back(PAIR, SHIPPED, values=[13.0, 14.0], **GRID).data]),
    "critical_full": lambda: (lapwing.critical_full, [lapwing.critical_full(
        PAIR, SHIPPED, parameter="pinion_speed_rpm", values=[200.0, 240.0],
        brake_torque=3.0).data]),
    "branches": lambda: (lapwing.branches, [lapwing.branches(
        PAIR, SHIPPED, low=11.0, high=12.5, seeds=2, settle=50, doublings=0, points=3,
        rattling_cycles=20_000, pinion_speed_rpm=240, impact_law="absolute")]),
    "attractors": lambda: (lapwing.attractors, [
        lapwing.attractors(scene_a(1.8), runs=32, most_cycles=50)]),
}
BLOCK = re.compile(r"^ *[^()\n]*\(([a-z_, ]+)\): ((?:.*,\n)*.*)$", re.MULTILINE)
NAME = re.compile(r"(\w+)(?: \[([^\]]+)\])?(?:, |,\n *|$)")


def told(text, only=None):
    """name -> (dimensions, unit or enumeration), of the variables that a docstring lists."""
    return {name: (tuple(dims.split(", ")), unit)
            for dims, names in BLOCK.findall(text) if only in (None, dims)
            for name, unit in NAME.findall(names)}


def there(data):
    """The same of a Dataset, of limits `_low` and `_high` of an ensemble nothing."""
    found = {}
    for name, variable in data.variables.items():
        dims = tuple(DIMENSIONS.get(dim, dim) for dim in variable.dims)
        if name in COORDINATES or (name.endswith(("_low", "_high"))
                                   and name.rpartition("_")[0] in data):
            continue
        unit = variable.attrs.get("units", "1")
        if "flag_meanings" in variable.attrs:
            unit = variable.attrs["flag_meanings"]
        elif unit == "rad" and "per unit of" in variable.attrs["long_name"]:
            unit = "rad per tau"
        found[name] = (dims, "" if unit == "1" else unit)
    return found


def spelled(unit, data):
    """An enumeration by the meanings of its codes; the parameter by its unit; a unit as it is."""
    if unit == "parameter":
        return quantities.parameter(data.attrs["parameter"]).units
    known = getattr(codes, unit, None) if unit.isidentifier() else None
    return unit if known is None else " ".join(code.name.lower() for code in known)


@pytest.mark.parametrize("what", CASES)
def test_the_variables_are_those_of_the_docstring(what):
    documented, results = CASES[what]()
    # A run has two Datasets.
    said = told(documented.__doc__, what.removesuffix("s") if documented is lapwing.Run else None)
    found = {name: one for data in results for name, one in there(data).items()}
    assert {name: (dims, spelled(unit, results[0]))
            for name, (dims, unit) in said.items()} == found
