"""Hostile surroundings, many times over: damaged files, kills, signals, full disks, odd calls.

    python tests/robustness.py [--seed S] [damage=N] [kill=N] [signal=N] [disk=N]

runs the command `lapwing` on small decks in a folder of its own, hurts it N times in each way and
judges what is left; without arguments 200, 100, 60 and 16 times. Prints each failure and a count
of every outcome; the exit status is 1 if there was any failure.

A results folder is good when the numbers of its result file are, to the bit, those of an
undisturbed run of the old or of the new values, and a file of the user's that lies in it is as it
was. What is asked of every trial besides: no traceback, no death by a signal that was not sent, no
process left, and the same command run once more gives the new results and leaves nothing over.
"""

from __future__ import annotations

import contextlib
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

ROOT = Path(__file__).parents[1]
COUNTS = {"damage": 200, "kill": 100, "signal": 60, "disk": 16}
# What a hung command is told from a slow one by, seconds; nothing is judged by its duration.
HANGS = 120.0
SIGNALS = {signal.SIGINT: 130, signal.SIGTERM: 75, signal.SIGUSR1: 75}
# Part of the signals that are sent while files are being written.
WHILE_WRITING = 1 / 3
MARK = "LAPWING_ROBUSTNESS_TRIAL"
DECK = """\
&gear_pair
  pinion_teeth = 25, gear_teeth = 32, pinion_inertia = 0.0078, gear_inertia = 0.026
  pinion_base_lever = 0.034, mesh_stiffness = 3.12e8, backlash = 0.002
  restitution = 0.8, damping_ratio = 0.1
/
&transmission_error parabola_amplitude = 125e-6 /
&operation brake_torque = {torque}, pinion_speed_rpm = 480 /
&response name = 'one', settle_cycles = 50, record_cycles = 20 /
&critical name = 'full', find = 'full' /
&sweep name = 'torque', parameter = 'brake_torque', from = {torque}, to = 9, count = 40,
  settle_cycles = 100, record_cycles = 50, impacts = .true. /
"""
OLD, NEW = 1.8, 2.2
NOTES = "the user's own notes\n"


@dataclass
class Bench:
    """A folder with the decks, and what undisturbed runs of them give.

    Attributes
    ----------
    folder : Path
    numbers : dict of torque -> every variable of the result file
    sample : Path, an undisturbed results folder of the old values
    seconds : float, what a run takes here: trials are spread over it
    """

    folder: Path
    numbers: dict = field(default_factory=dict)
    sample: Path | None = None
    seconds: float = 0.0

    @classmethod
    def prepare(cls, folder: Path) -> Bench:
        """Write the decks and run each once."""
        bench = cls(folder)
        for torque in (OLD, NEW):
            bench.deck(torque).parent.mkdir()
            bench.deck(torque).write_text(DECK.format(torque=torque))
            begun = time.monotonic()
            done = finish(bench.start(torque, folder / f"undisturbed_{torque}"))
            bench.seconds = time.monotonic() - begun
            if done.code:
                raise RuntimeError(f"an undisturbed run failed:\n{done.said}")
            bench.numbers[torque] = numbers(folder / f"undisturbed_{torque}" / "small")
        bench.sample = folder / f"undisturbed_{OLD}" / "small"
        return bench

    def deck(self, torque: float) -> Path:
        """Deck of one torque; both have one name, so that they write into one folder."""
        return self.folder / f"decks_{torque}" / "small.nml"

    def start(self, torque: float, out: Path, *options: str, **how) -> subprocess.Popen:
        """Start a run, in a process group of its own and with the usual reaction to Ctrl-C."""
        words = [sys.executable, "-m", "lapwing", "run", str(self.deck(torque)), "--out",
                 str(out), "--threads", "2", *options]
        return subprocess.Popen(
            words, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, errors="replace",
            env=os.environ | {MARK: str(out)}, start_new_session=True,
            preexec_fn=lambda: signal.signal(signal.SIGINT, signal.default_int_handler), **how)

    def with_old_results(self, out: Path) -> Path:
        """A copy of the old results with a file of the user's among them."""
        folder = out / "small"
        shutil.copytree(self.sample, folder)
        (folder / "notes.txt").write_text(NOTES)
        return folder


@dataclass
class Done:
    """How a command ended."""

    code: int
    said: str
    hung: bool = False


def finish(process: subprocess.Popen) -> Done:
    """Wait for a command; one that hangs is killed."""
    try:
        said, _ = process.communicate(timeout=HANGS)
        return Done(process.returncode, said)
    except subprocess.TimeoutExpired:
        os.killpg(process.pid, signal.SIGKILL)
        said, _ = process.communicate()
        return Done(process.returncode, said, hung=True)


def numbers(folder: Path) -> dict[str, bytes] | None:
    """Every variable of a folder's result file, bit for bit; None where there is no such file."""
    import netCDF4

    path = folder / "result.nc"
    if not path.exists():
        return None
    found = {}
    try:
        file = netCDF4.Dataset(path)
    except OSError:
        return {"unreadable": b""}
    with file:
        for group in (file, *file.groups.values()):
            for name, variable in group.variables.items():
                variable.set_auto_maskandscale(False)
                values = np.asarray(variable[...])
                text = values.dtype.kind in "OU"
                found[f"{group.path}/{name}"] = repr(values.tolist()).encode() if text \
                    else values.tobytes()
    return found


def left_over(out: Path) -> list[str]:
    """Processes of a trial that still live, after the time that the system takes to end them."""
    mark = f"{MARK}={out}".encode()
    until = time.monotonic() + 10.0
    while True:
        alive = []
        for entry in Path("/proc").glob("[0-9]*"):
            with contextlib.suppress(OSError):
                state = (entry / "stat").read_text().rpartition(")")[2].split()[0]
                if state not in "ZX" and mark in (entry / "environ").read_bytes().split(b"\0"):
                    alive.append(f"process {entry.name}")
        if not alive or time.monotonic() > until:
            return alive
        time.sleep(0.05)


def is_partial(folder: Path) -> bool:
    """Whether the result file calls itself interrupted."""
    import netCDF4

    with netCDF4.Dataset(folder / "result.nc") as file:
        return bool(getattr(file, "interrupted", 0))


def problems_of(bench: Bench, out: Path, done: Done, codes: set[int], old_too: bool) -> list[str]:
    """What is wrong after a trial: how the command ended, and what it left."""
    folder = out / "small"
    problems = left_over(out)
    if done.hung:
        problems.append("hung")
    elif done.code not in codes:
        problems.append(f"exit {done.code}, one of {sorted(codes)} expected")
    if "Traceback" in done.said or "Fatal Python error" in done.said:
        problems.append("traceback")
    if old_too and (not (folder / "notes.txt").exists()
                    or (folder / "notes.txt").read_text() != NOTES):
        problems.append("the user's file is gone or changed")
    found = numbers(folder) if folder.exists() else None
    if found is None:
        if old_too:
            problems.append("old results are gone and there are no new ones")
    elif found not in bench.numbers.values():
        if old_too or not is_partial(folder):
            problems.append("results are neither the old nor the new ones")
    return problems


def once_more(bench: Bench, out: Path, torque: float, *options: str) -> list[str]:
    """Run the command again: good results, and nothing over of the run before."""
    done = finish(bench.start(torque, out, *options))
    problems = [f"again: {what}" for what in problems_of(bench, out, done, {0}, False)]
    if numbers(out / "small") != bench.numbers[torque]:
        problems.append("again: not the new results")
    expected = {path.name for path in bench.sample.iterdir()} | {"notes.txt"}
    over = [str(path.relative_to(out)) for path in out.rglob("*")
            if path.is_file() and path.name not in expected]
    if over:
        problems.append(f"again: left over {over}")
    return problems + ([f"it said:\n{done.said}"] if problems else [])


def damage(bench: Bench, rng: np.random.Generator, out: Path) -> tuple[str, list[str]]:
    """Truncate, flip or delete one file of good results and run again: noticed and made good."""
    folder = bench.with_old_results(out)
    before = {path.name: path.read_bytes() for path in bench.sample.iterdir()}
    name = "result.nc" if rng.random() < 0.7 else str(rng.choice(sorted(before)))
    path, how = folder / name, str(rng.choice(["empty", "cut", "flip", "flip", "gone"]))
    content = bytearray(path.read_bytes())
    if how == "gone":
        path.unlink()
    elif how == "flip":
        content[rng.integers(len(content))] ^= 1 << int(rng.integers(8))
        path.write_bytes(content)
    else:
        path.write_bytes(content[:0 if how == "empty" else rng.integers(len(content))])
    problems = []
    if name == "result.nc" and how != "gone" and shown(path):
        problems.append("its numbers were shown")
    done = finish(bench.start(OLD, out))
    problems += problems_of(bench, out, done, {0}, True)
    if numbers(folder) != bench.numbers[OLD]:
        problems.append("not the right results again")
    lacking = [one for one in before if not (folder / one).exists()]
    if lacking:
        problems.append(f"still lacking {lacking}")
    if name not in done.said:
        problems.append(f"not said of {name}")
    return f"{how} {name if name == 'result.nc' else 'other'}", problems + [done.said] * bool(
        problems)


def shown(path: Path) -> bool:
    """Whether a damaged result file is opened and read as if it were good."""
    from lapwing.results import read_results

    try:
        with read_results(path):
            return True
    except (OSError, ValueError):
        return False


def kill(bench: Bench, rng: np.random.Generator, out: Path) -> tuple[str, list[str]]:
    """SIGKILL at any instant while old results are replaced."""
    bench.with_old_results(out)
    process = bench.start(NEW, out, "--force")
    time.sleep(rng.uniform(0.0, 1.05) * bench.seconds)
    with contextlib.suppress(ProcessLookupError):
        os.kill(process.pid, signal.SIGKILL)
    done = finish(process)
    problems = problems_of(bench, out, done, {0, -signal.SIGKILL}, True)
    what = "killed" if done.code else "had ended"
    return what, problems or once_more(bench, out, NEW, "--force")


def interrupt(bench: Bench, rng: np.random.Generator, out: Path) -> tuple[str, list[str]]:
    """SIGINT, SIGTERM or SIGUSR1 at any instant, a third of them while files are written."""
    old_too = bool(rng.random() < 0.5)
    out.mkdir()
    if old_too:
        bench.with_old_results(out)
    sent = list(SIGNALS)[rng.integers(len(SIGNALS))]
    writing = rng.random() < WHILE_WRITING
    known = set(out.rglob("*"))
    process = bench.start(NEW, out, *["--force"] * old_too)
    if writing:
        while process.poll() is None and not any(
                ".nc" in path.name for path in set(out.rglob("*")) - known):
            time.sleep(0.001)
        time.sleep(rng.uniform(0.0, 0.05))
    else:
        time.sleep(rng.uniform(0.3, 1.05) * bench.seconds)
    with contextlib.suppress(ProcessLookupError):
        process.send_signal(sent)
    done = finish(process)
    problems = problems_of(bench, out, done, {0, SIGNALS[sent]}, old_too)
    what = f"{signal.Signals(sent).name} {'while writing' if writing else 'somewhere'}, exit " \
           f"{done.code}"
    if problems:
        return what, [*problems, done.said]
    return what, once_more(bench, out, NEW, *["--force"] * old_too)


def full_disk(bench: Bench, rng: np.random.Generator, out: Path, part: float,
              ) -> tuple[str, list[str]]:
    """A disk that holds `part` of the results: exit 3 and one line, and good results with room."""
    size = sum(path.stat().st_size for path in bench.sample.iterdir())
    out.mkdir()
    room = max(8192, int(part * size))
    mount("-t", "tmpfs", "-o", f"size={room}", "tmpfs", str(out))
    try:
        old_too = part > 1.2
        if old_too:
            bench.with_old_results(out)
        done = finish(bench.start(NEW, out, *["--force"] * old_too))
        problems = problems_of(bench, out, done, {0, 3}, old_too)
        what = f"exit {done.code}"
        mount("-o", f"remount,size={10 * size}", str(out))
        problems = problems or once_more(bench, out, NEW, *["--force"] * old_too)
        return what, problems + [done.said] * bool(problems)
    finally:
        subprocess.run(["umount", "-l", str(out)], check=False)


def mount(*words: str) -> None:
    """Mount, or OSError."""
    done = subprocess.run(["mount", *words], capture_output=True, text=True, check=False)
    if done.returncode:
        raise OSError(done.stderr.strip())


def can_mount() -> bool:
    """Whether this process may mount a file system in memory."""
    with tempfile.TemporaryDirectory() as folder:
        try:
            mount("-t", "tmpfs", "-o", "size=64k", "tmpfs", folder)
        except OSError:
            return False
        subprocess.run(["umount", folder], check=True)
        return True


def trials(kind: str, count: int):
    """The trials of a kind, as functions of bench, generator and folder."""
    if kind == "disk":
        parts = np.geomspace(0.02, 2.6, count)
        return [lambda *given, part=float(part): full_disk(*given, part) for part in parts]
    return [{"damage": damage, "kill": kill, "signal": interrupt}[kind]] * count


def hurt(bench: Bench, kind: str, count: int, seed: int) -> tuple[Counter, list[str]]:
    """All trials of a kind: what happened how often, and every failure in full."""
    outcomes, failures = Counter(), []
    for n, trial in enumerate(trials(kind, count)):
        # A folder of its own, so that a trial that failed spoils no other.
        out = bench.folder / f"{kind}_{n}"
        rng = np.random.default_rng([seed, list(COUNTS).index(kind), n])
        what, problems = trial(bench, rng, out)
        outcomes[what] += 1
        if problems:
            failures.append(f"{kind} {n} ({what}): " + "; ".join(problems))
        else:
            shutil.rmtree(out, ignore_errors=True)
    return outcomes, failures


def survey(counts: dict[str, int], seed: int = 0, say=print) -> list[str]:
    """Run every kind of trial and say what came of it; returns the failures."""
    failures = []
    with tempfile.TemporaryDirectory(prefix="lapwing-robustness-") as folder:
        bench = Bench.prepare(Path(folder))
        for kind, count in counts.items():
            if kind == "disk" and count and not can_mount():
                say("disk: not tried, this user may mount nothing")
                continue
            outcomes, failed = hurt(bench, kind, count, seed)
            failures += failed
            say(f"{kind}: {count} trials, {len(failed)} failures")
            for what, times in sorted(outcomes.items()):
                say(f"{times:7} {what}")
    return failures


def main(arguments: list[str]) -> int:
    """Run the trials that the arguments name; the exit status."""
    seed = 0
    if arguments[:1] == ["--seed"]:
        seed, arguments = int(arguments[1]), arguments[2:]
    counts = {name: int(count) for name, count in (word.split("=") for word in arguments)}
    failures = survey(counts or COUNTS, seed)
    for failure in failures:
        print(failure, end="\n\n")
    return bool(failures)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
