"""A map as a job array of a real Slurm, one part requeued and one cancelled: python tests/slurm.py

Starts munged, slurmctld and slurmd of Debian's packages on this machine, as root and without
systemd, with keys, ports, spools and logs of their own in a folder that goes afterwards; ends them.
Four minutes: a part that is requeued waits for two. Part of no other test; `make test-slurm`.
"""

import contextlib
import os
import re
import secrets
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1] / ".build"))

from toolchain import apt_commands

from helpers import plane_deck, plane_numbers

PROGRAMS = ("munged", "slurmctld", "slurmd", "sbatch")
PARTS = 4
PATIENCE = 300.0
DAEMONS = []
CONFIGURATION = """\
ClusterName=lapwing
SlurmctldHost={host}(127.0.0.1)
SlurmctldPort={ports[0]}
SlurmdPort={ports[1]}
SlurmUser=root
SlurmdUser=root
AuthType=auth/munge
AuthInfo=socket={folder}/munge.socket
StateSaveLocation={folder}/state
SlurmdSpoolDir={folder}/spool
SlurmctldPidFile={folder}/slurmctld.pid
SlurmdPidFile={folder}/slurmd.pid
SlurmctldLogFile={folder}/slurmctld.log
SlurmdLogFile={folder}/slurmd.log
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
JobAcctGatherType=jobacct_gather/none
AccountingStorageType=accounting_storage/none
SelectType=select/cons_tres
SelectTypeParameters=CR_Core
MpiDefault=none
ReturnToService=2
NodeName={host} NodeAddr=127.0.0.1 CPUs={cpus} RealMemory={megabytes} State=UNKNOWN
PartitionName=all Nodes={host} Default=YES MaxTime=INFINITE State=UP
"""


def say(text):
    print(f"{time.monotonic() - BEGUN:5.0f} s  {text}", flush=True)


def call(*words, **options):
    """What a program says; CalledProcessError with its words where it fails."""
    done = subprocess.run([*map(str, words)], capture_output=True, text=True, check=False,
                          **options)
    if done.returncode:
        raise RuntimeError(f"{words}: {done.returncode}\n{done.stdout}{done.stderr}")
    return done.stdout


def wait_for(what, condition):
    """Until the condition holds."""
    end = time.monotonic() + PATIENCE
    while not (found := condition()):
        gone = [one.args[0] for one in DAEMONS if one.poll() is not None]
        if gone or time.monotonic() > end:
            raise RuntimeError(f"in vain: {what}" + f"; {', '.join(gone)} has ended" * bool(gone))
        time.sleep(0.2)
    say(what)
    return found


def free_ports(count):
    with contextlib.ExitStack() as stack:
        found = [stack.enter_context(socket.socket()) for _ in range(count)]
        for one in found:
            one.bind(("127.0.0.1", 0))
        return [one.getsockname()[1] for one in found]


@contextlib.contextmanager
def cluster(folder):
    """A cluster of this machine alone; it has ended when the block has."""
    folder.chmod(0o755)  # munged refuses a socket that not all could reach
    for name in ("state", "spool"):
        (folder / name).mkdir()
    key = folder / "munge.key"
    key.write_bytes(secrets.token_bytes(128))
    key.chmod(0o600)
    host = socket.gethostname().partition(".")[0]
    (folder / "slurm.conf").write_text(CONFIGURATION.format(
        host=host, ports=free_ports(2), folder=folder, cpus=os.cpu_count(),
        megabytes=os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") * 9 // 10 >> 20),
        encoding="utf-8")
    os.environ["SLURM_CONF"] = str(folder / "slurm.conf")
    started = DAEMONS

    def start(*words):
        with (folder / f"{words[0]}.out").open("wb") as out:
            started.append(subprocess.Popen(words, stdout=out, stderr=out,
                                            stdin=subprocess.DEVNULL))

    try:
        start("munged", "--foreground", f"--key-file={key}", f"--socket={folder}/munge.socket",
              f"--pid-file={folder}/munged.pid", f"--log-file={folder}/munged.log",
              f"--seed-file={folder}/munged.seed", "--num-threads=2")
        wait_for("munged listens", (folder / "munge.socket").exists)
        start("slurmctld", "-D")
        start("slurmd", "-D")
        wait_for("the node is idle", lambda: "idle" in subprocess.run(
            ["sinfo", "-h", "-o", "%t"], capture_output=True, text=True, check=False).stdout)
        yield
        call("scancel", "--user=root")
        wait_for("no job is left", lambda: not call("squeue", "-h"))
    except BaseException:
        for log in sorted([*folder.glob("*.log"), *folder.glob("*.out")]):
            print(f"--- {log.name}\n{log.read_text(errors='replace')[-3000:]}")
        with contextlib.suppress(OSError):
            subprocess.run(["scancel", "--user=root", "--signal=KILL", "--full"], timeout=20,
                           check=False)
        raise
    finally:
        for process in reversed(started):
            process.send_signal(signal.SIGTERM)
        for process in reversed(started):
            try:
                process.wait(30)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()
        DAEMONS.clear()


def facts(job):
    """What Slurm knows of a job: name -> value."""
    return dict(re.findall(r"(\w+)=(\S*)", call("scontrol", "show", "job", "-o", job)))


def hand_in(script):
    said = call("sh", script)
    say(said.strip())
    return re.findall(r"job (\d+)", said)


def ended(job):
    return facts(job)["JobState"] not in ("PENDING", "RUNNING", "COMPLETING", "CONFIGURING")


def shards_of_part(folder, part):
    return len([path for path in folder.glob("shard-*.nc")
                if (int(path.stem[6:]) % PARTS) + 1 == part])


def main(folder):
    """Everything; the folder is thrown away afterwards."""
    lapwing = [sys.executable, "-m", "lapwing"]
    deck = folder / "plane.nml"
    deck.write_text(plane_deck(160, 1600, 4), encoding="utf-8")
    call(*lapwing, "run", deck, "--out", folder / "alone", "--threads", 1, "--figures", "none")
    expected = plane_numbers(folder / "alone" / "plane" / "result.nc")
    say("one thread has its numbers")
    script, out = folder / "plane.sh", folder / "out"
    script.write_text(call(*lapwing, "slurm", deck, "--out", out, "--tasks", PARTS,
                           "--time", "0:10:00", cwd=folder), encoding="utf-8")
    shards, logs = out / "plane.shards" / "map_plane", out / "plane.logs"
    with cluster(folder):
        parts, merge = hand_in(script)
        wait_for("part 1 has made a shard", lambda: shards_of_part(shards, 1))
        # As Slurm does it `--signal=B:USR1@120` before the end of the time.
        told = subprocess.Popen(["scancel", "--signal=USR1", "--batch",
                                 f"{parts}_1"], stderr=subprocess.DEVNULL)
        wait_for("part 1 is stopped, and handed in again",
                 lambda: facts(f"{parts}_1")["Restarts"] == "1")
        told.terminate()  # it does not notice that it was heard, and would tell it again
        told.wait()
        made = shards_of_part(shards, 1)
        wait_for("part 2 has made a shard", lambda: shards_of_part(shards, 2))
        call("scancel", f"{parts}_2")
        wait_for("part 2 is cancelled", lambda: facts(f"{parts}_2")["JobState"] == "CANCELLED")
        wait_for("the others are done", lambda: all(ended(f"{parts}_{k}") for k in (3, 4)))
        assert facts(merge)["JobState"] == "PENDING"
        wait_for("part 1, which waited for two minutes, is done", lambda: ended(f"{parts}_1"))
        states = [facts(f"{parts}_{k}")["JobState"] for k in range(1, PARTS + 1)]
        assert states == ["COMPLETED", "CANCELLED", "COMPLETED", "COMPLETED"], states
        assert facts(f"{parts}_2")["Restarts"] == "0"
        assert 0 < made < shards_of_part(shards, 1) == 40 > shards_of_part(shards, 2) > 0
        wait_for("the merge has ended", lambda: ended(merge))
        told = (logs / f"merge-{merge}.log").read_text(encoding="utf-8")
        say("it says: " + next(line for line in told.splitlines() if "missing" in line))
        assert facts(merge)["JobState"] == "FAILED" and not (out / "plane").exists()
        assert f"{40 - shards_of_part(shards, 2)} of 160 shards are missing" in told

        parts, merge = hand_in(script)  # the same again
        wait_for("the merge has ended", lambda: ended(merge))
        assert facts(merge)["JobState"] == "COMPLETED", facts(merge)
    assert plane_numbers(out / "plane" / "result.nc") == expected
    assert not shards.exists()
    say(f"{len(expected)} variables: byte for byte the numbers of one thread")
    for log in sorted(logs.iterdir()):
        print(f"--- {log.name}\n{log.read_text(encoding='utf-8').rstrip()}")


BEGUN = time.monotonic()
if __name__ == "__main__":
    if os.geteuid():
        sys.exit("tests/slurm.py: Slurm is started as root, which this is not")
    os.environ["PATH"] += os.pathsep + "/usr/sbin"
    if any(shutil.which(name) is None for name in PROGRAMS):
        for command in apt_commands(["slurm-wlm", "munge"]):
            subprocess.run(command, check=True, stdout=subprocess.DEVNULL,
                           env={**os.environ, "DEBIAN_FRONTEND": "noninteractive"})
    with tempfile.TemporaryDirectory(prefix="lapwing-slurm-") as made:
        main(Path(made))
    print("Slurm: passed")
