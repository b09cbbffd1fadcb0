"""The summary: every number asked for is in it, readable, and from the file alone."""

import dataclasses
import math
import re
import warnings

import numpy as np
import pytest

import lapwing
from helpers import PAIR, SHIPPED, as_in_a_deck, scene_a
from lapwing.report.numbers import doubtful, with_error
from lapwing.report.response import (
    _energy_sentence,
    _motion_sentence,
    _paragraph,
    _table,
    _times,
)
from lapwing.report.summary import summary_text
from lapwing.report.words import plural, runs_of
from lapwing.results import read_results, write_results
from lapwing.studies.response.run import response

SHORT = {"settle": 60, "record": 24, "samples_per_cycle": 32}


@pytest.fixture(scope="module")
def text(tmp_path_factory):
    """Summary of a small study: bouncing, chaotic, engaged, failed; a sweep with hysteresis."""
    responses = [
        response(scene_a(3.3), PAIR, name="bounces", claim_impacts_per_cycle=5.0,
                 claim_deepest_separation=0.00032, claim_text="period 1", **SHORT),
        response(scene_a(0.8), PAIR, name="chaos", **SHORT),
        response(scene_a(12), PAIR, name="engaged", claim_text="separation vanishes", **SHORT),
        response(scene_a(3.3), PAIR, name="broken", max_steps_per_cycle=3, **SHORT)]
    sweep = lapwing.sweep(PAIR, SHIPPED, values=np.linspace(11.5, 12.7, 13), settle=60, record=10,
                          pinion_speed_rpm=240, impact_law="absolute")
    path = tmp_path_factory.mktemp("summary") / "result.nc"
    write_results(path, deck_name="case", deck_text="", used_text="", used_hash="0a1b",
                  pair=PAIR, te=SHIPPED, te_sign="printed", found={
                      "response": {one.attrs["name"]: one for one in responses},
                      "sweep": {"torque": as_in_a_deck(sweep)}})
    with read_results(path) as results:
        return summary_text(results)


def row(text, name):
    """Cells of one line of the table, by heading."""
    heading, line = (next(line for line in text.splitlines() if line.startswith(f"| {start} "))
                     for start in ("response", name))
    return dict(zip(*([cell.strip() for cell in one.strip("|").split("|")]
                      for one in (heading, line)), strict=True))


def paragraph(text, name):
    return text.split(f"### {name}\n\n")[1].split("\n")[0]


def test_table_comes_before_the_paragraphs(text):
    assert text.index("| response |") < text.index("### bounces")
    assert "Impacts are counted after flights deeper than 1 % of their cycle's deepest" in text


def test_a_bouncing_response_beside_its_claim(text):
    cells = row(text, "bounces")
    assert cells["motion"] == "period 1"
    assert cells["impacts per cycle, drive / coast"] == "5 / 0"
    # 0.00032123687, from the same scene at a tolerance of 1e-12.
    assert cells["deepest separation (µrad)"] == "321.2"
    assert cells["source"] == "5 impacts, 320 µrad (“period 1”)"
    words = paragraph(text, "bounces")
    assert "5 impacts per cycle (as here)" in words
    assert "320 µrad deepest separation (here +0.39 %)" in words
    assert "up to 321.2 µrad of 2000 µrad" in words
    assert "Settled" in words


def test_without_a_coast_flank_no_gap_is_told():
    words = _paragraph(response(dataclasses.replace(scene_a(3.3), gap="one_flank"), PAIR,
                                name="one", **SHORT).attrs)
    assert "part by up to 321.2 µrad and strike 5 times per cycle" in words
    assert "There are no coast flanks." in words and "the coast flanks" not in words
    assert not re.search(r"\b(nan|inf)\b", words)


def test_multipliers_below_the_least_number_are_not_told():
    """exp(-ξ·P) underflows where the mesh period is long: -inf is no exponent of a damped tooth."""
    osc = dataclasses.replace(scene_a(100.0), mesh_frequency_ratio=1e-4)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        words = _paragraph(response(osc, PAIR, name="one", exponents=True, settle=1, record=4,
                                    samples_per_cycle=8).attrs)
    assert "multipliers and exponents cannot be told" in words
    assert not re.search(r"\b(nan|inf)\b", words)


def test_an_engaged_response(text):
    assert row(text, "engaged")["contact"] == "engaged throughout"
    # k'·lever·F = T_l·lever⁻¹/i12 = 12/(0.034·1.28) N.
    assert row(text, "engaged")["mesh force, mean / peak (N)"].startswith("275.7 /")
    assert "never part" in paragraph(text, "engaged")
    assert "“separation vanishes”" in paragraph(text, "engaged")


def test_chaos_is_marked_as_statistics(text):
    assert row(text, "chaos")["motion"] == "no period"
    # 24 cycles are too few for an interval of the mean; the peak is the greatest one seen.
    assert re.fullmatch(r"≈ [\d.]+ \(change [\d.e-]+\) / ≥ [\d.]+",
                        row(text, "chaos")["mesh force, mean / peak (N)"])
    assert "Without a period" in paragraph(text, "chaos")


def test_a_failed_response_says_so(text):
    assert "failed: too many steps" in row(text, "broken")["motion"]
    assert not re.search(r"\bnan\b", text)


def test_sweep(text):
    findings = text.split("## Sweep torque")[1]
    assert "braking torque from 11.5 to 12.7 N·m: 13 values × 3 starts" in findings
    assert "none of 39 failed" in findings
    assert ("last back impact seen: none at 13 values from 11.5 to 12.7 N·m (each from rest, "
            "carried upwards, carried downwards)") in findings
    kept = next(line for line in findings.splitlines() if line.startswith("- T_full"))
    assert kept.startswith("- T_full = 11.91674544 N·m: contact *can* be kept from here")
    assert "mesh phase 0.951457" in kept
    assert re.search(r"rattling seen up to 12\.\d N·m \(carried upwards\); none at 8 values from "
                     r"12 to 12\.7 N·m above it \(each from rest, carried downwards\)$", kept)
    # Bouncing survives above complete engagement when carried upwards (docs/model.md, section 8).
    hysteresis = re.search(r"differ in period, impacts or depth at (.*)", findings)[1]
    assert re.search(r"(11\.9|12) to 12\.\d N·m", hysteresis)
    assert re.search(r"last separation seen [^:]*: 11\.9 N·m, none at 12 N·m \(each from rest.*\); "
                     r"12\.\d N·m, none at 12\.\d N·m \(carried up", findings)


def test_a_sweep_has_a_table_of_at_most_twelve_values(text):
    table = [line for line in text.split("Some of the motions, each from rest")[1].splitlines()
             if line.startswith("|")]
    assert table[0].startswith("| braking torque (N·m) | impacts per cycle |")
    assert len(table) == 2 + 12
    assert table[2].startswith("| 11.5 |") and table[-1] == "| 12.7 | 0 | 0 | 1 | 0 |"


def test_runs_leave_out_where_nothing_differs():
    flags = [bool(int(one)) for one in "1101100100010111"]
    assert runs_of(np.array(flags)) == [(0, 1), (3, 4), (7, 7), (11, 11), (13, 15)]


ATTRS = {"status": 0, "status_reference": 0, "motion_class": "9:(0,0)", "error_kind": "convergence",
         "motion_class_reference": "1:(0,0)", "impact_energy_per_cycle": -2e-3,
         "impact_energy_per_cycle_error": 1e-9, "impact_energy_per_cycle_change": 1e-10,
         "impact_energy_per_cycle_transient": 2e-10, "impacts_per_cycle": 1.0,
         "impacts_per_cycle_error": 0.0, "impacts_per_cycle_change": 0.0,
         "max_period": 24, "period": 1, "chatter_ends_per_cycle": 1.0}

SURE = ATTRS | {"motion_class_reference": "9:(0,0)"}


def test_a_motion_the_second_run_does_not_confirm_is_doubtful():
    assert doubtful(ATTRS)
    assert not doubtful(SURE)
    assert not doubtful(ATTRS | {"status_reference": 4})


def test_energy_fed_in_is_a_gain():
    rough = SURE | {"impact_energy_per_cycle_error": 1e-5}
    assert "the motion gains 2 (error 0.01) mJ" in _energy_sentence(rough)
    assert "take 2 mJ" in _energy_sentence(SURE | {"impact_energy_per_cycle": 2e-3})


@pytest.mark.parametrize(("changes", "shown"), [
    ({}, "take 2 mJ"), ({"impact_energy_per_cycle_error": 1e-5}, "take 2 (error 0.01) mJ"),
    # The second run does not confirm the period, or a file has no more than a change.
    ({"motion_class_reference": "no period"}, "take ≈ 2 (change 2e-07) mJ"),
    ({"impact_energy_per_cycle_change": None}, "take ≈ 2 (change 1e-06) mJ"),
    ({"status_reference": 4, "impact_energy_per_cycle_change": math.nan,
      "impact_energy_per_cycle_error": math.nan}, "take 2 mJ"),
    ({"period": 0, "impact_energy_per_cycle_error": 0.0003}, "take 2 ± 0.3 mJ"),
    ({"period": 0, "impact_energy_per_cycle_error": math.nan}, "take ≈ 2 (change 2e-07) mJ")])
def test_estimates_intervals_and_changes_have_their_own_names(changes, shown):
    attrs = SURE | {"impact_energy_per_cycle": 2e-3} | changes
    assert shown in _energy_sentence({k: v for k, v in attrs.items() if v is not None})


def test_one_is_singular():
    assert _times(ATTRS, "") == "1 time"
    assert "with 1 complete chatter per cycle" in _motion_sentence(ATTRS)


def test_without_a_claim_there_is_no_column_for_it():
    one = response(scene_a(12), PAIR, name="engaged", **SHORT).attrs
    assert "source" not in _table([one])[0]
    assert "source" in _table([one | {"claim_text": "engaged"}])[0]


def test_provenance_ends_it(text):
    last = text.rstrip().splitlines()[-1]
    assert last.startswith(f"Lapwing {lapwing.__version__} (")
    assert "`0a1b`" in last


@pytest.mark.parametrize(("value", "error", "shown"), [
    (321.236871, 2e-9, "321.2"), (321.236871, 0.3, "321.2 (error 0.3)"),
    (321.236871, 0.06, "321.2"), (321.236871, 0.11, "321.2 (error 0.2)"),
    (0.0, 1e-9, "0 (error 1e-09)"),
    (321.236871, 0.31, "321.2 (error 0.4)"),  # never told too small
    (321.236871, 40, "320 (error 40)"), (5.0, 0.0, "5"), (0.0, 0.0, "0"),
    (1.5, 7.0, "2 (error 7)"), (2.0, math.nan, "2"), (math.nan, 0.0, "–"),
    (1234567.0, 2e5, "1.2e+06 (error 200000)")])
def test_errors_are_readable(value, error, shown):
    assert with_error(value, error) == shown


def test_an_interval_or_a_change_is_always_told():
    assert with_error(321.236871, 0.3, "±") == "321.2 ± 0.3"
    assert with_error(321.236871, 2e-9, "±") == "321.2 ± 2e-09"
    assert with_error(321.236871, 2e-9, "change") == "321.2 (change 2e-09)"


@pytest.mark.parametrize(("number", "told"), [
    (1, "1 run"), (0, "0 runs"), (1_000_000, "1000000 runs"), (2.0, "2 runs"), (0.25, "0.25 runs")])
def test_whole_numbers_of_things_are_told_whole(number, told):
    assert plural(number, "run") == told
