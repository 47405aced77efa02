import pytest

from gmmjax.errors import ComputationError
from gmmjax.thesis.chapter4 import Journal, Plan, Table, run_chapter
from gmmjax.thesis.chapter4 import chapter as module
from gmmjax.thesis.chapter4.records import Headline, Unit, Work


class Laboratory:
    """Two parts of a few units, which say what was run, and can be made to fail."""

    def __init__(self):
        self.ran, self.failing = [], {}

    def part(self, name):
        return module._Part(
            lambda plan: Work([self.unit(name, seed) for seed in plan.seeds(plan.trials)], (f"note of {name}",)),
            lambda outcomes: [Table(name, name, tuple({"seed": own.seed, **own.result} for own in outcomes))],
            lambda outcomes: [Headline(name, "number", "m", str(len(outcomes)), "")],
        )

    def unit(self, name, seed):
        def run():
            self.ran.append((name, seed))
            if (name, seed) in self.failing:
                raise self.failing[name, seed]
            return {"value": 10 * seed}

        return Unit(name, "c", seed, "m", {}, run)


@pytest.fixture
def laboratory(monkeypatch):
    laboratory = Laboratory()
    monkeypatch.setattr(module, "_PARTS", {name: laboratory.part(name) for name in ("grid", "gaussians")})
    monkeypatch.setattr(module, "PARTS", ("grid", "gaussians"))
    return laboratory


@pytest.fixture
def file(tmp_path):
    return tmp_path / "journal.jsonl"


PLAN = Plan(trials=3)


def test_parts_that_are_asked_for_are_run_in_the_order_of_the_chapter(laboratory, file):
    stages = []
    results = run_chapter(
        PLAN, ["gaussians", "grid"], Journal(file), progress=lambda stage, share: stages.append((stage, share))
    )
    assert laboratory.ran == [(name, seed) for name in ("grid", "gaussians") for seed in (0, 1, 2)]
    assert [part.name for part in results.parts] == ["grid", "gaussians"] and not results.failures
    assert results.parts[0].tables[0].rows == tuple({"seed": seed, "value": 10 * seed} for seed in (0, 1, 2))
    assert results.parts[0].notes == ("note of grid",)
    assert stages[0] == ("grid: c, seed 0, m", 0) and stages[3][1] == 0.5


def test_an_interrupted_run_goes_on_where_it_was(laboratory, file):
    laboratory.failing[("grid", 1)] = KeyboardInterrupt()
    with pytest.raises(KeyboardInterrupt):
        run_chapter(PLAN, ["grid"], Journal(file))
    laboratory.failing.clear()
    laboratory.ran.clear()
    shares = []
    results = run_chapter(PLAN, ["grid"], Journal(file), progress=lambda stage, share: shares.append(share))
    assert laboratory.ran == [("grid", 1), ("grid", 2)]
    assert [row["value"] for row in results.parts[0].tables[0].rows] == [0, 10, 20]
    assert shares == [pytest.approx(1 / 3), pytest.approx(2 / 3)]


def test_what_fails_is_left_out_and_tried_again_the_next_time(laboratory, file):
    laboratory.failing[("grid", 1)] = ValueError("no")
    results = run_chapter(PLAN, ["grid"], Journal(file))
    assert [row["seed"] for row in results.parts[0].tables[0].rows] == [0, 2]
    assert [str(failure) for failure in results.failures] == ["grid, c, seed 1, m: ValueError: no"]
    laboratory.failing.clear()
    laboratory.ran.clear()
    assert not run_chapter(PLAN, ["grid"], Journal(file)).failures
    assert laboratory.ran == [("grid", 1)]


def test_nothing_but_failures_is_an_error(laboratory, file):
    laboratory.failing.update({("grid", seed): ValueError("no") for seed in range(3)})
    with pytest.raises(ComputationError, match=r"nothing could be run: grid, c, seed 0, m: ValueError: no"):
        run_chapter(PLAN, ["grid"], Journal(file))


def test_parts_that_are_complete_from_earlier_are_shown_as_well(laboratory, file):
    run_chapter(PLAN, ["gaussians"], Journal(file))
    laboratory.failing[("grid", 2)] = ValueError("no")
    results = run_chapter(PLAN, ["grid"], Journal(file))
    assert [part.name for part in results.parts] == ["grid", "gaussians"]
    assert [part.name for part in run_chapter(PLAN, ["gaussians"], Journal(file)).parts] == ["gaussians"]
