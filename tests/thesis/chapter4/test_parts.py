import dataclasses
import functools

import numpy as np
import pytest

from gmmjax import InputError, mixtures
from gmmjax.evaluation import Detection
from gmmjax.thesis.chapter4 import Outcome, Plan, clustering, filtering, gaussians, grid, surveys
from gmmjax.thesis.chapter4.accuracy import Confusion
from gmmjax.thesis.chapter4.clustering import fixed_cloud
from gmmjax.thesis.chapter4.records import LastPair
from tests.thesis.chapter4.pairs import floor_pair, floor_sources

PARTS = (grid, clustering, filtering, gaussians, surveys)
PERFECT, BLIND = Confusion(1, 0, 1, 0, 3), Confusion(0, 1, 0, 1, 2)


@pytest.fixture(autouse=True)
def floors(monkeypatch):
    for part in (surveys, filtering):
        monkeypatch.setattr(part, "survey_sources", floor_sources)


def outcome(condition, method, counts=PERFECT, seed=0, **more):
    return Outcome(condition, seed, method, {}, {"all": dataclasses.asdict(counts), **more})


@pytest.mark.parametrize("part", PARTS, ids=lambda part: part.PART)
def test_every_unit_is_a_different_one(part):
    units = part.work(Plan()).units
    assert len({unit.key for unit in units}) == len(units) > 1
    assert {unit.part for unit in units} == {part.PART}


@pytest.mark.parametrize("part", PARTS, ids=lambda part: part.PART)
def test_a_part_without_outcomes_has_tables_all_the_same(part):
    for table in part.tables([]):
        assert table.to_csv()
    part.headlines([])


def test_the_plan_says_how_many():
    plan = Plan(5, clustering_seeds=2, trials=3, survey_seeds=4, filtering_seeds=1)
    assert len(grid.work(plan).units) == 2
    assert len(clustering.work(plan).units) == 2 * 2 * 2 + 1
    assert len(gaussians.work(plan).units) == 10 * 3 * 3
    assert len(surveys.work(plan).units) == 3 * 4 * 2
    assert len(filtering.work(plan).units) == 1 * 2 * 2 + 1
    assert {unit.seed for unit in gaussians.work(plan).units} == {5, 6, 7}


def test_the_published_algorithm_is_told_the_kinds_of_change():
    units = gaussians.work(Plan(trials=1)).units
    kinds = {unit.condition: unit.settings["kinds"] for unit in units if unit.method == "published"}
    assert kinds["(+2) low"] == ("appeared",) and kinds["(-1) medium"] == ("disappeared",)
    assert kinds["(-1 +1) low"] == ("appeared", "disappeared")


def test_what_cannot_be_made_here_is_left_out_and_said(monkeypatch):
    def without_open3d(seeds, kind):
        if kind != "frame":
            raise InputError("install open3d")
        return floor_sources(seeds, kind)

    for part in (surveys, filtering):
        monkeypatch.setattr(part, "survey_sources", without_open3d)
    work = surveys.work(Plan(survey_seeds=2))
    assert {unit.condition for unit in work.units} == {"single frames"}
    assert work.notes[0] == "Left out: install open3d."
    assert not filtering.work(Plan()).units and filtering.work(Plan()).notes


def test_scores_of_the_grid_search(monkeypatch):
    """Of a cloud of four Gaussians: every criterion has one lowest score, and three Gaussians are never the best."""
    one_type = functools.partial(mixtures.grid_search, covariance_types=("diagonal",))
    monkeypatch.setattr(grid, "grid_search", one_type)
    monkeypatch.setattr(grid, "COVARIANCE_TYPES", ("diagonal",))
    monkeypatch.setattr(grid, "fixed_cloud", lambda cloud, seed: fixed_cloud(cloud, seed)[::8])
    unit = grid.work(Plan(3)).units[0]
    (table,) = grid.tables([Outcome(unit.condition, unit.seed, unit.method, unit.settings, unit.run())])
    assert len(table.rows) == 3 * 6
    for criterion in ("mdl", "bic", "aic"):
        rows = [row for row in table.rows if row["criterion"] == criterion]
        (lowest,) = [row for row in rows if row["lowest"]]
        assert lowest["score"] == min(row["score"] for row in rows)
        assert lowest["gaussians"] > 3


def test_a_model_that_failed_has_no_score():
    scores = np.arange(24.0).reshape(4, 6).tolist()
    scores[0][0] = None
    result = {"scores": dict.fromkeys(("mdl", "bic", "aic"), scores)}
    (table,) = grid.tables([Outcome("4 Gaussians", 0, "grid search", {}, result)])
    assert table.rows[0]["score"] is None and not table.rows[0]["lowest"]
    assert table.rows[1]["lowest"]


def test_numbers_of_gaussians_that_were_found():
    outcomes = [
        Outcome("4 Gaussians", seed, "annihilation", {}, {"found": found, "best": 4})
        for seed, found in enumerate(([4, 4, 5], [4, 4, 4]))
    ]
    outcomes += [Outcome("7 Gaussians", seed, "grid search", {}, {"best": best}) for seed, best in enumerate((6, 7))]
    annihilation, scanned = clustering.tables(outcomes)
    one, best = annihilation.rows[:2]
    assert (one["fits"], one["right"], one["share"], one["found"]) == (6, 5, 0.8333, "4: 5, 5: 1")
    assert (best["fits"], best["right"]) == (2, 2)
    assert (scanned.rows[1]["right"], scanned.rows[1]["found"]) == (1, "6: 1, 7: 1")
    line = clustering.headlines(outcomes)[0]
    assert (line.figure, line.here, line.thesis) == ("4.1", "5 of 6", "right nearly every time")


def test_clouds_are_clustered_and_the_changes_found(monkeypatch):
    monkeypatch.setattr(clustering, "fixed_cloud", lambda cloud, seed: fixed_cloud(cloud, seed)[::8])
    monkeypatch.setattr(clustering, "RESTARTS", 2)
    units = [unit for unit in clustering.work(Plan(clustering_seeds=1)).units if unit.condition != "7 Gaussians"]
    results = {unit.method: unit.run() for unit in units}
    assert len(results["annihilation"]["found"]) == 2
    for method in ("annihilation", "grid search"):
        mixture = clustering.mixture_of(results[method])
        assert 4 <= results[method]["best"] == len(mixture.weights) <= 9
        assert np.linalg.norm(mixture.means - [2, 0.5, 0], axis=1).min() < 0.2
    new = clustering.mixture_of(results["changes"]).means
    apart = np.array([2.5, 2.5, 2.5])
    assert np.linalg.norm(new - apart, axis=1).min() < 0.2


def test_one_kind_and_both_kinds_of_change_are_summed_up():
    outcomes = [outcome("(+1) low", "published"), outcome("(-2) medium", "published", BLIND)]
    outcomes += [outcome("(-1 +1) low", "published", BLIND), outcome("(+1) low", "joint")]
    (table,) = gaussians.tables(outcomes)
    rows = {(row["method"], row["condition"]): row for row in table.rows}
    assert rows["published", "(+1) low"]["f1"] == 1
    assert rows["published", "one kind"]["f1"] == 0.5 and rows["published", "one kind"]["pairs"] == 2
    assert rows["published", "both kinds"]["f1"] == 0 and rows["joint", "both kinds"]["f1"] is None
    assert rows["thesis", "one kind"]["f1"] == 0.8 and rows["thesis", "both kinds"]["f1"] == 0.52
    lines = {(line.measure, line.method): (line.here, line.thesis) for line in gaussians.headlines(outcomes)}
    assert lines["F1, both kinds of change", "published"] == ("0.00", "0.52")


def test_surveys_stand_beside_the_numbers_of_the_thesis():
    opposite = dataclasses.asdict(Confusion(false_positives=1, true_negatives=3))
    overlap = dataclasses.asdict(Confusion(true_positives=1, found=1, missed=1))
    outcomes = [outcome("single frames", "published", opposite=opposite, overlap=overlap)]
    measures, types = surveys.tables(outcomes)
    rows = {(row["data"], row["method"]): row for row in measures.rows}
    assert rows["single frames", "published"]["f1"] == 1 and rows["single frames", "thesis"]["f1"] == 0.7
    assert rows["single frames", "published"]["f1_by_overlap"] == pytest.approx(2 / 3, abs=1e-4)
    assert ("volumetric maps", "published") not in rows and rows["volumetric maps", "thesis"]["precision"] == 0.81
    rows = {(row["data"], row["method"]): row["accuracy"] for row in types.rows}
    assert rows["single frames", "published"] == 0.75 and rows["localised maps", "thesis"] == 0.82
    lines = [(line.figure, line.here, line.thesis) for line in surveys.headlines(outcomes)]
    assert lines == [("4.10", "1.00", "0.70"), ("4.10", "0.67", "0.70"), ("4.12", "0.75", "0.94")]


@pytest.mark.parametrize("condition", ["appeared", "disappeared"])
def test_what_happened_and_what_did_not_are_counted_apart(condition, monkeypatch):
    """A detector that reports everything in both clouds."""

    def everything(pair):
        return Detection(*(np.zeros(len(cloud.points), int) for cloud in (pair.before, pair.after)))

    monkeypatch.setattr(surveys, "detector", lambda name: everything)
    seed = int(condition == "disappeared")
    (source,) = floor_sources([seed], "frame")
    result = surveys._run(LastPair(), source, "joint")
    assert result["opposite"] == dataclasses.asdict(Confusion(false_positives=1, true_negatives=0))
    assert result["all"]["false_positives"] == 2
    # The one that holds the change overlaps it.
    assert result["overlap"]["found"] + result["overlap"]["missed"] == 1


def test_the_filter_takes_stray_points_out_of_every_array():
    pair = floor_pair(0)
    stray = dataclasses.replace(
        pair.after,
        points=np.concatenate([pair.after.points, [[0.5, 0.5, 5.0]]]),
        truth=np.append(pair.after.truth, -1),
        things=np.append(pair.after.things, -1),
        unseen=np.append(pair.after.truth >= 0, True),
    )
    filtered, kept_before, kept_after = filtering.without_outliers(dataclasses.replace(pair, after=stray))
    assert not kept_after[-1] and kept_after.mean() > 0.9 and len(kept_before) == len(pair.before.points)
    for values in (filtered.after.truth, filtered.after.things, filtered.after.unseen):
        assert len(values) == len(filtered.after.points) == kept_after.sum()
