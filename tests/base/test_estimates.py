"""Memory: the bounds against what studies take, the limits known, and the refusals."""

import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

import children
from lapwing import (
    GearPair,
    TransmissionError,
    critical_back,
    simulate,
    sweep,
)
from lapwing.base import estimates, exit_codes
from lapwing.base.estimates import available_bytes, refusal, response_bytes, spell, sweep_bytes
from lapwing.cli import app
from lapwing.deck import load_deck
from lapwing.engine import calls
from lapwing.results.variables import described
from lapwing.run import run_deck
from lapwing.studies.critical.starts import StartGrid
from lapwing.studies.response.run import response

PLAIN = (Path(__file__).parents[1] / "deck" / "accepted" / "plain.nml").read_text(encoding="utf-8")
LARGE = PLAIN + ("&sweep name = 'large' parameter = 'brake_torque' from = 1 to = 2 count = 100000 "
                 "settle_cycles = 0 record_cycles = 100000 /\n")
# (work, bytes of its tables); run once small and once large in children of their own.
CHILD = """
import resource, sys
from lapwing import GearPair, TransmissionError, sweep
from lapwing.studies.response.run import response
pair = GearPair(25, 32, .0078, .026, .034, 3.12e8, .002, .8, damping_ratio=.1)
te = TransmissionError.parabola(125e-6)
{work}
with open("/proc/self/status") as file:
    # Not ru_maxrss: that also counts the process that began this one.
    print(1024 * next(int(line.split()[1]) for line in file if line.startswith("VmHWM")))
"""


def peak(work):
    return int(children.carried_out(CHILD.format(work=work)).said)


SWEEP = ("sweep(pair, te, parameter='brake_torque', values=[1.0 + i for i in range({})], "
         "starts=['rest'], settle=0, record={}, pinion_speed_rpm=240., observe={}, threads=1)")
RESPONSE = ("response(pair.oscillator(te, brake_torque=30., pinion_speed_rpm=240.), pair, "
            "name='a', record={}, settle=1, samples_per_cycle=4000)")


@pytest.mark.parametrize(("small", "large", "bound"), [
    (SWEEP.format(2, 10, ("cycles",)), SWEEP.format(40, 20_000, ("cycles",)),
     sweep_bytes(40, 20_000)),
    pytest.param(RESPONSE.format(2), RESPONSE.format(400), response_bytes(400, 4000),
                 marks=pytest.mark.full),
], ids=["cycles", "response"])
def test_the_peak_lies_between_the_bound_and_four_times_it(small, large, bound):
    assert bound > 1e8
    taken = peak(large) - peak(small)
    assert 0.95 * bound < taken < 4 * bound, taken / bound


def test_columns_are_the_engines():
    assert (estimates.CYCLE, estimates.TANGENT, estimates.LOG, estimates.SAMPLE) == (
        calls.CYCLE_COLUMNS, calls.TANGENT_COLUMNS, calls.LOG_COLUMNS, calls.SAMPLE_COLUMNS)


def test_too_large_is_refused_before_work(tmp_path):
    deck = tmp_path / "deck.nml"
    deck.write_text(LARGE, encoding="utf-8")
    for command in (["check", str(deck)], ["run", str(deck), "--out", str(tmp_path / "out")]):
        done = CliRunner().invoke(app, command)
        assert done.exit_code == 2
        assert f"{deck}: &sweep 'large' needs at least 4.08 TB of memory, " in done.stderr
        assert "lower record_cycles, the number of values" in done.stderr
        assert len(done.stderr.splitlines()) == 1
    assert not (tmp_path / "out").exists()


def test_python_calls_are_refused_alike():
    pair = GearPair(25, 32, .0078, .026, .034, 3.12e8, .002, .8, damping_ratio=.1)
    te = TransmissionError.parabola(125e-6)
    with pytest.raises(MemoryError, match=r"sweep: needs at least 1.36 TB .*; lower values"):
        sweep(pair, te, parameter="brake_torque", values=np.arange(1.0, 101.0), starts=["rest"],
              record=10**8, observe=["cycles"], pinion_speed_rpm=240.0)
    osc = pair.oscillator(te, brake_torque=1.8, pinion_speed_rpm=240.0)
    with pytest.raises(MemoryError, match=r"response: needs at least .*; lower record_cycles"):
        response(osc, pair, name="a", record=10**8)


@pytest.mark.parametrize(("files", "left"), [
    ({}, None),
    ({"proc/meminfo": "MemTotal: 9 kB\nMemAvailable:  5 kB\nSwapFree: 2 kB\n"}, 7 * 1024),
    ({"proc/meminfo": "MemAvailable: 5 kB\n", "proc/self/cgroup": "0::/a/b\n",
      "sys/fs/cgroup/a/b/memory.max": "max\n", "sys/fs/cgroup/a/b/memory.current": "10\n",
      "sys/fs/cgroup/a/memory.max": "1000\n", "sys/fs/cgroup/a/memory.current": "300\n",
      "sys/fs/cgroup/a/memory.stat": "anon 1\nfile 50\n"}, 750),
    ({"proc/self/cgroup": "5:cpu:/x\n4:memory:/x\n",
      "sys/fs/cgroup/memory/x/memory.limit_in_bytes": "2000\n",
      "sys/fs/cgroup/memory/x/memory.usage_in_bytes": "2500\n",
      "sys/fs/cgroup/memory/memory.limit_in_bytes": f"{2**63 - 4096}\n",
      "sys/fs/cgroup/memory/memory.usage_in_bytes": "1\n"}, 0),
])
def test_limits_known_to_the_system(tmp_path, monkeypatch, files, left):
    monkeypatch.setattr(estimates, "_of_address_space", lambda root: [])
    for name, text in files.items():
        path = tmp_path / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")
    assert available_bytes(tmp_path) == left


def test_the_limit_of_the_address_space_is_known():
    code = ("import resource; resource.setrlimit(resource.RLIMIT_AS, (3 * 10**8, -1));"
            "from lapwing.base.estimates import available_bytes; print(available_bytes())")
    done = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True)
    assert 0 < int(done.stdout) < 3e8


def test_words():
    assert refusal(10**9, "x", 10**9) == ""
    assert refusal(37 * 10**11, "record", 16 * 10**9) == (
        "needs at least 3.7 TB of memory, 16 GB are available; lower record")
    assert [spell(n) for n in (0, 999, 1000, 10**6, 2 * 10**18)] == [
        "0 bytes", "999 bytes", "1 kB", "1 MB", "2e+03 PB"]


# --- disk -------------------------------------------------------------------------------------


@pytest.mark.full
def test_disk_between_the_bounds(tmp_path):
    """What a run leaves: more than the least, and no more than tables, figures and a little."""
    deck = tmp_path / "deck.nml"
    deck.write_text(PLAIN, encoding="utf-8")
    least, tables = estimates.disk_bytes(load_deck(deck, []))
    run_deck(load_deck(deck, []), tmp_path / "out")
    files = {path.name: path.stat().st_size for path in (tmp_path / "out" / "deck").iterdir()}
    assert least < sum(files.values())
    # The log of events, and what a file of groups and attributes takes by itself.
    assert files["result.nc"] < tables + 1_000_000


def test_tables_are_counted_as_they_are_stored():
    pair = GearPair(25, 32, .0078, .026, .034, 3.12e8, .002, .8, damping_ratio=.1)
    te = TransmissionError.parabola(125e-6)
    osc = pair.oscillator(te, brake_torque=30., pinion_speed_rpm=240.)
    one = described(response(osc, pair, name="a", record=3, settle=1))
    samples = sum(v.dtype.itemsize for v in one.variables.values() if v.dims == ("sample",))
    assert samples == estimates.STORED_SAMPLE
    cycles = described(sweep(pair, te, parameter="brake_torque", values=[30.], starts=["rest"],
                             settle=0, record=3, observe=["cycles"], pinion_speed_rpm=240.))
    stored = sum(v.dtype.itemsize for v in cycles.data_vars.values() if "recorded_cycle" in v.dims)
    assert stored == estimates.STORED_CYCLE


def test_a_disk_that_is_too_small_is_refused_before_work(tmp_path, monkeypatch, capsys):
    deck = tmp_path / "deck.nml"
    deck.write_text(PLAIN, encoding="utf-8")
    loaded = load_deck(deck, [])
    least, _ = estimates.disk_bytes(loaded)
    assert f"; disk at least {spell(least)}, and up to " in estimates.stated(loaded)
    estimates.require_disk(loaded, tmp_path / "not" / "there", least)
    with pytest.raises(OSError, match=r"no space: results take at least .* of disk") as caught:
        estimates.require_disk(loaded, tmp_path / "not" / "there", least - 1)
    assert exit_codes.of_error(caught.value) == exit_codes.ExitCode.SURROUNDINGS
    full = shutil.disk_usage(tmp_path)._replace(free=1000)
    monkeypatch.setattr(estimates.shutil, "disk_usage", lambda path: full)
    monkeypatch.setattr("lapwing.studies.of_deck.compute",
                        lambda *_, **__: pytest.fail("it worked"))
    with pytest.raises(OSError, match="1 kB are free"):
        run_deck(loaded, tmp_path / "out", threads=1)
    assert not (tmp_path / "out" / "deck").exists()


def test_single_calls_are_refused_alike():
    pair = GearPair(25, 32, .0078, .026, .034, 3.12e8, .002, .8, damping_ratio=.1)
    te = TransmissionError.parabola(125e-6)
    osc = pair.oscillator(te, brake_torque=1.8, pinion_speed_rpm=240.0)
    with pytest.raises(MemoryError, match=r"simulate: needs at least 272 GB .*; lower cycles"):
        simulate(osc, cycles=2e9)
    given = {"values": [2.0, 3.0], "pinion_speed_rpm": 240.0}
    with pytest.raises(MemoryError, match=r"critical: needs at least .*; lower record"):
        critical_back(pair, te, record=2 * 10**9, **given)
    with pytest.raises(MemoryError, match=r"critical: needs at least .*; lower start"):
        critical_back(pair, te, starts=StartGrid(1000, 1000, 1000), **given)
