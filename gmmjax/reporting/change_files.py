"""The changes as a table (CSV) and as footprints on a map (GeoJSON)."""

import csv
import dataclasses
import io
import json
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from gmmjax.changes import Box, ChangeColumns, Changes, change_columns
from gmmjax.clouds import atomic_write, epsg_code, is_wkt, system_name
from gmmjax.errors import warn
from gmmjax.geometry import hull_corners
from gmmjax.reporting.geotiff import longitude_latitude

TABLE_FILE = "changes.csv"
MAP_FILE = "changes.geojson"
# Widths of a footprint below this share of its length are rounding.
NO_WIDTH = 1e-9
# GDAL takes coordinates without a system for degrees.
LOCAL_SYSTEM = 'LOCAL_CS["coordinates of the scans",UNIT["unknown",1]]'


def write_table(path: Path, changes: Changes) -> None:
    """Write the changes as CSV: a row each, with the fields of `ChangeColumns` and the unit; what is None is empty."""
    names = [field.name for field in dataclasses.fields(ChangeColumns)]
    text = io.StringIO(newline="")
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow([*names, "unit"])
    for row in change_columns(changes):
        writer.writerow([*(getattr(row, name) for name in names), changes.unit])
    with atomic_write(path) as file:
        file.write(text.getvalue().encode())


def write_map(path: Path, changes: Changes) -> None:
    """Write the changes as GeoJSON: the outline of each box from above, with the fields of its row as properties.

    Coordinates are longitude and latitude in WGS 84, as RFC 7946 has them, where the system of the scans is known and
    rasterio is installed. Else they are those of the scans, and a `crs` member says so, of which QGIS and GDAL take
    notice. Outlines are counterclockwise; that of a box without a width is a line or a point.

    Args:
        path: the file to write.
        changes: what was found.

    Raises:
        InputError, OSError: the file cannot be written.

    Warns:
        InputWarning: the scans state a system, and the coordinates are not converted.
    """
    outlines = [_outline(change.box.corners()[:, :2]) for change in changes]
    degrees = None if changes.crs is None else _in_degrees(path, outlines, changes.crs)
    content: dict[str, Any] = {"type": "FeatureCollection", "crs_of_scans": changes.crs}
    if degrees is None:
        content["crs"] = {"type": "name", "properties": {"name": _legacy_name(changes.crs)}}
    content["features"] = [
        _feature(row, change.box, outline, changes.unit)
        for row, change, outline in zip(
            change_columns(changes), changes, outlines if degrees is None else degrees, strict=True
        )
    ]
    with atomic_write(path) as file:
        file.write(json.dumps(content, indent=1, allow_nan=False).encode())


def _in_degrees(path: Path, outlines: list[np.ndarray], crs: str) -> list[np.ndarray] | None:
    """Convert outlines to longitude and latitude; None, with a warning, where they cannot be converted."""
    degrees = longitude_latitude(np.concatenate([np.empty((0, 2)), *outlines]), crs)
    if degrees is None:
        warn(
            f"{path.name} is in {system_name(crs)}, not in degrees: programs that ignore its member crs will misplace "
            "it. pip install 'gmmjax[map]' converts map projections that PROJ knows to longitude and latitude"
        )
        return None
    ends = np.cumsum([len(outline) for outline in outlines])
    return [degrees[end - len(outline) : end] for end, outline in zip(ends, outlines, strict=True)]


def _legacy_name(crs: str | None) -> str:
    """Name a system as GeoJSON of 2008 does; GDAL takes WKT, too, and then never takes lengths for degrees."""
    if crs is not None and (code := epsg_code(crs)) is not None:
        return f"urn:ogc:def:crs:{code.replace(':', '::')}"
    return crs if crs is not None and is_wkt(crs) else LOCAL_SYSTEM


def _feature(row: ChangeColumns, box: Box, outline: Float[np.ndarray, "n 2"], unit: str | None) -> dict[str, Any]:
    heights = box.corners()[:, 2]
    properties = {**dataclasses.asdict(row), "base": heights.min().item(), "top": heights.max().item(), "unit": unit}
    return {"type": "Feature", "id": row.change, "geometry": _geometry(outline), "properties": properties}


def _outline(places: Float[np.ndarray, "8 2"]) -> Float[np.ndarray, "n 2"]:
    """Outline a box by its corners seen from above: a ring, two ends where it has no width, or a point."""
    centre = places.mean(axis=0)
    near = places - centre
    length = float(np.ptp(near, axis=0).max())
    ring = hull_corners(near)
    if _area(ring) > NO_WIDTH * length**2:
        return np.asarray(centre + np.concatenate([ring, ring[:1]]))
    return np.asarray(centre + near[np.lexsort(near.T)][[0, -1]] if length > 0 else centre[None])


def _geometry(outline: Float[np.ndarray, "n 2"]) -> dict[str, Any]:
    if len(outline) < 3:
        kind, places = ("Point", outline[0]) if len(outline) == 1 else ("LineString", outline)
        return {"type": kind, "coordinates": places.tolist()}
    # The axes of some systems point south and west.
    ring = outline if _area(outline - outline[0]) > 0 else outline[::-1]
    return {"type": "Polygon", "coordinates": [ring.tolist()]}


def _area(ring: Float[np.ndarray, "n 2"]) -> float:
    """Return the area that a ring of corners encloses, positive where it is counterclockwise."""
    following = np.roll(ring, -1, axis=0)
    return float((ring[:, 0] * following[:, 1] - following[:, 0] * ring[:, 1]).sum()) / 2
