"""Reading E57 files, the format of terrestrial scanners (ASTM E2807), with pye57 in a process of its own."""

import dataclasses
import functools
import json
import os
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float64
from scipy.spatial.transform import Rotation

from gmmjax.clouds.cloud_file import CloudFile, RowBlock
from gmmjax.clouds.decoder_process import DecoderProcess, DecodingError, Request
from gmmjax.clouds.files import require_file
from gmmjax.clouds.point_cloud import PointCloud
from gmmjax.clouds.reference_system import ANGLES, of_wkt
from gmmjax.clouds.source_file import SourceFile
from gmmjax.clouds.views import SensorViews
from gmmjax.errors import InputError, one_line
from gmmjax.geometry import rigid_transform, transformed

# Lengths in E57 are metres, by its standard; a file that states a geographic system may hold angles in their place.
UNIT = "m"
SIGNATURE = b"ASTM-E57"
CARTESIAN = ("cartesianX", "cartesianY", "cartesianZ")
SPHERICAL = ("sphericalRange", "sphericalAzimuth", "sphericalElevation")
COLORS = ("colorRed", "colorGreen", "colorBlue")
NORMALS = ("nor:normalX", "nor:normalY", "nor:normalZ")
INVALID, SPHERICAL_INVALID = "cartesianInvalidState", "sphericalInvalidState"
# Where a scan has them, the elevations of a turning scanner grow evenly with one of these.
INDICES = ("rowIndex", "columnIndex")
# Fields that say again what the coordinates and colours do.
REPEATED = (*CARTESIAN, *SPHERICAL, *COLORS, INVALID, SPHERICAL_INVALID)
# Bytes a second that the slowest machine decodes, and bytes that the library takes beside a block of points.
SLOWEST, WORKING_MEMORY = 1_000_000, 1 << 29
# Standard deviation of the elevations from even steps along the rows or columns of a scan, as a fraction of their
# range, below which its pose is that of a turning scanner. Larger: merged scans have views from where nobody stood.
MOST_UNEVENNESS = 0.02


@dataclasses.dataclass(frozen=True, eq=False)
class Scan:
    """What a file says of one of its scans.

    Attributes:
        fields: the names of E57 of what its points have.
        count: of its points.
        pose: scanner to world; the identity where the file has none.
        posed: whether the file has one.
    """

    fields: tuple[str, ...]
    count: int
    pose: Float64[np.ndarray, "4 4"]
    posed: bool

    def places(self, columns: dict[str, np.ndarray]) -> Float64[np.ndarray, "n 3"]:
        """Coordinates in the frame of the scan; NaN where the scanner had no return.

        Args:
            columns: of some of its points, by name.
        """
        if set(CARTESIAN) <= set(self.fields):
            places, invalid = np.stack([columns[name] for name in CARTESIAN], axis=1), INVALID
        else:
            reach, azimuth, elevation = (np.ascontiguousarray(columns[name]) for name in SPHERICAL)
            # What is damaged may be infinite.
            with np.errstate(invalid="ignore", over="ignore"):
                flat = reach * np.cos(elevation)
                places = np.stack([flat * np.cos(azimuth), flat * np.sin(azimuth), reach * np.sin(elevation)], axis=1)
            invalid = SPHERICAL_INVALID
        if invalid in columns:
            places[columns[invalid] != 0] = np.nan
        return places

    def turned_normals(self, columns: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
        """The normals in the world, by their names in E57; none where the scan has none."""
        if not set(NORMALS) <= set(self.fields):
            return {}
        normals = np.stack([columns[name] for name in NORMALS], axis=1) @ self.pose[:3, :3].T
        return dict(zip(NORMALS, normals.T, strict=True))


@dataclasses.dataclass(frozen=True, eq=False, kw_only=True)
class E57File(CloudFile):
    """An E57 file: the points of all its scans, in the world, in metres.

    Attributes:
        all_scans: of the file, also those without points.
    """

    all_scans: tuple[Scan, ...]

    @property
    def scans(self) -> int:
        """How many scans with points the file holds."""
        return len(self._filled)

    @functools.cached_property
    def views(self) -> SensorViews | None:
        """Where the scanner stood, where every scan has a pose and rows as of a turning scanner there; else None."""
        evenness = self._evenness()
        if not evenness:
            return None
        for block in self.row_blocks():
            _add(evenness, block)
        return self._views(evenness, lambda: (chunk.points for chunk in self.chunks()))

    def read(self) -> PointCloud:
        """All points, in memory.

        Raises:
            InputError: as `row_blocks`, or the memory does not hold them.
        """
        evenness = self._evenness()

        def observed() -> Iterator[RowBlock]:
            for block in self.row_blocks():
                _add(evenness, block)
                yield block

        cloud = self._read(observed())
        return dataclasses.replace(cloud, views=self._views(evenness, lambda: [cloud.points]))

    def blocks(self) -> Iterator[RowBlock]:
        """All points, some at a time.

        Raises:
            InputError: the file is damaged or cut off.
        """
        with _decoded(self.path, self.source.size) as blocks:
            next(blocks)
            number = 0
            for scan in self.all_scans:
                yield from self._scan_blocks(blocks, scan, number)
                number += scan.count > 0
            # Ends the answer, and the process with it.
            next(blocks, None)

    @property
    def _filled(self) -> list[Scan]:
        return [scan for scan in self.all_scans if scan.count]

    @functools.cached_property
    def _names(self) -> tuple[str, ...]:
        """Of all columns, those that only some of the scans have among them."""
        names = dict.fromkeys(name for scan in self._filled for name in scan.fields if name not in REPEATED)
        return tuple(names)

    def _scan_blocks(self, blocks: Iterator[bytearray], scan: Scan, number: int) -> Iterator[RowBlock]:
        found = 0
        while block := next(blocks, None):
            table = np.frombuffer(block, np.float64).reshape(-1, len(scan.fields))
            found += len(table)
            yield self._rows(scan, number, table)
        if found != scan.count:
            raise InputError(f"{self.path}: declares a scan of {scan.count} points, {found} are there; copy it again")

    def _rows(self, scan: Scan, number: int, table: Float64[np.ndarray, "n fields"]) -> RowBlock:
        columns = {name: table[:, index] for index, name in enumerate(scan.fields)}
        points = transformed(scan.places(columns), scan.pose)
        colors = None
        if all(set(COLORS) <= set(own.fields) for own in self._filled):
            colors = np.stack([columns[name] for name in COLORS], axis=1)
        columns |= scan.turned_normals(columns)
        fields = {name: columns.get(name, np.full(len(table), np.nan)) for name in self._names}
        if self.scans == 1:
            return RowBlock(points, fields, colors)
        fields["scan"] = np.full(len(table), number, np.int32)
        return RowBlock(points, fields, colors, np.full(len(table), number, np.int16))

    def _evenness(self) -> "list[_Evenness]":
        """That of each scan; none where a scan has no pose."""
        scans = self._filled
        return [_Evenness(scan) for scan in scans] if all(scan.posed for scan in scans) else []

    def _views(self, evenness: "list[_Evenness]", parts: Callable[[], Iterable[np.ndarray]]) -> SensorViews | None:
        if not evenness or not all(own.is_station for own in evenness):
            return None
        try:
            return SensorViews.from_parts(parts, np.stack([scan.pose[:3, 3] for scan in self._filled]))
        # Such as a scanner that is too far away from its points.
        except InputError:
            return None


def open_e57(path: str | os.PathLike[str]) -> E57File:
    """An E57 file: the points of all its scans, in the world, in metres.

    Colours become bytes; all other fields of the points (intensity, time, row and column of the scan, ...) stay, with
    NaN in scans that do not have them; in a file of several scans the field `scan` is the number of each point's own.
    Pixels without a return are dropped and counted. Spherical coordinates are converted where a scan has no Cartesian
    ones.

    Args:
        path: the file.

    Returns:
        The file, of which the descriptions of the scans are read.

    Raises:
        InputError: pye57 is not installed; the file is damaged, has no points, or a scan has no coordinates.
    """
    file = require_file(path)
    source = SourceFile.of(file)
    with file.open("rb") as stream:
        if stream.read(len(SIGNATURE)) != SIGNATURE:
            raise InputError(f"{file}: is no E57 file (it does not start with ASTM-E57); rename it to its real format")
    with _decoded(file, source.size) as blocks:
        details = json.loads(next(blocks, b"{}"))
    described = details.get("scans", [])
    _check(described, file)
    scans = tuple(_scan(own) for own in described)
    system = of_wkt(details["coordinate_metadata"])
    return E57File(
        path=file,
        source=source,
        count=sum(scan.count for scan in scans),
        unit=system.unit if system.unit in ANGLES else UNIT,
        crs=system.crs,
        all_scans=scans,
    )


@contextmanager
def _decoded(file: Path, size: int) -> Iterator[Iterator[bytearray]]:
    """What the decoder says of a file: a description of the scans, and the blocks of their points."""
    request = Request("e57", file, "pye57", WORKING_MEMORY + size, size / SLOWEST, {})
    try:
        with DecoderProcess() as decoder:
            yield decoder.decode(request)
    except DecodingError as error:
        if error.kind in ("ModuleNotFoundError", "ImportError"):
            raise InputError(f"{file}: E57 files need pye57 ({error}): pip install 'gmmjax[e57]'") from error
        raise InputError(
            # What follows the asterisks is for the developers of the library.
            f"{file}: pye57 cannot read it ({one_line(error).split(' ****')[0]}); the file is damaged, copy or "
            "export it again"
        ) from error


def _check(scans: list[dict[str, Any]], file: Path) -> None:
    """Whether there are points, with coordinates and a pose that is one."""
    if not any(scan["count"] for scan in scans):
        what = f"has no points in any of its scans ({len(scans)})" if scans else "has no scan"
        raise InputError(f"{file}: {what}; export the file again with its point data")
    for number, scan in enumerate(scans):
        if scan["count"] and not any(set(axes) <= set(scan["fields"]) for axes in (CARTESIAN, SPHERICAL)):
            listed = ", ".join(scan["fields"][:6]) or "nothing"
            raise InputError(
                f"{file}: scan {number} of {len(scans)} has neither Cartesian nor spherical coordinates, only: "
                f"{listed}; export the file with Cartesian coordinates"
            )
        if scan["pose"] is not None and _pose(scan["pose"]) is None:
            raise InputError(f"{file}: the pose of scan {number} of {len(scans)} is none; export the file again")


def _pose(pose: list[list[float]]) -> Float64[np.ndarray, "4 4"] | None:
    rotation, translation = (np.array(part, np.float64) for part in pose)
    if not (np.isfinite(rotation).all() and np.isfinite(translation).all() and 0.5 < np.linalg.norm(rotation) < 2):
        return None
    return rigid_transform(Rotation.from_quat(rotation[[1, 2, 3, 0]]).as_matrix(), translation)


def _scan(details: dict[str, Any]) -> Scan:
    pose = None if details["pose"] is None else _pose(details["pose"])
    posed = pose is not None
    return Scan(tuple(details["fields"]), details["count"], pose if pose is not None else np.eye(4), posed)


class _Evenness:
    """Whether elevations grow evenly with the row or the column of a scan, as from the place of a turning scanner."""

    def __init__(self, scan: Scan) -> None:
        self._to_scan = np.linalg.inv(scan.pose)
        self._lines = {name: _Line() for name in INDICES if name in scan.fields}

    def add(self, block: RowBlock) -> None:
        """Takes some points of the scan into account."""
        places = transformed(block.points, self._to_scan)
        elevations = np.arctan2(places[:, 2], np.hypot(places[:, 0], places[:, 1]))
        known = np.isfinite(elevations)
        for name, line in self._lines.items():
            line.add(block.columns[name][known], elevations[known])

    @property
    def is_station(self) -> bool:
        """Whether they do."""
        return any(line.unevenness < MOST_UNEVENNESS for line in self._lines.values())


def _add(evenness: list[_Evenness], block: RowBlock) -> None:
    """Takes a block of one scan into account for it."""
    if evenness:
        evenness[0 if block.scan is None else int(block.scan[0])].add(block)


class _Line:
    """The straight line through values over an index, of which some are given at a time."""

    def __init__(self) -> None:
        self._count, self._mean, self._scatter = 0, np.zeros(2), np.zeros((2, 2))
        self._lowest, self._highest = np.inf, -np.inf

    def add(self, index: Float64[np.ndarray, " n"], values: Float64[np.ndarray, " n"]) -> None:
        """Takes more values into account (Chan, Golub and LeVeque 1983)."""
        if not len(index):
            return
        pairs = np.stack([index, values])
        mean = pairs.mean(axis=1)
        centred = pairs - mean[:, None]
        total = self._count + len(index)
        step = mean - self._mean
        self._scatter += centred @ centred.T + np.outer(step, step) * (self._count * len(index) / total)
        self._mean = self._mean + step * (len(index) / total)
        self._count = total
        self._lowest, self._highest = min(self._lowest, index.min()), max(self._highest, index.max())

    @property
    def unevenness(self) -> float:
        """Standard deviation from the straight line over the index, as a fraction of the line's range."""
        spread = self._scatter[0, 0]
        if not spread:
            return np.inf
        slope = self._scatter[0, 1] / spread
        extent = abs(slope) * (self._highest - self._lowest)
        variance = max(self._scatter[1, 1] - slope * self._scatter[0, 1], 0.0) / self._count
        return float(np.sqrt(variance) / extent) if extent else np.inf
