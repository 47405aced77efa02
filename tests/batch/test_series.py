"""The comparisons of a series, and what happens where an epoch cannot be read."""

import csv
import dataclasses

import pytest

from gmmjax.batch import Epoch, compared_epochs, detect_series, run_folder
from gmmjax.changes import DetectionConfig
from gmmjax.clouds import write_ply
from gmmjax.errors import InputError
from gmmjax.reporting.batch_files import write_history
from tests.batch.runs import SETTINGS, cloud, worker

CONFIG = dataclasses.replace(DetectionConfig(**SETTINGS), restarts=1)


@pytest.fixture
def epochs(tmp_path):
    """A Gaussian that comes with the third of four surveys."""
    found = []
    for number, gaussians in enumerate((4, 4, 5, 5)):
        path = tmp_path / f"{number}.ply"
        write_ply(path, cloud(number, gaussians))
        found.append(Epoch(f"day {number}", path))
    return found


def detect(epochs, out, **options):
    return {
        result.name: result for result in detect_series(epochs, out=out, config=CONFIG, executor=worker(), **options)
    }


def test_each_is_compared_with_its_predecessor(epochs, tmp_path):
    folder = tmp_path / "run"
    results = detect(epochs, folder)
    assert sorted(results) == ["day 0 to day 1", "day 1 to day 2", "day 2 to day 3"]
    assert [results[name].pair.changes for name in sorted(results)] == [0, 1, 0]
    histories = write_history(run_folder(folder))
    assert [[(event.kind, event.epoch) for event in own.events] for own in histories] == [[("came", 2)]]
    with (folder / "objects.csv").open(newline="") as file:
        assert [row["epoch"] for row in csv.DictReader(file)] == ["day 2"]
    assert "day 3" in (folder / "timeline.html").read_text()


def test_a_gap_is_bridged_until_it_is_closed(epochs, tmp_path):
    whole = epochs[1].cloud.read_bytes()
    epochs[1].cloud.write_bytes(b"no cloud")
    results = detect(epochs, tmp_path / "run")
    assert sorted(name for name, result in results.items() if result.done) == ["day 0 to day 2", "day 2 to day 3"]
    assert dict(compared_epochs(run_folder(tmp_path / "run"))) == {
        (0, 2): "day 0 to day 2",
        (2, 3): "day 2 to day 3",
    }
    (history,) = write_history(run_folder(tmp_path / "run"))
    (event,) = history.events
    # Between the first and the third survey: the second is not known.
    assert (event.kind, event.previous, event.epoch) == ("came", 0, 2)
    epochs[1].cloud.write_bytes(whole)
    results = detect(epochs, tmp_path / "run")
    assert sorted(results) == ["day 0 to day 1", "day 1 to day 2", "day 2 to day 3"]
    assert results["day 2 to day 3"].reused
    assert sorted(compared_epochs(run_folder(tmp_path / "run"))) == [(0, 1), (1, 2), (2, 3)]


def test_a_run_of_pairs_is_no_series(tmp_path, epochs):
    from gmmjax.batch import BatchPair, detect_many

    list(
        detect_many(
            [BatchPair("x", epochs[0].cloud, epochs[2].cloud)], out=tmp_path / "run", config=CONFIG, executor=worker()
        )
    )
    with pytest.raises(InputError, match="holds no series"):
        compared_epochs(run_folder(tmp_path / "run"))
    with pytest.raises(InputError, match=r"holds a run with other settings \(series None\)"):
        detect(epochs, tmp_path / "run")
