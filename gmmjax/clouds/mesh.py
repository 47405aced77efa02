"""Reading the vertices of mesh files with Open3D, the optional extra `open3d`."""

import os
from typing import Any

import numpy as np

from gmmjax.clouds.colors import color_bytes
from gmmjax.clouds.files import require_file
from gmmjax.clouds.point_cloud import PointCloud
from gmmjax.errors import InputError

SYSTEM_PACKAGES = "libusb-1.0-0 libgl1 libegl1 libgomp1"


def read_mesh(path: str | os.PathLike[str]) -> PointCloud:
    """The vertices of a mesh: .obj, .off, .stl, .gltf or .glb.

    Args:
        path: the file.

    Returns:
        The cloud, vertices in the order in which Open3D gives them, with their colours if the file has any.

    Raises:
        InputError: Open3D is not installed or cannot load, or the file cannot be read.
    """
    file = require_file(path)
    open3d = load_open3d(f"{file}: reading {file.suffix} files")
    try:
        with open3d.utility.VerbosityContextManager(open3d.utility.VerbosityLevel.Error):
            mesh = open3d.io.read_triangle_mesh(str(file))
        vertices = np.array(mesh.vertices, np.float64).reshape(-1, 3)
        shades = np.array(mesh.vertex_colors, np.float64).reshape(-1, 3)
    except Exception as error:
        raise InputError(f"{file}: Open3D cannot read it ({error}); export the vertices as PLY") from error
    if not len(vertices):
        raise InputError(f"{file}: Open3D finds no vertices in it; check the file, or export the vertices as PLY")
    colors = color_bytes(shades, str(file)) if len(shades) == len(vertices) else None
    return PointCloud.from_rows(vertices, colors, source=str(file))


def load_open3d(purpose: str) -> Any:
    """The module open3d.

    Args:
        purpose: what it is for, at the start of the message.

    Returns:
        The module.

    Raises:
        InputError: it is not installed, or a library of the system that it needs is missing.
    """
    try:
        import open3d
    except ModuleNotFoundError as error:
        if error.name != "open3d":
            raise InputError(f"{purpose} needs Open3D, which lacks {error.name}: pip install {error.name}") from error
        raise InputError(f"{purpose} needs Open3D: pip install '.[open3d]'") from error
    except (ImportError, OSError) as error:
        raise InputError(
            f"{purpose} needs Open3D, which is installed but cannot load ({error}): "
            f"apt-get install {SYSTEM_PACKAGES} (Debian, Ubuntu), or export the vertices as PLY"
        ) from error
    return open3d
