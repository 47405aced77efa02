import sys

import numpy as np
import pytest

from gmmjax.clouds import read_cloud
from gmmjax.errors import InputError

OBJ = b"v 0 0 0.5\nv 1 0 -0.25\nv 0 1 3\nf 1 2 3\n"
OFF = b"OFF\n3 1 0\n0 0 0.5\n1 0 -0.25\n0 1 3\n3 0 1 2\n"
STL = b"""solid hand
facet normal 0 0 1
outer loop
vertex 0 0 0.5
vertex 1 0 -0.25
vertex 0 1 3
endloop
endfacet
endsolid hand
"""


@pytest.mark.parametrize(("name", "content"), [("a.obj", OBJ), ("a.off", OFF), ("a.STL", STL)])
def test_vertices(open3d, write_file, name, content):
    cloud = read_cloud(write_file(name, content))
    np.testing.assert_allclose(cloud.points, [[0, 0, 0.5], [1, 0, -0.25], [0, 1, 3]])


@pytest.mark.parametrize("name", ["a.obj", "a.off", "a.stl", "a.gltf", "a.glb"])
def test_damaged_meshes(open3d, write_file, name):
    path = write_file(name, b"nothing of the kind")
    with pytest.raises(InputError, match=r"Open3D .* vertices") as caught:
        read_cloud(path)
    assert str(path) in str(caught.value)


@pytest.fixture
def broken_open3d(monkeypatch, tmp_path):
    """Puts an open3d in front whose import runs the given line."""

    def install(line: str) -> None:
        (tmp_path / "open3d.py").write_text(line)
        monkeypatch.delitem(sys.modules, "open3d", raising=False)
        monkeypatch.syspath_prepend(tmp_path)

    return install


def test_not_installed(broken_open3d, write_file):
    broken_open3d("raise ModuleNotFoundError('No module named open3d', name='open3d')")
    path = write_file("a.obj", OBJ)
    with pytest.raises(InputError, match=r"pip install '\.\[open3d\]'") as caught:
        read_cloud(path)
    assert str(path) in str(caught.value)


@pytest.mark.parametrize("kind", ["OSError", "ImportError"])
def test_a_library_of_the_system_is_missing(broken_open3d, write_file, kind):
    broken_open3d(f"raise {kind}('libusb-1.0.so.0: cannot open shared object file: No such file or directory')")
    with pytest.raises(
        InputError, match=r"libusb-1.0.so.0: cannot open.*apt-get install libusb-1.0-0 libgl1 libegl1 libgomp1"
    ):
        read_cloud(write_file("a.obj", OBJ))


def test_a_package_that_open3d_needs_is_missing(broken_open3d, write_file):
    broken_open3d("import no_such_package_of_open3d")
    with pytest.raises(InputError, match="pip install no_such_package_of_open3d"):
        read_cloud(write_file("a.obj", OBJ))
