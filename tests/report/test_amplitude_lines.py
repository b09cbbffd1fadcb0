"""What is said of amplitudes: the greatest number, where it is and from which start."""

import numpy as np
import pytest
from partial_data import DAMAGES

from lapwing.report.amplitudes import amplitude_lines, greatest
from lapwing.report.answers.findings import findings

NAMES = ("torque", "compliant", "rigid", "single", "negative", "speed")


@pytest.mark.parametrize("damage", DAMAGES, ids=lambda one: one.__name__)
@pytest.mark.parametrize("name", NAMES)
def test_the_greatest_is_that_of_the_points_that_are_there(damaged, name, damage):
    data = damaged("sweeps", name, damage)
    lines = amplitude_lines(data, "u")
    assert not any("nan" in line for line in lines)
    values = data["dynamic_te_rms"].values
    known = values[np.isfinite(values)]
    assert bool(lines) == bool(known.size)
    if known.size:
        assert lines[0].startswith("- greatest rms of the dynamic transmission error: "
                                   f"{1e6 * known.max():.4g} µrad at ")
    # Rigid teeth have no spring.
    assert any("mesh force" in line for line in lines) == bool(known.size and name != "rigid")


def test_it_says_where_and_from_which_start(sweeps):
    data = sweeps["speed"].copy(deep=True)
    data["dynamic_te_rms"][1, 2] = 1e-3
    assert greatest(data, "dynamic_te_rms", 1e6, "µrad", "rpm") == \
        "1000 µrad at 400 rpm (carried upwards)"
    said, = findings((), (), [data])
    assert "the dynamic transmission error has its greatest rms, 1000 µrad at 400 rpm" in said


def test_without_amplitudes_nothing_is_said(sweeps):
    assert amplitude_lines(sweeps["speed"].drop_vars("dynamic_te_rms"), "rpm") == []
