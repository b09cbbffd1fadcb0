"""Ensembles: each run is the run of its values, whatever the cut; what is sure is said, no more."""

from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context

import numpy as np
import pytest
from scipy.stats import norm, pearsonr

import lapwing
from helpers import dataset_bytes
from lapwing import (
    Draw,
    Numerics,
    Status,
    TransmissionError,
    critical_torque,
    ensemble,
    parameter_map,
)
from lapwing.model.draw import SAMPLINGS
from lapwing.results.shards import shard_path, shards_in
from lapwing.studies.ensemble import points
from lapwing_bench.scenes import PAIR

TE = TransmissionError.harmonic([17e-6, 4.5e-6, 1.5e-6], [0.0, 1.0, 2.0], [1, 2, 3])
DRAWS = {"backlash": Draw("normal", mean=2e-3, deviation=3e-4, low=1e-3, high=3e-3),
         "damping_ratio": Draw("lognormal", mean=0.1, deviation=0.03),
         "brake_torque": Draw("triangular", low=2.0, mode=8.0, high=14.0)}
QUICK = {"settle": 20, "record": 10, "threads": 2, "pinion_speed_rpm": 1500.0, "runs": 32}


def drawn(draws=None, **options):
    return ensemble(PAIR, TE, DRAWS if draws is None else draws, **{**QUICK, **options})


@pytest.mark.parametrize("sampling", SAMPLINGS)
def test_a_run_is_the_run_of_its_values(sampling):
    found = drawn(sampling=sampling, scrambles=16)
    for run in (0, 7, 31):
        one = found.isel(run=run)
        pair = lapwing.GearPair(**{**vars(PAIR), "backlash": float(one["backlash"]),
                                   "damping_ratio": float(one["damping_ratio"])})
        torque = float(one["brake_torque"])
        alone = parameter_map(
            pair, TE, {"brake_torque": [torque], "restitution": [pair.restitution]}, settle=20,
            record=10, pinion_speed_rpm=1500.0).isel(brake_torque=0, restitution=0)
        for name in ("period", "deepest_separation", "arrivals", "fastest_arrival"):
            assert float(one[name]) == float(alone[name])
        osc = pair.oscillator(TE, brake_torque=torque, pinion_speed_rpm=1500.0)
        assert float(one["full_engagement"]) == critical_torque(osc)[0]


def test_values_follow_their_laws_and_the_seed():
    found = drawn(sampling="random", runs=200, settle=0, record=1)
    assert found["backlash"].min() >= 1e-3 and found["backlash"].max() <= 3e-3
    assert float(np.log(found["damping_ratio"]).std()) == pytest.approx(0.29, rel=0.15)
    again, other = (drawn(sampling="random", runs=200, settle=0, record=1, seed=seed)
                    for seed in (0, 1))
    assert dataset_bytes(again) == dataset_bytes(found)
    assert not np.any(other["backlash"].values == found["backlash"].values)


def test_correlations_are_those_of_the_normal_variables_behind():
    matrix = np.array([[1.0, 0.8, 0.0], [0.8, 1.0, -0.3], [0.0, -0.3, 1.0]])
    draws = {"backlash": Draw("normal", mean=2e-3, deviation=1e-4),
             "damping_ratio": Draw("uniform", low=0.05, high=0.15),
             "brake_torque": Draw("normal", mean=5.0, deviation=0.1)}
    shares = points.shares_of("sobol", 4096, 3, 16, 0)
    values = points.drawn(draws, shares, matrix)
    behind = [(values["backlash"] - 2e-3) / 1e-4, norm.ppf((values["damping_ratio"] - 0.05) / 0.1),
              (values["brake_torque"] - 5.0) / 0.1]
    assert np.corrcoef(behind) == pytest.approx(matrix, abs=0.02)
    assert pearsonr(values["backlash"], values["brake_torque"]).statistic == \
        pytest.approx(0.0, abs=0.02)
    for name, draw in draws.items():
        even = draw.at((np.arange(4096) + 0.5) / 4096)
        assert np.sort(values[name])[40:-40] == pytest.approx(even[40:-40], rel=0.01)


@pytest.mark.parametrize("sampling", [
    "sobol", pytest.param("random", marks=pytest.mark.full)])
def test_no_number_depends_on_the_cut_threads_or_processes(sampling, tmp_path):
    draws = {name: DRAWS[name] for name in ("backlash", "brake_torque")}
    options = {"draws": draws, "sampling": sampling, "sensitivity_draws": 16, "settle": 3,
               "record": 2}
    whole = drawn(threads=1, **options)
    expected = dataset_bytes(whole)
    for size, threads, folder in ((97, 2, None), (500, 1, tmp_path / "a")):
        assert dataset_bytes(drawn(shard_runs=size, threads=threads, folder=folder,
                                   **options)) == expected
    with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as pool:
        assert dataset_bytes(drawn(executor=pool, folder=tmp_path / "b", shard_runs=700,
                                   **options)) == expected
    assert whole.attrs["sensitivity_runs"] == 16 * 4 * 16


def test_what_is_finished_is_kept_and_the_rest_is_open(tmp_path):
    expected = dataset_bytes(drawn(shard_runs=4))

    def stop(fraction):
        if fraction > 0.5:
            raise KeyboardInterrupt
    part = drawn(shard_runs=4, folder=tmp_path, progress=stop, keep_interrupted=True)
    open_ = part["status"].values == Status.UNFINISHED
    assert part.attrs["interrupted"] == 1 and 0 < open_.sum() < open_.size
    assert np.isnan(part["full_engagement"].values[open_]).all()
    assert int(part["known"].sel(event="rattles")) == (~open_).sum()
    # What is open may rattle or not.
    low, high = (float(part[f"probability_{end}"].sel(event="rattles")) for end in ("low", "high"))
    assert high - low > open_.mean()
    lying = {index: shard_path(tmp_path, index).read_bytes() for index in shards_in(tmp_path)}
    assert dataset_bytes(drawn(shard_runs=4, folder=tmp_path, notes=pytest.fail)) == expected
    assert all(shard_path(tmp_path, index).read_bytes() == was for index, was in lying.items())


def test_other_draws_do_not_take_the_shards(tmp_path):
    drawn(folder=tmp_path, shard_runs=16)
    notes = []
    found = drawn(folder=tmp_path, shard_runs=16, seed=4, notes=notes.append)
    assert len(notes) == 2 and all("is of another study: made again" in note for note in notes)
    assert dataset_bytes(found) == dataset_bytes(drawn(shard_runs=16, seed=4))


def test_runs_that_fail_are_counted_and_widen_what_is_said():
    found = drawn(numerics=Numerics(max_events_per_cycle=20))
    failed = ~np.isin(found["status"].values, [Status.OK])
    assert 0 < failed.sum() < failed.size
    rattles = found.sel(event="rattles")
    assert int(rattles["known"]) == (~failed).sum()
    assert float(rattles["probability_high"]) >= (
        int(rattles["seen"]) + failed.sum()) / failed.size
    # T_full is known without a run.
    assert int(found["known"].sel(event="contact_can_be_kept")) == failed.size
    assert np.isfinite(found["full_engagement_quantile"]).all()


def test_a_sharp_question_has_the_known_answer():
    """The only thing drawn is the torque, normal: how often it exceeds T_full is in a table."""
    osc = PAIR.oscillator(TE, brake_torque=1.0, pinion_speed_rpm=1500.0)
    full = critical_torque(osc)[0]
    found = drawn({"brake_torque": Draw("normal", mean=full + 1.0, deviation=1.0)}, settle=0,
                  record=1, runs=128)
    event = found.sel(event="contact_can_be_kept")
    assert float(event["probability"]) == pytest.approx(norm.cdf(1), abs=0.01)
    assert event["probability_low"] <= norm.cdf(1) <= event["probability_high"]
    assert np.unique(found["full_engagement"]).size == 1


def test_listed_values_are_run_as_they_are():
    values = {"backlash": [1e-3, 2e-3, 1e-3], "brake_torque": [3.0, 5.0, 12.0]}
    found = drawn(values)
    assert found.sizes["run"] == 3 and "scramble" not in found
    for name, given in values.items():
        assert found[name].values.tolist() == given
    assert np.isnan(found["probability_low"]).all() and np.isfinite(found["probability"]).all()
    assert found.attrs["sampling"] == "table"


def test_without_a_torque_in_balance_full_engagement_is_not_told():
    for options in ({"drive_torque": 5.0}, {"contact_law": "rigid"}):
        found = drawn({"backlash": DRAWS["backlash"]}, brake_torque=5.0, settle=1, record=1,
                      **options)
        assert "full_engagement" not in found and "full_engagement_quantile" not in found
        assert found["event"].values.tolist() == ["rattles", "back_arrivals"]
        assert "full_engagement" not in found["answer"].values


@pytest.mark.parametrize(("draws", "options", "said"), [
    ({}, {}, "draws = {}, expected"),
    ({"colour": DRAWS["backlash"]}, {}, "draws = 'colour', expected one of"),
    ({"te": DRAWS["backlash"]}, {}, "'te' is no number, and curves cannot be drawn"),
    ({"te": {"a": PAIR}}, {}, "'te' is no number, and curves cannot be drawn or listed"),
    ({"backlash": 3.0, "damping_ratio": DRAWS["damping_ratio"]}, {}, "class Draw"),
    ({"backlash": [1e-3, 2e-3], "damping_ratio": [0.1]}, {}, "2 of backlash, 1 of damping_ratio"),
    ({"backlash": [1e-3]}, {"sensitivity_draws": 16}, "goes with draws, not with values"),
    (None, {"brake_torque": 3.0}, "brake_torque = 3.0, expected none beside its draw"),
    (None, {"runs": 100}, "runs = 100, expected a power of two in each of 16 scrambles"),
    (None, {"scrambles": 8, "runs": 8}, "scrambles = 8, expected a whole number from 16"),
    (None, {"sampling": "grid", "seed": -1}, "sampling = 'grid', .*; seed = -1"),
    (None, {"correlation": np.eye(2)}, "2 × 2 numbers, expected 3 × 3"),
    (None, {"correlation": np.eye(3), "sensitivity_draws": 16}, "of independent parameters"),
    ({"backlash": Draw("normal", mean=1e-3, deviation=1.0)}, {"brake_torque": 3.0}, "backlash"),
    ({"damping_ratio": DRAWS["damping_ratio"], "mesh_damping": Draw("uniform", low=1, high=2)},
     {"brake_torque": 3.0}, "damping")])
def test_what_makes_no_ensemble_is_refused(draws, options, said):
    with pytest.raises((TypeError, ValueError), match=said):
        drawn(draws, **options)
