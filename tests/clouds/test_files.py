"""What all readers ask of a file: that it is a regular one, and of small text files, that they are small."""

import os
import signal
import socket

import numpy as np
import pytest

from gmmjax import Changes
from gmmjax.cli.detect import read_settings
from gmmjax.clouds import (
    MAX_SETTINGS,
    READERS,
    parse_json,
    read_cloud,
    read_json,
    read_toml,
    read_views,
    require_file,
)
from gmmjax.errors import InputError
from gmmjax.evaluation.labelled_pair import read_pair
from gmmjax.reporting.mixture_files import read_mixture
from gmmjax.reporting.tuning_files import read_state
from gmmjax.surveys import Intrinsics, open_bag, read_depth_frame, read_intrinsics

CAMERA = Intrinsics(8.0, 8.0, 3.5, 2.5, 8, 6)


def read_depth(path):
    return read_depth_frame(path, CAMERA)


def read_bag(path):
    with open_bag(path):
        pass


def read_labels(path):
    (path.parent / "changes.json").write_text('{"schema_version": 3}')
    return Changes.load(path.parent)


def read_truth(path):
    for side in ("before", "after"):
        (path.parent / f"{side}.xyz").write_text("1 2 3\n")
    return read_pair(path.parent)


OPENERS = [
    *((f"a{ending}", read_cloud) for ending in READERS),
    *((f"views{ending}", read_views) for ending in (".json", ".npz")),
    ("config.toml", read_settings),
    *((name, read_intrinsics) for name in ("camera.json", "camera.yaml")),
    *((f"depth{ending}", read_depth) for ending in (".png", ".npy")),
    *((f"run{ending}", read_bag) for ending in (".bag", ".mcap", ".db3")),
    ("metadata.yaml", lambda path: read_bag(path.parent)),
    ("changes.json", Changes.load),
    ("labels.npz", read_labels),
    ("mixture.json", read_mixture),
    ("state.npz", lambda path: read_state(path, "these")),
]


pytestmark = pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="there are no named pipes here")


@pytest.fixture(autouse=True)
def no_waiting():
    """A reader that waits for a pipe fails in place of waiting for ever."""
    signal.signal(signal.SIGALRM, lambda *_: pytest.fail("it waits"))
    signal.alarm(30)
    yield
    signal.alarm(0)


@pytest.mark.parametrize(("name", "read"), OPENERS)
@pytest.mark.parametrize("kind", ["a pipe", "a device"])
def test_only_regular_files_are_opened(tmp_path, name, read, kind):
    path = tmp_path / name
    if kind == "a pipe":
        os.mkfifo(path)
    else:
        path.symlink_to("/dev/zero")
    with pytest.raises(InputError, match=f"{name}: is {kind}; write what comes from it to a file"):
        read(path)


def test_sockets_are_no_files(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with socket.socket(socket.AF_UNIX) as listening:
        listening.bind("a.ply")
        with pytest.raises(InputError, match=r"a\.ply: is a socket"):
            read_cloud("a.ply")


def test_pipes_among_the_files_of_a_pair_and_a_bag(tmp_path):
    for side in ("before", "after"):
        np.save(tmp_path / f"truth_{side}.npy", np.full(1, -1))
    os.mkfifo(tmp_path / "before.xyz")
    (tmp_path / "after.xyz").write_text("1 2 3\n")
    with pytest.raises(InputError, match=r"before\.xyz: is a pipe"):
        read_pair(tmp_path)
    bag = tmp_path / "run"
    bag.mkdir()
    (bag / "metadata.yaml").write_text("a: 1")
    os.mkfifo(bag / "run_0.mcap")
    with pytest.raises(InputError, match=r"run_0\.mcap: is a pipe"):
        read_bag(bag)


def test_links_to_files_are_files(tmp_path):
    (tmp_path / "a.xyz").write_text("1 2 3\n")
    (tmp_path / "link.xyz").symlink_to(tmp_path / "a.xyz")
    assert read_cloud(tmp_path / "link.xyz").points.tolist() == [[1, 2, 3]]
    (tmp_path / "nothing.xyz").symlink_to(tmp_path / "b.xyz")
    with pytest.raises(InputError, match="no such file"):
        read_cloud(tmp_path / "nothing.xyz")


def test_a_file_may_be_too_large(tmp_path):
    (tmp_path / "a").write_bytes(bytes(11))
    assert require_file(tmp_path / "a", 11) == tmp_path / "a"
    with pytest.raises(InputError, match="has 11 bytes, and may have 10; check that it is the right file"):
        require_file(tmp_path / "a", 10)
    path = tmp_path / "config.toml"
    path.write_text("#" * (MAX_SETTINGS + 1))
    with pytest.raises(InputError, match=r"config\.toml: has 262145 bytes"):
        read_settings(path)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (b"{", "Expecting"),
        (b'{"a": NaN}', "NaN is no number"),
        (b"[-Infinity]", "-Infinity is no number"),
        (b"1e999", "1e999 is too large"),
        (b"9" * 400, "of 400 digits is too large"),
        (b"9" * 100_000, "of 100000 digits is too large"),
        (b"9223372036854775808", "of 19 digits is too large"),
        (b"[" * 100_000, "nested too deeply"),
        (b"\xff\xfe", "decode"),
    ],
)
def test_json_that_is_none(tmp_path, text, message):
    path = tmp_path / "a.json"
    path.write_bytes(text)
    with pytest.raises(InputError, match=rf"a\.json: is not JSON .*{message}.*; copy it") as caught:
        read_json(path, "copy it")
    assert len(str(caught.value)) < 500


def test_json_that_is_one():
    assert parse_json(b'\xef\xbb\xbf{"a": [1, -9223372036854775807, 2.5, true, null]}') == {
        "a": [1, -9223372036854775807, 2.5, True, None]
    }


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("seed = " + "9" * 5000, "is not TOML"),
        ("seed = 0x" + "F" * 5000, "a whole number of 20000 bits is too large"),
        ("a." * 1000 + "a = 1", "a line has more than 200 dots"),
        ("crop = " + "[" * 20_000, "nested too deeply"),
        ("seed = 2020-99-99", "is not TOML"),
    ],
)
def test_toml_that_is_none(tmp_path, text, message):
    path = tmp_path / "a.toml"
    path.write_text(text)
    with pytest.raises(InputError, match=rf"a\.toml: .*{message}.*one setting a line"):
        read_toml(path)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("crop = true", "crop=True must be six finite numbers"),
        ('crop = "abcdef"', "crop='abcdef' must be six finite numbers"),
        ("crop = [0, 0, 0, 1, 1, nan]", ".*must be six finite numbers"),
        ("crop = [0, 0, 0, 1, 1, true]", ".*must be six finite numbers"),
        ("crop = [[], {}, 0, 1, 1, 1]", ".*must be six finite numbers"),
        ("noise_floor = true", "noise_floor=True must be a positive number"),
        ("tolerance = inf", "tolerance=inf must be a positive number"),
        ("concentration = nan", "concentration=nan must be a number below 1"),
        ("threshold = true", "threshold=True must lie between"),
        ("method = [1]", r"method=\(1,\) is unknown"),
        ("restarts = 1.5", r"restarts=1\.5 must be a whole number"),
        ("seed = { a = 1 }", "seed={'a': 1} must be a whole number"),
    ],
)
def test_settings_of_another_type(tmp_path, as_users, text, message):
    path = tmp_path / "config.toml"
    path.write_text(text)
    with pytest.raises(InputError, match=rf"config\.toml: {message}"):
        read_settings(path)
