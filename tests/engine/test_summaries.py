"""What the engine tells of each point's recorded cycles, against the cycles themselves."""

import numpy as np
import pytest

from helpers import scene_a, scene_c
from lapwing import engine
from lapwing.base.codes import EventKind, Status
from lapwing.engine import Numerics, Wanted
from lapwing.engine.records import EXTREMES


def swept(oscillators, *, keep_cycles, threads=1, record=60, impacts=False, method="auto"):
    n = len(oscillators)
    return engine.sweep(
        oscillators, [(i, i, False) for i in range(n)], [(engine.REST, 0, 0, 0.0)] * n,
        numerics=Numerics(rtol=1e-8, method=method), wanted=Wanted(cycles=True, impacts=impacts),
        settle=30, record=record, log_room=20_000, threads=threads, keep_cycles=keep_cycles)


@pytest.mark.parametrize("law", ["restitution", "compliant"])
@pytest.mark.parametrize("scene", [scene_a, scene_c])
@pytest.mark.parametrize("method", ["exact", "rk4"])
def test_extremes_are_those_of_the_cycles(scene, law, method):
    options = {"contact_law": law} if scene is scene_c else {
        "contact_law": law, "impact_law": "relative"}
    oscillators = [scene(torque, **options) for torque in np.linspace(0.3, 13, 12)]
    found = swept(oscillators, keep_cycles=True, impacts=True, method=method)
    for row, cycles, log in zip(found.outcome, found.cycles, found.logs(), strict=True):
        assert row["deepest_separation"] == cycles["deepest_separation"].max()
        assert row["deepest_back_penetration"] == cycles["deepest_back_penetration"].max()
        visited = np.bitwise_or.reduce(cycles["states_visited"].astype(int))
        assert row["states_visited"] == visited
        if law == "restitution":
            hits = log[np.isin(log["kind"], [EventKind.IMPACT, EventKind.BACK_IMPACT])]
            assert len(hits) == len(log)
            assert row["fastest_arrival"] == np.abs(hits["velocity_before"]).max(initial=0)
        else:
            arrives = cycles["engages"].sum() + cycles["back_engages"].sum() > 0
            assert (row["fastest_arrival"] > 0) == arrives
    assert len(np.unique(found.outcome["deepest_separation"])) > 5


def test_without_their_table_points_end_alike(monkeypatch):
    """One table for all, and calls cut in the middle of points."""
    from lapwing.engine import calls

    oscillators = [scene_a(torque, "relative") for torque in np.linspace(0.3, 13, 40)]
    kept = swept(oscillators, keep_cycles=True, threads=2)
    monkeypatch.setattr(calls, "CALL_SECONDS", 0.0)
    alone = swept(oscillators, keep_cycles=False, threads=2)
    assert alone.outcome.tobytes() == kept.outcome.tobytes()
    assert alone.cycles.shape[0] == 1 and np.all(kept.outcome["status"] == Status.OK)
    assert set(EXTREMES) < set(kept.outcome.dtype.names)
