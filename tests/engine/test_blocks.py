"""A sweep in blocks: every point once, the same bytes, and the memory of what happened."""

import tracemalloc
from dataclasses import fields

import numpy as np
import pytest

from helpers import PAIR, SHIPPED, dataset_bytes, scene_a
from lapwing import engine, sweep
from lapwing.base import estimates
from lapwing.base.codes import EventKind, Status
from lapwing.engine import Numerics, Wanted, blocks, calls, sweeps
from lapwing.engine.records import IMPACT_TABLE

LINES = {
    "single": [(i, i, False) for i in range(23)],
    "three starts": [(23, 45, True), (68, 46, True), *((i, i, False) for i in range(23))],
    "ranges from rest": [(0, 9, False), (22, 10, False)],
    "one line": [(22, 0, True)],
    "none": [],
}


@pytest.mark.parametrize("most", [1, 2, 7, 22, 23, 1000])
@pytest.mark.parametrize("lines", LINES.values(), ids=LINES)
def test_every_point_is_in_one_block_and_lines_keep_their_order(lines, most):
    way = np.array(lines, dtype=np.intc).reshape(-1, 3)
    cut = list(blocks.cut(way, most))
    points = [blocks.points_of(pieces) for pieces in cut]
    expected = sorted(i for first, last, _ in lines for i in range(min(first, last),
                                                                   max(first, last) + 1))
    assert sorted(np.concatenate(points).tolist() if points else []) == expected
    # Pieces of each line one after the other; of each long one, and of all others together, a
    # block may have one point more than its part.
    assert all(len(some) <= most + 1 + sum(last != first for first, last, _ in lines)
               for some in points)
    if most >= len(expected):
        assert len(cut) <= 1
    for number, (first, last, _) in enumerate(lines):
        pieces = np.array([piece for some in cut for piece in some if piece[2] == number])
        step = 1 if last >= first else -1
        assert (pieces[0, 0], pieces[-1, 1]) == (first, last)
        assert pieces[1:, 0].tolist() == (pieces[:-1, 1] + step).tolist()
        assert pieces[:, 3].tolist() == [1] + [0] * (len(pieces) - 1)


def three_starts(threads=1, room=300, **options):
    """From rest, up and down over torques where all three differ, more impacts than room."""
    torques = np.linspace(0.4, 14, 17)
    points = [scene_a(torque, "relative") for _ in range(3) for torque in torques]
    lines = [(17, 33, True), (50, 34, True), *((i, i, False) for i in range(17))]
    wanted = Wanted(impacts=True, cycles=True, strobe=True, tangent=True,
                    speed_edges=tuple(np.geomspace(1e-9, 1e-3, 20)))
    return engine.sweep(points, lines, [(engine.REST, 0, 0, 0.25)] * len(lines),
                        numerics=Numerics(), wanted=wanted, settle=12, record=9, log_room=room,
                        threads=threads, **options)


@pytest.mark.parametrize("threads", [1, 3])
@pytest.mark.parametrize("most", [1, 4, 20])
def test_blocks_change_no_byte(most, threads, monkeypatch):
    whole = three_starts()
    assert np.any(whole.kept < whole.outcome["logged"]) and np.any(whole.kept == 300)
    monkeypatch.setattr(estimates, "LOG_BYTES", most * 300 * 7 * 8)
    monkeypatch.setattr(sweeps, "POINTS_PER_THREAD", 1)
    monkeypatch.setattr(calls, "CALL_SECONDS", 0.0 if threads > 1 else calls.CALL_SECONDS)
    seen = []
    parts = three_starts(threads, progress=seen.append)
    for field in fields(whole):
        one, other = getattr(whole, field.name), getattr(parts, field.name)
        if isinstance(one, np.ndarray):
            assert one.tobytes() == other.tobytes(), field.name
    assert seen == sorted(seen) and seen[-1] == 1 and len(seen) > 51 // max(most, threads) - 1


def test_chains_hand_over_what_failed(monkeypatch):
    """A point that fails lets the next one begin at rest, also where it ends a block."""
    def up(most):
        monkeypatch.setattr(estimates, "LOG_BYTES", most * 50 * 7 * 8)
        monkeypatch.setattr(sweeps, "POINTS_PER_THREAD", 1)
        points = [scene_a(torque, "relative") for torque in (14.0, 0.4, 14.0, 0.5, 1.8)]
        return engine.sweep(points, [(0, 4, True)], [(engine.REST, 0, 0, 0.0)], settle=3, record=4,
                            numerics=Numerics(max_events_per_cycle=40), log_room=50, threads=1,
                            wanted=Wanted(impacts=True, cycles=True))
    whole, single = up(10), up(1)
    assert set(whole.outcome["status"]) == {Status.OK, Status.TOO_MANY_EVENTS}
    assert whole.outcome.tobytes() == single.outcome.tobytes()
    assert whole.events.tobytes() == single.events.tobytes()


def test_an_interrupted_sweep_keeps_the_blocks_before(monkeypatch):
    whole = three_starts()
    monkeypatch.setattr(estimates, "LOG_BYTES", 8 * 300 * 7 * 8)
    monkeypatch.setattr(sweeps, "POINTS_PER_THREAD", 1)

    def stop(part):
        if part > 0.5:
            raise KeyboardInterrupt

    cut = three_starts(progress=stop, keep_interrupted=True)
    done = cut.outcome["status"] == Status.OK
    assert cut.interrupted and 0.5 < done.mean() < 0.9
    assert set(cut.outcome["status"][~done]) == {Status.UNFINISHED}
    assert cut.kept[done].tolist() == whole.kept[done].tolist() and not cut.kept[~done].any()
    assert cut.cycles[done].tobytes() == whole.cycles[done].tobytes()
    assert np.isnan(cut.cycles["phi"][~done]).all()
    logs = zip(cut.logs(), whole.logs(), done, strict=True)
    assert all(one.tobytes() == other.tobytes() for one, other, known in logs if known)
    with pytest.raises(KeyboardInterrupt):
        three_starts(progress=stop)


def test_some_columns_of_the_log():
    whole, some = three_starts(), three_starts(log_table=IMPACT_TABLE)
    assert some.events.dtype.itemsize == 17 and len(some.events) == len(whole.events)
    for name in IMPACT_TABLE.names:
        assert some.events[name].tolist() == whole.events[name].tolist()
    assert set(some.events["kind"]) == {EventKind.IMPACT, EventKind.BACK_IMPACT}


def test_the_studys_list_is_that_of_one_block(monkeypatch):
    def swept():
        return sweep(PAIR, SHIPPED, values=np.linspace(0.4, 12.5, 19), settle=10, record=5,
                     observe=("cycles", "impacts"), pinion_speed_rpm=240, threads=2,
                     max_impacts=100)
    whole = swept()
    monkeypatch.setattr(estimates, "LOG_BYTES", 5 * 100 * 7 * 8)
    monkeypatch.setattr(sweeps, "POINTS_PER_THREAD", 1)
    assert dataset_bytes(swept()) == dataset_bytes(whole)


def test_memory_follows_what_happened():
    """Sizes asked of numpy: room for all the points' logs at once were 470 MB."""
    def asked(points):
        tracemalloc.start()
        data = sweep(PAIR, SHIPPED, values=np.linspace(12.5, 16, points), starts=("rest",),
                     settle=0, record=1, observe=("impacts",), pinion_speed_rpm=240, threads=1)
        peak = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        assert data.sizes["impact"] == 0
        return peak
    asked(2)
    # One buffer for a block, and less than 3 kB of tables and what is made from them by point.
    bound = estimates.sweep_bytes(4200, 1, impacts=True)
    assert estimates.LOG_BYTES * 0.99 < bound < asked(4200) < estimates.LOG_BYTES + 4200 * 3000


def test_a_list_that_cannot_fit_is_refused(monkeypatch):
    monkeypatch.setattr(estimates, "LITTLE", 0)
    monkeypatch.setattr(estimates, "available_bytes", lambda: 10_000)
    with pytest.raises(MemoryError, match=r"sweep: needs at least .* are available; lower .*"
                       "max_impacts"):
        three_starts()
