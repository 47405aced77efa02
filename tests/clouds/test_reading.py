import os

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gmmjax.clouds import READERS, read_cloud
from gmmjax.errors import InputError

OWN_ENDINGS = sorted(set(READERS) - {".obj", ".off", ".stl", ".gltf", ".glb"})
STARTS = [
    b"",
    b"ply\nformat binary_little_endian 1.0\nelement vertex 3\nproperty float x\n",
    b"ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\nproperty float z\nend_header\n",
    b"VERSION 0.7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nWIDTH 2\nHEIGHT 1\nDATA ",
    b"VERSION 0.7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nWIDTH 2\nHEIGHT 1\nDATA binary_compressed\n",
    b"LASF" + bytes(20) + b"\x01\x02",
    b"\x93NUMPY\x01\x00\x46\x00{'descr': '<f8', 'fortran_order': False, 'shape': (",
    b"PK\x03\x04",
    b"2\n1 2 3\n",
]


@settings(max_examples=400)
@given(st.sampled_from(OWN_ENDINGS), st.sampled_from(STARTS), st.binary(max_size=300))
def test_garbage_is_read_or_is_an_input_error(write_file, ending, start, garbage):
    path = write_file(f"garbage{ending}", start + garbage)
    try:
        assert len(read_cloud(path)) > 0
    except InputError as error:
        assert str(path) in str(error)


@pytest.mark.parametrize("ending", OWN_ENDINGS)
def test_random_bytes_are_an_input_error(write_file, ending):
    path = write_file(f"noise{ending}", bytes(range(255, 0, -1)) * 8)
    with pytest.raises(InputError):
        read_cloud(path)


@pytest.mark.parametrize(
    ("path", "message"),
    [
        ("nowhere.ply", r"nowhere.ply: no such file; check the path"),
        (".", "is a folder"),
        ("a\0.ply", "cannot be opened"),
    ],
)
def test_what_is_no_file(tmp_path, path, message):
    with pytest.raises(InputError, match=message):
        read_cloud(str(tmp_path / path))


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        *[(name, b"", r"is empty \(0 bytes\)") for name in ("a.ply", "a.npy", "a.unknown")],
        *[(name, b"1 2 3\n", r"no known format.*\.ply \.pcd .*\.laz .*\.glb") for name in ("a.doc", "cloud")],
        ("a.xyz", b"nan 0 0\n0 inf 0\n", "every one of its 2 points has NaN or inf"),
    ],
)
def test_files_without_points(write_file, name, content, message):
    with pytest.raises(InputError, match=message):
        read_cloud(write_file(name, content))


@pytest.mark.skipif(not hasattr(os, "geteuid") or os.geteuid() == 0, reason="the administrator may read everything")
def test_no_permission(write_file):
    path = write_file("a.ply", b"ply\n")
    path.chmod(0)
    with pytest.raises(InputError, match="may not be read"):
        read_cloud(path)


def test_a_refused_file_names_the_remedy(write_file, monkeypatch):
    path = write_file("a.ply", b"ply\n")

    def refuse(*_, **__):
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr("pathlib.Path.open", refuse)
    with pytest.raises(InputError, match="may not be read; change its permissions"):
        read_cloud(path)
