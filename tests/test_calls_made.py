"""What short calls do in Python, counted: set-up that grows with points or calls fails here.

Function calls depend neither on the machine nor on what else it does. Times are measured by
`lapwing bench --calls`.
"""

import sys
from contextlib import contextmanager
from types import SimpleNamespace

import numpy as np
import pytest

import lapwing
from helpers import PAIR, SHIPPED
from lapwing.engine import calls

SMOOTH = lapwing.TransmissionError.harmonic([5e-5])


@contextmanager
def counted():
    """Python functions begun, calls into the engine, oscillators and xarray Datasets checked."""
    found = SimpleNamespace(python=0, engine=0, oscillators=0, datasets=0)
    names = {lapwing.Oscillator.__post_init__.__code__: "oscillators"}
    import xarray as xr

    names[xr.Dataset.__init__.__code__] = "datasets"
    api = calls.api

    class Counting:
        def __getattr__(self, name):
            found.engine += 1
            return getattr(api, name)

    def seen(frame, event, _):
        if event == "call":
            found.python += 1
            kind = names.get(frame.f_code)
            if kind:
                setattr(found, kind, getattr(found, kind) + 1)

    calls.api = Counting()
    sys.setprofile(seen)
    try:
        yield found
    finally:
        sys.setprofile(None)
        calls.api = api


def sweep(torques):
    return lapwing.sweep(PAIR, SMOOTH, values=torques, starts=("rest",), settle=0, record=50,
                         threads=1, mesh_frequency_hz=300.0, contact_law="compliant")


@pytest.fixture(scope="module")
def few():
    """A sweep of four torques after one of four others."""
    sweep([9.0, 10.0, 11.0, 12.0])
    with counted() as found:
        sweep([8.0, 9.5, 11.0, 12.5])
    return found


def test_a_sweep_takes_no_python_for_each_point(few):
    with counted() as many:
        sweep(np.linspace(8.0, 12.5, 300))
    # The same calls, to what NumPy does otherwise with more numbers.
    assert abs(many.python - few.python) <= 20
    assert (many.engine, many.oscillators, many.datasets) == (1, 0, 0)


def test_what_is_the_same_is_made_once(few):
    """Of a second sweep of the pair nothing is made or checked again but what is new in it.

    536 functions of Python were called when this was written, xarray's and NumPy's own among them,
    and 2593 before; an oscillator made anew is 150, a Dataset whose parts are checked 2000.
    """
    assert (few.engine, few.oscillators, few.datasets) == (1, 0, 0)
    assert few.python < 650


def test_a_prepared_oscillator_is_set_up_once():
    osc = PAIR.oscillator(SHIPPED, brake_torque=3.3, pinion_speed_rpm=240, impact_law="absolute")
    lapwing.simulate(osc, cycles=50)
    with counted() as found:
        run = lapwing.simulate(osc, phase=0.25, cycles=50)
    assert (found.engine, found.oscillators, found.datasets) == (1, 0, 0)
    assert found.python < 120
    assert len(run.events.tau) and len(run.cycles.cycle)
    other = lapwing.simulate(osc, phase=0.5, cycles=50)
    with counted() as found:
        assert len(other.events.tau) and len(other.cycles.cycle)
    assert (found.engine, found.datasets) == (0, 0)
