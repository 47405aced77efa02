"""Reading a point cloud from a file of any known format."""

import dataclasses
import logging
import os
from collections.abc import Callable, Mapping

from gmmjax.clouds.arrays import read_npy, read_npz
from gmmjax.clouds.e57 import read_e57
from gmmjax.clouds.files import require_file
from gmmjax.clouds.las import read_las
from gmmjax.clouds.mesh import read_mesh
from gmmjax.clouds.pcd import read_pcd
from gmmjax.clouds.ply import read_ply
from gmmjax.clouds.point_cloud import PointCloud
from gmmjax.clouds.source_file import SourceFile
from gmmjax.clouds.text import read_text
from gmmjax.errors import InputError

logger = logging.getLogger(__name__)

READERS: Mapping[str, Callable[[str | os.PathLike[str]], PointCloud]] = {
    ".ply": read_ply,
    ".pcd": read_pcd,
    **dict.fromkeys((".xyz", ".asc", ".txt", ".csv", ".pts"), read_text),
    ".npy": read_npy,
    ".npz": read_npz,
    **dict.fromkeys((".las", ".laz"), read_las),
    ".e57": read_e57,
    **dict.fromkeys((".obj", ".off", ".stl", ".gltf", ".glb"), read_mesh),
}


def read_cloud(path: str | os.PathLike[str]) -> PointCloud:
    """The point cloud in a file; its ending, in upper or lower case, tells the format.

    PLY, PCD, text (.xyz, .asc, .txt, .csv, .pts), NumPy (.npy, .npz), LAS and LAZ; E57 with the extra `e57`, and the
    vertices of meshes (.obj, .off, .stl, .gltf, .glb) with the extra `open3d`. Rows with NaN or inf are left out and
    counted in `rows_dropped`.

    Args:
        path: the file; its coordinates may be in any unit.

    Returns:
        The cloud, with at least one point.

    Raises:
        InputError: the file is missing, unreadable, damaged, of an unknown format, or has no finite point; the message
            has the file's name, the cause and the remedy.
    """
    file = require_file(path)
    reader = READERS.get(file.suffix.lower())
    if reader is None:
        raise InputError(
            f"{file}: the ending {file.suffix!r} is of no known format; convert it to one of {' '.join(READERS)}"
        )
    source = SourceFile.of(file)
    cloud = dataclasses.replace(reader(file), file=source)
    if not len(cloud) and not cloud.rows_dropped:
        raise InputError(f"{file}: has 0 points; export the cloud again")
    if not len(cloud):
        raise InputError(
            f"{file}: every one of its {cloud.rows_dropped} points has NaN or inf coordinates; export the cloud again"
        )
    logger.info("read %r", cloud)
    return cloud
