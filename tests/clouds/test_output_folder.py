import errno
import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from gmmjax.clouds.atomic import atomic_write
from gmmjax.clouds.output_folder import FolderKind, check_output_folder, output_folder
from gmmjax.clouds.temporaries import PREFIX
from gmmjax.errors import InputError

KIND = FolderKind("result", "marker.json", "items", ("data.bin",))


def write(folder, content="new", **settings):
    with output_folder(folder, KIND, **settings) as staging:
        (staging / "marker.json").write_text(json.dumps({"schema_version": 1, "items": content}))
        (staging / "data.bin").write_text(content)


def contents(folder):
    return {path.name: path.read_text() for path in folder.iterdir()}


@pytest.mark.parametrize("there", ["nothing", "a missing parent", "an empty folder"])
def test_all_files_appear_and_nothing_else(tmp_path, there):
    folder = tmp_path / "a" / "b" if there == "a missing parent" else tmp_path / "a"
    if there == "an empty folder":
        folder.mkdir()
    write(folder)
    assert set(contents(folder)) == {"marker.json", "data.bin"}
    assert {path.name for path in tmp_path.iterdir()} == {"a"}


def test_nothing_is_seen_before_the_end(tmp_path):
    with output_folder(tmp_path / "a", KIND) as staging:
        (staging / "data.bin").write_text("x")
        assert not (tmp_path / "a").exists()


def test_a_previous_result_is_replaced_only_when_asked_for(tmp_path):
    write(tmp_path / "a", "old")
    with pytest.raises(InputError, match="previous result; --overwrite"):
        write(tmp_path / "a")
    assert contents(tmp_path / "a")["data.bin"] == "old"
    write(tmp_path / "a", overwrite=True)
    assert contents(tmp_path / "a")["data.bin"] == "new"
    assert set(contents(tmp_path / "a")) == {"marker.json", "data.bin"}


@pytest.mark.parametrize(
    "foreign",
    [{"notes.txt": "mine"}, {"data.bin": "mine"}, {"marker.json": "{}"}, {"marker.json": "no json", "data.bin": ""}],
)
def test_a_folder_that_holds_something_else_is_left_alone(tmp_path, foreign):
    for name, text in foreign.items():
        (tmp_path / name).write_text(text)
    with pytest.raises(InputError, match="holds something else"):
        write(tmp_path, overwrite=True)
    assert contents(tmp_path) == foreign


def test_a_result_with_something_else_beside_it_is_left_alone(tmp_path):
    write(tmp_path / "a", "old")
    (tmp_path / "a" / "thesis.tex").write_text("precious")
    with pytest.raises(InputError, match=r"thesis\.tex"):
        write(tmp_path / "a", overwrite=True)
    assert contents(tmp_path / "a")["data.bin"] == "old"


@pytest.mark.parametrize("path", ["file", "file/below", "file/below/that"])
def test_a_file_in_the_way(tmp_path, path):
    (tmp_path / "file").write_text("precious")
    with pytest.raises(InputError, match="file"):
        check_output_folder(tmp_path / path, KIND)
    assert contents(tmp_path) == {"file": "precious"}


def test_a_name_that_the_file_system_refuses(tmp_path):
    with pytest.raises(InputError, match="cannot be written"):
        check_output_folder(tmp_path / ("n" * 300), KIND)


def test_the_check_leaves_no_trace(tmp_path):
    check_output_folder(tmp_path / "a" / "b", KIND)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("there", "call"),
    [
        ("nothing", "fsync"),
        ("an empty folder", "fsync"),
        ("a result", "fsync"),
        ("an empty folder", "replace"),
        ("a result", "replace"),
    ],
)
def test_a_full_disk_leaves_everything_as_it_was(tmp_path, monkeypatch, there, call):
    folder = tmp_path / "a" / "b"
    if there == "an empty folder":
        folder.mkdir(parents=True)
    if there == "a result":
        write(folder, "old")
    before = sorted(tmp_path.rglob("*"))
    if call == "fsync":
        monkeypatch.setattr(os, call, full_disk)
    else:
        fail_late(monkeypatch)
    with pytest.raises(InputError, match=r"a/b: cannot be written \(No space left on device\)"):
        write(folder, overwrite=True)
    monkeypatch.undo()
    assert sorted(tmp_path.rglob("*")) == before
    if there == "a result":
        assert contents(folder)["data.bin"] == "old"


def full_disk(*arguments):
    raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


def fail_late(monkeypatch):
    """The second file that is moved into its place does not get there."""
    replace, calls = Path.replace, []

    def replace_or_fail(source, destination):
        if destination.name == "marker.json" and "previous" not in str(destination) and not calls:
            calls.append(destination)
            full_disk()
        return replace(source, destination)

    monkeypatch.setattr(Path, "replace", replace_or_fail)


KILLED = """
import os, signal, sys, warnings
from pathlib import Path
from tests.clouds.test_output_folder import write

warnings.simplefilter("ignore")  # of forks beside JAX's threads: there are none yet
replace = Path.replace
for moves in range(6):
    folder = Path(sys.argv[1]) / str(moves)
    write(folder, "old")
    child = os.fork()
    if not child:
        left = [moves]

        def replace_until_killed(source, destination):
            if not left[0]:
                os.kill(os.getpid(), signal.SIGKILL)
            left[0] -= 1
            return replace(source, destination)

        Path.replace = replace_until_killed
        write(folder, "new", overwrite=True)
        os._exit(0)
    os.waitpid(child, 0)
"""


@pytest.mark.skipif(not hasattr(os, "fork"), reason="needs fork")
def test_a_previous_result_comes_back_after_a_kill_at_any_move(tmp_path):
    """Two files are moved away and two into their place; the last move makes the new result."""
    root = Path(__file__).parents[2]
    subprocess.run([sys.executable, "-c", KILLED, str(tmp_path)], check=True, cwd=root)
    for moves in range(6):
        folder = tmp_path / str(moves)
        assert moves > 3 or any(path.name.startswith(PREFIX) for path in folder.iterdir())
        expected = "new" if moves > 3 else "old"
        with pytest.raises(InputError, match="previous result; --overwrite"):
            check_output_folder(folder, KIND)
        assert set(contents(folder)) == {"marker.json", "data.bin"}
        assert contents(folder)["data.bin"] == expected
        assert json.loads(contents(folder)["marker.json"])["items"] == expected


def test_what_killed_runs_left_is_cleared(tmp_path):
    """In the folder, and beside it where it is not there yet; not what a live run writes, nor what is not ours."""
    (tmp_path / f"{PREFIX}mine").mkdir()
    with output_folder(tmp_path / "live", KIND) as live:
        left_behind = [tmp_path / f"{live.name[:-1]}{'1' if live.name[-1] == '0' else '0'}", tmp_path / "a" / live.name]
        for folder in left_behind:
            (folder / "half").mkdir(parents=True)
            (folder / "half" / "data.bin").write_text("x")
        write(tmp_path / "a")
        assert not any(folder.exists() for folder in left_behind)
        assert live.exists()
        for name, text in (("marker.json", '{"schema_version": 1, "items": 0}'), ("data.bin", "")):
            (live / name).write_text(text)
    assert {path.name for path in tmp_path.iterdir()} == {"a", "live", f"{PREFIX}mine"}
    assert set(contents(tmp_path / "a")) == {"marker.json", "data.bin"}


def test_an_error_of_the_writer_is_passed_on(tmp_path):
    with pytest.raises(ZeroDivisionError), output_folder(tmp_path / "a" / "b", KIND):
        1 / 0  # noqa: B018
    assert not list(tmp_path.iterdir())


def test_all_files_reach_the_disk_before_they_take_their_place(tmp_path, monkeypatch):
    synced, sync = [], os.fsync

    def noted(descriptor):
        synced.append(os.fstat(descriptor).st_ino)
        sync(descriptor)

    monkeypatch.setattr(os, "fsync", noted)
    with output_folder(tmp_path / "out", KIND) as staging:
        (staging / "marker.json").write_text("{}")
        (staging / "inner").mkdir()
        with atomic_write(staging / "inner" / "file") as file:
            file.write(b"content")
        # One after the other each would wait for the disk.
        assert not synced
    paths = [tmp_path / "out", *(tmp_path / "out").rglob("*")]
    assert {path.stat().st_ino for path in paths} <= set(synced)
