"""Maps: the numbers of sweeps, whatever the cut, and nothing lost between processes."""

import errno
import os
import subprocess
import sys
import time
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path

import numpy as np
import pytest

import children
import lapwing
from helpers import ROOT, dataset_bytes
from lapwing import Numerics, Status, TransmissionError, engine, parameter_map, sweep
from lapwing.base import estimates
from lapwing.engine import Wanted
from lapwing.results import shards as stored
from lapwing.results.shards import Shard, discard_shards, read_shard, shard_path, shards_in
from lapwing.studies.map import shards
from lapwing.studies.map.cut import Cut, shard_size, shared_size
from lapwing.studies.map.observed import KEPT
from lapwing.studies.map.run import job_of
from lapwing.studies.map.work import Found, missing_of
from lapwing_bench.scenes import PAIR

TE = TransmissionError.harmonic([17e-6, 4.5e-6, 1.5e-6], [0.0, 1.0, 2.0], [1, 2, 3])
AXES = {"pinion_speed_rpm": [900.0, 1500.0, 2400.0], "brake_torque": np.linspace(0.5, 13, 11)}
SETTLE, RECORD = 60, 40


def mapped(axes=None, **options):
    return parameter_map(PAIR, TE, AXES if axes is None else axes,
                         **{"settle": SETTLE, "record": RECORD, "threads": 2, **options})


def numbers_of(found):
    return dataset_bytes(found.drop_attrs())


@pytest.fixture
def every_bounce(monkeypatch):
    """Maps follow bounce after bounce, as sweeps do."""
    monkeypatch.setattr(shards, "wanted", lambda _: Wanted(cycles=True))


@pytest.mark.parametrize("start", ["rest", "up", "down"])
@pytest.mark.parametrize("law", ["restitution", "compliant"])
def test_a_column_is_a_sweep(start, law, every_bounce):
    found = mapped(start=start, line="brake_torque", contact_law=law)
    assert found["status"].dims == tuple(AXES)
    for speed in AXES["pinion_speed_rpm"]:
        column = found.sel(pinion_speed_rpm=speed)
        one = sweep(PAIR, TE, values=AXES["brake_torque"], starts=(start,), settle=SETTLE,
                    record=RECORD, pinion_speed_rpm=speed, contact_law=law).isel(start=0)
        assert np.array_equal(column["period"], one["period"])
        for name in ("deepest_separation", "deepest_back_penetration"):
            assert np.array_equal(column[name], one[name].max("recorded_cycle"))
        counts = ("counted_impacts", "engages")[law == "compliant"]
        for value in AXES["brake_torque"]:
            run, cycles = column.sel(brake_torque=value), one.sel(brake_torque=value)
            last = int(run["period"]) or RECORD
            assert float(run["arrivals"]) == float(cycles[counts][-last:].sum())
            assert float(run["impacts_per_cycle"]) == float(run["arrivals"]) / last
    assert len(np.unique(found["period"])) > 1


def test_bounces_that_do_not_count_are_summed_early(request):
    """What is kept of a map stays: counts, and extremes to the tolerance of a chatter's end.

    The gear with a kinked parabola, whose chatters are geometric series, where it has a period:
    chaos takes another course with every rounding.
    """
    te = TransmissionError.parabola(125e-6)
    axes = {"pinion_speed_rpm": [480.0, 900.0], "brake_torque": np.linspace(4, 12, 9)}
    found = [parameter_map(PAIR, te, axes)]
    request.getfixturevalue("every_bounce")
    found.append(parameter_map(PAIR, te, axes))
    early, singly = (one.where(found[1]["period"] > 0, drop=False) for one in found)
    assert int(((found[1]["chatter"] > 0) & (found[1]["period"] > 0)).sum()) >= 5
    for name in KEPT:
        exact = KEPT[name] is not float
        # Each end of a chatter is right to 1e-13 periods, and what follows forgets it.
        np.testing.assert_allclose(early[name], singly[name], rtol=0 if exact else 1e-10,
                                   atol=0)


def test_where_every_impact_counts_none_is_summed_early(request):
    axes = {"pinion_speed_rpm": [1500.0], "brake_torque": np.linspace(3, 9, 7)}
    early = mapped(axes, numerics=Numerics(count_depth=0.0))
    request.getfixturevalue("every_bounce")
    singly = mapped(axes, numerics=Numerics(count_depth=0.0))
    assert early["chatter"].any() and dataset_bytes(early) == dataset_bytes(singly)
    summed = mapped(axes)
    assert summed["chatter"].any() and int(early["arrivals"].sum()) > int(summed["arrivals"].sum())


def test_other_axes_and_more_than_two(every_bounce):
    axes = {"backlash": [1e-4, 2e-3], "brake_torque": [0.5, 3.0], "restitution": [0.2, 0.8]}
    found = mapped(axes, pinion_speed_rpm=1500.0)
    assert found["period"].shape == (2, 2, 2)
    one = sweep(lapwing.GearPair(**{**vars(PAIR), "backlash": 1e-4, "restitution": 0.2}), TE,
                values=[0.5, 3.0], starts=("rest",), settle=SETTLE, record=RECORD,
                pinion_speed_rpm=1500.0)
    assert np.array_equal(found["deepest_separation"].values[0, :, 0],
                          one["deepest_separation"].max("recorded_cycle").values[0])


@pytest.mark.parametrize("start", ["rest", "up", "down"])
def test_no_number_depends_on_the_cut(start, tmp_path):
    expected = numbers_of(mapped(start=start, threads=1))
    for size, threads, folder in ((1, 2, None), (5, 2, tmp_path / "a"), (33, 1, tmp_path / "b"),
                                  (1000, 4, None)):
        found = mapped(start=start, shard_runs=size, threads=threads, folder=folder)
        assert numbers_of(found) == expected


def test_a_run_is_moved_as_it_would_be_alone():
    """Without damage an undamped resonance wants RK4; the runs beside it stay in closed form."""
    pair = lapwing.GearPair(**{**vars(PAIR), "damping_ratio": 0.0})
    resonance = pair.natural_frequency / (2 * np.pi)
    axes = {"mesh_frequency_hz": resonance * np.array([0.7, 1.0 + 1e-5, 1.4]),
            "brake_torque": [3.0, 9.0]}
    options = {"settle": 5, "record": 5}
    whole = parameter_map(pair, TE, axes, **options)
    for value in axes["mesh_frequency_hz"]:
        column = parameter_map(pair, TE, {**axes, "mesh_frequency_hz": [value]}, **options)
        assert np.array_equal(whole["deepest_separation"].sel(mesh_frequency_hz=[value]),
                              column["deepest_separation"])


def test_what_is_finished_is_kept_and_gone_on_with(tmp_path):
    """Ctrl-C at several places; in the end the numbers of a map that nobody stopped."""
    expected = numbers_of(mapped(shard_runs=3))
    for place in (0.2, 0.6):
        def stop(fraction, place=place):
            if fraction > place:
                raise KeyboardInterrupt
        part = mapped(shard_runs=3, folder=tmp_path, progress=stop, keep_interrupted=True)
        open_ = part["status"].values == Status.UNFINISHED
        assert part.attrs["interrupted"] == 1 and 0 < open_.sum() < open_.size
        assert np.isnan(part["deepest_separation"].values[open_]).all()
        lying = {index: shard_path(tmp_path, index).read_bytes() for index in shards_in(tmp_path)}
        assert lying and len(lying) < 11
    done = mapped(shard_runs=3, folder=tmp_path, notes=pytest.fail)
    assert numbers_of(done) == expected and done.attrs["interrupted"] == 0
    assert all(shard_path(tmp_path, index).read_bytes() == was for index, was in lying.items())
    with pytest.raises(KeyboardInterrupt):
        mapped(progress=stop)
    discard_shards(tmp_path)
    assert not tmp_path.exists()


def _cut(path):
    path.write_bytes(path.read_bytes()[:-100])


def _empty(path):
    path.write_bytes(b"")


def _other_place(path):
    path.write_bytes(shard_path(path.parent, 2).read_bytes())


def _no_file(path):
    path.unlink()
    path.mkdir()
    path.rmdir()


@pytest.mark.parametrize(("harm", "said"), [
    (_cut, "shard 1 "), (_empty, "shard 1 cannot be read"),
    (_other_place, "shard 1 is of another"), (_no_file, "")])
def test_what_is_no_good_is_made_again_and_said(harm, said, tmp_path):
    expected = dataset_bytes(mapped(shard_runs=9, folder=tmp_path))
    harm(shard_path(tmp_path, 1))
    notes = []
    assert dataset_bytes(mapped(shard_runs=9, folder=tmp_path, notes=notes.append)) == expected
    assert len(notes) == bool(said) and all(note.startswith(said) for note in notes)
    assert all(note.endswith(": made again") for note in notes)


@pytest.mark.parametrize("places", [40, pytest.param(4000, marks=pytest.mark.full)])
def test_a_flipped_bit_is_noticed_or_changes_no_number(places, tmp_path):
    mapped(shard_runs=9, folder=tmp_path)
    path = shard_path(tmp_path, 1)
    whole, random = path.read_bytes(), np.random.default_rng(places)
    import netCDF4

    with netCDF4.Dataset(path) as file:
        told = {name: file.getncattr(name) for name in ("inputs", "first", "stop")}
    good, _ = read_shard(tmp_path, 1, told)
    noticed = 0
    for at in random.integers(0, 8 * len(whole), places):
        content = bytearray(whole)
        content[at // 8] ^= 1 << at % 8
        path.write_bytes(content)
        found, why = read_shard(tmp_path, 1, told)
        noticed += found is None
        assert (found is None) == bool(why)
        assert found is None or all(np.array_equal(found.data[name], values, equal_nan=True)
                                    for name, values in good.data.items())
    assert noticed > 0.02 * places  # most of so small a file is room that nothing is kept in


@pytest.mark.parametrize("change", [
    {"settle": SETTLE + 1}, {"contact_law": "compliant"}, {"numerics": Numerics(rtol=1e-7)},
    {"shard_runs": 10}, {"phase": 0.25}])
def test_shards_of_other_values_are_not_mixed(change, tmp_path):
    mapped(shard_runs=9, folder=tmp_path)
    notes = []
    found = mapped(**{"shard_runs": 9, **change}, folder=tmp_path, notes=notes.append)
    assert len(notes) == 4 and all("is of another study" in note for note in notes)
    assert dataset_bytes(found) == dataset_bytes(mapped(**{"shard_runs": 9, **change}))


def test_a_shard_of_another_build_is_not_taken(tmp_path, monkeypatch):
    from lapwing.results import shards

    mapped(shard_runs=9, folder=tmp_path)
    monkeypatch.setattr(shards, "engine_digest", lambda: "0" * 64)
    notes = []
    mapped(shard_runs=9, folder=tmp_path, notes=notes.append)
    assert len(notes) == 4 and all("another build of the engine" in note for note in notes)


@pytest.fixture(scope="module")
def processes():
    """Two that wait for work."""
    with ProcessPoolExecutor(2, mp_context=get_context("spawn")) as pool:
        yield pool


def bytes_of_a_map(folder):
    return dataset_bytes(mapped(shard_runs=2, folder=folder, threads=1))


def test_two_starters_at_worst_repeat_work(tmp_path, processes):
    one, other = [processes.submit(bytes_of_a_map, tmp_path) for _ in range(2)]
    assert one.result() == other.result()
    assert not list(tmp_path.glob(".*"))


LONG = {"pinion_speed_rpm": [1500.0, 1700.0, 1900.0, 2100.0],
        "brake_torque": np.linspace(4, 9, 40)}
KILLED = """
import os, signal, sys
from pathlib import Path
sys.path.insert(0, {here!r})
from test_map import LONG, mapped
from lapwing.results import shards
left, original = {call}, shards.{step}

def counted(*given):
    global left
    left -= 1
    if {after}:
        original(*given)
    if left < 0:
        os.kill(os.getpid(), signal.SIGKILL)
    return None if {after} else original(*given)

shards.{step} = counted
mapped(LONG, shard_runs=4, folder=Path({folder!r}), settle=30)
"""


# A publication flushes twice: the file, and the folder that has its name.
@pytest.mark.parametrize(("step", "call", "after"), [
    ("store_checksums", 5, False), ("flush", 8, False), ("flush", 8, True), ("flush", 9, False)])
def test_a_kill_loses_no_more_than_what_was_under_way(step, call, after, tmp_path):
    """Whatever lies there after SIGKILL is whole, and the map goes on to the same numbers."""
    program = KILLED.format(here=str(Path(__file__).parent), folder=str(tmp_path), step=step,
                            call=call, after=after)
    ended = children.carried_out(program)
    assert ended.code == -9, ended.said
    lying = shards_in(tmp_path)
    assert len(lying) >= 3 and any(tmp_path.glob(".*.tmp")) == (call != 9)
    expected = mapped(LONG, shard_runs=4, settle=30)
    found = mapped(LONG, shard_runs=4, folder=tmp_path, settle=30, notes=pytest.fail)
    assert dataset_bytes(found) == dataset_bytes(expected)
    discard_shards(tmp_path)
    assert not tmp_path.exists()


AT_RANDOM = """
import os, signal, sys, threading
from pathlib import Path
sys.path.insert(0, {here!r})
from test_map import LONG, mapped
threading.Timer({delay}, os.kill, (os.getpid(), signal.SIGKILL)).start()
mapped(LONG, shard_runs=4, folder=Path({folder!r}), settle=30)
os._exit(0)
"""


def test_of_five_kills_at_any_instant_none_leaves_anything_half(tmp_path):
    begun = time.perf_counter()
    expected = dataset_bytes(mapped(LONG, shard_runs=4, settle=30, threads=1))
    lasts, random, deaths = time.perf_counter() - begun, np.random.default_rng(5), 0
    for _ in range(50):
        delay = lasts * random.uniform(0.05, 0.6)
        ended = children.carried_out(AT_RANDOM.format(
            here=str(Path(__file__).parent), folder=str(tmp_path), delay=delay))
        assert ended.code in (0, -9), ended.said
        deaths += ended.code == -9
        if deaths == 5:
            break
        if ended.code == 0:
            discard_shards(tmp_path)
    assert deaths == 5
    found = mapped(LONG, shard_runs=4, folder=tmp_path, settle=30, notes=pytest.fail)
    assert dataset_bytes(found) == expected


@pytest.mark.full
def test_of_a_hundred_kills_at_any_instant_none_leaves_anything_half(tmp_path):
    code = ("import sys; sys.path[:0] = sys.argv[1:3]\n"
            "from pathlib import Path\nfrom test_map import mapped, LONG\n"
            "mapped(LONG, shard_runs=4, folder=Path(sys.argv[3]), settle=400, threads=2,\n"
            "       progress=lambda _: print(flush=True))\n")
    deaths = 0
    while deaths < 100:
        child = subprocess.Popen([sys.executable, "-c", code, Path(__file__).parent, ROOT / "tests",
                                  tmp_path], stdout=subprocess.PIPE)
        for _ in range(1 + deaths % 7):  # killed some time after it has told of a shard
            child.stdout.readline()
        child.kill()
        child.communicate()
        deaths += child.returncode != 0
        if child.returncode == 0:
            discard_shards(tmp_path)
    expected = mapped(LONG, shard_runs=4, settle=400)
    found = mapped(LONG, shard_runs=4, folder=tmp_path, settle=400, notes=pytest.fail)
    assert dataset_bytes(found) == dataset_bytes(expected)


def test_any_executor_makes_the_same_shards(tmp_path, processes):
    expected = dataset_bytes(mapped(shard_runs=9))
    found = mapped(shard_runs=9, folder=tmp_path, executor=processes)
    assert dataset_bytes(found) == expected and shards_in(tmp_path) == [0, 1, 2, 3]
    with pytest.raises(ValueError, match="executor wants a folder"):
        mapped(executor=processes)


def test_the_cut_follows_from_the_map_alone():
    assert shard_size(1_000_000, 500, 1, None) == 8_000
    assert shard_size(100_000, 500, 1, None) == 1_563
    assert shard_size(100, 10**9, 1, None) == 1
    assert shard_size(1_000_000, 500, 1000, None) == 8_000
    assert shard_size(30, 500, 10, 17) == 20 and shard_size(30, 500, 1, 99) == 30
    # Of a long line a part, but not for threads alone.
    assert shard_size(30, 500, 10, 7) == 7 and shard_size(30, 500, 10, None) == 10
    assert shard_size(30_000, 500, 10_000, None) == 8_000


def test_runs_that_share_a_long_table_are_in_one_shard(monkeypatch):
    """Its closed form is made once for all torques of a speed, whichever axis is the last."""
    axes = {"brake_torque": np.linspace(3, 9, 20), "pinion_speed_rpm": np.linspace(900, 2400, 20)}

    def job(te):
        return job_of(PAIR, te, axes, line=None, start="rest", settle=400, record=100, phase=0.0,
                      numerics=None, shard_runs=None)
    monkeypatch.setattr("lapwing.studies.map.cut.LONG", 100)
    phase = np.arange(101) / 101
    curve = TransmissionError.from_hermite(phase, 1e-5 * np.cos(2 * np.pi * phase), 0 * phase)
    assert job(curve).grid.pieces == 101 and job(TE).grid.pieces == 0
    assert job(curve).grid.line == "brake_torque" and job(curve).cut.shards == 20
    assert job(TE).cut.shards == 58  # a short series is no table
    assert [shared_size(7, length, 10**6) for length in (1, 20, 32, 33, 100)] == [7, 20, 32, 17, 25]
    assert shared_size(7, 100, 99) == 7 and shared_size(500, 100, 10**6) == 500


def test_so_many_threads_are_begun_as_find_memory(monkeypatch):
    monkeypatch.setattr(estimates, "available_bytes", lambda: 4 * 10**9)
    assert [estimates.threads_that_fit(8, each) for each in (0, 10**6, 10**9, 10**10)] \
        == [8, 8, 2, 1]
    monkeypatch.setattr(estimates, "available_bytes", lambda: None)
    assert estimates.threads_that_fit(8, 10**10) == 8


@pytest.mark.parametrize("start", ["rest", "up", "down"])
@pytest.mark.parametrize("size", [1, 3, 5, 10, 30])
def test_every_run_is_in_the_shard_that_says_so(start, size):
    cut = Cut(30, size, 10, start)
    found = np.full(30, -1)
    for index in range(cut.shards):
        first, stop = cut.place(index)
        assert np.all(found[first:stop] == -1)
        found[first:stop] = index
        before = cut.before(index)
        if before is not None:
            ends = cut.place(before)
            assert (ends[1] == first) if start == "up" else (ends[0] == stop)
            assert first // 10 == ends[0] // 10
    assert np.array_equal(found, cut.shard_of(np.arange(30)))
    assert sorted(index for chain in range(cut.chains) for index in cut.chain(chain)) \
        == list(range(cut.shards))
    assert (cut.links > 1) == (start != "rest" and size < 10)


@pytest.mark.parametrize("start", ["up", "down"])
@pytest.mark.parametrize("spawned", [False, True])
def test_a_chain_goes_on_from_what_it_was_handed(start, spawned, tmp_path, request):
    """A shard in the middle is lost, another is changed: the same numbers, and nothing for nothing.

    The coast-flank runs in between fail: the next value begins at rest, as in one line.
    """
    options = {"start": start, "line": "brake_torque", "shard_runs": 3, "folder": tmp_path,
               "numerics": Numerics(max_events_per_cycle=60)}
    expected = mapped(start=start, line="brake_torque", numerics=options["numerics"])
    assert 0 < np.count_nonzero(expected["status"]) < expected["status"].size
    assert numbers_of(mapped(**options)) == numbers_of(expected)
    assert shards_in(tmp_path) == list(range(12))
    lying = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    shard_path(tmp_path, 5).unlink()
    _cut(shard_path(tmp_path, 9))
    notes, made = [], {path.name: path.stat().st_ino for path in tmp_path.iterdir()}
    found = mapped(**options, notes=notes.append,
                   executor=request.getfixturevalue("processes") if spawned else None)
    assert numbers_of(found) == numbers_of(expected)
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == lying
    assert {path.name for path in tmp_path.iterdir() if path.stat().st_ino
            != made.get(path.name)} == {"shard-00005.nc", "shard-00009.nc"}
    assert len(notes) == 1 and notes[0].startswith("shard 9 ")


def test_a_shard_of_another_chain_is_not_taken(tmp_path):
    import netCDF4

    from lapwing.results.checksums import store_checksums

    options = {"start": "up", "line": "brake_torque", "shard_runs": 4, "folder": tmp_path}
    expected = numbers_of(mapped(**options))
    # As if the forerunner had handed over another state, all else being alike.
    with netCDF4.Dataset(shard_path(tmp_path, 0), "a") as file:
        file.setncattr("handed", np.array([-1.0, 0.0, 0.0]))
    store_checksums(shard_path(tmp_path, 0))
    # Which state the third one is to begin with is known when the second is there.
    job = job_of(PAIR, TE, AXES, line="brake_torque", start="up", settle=SETTLE, record=RECORD,
                 phase=0.0, numerics=None, shard_runs=4)
    assert missing_of(job, tmp_path) == [1]
    notes = []
    mapped(**options, notes=notes.append)
    assert notes == [f"shard {i} is of another chain: made again" for i in (1, 2)]
    assert missing_of(job, tmp_path) == []
    discard_shards(tmp_path)
    assert numbers_of(mapped(**options)) == expected


@pytest.mark.parametrize(("start", "most"), [("rest", 4), ("up", 11)])
def test_a_shard_is_moved_in_blocks(start, most, monkeypatch):
    expected, taken, sweep = mapped(start=start), [], engine.sweep
    monkeypatch.setattr(shards, "AT_A_TIME", 4)
    monkeypatch.setattr(shards.engine, "sweep", lambda points, *rest, **options: (
        taken.append(len(points)), sweep(points, *rest, **options))[1])
    told = []
    whole = mapped(start=start, shard_runs=33, progress=told.append, threads=1)
    assert numbers_of(whole) == numbers_of(expected) and whole.attrs["shards"] == 1
    assert max(taken) == most and sum(taken) == 33
    assert told == sorted(told) and told[-1] == 1.0


@pytest.mark.parametrize("start", ["rest", "up"])
def test_a_shard_that_several_threads_share_is_the_same(start):
    job = job_of(PAIR, TE, AXES, line=None, start=start, settle=5, record=5, phase=0.0,
                 numerics=None, shard_runs=10**6)
    asked = []

    def three(lines):
        asked.append(lines)
        return 3

    found, expected = (job.carried_out(0, **one).data for one in ({"share_work": three}, {}))
    assert asked == [job.grid.runs // (1 if start == "rest" else job.grid.length)]
    assert {name: one.tobytes() for name, one in found.items()} \
        == {name: one.tobytes() for name, one in expected.items()}


def test_what_is_torn_apart_is_not_told_as_known():
    class Stopping:
        def __array__(self, *_, **__):
            raise KeyboardInterrupt

    job = job_of(PAIR, TE, AXES, line=None, start="rest", settle=1, record=1, phase=0.0,
                 numerics=None, shard_runs=33)
    data = job.carried_out(0).data
    for torn in set(KEPT) - {"status"}:
        found = Found(job, print)
        with pytest.raises(KeyboardInterrupt):
            found.take(0, Shard({**data, torn: Stopping()}, "cpu"))
        assert np.all(found.data["status"] == Status.UNFINISHED)


def test_failed_runs_have_no_numbers_but_their_status():
    found = mapped(numerics=Numerics(max_events_per_cycle=5))
    bad = found["status"].values == Status.TOO_MANY_EVENTS
    assert 0 < bad.sum() < bad.size
    for name in ("deepest_separation", "fastest_arrival", "impacts_per_cycle"):
        assert np.array_equal(np.isnan(found[name].values), bad)
    assert not found["period"].values[bad].any()


@pytest.mark.parametrize(("change", "said"), [
    ({"axes": {"brake_torque": [1.0]}}, "two or more"),
    ({"axes": {"brake_torque": [1.0], "colour": [1.0]}}, "axes = 'colour'"),
    ({"axes": {"brake_torque": [np.nan], "backlash": [1e-3]}}, "brake_torque"),
    ({"axes": {"brake_torque": [1.0], "backlash": [-1e-3, 1e-3]}}, "backlash"),
    ({"start": "left"}, "start = 'left'"), ({"line": "backlash"}, "line = 'backlash'"),
    ({"settle": -1}, "settle"), ({"record": 0}, "record"), ({"shard_runs": 0}, "shard_runs"),
    ({"brake_torque": 3.0}, "brake_torque = 3.0, expected none beside its axis"),
    ({"executor": 3, "folder": "nowhere"}, "executor = 3"),
    ({"phase": 1.0}, "phase"), ({"numerics": 3}, "numerics")])
def test_refusals(change, said):
    with pytest.raises((ValueError, TypeError), match=said):
        mapped(**change)


def test_read_shard_tells_nothing_of_what_is_not_there(tmp_path):
    assert read_shard(tmp_path, 0, {}) == (None, "")
    assert shards_in(tmp_path / "nowhere") == []


@pytest.mark.parametrize("given", [[1.0, 3.0, 1.0, 9.0, 3.0], [9.0, 1.0, 3.0]],
                         ids=["repeated", "unsorted"])
@pytest.mark.parametrize("start", ["rest", "up"])
def test_values_are_taken_once_and_in_order(given, start):
    expected = mapped({"pinion_speed_rpm": [1500.0], "brake_torque": [1.0, 3.0, 9.0]}, start=start)
    found = mapped({"pinion_speed_rpm": [1500.0], "brake_torque": given}, start=start)
    assert found["status"].shape == (1, 3) and dataset_bytes(found) == dataset_bytes(expected)


def test_axes_of_no_value_are_refused_and_of_one_are_not(tmp_path):
    with pytest.raises(ValueError, match="brake_torque"):
        mapped({"pinion_speed_rpm": [1500.0], "brake_torque": []})
    found = mapped({"pinion_speed_rpm": [1500.0], "brake_torque": [3.0]}, folder=tmp_path)
    assert found["status"].shape == (1, 1) and not found["status"].any()
    assert shards_in(tmp_path) == [0]


def test_a_shard_of_another_form_is_not_taken(tmp_path, monkeypatch):
    monkeypatch.setattr(stored, "SHARD_FORMAT", stored.SHARD_FORMAT + 1)
    expected = dataset_bytes(mapped(shard_runs=9, folder=tmp_path))
    monkeypatch.undo()
    notes = []
    assert dataset_bytes(mapped(shard_runs=9, folder=tmp_path, notes=notes.append)) == expected
    assert len(notes) == 4 and all("is of another version" in note for note in notes)


@pytest.mark.parametrize("years", [-50, 50])
def test_no_clock_decides_anything(years, tmp_path, monkeypatch):
    """Whatever the time of day was when a shard was written, and is now."""
    mapped(shard_runs=9, folder=tmp_path)
    then = time.time() + years * 3.156e7
    for path in tmp_path.iterdir():
        os.utime(path, (then, then))
    lying = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    shard_path(tmp_path, 2).unlink()
    monkeypatch.setattr(time, "time", lambda: then)
    mapped(shard_runs=9, folder=tmp_path, notes=pytest.fail)
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == lying


@pytest.mark.parametrize("room", [0, 2])
@pytest.mark.parametrize("call", ["flush", "store_checksums"])
def test_a_full_disk_leaves_whole_shards_or_none(room, call, tmp_path, monkeypatch):
    """The disk takes the description of the study and so many shards."""
    expected, calls, real = dataset_bytes(mapped(shard_runs=9)), [], getattr(stored, call)

    def refuse(path):
        if not path.is_dir():
            calls.append(path)
        if len(calls) > room + 1:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        return real(path)

    monkeypatch.setattr(stored, call, refuse)
    with pytest.raises(OSError, match="space") as caught:
        mapped(shard_runs=9, folder=tmp_path, threads=1)
    assert caught.value.errno == errno.ENOSPC
    assert sorted(path.name for path in tmp_path.iterdir()) == [
        *(f"shard-0000{i}.nc" for i in range(room)), stored.STUDY]
    monkeypatch.undo()
    found = mapped(shard_runs=9, folder=tmp_path, notes=pytest.fail)
    assert dataset_bytes(found) == expected


@pytest.mark.parametrize("knots", [20_000, pytest.param(10**6, marks=pytest.mark.full)])
def test_a_table_of_very_many_pieces_moves_as_the_curve_it_follows(knots, monkeypatch):
    """Also where to make its oscillator takes longer than a call of the engine is to take."""
    monkeypatch.setattr(engine.calls, "CALL_SECONDS", 0.0)
    phase = np.arange(knots) / knots
    angle = 2 * np.pi * phase
    table = TransmissionError.from_hermite(phase, 17e-6 * np.cos(angle),
                                           -2 * np.pi * 17e-6 * np.sin(angle))
    axes = {"pinion_speed_rpm": [1500.0], "brake_torque": [2.0, 13.0]}
    cycles = {"settle": 1, "record": 1} if knots < 10**6 else {"settle": 200, "record": 20}
    found, expected = (parameter_map(PAIR, te, axes, **cycles) for te in (
        table, TransmissionError.harmonic([17e-6], [0.0], [1])))
    for name in ("status", "arrivals", "states_visited"):
        assert np.array_equal(found[name], expected[name])
    np.testing.assert_allclose(found["deepest_separation"], expected["deepest_separation"],
                               rtol=1e-6, atol=1e-15)
    assert found["deepest_separation"].values[0, 0] > 0
