"""Reading E57 files, the format of terrestrial scanners (ASTM E2807), with pye57 in a process of its own."""

import dataclasses
import functools
import json
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float64
from scipy.spatial.transform import Rotation

from gmmjax.clouds.cloud_file import CloudFile, RowBlock
from gmmjax.clouds.decoder_process import DecoderProcess, DecodingError, Request
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
MAX_UNEVENNESS = 0.02


@dataclasses.dataclass(frozen=True, eq=False)
class Scan:
    """One of the scans of a file.

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

    def has(self, *names: str) -> bool:
        """True if the points have all of these fields."""
        return set(names) <= set(self.fields)

    def places(self, columns: dict[str, np.ndarray]) -> Float64[np.ndarray, "n 3"]:
        """Coordinates, in the frame of the scan, of points given by their columns; NaN where there was no return."""
        if self.has(*CARTESIAN):
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


@dataclasses.dataclass(frozen=True, eq=False, kw_only=True)
class E57File(CloudFile):
    """An E57 file: the points of all its scans, in the world, in metres.

    Attributes:
        all_scans: of the file, also those without points.
    """

    all_scans: tuple[Scan, ...]

    @property
    def scans(self) -> int:
        """Number of scans with points in the file."""
        return len(self._filled)

    def blocks(self) -> Iterator[RowBlock]:
        """Yield all points, some at a time; raises an `InputError` where the file is damaged or cut off."""
        with _decoded(self.path, self.source.size) as blocks:
            next(blocks)
            number = 0
            for scan in self.all_scans:
                yield from self._scan_blocks(blocks, scan, number)
                number += scan.count > 0
            # Ends the answer, and the process with it.
            next(blocks, None)

    def views_of(self, blocks: Callable[[], Iterable[RowBlock]]) -> SensorViews | None:
        """Views of the scanner, if every scan has a pose and the rows of a rotating scanner; else None."""
        scans = self._filled
        if not all(scan.posed and set(INDICES) & set(scan.fields) for scan in scans):
            return None
        lines = [{name: _Line() for name in INDICES if scan.has(name)} for scan in scans]
        for block in blocks():
            numbers = block.columns.get("scan", np.zeros(len(block.points)))
            for number, (scan, own) in enumerate(zip(scans, lines, strict=True)):
                # The scans follow each other.
                part = block.part(slice(*map(int, np.searchsorted(numbers, [number, number + 1]))))
                _add_elevations(own, scan, part)
        if not all(any(line.unevenness < MAX_UNEVENNESS for line in own.values()) for own in lines):
            return None
        try:
            stations = np.stack([scan.pose[:3, 3] for scan in scans])
            return SensorViews.from_parts(lambda: (block.points for block in blocks()), stations)
        # Such as a scanner that is too far away from its points.
        except InputError:
            return None

    @functools.cached_property
    def _filled(self) -> list[Scan]:
        return [scan for scan in self.all_scans if scan.count]

    @functools.cached_property
    def _names(self) -> tuple[str, ...]:
        """Names of all columns, with those that only some of the scans have."""
        return tuple(dict.fromkeys(name for scan in self._filled for name in scan.fields if name not in REPEATED))

    def _scan_blocks(self, blocks: Iterator[bytearray], scan: Scan, number: int) -> Iterator[RowBlock]:
        found = 0
        while block := next(blocks, None):
            table = np.frombuffer(block, np.float64).reshape(-1, len(scan.fields))
            found += len(table)
            yield self._rows(scan, number, table)
        if found != scan.count:
            raise InputError(f"{self.path}: declares a scan of {scan.count} points, {found} are there; copy it again")

    def _rows(self, scan: Scan, number: int, table: Float64[np.ndarray, "n fields"]) -> RowBlock:
        columns = dict(zip(scan.fields, table.T, strict=True))
        points = transformed(scan.places(columns), scan.pose)
        colored = all(own.has(*COLORS) for own in self._filled)
        colors = np.stack([columns[name] for name in COLORS], axis=1) if colored else None
        if scan.has(*NORMALS):
            normals = np.stack([columns[name] for name in NORMALS], axis=1) @ scan.pose[:3, :3].T
            columns |= zip(NORMALS, normals.T, strict=True)
        fields = {name: columns.get(name, np.full(len(table), np.nan)) for name in self._names}
        if self.scans == 1:
            return RowBlock(points, fields, colors)
        fields["scan"] = np.full(len(table), number, np.int32)
        return RowBlock(points, fields, colors, np.full(len(table), number, np.int16))


def open_e57(path: Path) -> E57File:
    """Open an E57 file: the points of all its scans, in the world, in metres.

    Colours become bytes; all other fields of the points (intensity, time, row and column of the scan, ...) stay, with
    NaN in scans that do not have them; in a file of several scans the field `scan` is the number of each point's own.
    Pixels without a return are dropped and counted. Spherical coordinates are converted where a scan has no Cartesian
    ones.

    Args:
        path: the file.

    Returns:
        The file, with the descriptions of its scans read.

    Raises:
        InputError: pye57 is not installed; the file is damaged, has no points, or a scan has no coordinates.
    """
    source = SourceFile.of(path)
    with path.open("rb") as stream:
        if stream.read(len(SIGNATURE)) != SIGNATURE:
            raise InputError(f"{path}: is no E57 file (it does not start with ASTM-E57); rename it to its real format")
    with _decoded(path, source.size) as blocks:
        details = json.loads(next(blocks, b"{}"))
    described = details.get("scans", [])
    if not any(own["count"] for own in described):
        what = f"has no points in any of its scans ({len(described)})" if described else "has no scan"
        raise InputError(f"{path}: {what}; export the file again with its point data")
    total = len(described)
    scans = tuple(_scan(own, path, f"scan {number} of {total}") for number, own in enumerate(described))
    system = of_wkt(details["coordinate_metadata"])
    return E57File(
        path=path,
        source=source,
        count=sum(scan.count for scan in scans),
        unit=system.unit if system.unit in ANGLES else UNIT,
        crs=system.crs,
        all_scans=scans,
    )


@contextmanager
def _decoded(file: Path, size: int) -> Iterator[Iterator[bytearray]]:
    """Output of the decoder for a file: a description of the scans, and the blocks of their points."""
    request = Request("e57", file, "pye57", WORKING_MEMORY + size, size / SLOWEST)
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


def _scan(details: dict[str, Any], file: Path, name: str) -> Scan:
    """A scan as the decoder describes it, which must have coordinates and a pose that is one."""
    scan = Scan(tuple(details["fields"]), details["count"], np.eye(4), details["pose"] is not None)
    if scan.count and not (scan.has(*CARTESIAN) or scan.has(*SPHERICAL)):
        raise InputError(
            f"{file}: {name} has neither Cartesian nor spherical coordinates, only: "
            f"{', '.join(scan.fields[:6]) or 'nothing'}; export the file with Cartesian coordinates"
        )
    if not scan.posed:
        return scan
    pose = np.array(details["pose"])
    if not np.isfinite(pose).all() or not 0.5 < np.linalg.norm(pose[:4]) < 2:
        raise InputError(f"{file}: the pose of {name} is none; export the file again")
    rotation = Rotation.from_quat(pose[[1, 2, 3, 0]]).as_matrix()
    return dataclasses.replace(scan, pose=rigid_transform(rotation, pose[4:]))


def _add_elevations(lines: "dict[str, _Line]", scan: Scan, block: RowBlock) -> None:
    """Adds points of a scan to the lines of their elevations over its indices, by name."""
    places = transformed(block.points, np.linalg.inv(scan.pose))
    elevations = np.arctan2(places[:, 2], np.hypot(places[:, 0], places[:, 1]))
    for name, line in lines.items():
        line.add(block.columns[name], elevations)


class _Line:
    """The straight line through elevations over an index, of which some are given at a time."""

    def __init__(self) -> None:
        self._moments, self._low, self._high = np.zeros((3, 3)), np.inf, -np.inf

    @np.errstate(over="ignore", invalid="ignore")
    def add(self, index: Float64[np.ndarray, " n"], elevations: Float64[np.ndarray, " n"]) -> None:
        known = np.isfinite(index) & np.isfinite(elevations)
        table = np.stack([np.ones(known.sum()), index[known], elevations[known]])
        # Indices are whole numbers of at most some thousands: nothing is lost in their squares.
        self._moments += table @ table.T
        self._low = min(self._low, table[1].min(initial=np.inf))
        self._high = max(self._high, table[1].max(initial=-np.inf))

    @property
    @np.errstate(over="ignore", invalid="ignore")
    def unevenness(self) -> float:
        """Standard deviation from the straight line, as a fraction of the line's range."""
        if not self._low < self._high:
            return np.inf
        count, mean = self._moments[0, 0], self._moments[0, 1:] / self._moments[0, 0]
        scatter = self._moments[1:, 1:] / count - np.outer(mean, mean)
        slope = scatter[0, 1] / scatter[0, 0]
        extent = abs(slope) * (self._high - self._low)
        return float(np.sqrt(max(scatter[1, 1] - slope * scatter[0, 1], 0.0)) / extent) if extent else np.inf
