"""Steps in contact that nobody looks at are taken in one go: the same motion to the last bit."""

import numpy as np
import pytest

from helpers import scene_a, scene_c
from lapwing import engine
from lapwing.engine import Numerics, Wanted

# Steps in contact make up most of each.
SCENES = {"table with kinks": scene_a(3.3), "series": scene_c(8.0),
          "series, compliant": scene_c(5.0, contact_law="compliant")}


def final(osc, wanted, *, start=(engine.REST, 0.0, 0.0, 0.0), max_steps=10_000_000):
    numerics = Numerics(method="rk4", rtol=1e-7, copy_repeats=False, max_steps_per_cycle=max_steps)
    return engine.sweep([osc], [(0, 0, False)], [start], numerics=numerics, wanted=wanted,
                        settle=2, record=12, log_room=20_000, threads=1)


@pytest.mark.parametrize("name", SCENES)
def test_looked_at_or_not(name):
    alone = final(SCENES[name], Wanted(events=True))
    watched = final(SCENES[name], Wanted(events=True, cycles=True, tangent=True))
    count = int(alone.outcome["logged"][0])
    assert alone.outcome["work"][0, 0] > 14 * 20  # there were steps to be skipped
    assert count == watched.outcome["logged"][0]
    for column in ("kind", "cycle", "t", "velocity_before", "velocity_after"):
        assert alone.logs()[0][column].tobytes() == watched.logs()[0][column].tobytes()
    for column in ("status", "motion_state", "phi", "phi_dot"):
        assert alone.outcome[column].tobytes() == watched.outcome[column].tobytes()
    assert np.array_equal(alone.outcome["work"][0, :5], watched.outcome["work"][0, :5])


def test_a_bound_on_steps_ends_both_alike():
    ends = [final(SCENES["series"], wanted, max_steps=50).outcome
            for wanted in (Wanted(events=True), Wanted(events=True, cycles=True, tangent=True))]
    assert ends[0]["status"][0] == ends[1]["status"][0] != 0
    for column in ("motion_state", "phi", "phi_dot"):
        assert ends[0][column].tobytes() == ends[1][column].tobytes()
