"""The unit and the coordinate reference system that two clouds have in common."""

from typing import Any

import numpy as np

from gmmjax.changes.config import DetectionConfig
from gmmjax.clouds import ANGLES, CloudFile, PointCloud, SurveyFiles, epsg_code, is_wkt, system_name
from gmmjax.errors import InputError
from gmmjax.pair import Pair


def common_unit(clouds: Pair[Any], config: DetectionConfig | None = None) -> str | None:
    """The unit of both clouds: the setting, else what both files state; no coordinate is ever converted.

    Args:
        clouds: coordinates, or a cloud, a file or a survey with the unit and the reference system that its files state.
        config: with the unit that the user gave; None where none can be given.

    Returns:
        The unit; None where it is not known.

    Raises:
        InputError: the files state two units, and the user gave none; two reference systems; or angles.
    """
    unit = None if config is None else config.unit
    for side, cloud in zip(("before", "after"), clouds, strict=True):
        check_lengths(side, cloud, strict=unit is None)
    units, systems = clouds.map(lambda cloud: _stated(cloud, "unit")), stated_systems(clouds).map(epsg_code)
    given = "" if config is None else ", or give the unit of both (DetectionConfig(unit=...), --unit) if one is wrong"
    if unit is None and None not in (*units,) and units.before != units.after:
        raise InputError(
            f"before is in {units.before} and after in {units.after}, as their files state; convert one of them{given}"
        )
    if None not in (*systems,) and systems.before != systems.after:
        raise InputError(
            f"before is in {systems.before} and after in {systems.after}, as their files state: coordinates of two "
            "reference systems cannot be compared; reproject one of them"
        )
    return unit or (units.before if units.before == units.after else None)


def check_lengths(name: str, cloud: Any, *, strict: bool = False) -> None:
    """Checks that the coordinates of a cloud are lengths, and not longitude and latitude.

    Args:
        name: what messages call the cloud.
        cloud: as of `common_unit`.
        strict: whether a file is refused as well whose coordinates are hardly the angles that it states.

    Raises:
        InputError: the file states a geographic reference system; it names the file, and a system to project it to.
    """
    angle = _stated(cloud, "unit")
    if angle not in ANGLES:
        return
    parts = [cloud] if isinstance(cloud, PointCloud) else cloud.chunks()
    points = next((part.points for part in parts if len(part.points)), np.zeros((1, 3)))
    low, (x, y), high = np.percentile(points[:, :2], [5, 50, 95], axis=0)
    stated = f"{name}{_file(cloud)}: states a geographic coordinate reference system"
    if (crs := _stated(cloud, "crs")) is not None:
        stated += f" ({system_name(crs)})"
    # A scan is smaller than a degree, and no angle is greater than 400 grad.
    if max(abs(x), abs(y)) <= 400 and (high - low).max() < 1:
        zone = _utm_zone(x, y) if angle == "degree" else ("the UTM zone of the place", "EPSG:CODE")
        raise InputError(
            f"{stated}: x and y are angles{' in degrees' if angle == 'degree' else ''}, and distances need lengths; "
            f"project both scans first, such as to {zone[0]}: pdal translate IN.las OUT.las reprojection "
            f"--filters.reprojection.out_srs={zone[1]} "
            + " ".join(f"--writers.las.scale_{axis}=0.001 --writers.las.offset_{axis}=auto" for axis in "xyz")
        )
    if strict:
        raise InputError(
            f"{stated}, but coordinates such as x {x:.6g}, y {y:.6g} are hardly angles; correct the reference system "
            "of the file, or say what its coordinates are in (DetectionConfig(unit=...), --unit)"
        )


def _utm_zone(longitude: float, latitude: float) -> tuple[str, str]:
    """Name and EPSG code of the UTM zone of a place, in WGS 84."""
    zone, north = int((longitude + 180) // 6) % 60 + 1, latitude >= 0
    return f"UTM zone {zone}{'N' if north else 'S'} of WGS 84", f"EPSG:{(32600 if north else 32700) + zone}"


def stated_system(cloud: Any) -> str | None:
    """The coordinate reference system that the file of a cloud states; None: it states none, or a wrong one.

    Args:
        cloud: coordinates, or a cloud, a file or a survey. It passed `check_lengths`: a geographic system is wrong.
    """
    return None if _stated(cloud, "unit") in ANGLES else _stated(cloud, "crs")


def stated_systems(clouds: Pair[Any]) -> Pair[str | None]:
    """The systems of both clouds that can be compared; None for one that is known by a name at the most.

    Args:
        clouds: as of `stated_system`.
    """
    systems = clouds.map(stated_system)
    return systems.map(lambda crs: crs if crs is not None and (epsg_code(crs) or is_wkt(crs)) else None)


def in_one_system(clouds: Pair[Any]) -> bool:
    """True where the files of both clouds state the same coordinate reference system.

    Args:
        clouds: coordinates, or a cloud, a file or a survey.
    """
    systems = stated_systems(clouds)
    return systems.before is not None and systems.before == systems.after


def _stated(cloud: Any, name: str) -> str | None:
    return getattr(cloud, name) if isinstance(cloud, PointCloud | CloudFile | SurveyFiles) else None


def _file(cloud: PointCloud | CloudFile | SurveyFiles) -> str:
    """The source of a cloud, in brackets; empty where it is not known."""
    if isinstance(cloud, PointCloud):
        return "" if cloud.source is None else f" ({cloud.source})"
    return f" ({cloud.path if isinstance(cloud, CloudFile) else cloud.title})"
