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
from gmmjax.clouds import atomic_write
from gmmjax.geometry import hull_corners

TABLE_FILE = "changes.csv"
MAP_FILE = "changes.geojson"
# Widths of a footprint below this share of its length are rounding.
NO_WIDTH = 1e-9


def write_table(path: Path, changes: Changes) -> None:
    """Writes the changes as CSV: a row each, with the fields of `ChangeColumns` and the unit; what is None is empty.

    Args:
        path: the file to write.
        changes: what was found.

    Raises:
        InputError, OSError: the file cannot be written.
    """
    names = [field.name for field in dataclasses.fields(ChangeColumns)]
    text = io.StringIO(newline="")
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow([*names, "unit"])
    for row in change_columns(changes):
        writer.writerow([*(getattr(row, name) for name in names), changes.unit])
    with atomic_write(path) as file:
        file.write(text.getvalue().encode())


def write_map(path: Path, changes: Changes, crs: str | None) -> None:
    """Writes the changes as GeoJSON: the outline of each box from above, with the fields of its row as properties.

    Coordinates are those of the scans, not degrees: with a `crs` member, which QGIS and GDAL know, where the scans
    state their system. Outlines are counterclockwise (RFC 7946); that of a box without a width is a line or a point.

    Args:
        path: the file to write.
        changes: what was found.
        crs: coordinate reference system of the scans, as "EPSG:25832"; None where it is not known.

    Raises:
        InputError, OSError: the file cannot be written.
    """
    content: dict[str, Any] = {"type": "FeatureCollection"}
    if crs is not None:
        authority, code = crs.split(":")
        content["crs"] = {"type": "name", "properties": {"name": f"urn:ogc:def:crs:{authority}::{code}"}}
    content["features"] = [
        _feature(row, change.box, changes.unit) for row, change in zip(change_columns(changes), changes, strict=True)
    ]
    with atomic_write(path) as file:
        file.write(json.dumps(content, indent=1, allow_nan=False).encode())


def _feature(row: ChangeColumns, box: Box, unit: str | None) -> dict[str, Any]:
    corners = box.corners()
    heights = corners[:, 2]
    properties = {**dataclasses.asdict(row), "base": heights.min().item(), "top": heights.max().item(), "unit": unit}
    return {"type": "Feature", "id": row.change, "geometry": _geometry(corners[:, :2]), "properties": properties}


def _geometry(places: Float[np.ndarray, "8 2"]) -> dict[str, Any]:
    """The outline of the corners of a box seen from above; of one without a width the line or the point that it is."""
    centre = places.mean(axis=0)
    near = places - centre
    length = float(np.ptp(near, axis=0).max())
    ring = hull_corners(near)
    if _area(ring) > NO_WIDTH * length**2:
        return {"type": "Polygon", "coordinates": [(centre + np.concatenate([ring, ring[:1]])).tolist()]}
    ends = near[np.lexsort(near.T)][[0, -1]]
    if length > 0:
        return {"type": "LineString", "coordinates": (centre + ends).tolist()}
    return {"type": "Point", "coordinates": centre.tolist()}


def _area(ring: Float[np.ndarray, "n 2"]) -> float:
    """What a ring of corners encloses, positive where it is counterclockwise."""
    following = np.roll(ring, -1, axis=0)
    return float((ring[:, 0] * following[:, 1] - following[:, 0] * ring[:, 1]).sum()) / 2
