"""The engine's tables by name: the order of their columns, and no number lost on the way."""

import numpy as np

from helpers import scene_a
from lapwing.base.codes import EventKind
from lapwing.engine import Numerics, TrajectoryCall, Wanted, numbers, of_kind, unknown
from lapwing.engine.records import CYCLE_TABLE, EVENT_TABLE, SAMPLE_TABLE, named


def test_rows_and_names_are_the_same_bytes():
    rows = np.arange(28.0).reshape(2, 2, 7)
    table = named(rows, EVENT_TABLE)
    assert table.shape == (2, 2) and table["kind"].tolist() == [[0, 7], [14, 21]]
    assert table["flight_depth"][1, 1] == 27
    assert numbers(table).tobytes() == rows.tobytes()
    assert named(np.zeros((0, 7)), EVENT_TABLE).shape == (0,)


def test_what_was_not_recorded_is_unknown():
    assert np.isnan(numbers(unknown(CYCLE_TABLE, 3))).all()
    assert unknown(SAMPLE_TABLE, 2, 0).shape == (2, 0)


def test_columns_mean_what_their_names_say():
    """Told apart by what holds between them on a motion that separates and bounces."""
    osc = scene_a(1.8, impact_law="relative")
    call = TrajectoryCall(osc, (-1.0, 0.0, 0.0, 0.0), numerics=Numerics(rtol=1e-8),
                          wanted=Wanted(events=True, cycles=True))
    call.run((20, 0.0), [(10, 0.25 * osc.period)])
    events, cycles = call.events, call.cycles
    assert cycles["cycle"].tolist() == list(range(20))
    for kind, column in ((EventKind.IMPACT, "impacts"), (EventKind.RELEASE, "releases"),
                         (EventKind.ENGAGE, "engages"), (EventKind.CHATTER_END, "chatter_ends")):
        seen = np.bincount(of_kind(events, [kind])["cycle"].astype(int), minlength=20)
        assert seen.tolist() == cycles[column].tolist(), column
    impacts = of_kind(events, [EventKind.IMPACT])
    assert len(impacts) and np.all(impacts["velocity_before"] > 0)
    assert np.allclose(impacts["velocity_after"], -osc.restitution * impacts["velocity_before"],
                       rtol=1e-12, atol=0)
    assert np.all((events["t"] >= 0) & (events["t"] <= osc.period))
    assert np.all(cycles["deepest_separation"] >= np.maximum(0, -cycles["phi"]))
    separated = cycles["motion_state"] == 0
    assert np.all(cycles["phi"][separated] <= 0) and call.samples.shape == (1,)
