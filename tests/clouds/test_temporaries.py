import os
import subprocess
import sys

import pytest

from gmmjax.clouds import atomic_write, temporaries
from gmmjax.clouds.temporaries import JOURNAL, clear_folders, temporary_file, temporary_folder

pytestmark = pytest.mark.skipif(temporaries.fcntl is None, reason="nothing is locked on this system")

KILLED = """
import os, signal, sys
from pathlib import Path
from gmmjax.clouds.temporaries import temporary_file, temporary_folder

with temporary_folder(Path(sys.argv[1])) as folder, temporary_file(Path(sys.argv[1])) as (path, file):
    (folder / "data.bin").write_text("half")
    file.write(b"half")
    file.flush()
    os.kill(os.getpid(), signal.SIGKILL)
"""


def test_what_a_killed_process_left_is_cleared(tmp_path):
    ended = subprocess.run([sys.executable, "-c", KILLED, str(tmp_path)], check=False)
    assert ended.returncode == -9
    assert len(list(tmp_path.iterdir())) == 2
    clear_folders(tmp_path)
    with atomic_write(tmp_path / "a.txt") as file:
        file.write(b"whole")
    assert os.listdir(tmp_path) == ["a.txt"]


def test_what_a_live_process_writes_stays(tmp_path):
    with temporary_folder(tmp_path) as folder, temporary_file(tmp_path) as (path, _):
        clear_folders(tmp_path)
        temporaries._clear_files.cache_clear()
        with atomic_write(tmp_path / "a.txt") as file:
            file.write(b"whole")
        assert folder.is_dir() and path.is_file()
    assert os.listdir(tmp_path) == ["a.txt"]


@pytest.mark.parametrize(
    "name", [".gmmjax-notes", ".gmmjax-0123456789abcdef", ".gmmjax-{other}-0123456789abcdef", "{link}"]
)
def test_what_is_not_ours_stays(tmp_path, name):
    """A user's folder, one of another host, and a link with the name of a temporary folder."""
    with temporary_folder(tmp_path) as folder:
        own = folder.name
    place = tmp_path / name.format(other="0" * 8, link=own)
    if name == "{link}":
        (tmp_path / "precious").mkdir()
        place.symlink_to(tmp_path / "precious")
    else:
        place.mkdir()
    clear_folders(tmp_path)
    assert place.is_dir()


def test_what_holds_a_previous_result_stays_with_who_cannot_put_it_back(tmp_path):
    with temporary_folder(tmp_path) as folder:
        own = folder
    own.mkdir()
    (own / JOURNAL).write_text("{}")
    clear_folders(tmp_path)
    assert own.is_dir()

    def fails(folder):
        raise OSError("no space")

    clear_folders(tmp_path, recover=fails)
    assert own.is_dir()
    clear_folders(tmp_path, recover=lambda folder: None)
    assert not own.exists()


def test_a_folder_that_was_cleared_while_it_was_made_is_made_anew(tmp_path, monkeypatch):
    lock, calls = temporaries._lock, []

    def cleared_at_first(path):
        calls.append(path)
        if len(calls) == 1:
            raise BlockingIOError
        return lock(path)

    monkeypatch.setattr(temporaries, "_lock", cleared_at_first)
    with temporary_folder(tmp_path) as folder:
        assert [path.name for path in tmp_path.iterdir()] == [folder.name]
    assert len(calls) == 2 and not list(tmp_path.iterdir())


def test_a_file_system_without_locks(tmp_path, monkeypatch):
    monkeypatch.setattr(temporaries, "_try_lock", lambda descriptor: False)
    with temporary_folder(tmp_path) as folder:
        clear_folders(tmp_path)
        assert folder.is_dir()
    assert not list(tmp_path.iterdir())
