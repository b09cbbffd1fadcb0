"""The odd values, and the calls they are put into: every public function, class and method.

Run as a program it makes one batch of calls in its own process, under a limit of memory, and
prints a line for each that ends in anything but a result or a clear refusal.
"""

from __future__ import annotations

import atexit
import contextlib
import json
import math
import os
import resource
import shutil
import sys
import tempfile
import warnings
from pathlib import Path

import numpy as np

import lapwing as lw
from lapwing.base.codes import MotionState
from lapwing.deck import DeckError
from lapwing.engine import Numerics
from lapwing.model.transmission_error.file import TransmissionErrorFileError
from lapwing.results.store import StoreError
from lapwing.studies.orbit import NoOrbit

MEMORY = 3 << 30
ODD = {
    "None": None, "True": True, "'1'": "1", "''": "", "nan": math.nan, "inf": math.inf,
    "-inf": -math.inf, "-1": -1, "0": 0, "1.5": 1.5, "2**31": 2**31, "2**63": 2**63,
    "10**400": 10**400, "1e308": 1e308, "5e-324": 5e-324, "1+1j": 1 + 1j, "[]": [],
    "[1, 2]": [1, 2], "{}": {}, "b'1'": b"1", "masked": np.ma.masked,
    "masked array": np.ma.masked_array([1.0, 2.0], mask=[True, False]),
    "nan array": np.array([np.nan, 1.0]), "object array": np.array([object(), None], dtype=object),
    "empty": np.empty(0), "0-d": np.array(0.5), "float32": np.float32(0.5), "int8": np.int8(3),
    "object": object(), "ragged": [[1.0], [1.0, 2.0]], "long": "x" * 10**6,
    "2-d": np.ones((2, 3)), "-0.0": -0.0, "-1e308": -1e308,
}
# Those that took the process down, or could not be told from a bug, before anything was checked.
FAST = ("None", "True", "'1'", "nan", "inf", "-1", "2**31", "10**400", "1e308", "5e-324", "1+1j",
        "[]", "masked", "object array")

TE = lw.TransmissionError.parabola(7.5e-5)
PAIR = lw.GearPair(25, 32, 7.8e-3, 1.24e-2, 0.0414, 3.12e8, 2e-3, 0.8, damping_ratio=0.07)
OSC = PAIR.oscillator(TE, brake_torque=12.5, pinion_speed_rpm=300)
RUN = lw.simulate(OSC, cycles=2)
# The bouncing ball of docs/model.md, at rest in its orbit of one impact a cycle.
ORBIT = lw.find_orbit(lw.Oscillator(
    lw.TransmissionError.harmonic([1.0]), force=1.0, mesh_frequency_ratio=1.0, restitution=0.7,
    backlash=1e3, damping_ratio=0.1), (0, -5.9, 1.2), settle=1)
BRANCH = lw.branch(ORBIT, ORBIT.oscillator.with_force, value=1.0, low=0.85, high=1.001)
RESPONSE = lw.engaged_response(OSC)
STATE = lw.settled_state(OSC, 3)
SHORT = {"settle": 1, "record": 1, "pinion_speed_rpm": 300}
GRID = lw.StartGrid(1, 1, 1)
ROWS = ([0.0, 0.25, 0.5, 0.75], [0.0, 1e-5, 2e-5, 1e-5])


# Where decks are run: gone with the process.
FOLDER = Path(tempfile.mkdtemp(prefix="lapwing-odd-"))
atexit.register(shutil.rmtree, FOLDER, ignore_errors=True)


def studied():
    """Folder of a map's shards."""
    lw.parameter_map(PAIR, TE, {"brake_torque": [12.0], "backlash": [1e-3]},
                     folder=FOLDER / "shards", **SHORT)
    return FOLDER / "shards"


DECK = FOLDER / "odd.nml"
DECK.write_text("""\
&gear_pair
  pinion_teeth = 25, gear_teeth = 32, pinion_inertia = 7.8e-3, gear_inertia = 1.24e-2
  pinion_base_lever = 0.0414, mesh_stiffness = 3.12e8, backlash = 2e-3, damping_ratio = 0.07
  restitution = 0.8
/
&transmission_error parabola_amplitude = 7.5e-5 /
&operation brake_torque = 12.5, pinion_speed_rpm = 300 /
&critical name = 'full', find = 'full' /
""", encoding="utf-8")
lw.run_deck(lw.load_deck(DECK), FOLDER / "r", figures="none")


def make(force):
    return OSC.with_force(force)


NUMERICS = {"method": "auto", "rtol": 1e-6, "chatter_tol": None, "count_depth": 0.01,
            "max_events_per_cycle": 1000, "max_steps_per_cycle": 10000}
OPERATION = {"brake_torque": 1.0, "drive_torque": None, "pinion_speed_rpm": 300,
             "pinion_speed_rad_s": None, "mesh_frequency_hz": None, "contact_law": "restitution",
             "impact_law": "relative", "gap": "one_sided", "back_flank_te": True,
             "te_sign": "printed"}
SCAN = {"pair": PAIR, "te": TE, "parameter": "brake_torque", "values": [12.0, 13.0],
        "safe_end": "high"}
STUDY = {"starts": GRID, "phase": 0.0, "numerics": None, "threads": 1, "progress": None, **SHORT}
# Every public name: what is called, and its good arguments, each of which is replaced in turn.
CASES = {
    "TransmissionError": (lw.TransmissionError, {
        "knots": [0.0, 1.0], "coefficients": np.zeros((1, 6)), "kinks": [False],
        "harmonics": (), "te_sign_hint": "printed"}),
    "TransmissionError.harmonic": (lw.TransmissionError.harmonic, {
        "amplitudes": [1e-5], "shifts": [0.0], "orders": [1]}),
    "TransmissionError.parabola": (lw.TransmissionError.parabola, {"amplitude": 1e-5}),
    "TransmissionError.from_hermite": (lw.TransmissionError.from_hermite, {
        "phase": ROWS[0], "value": ROWS[1], "slope_left": [0.0] * 4, "slope_right": [0.0] * 4}),
    "TransmissionError.from_samples": (lw.TransmissionError.from_samples, {
        "phase": ROWS[0], "value": ROWS[1], "kinks": [1, 0, 0, 0]}),
    "TransmissionError.from_tca": (lw.TransmissionError.from_tca, {
        "pinion_angle": [0.0, 0.1, 0.2], "gear_angle": [0.0, 0.078, 0.156], "pinion_teeth": 25,
        "gear_teeth": 32, "reference": (0.0, 0.0)}),
    "TransmissionError.from_file": (lw.TransmissionError.from_file, {
        "path": "/nowhere", "pinion_teeth": 25, "gear_teeth": 32, "reference": (0.0, 0.0)}),
    **{f"TransmissionError.{name}": (getattr(TE, name), {"phase": 0.3})
       for name in ("value",)},
    **{f"TransmissionError.{name}": (getattr(TE, name), {"phase": 0.3, "side": "right"})
       for name in ("slope", "curvature")},
    **{f"TransmissionError.{name}": (getattr(TE, name),
                                     {"order": 1, "phase": 0.3, "side": "right"})
       for name in ("derivative", "table_derivative")},
    "TransmissionError.slope_jumps": (TE.slope_jumps, {}),
    "GearPair": (lw.GearPair, {
        "pinion_teeth": 25, "gear_teeth": 32, "pinion_inertia": 7.8e-3, "gear_inertia": 1.24e-2,
        "pinion_base_lever": 0.0414, "mesh_stiffness": 3.12e8, "backlash": 2e-3,
        "restitution": 0.8, "damping_ratio": 0.07, "mesh_damping": None}),
    "GearPair.force": (PAIR.force, {"brake_torque": 1.0, "drive_torque": 1.0}),
    "GearPair.mesh_frequency": (PAIR.mesh_frequency, {
        "pinion_speed_rpm": 300, "pinion_speed_rad_s": None, "mesh_frequency_hz": None}),
    "GearPair.oscillator": (PAIR.oscillator, {"te": TE, "te_scale": 1.1, **OPERATION,
                                                 "degrees_of_freedom": 1}),
    "Oscillator": (lw.Oscillator, {
        "te": TE, "te_scale": 1.1, "force": 1e-4, "mesh_frequency_ratio": 0.5, "gear_ratio": 1.28,
        "damping_ratio": 0.07, "restitution": 0.8, "backlash": 2e-3,
        "contact_law": "restitution", "impact_law": "relative", "gap": "one_sided",
        "back_flank_te": True, "te_sign": "printed", "scales": None, "load": None,
        "mean_rotation": None}),
    "Oscillator.with_force": (OSC.with_force, {"force": 1e-4}),
    "engaged_response": (lw.engaged_response, {"osc": OSC}),
    "engaged_response.penetration": (RESPONSE.penetration, {"phase": 0.2, "order": 0}),
    "critical_force": (lw.critical_force, {"osc": OSC}),
    "critical_torque": (lw.critical_torque, {"osc": OSC}),
    "lift_off_force": (lw.lift_off_force, {"osc": OSC}),
    "Scales": (lw.Scales, {"natural_frequency": 8e3, "force_per_torque": 1e-5}),
    "TransmissionError.shifted": (TE.shifted, {"phase": 0.3}),
    "critical_full": (lw.critical_full, {**SCAN, "pinion_speed_rpm": 300}),
    "critical_on": (lw.critical_on, {**SCAN, "pinion_speed_rpm": 300, "contact_law": "rigid"}),
    "critical_safe": (lw.critical_safe, {**SCAN, **STUDY, "resolution": 0.3, "further": 0}),
    "critical_back": (lw.critical_back, {**SCAN, **STUDY, "confidence": 0.9}),
    "StartGrid": (lw.StartGrid, {"phases": 1, "positions": 1, "speeds": 1}),
    "simulate": (lw.simulate, {
        "osc": OSC, "start": "rest", "phase": 0.0, "cycles": 2, **NUMERICS,
        "observe": ("events",), "graze_distance": None}),
    "simulate.start": (lambda motion_state, phi, phi_dot: lw.simulate(
        OSC, (motion_state, phi, phi_dot), cycles=1),
        {"motion_state": 0, "phi": -1e-3, "phi_dot": 0.0}),
    "simulate.history": (RUN.history, {"taus": [0.0, 1.0]}),
    "sweep": (lw.sweep, {
        "pair": PAIR, "te": TE, "parameter": "brake_torque", "values": [12.0, 13.0],
        "starts": ("rest",), "observe": ("cycles",), "phase": 0.0, **NUMERICS,
        "max_impacts": 20, "threads": 1, "progress": None, "keep_interrupted": False, **SHORT}),
    "parameter_map": (lw.parameter_map, {
        "pair": PAIR, "te": TE, "axes": {"brake_torque": [12.0], "backlash": [1e-3]},
        "line": "backlash", "start": "up", "phase": 0.0, "numerics": None, "observe": ("rms",),
        "shard_runs": 1,
        "folder": FOLDER / "map", "executor": None, "threads": 1, "progress": None, "notes": None,
        "keep_interrupted": False, **SHORT}),
    "parameter_map.axes": (lambda backlash: lw.parameter_map(
        PAIR, TE, {"brake_torque": [12.0], "backlash": backlash}, settle=1, record=1,
        pinion_speed_rpm=300), {"backlash": [1e-3]}),
    "open_study": (lw.open_study, {"folder": studied()}),
    "Draw": (lw.Draw, {"law": "normal", "mean": 1.0, "deviation": 0.1, "mode": None, "low": 0.5,
                       "high": 2.0}),
    "ensemble": (lw.ensemble, {
        "pair": PAIR, "te": TE, "draws": {"backlash": lw.Draw("uniform", low=1e-3, high=2e-3)},
        "sampling": "random", "runs": 2, "scrambles": 16, "seed": 0, "correlation": [[1.0]],
        "sensitivity_draws": None, "phase": 0.0, "numerics": None, "shard_runs": 1,
        "folder": FOLDER / "ensemble", "executor": None, "threads": 1, "progress": None,
        "notes": None, "keep_interrupted": False, "brake_torque": 12.0, **SHORT}),
    "ensemble.draws": (lambda backlash: lw.ensemble(
        PAIR, TE, {"backlash": backlash}, settle=1, record=1, brake_torque=12.0,
        pinion_speed_rpm=300), {"backlash": [1e-3]}),
    "attractors": (lw.attractors, {
        "osc": OSC, "starts": "random", "runs": 2, "scrambles": 16, "seed": 0, "phi": (-1e-4, 1e-5),
        "phi_dot": (-1e-5, 1e-5), "phase": 0.0, "most_cycles": 20, "returns": 3, "recurrences": 5,
        "resolution": 16, "numerics": None, "threads": 1, "progress": None}),
    "attractors_along": (lw.attractors_along, {
        "pair": PAIR, "te": TE, "values": [12.0], "parameter": "brake_torque", "runs": 2, "seed": 0,
        "phi": (-1e-4, 1e-5), "phi_dot": (-1e-5, 1e-5), "phase": 0.0, "most_cycles": 20,
        "returns": 3, "recurrences": 5, "resolution": 16, "numerics": None, "threads": 1,
        "progress": None, "keep_interrupted": False, "pinion_speed_rpm": 300}),
    "basins": (lw.basins, {
        "osc": OSC, "plane": "state", "size": 2, "phi": (-1e-4, 1e-5), "phi_dot": (-1e-5, 1e-5),
        "phase": 0.0, "speed": None, "most_cycles": 20, "returns": 3, "recurrences": 5,
        "resolution": 16, "numerics": None, "shard_runs": 1, "folder": FOLDER / "basins",
        "executor": None, "threads": 1, "progress": None, "notes": None,
        "keep_interrupted": False}),
    "find_orbit": (lw.find_orbit, {"osc": OSC, "start": STATE, "cycles": 1, "settle": 3}),
    "exponents": (lw.exponents, {"osc": OSC, "start": "rest", "phase": 0.0, "settle": 1,
                                 "record": 2}),
    "response": (lw.response, {
        "osc": OSC, "pair": PAIR, "name": "one", "start": "rest", "phase": 0.0, "settle": 1,
        "record": 2, "samples_per_cycle": 8, "exponents": False, "max_period": 1, "order": 0,
        "claim_impacts_per_cycle": 1.0, "claim_deepest_separation": 1e-4, "claim_text": "two",
        **NUMERICS}),
    "follow": (lw.follow, {"make": make, "values": [OSC.force], "start": STATE, "cycles": 1}),
    "period_doubling": (lw.period_doubling, {
        "make": make, "low": OSC.force, "high": OSC.force * 1.01, "start": STATE, "cycles": 1}),
    "cascade": (lw.cascade, {
        "make": make, "low": OSC.force, "high": OSC.force * 1.01, "start": STATE,
        "doublings": 1, "cycles": 1, "settle": 2}),
    "branch": (lw.branch, {"orbit": ORBIT, "parameter": ORBIT.oscillator.with_force,
                           "value": 1.0, "low": 0.999, "high": 1.001, "points": 3,
                           "unstable": None}),
    "branches": (lw.branches, {
        "pair": PAIR, "te": TE, "parameter": "brake_torque", "low": 12.4, "high": 12.6, "seeds": 2,
        "starts": GRID, "random_starts": 1, "random_seed": 0, "highest_period": 2, "threads": 1,
        "settle": 1, "doublings": 0, "points": 2, "unstable": 1, "progress": None,
        "rattling_cycles": 4000,
        "pinion_speed_rpm": 300}),
    "curve": (lw.curve, {
        "branch": BRANCH, "special": BRANCH.specials[1], "low": -0.01, "high": 0.01, "value": 0.0,
        "points": 2, "second": lambda force, more: ORBIT.oscillator.with_force(force + more)}),
    "settled_state": (lw.settled_state, {"osc": OSC, "cycles": 2, "start": "rest"}),
    "load_deck": (lw.load_deck, {"path": DECK, "overrides": [("operation.brake_torque", "2")]}),
    "run_deck": (lw.run_deck, {"deck": lw.load_deck(DECK), "parent": FOLDER / "r", "threads": 1,
                               "force": False, "progress": None, "figures": "none",
                               "executor": None}),
    "open_results": (lw.open_results, {"path": FOLDER / "r" / "odd" / "result.nc", "check": True}),
    "Numerics": (Numerics, {**NUMERICS, "copy_repeats": True}),
}
# Enumerations and errors are Python's own; a version is a text; a bar is a context.
# Results are made by calls.
RESULTS = {"Branch", "CriticalForce", "CriticalValue", "Curve", "CycleMaps", "Deck",
           "EngagedResponse", "Exponents", "Followed", "HybridState", "LapwingAccessor", "LiftOff",
           "Load", "MeanRotation", "Meeting", "Multipliers", "Orbit", "Outcome", "Point", "Results",
           "Run", "Special"}
NOT_CALLED = {"ArgumentError", "BranchOutcome", "DeckError", "Ending", "EventKind", "MotionState",
              "NoOrbit", "ParameterError", "SearchStage", "SpecialPoint", "Status", "__version__",
              "progress_bar", *RESULTS}
# What a call may end in besides a result, TypeError and ValueError: documented at its place.
ALLOWED = (NoOrbit, OSError, TransmissionErrorFileError, DeckError, StoreError)


def batch(name, labels):
    """Every wrong outcome of one case: each argument replaced by each of the labelled values."""
    function, good = CASES[name]
    for argument in good:
        for label in labels:
            fault = outcome(function, {**good, argument: ODD[label]}, argument)
            if fault:
                yield f"{name}({argument} = {label}): {fault}"


def outcome(function, arguments, argument):
    """What is wrong with how a call ends, or None."""
    try:
        with warnings.catch_warnings(), contextlib.suppress(*ALLOWED), np.errstate(all="ignore"):
            warnings.simplefilter("ignore")
            function(**arguments)
    except (TypeError, ValueError) as error:
        said = str(error)
        if len(said) > 2000:
            return f"a message of {len(said)} characters"
        # A refusal names the argument, or the whole that it is part of.
        words = (argument, argument.rstrip("s"), argument.split("_")[0])
        return None if any(word in said for word in words) else f"no name in {said[:120]!r}"
    except Exception as error:  # every other kind is what is looked for
        return f"{type(error).__name__}: {str(error)[:120]}"
    return None


if __name__ == "__main__":
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
    assert MotionState(0) == 0
    os.chdir(FOLDER)  # where a text is a path, something is written there
    for wanted in json.loads(sys.argv[1]):
        for line in batch(wanted, FAST if sys.argv[2] == "fast" else tuple(ODD)):
            print(line, flush=True)
        print(f"done {wanted}", flush=True)
