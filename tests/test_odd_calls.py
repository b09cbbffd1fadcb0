"""Every public name, called with odd values for every argument in processes of their own."""

import inspect
import json
import subprocess
import sys
from pathlib import Path

import pytest

import lapwing
import odd_values

HERE = Path(__file__).parent
NAMES = list(odd_values.CASES)
# A few processes of many calls each: starting one takes longer than its calls.
BATCHES = [NAMES[i::2] for i in range(2)]


def run(names, which):
    """Output of one process that makes the calls of some cases."""
    return subprocess.run(
        [sys.executable, str(HERE / "odd_values.py"), json.dumps(names), which],
        capture_output=True, text=True, check=False, stdin=subprocess.DEVNULL)


def check(names, which):
    done = run(names, which)
    wrong = [line for line in done.stdout.splitlines() if not line.startswith("done ")]
    assert not wrong, "\n".join(wrong)
    assert done.returncode == 0, f"ended with {done.returncode}: {done.stdout[-200:]}{done.stderr}"
    assert done.stdout.split() == [word for name in names for word in ("done", name)]


@pytest.mark.parametrize("names", BATCHES, ids=lambda names: names[0])
def test_odd_calls_end_in_a_result_or_a_refusal_that_names_the_argument(names):
    check(names, "fast")


@pytest.mark.full
@pytest.mark.parametrize("names", BATCHES, ids=lambda names: names[0])
def test_every_odd_value(names):
    check(names, "full")


def test_every_public_name_has_a_case():
    called = {name.split(".")[0] for name in odd_values.CASES}
    assert set(lapwing.__all__) - odd_values.NOT_CALLED <= called


@pytest.mark.parametrize("name", sorted(set(lapwing.__all__) - odd_values.NOT_CALLED))
def test_a_name_that_nobody_has_is_answered(name):
    with pytest.raises(lapwing.ArgumentError, match=f"{name}: 'no_such_name' is unknown"):
        getattr(lapwing, name)(no_such_name=1)


@pytest.mark.parametrize("kind", ["TransmissionError", "GearPair", "Oscillator", "StartGrid"])
def test_every_public_method_has_a_case(kind):
    cls = getattr(lapwing, kind)
    methods = {name for name, member in vars(cls).items() if not name.startswith("_")
               and (inspect.isfunction(member) or isinstance(member, classmethod))}
    assert {f"{kind}.{name}" for name in methods} <= set(odd_values.CASES)


@pytest.mark.parametrize("name", [name for name in NAMES if name != "simulate.start"])
def test_every_argument_has_a_good_value(name):
    """An argument added to a function is tried with odd values too."""
    function, good = odd_values.CASES[name]
    named = {key for key, one in inspect.signature(function).parameters.items()
             if one.kind is not one.VAR_KEYWORD}
    assert named - set(good) <= {"numerics", "chatter_tol", "method", "rtol", "count_depth",
                                 "max_events_per_cycle", "max_steps_per_cycle", "records"}


@pytest.mark.parametrize("name", [name for name in NAMES
                                  if name not in ("TransmissionError.from_file",)])
def test_the_good_values_are_good(name):
    """Else every odd value would be refused on behalf of another argument."""
    function, good = odd_values.CASES[name]
    try:
        function(**good)
    except odd_values.NoOrbit:
        assert name in ("period_doubling", "cascade")


def test_a_fault_is_seen():
    """The judge of outcomes knows what it looks for."""
    def raises(error):
        def function(argument):
            raise error
        return odd_values.outcome(function, {"argument": 1}, "argument")

    assert raises(KeyError("argument")).startswith("KeyError")
    assert raises(OverflowError("too large")).startswith("OverflowError")
    assert raises(ValueError("something else")).startswith("no name")
    assert "characters" in raises(ValueError("argument" + "x" * 3000))
    assert raises(ValueError("argument = 1, expected 2")) is None


EXTREMES = """
import resource, sys
from dataclasses import replace
resource.setrlimit(resource.RLIMIT_AS, (3 << 30, 3 << 30))
sys.path.insert(0, {here!r})
import lapwing
from lapwing.base.arguments import LEAST, MAX_INT, MOST
from helpers import PAIR, SHIPPED
OSC = PAIR.oscillator(SHIPPED, brake_torque=12.5, pinion_speed_rpm=300)
for key, value in {extremes}:
    if key.endswith("teeth"):
        pair = replace(PAIR, **{{key: value}})
        osc = pair.oscillator(SHIPPED, brake_torque=1, pinion_speed_rpm=300)
    else:
        osc = replace(OSC, **{{key: value}})
    for method in ("auto", "rk4"):
        run = lapwing.simulate(osc, cycles=1, method=method, max_steps_per_cycle=2000,
                               max_events_per_cycle=100)
        print(key, value, method, run.status.name, flush=True)
"""
PARAMETERS = ("force", "mesh_frequency_ratio", "gear_ratio", "damping_ratio", "backlash")
ENDS = [(key, end) for key in PARAMETERS for end in ("LEAST", "MOST")] + [
    ("force", "-MOST"), ("force", "5e-324"), ("gear_teeth", "MAX_INT - 1"),
    ("pinion_teeth", "MAX_INT - 1")]


def test_the_ends_of_what_is_accepted_run_to_a_status():
    """What overflows beyond the checks of the arguments ends as a status of the run."""
    extremes = "[" + ", ".join(f"({key!r}, {end})" for key, end in ENDS) + "]"
    done = subprocess.run(
        [sys.executable, "-W", "ignore", "-c", EXTREMES.format(here=str(HERE), extremes=extremes)],
        capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout[-200:] + done.stderr[-2000:]
    assert len(done.stdout.splitlines()) == 2 * len(ENDS)
