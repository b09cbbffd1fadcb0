"""An axis of labels: a column for each, its name below; nothing joins neighbours."""

import numpy as np
import pytest

from helpers import PAIR, SHIPPED
from lapwing import TransmissionError, parameter_map, sweep
from lapwing.plots.map import map_classes, parts
from lapwing.plots.sweep import (
    amplitudes,
    deepest_separation,
    exponents,
    impact_speed_density,
    orbit_diagram,
    staircase,
    waterfall,
)
from lapwing.plots.sweep import parts as sweep_parts
from lapwing.report.answers.besides import besides
from lapwing.report.map.findings import findings
from lapwing.report.map.text import map_text
from lapwing.report.sweep import sweep_text
from lapwing.results.file import write_results
from lapwing.results.findings import map_rattles

SERIES = TransmissionError.harmonic([17e-6, 4.5e-6, 1.5e-6], [0.0, 1.0, 2.0])
CURVES = {"z ground": SERIES, "kinked": TransmissionError.parabola(125e-6), "a shipped": SHIPPED}
FIGURES = (orbit_diagram, amplitudes, deepest_separation, exponents, impact_speed_density,
           staircase, waterfall)


@pytest.fixture(scope="module")
def swept():
    data = sweep(PAIR, SERIES, parameter="te", values=CURVES, settle=50, record=20,
                 brake_torque=1.8, pinion_speed_rpm=1500, observe=(
                     "cycles", "impacts", "exponents", "speeds", "spectra", "amplitudes"))
    return data.assign_attrs(name="curves", parameter="te")


@pytest.fixture(scope="module")
def plane():
    data = parameter_map(PAIR, SERIES, {"te": CURVES, "brake_torque": np.linspace(1, 25, 13)},
                         settle=50, record=20, pinion_speed_rpm=1500, observe=("rms",))
    return data.assign(full_engagement=("te", [11.9, np.nan, 17.0])).assign_attrs(name="plane")


def ticks(axis, side="x"):
    one = axis.xaxis if side == "x" else axis.yaxis
    return dict(zip(one.get_ticklocs().tolist(),
                    [text.get_text() for text in one.get_ticklabels()], strict=True))


NAMED = {float(i): label for i, label in enumerate(CURVES)}


@pytest.mark.parametrize("module", FIGURES, ids=lambda one: one.__name__.rpartition(".")[2])
def test_each_curve_has_a_column_with_its_label(swept, module):
    axes = [one for one in module.draw(swept).axes if one.get_label() != "<colorbar>"]
    assert ticks(axes[-1]) == NAMED or ticks(axes[0]) == NAMED
    low, high = axes[0].get_xlim()
    assert (low, high) == (-0.5, 2.5)
    for axis in axes[:1]:
        for line in axis.lines:  # across all columns, or a mark in one
            x = np.asarray(line.get_xdata())
            assert len(np.unique(x)) < 2 or set(np.unique(x)) <= {0, 1, 2}


def test_points_of_a_section_fill_their_column(swept):
    axis = orbit_diagram.draw(swept).axes[0]
    ends = np.concatenate([np.array(one.get_segments()) for one in axis.collections])[..., 0]
    middle, half = ends.mean(axis=1), np.ptp(ends, axis=1) / 2
    assert set(np.unique(middle).round(9)) == {0.0, 1.0, 2.0}
    np.testing.assert_allclose(half, sweep_parts.COLUMN)


def test_the_staircase_names_neighbours_of_one_class_apart(swept):
    same = swept.assign(motion_class=swept["motion_class"].copy(
        data=np.full((1, 3), "1:(1,0)")))
    named = [text.get_text() for text in staircase.draw(same).axes[1].texts]
    assert named.count("1:(1,0)") == 3


@pytest.mark.parametrize("side", "xy")
def test_a_map_names_its_columns_or_rows(plane, side):
    other = "y" if side == "x" else "x"
    data = plane.assign_attrs({f"{side}_parameter": "te", f"{other}_parameter": "brake_torque"})
    axis = map_classes.draw(data).axes[0]
    assert ticks(axis, side) == NAMED
    dashed = [line for line in axis.lines if line.get_linestyle() == "--"][-1]
    at, torque = (np.asarray(getattr(dashed, f"get_{one}data")()) for one in (side, other))
    # A level of its own in the column of each curve that has one, and nothing between.
    np.testing.assert_array_equal(at[:3], [-0.5, 0.5, np.nan])
    np.testing.assert_array_equal(torque[[0, 1, 3, 6, 7]], [11.9, 11.9, np.nan, 17.0, 17.0])
    assert parts.thinned(data)["te"].values.tolist() == [0, 1, 2]


def test_summaries_name_curves_in_their_order(swept, plane):
    text = "\n".join(sweep_text(swept))
    assert "transmission error 'z ground', 'kinked', 'a shipped': 3 values × 1 start" in text
    assert "- separation seen (anything but engagement of the drive flanks): at 'z ground'" in text
    assert "last" not in text and "| 'kinked' |" in text
    said, = besides([], [swept])
    assert "3 values looked at, 'z ground', 'kinked', 'a shipped'" in said
    for sides in (("te", "brake_torque"), ("brake_torque", "te")):
        data = plane.assign_attrs(dict(zip(("x_parameter", "y_parameter"), sides, strict=True)))
        told = "\n".join([*map_text(data), *findings(data)])
        rattling = map_rattles(data).transpose("te", "brake_torque").values
        for label, row in zip(CURVES, rattling, strict=True):
            line = next(one for one in told.splitlines() if one.startswith(f"| '{label}' |"))
            assert f"| {data['brake_torque'].values[row][-1]:g} |" in line
        assert "up to braking torque" in told and "nothing was looked at" not in told


def test_labels_are_text_of_a_result_file(swept, plane, tmp_path):
    import netCDF4

    write_results(tmp_path / "result.nc", deck_name="d", deck_text="", used_text="", used_hash="",
                  pair=PAIR, te=SERIES, te_sign="printed",
                  found={"sweep": {"curves": swept}, "map": {"plane": plane}})
    with netCDF4.Dataset(tmp_path / "result.nc") as file:
        for group in ("sweep_curves", "map_plane"):
            variable = file[group]["te"]
            assert variable.dtype == np.dtype("S1") and variable.dimensions[0] == "te"
            assert variable.long_name == "transmission error, by its label"
            variable.set_auto_chartostring(False)
            assert netCDF4.chartostring(variable[:]).tolist() == list(CURVES)
