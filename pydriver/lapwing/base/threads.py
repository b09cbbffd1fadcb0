"""How many threads to use where nobody says, and how many there can be."""

from __future__ import annotations

import math
import os
import re
import threading
from collections import Counter
from collections.abc import Iterable, Iterator
from contextlib import contextmanager

from lapwing.base.arguments import MAX_INT, whole

# More threads than processors gain nothing; some are allowed, to show that no result depends on
# them, and because a wish made for another machine is no reason to refuse.
PER_PROCESSOR, AT_LEAST = 4, 16
_LIST = re.compile(r"\s*\+?([0-9]{1,20})\s*(,\s*\+?[0-9]+\s*)*", re.ASCII)
# The threads of this process, by number.
_TASKS = "/proc/self/task"
# Read by GNU OpenMP when it is loaded.
_SPINS = "GOMP_SPINCOUNT"
_state = {"forked": False}
# Threads of this process where several share the machine's; None: it is alone.
_share: list[int | None] = [None]


def _born_by_fork() -> None:
    _state["forked"] = True


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_born_by_fork)


@contextmanager
def short_waits() -> Iterator[None]:
    """While it lasts, OpenMP is loaded so that its threads soon sleep when there is nothing to do.

    They spin for milliseconds otherwise, after each of the short calls that a study is made of, and
    hold a processor that others want. Whoever has said how they wait is listened to.
    """
    if not {"OMP_WAIT_POLICY", _SPINS}.isdisjoint(os.environ):
        yield
        return
    os.environ[_SPINS] = "10000"  # some tenths of a millisecond
    try:
        yield
    finally:
        del os.environ[_SPINS]


def default_threads() -> int:
    """Threads: OMP_NUM_THREADS, SLURM_CPUS_PER_TASK, or the processors this process may use.

    Of a list such as ``4,3,2`` the first number is taken, as OpenMP does.  What is no whole number
    above 0 is passed over, and the answer is `most_threads` at most.
    """
    return asked_threads() or _processors()


def most_threads() -> int:
    """The most threads that are ever begun: four for each processor, at least 16."""
    return max(AT_LEAST, PER_PROCESSOR * _processors())


def checked_threads(threads: object) -> int:
    """The argument `threads` of a study: None for the default, or a whole number >= 1.

    Raises
    ------
    TypeError, ValueError
        where it is anything else.
    """
    return default_threads() if threads is None else whole("threads", threads, 1, MAX_INT)


def take_share(threads: int | None) -> None:
    """From now on no study of this process begins more threads than so many; None: as it likes.

    Its processes work side by side, and the shares of some grow when others are done.
    """
    _share[0] = threads


def share_of(wanted: int) -> int:
    """The wanted threads, or this process's share of them where it is less."""
    return wanted if _share[0] is None else min(wanted, _share[0])


def fair_share(own: Iterable[int], others: Iterable[Iterable[int]]) -> int:
    """Threads of a process among those that work on the same node, one at least.

    Parameters
    ----------
    own : processors that it may use
    others : those of each process at work there, itself included
    """
    users = Counter(processor for processors in others for processor in processors)
    return max(1, math.floor(sum(1 / users[processor] for processor in own) + 1e-9))


def asked_threads() -> int | None:
    """OMP_NUM_THREADS or SLURM_CPUS_PER_TASK, the first that says a number; None: neither."""
    for name in ("OMP_NUM_THREADS", "SLURM_CPUS_PER_TASK"):
        found = _LIST.fullmatch(os.environ.get(name, ""))
        if found and int(found[1]) > 0:
            return min(int(found[1]), most_threads())
    return None


def processors() -> set[int]:
    """Numbers of the processors that this process may use; the system's where that is not known."""
    return os.sched_getaffinity(0) if hasattr(os, "sched_getaffinity") \
        else set(range(os.cpu_count() or 1))


def worker_threads(tasks: int) -> int:
    """Threads for so many tasks in a process that works for another: its share, else one."""
    return usable_threads(_share[0] or 1, tasks)


def usable_threads(wanted: int, tasks: int) -> int:
    """How many of the wanted threads are begun; no result depends on it.

    Not more than there are tasks, than `share_of` and `most_threads`, and than the system lets
    begin just now (limits of processes or of memory): OpenMP ends the whole process where it fails
    to begin one.
    A process born by fork gets one: OpenMP's other threads do not live on in it, and waiting for
    them would never end.
    """
    wanted = share_of(wanted)
    if _state["forked"] or wanted <= 1 or tasks <= 1:
        return 1
    wanted = max(1, min(wanted, tasks, most_threads()))
    return wanted if wanted == 1 or _team.stands(wanted) else 1 + _can_begin(wanted - 1)


class _Team(threading.local):
    """Threads that OpenMP began for calls of this one, by their numbers; they wait for its next."""

    numbers: frozenset[str] = frozenset()

    def stands(self, count: int) -> bool:
        """Whether a team of so many, this thread included, is known to be there still."""
        return len(self.numbers) >= count - 1 > 0 and all(
            os.path.exists(f"{_TASKS}/{number}") for number in self.numbers)

    def now(self) -> frozenset[str]:
        """All threads of this process; none where the system does not say."""
        try:
            return frozenset(os.listdir(_TASKS))
        except OSError:
            return frozenset()


_team = _Team()


@contextmanager
def team_of(count: int) -> Iterator[None]:
    """While it lasts, OpenMP is used by so many threads, this one included.

    It keeps them for the next call; a larger team than the next one is let go in part.
    """
    if count == 1 or (len(_team.numbers) == count - 1 and _team.stands(count)):
        yield
        return
    here, before = _team.numbers, _team.now()
    _team.numbers = frozenset()
    yield
    after = _team.now()
    begun = (after - before) | (here & after)
    if len(begun) == count - 1:  # else others came or went meanwhile
        _team.numbers = begun


def _can_begin(wanted: int) -> int:
    """How many threads can be begun at this moment, of those wanted: by beginning them.

    Where not all can, half of those that could are left to what the others allocate.
    """
    release, begun = threading.Event(), []
    try:
        for _ in range(wanted):
            thread = threading.Thread(target=release.wait, daemon=True)
            thread.start()
            begun.append(thread)
    except (RuntimeError, MemoryError):
        pass
    finally:
        release.set()
        for thread in begun:
            thread.join()
    return len(begun) if len(begun) == wanted else len(begun) // 2


def _processors() -> int:
    return max(1, min(len(processors()), _cgroup_quota()))


def _cgroup_quota() -> int:
    """Whole processors a control group grants; a large number where none does."""
    try:
        with open("/sys/fs/cgroup/cpu.max", encoding="ascii") as file:
            quota, period = file.read().split()
        return max(1, int(quota) // int(period))
    except (OSError, ValueError, ZeroDivisionError):
        return 1 << 16
