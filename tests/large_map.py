"""A large map killed midway, gone on with, and judged: memory, time, numbers.

    python tests/large_map.py [--side 1000] [--kills 2] [--threads 2] [--samples 5] [--out FOLDER]
                              [--settle CYCLES] [--record CYCLES]

runs `inputs/plane_25x32.nml` over side x side values by the command `lapwing run`, kills the whole
of it (SIGKILL) so many times on the way, and lets the same command go on. It prints

- the greatest memory: the sum of what all its processes hold at a time, and the peak of each;
- wall time, processor time of the whole, and of the engine's calls in it (read off inside these
  very processes), and how the whole compares with 1.05 times the engine and 30 s;
- how many shards were begun and not finished, against one for each thread and kill, and that none
  was finished twice;
- whether the numbers of some shards, and their cut, are to the bit those that one thread computes
  now without interruption.

The exit status is 1 where any of these is not as it should be. With its 1000 x 1000 runs of 500
mesh cycles it takes some 20 minutes on two quiet cores; `--side 100` takes one. With `--kills 0
--settle 1 --record 1` a million runs take a minute or two, and as much memory.
"""

from __future__ import annotations

import argparse
import contextlib
import os
import random
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

ROOT = Path(__file__).parents[1]
DECK = ROOT / "inputs" / "plane_25x32.nml"
# `lapwing` as it is, but for a line in a log for each call of the engine and each shard.
TIMED = '''
import os, sys, time
from lapwing.engine import calls
from lapwing.studies.map import work
from lapwing.studies.map.shards import Job

log = os.open(os.environ["LARGE_MAP_LOG"], os.O_WRONLY | os.O_APPEND | os.O_CREAT)
api, carried_out, write_shard = calls.api, Job.carried_out, work.write_shard

class Timed:
    def __getattr__(self, name):
        return getattr(api, name)

    def sweep(self, *arguments):
        begun = time.thread_time()
        api.sweep(*arguments)
        os.write(log, b"engine %.6f\\n" % (time.thread_time() - begun))

def begin(job, index, *rest):
    os.write(log, b"begun %d\\n" % index)
    return carried_out(job, index, *rest)

def finish(folder, index, *rest):
    write_shard(folder, index, *rest)
    os.write(log, b"done %d\\n" % index)

calls.api, Job.carried_out, work.write_shard = Timed(), begin, finish
from lapwing.__main__ import main
sys.exit(main())
'''
ALLOWED = 1e9  # bytes


def command(arguments: argparse.Namespace, out: Path) -> list[str]:
    """The run, as a user would type it after `lapwing`."""
    return ["run", str(DECK), "--out", str(out), "--threads", str(arguments.threads),
            *(word for key, value in changed(arguments) for word in ("--set", f"{key}={value}"))]


def changed(arguments: argparse.Namespace) -> list[tuple[str, str]]:
    """Keys of the deck that have other values."""
    wanted = {"x_count": arguments.side, "y_count": arguments.side,
              "settle_cycles": arguments.settle, "record_cycles": arguments.record}
    return [(f"map.{key}", str(value)) for key, value in wanted.items() if value is not None]


class Run:
    """One start of the command, its processes looked at now and then."""

    def __init__(self, words: list[str], log: Path) -> None:
        self.begun = time.perf_counter()
        self.process = subprocess.Popen(
            [sys.executable, "-c", TIMED, *words], start_new_session=True,
            env=os.environ | {"LARGE_MAP_LOG": str(log)}, stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT, text=True)
        self.peaks: dict[int, int] = {}
        self.most = 0

    def look(self) -> bool:
        """Note the memory of all its processes; whether it is still there."""
        held = 0
        for pid in tree(self.process.pid):
            with contextlib.suppress(OSError, KeyError, IndexError):
                facts = dict(line.split(":", 1) for line in
                             Path(f"/proc/{pid}/status").read_text().splitlines())
                held += 1024 * int(facts["VmRSS"].split()[0])
                self.peaks[pid] = max(self.peaks.get(pid, 0),
                                      1024 * int(facts["VmHWM"].split()[0]))
        self.most = max(self.most, held)
        time.sleep(0.05)
        done = os.waitid(os.P_PID, self.process.pid, os.WEXITED | os.WNOHANG | os.WNOWAIT)
        return done is None

    def end(self) -> float:
        """Wait for it; processor time of it and of what it waited for."""
        if self.process.stdout is not None:
            self.said = self.process.stdout.read()
        _, status, usage = os.wait4(self.process.pid, 0)
        self.process.returncode = self.code = os.waitstatus_to_exitcode(status)
        self.wall = time.perf_counter() - self.begun
        return usage.ru_utime + usage.ru_stime

    def kill(self) -> None:
        """End all of it at once."""
        os.killpg(self.process.pid, signal.SIGKILL)


def tree(pid: int) -> list[int]:
    """A process and all below it."""
    found = [pid]
    with contextlib.suppress(OSError):
        for task in os.listdir(f"/proc/{pid}/task"):
            for child in Path(f"/proc/{pid}/task/{task}/children").read_text().split():
                found += tree(int(child))
    return found


def lines(log: Path, word: str) -> list[str]:
    """What the log says after a word, line by line."""
    if not log.exists():
        return []
    rows = (line.split() for line in log.read_text().splitlines())
    return [row[1] for row in rows if len(row) == 2 and row[0] == word]


def judge(arguments: argparse.Namespace, out: Path, say=print) -> list[str]:
    """Run, kill, go on, compare; returns what is not as it should be."""
    problems: list[str] = []
    log, words = out / "log", command(arguments, out)
    job = job_of_deck(arguments)
    say(f"{job.grid.runs} runs of {job.settle + job.record} mesh cycles in {job.cut.shards} "
        f"shards; the same by hand: lapwing {' '.join(words)}")
    cpu = wall = 0.0
    most, lost = 0, 0
    for turn in range(1, arguments.kills + 2):
        until = job.cut.shards * turn / (arguments.kills + 1) if turn <= arguments.kills else None
        run = Run(words, log)
        while run.look():
            if until is not None and len(lines(log, "done")) >= until:
                run.kill()
                break
        seconds = run.end()
        begun, done = lines(log, "begun"), lines(log, "done")
        now_lost = len(begun) - len(done) - lost
        lost += now_lost
        if run.code not in ((-signal.SIGKILL,) if until is not None else (0,)):
            problems.append(f"ended with {run.code}: {run.said[-2000:]}")
        if now_lost > arguments.threads * (until is not None):
            problems.append(f"{now_lost} shards begun in vain")
        say(f"start {turn}: {'killed' if run.code else 'finished'} with {len(done)} shards after "
            f"{run.wall:.0f} s, processor {seconds:.0f} s; {now_lost} shards begun in vain; memory "
            f"of all processes together at most {run.most / 1e6:.0f} MB, of the program itself "
            f"{run.peaks.pop(run.process.pid) / 1e6:.0f}, each other at most "
            + ", ".join(f"{peak / 1e6:.0f}" for peak in sorted(run.peaks.values())[::-1][:5]))
        cpu, wall, most = cpu + seconds, wall + run.wall, max(most, run.most)
    if sorted(map(int, done)) != list(range(job.cut.shards)):
        problems.append("shards were finished twice, or never")
    if most > ALLOWED:
        problems.append(f"{most / 1e6:.0f} MB of memory")
    engine = sum(map(float, lines(log, "engine")))
    cycles = job.grid.runs * (job.settle + job.record)
    allowed = 1.05 * engine + 30
    say(f"the whole: wall {wall:.0f} s, processor {cpu:.0f} s; the engine {engine:.0f} s of it, "
        f"{1e6 * engine / cycles:.2f} us a mesh cycle; allowed 1.05 x engine + 30 s = "
        f"{allowed:.0f} s")
    if cpu > allowed:
        problems.append(f"{cpu:.0f} s of processor time, {allowed:.0f} allowed")
    problems += compared(job, out / DECK.stem / "result.nc", arguments.samples, say)
    return problems


def job_of_deck(arguments: argparse.Namespace):
    """The map's job, as the command makes it."""
    from lapwing import load_deck
    from lapwing.studies.map.run import job_of
    from lapwing.studies.map.study import _arguments

    deck = load_deck(DECK, changed(arguments))
    (study,) = deck.studies["map"]
    return job_of(**_arguments(deck, study))


def compared(job, path: Path, samples: int, say=print) -> list[str]:
    """Some shards, computed by one thread now, against the result file."""
    import xarray as xr

    with xr.open_dataset(path, group="map_plane", engine="netcdf4", decode_times=False,
                         mask_and_scale=False) as data:
        stored = {name: data[name].transpose(*job.grid.order).values.ravel()
                  for name in ("status", "period", "arrivals", "back_arrivals", "chatter",
                               "states_visited", "deepest_separation",
                               "deepest_back_penetration", "fastest_arrival")}
    wrong = []
    chosen = random.Random(1).sample(range(job.cut.shards), min(samples, job.cut.shards))
    for index in chosen:
        first, stop = job.cut.place(index)
        for name, values in job.carried_out(index).data.items():
            if stored[name][first:stop].tobytes() != values.tobytes():
                wrong.append(f"shard {index}: {name} differs")
    unfinished = int(np.count_nonzero(stored["status"]))
    say(f"{len(chosen)} shards, {sorted(chosen)}, computed anew by one thread: "
        f"{'the same bytes' if not wrong else 'NOT the same'}; {unfinished} runs without a result")
    return wrong


def main(words: list[str]) -> int:
    """Read the arguments and judge; the exit status."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", maxsplit=1)[0])
    for name, default in (("side", 1000), ("kills", 2), ("threads", 2), ("samples", 5)):
        parser.add_argument(f"--{name}", type=int, default=default)
    for name in ("settle", "record"):
        parser.add_argument(f"--{name}", type=int, help="mesh cycles; default: the deck's")
    parser.add_argument("--out", type=Path, help="where results go and stay; default: nowhere")
    arguments = parser.parse_args(words)
    with tempfile.TemporaryDirectory(prefix="lapwing-large-map-") as folder:
        out = arguments.out or Path(folder)
        out.mkdir(parents=True, exist_ok=True)
        problems = judge(arguments, out)
    for problem in problems:
        print(f"WRONG: {problem}")
    return bool(problems)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
