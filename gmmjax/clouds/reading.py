"""Opening and reading a point cloud from a file of any known format."""

import logging
import os
from collections.abc import Callable, Mapping
from pathlib import Path

from gmmjax.clouds.arrays import open_npy, open_npz
from gmmjax.clouds.cloud_file import CloudFile, WholeFile
from gmmjax.clouds.e57 import open_e57
from gmmjax.clouds.files import require_file
from gmmjax.clouds.las import open_las
from gmmjax.clouds.mesh import open_mesh
from gmmjax.clouds.pcd import open_pcd
from gmmjax.clouds.ply import open_ply
from gmmjax.clouds.point_cloud import PointCloud
from gmmjax.clouds.source_file import SourceFile
from gmmjax.clouds.text import open_text
from gmmjax.errors import InputError, shown

logger = logging.getLogger(__name__)

# The function that opens a file of an ending, which is there and not empty; it gives a cloud where it reads all of it.
READERS: Mapping[str, Callable[[Path], CloudFile | PointCloud]] = {
    ".ply": open_ply,
    ".pcd": open_pcd,
    **dict.fromkeys((".xyz", ".asc", ".txt", ".csv", ".pts"), open_text),
    ".npy": open_npy,
    ".npz": open_npz,
    **dict.fromkeys((".las", ".laz"), open_las),
    ".e57": open_e57,
    **dict.fromkeys((".obj", ".off", ".stl", ".gltf", ".glb"), open_mesh),
}


def open_cloud(path: str | os.PathLike[str]) -> CloudFile:
    """Open a file of points that are read later, some at a time; its ending tells the format as in `read_cloud`.

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
    ending = file.suffix.lower()
    if ending not in READERS:
        what = "of PTX, scans with their poses, which is not read" if ending == ".ptx" else "of no known format"
        raise InputError(f"{file}: the ending {file.suffix!r} is {what}; convert it to one of {' '.join(READERS)}")
    source = SourceFile.of(file)
    opened = READERS[ending](file)
    if isinstance(opened, PointCloud):
        count = len(opened) + opened.rows_dropped
        opened = WholeFile(path=file, source=source, count=count, unit=opened.unit, crs=opened.crs, cloud=opened)
    if not opened.count:
        raise InputError(f"{file}: has 0 points; export the cloud again")
    return opened


def read_cloud(path: str | os.PathLike[str]) -> PointCloud:
    """Read the point cloud in a file; its ending, in upper or lower case, tells the format.

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
    """Read an open file; raises an `InputError` where it is damaged, was changed since, or has no finite point."""
    cloud = file.read()
    if not len(cloud):
        raise InputError(
            f"{file.path}: every one of its {cloud.rows_dropped} points has NaN or inf coordinates; export the cloud "
            "again"
        )
    logger.info("read %r", cloud)
    return cloud
