"""Reading E57 files, the format of terrestrial scanners (ASTM E2807), with pye57 in a process of its own."""

import dataclasses
import json
import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float64
from scipy.spatial.transform import Rotation

from gmmjax.clouds.colors import color_bytes
from gmmjax.clouds.decoder_process import DecoderProcess, DecodingError, Request
from gmmjax.clouds.files import require_file
from gmmjax.clouds.point_cloud import PointCloud
from gmmjax.clouds.reference_system import of_wkt
from gmmjax.clouds.views import SensorViews
from gmmjax.errors import InputError, one_line
from gmmjax.geometry import rigid_transform, transformed

# Lengths in E57 are metres, by its standard.
UNIT = "m"
SIGNATURE = b"ASTM-E57"
CARTESIAN = ("cartesianX", "cartesianY", "cartesianZ")
COLORS = ("colorRed", "colorGreen", "colorBlue")
NORMALS = ("nor:normalX", "nor:normalY", "nor:normalZ")
INVALID = "cartesianInvalidState"
# Fields that say again what the coordinates and colours do.
REPEATED = (*CARTESIAN, *COLORS, INVALID, "sphericalRange", "sphericalAzimuth", "sphericalElevation")
# Bytes a second that the slowest machine decodes, and bytes that the library takes beside a block of points.
SLOWEST, WORKING_MEMORY = 1_000_000, 1 << 29


@dataclasses.dataclass(frozen=True)
class StationSettings:
    """When the pose of a scan is that of the scanner.

    Attributes:
        unevenness: standard deviation of the elevations from even steps along the rows or columns of the scan, as a
            fraction of their range, from which on the pose is not that of a turning scanner. Empirical. 0: no scan has
            views; infinite: merged and moved scans have views from where nobody stood.
    """

    unevenness: float = 0.02


class _Scan(NamedTuple):
    """One scan of a file.

    Attributes:
        columns: values of its points by the names of E57.
        pose: scanner to world; the identity where the file has none.
        posed: whether the file has one.
    """

    columns: dict[str, np.ndarray]
    pose: Float64[np.ndarray, "4 4"]
    posed: bool

    @property
    def places(self) -> Float64[np.ndarray, "n 3"]:
        """In the frame of the scan; NaN where the scanner had no return."""
        places = np.stack([self.columns[name] for name in CARTESIAN], axis=1)
        if INVALID in self.columns:
            places[self.columns[INVALID] != 0] = np.nan
        return places

    @property
    def turned_normals(self) -> dict[str, np.ndarray]:
        """The normals in the world, by their names in E57; none where the file has none."""
        if not set(NORMALS) <= set(self.columns):
            return {}
        normals = np.stack([self.columns[name] for name in NORMALS], axis=1) @ self.pose[:3, :3].T
        return dict(zip(NORMALS, normals.T, strict=True))


def read_e57(path: str | os.PathLike[str], stations: StationSettings = StationSettings()) -> PointCloud:
    """The points of all scans of an E57 file, in the world, in metres.

    Colours become bytes; all other fields of the points (intensity, time, row and column of the scan, ...) stay, with
    NaN in scans that do not have them; in a file of several scans the field `scan` is the number of each point's own.
    Pixels without a return are dropped and counted. Where every scan has a pose, and its rows are those of a turning
    scanner that stood there, the cloud has `views`.

    Args:
        path: the file.
        stations: when the poses of the scans are views.

    Returns:
        The cloud, scans and points in the order of the file.

    Raises:
        InputError: pye57 is not installed; the file is damaged, has no points, or a scan has no Cartesian coordinates.
    """
    file = require_file(path)
    with file.open("rb") as stream:
        if stream.read(len(SIGNATURE)) != SIGNATURE:
            raise InputError(f"{file}: is no E57 file (it does not start with ASTM-E57); rename it to its real format")
    size = file.stat().st_size
    request = Request("e57", file, "pye57", WORKING_MEMORY + size, size / SLOWEST, {})
    try:
        with DecoderProcess() as decoder:
            blocks = decoder.decode(request)
            details = json.loads(next(blocks, b"{}"))
            _check(details, file)
            scans = [_scan(blocks, own, file) for own in details["scans"]]
            # Ends the answer, and the process with it.
            next(blocks, None)
    except DecodingError as error:
        if error.kind in ("ModuleNotFoundError", "ImportError"):
            raise InputError(f"{file}: E57 files need pye57 ({error}): pip install 'gmmjax[e57]'") from error
        raise InputError(
            # What follows the asterisks is for the developers of the library.
            f"{file}: pye57 cannot read it ({one_line(error).split(' ****')[0]}); the file is damaged, copy or "
            "export it again"
        ) from error
    return _cloud([scan for scan in scans if len(scan.columns[CARTESIAN[0]])], details, file, stations)


def _check(details: dict[str, Any], file: Path) -> None:
    """Whether there are points, with Cartesian coordinates and a pose that is one."""
    scans = details.get("scans", [])
    if not any(scan["count"] for scan in scans):
        raise InputError(f"{file}: its {len(scans)} scans have no points; export the file again with its point data")
    for number, scan in enumerate(scans):
        if scan["count"] and not set(CARTESIAN) <= set(scan["fields"]):
            listed = ", ".join(scan["fields"][:6]) or "nothing"
            raise InputError(
                f"{file}: scan {number} of {len(scans)} has no Cartesian coordinates, only: {listed}; export the file "
                "with Cartesian coordinates"
            )
        if scan["pose"] is not None and _pose(scan["pose"]) is None:
            raise InputError(f"{file}: the pose of scan {number} of {len(scans)} is none; export the file again")


def _pose(pose: list[list[float]]) -> Float64[np.ndarray, "4 4"] | None:
    rotation, translation = (np.array(part, np.float64) for part in pose)
    if not (np.isfinite(rotation).all() and np.isfinite(translation).all() and 0.5 < np.linalg.norm(rotation) < 2):
        return None
    return rigid_transform(Rotation.from_quat(rotation[[1, 2, 3, 0]]).as_matrix(), translation)


def _scan(blocks: Iterator[bytearray], details: dict[str, Any], file: Path) -> _Scan:
    names, width = details["fields"], len(details["fields"])
    parts = []
    while block := next(blocks, None):
        parts.append(np.frombuffer(block, np.float64).reshape(-1, width))
    found = sum(map(len, parts))
    if found != details["count"]:
        raise InputError(f"{file}: declares a scan of {details['count']} points, {found} are there; copy it again")
    table = np.concatenate(parts) if parts else np.empty((0, width))
    pose = None if details["pose"] is None else _pose(details["pose"])
    columns = {name: table[:, index] for index, name in enumerate(names)} or {CARTESIAN[0]: np.empty(0)}
    return _Scan(columns, np.eye(4) if pose is None else pose, pose is not None)


def _cloud(scans: list[_Scan], details: dict[str, Any], file: Path, stations: StationSettings) -> PointCloud:
    places = [scan.places for scan in scans]
    points = np.concatenate([transformed(own, scan.pose) for own, scan in zip(places, scans, strict=True)])
    colors = None
    if all(set(COLORS) <= set(scan.columns) for scan in scans):
        channels = [np.stack([scan.columns[name] for name in COLORS], axis=1) for scan in scans]
        colors = color_bytes(np.concatenate(channels), str(file))
    cloud = PointCloud.from_rows(points, colors, _fields(scans), str(file))
    placed = [scan.posed and _is_station(scan, own, stations) for scan, own in zip(scans, places, strict=True)]
    views = _views(cloud.points, scans) if len(cloud) and all(placed) else None
    return dataclasses.replace(cloud, views=views, unit=UNIT, crs=of_wkt(details["coordinate_metadata"]).crs)


def _fields(scans: list[_Scan]) -> dict[str, np.ndarray]:
    """All columns but coordinates and colours, with NaN for the points of scans that do not have them."""
    columns = [{**scan.columns, **scan.turned_normals} for scan in scans]
    names = list(dict.fromkeys(name for own in columns for name in own if name not in REPEATED))
    sizes = [len(own[CARTESIAN[0]]) for own in columns]
    fields = {
        name: np.concatenate([own.get(name, np.full(size, np.nan)) for own, size in zip(columns, sizes, strict=True)])
        for name in names
    }
    if len(scans) > 1:
        fields["scan"] = np.repeat(np.arange(len(scans), dtype=np.int32), sizes)
    return fields


def _views(points: Float64[np.ndarray, "n 3"], scans: list[_Scan]) -> SensorViews | None:
    """Where the scanner stood; field of view and range hold the points."""
    try:
        return SensorViews.from_positions(points, np.stack([scan.pose[:3, 3] for scan in scans]))
    # Such as a scanner that is too far away from its points.
    except InputError:
        return None


def _is_station(scan: _Scan, places: Float64[np.ndarray, "n 3"], settings: StationSettings) -> bool:
    """Whether elevations grow evenly with the row or the column of the scan, as from the place of a turning scanner."""
    elevations = np.arctan2(places[:, 2], np.hypot(places[:, 0], places[:, 1]))
    indices = [scan.columns[name] for name in ("rowIndex", "columnIndex") if name in scan.columns]
    return any(_unevenness(elevations, index) < settings.unevenness for index in indices)


def _unevenness(values: np.ndarray, index: np.ndarray) -> float:
    """Standard deviation from the straight line over the index, as a fraction of the line's range."""
    known = np.isfinite(values)
    offsets = index[known] - index[known].mean() if known.any() else np.empty(0)
    spread = float(offsets @ offsets)
    if spread == 0:
        return np.inf
    centred = values[known] - values[known].mean()
    slope = float(offsets @ centred) / spread
    extent = abs(slope) * float(np.ptp(offsets))
    return float((centred - slope * offsets).std()) / extent if extent else np.inf
