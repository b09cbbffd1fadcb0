"""Attractors along a parameter: numbers kept by continuing, shares, words, figure."""

import re

import numpy as np
import pytest
from scipy.special import betaincinv

from helpers import PAIR, SHIPPED, one_impact_orbits, scene_c
from lapwing import TransmissionError, attractors, attractors_along, load_deck, run_deck
from lapwing.plots import figure_of
from lapwing.plots.attractors.attractor_shares import shows
from lapwing.plots.attractors.parts import CONTACT
from lapwing.report.answers.findings import findings as findings_of_all
from lapwing.report.attractors.along import (
    along_text,
    findings,
    headline,
    quiet_values,
    rattling_torques,
)
from lapwing.results import read_results
from lapwing.studies.cost import stages_of

HARMONIC = TransmissionError.harmonic([17e-6, 4.5e-6, 1.5e-6], [0.0, 1.0, 2.0], [1, 2, 3])
SCENE_A = {"pinion_speed_rpm": 240, "impact_law": "absolute", "threads": 1}


@pytest.fixture(scope="module")
def line():
    """Scene A where its rattling changes its period, up to where none is left."""
    return attractors_along(PAIR, SHIPPED, values=[12.1, 12.15, 12.17, 12.2, 12.25, 12.4, 12.5],
                            runs=64, **SCENE_A).assign_attrs(name="one")


def test_an_attractor_keeps_its_number_as_long_as_its_motion_goes_on():
    """Scene C: the closed form of each one-impact orbit, n = 1, 2, 3, from 1.5 to 1.9 N·m."""
    values = np.linspace(1.5, 1.9, 5)
    found = attractors_along(PAIR, HARMONIC, values=values, runs=64, pinion_speed_rpm=1500,
                             threads=1)
    numbers = {}
    for n in (1, 2, 3):
        for i, value in enumerate(values):
            osc = scene_c(value)
            stable = [one for one in one_impact_orbits(osc, n)
                      if abs(one[2]) < 1 + osc.restitution**2]
            for phi, phi_dot, _ in stable:
                near = np.hypot(found.point_phi[i] - phi, found.point_phi_dot[i] - phi_dot)
                (at,) = np.flatnonzero((near < 1e-13).any("point"))
                numbers.setdefault(n, set()).add(int(found.attractor[at]))
    assert numbers == {1: {1}, 2: {2}, 3: {3}}
    assert np.all(found.period[:, :3] == [1, 2, 3])


def test_a_motion_of_another_period_gets_another_number(line):
    """From 12.17 N·m on the rattling has period 2; the motion in contact keeps its number."""
    classes = line.motion_class.values
    quiet = [int(np.flatnonzero(row == "1:(0,0)").item()) for row in classes]
    assert len(set(quiet)) == 1
    rattling = 1 - quiet[0]
    assert np.all(line.period.values[:2, rattling] == 1)
    other = np.flatnonzero(line.period.values[3] == 2)
    assert other.size == 1 and other[0] > 1
    assert np.all(line.period.values[-1] == np.where(np.arange(line.attractor.size) == quiet[0],
                                                     1, -1))
    assert line.share.values[-1, quiet[0]] == 1
    total = np.nansum(line.share.values, axis=1)
    assert total == pytest.approx(np.ones(7))
    assert line.runs_ended.values.sum(axis=1).tolist() == [64] * 7


def test_one_value_is_what_attractors_finds():
    """The same starts: those of a value are drawn by a seed of its own."""
    seed = int(np.random.SeedSequence([5, 0]).generate_state(1)[0])
    alone = attractors(scene_c(1.8), "random", runs=128, seed=seed, threads=1)
    found = attractors_along(PAIR, HARMONIC, values=1.8, runs=128, seed=5, pinion_speed_rpm=1500,
                             threads=3)
    order = [int(np.flatnonzero(found.period[0] == p).item()) for p in alone.period]
    for name in ("share", "share_low", "share_high", "runs_ended", "deepest_separation"):
        assert np.array_equal(found[name].values[0, order], alone[name].values), name
    both = (attractors_along(PAIR, HARMONIC, values=[1.7, 1.8], runs=32, threads=threads,
                             pinion_speed_rpm=1500) for threads in (1, 2))
    assert next(both).identical(next(both))


def test_what_was_not_reached_is_said(line):
    calls = []

    def stop(fraction):
        calls.append(fraction)
        if len(calls) == 2:
            raise KeyboardInterrupt

    part = attractors_along(PAIR, SHIPPED, values=[12.1, 12.15, 12.2], runs=16, progress=stop,
                            keep_interrupted=True, **SCENE_A).assign_attrs(name="part")
    assert (part.interrupted, part.reached.values.tolist()) == (1, [1, 1, 0])
    assert np.all(part.period.values[2] == -1) and part.unresolved.values[2] == -1
    assert "**1 not reached**" in along_text(part)[0]
    assert headline(part).endswith("; 1 value not reached")
    assert "2 values" in findings(part)[-1]
    assert findings_of_all((), (), (), lines=[part])[0].startswith(
        "**The run was stopped before its end**: attractors `part` lacks 1 of 3 values.")
    for name, value in (("reached", 0), ("period", -1)):
        none = part.copy(deep=True)
        none[name].values[:] = value
        assert findings(none) == []
    empty = none.isel(attractor=slice(0, 0))
    assert along_text(empty)[-1] == "- no motion was recognised: nothing is known"
    assert not shows(empty)
    with pytest.raises(KeyboardInterrupt):
        calls.clear()
        attractors_along(PAIR, SHIPPED, values=[12.1, 12.15, 12.2], runs=4, progress=stop,
                         **SCENE_A)


def test_words(line):
    quiet, sentence = findings(line)
    assert quiet == ("**No start rattles at 12.5 N·m on the gear** (at a pinion speed of 240 rpm, "
                     "impact law `absolute`; 64 random starts).")
    more = line.copy(deep=True)
    more["deepest_separation"].values[-2] = 0.0
    assert findings(more)[0].endswith("; 64 random starts at each of 2 values).")
    assert re.match(r"\*\*Up to \d motions coexist\*\* \([^)]+\), along braking torque 12.1 to ",
                    sentence)
    assert "the last value at which separation was found is 12.4 N·m" in sentence
    # 1 - 0.05^(1/64)
    assert "below 4.57 %, with 95 % confidence" in sentence
    text = "\n".join(along_text(line))
    assert "64 random starts at each (seed 0)" in text and "none of 448 failed" in text
    lost = line.copy(deep=True)
    lost["unresolved"].values[2] = 3
    assert findings(lost)[-1].endswith("Of 3 runs the end is not known.")
    # The upper limit of 3 of 64: those of which the end is not known may lead to it.
    assert f"below {100 * betaincinv(4, 61, 0.95):.3g} %, with 95 % confidence" \
        in findings(lost)[-1]
    none = lost.copy(deep=True)
    none["unresolved"].values[2] = 64
    assert "is not excluded. Of 64 runs" in findings(none)[-1]
    assert "attract no other" in findings(line.assign_attrs(restitution=1.0))[-1]
    lost["failed"].values[-1] = 1  # whether that one rattles is not known
    assert len(findings(lost)) == 1 and not quiet_values(lost).size
    assert max(rattling_torques([line])) == 12.4
    lost["reached"].values[-2:] = 0
    assert max(rattling_torques([lost])) == 12.25
    assert "3 runs not resolved" in headline(lost)


def test_figure(line):
    figure = figure_of("attractor_shares", line)
    section, stacked = figure.axes
    points = sum(one.get_xdata().size for one in section.lines[:-1])
    assert points == int(np.isfinite(line.point_phi.values).sum())
    heights = np.zeros(7)
    colours = set()
    for bars in stacked.containers:
        heights += [bar.get_height() for bar in bars]
        colours |= {bars[0].get_facecolor()}
    assert heights == pytest.approx(100 * np.ones(7))
    assert len(colours) == line.attractor.size + 1  # and what is not known
    words = [text.get_text() for text in figure.legends[0].get_texts()]
    assert "contact kept" in words
    assert any(re.fullmatch(r"motion \d: period 1, 11( to 12)? impacts a cycle, 170 µrad deep", one)
               for one in words)
    from matplotlib.colors import to_rgba

    assert stacked.containers[0][0].get_facecolor() == to_rgba(CONTACT)


def test_a_deck_runs_what_python_runs(tmp_path):
    path = tmp_path / "line.nml"
    path.write_text("""
&gear_pair
  pinion_teeth = 25, gear_teeth = 32, pinion_inertia = 0.0078, gear_inertia = 0.026
  pinion_base_lever = 0.034, mesh_stiffness = 3.12e8, backlash = 0.002
  restitution = 0.8, damping_ratio = 0.1
/
&transmission_error harmonic_amplitude = 17e-6, 4.5e-6, 1.5e-6, harmonic_shift = 0, 1, 2 /
&operation pinion_speed_rpm = 1500 /
&attractors name = 'torque', values = 1.7, 1.8, runs = 32 /
""", encoding="utf-8")
    deck = load_deck(path)
    outcome = run_deck(deck, tmp_path / "out", threads=1, figures="none")
    alone = attractors_along(PAIR, HARMONIC, values=[1.7, 1.8], runs=32, pinion_speed_rpm=1500,
                             threads=1)
    with read_results(outcome.folder / "result.nc") as results:
        stored = results.study("attractors", "torque")
        for name in ("period", "share", "point_phi", "runs_ended", "reached"):
            assert np.array_equal(alone[name], stored[name], equal_nan=True), name
        assert shows(stored) and figure_of("attractor_shares", stored)
    summary = (outcome.folder / "summary.md").read_text(encoding="utf-8")
    assert "## Attractors torque" in summary and "motions coexist**" in summary
    (stage,) = stages_of(deck, 1, 0.2)
    assert 0 < stage.low <= stage.high


def test_what_is_refused():
    for given, message in (
            ({"values": []}, "values is empty"),
            ({"values": [1.0], "parameter": "x", "runs": 0, "seed": -1}, "parameter.*runs.*seed"),
            ({"values": [1.0], "phi": (1, 0), "most_cycles": 0, "keep_interrupted": 3},
             "keep_interrupted.*phi.*most_cycles"),
            ({"values": [1.0], "degrees_of_freedom": 2}, "degrees_of_freedom"),
            ({"values": [1.0], "contact_law": "rigid", "phi": (-1e-4, 1e-4)}, "lets no tooth")):
        with pytest.raises(ValueError, match=message):
            attractors_along(PAIR, HARMONIC, pinion_speed_rpm=1500, **given)
