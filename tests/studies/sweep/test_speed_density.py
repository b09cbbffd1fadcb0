"""Impacts counted by speed in the engine, against the impacts themselves."""

import numpy as np
import pytest

from helpers import PAIR, SHIPPED, dataset_bytes
from lapwing import Status, sweep
from lapwing.base.arrivals import listed_impacts
from lapwing.engine import calls

OPERATION = {"pinion_speed_rpm": 240, "impact_law": "relative", "settle": 40, "record": 20,
             "values": [0.4, 1.8, 5.5, 13.0], "starts": ("rest", "up")}


@pytest.fixture(scope="module")
def swept():
    return sweep(PAIR, SHIPPED, observe=("cycles", "impacts", "speeds"), **OPERATION)


def test_counts_are_those_of_the_impacts(swept):
    edges = swept["speed_edge"].values
    assert edges[-1] / edges[0] == pytest.approx(1e4) and len(edges) == 161
    for start in (0, 1):
        for point in range(4):
            places, _ = listed_impacts(swept.isel(start=start, brake_torque=point))
            speed = np.abs(swept["impact_velocity"].values[places])
            # A speed within rounding of an edge may fall on either side; none does here.
            assert np.abs(np.log(speed[:, None] / edges)).min(initial=1) > 1e-12
            counted, _ = np.histogram(speed, edges)
            assert (20 * swept["impact_speed_density"].values[start, point]).round(9).tolist() \
                == counted.tolist()
            assert 20 * swept["slow_impacts"].values[start, point] == pytest.approx(
                np.sum(speed < edges[0]))
    assert swept["impact_speed_density"].values[:, :3].any(axis=-1).all()
    assert not swept["impact_speed_density"].values[:, 3].any()


def test_where_a_call_is_cut_changes_no_count(swept, monkeypatch):
    monkeypatch.setattr(calls, "CALL_SECONDS", 0.0)
    again = sweep(PAIR, SHIPPED, observe=("cycles", "impacts", "speeds"), threads=2, **OPERATION)
    assert dataset_bytes(again) == dataset_bytes(swept)


def test_what_is_faster_than_the_last_bin_is_in_it(swept, monkeypatch):
    from lapwing.studies.sweep import run as study

    edges = swept["speed_edge"].values
    monkeypatch.setattr(study, "_speed_edges", lambda oscillators: edges / 1e3)
    low = sweep(PAIR, SHIPPED, observe=("cycles", "speeds"), **OPERATION)
    total = low["impact_speed_density"].sum("speed_bin") + low["slow_impacts"]
    every = (low["impacts"] + low["back_impacts"]).mean("recorded_cycle")
    assert total.values == pytest.approx(every.values, rel=1e-12)
    assert low["impact_speed_density"].values[0, 1, -1] > 1


def test_a_failed_point_has_no_counts():
    data = sweep(PAIR, SHIPPED, observe=("cycles", "speeds"), max_events_per_cycle=2,
                 **{**OPERATION, "values": [1.0, 14.0], "settle": 2})
    assert data["status"].values[0].tolist() == [Status.TOO_MANY_EVENTS, Status.OK]
    assert np.all(np.isnan(data["impact_speed_density"].values[0, 0]))
    assert np.all(data["impact_speed_density"].values[0, 1] == 0)
