"""Hostile surroundings, many times over: damaged files, kills, signals, full disks.

    python tests/robustness.py [--seed S] [damage=N] [kill=N] [signal=N] [disk=N]

runs the command `lapwing` on small decks in a folder of its own, hurts it N times in each way and
judges what is left; without arguments 200, 100, 60 and 16 times. Prints each failure and a count
of every outcome; the exit status is 1 if there was any failure. Of the figures one is drawn, and
trials are made good by one command for several decks: most of the time would go into drawing and
into loading modules.

A results folder is good when the numbers of its result file are, to the bit, those of an
undisturbed run of the old or of the new values, and a file of the user's that lies in it is as it
was. What is asked of every trial besides: no traceback, no death by a signal that was not sent, no
process left, and the same command run once more gives the new results and leaves nothing over.
"""

from __future__ import annotations

import contextlib
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path

import numpy as np

from robustness_bench import (
    NEW,
    OLD,
    Bench,
    finish,
    numbers,
    once_more,
    problems_of_command,
    problems_of_folder,
)

COUNTS = {"damage": 200, "kill": 100, "signal": 60, "disk": 16}
SIGNALS = {signal.SIGINT: 130, signal.SIGTERM: 75, signal.SIGUSR1: 75}
# Every so many signals one is sent while files are being written.
WHILE_WRITING = 3
# A kill that came after the end is drawn anew, this many times at most, over what that run took.
REDRAWS = 8
# Trials that share a folder of results, and the command that is to make them good.
TOGETHER = 10


def damage(bench: Bench, rngs: list, out: Path) -> list[tuple[str, list[str]]]:
    """Truncate, flip or delete one file of good results and run again: noticed and made good."""
    before = {path.name: path.read_bytes() for path in bench.sample.iterdir()}
    outcomes, trials, names = [], {}, {}
    for n, rng in enumerate(rngs):
        folder = bench.with_old_results(out / f"d{n}")
        name = "result.nc" if rng.random() < 0.7 else str(rng.choice(sorted(before)))
        path, how = folder / name, str(rng.choice(["empty", "cut", "flip", "flip", "gone"]))
        hurt_file(path, how, rng)
        trials[folder.name], names[folder.name] = [], name
        if name == "result.nc" and how != "gone" and shown(path):
            trials[folder.name].append("its numbers were shown")
        outcomes.append((f"{how} {name if name == 'result.nc' else 'other'}",
                         trials[folder.name]))
    done = finish(bench.start(OLD, out, list(trials)), len(trials))
    for stem, problems in trials.items():
        problems += problems_of_command(out, done, {0})
        problems += problems_of_folder(bench, out / stem, True)
        if numbers(out / stem) != bench.numbers[OLD]:
            problems.append("not the right results again")
        lacking = [one for one in before if not (out / stem / one).exists()]
        if lacking:
            problems.append(f"still lacking {lacking}")
        told = f"{out / stem}: without a readable manifest.json" \
            if names[stem] == "manifest.json" else str(out / stem / names[stem])
        if told not in done.said:
            problems.append(f"not said of {names[stem]}")
        problems += [done.said] * bool(problems)
    return outcomes


def hurt_file(path: Path, how: str, rng: np.random.Generator) -> None:
    """Damage one file."""
    content = bytearray(path.read_bytes())
    if how == "gone":
        path.unlink()
    elif how == "flip":
        content[rng.integers(len(content))] ^= 1 << int(rng.integers(8))
        path.write_bytes(content)
    else:
        path.write_bytes(content[:0 if how == "empty" else rng.integers(len(content))])


def shown(path: Path) -> bool:
    """Whether a damaged result file is opened and read as if it were good."""
    from lapwing.results import read_results

    try:
        with read_results(path):
            return True
    except (OSError, ValueError):
        return False


def kill(bench: Bench, rngs: list, out: Path) -> list[tuple[str, list[str]]]:
    """SIGKILL at any instant while old results are replaced."""
    outcomes, trials = [], {}
    for n, rng in enumerate(rngs):
        folder, span = out / f"k{n}", bench.seconds
        for _ in range(1 + REDRAWS):
            shutil.rmtree(folder, ignore_errors=True)
            bench.with_old_results(folder)
            begun = time.monotonic()
            process = bench.start(NEW, out, [folder.name], "--force")
            # Not waited for to the end: then the run is over, and its span is known anew.
            with contextlib.suppress(subprocess.TimeoutExpired):
                process.wait(timeout=rng.uniform(0.0, 1.0) * span)
            span = min(span, time.monotonic() - begun) if process.poll() is not None else span
            with contextlib.suppress(ProcessLookupError):
                process.send_signal(signal.SIGKILL)
            done = finish(process)
            if done.code != 0:
                break
        problems = problems_of_command(out, done, {0, -signal.SIGKILL})
        problems += problems_of_folder(bench, folder, True)
        problems += [done.said] * bool(problems)
        trials[folder.name] = problems
        outcomes.append(("killed" if done.code else "had ended", problems))
    once_more(bench, out, trials, NEW, "--force")
    return outcomes


def interrupt(bench: Bench, rngs: list, out: Path) -> list[tuple[str, list[str]]]:
    """SIGINT, SIGTERM or SIGUSR1 at any instant, every third while files are written."""
    outcomes, trials = [], {True: {}, False: {}}
    for n, rng in enumerate(rngs):
        stem, old_too = f"s{n}", bool(rng.random() < 0.5)
        if old_too:
            bench.with_old_results(out / stem)
        sent = list(SIGNALS)[rng.integers(len(SIGNALS))]
        writing = n % WHILE_WRITING == 0
        known = set(out.rglob("*"))
        process = bench.start(NEW, out, [stem], *["--force"] * old_too)
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
        problems = problems_of_command(out, done, {0, SIGNALS[sent]})
        problems += problems_of_folder(bench, out / stem, old_too)
        problems += [done.said] * bool(problems)
        trials[old_too][stem] = problems
        outcomes.append((f"{signal.Signals(sent).name} "
                         f"{'while writing' if writing else 'somewhere'}, exit {done.code}",
                         problems))
    once_more(bench, out, trials[False], NEW)
    once_more(bench, out, trials[True], NEW, "--force")
    return outcomes


def full_disk(bench: Bench, out: Path, part: float) -> tuple[str, list[str]]:
    """A disk that holds `part` of the results: exit 3 and one line, and good results with room."""
    size = sum(path.stat().st_size for path in bench.sample.iterdir())
    out.mkdir()
    room = max(8192, int(part * size))
    mount("-t", "tmpfs", "-o", f"size={room}", "tmpfs", str(out))
    try:
        old_too = part > 1.2
        if old_too:
            bench.with_old_results(out / "small")
        done = finish(bench.start(NEW, out, ["small"], *["--force"] * old_too))
        problems = problems_of_command(out, done, {0, 3})
        problems += problems_of_folder(bench, out / "small", old_too)
        problems += [done.said] * bool(problems)
        mount("-o", f"remount,size={10 * size}", str(out))
        once_more(bench, out, {"small": problems}, NEW, *["--force"] * old_too)
        return f"exit {done.code}", problems
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


def groups(bench: Bench, kind: str, count: int, seed: int):
    """Carry out the trials of a kind, some in a folder together; yields their outcomes."""
    if kind == "disk":
        for n, part in enumerate(np.geomspace(0.02, 2.6, count)):
            yield bench.folder / f"disk_{n}", [full_disk(
                bench, bench.folder / f"disk_{n}", float(part))]
        return
    hurt = {"damage": damage, "kill": kill, "signal": interrupt}[kind]
    for first in range(0, count, TOGETHER):
        # A folder of their own, so that a trial that failed spoils no other group.
        out = bench.folder / f"{kind}_{first}"
        out.mkdir()
        yield out, hurt(bench, [np.random.default_rng([seed, list(COUNTS).index(kind), n])
                                for n in range(first, min(first + TOGETHER, count))], out)


def survey(counts: dict[str, int], seed: int = 0, say=print) -> list[str]:
    """Run every kind of trial and say what came of it; returns the failures."""
    failures = []
    with tempfile.TemporaryDirectory(prefix="lapwing-robustness-") as folder:
        bench = Bench.prepare(Path(folder))
        for kind, count in counts.items():
            if kind == "disk" and count and not can_mount():
                say("disk: not tried, this user may mount nothing")
                continue
            outcomes, failed = Counter(), []
            for out, group in groups(bench, kind, count, seed):
                for what, problems in group:
                    outcomes[what] += 1
                    if problems:
                        failed.append(f"{kind} {sum(outcomes.values()) - 1} ({what}): "
                                      + "; ".join(problems))
                        say(failed[-1] + "\n")
                if not any(problems for _, problems in group):
                    shutil.rmtree(out, ignore_errors=True)
                say(f"{kind}: {sum(outcomes.values())} trials, {len(failed)} failures")
            failures += failed
            for what, times in sorted(outcomes.items()):
                say(f"{times:7} {what}")
    return failures


def main(arguments: list[str]) -> int:
    """Run the trials that the arguments name; the exit status."""
    seed = 0
    if arguments[:1] == ["--seed"]:
        seed, arguments = int(arguments[1]), arguments[2:]
    counts = {name: int(count) for name, count in (word.split("=") for word in arguments)}
    return bool(survey(counts or COUNTS, seed))


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
