"""Which figures are drawn: the fewest, those a deck names, or all."""

import pytest

from lapwing import plots
from lapwing.base.registry import STUDIES
from lapwing.deck import DeckError, load_deck, used_hash, used_text
from lapwing.plots.choice import asked, covers, formats_of
from lapwing.report.answers.findings import findings_in
from lapwing.report.summary import summary_text

DECK = """&gear_pair
  pinion_teeth = 25, gear_teeth = 32, pinion_inertia = 0.0078, gear_inertia = 0.026
  pinion_base_lever = 0.034, mesh_stiffness = 3.12e8, backlash = 0.002
  restitution = 0.8, damping_ratio = 0.1
/
&transmission_error parabola_amplitude = 125e-6 /
&operation brake_torque = 1.8, pinion_speed_rpm = 240 /
&response name = 'one'{} /
"""


def chosen(results, words):
    """Stems of the figures drawn, and their formats."""
    found = {task.stem: formats_of(task, results, words) for task in plots.tasks_of(results)}
    return {stem: formats for stem, formats in found.items() if formats}


def every(results, named=None):
    return {(kind, name): (named or {}).get(name) for kind in STUDIES
            for name in results.studies.get(kind, ())}


@pytest.mark.full
def test_all_are_all_in_both_formats(results):
    found = chosen(results, asked("all", every(results)))
    assert found.keys() == {task.stem for task in plots.tasks_of(results)}
    assert set(found.values()) == {("png", "pdf")}
    assert chosen(results, asked("none", every(results))) == {}


def test_few_are_of_every_study(results):
    found = chosen(results, asked("png", every(results)))
    assert set(found.values()) == {("png",)}
    assert {f"history_{name}" for name in results.responses} <= found.keys()
    assert not any(stem.startswith(("phase_portrait", "impact_section", "spectrum", "staircase"))
                   for stem in found)
    assert {"deepest_separation_torque", "orbit_diagram_torque"} <= found.keys()
    # A sweep over the torque shows these; nothing shows what was not found, or at another speed.
    assert "critical_search_safe" not in found and "critical_search_back" not in found
    assert "critical_search_no_back" in found
    assert len(found) < len(plots.tasks_of(results)) / 2


def test_a_deck_names_others(results):
    found = chosen(results, asked("png", every(results, {
        "periodic": ["spectrum", "phase_portrait"], "engaged": ["none"], "chatter": ["all"]})))
    figures = STUDIES["response"].figure_names
    of = {name: {figure for figure in figures if f"{figure}_{name}" in found}
          for name in ("periodic", "engaged", "chatter", "aperiodic")}
    assert of["periodic"] == {"spectrum", "phase_portrait"} and of["engaged"] == set()
    assert of["chatter"] == {"history", "spectrum", "phase_portrait", "impact_section"}
    assert of["aperiodic"] == {"history"}


def test_what_was_drawn_is_known():
    named = {("response", "one"): None, ("sweep", "s"): ["staircase"]}
    few = asked("png", named)
    assert covers(few, few) and covers(asked("all", named), few) and covers(few, ())
    assert not covers(few, asked("all", named))
    assert not covers(few, asked("png", named | {("response", "one"): ["history", "spectrum"]}))


def test_no_result_depends_on_the_figures_of_a_deck(tmp_path):
    paths = [tmp_path / name for name in ("plain.nml", "named.nml", "again.nml")]
    paths[0].write_text(DECK.format(""))
    paths[1].write_text(DECK.format(", figures = 'history', 'spectrum'"))
    plain, named = map(load_deck, paths[:2])
    assert used_hash(plain) == used_hash(named)
    paths[2].write_text(used_text(named))
    assert load_deck(paths[2]).responses[0].figures == ["history", "spectrum"]
    assert plain.responses[0].figures is None


def test_a_figure_that_does_not_exist_is_refused_by_name(tmp_path):
    path = tmp_path / "wrong.nml"
    path.write_text(DECK.format(", figures = 'history', 'spectra'"))
    with pytest.raises(DeckError, match=r"8:\d+: figures = 'spectra', expected each one of .*"
                                        r"'spectrum'.*did you mean 'spectrum'"):
        load_deck(path)


@pytest.mark.parametrize("kind", STUDIES)
def test_the_few_are_some_of_the_figures(kind):
    assert set(STUDIES[kind].few) <= set(STUDIES[kind].figures)


def test_the_summary_names_the_figure_to_look_at_first(results):
    names = plots.names_of(results, asked("png", every(results)))
    # Along a speed the amplitudes are the picture; it is the only sweep that has them.
    assert names[0] == "amplitudes_speed.png" and names[1].startswith("deepest_separation_")
    lines = summary_text(results, names).splitlines()
    assert lines[2] == (f"Figure to look at first: [{names[0]}]({names[0]}); {len(names) - 1} more "
                        "beside it.")
    # The findings follow, and are found again where a run is used once more.
    assert lines[3] == "## Findings" and lines[4].startswith("- ")
    assert findings_in("\n".join(lines)) == findings_in(summary_text(results)) != ()
    assert "Figure to look at" not in summary_text(results)
