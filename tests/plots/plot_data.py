"""Result files for the tests of the figures: small, and one for each kind of motion."""

import numpy as np

from helpers import PAIR, SHIPPED, as_in_a_deck, scene_a, scene_d
from lapwing import (
    StartGrid,
    TransmissionError,
    critical_back,
    critical_full,
    critical_on,
    critical_safe,
    sweep,
)
from lapwing.engine import Numerics
from lapwing.results import read_results, write_results
from lapwing.studies.response.run import response

SHORT = {"settle": 40, "record": 20, "samples_per_cycle": 200, "rtol": 1e-6}
CLAIM = {"claim_impacts_per_cycle": 3, "claim_deepest_separation": 0.00063,
         "claim_text": "3 impacts per cycle"}
RESPONSES = {
    # name: oscillator, further arguments
    "periodic": (scene_a(1.8), {**CLAIM}),
    "aperiodic": (scene_a(0.8), {"settle": 5}),
    "engaged": (scene_a(14), {"settle": 80}),
    "rigid": (scene_a(3.3, "relative", contact_law="rigid"), {}),
    "rigid_engaged": (scene_a(1000, "relative", contact_law="rigid"), {}),
    "chatter": (scene_d(5.5), {}),
    "compliant": (scene_a(1.8, "relative", contact_law="compliant"), {}),
    "one_flank": (scene_a(1.8, "relative", gap="one_flank"), {}),
    "standing": (scene_a(0.2, "relative", back_flank_te=False), {}),
    "failed": (scene_d(5.5), {"max_events_per_cycle": 3}),
    "single_cycle": (scene_a(1.8), {"record": 1}),
}
CURVES = {
    "table": SHIPPED, "kinked": TransmissionError.parabola(125e-6),
    "harmonic": TransmissionError.harmonic([17e-6], [0.0], [1]),
    "flat": TransmissionError.from_hermite([0.0], [0.0], [0.0])}


def make_sweeps():
    """A normal one, one that fails, one of another parameter, one without impacts and exponents."""
    options = {"settle": 30, "record": 20, "impact_law": "absolute", "pinion_speed_rpm": 240}
    impacts = {"max_impacts": 60,
               "observe": ("cycles", "impacts", "exponents", "speeds", "spectra", "amplitudes")}
    speed = {key: options[key] for key in ("settle", "record", "impact_law")}
    return {
        "torque": as_in_a_deck(sweep(PAIR, SHIPPED, values=np.linspace(1, 14, 14), **impacts,
                                     **options)),
        "failed": as_in_a_deck(sweep(PAIR, SHIPPED, values=[1.0, 12.0, 14.0],
                                     max_events_per_cycle=2, **impacts, **options)),
        "speed": sweep(PAIR, SHIPPED, parameter="pinion_speed_rpm", brake_torque=3.3,
                       values=[100, 200, 400], **impacts, **speed),
        "plain": as_in_a_deck(sweep(PAIR, SHIPPED, values=[5.0, 14.0], starts=("rest",),
                                    **options))}


def make_criticals():
    """Each search once, and searches that find nothing or fail."""
    law = {"impact_law": "absolute"}
    short = {"settle": 30, "record": 10, "pinion_speed_rpm": 240, **law}
    return {
        "full": critical_full(PAIR, SHIPPED, pinion_speed_rpm=240, **law),
        "speed": critical_full(PAIR, SHIPPED, parameter="pinion_speed_rpm", brake_torque=12,
                               values=np.arange(100, 401, 50), safe_end="low",
                               **law).assign_attrs(own_operation=1),
        "safe": critical_safe(PAIR, SHIPPED, values=[12, 12.5, 13], resolution=0.1, further=1,
                              starts=StartGrid(2, 2, 2), **short),
        "all_safe": critical_safe(PAIR, SHIPPED, values=[13, 14], starts=StartGrid(1, 1, 1),
                                  **short),
        "failing": critical_safe(PAIR, SHIPPED, values=[12.6, 13], starts=StartGrid(1, 1, 1),
                                 numerics=Numerics(max_events_per_cycle=2), **short),
        # At 0.7 N·m one cycle in seventy has a back impact: some are in as many as these.
        "back": critical_back(PAIR, SHIPPED, values=[0.6, 0.7, 0.9, 1.1],
                              starts=StartGrid(1, 1, 1), **(short | {"record": 600})),
        "no_back": critical_back(PAIR, SHIPPED, values=[5, 6], starts=StartGrid(1, 1, 1), **short),
        "on": critical_on(PAIR, TransmissionError.parabola(5e-5), contact_law="rigid",
                          pinion_speed_rpm=240)}


def make_results(folder, responses=tuple(RESPONSES), sweeps=None, criticals=None):
    """Write a result file with everything in it, or what is given; returns it open."""
    found = [response(osc, PAIR, name=name, **(SHORT | options))
             for name, (osc, options) in RESPONSES.items() if name in responses]
    write_results(folder / "result.nc", deck_name="test", deck_text="", used_text="",
                  used_hash="0", pair=PAIR, te=SHIPPED, te_sign="printed", found={
                      "response": {one.attrs["name"]: one for one in found},
                      "sweep": make_sweeps() if sweeps is None else sweeps,
                      "critical": make_criticals() if criticals is None else criticals})
    return read_results(folder / "result.nc")


def make_curve(folder, name):
    """Group `transmission_error` of a file with another curve."""
    te = CURVES[name]
    write_results(folder / f"{name}.nc", deck_name="test", deck_text="", used_text="",
                  used_hash="0", pair=PAIR, te=te, found={},
                  te_sign="printed")
    return read_results(folder / f"{name}.nc")
