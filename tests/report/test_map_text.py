"""What is said of a map, also where runs are missing or failed."""

import re

import numpy as np
import pytest
import xarray as xr

from lapwing import Status, TransmissionError, parameter_map
from lapwing.base.codes import MotionState
from lapwing.base.quantities import OBSERVED
from lapwing.plots import style
from lapwing.plots.map import (
    map_arrivals,
    map_classes,
    map_depth,
    map_exponent,
    map_force,
    map_rms,
    parts,
)
from lapwing.report.map.findings import findings
from lapwing.report.map.text import headline, map_text
from lapwing.results.findings import KINDS, map_kinds, map_rattles
from lapwing_bench.scenes import PAIR

FIGURES = (map_classes, map_depth, map_arrivals, map_exponent, map_force, map_rms)
TE = TransmissionError.harmonic([17e-6, 4.5e-6, 1.5e-6], [0.0, 1.0, 2.0], [1, 2, 3])


@pytest.fixture(scope="module")
def plane():
    data = parameter_map(PAIR, TE, {"pinion_speed_rpm": np.linspace(500, 3000, 6),
                                    "brake_torque": np.linspace(0.5, 13, 8)},
                         settle=100, record=50, threads=2, observe=tuple(OBSERVED))
    full = ("pinion_speed_rpm", np.linspace(1.0, 40.0, 6))
    return data.assign(full_engagement=full).assign_attrs(
        name="plane", x_parameter="pinion_speed_rpm", y_parameter="brake_torque")


def lost(data, status, where):
    """The same with some runs without a result."""
    data = data.copy(deep=True)
    data["status"].values[where] = status
    for name in ("deepest_separation", "fastest_arrival", "impacts_per_cycle",
                 "back_impacts_per_cycle", "deepest_back_penetration",
                 *(one for names in OBSERVED.values() for one in names)):
        data[name].values[where] = np.nan
    for name in ("period", "arrivals", "back_arrivals", "chatter", "states_visited"):
        data[name].values[where] = 0
    return data


def test_kinds_are_by_what_arrives_and_repeats(plane):
    names, found = map_kinds(plane)
    assert names == KINDS
    for at in np.ndindex(found.shape):
        run = plane.isel(pinion_speed_rpm=at[0], brake_torque=at[1])
        period, back = int(run["period"]), int(run["back_arrivals"]) > 0
        engaged = int(run["states_visited"]) == 1 << MotionState.ENGAGEMENT
        word = names[int(found.values[at])]
        assert (word == "engaged throughout") == (engaged and not run["arrivals"] and not back)
        assert ("back impacts" in word) == back
        assert ("no period" in word) == (period == 0)
    assert len(np.unique(found)) > 2
    assert np.array_equal(map_rattles(plane).values, found.values != 0)


def test_a_whole_map_in_words(plane):
    text, said = "\n".join(map_text(plane)), " ".join(findings(plane))
    seen = plane["brake_torque"].values[map_rattles(plane).values.any(axis=0)].max()
    assert "(48 runs from rest, map `" in said
    assert f"separation seen up to braking torque {seen:g} N·m" in said and "may hold" not in said
    assert "none of 48 failed" in text and "T_full (N·m)" in text
    assert text.count("| 8 of 8 |") == 6
    assert headline(plane).startswith("48 of 48 runs have a result, over pinion speed and braking")


@pytest.mark.parametrize("status", [Status.UNFINISHED, Status.TOO_MANY_EVENTS])
def test_what_is_missing_is_said_and_judges_nothing(plane, status):
    top = np.zeros(plane["status"].shape, dtype=bool)
    top[:, 4:] = True
    data = lost(plane, status, top)
    text, said = "\n".join(map_text(data)), " ".join(findings(data))
    assert "(24 of 48 runs from rest, map `" in said
    assert "24 runs without a result may hold others" in said
    assert ("**24 not reached**" in text) == (status == Status.UNFINISHED)
    assert ("24 of 48 failed" in text) == (status != Status.UNFINISHED)
    assert text.count("| 4 of 8 |") == 6
    last = plane["brake_torque"].values[3]
    assert f"up to braking torque {last:g}" in said and "(the last one looked at)" not in said


    share = 100 * map_rattles(data).values[:, :4].mean()
    assert f"seen in {share:.3g} % of the runs that have a result" in text


def test_rest_on_the_coast_flank_is_no_separation():
    data = parameter_map(PAIR, TE, {"pinion_speed_rpm": [300.0], "brake_torque": [-14.0, -9.0]},
                         settle=50, record=20).assign_attrs(
        name="p", x_parameter="pinion_speed_rpm", y_parameter="brake_torque")
    assert not data["deepest_separation"].values.any() and map_rattles(data).values.all()
    text, (said,) = "\n".join(map_text(data)), findings(data)
    assert "Over pinion speed 300 rpm and braking torque -14 to -9 N·m" in said
    assert "(2 runs from rest, map `p`) no separation seen; no back impacts seen" in said
    assert "| 300 | none | none |" in text
    (alone,) = findings(data.isel(brake_torque=[0]))
    assert "braking torque -14 N·m" in alone and "(1 run from rest, map" in alone


def test_a_map_says_by_what_to_choose(plane):
    """Of each speed the least torque from which on every run is known, engaged, and T_full."""
    rattles = map_rattles(plane).values
    torque, full = plane["brake_torque"].values, plane["full_engagement"].values
    least = [next((value for j, value in enumerate(torque)
                   if not rattles[i, j:].any() and value >= full[i]), np.nan) for i in range(6)]
    said, above = findings(plane)[0], findings(plane)[-1]
    speed = plane["pinion_speed_rpm"].values
    there = np.flatnonzero(np.isfinite(least))
    assert 2 <= there.size < 6 and speed[-1] not in speed[there]
    for i in there:
        edge = {torque[0]: " (the lowest looked at)", torque[-1]: " (the highest looked at)"}
        assert f"{least[i]:g} N·m{edge.get(least[i], '')} at {speed[i]:g} rpm" in said
    assert f"{speed[-1]:g} rpm more than the 13 N·m looked at, or not known" in said
    known = torque > full[:, None]
    assert not (known & rattles).any()
    assert f"none of {known.sum()} runs from rest rattles" in above
    deeper = plane.assign(full_engagement=("pinion_speed_rpm", 0.5 * np.minimum(full, 16.0)))
    known = torque > deeper["full_engagement"].values[:, None]
    assert 0 < (known & rattles).sum() < known.sum()
    assert (f"{(known & rattles).sum()} of {known.sum()} runs from rest rattle all the same, at "
            "pinion speed ") in findings(deeper)[-1]
    quiet = plane.isel(pinion_speed_rpm=[0], brake_torque=[6, 7]).assign(
        full_engagement=("pinion_speed_rpm", [1.0]))
    assert findings(quiet)[0].startswith(f"**Choose at least {torque[6]:.6g} N·m on the gear**")
    assert "none of 2 runs from rest rattles" in findings(quiet)[-1]
    lacking = lost(quiet, Status.UNFINISHED, (0, 1))
    assert findings(lacking)[0].startswith("**Which torque to choose map `plane` does not answer**")


def test_beside_torques_looked_at_singly_a_map_gives_no_second_choice(plane):
    """The searches of a run say 12.5 N·m, a map of single runs from rest 12 at the same speed."""
    alone, beside = findings(plane), findings(plane, chosen=True)
    assert alone[0].startswith("**Choose ") and alone[1:] == beside[1:]
    assert not any("Choose" in sentence or "One start alone" in sentence for sentence in beside)
    assert "from one start each" in beside[0] and "that holds" in beside[0]
    few = plane.isel(brake_torque=[0])
    assert "does not answer" in findings(few)[0] and "answer" not in findings(few, chosen=True)[0]


def test_ranges_are_told_by_the_most_that_any_of_their_speeds_needs():
    """A narrow peak between two speeds told would be missed: every speed lies in a range."""
    speeds = np.arange(100.0, 400.0, 10.0)
    torques = np.arange(1.0, 9.0)
    needed = np.where(speeds == 230, 7.0, 3.0)
    needed[20:22] = np.nan  # never quiet
    rattles = ~(torques >= needed[:, None])
    axes = ("pinion_speed_rpm", "brake_torque")
    engaged = 1 << MotionState.ENGAGEMENT
    data = xr.Dataset({"status": (axes, np.zeros(rattles.shape, int)),
                       "states_visited": (axes, np.full(rattles.shape, engaged)),
                       "deepest_separation": (axes, 1e-6 * rattles),
                       "arrivals": (axes, rattles.astype(int)),
                       "back_arrivals": (axes, np.zeros(rattles.shape, int))},
                      coords={axes[0]: speeds, axes[1]: torques},
                      attrs={"x_parameter": axes[0], "y_parameter": axes[1], "start": "rest",
                             "name": "p", "contact_law": "restitution"})
    said = findings(data)[0]
    told = [tuple(map(float, one)) for one in re.findall(
        r"([\d.]+) N·m from ([\d.]+) to ([\d.]+) rpm", said)]
    for speed, torque in zip(speeds, needed, strict=True):
        most = [value for value, low, high in told if low <= speed <= high]
        assert most == [] if np.isnan(torque) else len(most) == 1 and most[0] >= torque
    assert {value for value, _, _ in told} == {3.0, 7.0}
    assert "at 300 to 310 rpm more than the 8 N·m looked at" in said
    assert "beyond 100 and 390 rpm nothing was looked at" in said


@pytest.mark.parametrize("status", [Status.UNFINISHED, Status.STEP_TOO_SMALL])
def test_nothing_known_says_so(plane, status):
    data = lost(plane, status, np.ones(plane["status"].shape, dtype=bool))
    assert findings(data) == []
    assert "nothing is known" in map_text(data)[-1]
    assert headline(data).startswith("0 of 48 runs")
    assert not any(figure.shows(data) for figure in FIGURES)


@pytest.mark.parametrize("figure", FIGURES)
@pytest.mark.parametrize("damage", [None, Status.UNFINISHED, Status.TOO_MANY_EVENTS])
def test_figures_tell_failed_from_missing(plane, figure, damage):
    data = plane
    if damage is not None:
        where = np.zeros(plane["status"].shape, dtype=bool)
        where[2:4, 1:5] = True
        data = lost(plane, damage, where)
    assert figure.shows(data)
    drawn = figure.draw(data, {"backlash": 2e-3}, title="deck, map 'plane'")
    words = [text.get_text() for legend in drawn.legends for text in legend.get_texts()]
    assert ("not reached" in words) == (damage == Status.UNFINISHED)
    assert ("failed" in words) == (damage == Status.TOO_MANY_EVENTS)
    assert any("T_full" in word for word in words)
    axis = drawn.axes[0]
    assert axis.get_xlabel() == "pinion speed (rpm)"
    assert axis.get_ylabel() == "braking torque (N·m)"


@pytest.mark.parametrize("figure", FIGURES)
def test_of_more_values_than_pixels_some_are_drawn_and_the_axis_says_so(plane, figure, monkeypatch):
    monkeypatch.setattr(parts, "MOST_VALUES", 3)
    axis = figure.draw(plane).axes[0]
    assert axis.get_xlabel() == "pinion speed (rpm), one of 2 values drawn"
    assert axis.get_ylabel() == "braking torque (N·m), one of 3 values drawn"
    assert {image.get_array().shape for image in axis.images} == {(3, 3, 4)}


def test_each_cell_is_as_wide_as_it_is():
    """Values at unequal distances: the middle of each cell has its colour, whatever its width."""
    data = parameter_map(PAIR, TE, {"brake_torque": [0.5, 1.0, 5.0, 12.0],
                                    "pinion_speed_rpm": [900.0, 1500.0, 1600.0]},
                         settle=20, record=20).assign_attrs(
        x_parameter="pinion_speed_rpm", y_parameter="brake_torque")
    axis = parts.new_plane("")[1]
    values = np.arange(12.0).reshape(4, 3)
    image = parts.cells(axis, data, values, cmap="viridis")
    drawn = axis.images[0].get_array()
    for i, torque in enumerate(data["brake_torque"].values):
        for j, speed in enumerate(data["pinion_speed_rpm"].values):
            at = [int((value - low) / (high - low) * size) for value, (low, high), size in zip(
                (torque, speed), (axis.get_ylim(), axis.get_xlim()), drawn.shape, strict=False)]
            assert np.array_equal(drawn[*at], image.to_rgba(values[i, j], bytes=True))


def test_of_very_many_edges_the_cells_are_coloured(plane, monkeypatch):
    monkeypatch.setattr(parts, "MOST_EDGES", 0)
    axis = parts.new_plane("")[1]
    where = np.zeros(parts.known(plane).shape, dtype=bool)
    where[1:4, 2:5] = True
    parts.outline(axis, plane, where, style.VERMILION)
    inside = np.zeros_like(where)
    inside[2, 3] = True
    assert not axis.lines
    assert np.array_equal(axis.images[0].get_array()[..., 3] > 0, where & ~inside)


@pytest.mark.parametrize("cells", [[(0, 0)], [(2, 3), (2, 4)], [(5, 7)], "all", "row", "column"])
def test_the_outline_goes_round_the_cells_of_back_impacts(plane, cells):
    speed, torque = "pinion_speed_rpm", "brake_torque"
    data = {"row": plane.isel({torque: [1]}), "column": plane.isel({speed: [1]})}.get(
        cells if isinstance(cells, str) else "", plane).copy(deep=True)
    back = np.zeros(data["status"].transpose(torque, speed).shape, dtype=bool)
    for at in cells if isinstance(cells, list) else np.ndindex(*back.shape[::-1]):
        back[at[::-1]] = True
    data["back_impacts_per_cycle"] = ((torque, speed), back.astype(float))
    drawn = map_arrivals.draw(data).axes[0]
    (line,) = (one for one in drawn.lines if one.get_color() == style.VERMILION)
    edges = line.get_xydata().reshape(-1, 3, 2)
    segments = edges[:, :2]
    assert np.isfinite(segments).all() and np.isnan(edges[:, 2]).all()
    # Shoelace formula over the edges, each turned so that the marked cell is at its left.
    spans = [np.ptp(edges) / n for edges, n in zip(
        (drawn.get_xlim(), drawn.get_ylim()), back.shape[::-1], strict=True)]
    low = [lim[0] for lim in (drawn.get_xlim(), drawn.get_ylim())]
    unit = np.rint((segments - low) / spans).astype(int)
    upright = unit[unit[:, 0, 0] == unit[:, 1, 0]]
    area = 0
    for (x, j), _ in upright:
        area += -x if x < back.shape[1] and back[j, x] else x
    assert area == back.sum()
    assert len(upright) % 2 == 0 and len(unit) > len(upright)


@pytest.mark.parametrize(("full", "seen"), [(5.0, True), (40.0, False), (np.nan, False)])
@pytest.mark.parametrize("turned", [False, True])
def test_full_engagement_at_one_value_is_a_line_where_it_lies_in_the_panel(plane, full, seen,
                                                                           turned):
    data = plane.isel(pinion_speed_rpm=[2]).assign(full_engagement=("pinion_speed_rpm", [full]))
    if turned:
        data = data.assign_attrs(x_parameter="brake_torque", y_parameter="pinion_speed_rpm")
    drawn = map_classes.draw(data)
    words = [text.get_text() for text in drawn.legends[0].get_texts()]
    assert any("T_full" in word for word in words) == seen
    if seen:
        axis = drawn.axes[0]
        x, y = axis.lines[-1].get_data()
        along, across = (y, x) if turned else (x, y)
        limits = axis.get_ylim() if turned else axis.get_xlim()
        assert np.all(across == full) and tuple(along) == limits


def test_logarithmic_and_single_values_can_be_drawn():
    for speeds in ([1500.0], np.geomspace(200, 3000, 5)):
        data = parameter_map(PAIR, TE, {"brake_torque": [0.5, 5.0], "pinion_speed_rpm": speeds},
                             settle=20, record=20).assign_attrs(
            name="p", x_parameter="pinion_speed_rpm", y_parameter="brake_torque")
        for figure in (map_classes, map_depth, map_arrivals):
            axis = figure.draw(data).axes[0]
            assert axis.get_xscale() == ("log" if len(speeds) > 1 else "linear")
        assert findings(data)


def test_what_was_asked_for_besides_is_told_where_it_is_known(plane):
    text = "\n".join(map_text(plane))
    peak = plane["mesh_force_peak"]
    place = peak.where(peak == peak.max(), drop=True)
    assert (f"to {float(peak.max()):.4g} N, the largest at pinion speed "
            f"{float(place['pinion_speed_rpm'][0]):g} rpm and braking torque "
            f"{float(place['brake_torque'][0]):g} N·m") in text
    share = 100 * float(plane["engagement_share"].mean())
    assert f"{share:.3g} % in engagement" in text
    rate = plane["lyapunov_exponent"].values
    assert f"above 0 in {100 * (rate > 0).mean():.3g} % of 48 runs" in text
    assert "of chaos" in text and "graze" not in text
    some = plane.copy(deep=True)
    some["lyapunov_exponent"].values[0, :2] = np.nan
    some["mesh_force_peak"].values[:] = np.nan
    text = "\n".join(map_text(some))
    assert "of 46 runs" in text and "not known in 2 runs that graze a flank" in text
    assert "peak mesh force, impacts apart: not known, the rigid" in text
    plain = "\n".join(map_text(plane.drop_vars([
        name for names in OBSERVED.values() for name in names])))
    assert "Lyapunov" not in plain and "rms" not in plain and "time of all runs" not in plain


def test_an_exponent_without_a_number_has_a_colour_of_its_own(plane):
    data = plane.copy(deep=True)
    data["lyapunov_exponent"].values[0, 0] = -np.inf
    data["lyapunov_exponent"].values[1, 1] = np.nan
    words = [text.get_text() for text in map_exponent.draw(data).legends[0].get_texts()]
    assert any(word.startswith("-∞") for word in words)
    assert any(word.startswith("not known") for word in words)


@pytest.mark.parametrize("turned", [False, True])
def test_the_last_rattling_torque_is_drawn_where_the_map_knows_it(plane, turned):
    if turned:
        plane = plane.assign_attrs(x_parameter="brake_torque", y_parameter="pinion_speed_rpm")
    speeds, torques = plane["pinion_speed_rpm"].values, plane["brake_torque"].values
    rattles = map_rattles(plane).transpose("pinion_speed_rpm", "brake_torque").values
    lost_one = plane.copy(deep=True)
    lost_one["status"].values[4, -1] = Status.UNFINISHED
    lost_one["states_visited"].values[4, -1] = 0
    for data, unknown in ((plane, None), (lost_one, 4)):
        axis = parts.new_plane("")[1]
        parts.cells(axis, data, np.zeros((8, 6)[:: -1 if turned else 1]), cmap="viridis")
        assert parts.mark_last_rattling(axis, data)
        edges, line = axis.lines[-1].get_data()[:: -1 if turned else 1]
        assert len(edges) == len(speeds) + 1
        for i in range(len(speeds)):
            told = rattles[i].any() and not rattles[i, -1] and i != unknown
            last = torques[rattles[i]].max() + 0.5 * np.diff(torques)[0] if told else np.nan
            np.testing.assert_allclose(line[i], last)


def test_a_legend_takes_no_more_room_than_the_figure_has(plane):
    data = plane.copy(deep=True)
    period, back = data["period"].values, data["back_arrivals"].values
    period.flat[:10], back.flat[:10] = [1, 2, 3, 5, 0, 1, 2, 0, 5, 5], [0] * 5 + [1] * 5
    data["arrivals"].values.flat[:10] = 1
    drawn = map_classes.draw(data)
    (legend,) = drawn.legends
    assert len(legend.get_texts()) >= 9
    assert legend.get_window_extent().width <= drawn.bbox.width
