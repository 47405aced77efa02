"""Frames as files: one frame, a folder of frames, or one archive of many."""

import functools
import json
import re
import shutil
import tempfile
import zipfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO, Literal

import numpy as np
from jaxtyping import Float64

from gmmjax.clouds import (
    FolderKind,
    atomic_write,
    check_output_folder,
    output_folder,
    viewpoint_of,
    write_pcd,
    write_ply,
)
from gmmjax.errors import InputError
from gmmjax.geometry import transformed
from gmmjax.surveys import Frame

SCHEMA_VERSION = 1
MARKER = "frames.json"
FRAME_SUFFIXES = (".pcd", ".ply", ".npz")
# Coordinates are written as float32 where that moves none by more than this, metres.
FLOAT32_ERROR = 5e-5
IN_PLACE = np.eye(4)

Pose = Float64[np.ndarray, "4 4"]
AddFrame = Callable[[Frame, Pose | None], None]


def write_frame(path: Path, frame: Frame, pose: Pose | None = None) -> None:
    """Write one frame, whole or not at all.

    Args:
        path: `.pcd`, which keeps the order of the pixels and the pose, `.ply` or `.npz`.
        frame: in its sensor's coordinates.
        pose: sensor to world; the points are then written in the world.

    Raises:
        InputError: another ending, a name of a field that the format cannot hold, or a folder that cannot be written.
    """
    writers = {".pcd": _write_pcd, ".ply": _write_ply, ".npz": _write_npz}
    if path.suffix not in writers:
        raise InputError(f"{path}: a frame is written as {', '.join(FRAME_SUFFIXES)}; rename it")
    writers[path.suffix](path, frame, pose)


@contextmanager
def frame_archive(path: Path) -> Iterator[AddFrame]:
    """Write an NPZ file of many frames, whole or not at all; the points wait on the disk, not in memory.

    Its arrays: `points` float64 [N, 3] of all frames, `frame` int64 [N], the frame of each point, `times` float64 [V],
    and `poses` float64 [V, 4, 4], sensor to world, where every frame has one; the points are then in the world.

    Yields:
        A function that adds a frame.

    Raises:
        InputError: no frame was added, or the folder cannot be written.
    """
    frames: list[tuple[float, int, Pose | None]] = []
    with atomic_write(path) as file, tempfile.TemporaryFile(dir=path.absolute().parent) as waiting:
        yield functools.partial(_put_aside, waiting, frames)
        if not frames:
            raise InputError(f"{path}: there are no frames to write; check the topic and the times")
        waiting.seek(0)
        times, counts, given = zip(*frames, strict=True)
        poses = [pose for pose in given if pose is not None]
        small = {"times": np.array(times)} | ({"poses": np.stack(poses)} if len(poses) == len(times) else {})
        with zipfile.ZipFile(file, "w") as archive:
            with _member(archive, "points", np.dtype(np.float64), (sum(counts), 3)) as stream:
                shutil.copyfileobj(waiting, stream)
            with _member(archive, "frame", np.dtype(np.int64), (sum(counts),)) as stream:
                for index, count in enumerate(counts):
                    stream.write(np.full(count, index, np.int64).tobytes())
            for name, values in small.items():
                with _member(archive, name, values.dtype, values.shape) as stream:
                    stream.write(values.tobytes())


def _put_aside(
    waiting: IO[bytes], frames: list[tuple[float, int, Pose | None]], frame: Frame, pose: Pose | None
) -> None:
    frames.append((frame.time, len(frame.cloud), pose))
    waiting.write(_in_world(frame.cloud.points, pose).tobytes())


@contextmanager
def frame_folder(folder: Path, suffix: Literal["pcd", "ply"], *, overwrite: bool = False) -> Iterator[AddFrame]:
    """Write a folder with a file for each frame and `frames.json`, their times and poses; whole or not at all.

    Yields:
        A function that adds a frame.

    Raises:
        InputError: as `output_folder`, or no frame was added.
    """
    entries: list[dict[str, object]] = []
    with output_folder(folder, _kind(folder), overwrite=overwrite) as staging:
        yield functools.partial(_add_file, staging, suffix, entries)
        if not entries:
            raise InputError(f"{folder}: there are no frames to write; check the topic and the times")
        content = {"schema_version": SCHEMA_VERSION, "frames": entries}
        (staging / MARKER).write_text(json.dumps(content, indent=1, allow_nan=False) + "\n", encoding="utf-8")


def _add_file(folder: Path, suffix: str, entries: list[dict[str, object]], frame: Frame, pose: Pose | None) -> None:
    name = f"frame_{len(entries):06d}.{suffix}"
    write_frame(folder / name, frame, pose)
    placed = {} if pose is None else {"pose": pose.tolist()}
    entries.append({"file": name, "time": frame.time, "points": len(frame.cloud), **placed})


def check_frame_folder(folder: Path, *, overwrite: bool = False) -> None:
    """Raise an InputError unless `frame_folder` could write there. Changes nothing."""
    check_output_folder(folder, _kind(folder), overwrite=overwrite)


def _kind(folder: Path) -> FolderKind:
    """Name the files of a folder of frames: those of one that is there already, whatever frames it has."""
    names = [path.name for path in folder.iterdir()] if folder.is_dir() else []
    frames = tuple(name for name in names if re.fullmatch(r"frame_\d{6,}\.(pcd|ply)", name))
    return FolderKind("folder of frames", MARKER, "frames", frames)


def _write_pcd(path: Path, frame: Frame, pose: Pose | None) -> None:
    cloud = frame.cloud
    points = _compact(_in_world(cloud.points, pose))
    colors, fields = cloud.colors, dict(cloud.fields)
    if frame.width is not None:
        points = _by_pixel(frame, points, np.nan)
        colors = None if colors is None else _by_pixel(frame, colors, 0)
        fields = {name: _by_pixel(frame, values, 0) for name, values in fields.items()}
    viewpoint = viewpoint_of(IN_PLACE if pose is None else pose)
    write_pcd(path, points, viewpoint=viewpoint, colors=colors, fields=fields)


def _write_ply(path: Path, frame: Frame, pose: Pose | None) -> None:
    comments = [f"time {frame.time:.9f}", f"frame {frame.name or 'without a name'}"]
    points = _in_world(frame.cloud.points, pose)
    write_ply(path, points, colors=frame.cloud.colors, fields=frame.cloud.fields, comments=comments)


def _write_npz(path: Path, frame: Frame, pose: Pose | None) -> None:
    with frame_archive(path) as add:
        add(frame, pose)


def _in_world(points: Float64[np.ndarray, "n 3"], pose: Pose | None) -> Float64[np.ndarray, "n 3"]:
    return points if pose is None else transformed(points, pose)


def _compact(points: Float64[np.ndarray, "n 3"]) -> np.ndarray:
    single = points.astype(np.float32)
    return single if np.abs(single - points).max(initial=0) <= FLOAT32_ERROR else points


def _by_pixel(frame: Frame, values: np.ndarray, empty: float | int) -> np.ndarray:
    """Put values of the points in the order of an ordered frame's pixels."""
    assert frame.width is not None and frame.height is not None
    image = np.full((frame.height * frame.width, *values.shape[1:]), empty, values.dtype)
    image[frame.cloud.rows] = values
    return image.reshape(frame.height, frame.width, *values.shape[1:])


@contextmanager
def _member(archive: zipfile.ZipFile, name: str, dtype: np.dtype, shape: tuple[int, ...]) -> Iterator[IO[bytes]]:
    """Open an array of an archive, to be written in blocks."""
    with archive.open(zipfile.ZipInfo(f"{name}.npy"), "w", force_zip64=True) as stream:
        header = {"descr": np.lib.format.dtype_to_descr(dtype), "fortran_order": False, "shape": shape}
        np.lib.format.write_array_header_1_0(stream, header)
        yield stream
