"""Opening and reading a point cloud from a file of any known format."""

import logging
import os
from collections.abc import Callable, Mapping

from gmmjax.clouds.arrays import open_npy, read_npz
from gmmjax.clouds.cloud_file import CloudFile, WholeFile
from gmmjax.clouds.e57 import open_e57
from gmmjax.clouds.files import require_file
from gmmjax.clouds.las import open_las
from gmmjax.clouds.mesh import read_mesh
from gmmjax.clouds.pcd import open_pcd
from gmmjax.clouds.ply import open_ply
from gmmjax.clouds.point_cloud import PointCloud
from gmmjax.clouds.source_file import SourceFile
from gmmjax.clouds.text import read_text
from gmmjax.errors import InputError, shown

logger = logging.getLogger(__name__)

# Of each ending the function that opens the file, or that reads it where it has to be read whole.
READERS: Mapping[str, Callable[[str | os.PathLike[str]], CloudFile | PointCloud]] = {
    ".ply": open_ply,
    ".pcd": open_pcd,
    **dict.fromkeys((".xyz", ".asc", ".txt", ".csv", ".pts"), read_text),
    ".npy": open_npy,
    ".npz": read_npz,
    **dict.fromkeys((".las", ".laz"), open_las),
    ".e57": open_e57,
    **dict.fromkeys((".obj", ".off", ".stl", ".gltf", ".glb"), read_mesh),
}


def open_cloud(path: str | os.PathLike[str]) -> CloudFile:
    """A file of points whose points are read later, some at a time; its ending tells the format as in `read_cloud`.

    LAS, LAZ, E57, .npy and binary PLY and PCD take the memory of a chunk, whatever their size. All other formats, and
    ascii and compressed PLY and PCD, are read whole.

    Args:
        path: the file; its coordinates may be in any unit.

    Raises:
        InputError: the file is missing, damaged, cut off, of an unknown format or without points; the message has the
            file's name, the cause and the remedy. What is damaged behind the header is found when it is read.
    """
    if isinstance(path, list | tuple):
        raise InputError(f"{shown(path)}: are several files; read those of one survey with gmmjax.read_survey(paths)")
    file = require_file(path)
    reader = READERS.get(file.suffix.lower())
    if reader is None:
        what = (
            "of PTX, scans with their poses, which is not read"
            if file.suffix.lower() == ".ptx"
            else "of no known format"
        )
        raise InputError(f"{file}: the ending {file.suffix!r} is {what}; convert it to one of {' '.join(READERS)}")
    source = SourceFile.of(file)
    opened = reader(file)
    opened = WholeFile.of(file, source, opened) if isinstance(opened, PointCloud) else opened
    if not opened.count:
        raise InputError(f"{file}: has 0 points; export the cloud again")
    return opened


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
    return read_opened(open_cloud(path))


def read_opened(file: CloudFile) -> PointCloud:
    """The point cloud in a file that is open.

    Raises:
        InputError: it is damaged, was changed since, or has no finite point.
    """
    cloud = file.read()
    if not len(cloud):
        raise InputError(
            f"{file.path}: every one of its {cloud.rows_dropped} points has NaN or inf coordinates; export the cloud "
            "again"
        )
    logger.info("read %r", cloud)
    return cloud
