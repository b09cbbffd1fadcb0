"""Maps carried out by MPI, by Dask and in parts: the same bytes, also after one of them is lost.

MPI and Dask are extras: `pip install 'lapwing[mpi,dask]'`.
"""

import os
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from typer.testing import CliRunner

from helpers import dataset_bytes, plane_deck, plane_numbers
from lapwing import executors
from lapwing.cli import app
from lapwing.results.shards import shards_in

SHARDS = 40
LAPWING = [sys.executable, "-m", "lapwing"]


@pytest.fixture(scope="module")
def deck(tmp_path_factory):
    path = tmp_path_factory.mktemp("map") / "plane.nml"
    path.write_text(plane_deck(40, 100, 4), encoding="utf-8")
    return path


def call(*words, **options):
    done = subprocess.run([*map(str, words)], capture_output=True, text=True, check=False,
                          **options)
    return done.returncode, done.stdout + done.stderr


def run(deck, out, *options):
    """Exit code and words of a run in this process."""
    done = CliRunner().invoke(app, [*map(str, ("run", deck, "--out", out, "--figures", "none",
                                               *options))])
    return done.exit_code, done.output


@pytest.fixture(scope="module")
def expected(deck, tmp_path_factory):
    out = tmp_path_factory.mktemp("alone")
    code, said = run(deck, out, "--threads", "1")
    assert code == 0, said
    return plane_numbers(out / "plane" / "result.nc")


def test_parts_make_a_whole(deck, expected, tmp_path):
    folder = tmp_path / "plane.shards" / "map_plane"
    for part in (3, 1):
        code, said = run(deck, tmp_path, "--shard", f"{part}/3")
        many = len(range(part - 1, SHARDS, 3))
        assert code == 0 and f"part {part} of 3 is done: {many} shards made; lapwing run" in said
    code, said = run(deck, tmp_path, "--shard", "1/2")  # of which some were made for others
    assert code == 0 and "part 1 of 2 is done: " in said and " lay there; lapwing run" in said
    code, said = run(deck, tmp_path, "--shard", "1/2")
    assert code == 0 and f"is done: 0 shards made, {-(-SHARDS // 2)} lay there" in said
    code, said = run(deck, tmp_path, "--shard", "99/99")
    assert code == 0 and "is done" not in said and "fewer shards than parts" in said
    assert shards_in(folder) == [i for i in range(SHARDS) if i % 3 != 1 or i % 2 == 0]
    code, said = run(deck, tmp_path, "--merge")
    assert code == 1 and not (tmp_path / "plane").exists()
    assert f"map plane: 7 of {SHARDS} shards are missing: 1, 7, 13, 19, 25, 31, 37" in said
    code, said = run(deck, tmp_path)  # which makes what is missing
    assert code == 0 and plane_numbers(tmp_path / "plane" / "result.nc") == expected
    assert [path.name for path in tmp_path.iterdir()] == ["plane"]
    assert run(deck, tmp_path, "--merge")[0] == 0
    code, said = run(deck, tmp_path, "--shard", "2/3")  # late
    assert code == 0 and "is done" not in said
    assert "complete results of the same values lie there, no shard is made" in said
    assert [path.name for path in tmp_path.iterdir()] == ["plane"]


@pytest.mark.parametrize("part", ["0/3", "4/3", "1", "1/", "a/b", "-1/3", "1/3/5", "²/3",
                                  "1/" + 5000 * "9"],
                         ids=lambda part: part[:6])
def test_odd_parts_are_refused(deck, part, tmp_path):
    code, said = run(deck, tmp_path, f"--shard={part}")
    assert code == 2 and "expected K/N with 1 <= K <= N" in said
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("ways", [("--shard=1/2", "--executor=mpi"), ("--shard=1/2", "--merge")],
                         ids=lambda ways: ways[1][2:7])
def test_there_is_one_way_to_share_the_work(deck, tmp_path, ways):
    code, said = run(deck, tmp_path, *ways)
    assert code == 2 and "each shares the work in its own way" in said
    assert not list(tmp_path.iterdir())


def test_a_merge_that_cannot_fit_names_what_is_missing_first(deck, tmp_path, monkeypatch):
    monkeypatch.setattr("lapwing.base.estimates.available_bytes", lambda: 10)
    monkeypatch.setattr("lapwing.base.estimates.LITTLE", 0)
    code, said = run(deck, tmp_path, "--merge")
    assert code == 1 and "40 of 40 shards are missing: 0-39" in said
    assert run(deck, tmp_path, "--shard", "1/1")[0] == 0  # a part fits
    code, said = run(deck, tmp_path, "--merge")
    assert code == 3 and "needs at least" in said and not (tmp_path / "plane").exists()
    assert len(shards_in(tmp_path / "plane.shards" / "map_plane")) == SHARDS


def test_shards_of_another_deck_are_missing_to_a_merge(deck, expected, tmp_path):
    code, said = run(deck, tmp_path, "--shard", "1/40", "--set", "map.y_to=9.5")
    assert code == 0, said
    code, said = run(deck, tmp_path, "--shard", "2/40")
    assert code == 0, said
    code, said = run(deck, tmp_path, "--merge")
    assert code == 1 and "39 of 40 shards are missing: 0, 2-39" in said


@pytest.mark.parametrize("name", ["minimal", "branches_25x32"])
def test_a_deck_without_maps_has_no_parts(name, tmp_path):
    """Nor has one whose branches are kept one by one: which there are is found under way."""
    code, said = run(Path(__file__).parents[1] / "inputs" / f"{name}.nml", tmp_path,
                     "--shard", "1/2")
    assert code == 2 and "--shard goes with &map, &ensemble and &basins" in said
    assert "the deck has none" in said


@pytest.mark.parametrize("name", ["foo", "dask", "dask=", "mpi=3"])
def test_unknown_executors_are_refused(name):
    with pytest.raises(ValueError, match="expected mpi, or dask=ADDRESS"), executors.opened(name):
        pass


@pytest.mark.parametrize(("name", "package"), [("mpi", "mpi4py.futures"),
                                               ("dask=tcp://127.0.0.1:9", "distributed")])
def test_a_package_that_is_missing_is_named(name, package, monkeypatch):
    monkeypatch.setitem(sys.modules, package, None)
    with pytest.raises(ValueError, match=r"pip install 'lapwing\["), executors.opened(name):
        pass


def test_none_is_named():
    with executors.opened(None) as executor:
        assert executor is None


def ranks(count):
    """The command that begins so many processes under MPI; skipped where there is none."""
    pytest.importorskip("mpi4py")
    found = shutil.which("mpiexec", path=os.pathsep.join([str(Path(sys.executable).parent),
                                                          os.environ["PATH"]]))
    return [found, "-n", str(count)] if found else pytest.skip("no mpiexec")


@pytest.mark.full  # the killed rank's job makes the same, too
def test_mpi_makes_the_same(deck, expected, tmp_path):
    code, said = call(*ranks(3), *LAPWING, "run", deck, "--out", tmp_path, "--figures", "none",
                      "--executor", "mpi")
    assert code == 0, said
    assert said.count("done, results in") == 1
    assert plane_numbers(tmp_path / "plane" / "result.nc") == expected


# The command, of which the rank that is to write a certain shard is killed.
DYING = """
import os, signal, sys
from lapwing.__main__ import main
from lapwing.studies.map import shards
write_shard = shards.write_shard

def write(folder, index, *given):
    if index == 7:
        os.kill(os.getpid(), signal.SIGKILL)
    return write_shard(folder, index, *given)

shards.write_shard = write
main()
"""


def test_a_killed_rank_ends_the_job_and_the_same_command_goes_on(deck, expected, tmp_path):
    command = ["run", deck, "--out", tmp_path, "--figures", "none", "--executor", "mpi"]
    code, said = call(*ranks(2), sys.executable, "-c", DYING, *command)
    assert code != 0 and not (tmp_path / "plane").exists(), said
    assert shards_in(tmp_path / "plane.shards" / "map_plane") == list(range(7))
    code, said = call(*ranks(2), *LAPWING, *command)
    assert code == 0 and "again" not in said, said
    assert plane_numbers(tmp_path / "plane" / "result.nc") == expected


@pytest.mark.parametrize("killed", [False, pytest.param(True, marks=pytest.mark.full)])
def test_dask_makes_the_same_also_if_a_worker_is_killed(tmp_path, killed):
    distributed = pytest.importorskip("distributed")
    import numpy as np

    from lapwing import TransmissionError, parameter_map
    from lapwing_bench.scenes import PAIR

    te = TransmissionError.harmonic([17e-6, 4.5e-6, 1.5e-6], [0.0, 1.0, 2.0], [1, 2, 3])
    axes = {"pinion_speed_rpm": np.linspace(1500, 2100, 4), "brake_torque": np.linspace(4, 9, 40)}
    options = {"settle": 800 if killed else 20, "shard_runs": 4}
    left = []

    def kill_one(fraction):
        if fraction > 0.2 and left:
            os.kill(left.pop(), signal.SIGKILL)

    with distributed.LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None,
                                  processes=killed, silence_logs=50) as cluster, \
            executors.opened(f"dask={cluster.scheduler_address}") as executor:
        if killed:
            left.append(min(executor._client.run(os.getpid).values()))
        found = parameter_map(PAIR, te, axes, folder=tmp_path, executor=executor,
                              progress=kill_one, **options)
    assert not left and shards_in(tmp_path) == list(range(SHARDS))
    assert dataset_bytes(found) == dataset_bytes(parameter_map(PAIR, te, axes, **options))


def test_workers_of_dask_share_their_node(monkeypatch):
    """As many threads each as there are processors for every call that is carried out there."""
    distributed = pytest.importorskip("distributed")
    told = []

    class Client:
        def nthreads(self):
            return {"tcp://10.0.0.1:40": 2, "tcp://10.0.0.1:41": 1, "tls://[::1]:7": 1}

    class Here:
        address = "tcp://10.0.0.1:99"

    class Inline:
        def submit(self, function, *args, **kwargs):
            return function(*args, **kwargs)

    monkeypatch.delenv("OMP_NUM_THREADS", raising=False)
    monkeypatch.delenv("SLURM_CPUS_PER_TASK", raising=False)
    monkeypatch.setattr(distributed, "get_worker", Here)
    monkeypatch.setattr(executors, "processors", lambda: set(range(13)))
    monkeypatch.setattr(executors, "take_share", told.append)
    pool = executors._Shared(Client(), Inline())
    assert pool.submit(max, 3, 5) == 5 and told == [4]  # 13 // 3
    Here.address = "tls://[::1]:8"
    pool.submit(max, 3, 5)
    Here.address = "tcp://10.0.0.2:1"  # one that has just come
    pool.submit(max, 3, 5)
    monkeypatch.setenv("OMP_NUM_THREADS", "2")
    pool.submit(max, 3, 5)
    assert told == [4, 13, 13, 2]
