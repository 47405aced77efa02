import errno
import os

import pytest

from gmmjax.clouds import atomic_write, write_ply
from gmmjax.errors import InputError


def test_new_and_replaced_files(tmp_path):
    path = tmp_path / "a.txt"
    for content in (b"first", b"second"):
        with atomic_write(path) as file:
            file.write(content)
        assert path.read_bytes() == content
        assert os.listdir(tmp_path) == ["a.txt"]


def test_the_old_file_stays_until_the_end(tmp_path):
    path = tmp_path / "a.txt"
    path.write_bytes(b"old")
    with atomic_write(path) as file:
        file.write(b"new")
        file.flush()
        assert path.read_bytes() == b"old"


@pytest.mark.parametrize("failure", [ValueError("stop"), KeyboardInterrupt(), OSError(errno.ENOSPC, "No space left")])
def test_a_failure_leaves_the_old_file_and_nothing_else(tmp_path, failure):
    path = tmp_path / "a.txt"
    path.write_bytes(b"old")
    with pytest.raises(type(failure)), atomic_write(path) as file:
        file.write(b"half of the new")
        raise failure
    assert path.read_bytes() == b"old"
    assert os.listdir(tmp_path) == ["a.txt"]


def test_a_full_disk_at_the_last_moment(tmp_path, monkeypatch):
    path = tmp_path / "a.ply"
    write_ply(path, [[0, 0, 0]])
    old = path.read_bytes()

    def full(_):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(OSError, match="No space left"):
        write_ply(path, [[1, 1, 1]])
    assert path.read_bytes() == old
    assert os.listdir(tmp_path) == ["a.ply"]


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="needs the device that is always full")
def test_a_full_disk_while_writing(tmp_path, monkeypatch):
    path = tmp_path / "a.ply"
    path.write_bytes(b"old")
    real_open = type(path).open

    def on_full_disk(self, mode="r", *arguments, **options):
        if mode != "wb":
            return real_open(self, mode, *arguments, **options)
        real_open(self, mode).close()
        return open("/dev/full", "wb")

    monkeypatch.setattr(type(path), "open", on_full_disk)
    with pytest.raises(OSError, match="No space left"):
        write_ply(path, [[1, 1, 1]])
    assert path.read_bytes() == b"old"
    assert os.listdir(tmp_path) == ["a.ply"]


def test_permissions_are_those_of_any_new_file(tmp_path):
    plain, ours = tmp_path / "plain", tmp_path / "ours"
    plain.write_bytes(b"")
    with atomic_write(ours):
        pass
    assert ours.stat().st_mode == plain.stat().st_mode


def test_a_link_stays_a_link(tmp_path):
    target, link = tmp_path / "target", tmp_path / "link"
    target.write_bytes(b"old")
    link.symlink_to(target)
    with atomic_write(link) as file:
        file.write(b"new")
    assert link.is_symlink()
    assert target.read_bytes() == b"new"


def test_folders_that_cannot_be_written(tmp_path):
    with pytest.raises(InputError, match="create the folder"), atomic_write(tmp_path / "missing" / "a.txt"):
        pass
    with pytest.raises(InputError, match="is a folder"), atomic_write(tmp_path):
        pass
