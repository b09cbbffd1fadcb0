"""Memory and disk that a study takes at least, and what there is: what cannot fit is refused.

The bounds count the engine's tables alone: no study asks for less.
What is made from them (statistics, figures) comes on top; tests hold the whole to 4 times as much.
"""

from __future__ import annotations

import errno
import math
import re
import shutil
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from lapwing.base import quantities

# Columns of the engine's tables, bytes of a number.
CYCLE, LOG, SAMPLE = map(len, (quantities.CYCLE, quantities.EVENT, quantities.SAMPLE))
TANGENT, REAL = 2 * 2 + len(quantities.TANGENT), 8
LOG_ROOM = 2000
# A sweep's log is one buffer for a block of points.
LOG_BYTES = 1 << 25
# In the result file, per sample and per cycle: numbers of 8 bytes, and whole ones of 4 and 1.
STORED_SAMPLE = 6 * 8 + 4 + 1
STORED_CYCLE = sum(4 if unit == "1" else 8 for name, unit in quantities.CYCLE.items()
                   if name != "cycle")
# A run of a map: status, period, arrivals at both flanks, chatter, states; five real numbers; what
# is asked for besides comes on top (`map_run`).
MAP_RUN = 1 + 2 + 2 * 4 + 1 + 1 + 5 * REAL
# What a summary reads of each run of a map: status, period, arrivals, states, deepest separation.
MAP_READ = 1 + 2 + 2 * 4 + 1 + REAL
# Of a closed form, for each piece of a table; its caller's copies are counted with it.
CLOSED_FORM = 800
# Deflate makes no more of it; a figure in its two formats is never smaller.
PACKED, FIGURE = 1032, 20_000
_NO_LIMIT = 2**60
# Bytes that are taken without asking; loading the engine took more.
LITTLE = 2**25


def sweep_bytes(points: int, record: int, cycles: bool = True, impacts: bool = False,
                exponents: bool = False, max_impacts: int = LOG_ROOM) -> int:
    """Bytes of the tables of a sweep of `points` (values times starts), `record` cycles each.

    The list of impacts comes on top; how long it gets is known by the run alone.
    """
    row = CYCLE * cycles + TANGENT * exponents
    logged = min(points, log_points(max_impacts)) * LOG * max_impacts * impacts
    return REAL * (points * record * row + logged)


def map_run(observe: Iterable[str] | None) -> int:
    """Bytes of a run of a map that is asked for some of `quantities.OBSERVED`."""
    return MAP_RUN + REAL * sum(len(quantities.OBSERVED[one]) for one in observe or ())


def map_read(observe: Iterable[str] | None) -> int:
    """Bytes of a run that its summary reads, where a map is put together from its shards."""
    return MAP_READ + map_run(observe) - MAP_RUN


def log_points(room: int) -> int:
    """Points for which a block's log has so much room each."""
    return max(1, LOG_BYTES // (REAL * LOG * room))


def response_bytes(record: int, samples_per_cycle: int, exponents: bool = False) -> int:
    """Bytes of the tables of a response while the second of its two runs is sampled.

    The samples of both runs are there then, and twice the times (cycle, time in it) of one.
    """
    row = 2 * (CYCLE + TANGENT * exponents) + (2 * SAMPLE + 2 * 2) * samples_per_cycle
    return REAL * record * row


def available_bytes(root: Path = Path("/")) -> int | None:
    """Memory that may still be taken, by the tightest of the limits known; None: none is known.

    The system's free memory and swap, the limit of the address space, and those of the control
    groups (versions 1 and 2) that this process is in.

    Parameters
    ----------
    root : Path, of proc and sys
    """
    found = [*_of_system(root), *_of_address_space(root), *_of_groups(root)]
    return max(0, min(found)) if found else None


def threads_that_fit(wanted: int, each: int) -> int:
    """How many of the wanted threads find memory, of which each takes so many bytes; one at least.

    Half of what there is stays for what they have in common, and for others.
    """
    if wanted * each <= LITTLE:
        return wanted
    available = available_bytes()
    return wanted if available is None else max(1, min(wanted, available // (2 * each)))


def require(needed: int, who: str, keys: str) -> None:
    """MemoryError where more is needed than there is, before any of it is taken.

    For little it is not asked what there is: that takes longer than a short run.
    """
    if needed <= LITTLE:
        return
    text = refusal(needed, keys, available_bytes())
    if text:
        raise MemoryError(f"{who}: {text}")


def refusal(needed: int, keys: str, available: int | None) -> str:
    """What to say where more is needed than there is, else empty text."""
    if available is None or needed <= available:
        return ""
    return (f"needs at least {spell(needed)} of memory, {spell(available)} are available; "
            f"lower {keys}")


def spell(count: int) -> str:
    """Bytes in words, three digits: `3.7 TB`."""
    power = min(5, int(math.log10(max(count, 1)) / 3))
    return f"{count / 1000**power:.3g} {('bytes', 'kB', 'MB', 'GB', 'TB', 'PB')[power]}"


def deck_bytes(deck: Any) -> list[tuple[str, int, str]]:
    """(what it is, bytes at least, keys to lower) of each study of a deck that takes many."""
    found = [(f"&{asked.kind} {asked.name!r}", asked.keys.memory(asked))
             for studies in deck.studies.values() for asked in studies]
    return [(what, *memory) for what, memory in found if memory]


def disk_bytes(deck: Any) -> tuple[int, int]:
    """Bytes of a deck's results: at least on disk, and of the result file's tables as such.

    Tables of samples and cycles are compressed, regular motions to a small part, chaotic ones
    hardly. The log of events comes on top; how long it gets is known by the run alone.
    """
    found = [asked.keys.disk(asked) for studies in deck.studies.values() for asked in studies]
    tables = sum(size for size, _ in found)
    return tables // PACKED + FIGURE * sum(figures for _, figures in found), tables


def require_disk(deck: Any, folder: Path, free: int | None = None) -> None:
    """OSError (no space left) where the results of a deck cannot fit, before any work.

    Parameters
    ----------
    deck : lapwing.deck.Deck
    folder : Path, where results go; need not exist
    free : int or None, bytes; default: what the file system has for this user
    """
    there = next(path for path in (folder, *folder.absolute().parents) if path.exists())
    free = shutil.disk_usage(there).free if free is None else free
    needed, _ = disk_bytes(deck)
    if needed > free:
        raise OSError(errno.ENOSPC, f"no space: results take at least {spell(needed)} of disk, "
                                    f"{spell(free)} are free", str(folder))


def stated(deck: Any) -> str:
    """What a deck takes at least, to end a line of `check`: memory of its largest study, disk."""
    most = max((needed for _, needed, _ in deck_bytes(deck)), default=0)
    least, tables = disk_bytes(deck)
    return (f"; memory at least {spell(most)}; disk at least {spell(least)}, and up to "
            f"{spell(tables)} of tables where they cannot be compressed") * (most > 0)


def refusals(deck: Any) -> list[str]:
    """One message for each study of a deck that does not fit into the memory available."""
    available = available_bytes()
    texts = ((what, refusal(needed, keys, available)) for what, needed, keys in deck_bytes(deck))
    return [f"{deck.path}: {what} {text}" for what, text in texts if text]


def _read(path: str) -> str:
    try:
        with open(path, encoding="utf-8") as file:
            return file.read()
    except (OSError, ValueError):
        return ""


def _kilobytes(text: str, name: str) -> int | None:
    """Bytes of the line `name: number kB` of proc, None where there is none."""
    found = re.search(rf"^{name}:\s+(\d+) kB$", text, re.M)
    return 1024 * int(found[1]) if found else None


def _of_system(root: Path) -> list[int]:
    facts = _read(f"{root}/proc/meminfo")
    free = _kilobytes(facts, "MemAvailable")
    return [] if free is None else [free + (_kilobytes(facts, "SwapFree") or 0)]


def _of_address_space(root: Path) -> list[Any]:
    try:
        import resource
    except ImportError:  # not on Windows
        return []
    limit = resource.getrlimit(resource.RLIMIT_AS)[0]
    if limit == resource.RLIM_INFINITY:
        return []
    return [limit - (_kilobytes(_read(f"{root}/proc/self/status"), "VmSize") or 0)]


def _of_groups(root: Path) -> list[Any]:
    """Of each control group with a limit, what is left; its file cache can be given back."""
    left = []
    for line in _read(f"{root}/proc/self/cgroup").splitlines():
        _, kinds, path = line.split(":", 2)
        if kinds == "":
            base, names = f"{root}/sys/fs/cgroup", ("memory.max", "memory.current", "file")
        elif "memory" in kinds.split(","):
            base, names = f"{root}/sys/fs/cgroup/memory", (
                "memory.limit_in_bytes", "memory.usage_in_bytes", "total_cache")
        else:
            continue
        parts = [part for part in path.split("/") if part]
        for depth in range(len(parts), -1, -1):
            folder = "/".join([base, *parts[:depth]])
            limit = _read(f"{folder}/{names[0]}").strip()
            used = _read(f"{folder}/{names[1]}").strip() if limit.isdigit() else ""
            if used.isdigit() and int(limit) < _NO_LIMIT:
                cache = [row.split()[1] for row in _read(f"{folder}/memory.stat").splitlines()
                         if row.startswith(names[2] + " ")]
                left.append(int(limit) - int(used) + sum(map(int, cache)))
    return left
