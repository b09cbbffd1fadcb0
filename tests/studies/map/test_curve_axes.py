"""Maps with the transmission error, or amplitudes of it, along an axis."""

import numpy as np
import pytest

from helpers import PAIR, SHIPPED
from lapwing import TransmissionError, open_study, parameter_map
from lapwing.studies.map.run import job_of

SERIES = TransmissionError.harmonic([17e-6, 4.5e-6, 1.5e-6], [0.0, 1.0, 2.0])
CURVES = {"as ground": SERIES, "lapped": SHIPPED}
TORQUES = [1.0, 2.0, 4.0, 8.0]
SHORT = {"settle": 10, "record": 5, "pinion_speed_rpm": 1500}


@pytest.mark.parametrize("start", ["rest", "up"])
def test_a_map_over_curves_has_the_numbers_of_each(start, tmp_path):
    """Cut into shards as it may be, carried along the torque, in either order of the axes."""
    axes = {"te": CURVES, "brake_torque": TORQUES}
    found = parameter_map(PAIR, SERIES, axes, start=start, shard_runs=3, folder=tmp_path,
                          observe=("rms",), **SHORT)
    turned = parameter_map(PAIR, SERIES, dict(reversed(axes.items())), start=start,
                           line="brake_torque", threads=1, observe=("rms",), **SHORT)
    stored = open_study(tmp_path)
    assert stored["te"].values.tolist() == list(CURVES)
    for label, te in CURVES.items():
        alone = parameter_map(PAIR, te, {"backlash": [0.002], "brake_torque": TORQUES},
                              start=start, observe=("rms",), **SHORT)
        for name in ("deepest_separation", "arrivals", "phi_rms"):
            expected = alone[name].values[0].tobytes()
            assert found[name].sel(te=label).values.tobytes() == expected
            assert turned[name].sel(te=label).values.tobytes() == expected
            assert stored[name].sel(te=label).values.tobytes() == expected


def test_two_amplitudes_cross():
    found = parameter_map(PAIR, SERIES, {"harmonic_amplitude_1": [1e-5, 2e-5],
                                         "harmonic_amplitude_3": [0.0, 3e-6]},
                          brake_torque=1.8, **SHORT)
    te = TransmissionError.harmonic([2e-5, 4.5e-6, 3e-6], [0.0, 1.0, 2.0])
    alone = parameter_map(PAIR, te, {"backlash": [0.002], "brake_torque": [1.8]}, **SHORT)
    assert found["deepest_separation"].values[1, 1] == alone["deepest_separation"].item()
    assert np.unique(found["deepest_separation"].values).size > 1


def identity(curves, **changed):
    return job_of(PAIR, SERIES, {"te": curves, "brake_torque": TORQUES}, line=None, start="rest",
                  phase=0.0, numerics=None, shard_runs=None, **SHORT | changed).identity


def test_shards_are_of_their_curves_and_labels():
    """A file that is changed under the same name makes another study."""
    known = identity(CURVES)
    assert known == identity(dict(CURVES)) != identity({**CURVES, "lapped": 1.000001 * SHIPPED})
    assert known != identity({"as ground": SERIES, "other": SHIPPED})
    assert known != identity(dict(reversed(CURVES.items())))


@pytest.mark.parametrize(("axes", "options", "message"), [
    ({"te": CURVES}, {"start": "up", "line": "te"}, "nothing is carried along 'te'"),
    ({"te": CURVES, "harmonic_amplitude_1": [1e-6]}, {}, "te and harmonic_amplitude_1: each curve"),
    ({"te": CURVES, "parabola_amplitude": [1e-6]}, {}, "te and parabola_amplitude: each curve"),
    ({"te": [SERIES]}, {}, "expected .label: TransmissionError.")])
def test_what_has_no_order_or_no_meaning_is_refused(axes, options, message):
    with pytest.raises(ValueError, match=message):
        parameter_map(PAIR, SERIES, {"brake_torque": TORQUES, **axes}, **SHORT | options)
