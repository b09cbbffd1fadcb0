"""Every figure is drawn from the file alone, for every kind of motion, and says its units."""

import re
import subprocess
import sys
import warnings

import numpy as np
import pytest
from plot_data import CURVES, RESPONSES, make_curve

from lapwing import Status, plots
from lapwing.plots import style, typeface
from lapwing.plots.critical_marks import marks_of
from lapwing.plots.response.trajectory import path
from lapwing.plots.sweep import parts as sweep_parts
from lapwing.plots.sweep.deepest_separation import _crossings, _free_place

SWEEPS = ("torque", "failed", "speed", "plain")
UNIT = re.compile(r"\((µrad|arcsec|N|N·m|rad/s|mm/s|mN·s|ms|rpm|Hz|mesh periods|mesh cycles|"
                  r"per mesh cycle|"
                  r"multiples of the mesh frequency|µrad per mesh period|"
                  r"(µrad|arcsec) per degree of the pinion|µrad per τ)[;)]")
# Placing everything takes long, so it is done for the studies most unlike each other only.
LAID_OUT = ("chatter", "failed", "rigid_engaged", "torque")
SHARE = re.compile(r"% of those followed|per mesh cycle examined|^$")
WITHOUT_UNIT = ("impacts\nper cycle", "recorded mesh cycle", "larger Floquet\nmultiplier |λ|",
                "impacts per mesh cycle and decade of speed", "each\nfrom rest",
                "carried\nupwards", "carried\ndownwards")


def draw(module, dataset, pair, laid_out=False, **options):
    """Figure of a module; a warning of the drawing library is an error."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        figure = plots.figure_of(module, dataset, gear_pair=pair, **options)
        if laid_out:
            figure.draw_without_rendering()
    return figure


def labels(figure):
    """All axis labels, those of second scales as well."""
    axes = [one for axis in figure.axes for one in (axis, *axis.child_axes)]
    return [text for axis in axes for text in (axis.get_xlabel(), axis.get_ylabel()) if text]


def texts(figure):
    """Everything written inside the panels, and the heading."""
    return [figure.get_suptitle(), *(text.get_text() for axis in figure.axes
                                     for text in axis.texts)]


def assert_units(figure):
    found = labels(figure)
    assert found
    for label in found:
        assert UNIT.search(label) or label in WITHOUT_UNIT, label


# The shafts' motion has a test beside that of two degrees of freedom.
OF_RESPONSES = [one for one in plots.FIGURES["response"] if not one.endswith("shaft_motion")]


@pytest.mark.parametrize("module", OF_RESPONSES)
@pytest.mark.parametrize("name", RESPONSES)
def test_a_response_is_drawn(results, module, name):
    figure = draw(module, results.response(name), results.gear_pair, name in LAID_OUT)
    assert_units(figure)
    assert name in figure.get_suptitle()


@pytest.mark.parametrize("module", OF_RESPONSES)
def test_a_response_is_drawn_without_its_gear_pair(results, module):
    assert_units(draw(module, results.response("periodic"), None))


@pytest.mark.parametrize("module", plots.FIGURES["sweep"])
@pytest.mark.parametrize("name", SWEEPS)
def test_a_sweep_is_drawn(results, module, name):
    if not plots.shows(module, results.sweep(name)):
        stems = [task.stem for task in plots.tasks_of(results)]
        assert f"{module.rpartition('.')[2]}_{name}" not in stems
        # Nothing was counted, or nothing but the points that failed would have struck.
        assert name == "plain" or (module.endswith("density") and name == "failed")
        return
    assert_units(draw(module, results.sweep(name), results.gear_pair, name in LAID_OUT))


@pytest.mark.parametrize("name", ["speed", "safe", "all_safe", "failing", "back", "no_back"])
def test_a_search_is_drawn(results, name):
    figure = draw("critical_search", results.critical(name), results.gear_pair, laid_out=True)
    shown = [label for label in labels(figure) if not SHARE.search(label)]
    assert shown and all(UNIT.search(label) for label in shown), shown
    assert name in figure.get_suptitle()
    legend = [text.get_text() for text in figure.legends[0].get_texts()]
    assert any("failed" in words for words in legend) == (name == "failing")


def test_the_bracket_of_a_search_is_shown(results):
    critical = results.critical("safe")
    figure = draw("critical_search", critical, results.gear_pair)
    for axis in figure.axes:
        low, high = axis.patches[0].get_extents().transformed(axis.transData.inverted()).intervalx
        assert (low, high) == pytest.approx((critical.rattling, critical.clean))
    low, high = figure.axes[1].get_xlim()
    assert low < critical.rattling < critical.clean < high < 13


def test_the_step_of_a_search_goes_through_every_value_tried_from_all_starts(results):
    critical = results.critical("safe")
    axis = draw("critical_search", critical, results.gear_pair).axes[0]
    step, = (line for line in axis.lines if line.get_drawstyle() == "steps-mid")
    shown = dict(zip(*(column.tolist() for column in step.get_data()), strict=True))
    squares, = (line for line in axis.lines if line.get_marker() == "s")
    for value, share in squares.get_xydata():
        assert shown[value] == share
    assert max(shown) == 13 and min(shown) <= 12


def test_critical_values_are_marked_on_a_sweep(results):
    marks = marks_of([results.critical(name) for name in results.criticals], "brake_torque")
    # Not the search at another speed, and none that found nothing.
    assert [mark.find for mark in marks] == ["back", "full", "safe"]
    marks[0] = marks[0]._replace(low=2.0, high=2.5)  # into the range of this sweep
    for module, panels in (("orbit_diagram", 4), ("deepest_separation", 1), ("staircase", 1),
                           ("exponents", 3), ("impact_speed_density", 3), ("waterfall", 3)):
        plain, marked = (draw(module, results.sweep("torque"), results.gear_pair,
                              laid_out=bool(given) and module == "orbit_diagram", marks=given)
                         for given in ((), marks))
        for one, two in list(zip(plain.axes, marked.axes, strict=True))[:panels]:
            assert len(two.patches) - len(one.patches) == 2  # T_full has its line already
        words = set(texts(marked)) - set(texts(plain))
        assert any("last seen at 0.7, none at 0.9 N·m" in one for one in words)
        # As the report rounds the ends of the bracket.
        found, = (re.search(r"T_safe: rattling seen at (12\.\d+), none from (12\.\d+) N·m on", one)
                  for one in words if "T_safe" in one)
        attrs = results.critical("safe").attrs
        assert float(found[1]) <= attrs["rattling"] < attrs["clean"] <= float(found[2])


def test_marks_out_of_range_are_left_out(results):
    marks = marks_of([results.critical("back")], "brake_torque")
    figure = draw("deepest_separation", results.sweep("plain"), None, marks=marks)
    assert not any("last seen" in text for text in texts(figure))


@pytest.mark.parametrize("name", CURVES)
def test_a_transmission_error_is_drawn(tmp_path, name):
    with make_curve(tmp_path, name) as results:
        figure = draw("te_curve", results.transmission_error, results.gear_pair, laid_out=True)
    assert_units(figure)
    heading = figure.axes[0].get_title("left")
    assert ("1 kink" in heading) == (name == "kinked")


def test_what_is_not_there_is_said(results):
    def said(module, name):
        return " ".join(texts(draw(module, results.response(name), results.gear_pair)))

    for module in OF_RESPONSES:
        assert "the run failed (too many events)" in said(module, "failed")
    for name in ("engaged", "failed"):
        assert not plots.shows("impact_section", results.response(name))
    for module in ("history", "spectrum"):
        assert "rigid contact" in said(module, "rigid")
    far, none = (labels(draw("phase_portrait", results.response(name), results.gear_pair))[0]
                 for name in ("periodic", "one_flank"))
    assert far == "relative displacement φ (µrad); coast flank at −2000 µrad"
    assert none == "relative displacement φ (µrad)"


def test_counts_come_with_their_threshold(results):
    figure = draw("history", results.response("periodic"), results.gear_pair)
    assert "3 impacts per cycle (flights deeper than 1 %)" in figure.get_suptitle()
    figure = draw("orbit_diagram", results.sweep("torque"), results.gear_pair)
    assert any("deeper than 1 %" in axis.get_title("left") for axis in figure.axes)


def test_a_sweep_shows_the_critical_torque_and_the_claims(results):
    claims = plots._claims(results, "torque")
    assert len(claims) == 1 and claims[0].impacts == 3 and claims[0].value == 1.8
    figure = draw("orbit_diagram", results.sweep("torque"), results.gear_pair, claims=claims)
    assert any("T_full = 11.92 N·m" in text for text in texts(figure))
    figure = draw("deepest_separation", results.sweep("torque"), results.gear_pair)
    assert any("source: 630 µrad" in text for text in texts(figure))
    markers = [line for line in figure.axes[0].lines if line.get_marker() == "D"]
    assert [line.get_xydata().tolist() for line in markers] == [[[1.8, pytest.approx(630)]]]


@pytest.mark.parametrize(("critical", "side"), [(11.9, "right"), (1.5, "left")])
def test_the_words_at_the_critical_torque_stay_inside(results, critical, side):
    figure = draw("deepest_separation", results.sweep("torque"), results.gear_pair,
                  full_engagement=critical)
    words = next(text for text in figure.axes[0].texts if "T_full" in text.get_text())
    assert words.get_horizontalalignment() == side


def test_the_ends_of_a_sweep_are_inside(results):
    low, high = draw("orbit_diagram", results.sweep("torque"), None).axes[3].get_xlim()
    assert 0.8 < low < 1 and 14 < high < 14.2


def test_the_leader_of_a_claim_avoids_the_data():
    """A marker below a step down: the words go below it too, not across the step."""
    step = np.array([(0, 0.9, 0.4, 0.9), (0.4, 0.9, 0.5, 0.1), (0.5, 0.1, 1, 0.1)])
    place, box = _free_place(step, np.array((0.3, 0.5)), 0.15)
    assert sum(_crossings(step, line) for line in (*box, np.array((0.3, 0.5, *place)))) == 0
    assert _crossings(step, np.array((0.3, 0.5, 0.8, 0.6))) == 1


def test_failed_points_of_a_sweep_have_a_row_of_their_own(results):
    strip = draw("orbit_diagram", results.sweep("failed"), results.gear_pair).axes[3]
    rows = dict(zip([label.get_text() for label in strip.get_yticklabels()],
                    strip.get_yticks(), strict=True))
    crosses = [line for line in strip.lines if line.get_marker() == "x"]
    failed = int((results.sweep("failed")["status"] != 0).sum())
    assert failed > 0
    assert sum(line.get_xdata().size for line in crosses) == failed
    assert all(np.all(line.get_ydata() == rows["failed"]) for line in crosses)


def test_an_interrupted_sweep_shows_what_was_done(results):
    sweep = results.sweep("torque").load().copy(deep=True)
    beyond = sweep["brake_torque"] > 6
    sweep["status"] = sweep["status"].where(~beyond, Status.UNFINISHED).transpose("start", ...)
    sweep = sweep.assign({name: sweep[name].where(~beyond).transpose("start", ...)
                          for name in ("phi", "deepest_separation", "counted_impacts",
                                       "counted_back_impacts")})
    sweep["kept_impacts"] = sweep["kept_impacts"].where(~beyond, 0).transpose("start", ...)
    strip = draw("orbit_diagram", sweep, results.gear_pair, laid_out=True).axes[3]
    assert "failed" not in [label.get_text() for label in strip.get_yticklabels()]
    assert max(line.get_xdata().max(initial=0) for line in strip.lines
               if line.get_marker() == "s") <= 6
    draw("deepest_separation", sweep, results.gear_pair, laid_out=True)


def test_a_path_is_cut_at_impacts_and_coloured_by_state(results):
    response = results.response("periodic")
    track = path(response, 2)
    assert np.all(np.diff(track.position) >= 0)
    x, _ = track.jumps([1], track.phi, track.phi_dot)
    assert np.count_nonzero(np.isnan(x)) == 2 * 3
    # Jumps happen on the flank, and only separation lies below it, by more than rounding.
    assert np.nanmax(np.abs(x)) < 1e-12
    for state, sign in ((0, -1), (1, 1)):
        _, phi = track.stretches(state, track.position, track.phi)
        assert np.nanmin(sign * phi) > -1e-12


def test_a_refined_path_keeps_its_nodes_and_follows_the_motion(results):
    """Halving samples and refining again loses no more than a cubic piece may."""
    response = results.response("engaged")
    track = path(response.isel(sample=slice(None, None, 2)), 2).refined(response, 2)
    full = path(response, 2)
    inner = np.interp(full.position, track.position, np.arange(track.position.size))
    index = np.round(inner).astype(int)[:-2]
    np.testing.assert_allclose(track.position[index], full.position[:-2], atol=1e-12)
    # Spacing h of the halved samples; max|φ''''| is about the amplitude, the rest curvature jumps.
    h = 2 * np.pi / float(response.attrs["mesh_frequency_ratio"]) / 100
    allowed = (h**2 / 8) * np.ptp(full.phi)
    assert np.max(np.abs(track.phi[index] - full.phi[:-2])) < allowed


def test_all_figures_are_written_the_same_twice(results, tmp_path, monkeypatch):
    monkeypatch.setitem(plots.FIGURES, "response", ("response.phase_portrait",))
    small = type("Small", (), {
        "attrs": results.attrs, "gear_pair": results.gear_pair, "responses": ("periodic",),
        "sweeps": (), "criticals": (), "response": results.response, "sweep": results.sweep,
        "studies": {"response": ("periodic",), "sweep": (), "critical": ()},
        "study": lambda self, kind, name: results.study(kind, name),
        "transmission_error": results.transmission_error})()
    first = plots.draw_all(small, tmp_path / "a")
    second = plots.draw_all(small, tmp_path / "b", formats=("png",))
    names = {one.name for one in first}
    assert {"phase_portrait_periodic.png", "phase_portrait_periodic.pdf", "te_curve.png"} <= names
    assert len(first) == 2 * (len(plots.FIGURES["response"]) + 1)
    for one in second:
        assert one.read_bytes() == (tmp_path / "a" / one.name).read_bytes()


def test_powers_of_ten_are_plain_text():
    """The labels of matplotlib's own formatter, in raised figures instead of TeX."""
    figure = style.new_figure(4, 3)
    axis = figure.subplots()
    axis.plot([1e-12, 1], [-2000, 0.003])
    axis.set_xscale("log")
    style.plain_powers(axis.xaxis)
    axis.set_yscale("symlog", linthresh=1e-2)
    style.plain_powers(axis.yaxis)
    figure.draw_without_rendering()
    assert axis.xaxis.get_major_formatter()(1e-12) == "10⁻¹²"
    assert axis.yaxis.get_major_formatter()(-1000.0) == "−10³"
    assert axis.yaxis.get_major_formatter()(0) == "0"
    axis.set_xlim(1, 4)
    figure.draw_without_rendering()
    assert "3×10⁰" in [label.get_text() for label in axis.get_xticklabels(minor=True)]


def test_the_typeface_keeps_the_shapes_and_widths_of_the_whole_font():
    """Glyph by glyph; and it has every letter the labels of the figures use."""
    from matplotlib import font_manager
    from matplotlib.ft2font import FT2Font, LoadFlags

    small = FT2Font(str(typeface._file()))
    whole = FT2Font(str(font_manager.findfont("DejaVu Sans")))
    codes = set(small.get_charmap())
    assert {ord(letter) for letter in "azAZ09φθΔ'|µ·²⁻⁹→←−≥≈▾○●◆…°×ä"} <= codes
    for font in (small, whole):
        font.set_size(10, 170)
    for code in sorted(codes):
        outlines = []
        for font in (small, whole):
            glyph = font.load_char(code, flags=LoadFlags.NO_HINTING)
            points = font.get_path()[0].tolist()
            # A point said twice in a row is no other shape.
            outlines.append((glyph.linearHoriAdvance, [point for point, before in zip(
                points, [None, *points], strict=False) if point != before]))
        assert outlines[0] == outlines[1], chr(code)


def test_words_outside_of_the_typeface_come_from_the_whole_font(tmp_path):
    figure = style.new_figure(2, 1)
    with style.house_style(), warnings.catch_warnings():
        warnings.simplefilter("error")  # a missing glyph warns
        figure.subplots().set_title("Ж")
        style.save(figure, tmp_path / "a.png", tmp_path / "a.pdf")


def test_a_name_in_another_script_is_written_as_escapes(tmp_path):
    figure = style.new_figure(4, 2, rows=True)
    with style.house_style(), warnings.catch_warnings():
        warnings.simplefilter("error")
        figure.subplots()
        figure.suptitle("歯車 ω × ü, sweep 's'\ndepth")
        style.save(figure, tmp_path / "a.png")
    assert figure.get_suptitle() == "\\u6b6f\\u8eca ω × ü, sweep 's'\ndepth"


def test_the_dots_of_a_periodic_motion_are_not_drawn_more_than_shows(results, monkeypatch):
    """Each place of a branch is there, none more than OPAQUE times."""
    monkeypatch.setattr(sweep_parts, "OPAQUE", 3)
    sweep = results.sweep("torque")
    axis = draw("orbit_diagram", sweep, results.gear_pair).axes[0]
    dots = [line.get_xydata() for line in axis.lines if line.get_marker() == "o"]
    shown = 0
    for branch, _ in sweep_parts.branches(sweep):
        phi = style.URAD * branch["phi"].values
        other = sweep_parts.differs(sweep, branch)
        if not other.any():
            continue
        drawn = dots[shown]
        shown += 1
        assert len(drawn) < phi.size
        step = np.ptp(phi) / sweep_parts.PLACES
        assert set(drawn[:, 0]) == set(branch["brake_torque"].values[other])
        for value, row in zip(branch["brake_torque"].values[other], phi[other], strict=True):
            places = drawn[drawn[:, 0] == value, 1]
            assert np.max(np.min(np.abs(row[:, None] - places), axis=1)) <= step
            assert np.max(np.unique(places, return_counts=True)[1]) <= sweep_parts.OPAQUE


def test_the_readers_own_settings_change_nothing(results):
    import matplotlib

    with matplotlib.rc_context({"font.size": 30, "axes.grid": False}):
        figure = draw("impact_section", results.response("periodic"), results.gear_pair)
        assert figure.axes[0].xaxis.label.get_size() == style.RC["font.size"]
        assert matplotlib.rcParams["font.size"] == 30


def test_figures_need_no_engine(results, tmp_path):
    program = (
        "import sys\n"
        "from lapwing.results import read_results\n"
        "from lapwing.plots import style\n"
        "from lapwing.plots.response import history\n"
        "from lapwing.plots.sweep import orbit_diagram\n"
        f"with read_results({str(results.path)!r}) as results:\n"
        "    pair = results.gear_pair\n"
        f"    style.save(history.draw(results.response('periodic'), pair), {str(tmp_path)!r}"
        " + '/a.pdf')\n"
        "    orbit_diagram.draw(results.sweep('torque'), pair)\n"
        "loaded = [name for name in sys.modules if name == 'matplotlib.pyplot' or name.startswith("
        "('lapwing.engine', 'lapwing._engine', 'lapwing.studies'))]\n"
        "assert not loaded, loaded\n")
    subprocess.run([sys.executable, "-c", program], check=True)
    assert (tmp_path / "a.pdf").stat().st_size > 0


def test_a_branch_is_drawn_where_it_is_seen_to_differ():
    import xarray as xr

    from lapwing.plots.sweep.parts import differs, stands_apart

    depth = np.array([[1.0, 2.0, 3.0, np.nan], [1.001, 2.5, 3.0, 1.0]])
    sweep = xr.Dataset({"status": (("start", "brake_torque"), np.array([[0, 0, 0, 3], [0] * 4])),
                        "period": (("start", "brake_torque"), np.array([[1] * 4, [2, 2, 1, 1]])),
                        "phi": (("start", "brake_torque", "recorded_cycle"),
                                np.repeat(depth[..., None], 4, axis=2)),
                        "depth": (("start", "brake_torque"), depth)},
                       coords={"start": ["rest", "up"], "brake_torque": np.arange(4.0)})
    up = sweep.isel(start=1)
    assert differs(sweep, up).tolist() == [True, True, False, True]
    apart = stands_apart(sweep, up, lambda one: one["depth"].values)
    assert apart.tolist() == [False, True, False, True]
    assert stands_apart(sweep, sweep.isel(start=0), lambda one: one["depth"].values).all()
