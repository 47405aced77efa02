"""Reading the vertices of mesh files with Open3D, the optional extra `open3d`, in a process of its own."""

from pathlib import Path
from typing import Any

import numpy as np

from gmmjax.clouds.colors import color_bytes
from gmmjax.clouds.decoder_process import DecoderProcess, DecodingError, Request
from gmmjax.clouds.point_cloud import PointCloud
from gmmjax.clouds.source_file import SourceFile
from gmmjax.errors import InputError, one_line

SYSTEM_PACKAGES = "libusb-1.0-0 libgl1 libegl1 libgomp1"
# Bytes that Open3D takes for a byte of a file, and bytes a second that it reads on the slowest machine: it is stopped
# where it takes more. Binary STL takes the most, about eight bytes.
MEMORY_OF_BYTE = 32
SLOWEST = 100_000


def open_mesh(path: Path) -> PointCloud:
    """Read the vertices of a mesh, .obj, .off, .stl, .gltf or .glb, with their colours if the file has any.

    Raises:
        InputError: Open3D is not installed or cannot load, or the file cannot be read.
    """
    size = SourceFile.of(path).size
    request = Request("mesh", path, "Open3D", MEMORY_OF_BYTE * size, size / SLOWEST)
    try:
        with DecoderProcess() as decoder:
            vertices, shades = (np.frombuffer(data, np.float64).reshape(-1, 3) for data in decoder.decode(request))
    except DecodingError as error:
        if error.kind in ("ModuleNotFoundError", "ImportError", "OSError"):
            raise _cannot_load(f"{path}: reading {path.suffix} files", error, error.name) from error
        raise InputError(f"{path}: Open3D cannot read it ({one_line(error)}); export the vertices as PLY") from error
    if not len(vertices):
        raise InputError(f"{path}: Open3D finds no vertices in it; check the file, or export the vertices as PLY")
    colors = color_bytes(shades, str(path)) if len(shades) == len(vertices) else None
    return PointCloud.from_rows(vertices, colors, source=str(path))


def load_open3d(purpose: str) -> Any:
    """Import open3d; `purpose` is what it is for, at the start of the message.

    Raises:
        InputError: it is not installed, or a library of the system that it needs is missing.
    """
    try:
        import open3d
    except (ImportError, OSError) as error:
        missing = error.name if isinstance(error, ModuleNotFoundError) else None
        raise _cannot_load(purpose, error, missing) from error
    return open3d


def _cannot_load(purpose: str, error: Exception, missing: str | None) -> InputError:
    if missing == "open3d":
        return InputError(f"{purpose} needs Open3D: pip install '.[open3d]'")
    if missing is not None:
        return InputError(f"{purpose} needs Open3D, which lacks {missing}: pip install {missing}")
    return InputError(
        f"{purpose} needs Open3D, which is installed but cannot load ({one_line(error)}): "
        f"apt-get install {SYSTEM_PACKAGES} (Debian, Ubuntu), or export the vertices as PLY"
    )
