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
BATCHES = [NAMES[i::4] for i in range(4)]


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
                                 "max_events_per_cycle", "max_steps_per_cycle"}


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
