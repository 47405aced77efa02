"""What the logger `gmmjax` says, and that it says nothing unless it is asked."""

import logging

import jax
import pytest

from gmmjax import DetectionConfig, detect_changes, fit_mixture, read_cloud
from gmmjax.clouds import write_ply
from tests.batch.runs import SETTINGS, cloud

CONFIG = DetectionConfig(**SETTINGS)


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    folder = tmp_path_factory.mktemp("scans")
    write_ply(folder / "before\x1b[2J.ply", cloud(0, 4))
    write_ply(folder / "after.ply", cloud(1))
    return folder / "before\x1b[2J.ply", folder / "after.ply"


def test_a_detection_is_silent_by_default(files, capfd):
    detect_changes(*map(read_cloud, files), config=CONFIG)
    assert capfd.readouterr() == ("", "")
    assert logging.getLogger("gmmjax").level == logging.NOTSET


def test_stages_sizes_and_what_was_derived_are_logged(files, caplog):
    caplog.set_level(logging.INFO, logger="gmmjax")
    before, after = map(read_cloud, files)
    found = detect_changes(before, after, config=CONFIG)
    said = caplog.messages
    assert said[1] == f"read {after!r}"
    assert any(text.startswith("before: 240 points of '") for text in said)
    # A file's name cannot move the cursor of a terminal.
    assert not any("\x1b" in text for text in said)
    spacing = found.diagnostics["spacing"]
    assert f"compared as volumes: 240 and 300 points, voxel size none, spacing {spacing:.4g}" in said
    assert any(text.startswith("registration: applied false") for text in said)
    tolerance = found.diagnostics["tolerance"]
    assert f"joint mixture: at most 8 components, tolerance {tolerance:.4g}" in said
    for stage in found.diagnostics["seconds"]:
        assert any(text.startswith(f"{stage}: ") and text.endswith(" s") for text in said)
    assert f"{len(found)} changes, 0 rejected candidates (0 unchanged, 0 not observed)" in said
    assert {record.name.split(".")[0] for record in caplog.records} == {"gmmjax"}


def test_details_are_for_debugging(files, caplog):
    caplog.set_level(logging.DEBUG, logger="gmmjax")
    found = detect_changes(*map(read_cloud, files), config=CONFIG)
    details = [record.getMessage() for record in caplog.records if record.levelno == logging.DEBUG]
    assert f"change 0: {found[0]!r}" in details and "Fitting the mixtures" in details


def test_a_fit_is_logged(caplog):
    caplog.set_level(logging.INFO, logger="gmmjax.mixtures")
    fit = fit_mixture(cloud(0), key=jax.random.key(0), max_components=8)
    assert caplog.messages == [
        "fitting 300 points from 1 starts with at most 8 components",
        f"components [{int(fit.mixture.count)}], message lengths [{round(float(fit.message_length), 1)}]",
    ]
