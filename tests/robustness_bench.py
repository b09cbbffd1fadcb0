"""A bench on which runs are hurt: decks, commands, and what is asked of the results they leave."""

from __future__ import annotations

import contextlib
import os
import shutil
import signal
import subprocess
import sys
import time
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

# What a hung command is told from a slow one by, seconds for each deck; nothing else is judged by
# its duration.
HANGS = 120.0
MARK = "LAPWING_ROBUSTNESS_TRIAL"
DECK = """\
&gear_pair
  pinion_teeth = 25, gear_teeth = 32, pinion_inertia = 0.0078, gear_inertia = 0.026
  pinion_base_lever = 0.034, mesh_stiffness = 3.12e8, backlash = 0.002
  restitution = 0.8, damping_ratio = 0.1
/
&transmission_error parabola_amplitude = 125e-6 /
&operation brake_torque = {torque}, pinion_speed_rpm = 480 /
&response name = 'one', settle_cycles = 20, record_cycles = 10, figures = 'history' /
&critical name = 'full', find = 'full', figures = 'none' /
&sweep name = 'torque', parameter = 'brake_torque', from = {torque}, to = 9, count = 12,
  settle_cycles = 50, record_cycles = 20, impacts = .true., figures = 'none' /
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
            (folder / f"decks_{torque}").mkdir()
            begun = time.monotonic()
            done = finish(bench.start(torque, folder / f"undisturbed_{torque}", ["small"]))
            bench.seconds = time.monotonic() - begun
            if done.code:
                raise RuntimeError(f"an undisturbed run failed:\n{done.said}")
            bench.numbers[torque] = numbers(folder / f"undisturbed_{torque}" / "small")
        bench.sample = folder / f"undisturbed_{OLD}" / "small"
        return bench

    def deck(self, torque: float, stem: str) -> Path:
        """Deck of one torque; of equal stems for both, so that they write into one folder."""
        path = self.folder / f"decks_{torque}" / f"{stem}.nml"
        path.write_text(DECK.format(torque=torque))
        return path

    def start(self, torque: float, out: Path, stems: list[str], *options: str,
              ) -> subprocess.Popen:
        """Start a run, in a process group of its own and with the usual reaction to Ctrl-C."""
        decks = [str(self.deck(torque, stem)) for stem in stems]
        words = [sys.executable, "-m", "lapwing", "run", *decks, "--out", str(out),
                 "--threads", "2", *options]
        return subprocess.Popen(
            words, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, errors="replace",
            env=os.environ | {MARK: str(out)}, start_new_session=True,
            preexec_fn=lambda: signal.signal(signal.SIGINT, signal.default_int_handler))

    def with_old_results(self, folder: Path) -> Path:
        """A copy of the old results with a file of the user's among them."""
        shutil.copytree(self.sample, folder)
        (folder / "notes.txt").write_text(NOTES)
        return folder


@dataclass
class Done:
    """How a command ended."""

    code: int
    said: str
    hung: bool = False


def finish(process: subprocess.Popen, decks: int = 1) -> Done:
    """Wait for a command; one that hangs is killed."""
    try:
        said, _ = process.communicate(timeout=HANGS * decks)
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
        with netCDF4.Dataset(path) as file:
            for group in (file, *file.groups.values()):
                for name, variable in group.variables.items():
                    variable.set_auto_maskandscale(False)
                    values = np.asarray(variable[...])
                    text = values.dtype.kind in "OU"
                    found[f"{group.path}/{name}"] = repr(values.tolist()).encode() if text \
                        else values.tobytes()
    except (OSError, RuntimeError):
        return {"unreadable": b""}
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


def problems_of_command(out: Path, done: Done, codes: set[int]) -> list[str]:
    """What is wrong with how a command ended."""
    problems = left_over(out)
    if done.hung:
        problems.append("hung")
    elif done.code not in codes:
        problems.append(f"exit {done.code}, one of {sorted(codes)} expected")
    if "Traceback" in done.said or "Fatal Python error" in done.said:
        problems.append("traceback")
    return problems


def problems_of_folder(bench: Bench, folder: Path, old_too: bool) -> list[str]:
    """What is wrong with the results that are left."""
    problems = []
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


def once_more(bench: Bench, out: Path, trials: dict[str, list[str]], torque: float, *options: str,
              ) -> None:
    """Run the decks again: good results, and nothing over of the runs before.

    `trials` has the problems of each stem; what is found is added. Those of the command itself, and
    files that belong to no stem, count for each.
    """
    if not trials:
        return
    done = finish(bench.start(torque, out, list(trials), *options), len(trials))
    common = problems_of_command(out, done, {0})
    expected = {path.name for path in bench.sample.iterdir()} | {"notes.txt"}
    over = {path.relative_to(out) for path in out.rglob("*")
            if path.is_file() and path.name not in expected}
    for stem, problems in trials.items():
        more = common + problems_of_folder(bench, out / stem, False)
        if numbers(out / stem) != bench.numbers[torque]:
            more.append("not the right results")
        lacking = expected - {"notes.txt"} - {path.name for path in (out / stem).glob("*")}
        if lacking:
            more.append(f"still lacking {sorted(lacking)}")
        mine = sorted(map(str, (path for path in over if path.parts[0].strip(".").split(".")[0]
                                == stem or path.parts[0] not in trials)))
        if mine:
            more.append(f"left over {mine}")
        problems += [f"again: {what}" for what in more] + [done.said] * bool(more)
